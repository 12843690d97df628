#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "engine/collision/placed_shape.h"
#include "parts.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {

// ---- helpers shared by the tests of event-driven contacts

inline constexpr double kPlace =
    1e-12;  ///< tolerance of positions in closed form, also within a tick [m]
inline constexpr double kTime = 1e-12;  ///< tolerance of times [s]

/// Tolerances at any time step of positions [m] and times [s] of motions that methods integrate
/// with tolerances of velocities up to the default.
inline constexpr double kPlaceAtTicks = 1e-8, kTimeAtTicks = 1e-9;

/// Method and time step of a scene.
struct Carried {
  double time_step;
  Method method = Method::kEventDriven;
  double tolerance = 1e-10;
  bool has_poses = false;  ///< bodies are described in other frames, with poses of their shapes
  bool has_parts = false;  ///< these shapes are parts of compounds

  operator double() const { return time_step; }
};

inline void PrintTo(const Carried& by, std::ostream* out) {
  *out << by.time_step << " s, " << name(by.method) << ", " << by.tolerance << " m/s"
       << (by.has_parts   ? ", parts"
           : by.has_poses ? ", poses"
                          : "");
}

inline WorldOptions by_events(const Carried& by, double gravity = kGravity) {
  WorldOptions options = engine::options(by.time_step, gravity);
  options.method = by.method;
  options.tolerance = by.tolerance;
  return options;
}

inline WorldOptions by_events(double time_step, double gravity = kGravity) {
  return by_events(Carried{time_step}, gravity);
}

/// Returns time steps with a method, and time steps with the default method and tolerance. The
/// default test run has three of the seven.
inline std::vector<Carried> each_setting(Method method) {
  const WorldOptions unsaid;
  if (!kIsLongRun)
    return {{1.0 / 30, method},
            {1.0 / 1000, method},
            {unsaid.time_step, unsaid.method, unsaid.tolerance}};
  std::vector<Carried> all;
  for (const double time_step : {1.0 / 30, 1.0 / 60, 1.0 / 240, 1.0 / 1000})
    all.push_back({time_step, method});
  for (const double time_step : {1.0 / 30, unsaid.time_step, 1.0 / 1000})
    all.push_back({time_step, unsaid.method, unsaid.tolerance});
  return all;
}

/// Returns some settings with shape poses.
inline std::vector<Carried> with_poses() {
  std::vector<Carried> some{{1.0 / 30}, {1.0 / 240}, {1.0 / 60, Method::kAuto, 1e-8}};
  for (Carried& by : some) by.has_poses = true;
  return some;
}

/// Returns the same with compounds.
inline std::vector<Carried> with_parts() {
  std::vector<Carried> some = with_poses();
  for (Carried& by : some) by.has_parts = true;
  return some;
}

/// Describes all bodies and joints in other frames, in a new world, if requested; names stay.
inline void frame_anew(World* world, const Carried& by) {
  if (!by.has_poses) return;
  World framed(world->options());
  const auto frame_of = [&](BodyId id) {
    return id == kWorldBody ? ShapePose{} : other_frame(world->body(id));
  };
  for (const BodyId id : world->body_ids()) {
    Body body = world->body(id);
    body.state = world->state(id);
    const Body posed = in_frame(body, frame_of(id));
    ASSERT_EQ(framed.add_body(by.has_parts ? in_parts(posed) : posed), id);
  }
  for (const JointId id : world->joint_ids()) {
    Joint joint = world->joint(id);
    put_in_frame(frame_of(joint.body_a), true, &joint);
    put_in_frame(frame_of(joint.body_b), false, &joint);
    ASSERT_EQ(framed.add_joint(joint), id);
  }
  for (const Wrench& wrench : world->wrenches()) framed.add_wrench(wrench);
  *world = framed;
}

/// Returns the state of a body's shape.
inline BodyState shape_state(const World& world, BodyId id) {
  return PlacedShape(world.body(id), 0, world.state(id)).state();
}

inline Body with_surface(Body body, double friction, double restitution) {
  body.friction = friction;
  body.restitution = restitution;
  return body;
}

/// A plane through a point, solid on the side opposite to `normal`.
inline Body plane(const std::string& name, const Eigen::Vector3d& point,
                  const Eigen::Vector3d& normal, double friction, double restitution) {
  Body body;
  body.name = name;
  body.type = BodyType::kStatic;
  body.shape = Plane{};
  body.state.position = point;
  body.state.orientation = rotation_between(Eigen::Vector3d::UnitZ(), normal);
  return with_surface(body, friction, restitution);
}

/// Returns the events of one kind.
inline std::vector<Event> of_kind(const std::vector<Event>& events, EventKind kind) {
  std::vector<Event> found;
  for (const Event& event : events)
    if (event.kind == kind) found.push_back(event);
  return found;
}

inline bool is_by_impulses(const World& world) {
  return world.report().costs.islands[index_of(Method::kSequentialImpulses)] +
             world.report().costs.islands[index_of(Method::kTimeStepping)] >
         0;
}

/// Steps for a time and returns all events. Expects that all islands are event-driven.
inline std::vector<Event> advance(World* world, double seconds) {
  std::vector<Event> all;
  const int steps = static_cast<int>(std::lround(seconds / world->options().time_step));
  for (int i = 0; i < steps; ++i) {
    world->step();
    EXPECT_FALSE(is_by_impulses(*world)) << world->time();
    EXPECT_LT(world->report().contacts.max_penetration, 1e-9) << world->time();
    all.insert(all.end(), world->events().begin(), world->events().end());
  }
  return all;
}

/// Throws a box over a level surface at z = 0: it slides v²/2μg in the time v/μg, and stays on its
/// corners.
inline void expect_box_slides_to_rest(World* world, double mu, const Carried& by) {
  Body box = with_surface(make_body("box", Box{{0.6, 0.5, 0.4}}, 2.0, {0.0, 0.0, 0.2}), mu, 0.0);
  box.state.linear_velocity = {2.0, 0.5, 0.0};
  const BodyId id = world->add_body(box);
  frame_anew(world, by);
  const std::vector<Event> events = advance(world, 1.0);
  const Eigen::Vector3d& v = box.state.linear_velocity;
  const double speed = v.norm();
  const Eigen::Vector3d place =
      Eigen::Vector3d(0.0, 0.0, 0.2) + v / speed * (speed * speed / (2 * mu * kGravity));
  EXPECT_LT((world->state(id).position - place).norm(), kPlace);
  EXPECT_LT(world->state(id).linear_velocity.norm(), 1e-15);
  EXPECT_LT(world->state(id).angular_velocity.norm(), 1e-15);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kSticks);
  EXPECT_NEAR(events[0].time, speed / (mu * kGravity), kTime);
  ASSERT_EQ(world->contacts().size(), 4u);
  double force = 0.0;
  for (const Contact& contact : world->contacts()) force += contact.normal_force;
  EXPECT_NEAR(force, 2.0 * kGravity, 1e-9);
}

}  // namespace constraint_sim::engine
