// Goals of trajectories: how they end.

#include <gtest/gtest.h>

#include <cmath>

#include "constraint_sim/engine/scene.h"
#include "sim/trajectory_goals.h"

namespace constraint_sim {
namespace {

using engine::World;
using Cause = TrajectoryGoals::Cause;

/// A wheel without gravity, and a beam that gravity turns, each on a hinge with this motor.
struct Fixture {
  explicit Fixture(const std::string& motor)
      : world(engine::load_scene(R"(
world: {time_step: 0.01}
bodies:
  - {name: disc, mass: 2, shape: {sphere: {radius: 0.5}}, no_collision: true}
  - {name: bar, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}, position: [5.5, 0, 0]}
constraints:
  - {name: wheel, type: hinge, body_b: disc, motor: )" +
                                 motor + R"(}
  - {name: beam, type: hinge, body_b: bar, anchor_a: [5, 0, 0], anchor_b: [-0.5, 0, 0], axis_a: [0, 1, 0], motor: )" +
                                 motor + "}\n")) {}

  TrajectoryGoal goal(double wheel, double beam, double tolerance) {
    TrajectoryGoal goal;
    goal.trajectory.joints = {"wheel", "beam"};
    goal.trajectory.points = {{1.0, {wheel, beam}, {0.0, 0.0}, {}}};
    goal.path.resize(2);
    goal.goal.assign(2, {tolerance, 0.0});
    return goal;
  }
  /// Steps until goals end; returns these. Their time is that of the world.
  std::vector<TrajectoryGoals::End> run(int most) {
    for (int i = 0; i < most; ++i) {
      trajectories.before_step(&world);
      world.step();
      goals.stepped(world);
      std::vector<TrajectoryGoals::End> ended = goals.take_ended();
      if (!ended.empty()) return ended;
    }
    return {};
  }
  double position(const char* joint) const {
    return world.joint_state(world.find_joint(joint)).coordinates[0].position;
  }

  World world;
  Trajectories trajectories;
  TrajectoryGoals goals{&trajectories};
};

// A motor without a limit is on its trajectory to rounding, so that the goal ends with it: after
// 100 ticks of 0.01 s, or one more by rounding of the time.
TEST(TrajectoryGoals, AreReachedWithTheTrajectory) {
  for (const char* motor : {"{bias: 0}", "{position: 0}"}) {
    Fixture t(motor);
    t.goals.begin(t.world, 7, t.goal(0.5, -0.3, 1e-9));
    const auto ended = t.run(200);
    ASSERT_EQ(ended.size(), 1u);
    EXPECT_EQ(ended[0].id, 7u);
    EXPECT_EQ(ended[0].cause, Cause::kReached) << ended[0].why;
    EXPECT_NEAR(t.world.time(), 1.0, 0.011);
    EXPECT_NEAR(t.position("wheel"), 0.5, 1e-12);  // rounding of integrated joints
    EXPECT_TRUE(t.goals.empty());
  }
}

// A servo of stiffness k that holds a beam of mass m and length L rests at an angle near
// m g L / 2 k = 4.905 / 100 rad: beyond 0.01 rad, and within 0.1 rad. It is critically damped with
// ω² = k / I = 300 s⁻², and has settled to 1e-3 rad within 0.6 s.
TEST(TrajectoryGoals, HaveATimeForTheEnd) {
  const char* motor = "{position: 0, servo_stiffness: 100, servo_damping: 11.5}";
  Fixture missed(motor);
  TrajectoryGoal goal = missed.goal(0.0, 0.0, 0.01);
  goal.goal_time = 0.5;
  missed.goals.begin(missed.world, 1, goal);
  auto ended = missed.run(300);
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kGoalViolated);
  EXPECT_NE(ended[0].why.find("joint 'beam': position off by 0.04"), std::string::npos)
      << ended[0].why;
  EXPECT_NEAR(missed.world.time(), 1.5, 0.011);

  Fixture reached(motor);
  reached.goals.begin(reached.world, 1, reached.goal(0.0, 0.0, 0.1));
  ended = reached.run(300);
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kReached) << ended[0].why;

  Fixture moving(motor);  // a lag that needs the time after the end: 0.5 rad within 0.1 s
  goal = moving.goal(0.5, 0.0, 0.1);
  goal.trajectory.points[0].time = 0.1;
  goal.goal_time = 1.0;
  moving.goals.begin(moving.world, 1, goal);
  ended = moving.run(300);
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kReached) << ended[0].why;
  EXPECT_GT(moving.world.time(), 0.15);
}

// A motor with a fifth of the torque that gravity has leaves the path, and all joints of the goal
// stop, the wheel as well, which could follow.
TEST(TrajectoryGoals, EndWhereAJointLeavesThePath) {
  Fixture t("{position: 0, max_force: 1}");
  TrajectoryGoal goal = t.goal(0.5, 0.0, 0.01);
  goal.path[1].position = 0.05;
  t.goals.begin(t.world, 1, goal);
  const auto ended = t.run(200);
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kPathViolated);
  EXPECT_NE(ended[0].why.find("joint 'beam': position off by 0.0"), std::string::npos)
      << ended[0].why;
  EXPECT_LT(t.world.time(), 0.5);
  t.run(100);  // 1 N m brakes 0.2 kg m^2
  const double stopped_at = t.position("wheel");
  t.run(100);
  EXPECT_NEAR(t.position("wheel"), stopped_at, 1e-9);
}

