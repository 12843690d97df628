// Islands: which bodies belong together, which method advances an island and why, and changes as a
// world runs.

#include <algorithm>

#include "engine/islands/islands.h"
#include "engine/math/list.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

TEST(FindIslands, JoinsWhatJointsJoin) {
  // Body 0 is immovable, as the world; 3-4-1 and 2-5 are joined, 6 is alone; the last joint is
  // inactive.
  const List<bool> movable{false, true, true, true, true, true, true};
  const List<std::pair<std::size_t, std::size_t>> ends{{3, 4}, {4, 1}, {0, 3},
                                                       {2, 5}, {0, 5}, {5, 6}};
  const auto islands = find_islands(movable, {true, true, true, true, true, false}, ends);
  ASSERT_EQ(islands.size(), 3u);
  EXPECT_EQ(islands[0].bodies, (List<int>{1, 3, 4}));
  EXPECT_EQ(islands[0].joints, (List<int>{0, 1, 2}));
  EXPECT_EQ(islands[1].bodies, (List<int>{2, 5}));
  EXPECT_EQ(islands[1].joints, (List<int>{3, 4}));
  EXPECT_EQ(islands[2].bodies, (List<int>{6}));
  EXPECT_TRUE(islands[2].joints.empty());
}

TEST(FindIslands, AgreesWithLabelsSpreadAlongJoints) {
  Random random;
  for (int trial = 0; trial < 100; ++trial) {
    const std::size_t n = 30;
    List<bool> movable, acting;
    for (std::size_t i = 0; i < n; ++i) movable.push_back(random() > -0.7);
    List<std::pair<std::size_t, std::size_t>> ends;
    for (int j = 0; j < 25; ++j) {
      const auto a = static_cast<std::size_t>(15.0 * (1.0 + random()));
      const auto b = static_cast<std::size_t>(15.0 * (1.0 + random()));
      if (a == b || (!movable[a] && !movable[b])) continue;
      ends.emplace_back(a, b);
      acting.push_back(random() > -0.5);
    }
    List<std::size_t> label(n);
    for (std::size_t i = 0; i < n; ++i) label[i] = i;
    for (std::size_t pass = 0; pass < n; ++pass) {
      for (std::size_t j = 0; j < ends.size(); ++j) {
        const auto [a, b] = ends[j];
        if (acting[j] && movable[a] && movable[b])
          label[a] = label[b] = std::min(label[a], label[b]);
      }
    }
    std::size_t bodies = 0, joints = 0;
    for (const IslandMembers& island : find_islands(movable, acting, ends)) {
      const std::size_t expected = label[static_cast<std::size_t>(island.bodies.front())];
      EXPECT_EQ(static_cast<std::size_t>(island.bodies.front()), expected);
      for (const int body : island.bodies)
        EXPECT_EQ(label[static_cast<std::size_t>(body)], expected);
      bodies += island.bodies.size();
      joints += island.joints.size();
    }
    EXPECT_EQ(bodies, static_cast<std::size_t>(std::count(movable.begin(), movable.end(), true)));
    EXPECT_EQ(joints, static_cast<std::size_t>(std::count(acting.begin(), acting.end(), true)));
  }
}

// ---- methods and reasons

WorldOptions default_options(double time_step = 0.01) {
  WorldOptions options;
  options.time_step = time_step;
  return options;
}

/// A point mass on this joint.
World hanging(const Joint& joint, const WorldOptions& options = default_options()) {
  World world(options);
  Joint added = joint;
  added.body_b = world.add_body(make_body("bob", Point{}, 1.0, {1.0, 0.0, 0.0}));
  world.add_joint(added);
  return world;
}

Island only_island(const World& world) {
  EXPECT_EQ(world.islands().size(), 1u);
  return world.islands().front();
}

TEST(Islands, HaveTheMethodThatTheirJointsAskFor) {
  Joint motor = hang("j", {});
  motor.motor.bias = 0.1;
  EXPECT_EQ(only_island(hanging(motor)).why, MethodReason::kSmooth);
  motor.motor.max_force = 5.0;
  EXPECT_EQ(only_island(hanging(motor)).why, MethodReason::kForceLimit);
  EXPECT_EQ(only_island(hanging(hang("j", {}))).why, MethodReason::kSmooth);
  EXPECT_EQ(only_island(hanging(hang("j", {}, JointKind::kBall))).why, MethodReason::kSmooth);
  EXPECT_EQ(only_island(hanging(hang("j", {}, rope(2.0)))).why, MethodReason::kLimit);
  EXPECT_EQ(only_island(hanging(hang("j", {}, between(0.5, 2.0)))).why, MethodReason::kLimit);
  EXPECT_EQ(only_island(hanging(hang("j", {}, spring(1.0, 100.0, 1.0)))).why,
            MethodReason::kSmooth);
}

