#pragma once

// Judges random event-driven scenes by the oracles of random_events.h.

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "random_events.h"

namespace constraint_sim::engine::random_events {

struct Verdict {
  std::vector<std::string> findings;  ///< descriptions of errors with their figures
  unsigned events = 0;
  bool was_followed = false;  ///< else joints have to be closed at first, which moves bodies
  bool is_given_up = false;   ///< the engine reported that it gave up, and used impulses for a time
  bool is_left = false;       ///< has elements that are not event-driven
  bool is_back = false;       ///< event-driven again after impulses
  /// Evaluations of the equations of motion in the dearest event-driven tick, over those of the
  /// median one.
  double worst_tick = 0.0;

  void find(const char* what, double time, double figure) {
    char text[100];
    std::snprintf(text, sizeof text, "%s at %.9g s: %.3g", what, time, figure);
    findings.push_back(text);
  }
};

/// Returns whether impulses advance an island, or have left it at rest, or advanced one that the
/// step divided afterwards, where a joint broke.
inline bool is_with_impulses(const World& world) {
  const std::vector<Island> islands = world.islands();  // each call makes its own list
  const auto advanced = [&](Method method) {
    return world.report().costs.islands[static_cast<std::size_t>(method)] > 0;
  };
  return advanced(Method::kSequentialImpulses) || advanced(Method::kTimeStepping) ||
         std::any_of(islands.begin(), islands.end(),
                     [](const Island& island) { return uses_impulses(island.method); });
}

inline bool has_given_up(const World& world) {
  const std::vector<Island> islands = world.islands();  // each call makes its own list
  return std::any_of(islands.begin(), islands.end(), [](const Island& island) {
    return island.why == MethodReason::kContactsGivenUp || island.why == MethodReason::kRefused;
  });
}

inline bool is_closing(const World& world) {
  for (const JointId id : world.joint_ids())
    if (world.joint_state(id).closing) return true;
  return false;
}

/// Returns the largest power of motors [W]: full force at the target rate. In the other direction
/// motors brake.
inline double driven_power(const Scene& scene) {
  double power = 0.0;
  for (const Joint& joint : scene.parts.joints)
    for (const CoordinateLaw& law : joint.coordinates)
      if (law.motor)
        power +=
            law.motor->max_force * (std::abs(law.motor->bias) + std::abs(law.motor->amplitude));
  return power;
}

/// Coordinate with a position motor, at the end of a step.
struct PositionMotor {
  double position, speed, max_force;  ///< [m or rad], [m/s or rad/s], [N or N m]
};

inline std::vector<PositionMotor> position_motors(const World& world) {
  std::vector<PositionMotor> motors;
  for (const JointId id : world.joint_ids())
    for (std::size_t i = 0; i < kMaxCoordinates; ++i) {
      const CoordinateLaw& law = world.joint(id).coordinates[i];
      if (!law.motor || !law.motor->position || law.motor->is_servo()) continue;
      const CoordinateState& state = world.joint_state(id).coordinates[i];
      motors.push_back({state.position, std::abs(state.velocity), law.motor->max_force});
    }
  return motors;
}

/// Returns the largest work that position motors can do in a step [J]: full force along the way of
/// their coordinates. The way is the change of position, which impacts may leave large between slow
/// ends, and an allowance by the larger speed of both ends, for motions that reverse in the step.
inline double largest_work(std::vector<PositionMotor> before, const std::vector<PositionMotor>& now,
                           double time_step) {
  if (before.size() != now.size()) before = now;  // in the first step, or a joint broke
  double work = 0.0;
  for (std::size_t i = 0; i < now.size(); ++i) {
    const double fastest = std::max(before[i].speed, now[i].speed);
    work += now[i].max_force *
            (std::abs(now[i].position - before[i].position) + 2.0 * (fastest + 0.1) * time_step);
  }
  return work;
}

/// Returns the largest of these numbers of evaluations over the median. A median below one substep
/// of order 8 counts as one.
inline double worst_over_median(std::vector<unsigned> costs) {
  constexpr double kSubstep = 12.0;
  if (costs.empty()) return 0.0;
  std::sort(costs.begin(), costs.end());
  return costs.back() / std::max(kSubstep, static_cast<double>(costs[costs.size() / 2]));
}

/// Checks 2 s: energy within tolerance and motors' work, joints and gaps within rounding, events in
/// order. Steps by impulses are checked for energy less the reported work only, including steps in
/// which contacts switch between events and impulses.
inline void follow(const Scene& scene, Verdict* verdict) {
  World world = world_of(scene);
  verdict->was_followed = scene.kind == Kind::kArm || !is_closing(world);
  if (!verdict->was_followed) return;
  std::vector<unsigned> costs;  // evaluations of event-driven ticks
  // The bound covers 1e-8 m/s of tolerance over the exchanged energy, and rounding.
  const double allowed = 1e-7 * scene.largest;
  const double power = driven_power(scene);
  double least = world.energy(), latest = 0.0, booked = 0.0;
  std::vector<PositionMotor> motors, motors_before;
  bool was_by_impulses = false, comes_from_impulses = false;
  while (world.time() < 2.0 && verdict->findings.empty()) {
    const double before = world.time();
    const StepReport& report = world.step();
    const double now = world.time();
    if (report.outcome.failed) verdict->find("failed", now, report.joints.max_error);
    booked += report.energy.correction_work + report.energy.driven_work;
    std::swap(motors, motors_before);
    motors = position_motors(world);
    const double work = largest_work(motors_before, motors, world.options().time_step);
    least += power * (now - before) + work;
    const double energy = world.energy() - booked;
    // Joints that impulses left open are reported, and closing them does work.
    if (was_by_impulses && (report.joints.max_error > 1e-6 || is_closing(world))) return;
    if (has_servos(scene.kind) &&
        is_with_impulses(world)) {  // first order, without account of servos' work
      (has_given_up(world) ? verdict->is_given_up : verdict->is_left) = true;
      return;
    }
    if (!(energy < least + allowed)) verdict->find("energy has risen", now, energy - least);
    least = std::min(least, energy);
    if (is_with_impulses(world)) {
      (has_given_up(world) ? verdict->is_given_up : verdict->is_left) = true;
      was_by_impulses = comes_from_impulses = true;
      continue;
    }
    verdict->is_back = verdict->is_back || was_by_impulses;
    costs.push_back(report.costs.evaluations);
    verdict->events += report.costs.events;
    for (const Event& event : world.events()) {
      if (event.time < latest || event.time < before - 1e-12 || event.time > now + 1e-12)
        verdict->find("an event out of order", now, event.time);
      latest = event.time;
    }
    // The conditions are negated so that NaN is found.
    if (!(report.joints.max_error < (was_by_impulses ? 1e-6 : 1e-9)))
      verdict->find("joints are off", now, report.joints.max_error);
    // Events take over contacts that impulses left with an overlap of up to 1e-7 m.
    if (!(report.contacts.max_penetration < (comes_from_impulses ? 1e-7 : 1e-9)))
      verdict->find("bodies overlap", now, report.contacts.max_penetration);
    comes_from_impulses = false;
    // A late event leaves an overlap, which is then corrected. Initial overlaps are corrected in
    // the first step, which is exempt.
    if (touches(scene.kind) && !was_by_impulses && before > 0.0 &&
        !(std::abs(report.energy.correction_work) < allowed))
      verdict->find("bodies were moved apart", now, report.energy.correction_work);
    if (!was_by_impulses && power == 0.0 && work == 0.0 && report.energy.rise != 0.0)
      verdict->find("energy_rise", now, report.energy.rise);
  }
  verdict->worst_tick = worst_over_median(std::move(costs));
}

/// Checks that a copy, a snapshot, and a world with threads continue with the same bits.
inline void repeat(const Scene& scene, Verdict* verdict) {
  World world = world_of(scene), threaded = world_of(scene);
  WorldOptions options = threaded.options();
  options.threads = 3;
  threaded.set_options(options);
  const int steps = std::min(100, static_cast<int>(0.7 / scene.options.time_step));
  for (int i = 0; i < steps; ++i)
    for (World* each : {&world, &threaded}) each->step();
  World copy = world, again = read_snapshot(write_snapshot(world));
  for (int i = 0; i < 20; ++i) {
    for (World* each : {&world, &threaded, &copy, &again}) each->step();
    const double now = world.time();
    if (copy.state_hash() != world.state_hash()) return verdict->find("a copy differs", now, i);
    if (again.state_hash() != world.state_hash())
      return verdict->find("a snapshot differs", now, i);
    if (threaded.state_hash() != world.state_hash()) return verdict->find("threads differ", now, i);
  }
}

/// Compares with the scene moved, turned and added in another order: the motion is the same up to
/// shortly after the first hits, within their share of the tolerance. Later hits come in another
/// order, by rounding. Impulses depend on the order of bodies. Returns whether there were events to
/// compare.
inline bool place_elsewhere(const Scene& scene, Verdict* verdict) {
  Draw draw(scene.seed + 7);
  Placing placing;
  placing.shift = 3.0 * draw.vector();
  placing.turn = draw.turn();
  placing.is_reversed = true;
  World here = world_of(scene), there = world_of(scene, placing);
  const unsigned most = touches(scene.kind) ? 2 : 1000000;
  const double until = touches(scene.kind) ? 1.0 : 0.5;
  unsigned events = 0;
  while (events < most && here.time() < until) {
    events += here.step().costs.events;
    there.step();
    if (is_with_impulses(here) || is_with_impulses(there)) return false;
  }
  for (const BodyId id : here.body_ids()) {
    const BodyState& other = there.state(there.find_body(here.body(id).name));
    const Eigen::Vector3d expected = placing.shift + placing.turn * here.state(id).position;
    const double off = (other.position - expected).norm();
    if (!(off < 1e-6)) verdict->find("elsewhere it moves otherwise", here.time(), off);
  }
  return events > 0;
}

/// Compares mechanisms with the same of a thousandth and of a thousand times the mass.
inline void weigh_otherwise(const Scene& scene, Verdict* verdict) {
  World world = world_of(scene), light = world_of(with_masses(scene, 1e-3)),
        heavy = world_of(with_masses(scene, 1e3));
  while (world.time() < 0.5) {
    for (World* each : {&world, &light, &heavy}) each->step();
    if (is_with_impulses(world) || is_with_impulses(light) || is_with_impulses(heavy)) return;
  }
  for (const BodyId id : world.body_ids())
    for (const World* other : {&light, &heavy}) {
      const double off = (world.state(id).position - other->state(id).position).norm();
      if (!(off < 1e-6)) verdict->find("with other masses it moves otherwise", world.time(), off);
    }
}

/// Compares with the scene at a third of the time step, of touching bodies up to the first hits.
/// Returns whether both went by events.
inline bool step_finer(const Scene& scene, Verdict* verdict) {
  World coarse = world_of(scene), fine = world_of(scene);
  WorldOptions options = fine.options();
  options.time_step /= 3.0;
  fine.set_options(options);
  const unsigned most = touches(scene.kind) ? 2 : 1000000;
  const double until = touches(scene.kind) ? 1.0 : 0.5;
  for (unsigned events = 0; events < most && coarse.time() < until;) {
    events += coarse.step().costs.events;
    if (is_with_impulses(coarse)) return false;
    for (int i = 0; i < 3; ++i) {
      fine.step();
      if (is_with_impulses(fine)) return false;
    }
  }
  for (const BodyId id : coarse.body_ids()) {
    const double off = (coarse.state(id).position - fine.state(id).position).norm();
    if (!(off < 1e-6)) verdict->find("in finer steps it moves otherwise", coarse.time(), off);
  }
  return true;
}

/// Checks joints that close their errors: without impulses they have met within the closing time,
/// with rounding, while shapes never overlap.
inline void follow_closing(const Scene& scene, Verdict* verdict) {
  World world = world_of(scene);
  verdict->was_followed = true;
  while (world.time() < 2.0 && verdict->findings.empty()) {
    const StepReport& report = world.step();
    const double now = world.time();
    if (report.outcome.failed) verdict->find("failed", now, report.joints.max_error);
    if (is_with_impulses(world)) {
      (has_given_up(world) ? verdict->is_given_up : verdict->is_left) = true;
      return;
    }
    verdict->events += report.costs.events;
    if (!(report.contacts.max_penetration < 1e-9))
      verdict->find("bodies overlap", now, report.contacts.max_penetration);
    if (!is_closing(world) && !(report.joints.max_error < 1e-9))
      verdict->find("joints are off", now, report.joints.max_error);
  }
}

/// Judges a scene by all checks; an exception is a finding.
inline Verdict judge(Kind kind, unsigned seed) {
  Verdict verdict;
  try {
    const Scene scene = scene_of(kind, seed);
    (kind == Kind::kTouchingOpen ? follow_closing : follow)(scene, &verdict);
    if (!verdict.was_followed) return verdict;
    repeat(scene, &verdict);
    place_elsewhere(scene, &verdict);
    if (!touches(kind)) weigh_otherwise(scene, &verdict);
    if (!touches(kind) || kind == Kind::kTouchingCoupled || kind == Kind::kTouchingOpen)
      step_finer(scene, &verdict);
  } catch (const std::exception& error) {
    verdict.findings.push_back(std::string("throws: ") + error.what());
  }
  return verdict;
}

}  // namespace constraint_sim::engine::random_events
