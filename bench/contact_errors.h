#pragma once

// Compares the error estimate of steps of contacts with their true error, in random scenes. The
// reference is the same step from the same state by events, or where these give up, in parts with
// located impacts at a tenth of the tolerance, at most 1e-5 m/s. Not compared are steps that begin
// with an overlap or an open joint, which they correct, and landings on an edge or a face, for
// which no order of the corners is defined. Steps of sequential_impulses, whose contacts rest with
// an overlap of g h², are taken again without corrections, and compared with parts without them.

#include <algorithm>
#include <cmath>
#include <vector>

#include "problems.h"
#include "random_events.h"

namespace constraint_sim::engine::contact_errors {

/// Errors that are compared, and errors of joints and depths of contacts whose correction counts as
/// an error [m].
inline constexpr double kRounding = 1e-8;
inline constexpr double kDuration = 1.0;  // [s]

struct Settings {
  unsigned scenes = 0, seed = 0;
  double tolerance = 0.0;
  int parts = 0;
  Method method = Method::kTimeStepping;
};

struct Ratio {
  double ratio;
  unsigned kind, seed;
  double time, error;
};

struct Table {
  std::vector<Ratio> ratios;
  long steps = 0, unsolved = 0, left_out = 0, by_events = 0;
  long kept = 0, rejected = 0;  ///< parts of steps in contact
};

inline World with(World world, Method method, double time_step, double contact_tolerance) {
  WorldOptions options = world.options();
  options.method = method;
  options.baumgarte =  // closes errors as the whole step does
      1.0 - std::pow(1.0 - options.baumgarte, time_step / options.time_step);
  options.time_step = time_step;
  options.contact_tolerance = contact_tolerance;
  world.set_options(options);
  return world;
}

inline bool is_with_impulses(const World& world) {
  const std::vector<Island> islands = world.islands();
  return std::any_of(islands.begin(), islands.end(),
                     [](const Island& island) { return uses_impulses(island.method); });
}

inline double depth_of(const World& world) {
  double deepest = 0.0;
  for (const Contact& contact : world.contacts()) deepest = std::max(deepest, contact.depth);
  return deepest;
}

/// Whether a pair of bodies has got two points that bear in a step: a landing on an edge or a face,
/// in which the order of the corners is not defined.
inline bool has_landed(const World& before, const World& after) {
  const auto count = [](const World& world, const Contact& like) {
    return std::count_if(world.contacts().begin(), world.contacts().end(), [&](const Contact& c) {
      return c.body_a == like.body_a && c.body_b == like.body_b && c.normal_force > 0.0;
    });
  };
  return std::any_of(after.contacts().begin(), after.contacts().end(), [&](const Contact& one) {
    return count(after, one) >= 2 && count(before, one) < count(after, one);
  });
}

/// The state after a step.
inline World reference_of(const World& world, const Settings& settings, long* by_events) {
  constexpr double kLoosest = 1e-5;  // [m/s]
  const double h = world.options().time_step;
  World exact = with(world, Method::kEventDriven, h, 0.0);
  if (depth_of(world) <= kRounding) exact.step();
  if (exact.time() > world.time() && !is_with_impulses(exact)) {
    ++*by_events;
    return exact;
  }
  const double tolerance =
      settings.tolerance > 0.0 ? std::min(0.1 * settings.tolerance, kLoosest) : kLoosest;
  exact = with(world, Method::kTimeStepping, h / settings.parts, tolerance);
  for (int k = 0; k < settings.parts; ++k) exact.step();
  return exact;
}

/// A world in which impulses correct no positions.
inline World without_corrections(World world) {
  WorldOptions options = world.options();
  options.baumgarte = 0.0;
  world.set_options(options);
  return world;
}

/// Whether a step begins with errors that it corrects.
inline bool is_off(const World& before) {
  return depth_of(before) > kRounding || before.report().joints.max_error > kRounding;
}

inline void compare(const Settings& settings, unsigned kind, unsigned seed, Table* table) {
  random_events::Scene scene =
      random_events::scene_of(static_cast<random_events::Kind>(kind), seed);
  scene.options.method = settings.method;
  scene.options.contact_tolerance = settings.tolerance;
  const bool is_swept = settings.method == Method::kSequentialImpulses;
  World world = random_events::world_of(scene);
  while (world.time() < kDuration) {
    const World before = is_swept ? without_corrections(world) : world;
    world.step();
    if (!is_with_impulses(world)) continue;
    if ((!is_swept && is_off(before)) || has_landed(before, world)) {
      ++table->left_out;
      continue;
    }
    World after = before;
    after.step();
    const double estimate = after.report().local_error;
    const World exact = reference_of(before, settings, &table->by_events);
    ++table->steps;
    table->kept += after.report().costs.substeps;
    table->rejected += after.report().costs.rejected;
    if (std::isnan(estimate)) {
      ++table->unsolved;
      continue;
    }
    const double error = problems::largest_difference(after, exact);
    if (error > kRounding)
      table->ratios.push_back({estimate / error, kind, seed, world.time(), error});
  }
}

/// Ratios of estimate to error below which an estimate is too low.
inline constexpr double kTooLow = 0.25;

}  // namespace constraint_sim::engine::contact_errors
