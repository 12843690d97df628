// Splines, and joints that follow them.

#include <gtest/gtest.h>

#include <cmath>

#include "constraint_sim/engine/scene.h"
#include "sim/trajectories.h"

namespace constraint_sim {
namespace {

using engine::World;

// A polynomial of degree five passes through quintic points, one of degree three through cubic
// ones, and a line through positions: rounding of numbers of order 10.
TEST(Spline, ReproducesPolynomials) {
  for (const int order : {1, 3, 5}) {
    const double c[6] = {0.3,
                         -1.0,
                         order > 1 ? 0.5 : 0.0,
                         order > 1 ? 0.7 : 0.0,
                         order > 3 ? -0.4 : 0.0,
                         order > 3 ? 0.1 : 0.0};
    std::vector<TrajectoryPoint> points;
    for (const double t : {0.0, 0.4, 1.5, 2.0}) {
      TrajectoryPoint& point = points.emplace_back();
      point.time = t;
      for (int k = 0; k < 6; ++k) {
        point.position += c[k] * std::pow(t, k);
        if (k > 0) point.velocity += k * c[k] * std::pow(t, k - 1);
        if (k > 1) point.acceleration += k * (k - 1) * c[k] * std::pow(t, k - 2);
      }
    }
    const Spline spline(points, order);
    for (double t = 0.0; t <= 2.0; t += 0.01) {
      double expected = 0.0;
      for (int k = 0; k < 6; ++k) expected += c[k] * std::pow(t, k);
      EXPECT_NEAR(spline.at(t), expected, 1e-14) << order << " at " << t;
      double rate = 0.0;
      for (int k = 1; k < 6; ++k) rate += k * c[k] * std::pow(t, k - 1);
      if (t > 0.0) {
        EXPECT_NEAR(spline.rate(t), rate, 1e-13) << order << " at " << t;
      }
    }
    EXPECT_EQ(spline.at(-1.0), points.front().position);
    EXPECT_EQ(spline.at(3.0), points.back().position);
  }
}

World two_bars(const std::string& motor) {
  return engine::load_scene(R"(
world: {time_step: 0.01}
bodies:
  - {name: upper, mass: 2, shape: {box: {size: [1, 0.1, 0.1]}}, position: [0.5, 0, 0]}
  - {name: lower, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}, position: [1.5, 0, 0]}
constraints:
  - {name: shoulder, type: hinge, body_b: upper, anchor_b: [-0.5, 0, 0], axis_a: [0, 1, 0], lower: -2, upper: 2, )" +
                            motor + R"(}
  - {name: elbow, type: hinge, body_a: upper, anchor_a: [0.5, 0, 0], body_b: lower, anchor_b: [-0.5, 0, 0], axis_a: [0, 1, 0], )" +
                            motor + "}\n");
}

JointTrajectory to(double shoulder, double elbow) {
  JointTrajectory trajectory;
  trajectory.joints = {"shoulder", "elbow"};
  trajectory.points = {{0.5, {0.5 * shoulder, 0.2 * elbow}, {1.0, -0.3}, {0.0, 0.0}},
                       {1.0, {shoulder, elbow}, {0.0, 0.0}, {0.0, 0.0}}};
  return trajectory;
}

double position(const World& world, const char* joint) {
  return world.joint_state(world.find_joint(joint)).coordinates[0].position;
}

// Rate motors are on the spline at the end of each tick, and stay at its end.
TEST(Trajectories, MotorsAreOnTheSpline) {
  World world = two_bars("motor: {bias: 0}");
  Trajectories trajectories;
  trajectories.begin(world, to(0.8, -0.6));
  const Spline shoulder({{0.0, 0.0, 0.0, 0.0}, {0.5, 0.4, 1.0, 0.0}, {1.0, 0.8, 0.0, 0.0}}, 5);
  const Spline elbow({{0.0, 0.0, 0.0, 0.0}, {0.5, -0.12, -0.3, 0.0}, {1.0, -0.6, 0.0, 0.0}}, 5);
  for (int i = 0; i < 150; ++i) {
    trajectories.before_step(&world);
    world.step();
    // rounding of integrated joints
    ASSERT_NEAR(position(world, "shoulder"), shoulder.at(world.time()), 1e-12) << i;
    ASSERT_NEAR(position(world, "elbow"), elbow.at(world.time()), 1e-12) << i;
  }
  EXPECT_TRUE(trajectories.empty());
  EXPECT_LT(world.report().joints.max_error, 1e-12);
}

// Motors that have little more force than the motion takes are on the spline as well, with friction
// too: their rates do not jump between ticks. The bars need up to 40 N m. Starting from rest, and
// coming to rest, takes a jump of 3 % of the rate in one tick: 1e-8 rad.
TEST(Trajectories, MotorsWithLimitsAreOnTheSpline) {
  for (const double rate : {30.0, 60.0, 240.0, 1000.0}) {
    World world = two_bars("friction: 0.1, motor: {position: 0, max_force: 60}");
    engine::WorldOptions options = world.options();
    options.time_step = 1.0 / rate;
    world.set_options(options);
    JointTrajectory there_and_back;
    there_and_back.joints = {"shoulder", "elbow"};
    there_and_back.points = {{1.0, {0.3, -0.4}, {0.0, 0.0}, {0.0, 0.0}},
                             {2.0, {0.0, 0.1}, {0.0, 0.0}, {0.0, 0.0}}};
    Trajectories trajectories;
    trajectories.begin(world, there_and_back);
    const Spline shoulder({{0.0, 0.0, 0.0, 0.0}, {1.0, 0.3, 0.0, 0.0}, {2.0, 0.0, 0.0, 0.0}}, 5);
    const Spline elbow({{0.0, 0.0, 0.0, 0.0}, {1.0, -0.4, 0.0, 0.0}, {2.0, 0.1, 0.0, 0.0}}, 5);
    double most = 0.0;
    for (int i = 0; i < static_cast<int>(2.2 * rate); ++i) {
      trajectories.before_step(&world);
      world.step();
      most = std::max({most, std::abs(position(world, "shoulder") - shoulder.at(world.time())),
                       std::abs(position(world, "elbow") - elbow.at(world.time()))});
    }
    EXPECT_LT(most, 1e-8) << rate;
  }
}

// A servo of stiffness k and damping c on a wheel of inertia I, following a ramp of rate v, finally
// lags by c v/k, since the damper acts against the joint's own rate.
TEST(Trajectories, ServosLagAsTheirSpringSays) {
  World world = engine::load_scene(R"(
world: {time_step: 0.001, gravity: [0, 0, 0]}
bodies:
  - {name: wheel, mass: 2, shape: {sphere: {radius: 0.5}}}
constraints:
  - {name: axle, type: hinge, body_b: wheel, motor: {position: 0, servo_stiffness: 50, servo_damping: 8}}
)");
  JointTrajectory ramp;
  ramp.joints = {"axle"};
  ramp.points = {{2.0, {1.0}, {}, {}}};
  Trajectories trajectories;
  trajectories.begin(world, ramp);
  for (int i = 0; i < 1990; ++i) {
    trajectories.before_step(&world);
    world.step();
  }
  // the target is constant over a tick, and a tick of the ramp is 5e-4
  EXPECT_NEAR(world.time() * 0.5 - position(world, "axle"), 8.0 * 0.5 / 50.0, 5e-4);
}

// A number that no motor accepts is rejected at once, and a trajectory whose motor cannot be set
// later ends alone: no exception reaches the step.
TEST(Trajectories, NumbersBeyondThoseOfTheEngineDoNotReachTheStep) {
  World world = two_bars("motor: {bias: 0}");
  Trajectories trajectories;
  for (const double value : {1e308, -1e21}) {
    EXPECT_THROW(trajectories.begin(world, to(value, 0.0)), std::invalid_argument);
    EXPECT_TRUE(trajectories.empty());
  }
  JointTrajectory steep;  // 1e19 rad within 1e-9 s
  steep.joints = {"elbow"};
  steep.points = {{1e-9, {1e19}, {}, {}}};
  trajectories.begin(world, to(0.8, 0.0));
  trajectories.begin(world, steep);
  const std::vector<std::string> failures = trajectories.before_step(&world);
  ASSERT_EQ(failures.size(), 1u);
  EXPECT_NE(failures[0].find("'elbow'"), std::string::npos) << failures[0];
  EXPECT_EQ(trajectories.end(), std::vector<std::string>{"shoulder"});
}

TEST(Trajectories, ANewOneReplacesTheOldAndNoneStops) {
  World world = two_bars("motor: {bias: 0}");
  Trajectories trajectories;
  trajectories.begin(world, to(0.8, -0.6));
  const auto run = [&](int ticks) {
    for (int i = 0; i < ticks; ++i) {
      trajectories.before_step(&world);
      world.step();
    }
  };
  run(50);
  JointTrajectory stop;
  stop.joints = {"shoulder"};
  trajectories.begin(world, stop);
  const double stopped_at = position(world, "shoulder");
  run(100);
  EXPECT_NEAR(position(world, "shoulder"), stopped_at, 1e-12);
  EXPECT_NEAR(position(world, "elbow"), -0.6, 1e-12);
}

// A motor to a position is on the spline like one by rate, and then holds the end point; so does
// one whose trajectory was replaced or stopped on its way. 1e-12: rounding of integrated joints.
TEST(Trajectories, AMotorToAPositionStaysOne) {
  World world = two_bars("motor: {position: 0}");
  Trajectories trajectories;
  const engine::JointId shoulder = world.find_joint("shoulder"), elbow = world.find_joint("elbow");
  const auto target = [&](engine::JointId id) {
    return world.joint(id).coordinates[0].motor->position;
  };
  const Spline spline({{0.0, 0.0, 0.0, 0.0}, {0.5, 0.4, 1.0, 0.0}, {1.0, 0.8, 0.0, 0.0}}, 5);
  const auto run = [&](int ticks) {
    for (int i = 0; i < ticks; ++i) {
      trajectories.before_step(&world);
      world.step();
    }
  };
  trajectories.begin(world, to(0.8, -0.6));
  for (int i = 0; i < 110; ++i) {
    run(1);
    ASSERT_NEAR(position(world, "shoulder"), spline.at(world.time()), 1e-12) << i;
  }
  EXPECT_TRUE(trajectories.empty());
  EXPECT_EQ(target(shoulder), 0.8);
  EXPECT_EQ(target(elbow), -0.6);
  EXPECT_FALSE(trajectories.drop(shoulder));
  run(50);
  EXPECT_NEAR(position(world, "shoulder"), 0.8, 1e-12);

  trajectories.begin(world, to(0.2, 0.3));
  run(30);
  EXPECT_FALSE(target(shoulder));
  EXPECT_TRUE(trajectories.drop(elbow));
  trajectories.begin(world, to(0.4, 0.0));  // elbow is a motor by rate from here on
  JointTrajectory stop;
  stop.joints = {"shoulder"};
  trajectories.begin(world, stop);
  run(2);  // a motor in motion holds its end for a tick before it holds it as a position
  ASSERT_TRUE(target(shoulder));
  EXPECT_NEAR(*target(shoulder), position(world, "shoulder"), 1e-12);
  run(120);
  EXPECT_FALSE(target(elbow));
  EXPECT_NEAR(position(world, "elbow"), 0.0, 1e-12);
}

// As in ros_control, a first point at time 0 that is elsewhere, and points whose time is over, do
// not count: the joint goes from its present state to the next point.
TEST(Trajectories, BeginInThePresentState) {
  const auto run = [](const JointTrajectory& trajectory, int ticks) {
    World world = two_bars("motor: {bias: 0}");
    Trajectories trajectories;
    trajectories.begin(world, trajectory);
    std::vector<double> positions;
    for (int i = 0; i < ticks; ++i) {
      trajectories.before_step(&world);
      world.step();
      positions.push_back(position(world, "shoulder"));
    }
    return positions;
  };
  const auto expect_same = [](const std::vector<double>& a, const std::vector<double>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-12) << i;  // rounding
  };
  JointTrajectory off = to(0.8, -0.6);
  off.points.insert(off.points.begin(), {0.0, {2e-3, 0.1}, {0.0, 0.0}, {0.0, 0.0}});
  expect_same(run(off, 120), run(to(0.8, -0.6), 120));