TEST(Islands, SpringsOffCentreAreStifferOnSlimBodies) {
  // A spring at r moves its end by 1/m + (r × n)·I⁻¹(r × n) for a unit force along n. The inertia
  // about the rod's axis z is 6.7e-5 kg m², about x and y 0.083 kg m². A lever along z turns the
  // rod about x and y only (at most 4 times 1/m), a lever across z about z too (3750 times 1/m).
  const auto why = [](const Vector3d& anchor) {
    World world(default_options());
    Joint joint = hang("j", {}, spring(1.0, 1e6, 0.0));
    joint.body_b = world.add_body(make_body("rod", Box{{0.02, 0.02, 1.0}}, 1.0, {1.0, 0.0, 0.0}));
    joint.anchor_b = anchor;
    world.add_joint(joint);
    return only_island(world).why;
  };
  EXPECT_EQ(why({0.0, 0.0, 0.0}), MethodReason::kSmooth);
  EXPECT_EQ(why({0.0, 0.0, 0.5}), MethodReason::kSmooth);
  EXPECT_EQ(why({0.5, 0.0, 0.0}), MethodReason::kStiff);
}

TEST(Islands, SpringsAreIntegratedWhileSubstepsArePaying) {
  // a single spring on a mass: the bound is ω = √(2k/m), the limit 40 rad a tick
  const double limit = 0.5 * std::pow(40.0 / 0.01, 2);
  EXPECT_EQ(only_island(hanging(hang("j", {}, spring(1.0, 0.99 * limit, 0.0)))).why,
            MethodReason::kSmooth);
  EXPECT_EQ(only_island(hanging(hang("j", {}, spring(1.0, 1.01 * limit, 0.0)))).why,
            MethodReason::kStiff);
  EXPECT_EQ(only_island(hanging(hang("j", {}, spring(1.0, 1.0, 2001.0)))).why,
            MethodReason::kStiff);
  WorldOptions asked = default_options();
  asked.method = Method::kRungeKutta;
  const World world = hanging(hang("j", {}, spring(1.0, 1.01 * limit, 0.0)), asked);
  EXPECT_EQ(only_island(world).method, Method::kRungeKutta);
}

TEST(Islands, AMethodAskedForByNameIsTaken) {
  WorldOptions asked = default_options();
  asked.method = Method::kSequentialImpulses;
  const Island island = only_island(hanging(hang("j", {}), asked));
  EXPECT_EQ(island.method, Method::kSequentialImpulses);
  EXPECT_EQ(island.why, MethodReason::kAskedFor);
}

TEST(Islands, AreMadeAnewWhenJointsComeAndGo) {
  World world(default_options());
  const BodyId a = world.add_body(make_body("a", Point{}, 1.0, {1.0, 0.0, 0.0}));
  const BodyId b = world.add_body(make_body("b", Point{}, 1.0, {2.0, 0.0, 0.0}));
  world.step();
  EXPECT_EQ(world.islands().size(), 2u);
  const JointId rod = world.add_joint(make_joint("rod", a, Vector3d::Zero(), b, Vector3d::Zero()));
  EXPECT_EQ(world.islands().size(), 1u);  // reported before the next step
  world.step();
  EXPECT_EQ(only_island(world).bodies, 2u);
  world.set_broken(rod, true);
  EXPECT_EQ(world.islands().size(), 2u);
  world.set_broken(rod, false);
  EXPECT_EQ(world.islands().size(), 1u);
  world.remove_body(b);
  world.step();
  EXPECT_EQ(only_island(world).first_body, a);
}

TEST(Islands, AreImpulsesWhileTheyTouchAndTheReportSaysSo) {
  WorldOptions options = default_options();
  options.method = Method::kRungeKutta;
  World world(options);
  world.add_body(make_floor(0.5));
  Body ball = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.6});
  ball.restitution = 0.8;
  world.add_body(ball);
  world.add_body(make_body("far", Sphere{0.1}, 1.0, {9.0, 0.0, 99.0}));
  std::uint32_t changes = 0;
  bool has_bounced = false;
  for (int i = 0; i < 60; ++i) {
    const StepReport& report = world.step();
    const bool touches = report.contacts.points > 0;
    has_bounced = has_bounced || touches;
    const std::vector<Island> islands = world.islands();
    EXPECT_EQ(islands[0].why, touches ? MethodReason::kContact : MethodReason::kSmooth) << i;
    EXPECT_EQ(islands[1].why, MethodReason::kSmooth);
    EXPECT_EQ(report.costs.islands[index_of(Method::kTimeStepping)], touches ? 1 : 0);
    EXPECT_EQ(report.costs.islands[index_of(Method::kRungeKutta)], touches ? 1 : 2);
    changes += report.costs.method_changes;
  }
  EXPECT_TRUE(has_bounced);
  EXPECT_EQ(changes, 2u);  // into the contact and out of it
}

