// Settings of a body and options changed while the body moves.

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {
namespace {

Body ball_at(const std::string& name, double x, double z, double mass = 1.0) {
  Body body;
  body.name = name;
  body.shape = Sphere{0.1};
  body.mass = mass;
  body.state.position = {x, 0.0, z};
  return body;
}

// A mass on a spring: ω = √(k/m). A quarter of the mass swings twice as fast about the same point.
TEST(BodySettings, ANewMassSwingsAsFastAsItsSpringSays) {
  WorldOptions options;
  options.gravity.setZero();
  options.tolerance = 1e-10;
  World world(options);
  const BodyId id = world.add_body(ball_at("bob", 1.5, 0.0, 4.0));
  Joint spring;
  spring.name = "spring";
  spring.body_b = id;
  spring.distance.length = 1.0;
  spring.distance.stiffness = 100.0;
  world.add_joint(spring);
  const auto expect_swings = [&](double omega) {
    const double x0 = world.state(id).position.x() - 1.0;
    const double v0 = world.state(id).linear_velocity.x();
    const double t0 = world.time();
    for (int i = 0; i < 100; ++i) {
      world.step();
      const double t = world.time() - t0;
      const double x = x0 * std::cos(omega * t) + v0 / omega * std::sin(omega * t);
      // tolerance: 1e-10 m/s of local error over 1 s, amplified by the swing
      EXPECT_NEAR(world.state(id).position.x() - 1.0, x, 1e-9) << t;
    }
  };
  expect_swings(5.0);
  Body lighter = world.body(id);
  lighter.mass = 1.0;
  world.set_body(id, lighter);
  expect_swings(10.0);
}

// A torque gives a body τ/I: three times the inertia, a third of the angular acceleration.
TEST(BodySettings, ANewInertiaTurnsAsSlowlyAsItSays) {
  WorldOptions options;
  options.gravity.setZero();
  World world(options);
  Body top = ball_at("top", 0.0, 0.0);
  top.inertia = {0.1, 0.1, 0.1};
  const BodyId id = world.add_body(top);
  top.inertia *= 3.0;
  world.set_body(id, top);
  Wrench wrench;
  wrench.body = id;
  wrench.torque = {0.0, 0.0, 0.6};
  world.add_wrench(wrench);
  for (int i = 0; i < 100; ++i) world.step();
  EXPECT_NEAR(world.state(id).angular_velocity.z(), 2.0, 1e-12);  // 0.6 / 0.3 · 1 s
}

// A block on a slope stays where friction exceeds tan 30°, and else slides with g (sin − μ cos).
TEST(BodySettings, ANewFrictionLetsABodySlideThatWasAtRest) {
  World world;
  const double angle = 3.14159265358979323846 / 6.0;
  Body slope;
  slope.name = "slope";
  slope.type = BodyType::kStatic;
  slope.shape = Plane{};
  slope.friction = 1.0;
  slope.state.orientation = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY());
  world.add_body(slope);
  const Eigen::Vector3d normal = slope.state.orientation * Eigen::Vector3d::UnitZ();
  Body block;
  block.name = "block";
  block.shape = Box{{0.4, 0.4, 0.1}};
  block.mass = 1.0;
  block.friction = 1.0;
  block.state.position = 0.05 * normal;
  block.state.orientation = slope.state.orientation;
  const BodyId id = world.add_body(block);
  for (int i = 0; i < 300; ++i) world.step();
  EXPECT_LT(world.state(id).linear_velocity.norm(), 1e-6);
  EXPECT_EQ(world.report().costs.asleep, 1u);  // at rest, and woken by the edit
  Body smooth = world.body(id);
  smooth.friction = 0.04;  // a pair has the geometric mean, 0.2
  world.set_body(id, smooth);
  for (int i = 0; i < 100; ++i) world.step();
  const double expected = 9.81 * (std::sin(angle) - 0.2 * std::cos(angle));
  EXPECT_NEAR(world.state(id).linear_velocity.norm(), expected, 0.01 * expected);
}

TEST(BodySettings, WhatCannotBeChangesNothing) {
  World world;
  const BodyId id = world.add_body(ball_at("bob", 0.0, 0.0));
  Body point;
  point.name = "point";
  point.mass = 1.0;
  const BodyId point_id = world.add_body(point);
  world.step();
  const std::uint64_t hash = world.state_hash();
  const auto refused = [&](BodyId of, auto change) {
    Body body = world.body(of);
    change(&body);
    EXPECT_THROW(world.set_body(of, body), std::invalid_argument);
    EXPECT_EQ(world.state_hash(), hash);
  };
  refused(id, [](Body* body) { body->mass = 0.0; });
  refused(id, [](Body* body) { body->inertia = {1.0, 1.0, 0.0}; });
  refused(id, [](Body* body) { body->friction = -1.0; });
  refused(id, [](Body* body) { body->restitution = 2.0; });
  refused(id, [](Body* body) { body->name = "other"; });
  refused(id, [](Body* body) { body->type = BodyType::kStatic; });
  refused(point_id, [](Body* body) { body->inertia = {1.0, 1.0, 1.0}; });
  EXPECT_THROW(world.set_body(kWorldBody, world.body(kWorldBody)), std::invalid_argument);
}

// ---- options as text

TEST(OptionsAsText, AreThoseOfScenes) {
  WorldOptions options;
  set_option("gravity", " [0, 0, -1.62] ", &options);
  set_option("tolerance", "1e-6", &options);
  set_option("sleep_after", ".inf", &options);
  set_option("warm_starting", "off", &options);
  set_option("method", "event_driven", &options);
  EXPECT_EQ(options.gravity, Eigen::Vector3d(0.0, 0.0, -1.62));
  EXPECT_EQ(options.tolerance, 1e-6);
  EXPECT_TRUE(std::isinf(options.sleep_after));
  EXPECT_FALSE(options.warm_starting);
  EXPECT_EQ(options.method, Method::kEventDriven);
  EXPECT_EQ(options.order, WorldOptions{}.order);
  const std::vector<std::pair<const char*, std::string>> bad{
      {"gravity", "1"},
      {"gravity", "[1, 2]"},
      {"gravity", "[1, 2, 3, 4]"},
      {"gravity", "[1, 2, x]"},
      {"order", "5.5"},
      {"order", "5\norder: 8"},
      {"order", "5 # or 8"},
      {"tolerance", ".inf"},
      {"tolerance", ""},
      {"warm_starting", "1"},
      {"method", "fast"},
      {"colour", "red"},
      {"clock", "{}"},
      {"tolerance", std::string(1000000, '[')}};
  for (const auto& [name, text] : bad)
    EXPECT_THROW(set_option(name, text, &options), std::invalid_argument) << name;
}

}  // namespace
}  // namespace constraint_sim::engine