  JointTrajectory late = to(0.8, -0.6);
  late.delay = -0.6;
  JointTrajectory rest;
  rest.joints = late.joints;
  rest.points = {{0.4, {0.8, -0.6}, {0.0, 0.0}, {0.0, 0.0}}};
  expect_same(run(late, 60), run(rest, 60));
}

// A joint at its limit is there to rounding, and may be told to stay there.
TEST(Trajectories, LimitsAreReachedToRounding) {
  World world = two_bars("motor: {position: 0}");
  Trajectories trajectories;
  trajectories.begin(world, to(2.0 + 1e-12, -0.6));
  for (int i = 0; i < 120; ++i) {
    trajectories.before_step(&world);
    world.step();
  }
  EXPECT_NEAR(position(world, "shoulder"), 2.0, 1e-12);  // rounding of integrated joints
  EXPECT_THROW(trajectories.begin(world, to(2.0 + 1e-5, -0.6)), std::invalid_argument);
}

// A motor whose trajectory ends on the way, as in a snapshot that was taken then, goes on at about
// the rate of that moment: 0.8 rad/s, and less than 3 % more in a tick.
TEST(Trajectories, AMotorThatIsLeftOnItsWayGoesOn) {
  World world = two_bars("motor: {position: 0}");
  Trajectories trajectories;
  trajectories.begin(world, to(0.8, -0.6));
  for (int i = 0; i < 30; ++i) {
    trajectories.before_step(&world);
    world.step();
  }
  EXPECT_TRUE(trajectories.drives(world.find_joint("shoulder")));
  trajectories.end();
  EXPECT_FALSE(trajectories.drives(world.find_joint("shoulder")));
  const Spline spline({{0.0, 0.0, 0.0, 0.0}, {0.5, 0.4, 1.0, 0.0}, {1.0, 0.8, 0.0, 0.0}}, 5);
  const double rate = spline.rate(0.3), from = position(world, "shoulder");
  for (int i = 0; i < 100; ++i) world.step();
  EXPECT_NEAR(position(world, "shoulder") - from, rate, 0.03 * rate);
}