TEST(TrajectoryGoals, EndWhereAJointIsTaken) {
  Fixture t("{position: 0}");
  t.goals.begin(t.world, 1, t.goal(0.5, 0.2, 0.01));
  t.run(20);
  TrajectoryGoal other = t.goal(0.1, 0.0, 0.01);
  other.trajectory.joints.pop_back();
  other.trajectory.points[0].positions.pop_back();
  other.trajectory.points[0].velocities.pop_back();
  t.goals.begin(t.world, 2, other);
  auto ended = t.goals.take_ended();
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].id, 1u);
  EXPECT_EQ(ended[0].cause, Cause::kReplaced);

  other.trajectory.joints = {"beam"};  // two goals without a joint in common
  t.goals.begin(t.world, 3, other);
  EXPECT_TRUE(t.goals.take_ended().empty());
  EXPECT_EQ(t.goals.progress(t.world).size(), 2u);
  t.goals.replace({"beam"}, "a command");
  ended = t.goals.take_ended();
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].id, 3u);
  EXPECT_EQ(ended[0].why, "a command takes joint 'beam'");

  t.goals.cancel(t.world, 2);
  ended = t.goals.take_ended();
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].id, 2u);
  EXPECT_EQ(ended[0].cause, Cause::kReplaced);
  const double stopped_at = t.position("wheel");
  t.run(150);
  EXPECT_NEAR(t.position("wheel"), stopped_at, 1e-12);  // rounding

  t.goals.begin(t.world, 4, t.goal(0.5, 0.2, 0.01));
  t.goals.end("load_scene");
  EXPECT_EQ(t.goals.take_ended()[0].why, "ended by load_scene");
  EXPECT_TRUE(t.goals.empty());
}

TEST(TrajectoryGoals, EndWithTheirJoints) {
  Fixture t("{position: 0}");
  t.goals.begin(t.world, 1, t.goal(0.5, 0.2, 0.01));
  t.run(20);
  t.world.remove_joint(t.world.find_joint("beam"));
  t.goals.edited(t.world);
  auto ended = t.goals.take_ended();
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kLost);
  EXPECT_EQ(ended[0].why, "joint 'beam' is gone");
  EXPECT_TRUE(t.goals.progress(t.world).empty());

  Fixture motorless("{position: 0}");
  motorless.goals.begin(motorless.world, 1, motorless.goal(0.5, 0.2, 0.01));
  motorless.run(20);
  motorless.world.set_motor(motorless.world.find_joint("beam"), 0, std::nullopt);
  ended = motorless.run(5);
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kLost);
}

// A goal that cannot begin changes nothing: the one on its way goes on.
TEST(TrajectoryGoals, ThatCannotBeginChangeNothing) {
  Fixture t("{position: 0}");
  t.goals.begin(t.world, 1, t.goal(0.5, 0.2, 1e-9));
  t.run(20);
  TrajectoryGoal wrong = t.goal(0.1, 0.1, 0.01);
  wrong.trajectory.joints[1] = "nobody";
  EXPECT_THROW(t.goals.begin(t.world, 2, wrong), TrajectoryError);
  TrajectoryGoal late = t.goal(0.1, 0.1, 0.01);
  late.trajectory.delay = -2.0;
  EXPECT_THROW(t.goals.begin(t.world, 3, late), TrajectoryError);
  EXPECT_TRUE(t.goals.take_ended().empty());
  const auto ended = t.run(200);
  ASSERT_EQ(ended.size(), 1u);
  EXPECT_EQ(ended[0].cause, Cause::kReached) << ended[0].why;
}

// The progress is the spline's motion and the joint's: a cubic through u = 0.5 has half its way and
// 1.5 times the mean rate.
TEST(TrajectoryGoals, TellTheirProgress) {
  Fixture t("{position: 0}");
  t.goals.begin(t.world, 1, t.goal(0.5, -0.3, 0.01));
  t.run(50);
  const auto progress = t.goals.progress(t.world);
  ASSERT_EQ(progress.size(), 1u);
  EXPECT_NEAR(progress[0].time, 0.5, 1e-12);
  const TrajectoryGoals::Progress::Joint& wheel = progress[0].joints[0];
  EXPECT_EQ(wheel.name, "wheel");
  EXPECT_NEAR(wheel.desired_position, 0.25, 1e-12);
  EXPECT_NEAR(wheel.desired_velocity, 0.75, 1e-12);
  EXPECT_NEAR(wheel.position, 0.25, 1e-12);
  EXPECT_NEAR(wheel.velocity, 0.75, 0.01);  // the rate within a tick is not the spline's
}

}  // namespace
}  // namespace constraint_sim