TEST(Islands, AreToldAfterABodyInContactIsGone) {
  World world(default_options());
  world.add_body(make_floor(0.5));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.09}));
  world.add_body(make_body("far", Sphere{0.1}, 1.0, {9.0, 0.0, 99.0}));
  world.step();
  EXPECT_EQ(world.islands().front().why, MethodReason::kOverlap);
  world.remove_body(ball);
  EXPECT_EQ(only_island(world).why, MethodReason::kSmooth);
  world.step();
}

TEST(Islands, ADrivenOneMayGoAfterASplitTick) {
  World world(default_options());
  const BodyId a = world.add_body(make_body("a", Point{}, 1.0, {1.0, 0.0, 0.0}));
  Joint winch = hang("winch", a);
  winch.motor.bias = 0.1;
  winch.motor.timeout = 0.005;  // ends within the tick
  world.add_joint(winch);
  world.step();
  world.remove_body(a);
  world.step();
  EXPECT_TRUE(world.islands().empty());
}

TEST(Islands, WhatIsInNoContactDoesNotNoticeThoseThatAre) {
  const auto make = [](bool with_contact) {
    World world(default_options());
    world.add_body(make_floor(0.5));
    world.add_joint(hang("rod", world.add_body(make_body("bob", Point{}, 1.0, {1.0, 0.0, 0.0}))));
    if (with_contact) world.add_body(make_body("ball", Sphere{0.1}, 1.0, {5.0, 0.0, 0.05}));
    return world;
  };
  World alone = make(false), beside = make(true);
  run(alone, 100);
  run(beside, 100);
  EXPECT_EQ(alone.state(alone.find_body("bob")).position,
            beside.state(beside.find_body("bob")).position);
}

// A pendulum with a ball that hits a wall.
struct PendulumAtAWall {
  World world;
  BodyId bob;
  JointId rod;

  PendulumAtAWall(double time_step, double speed) : world(default_options()) {
    WorldOptions options = default_options();
    options.method = Method::kRungeKutta;
    options.time_step = time_step;
    world.set_options(options);
    Body wall = make_body("wall", Plane{}, 0.0, {-0.2, 0.0, 0.0});
    wall.type = BodyType::kStatic;
    wall.state.orientation = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
    wall.restitution = 0.5;
    world.add_body(wall);
    Body ball = make_body("bob", Sphere{0.1}, 1.0, {1.0, 0.0, 0.0});
    ball.state.linear_velocity = {0.0, 0.0, -speed};
    bob = world.add_body(ball);
    rod = world.add_joint(hang("rod", bob));
  }
};

TEST(Islands, ComeBackFromImpulsesWithClosedJoints) {
  PendulumAtAWall at(0.01, 0.0);
  double speed = 0.0;
  for (int i = 0; i < 300; ++i) {
    const Vector3d before = at.world.state(at.bob).position;
    const bool touched = at.world.step().contacts.points > 0;
    const double moved = (at.world.state(at.bob).position - before).norm();
    if (i > 0 && !touched) {  // no jump: the body moves by its speed, within a tick's gravity
      EXPECT_LE(moved, 0.01 * (speed + 0.2)) << i;
    }
    speed = at.world.state(at.bob).linear_velocity.norm();
    EXPECT_FALSE(at.world.joint_state(at.rod).closing) << i;
    // The solver leaves residuals of 5e-6 g h, times h.
    EXPECT_LT(std::abs(at.world.joint_state(at.rod).error), 5e-9) << i;
  }
}

TEST(Islands, ComeBackFromImpulsesByClosingWhatTheseLeftOpen) {
  // The rod turns by some 60 degrees a step, for which curvature is not compensated.
  PendulumAtAWall at(0.1, 10.0);
  bool was_closing = false;
  for (int i = 0; i < 10; ++i) {
    at.world.step();
    was_closing = was_closing || at.world.joint_state(at.rod).closing;
  }
  EXPECT_TRUE(was_closing);
  run(at.world, 200);
  EXPECT_LT(std::abs(at.world.joint_state(at.rod).error), 1e-3);
}

}  // namespace
}  // namespace constraint_sim::engine