TEST(Trajectories, WhatCannotBeIsNamed) {
  World world = two_bars("motor: {bias: 0}");
  World passive = two_bars("damping: 0");
  World by_force = two_bars("motor: {force: 1}");
  Trajectories trajectories;
  const auto refusal = [&](const World& in, const JointTrajectory& trajectory) -> std::string {
    try {
      trajectories.begin(in, trajectory);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  const auto expect = [&](const World& in, const JointTrajectory& trajectory, const char* part) {
    const std::string message = refusal(in, trajectory);
    EXPECT_NE(message.find(part), std::string::npos) << message << " has no " << part;
    EXPECT_TRUE(trajectories.empty());
  };
  expect(passive, to(0.1, 0.1), "has no motor");
  expect(by_force, to(0.1, 0.1), "goes by force");
  expect(world, to(3.0, 0.1), "goes from -2");
  JointTrajectory wrong = to(0.1, 0.1);
  wrong.joints[1] = "wrist";
  expect(world, wrong, "there is no constraint named 'wrist'");
  wrong.joints[1] = "shoulder";
  expect(world, wrong, "'shoulder' is there twice");
  wrong = to(0.1, 0.1);
  wrong.points[1].time = 0.5;
  expect(world, wrong, "points[1].time_from_start");
  wrong = to(0.1, 0.1);
  wrong.points[0].positions.pop_back();
  expect(world, wrong, "points[0].positions");
  wrong = to(0.1, 0.1);
  wrong.points[0].velocities.pop_back();
  expect(world, wrong, "points[0]");
  wrong = to(0.1, 0.1);
  wrong.points.resize(1);
  wrong.points[0].time = 0.0;
  expect(world, wrong, "cannot be elsewhere at once");
  wrong = to(0.1, 0.1);
  wrong.delay = -1.5;
  expect(world, wrong, "at a time that is not later");
  wrong = to(0.1, 0.1);
  wrong.points[0].positions[0] = std::nan("");
  expect(world, wrong, "finite");
}

// Ids of joints restart in another process: a trajectory ends with its world, and never drives
// another joint with that id.
TEST(Trajectories, EndWithTheJointTheyAreFor) {
  World world = two_bars("motor: {bias: 0}");
  Trajectories trajectories;
  trajectories.begin(world, to(0.8, -0.6));
  World other = engine::load_scene(R"(
bodies:
  - {name: a, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}}
  - {name: b, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}, position: [5, 0, 0]}
constraints:
  - {name: elbow, type: hinge, body_b: a, motor: {bias: 0}}
  - {name: shoulder, type: hinge, body_b: b, anchor_a: [5, 0, 0], motor: {bias: 0}}
)");
  ASSERT_EQ(other.find_joint("elbow"), world.find_joint("shoulder"));
  const auto hash = other.state_hash();
  trajectories.before_step(&other);
  EXPECT_EQ(other.state_hash(), hash);
  EXPECT_TRUE(trajectories.empty());

  trajectories.begin(world, to(0.8, -0.6));
  EXPECT_EQ(trajectories.end(), (std::vector<std::string>{"shoulder", "elbow"}));
  EXPECT_TRUE(trajectories.empty());
  world.step();
  EXPECT_NEAR(position(world, "shoulder"), 0.0, 1e-12);  // rounding of the rows

  trajectories.begin(world, to(0.8, -0.6));
  world.remove_joint(world.find_joint("elbow"));
  for (int i = 0; i < 200; ++i) {
    trajectories.before_step(&world);
    world.step();
  }
  EXPECT_TRUE(trajectories.empty());
  EXPECT_NEAR(position(world, "shoulder"), 0.8, 1e-12);
}

}  // namespace
}  // namespace constraint_sim
