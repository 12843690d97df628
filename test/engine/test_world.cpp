// The world: ids, edits, time, failure, and the report of a step.

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Body ball_on_x(const std::string& name, double x) {
  return make_body(name, Sphere{0.1}, 1.0, {x, 0.0, 0.0});
}

/// Five balls in a row, joined one to the next: rod_0 joins ball_0 and ball_1.
struct Row5 {
  World world{options(0.01)};
  std::vector<BodyId> bodies;
  std::vector<JointId> joints;

  Row5() {
    for (int i = 0; i < 5; ++i)
      bodies.push_back(world.add_body(ball_on_x("ball_" + std::to_string(i), i)));
    for (int i = 0; i < 4; ++i)
      joints.push_back(
          world.add_joint(make_joint("rod_" + std::to_string(i), bodies[i], Vector3d::Zero(),
                                     bodies[i + 1], Vector3d::Zero())));
  }
};

// ---- ids

TEST(Ids, StayValidOverAddingRemovingAndStepping) {
  Row5 row;
  World& world = row.world;
  EXPECT_EQ(world.remove_body(row.bodies[1]), (std::vector<std::string>{"rod_0", "rod_1"}));
  world.step();
  world.remove_joint(row.joints[2]);
  const BodyId late = world.add_body(ball_on_x("late", 9.0));
  world.step();
  for (const int i : {0, 2, 3, 4}) {
    const std::string name = "ball_" + std::to_string(i);
    EXPECT_EQ(world.body(row.bodies[i]).name, name);
    EXPECT_EQ(world.find_body(name), row.bodies[i]);
    EXPECT_DOUBLE_EQ(world.state(row.bodies[i]).position.x(), i);
  }
  EXPECT_EQ(world.body(late).name, "late");
  EXPECT_EQ(world.joint(row.joints[3]).name, "rod_3");
  EXPECT_EQ(world.joint(row.joints[3]).body_b, row.bodies[4]);
  EXPECT_EQ(world.body_ids(), (std::vector<BodyId>{row.bodies[0], row.bodies[2], row.bodies[3],
                                                   row.bodies[4], late}));
  EXPECT_EQ(world.joint_ids(), (std::vector<JointId>{row.joints[3]}));
}

TEST(Ids, AreNeverUsedAgain) {
  Row5 row;
  World& world = row.world;
  world.remove_body(row.bodies[4]);
  const BodyId again = world.add_body(ball_on_x("ball_4", 4.0));
  for (const BodyId id : row.bodies) EXPECT_NE(again, id);
  EXPECT_THROW(world.state(row.bodies[4]), std::invalid_argument);
  EXPECT_THROW(world.remove_body(row.bodies[4]), std::invalid_argument);
  world.remove_joint(row.joints[0]);
  const JointId joint = world.add_joint(
      make_joint("rod_0", row.bodies[0], Vector3d::Zero(), again, Vector3d::Zero()));
  for (const JointId id : row.joints) EXPECT_NE(joint, id);
  EXPECT_THROW(world.joint_state(row.joints[0]), std::invalid_argument);
}

TEST(Ids, OfTheWorldItself) {
  World world;
  EXPECT_EQ(world.find_body("world"), kWorldBody);
  EXPECT_EQ(world.body(kWorldBody).type, BodyType::kStatic);
  EXPECT_TRUE(world.body_ids().empty());
  EXPECT_THROW(world.remove_body(kWorldBody), std::invalid_argument);
  EXPECT_THROW(world.set_state(kWorldBody, BodyState{}), std::invalid_argument);
}

// Contacts keep their bodies when others are removed; warm starting does not mix them up.
TEST(Ids, OfContactsSurviveRemovals) {
  World world(options(0.01));
  const BodyId first = world.add_body(ball_on_x("first", -3.0));
  world.add_body(make_floor(0.5));
  std::vector<BodyId> balls;
  for (int i = 0; i < 4; ++i) {
    Body body = ball_on_x("ball_" + std::to_string(i), i);
    body.mass = 1.0 + i;
    body.state.position.z() = 0.1;
    balls.push_back(world.add_body(body));
  }
  run(world, 50);
  world.remove_body(first);
  world.remove_body(balls[1]);
  EXPECT_TRUE(world.contacts().empty());
  for (int step = 0; step < 20; ++step) {
    world.step();
    ASSERT_EQ(world.contacts().size(), 3u);
    for (const Contact& contact : world.contacts()) {
      const BodyId id =
          world.body(contact.body_a).name == "floor" ? contact.body_b : contact.body_a;
      // a single sweep suffices only if warm started from the ball's own impulse
      ASSERT_NEAR(contact.normal_force, world.body(id).mass * kGravity, 1e-9);
    }
  }
}

// ---- editing

TEST(Editing, RemovingAnythingLeavesTheRestAsItIs) {
  Row5 row;
  run(row.world, 10);
  const BodyState before = row.world.state(row.bodies[3]);
  row.world.remove_body(row.bodies[0]);
  EXPECT_EQ(row.world.state(row.bodies[3]).position, before.position);
  EXPECT_EQ(row.world.state(row.bodies[3]).linear_velocity, before.linear_velocity);
}

TEST(Editing, StateOfABodyIsSetAndItsStartKept) {
  World world(options(0.01));
  const BodyId id = world.add_body(ball_on_x("ball", 1.0));
  BodyState state;
  state.position = {5.0, 6.0, 7.0};
  state.orientation = Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5);
  state.linear_velocity = {1.0, 2.0, 3.0};
  state.angular_velocity = {4.0, 5.0, 6.0};
  world.set_state(id, state);
  EXPECT_EQ(world.state(id).position, state.position);
  EXPECT_EQ(world.state(id).orientation.coeffs(), state.orientation.coeffs());
  EXPECT_EQ(world.state(id).linear_velocity, state.linear_velocity);
  EXPECT_EQ(world.state(id).angular_velocity, state.angular_velocity);
  EXPECT_EQ(world.body(id).state.position.x(), 1.0);
}

TEST(Editing, OrientationsAreNormalized) {
  World world;
  Body body = ball_on_x("ball", 0.0);
  body.state.orientation = Eigen::Quaterniond(1.004, 0.0, 0.0, 0.0);
  const BodyId id = world.add_body(body);
  EXPECT_EQ(world.state(id).orientation.w(), 1.0);
}

TEST(Editing, AnchorsAreInWorldCoordinates) {
  World world;
  Body body = ball_on_x("ball", 2.0);
  body.state.orientation = Eigen::AngleAxisd(kPi / 2.0, Vector3d::UnitZ());
  const BodyId id = world.add_body(body);
  const JointId joint =
      world.add_joint(make_joint("rod", kWorldBody, {0.0, 0.0, 1.0}, id, {0.1, 0.0, 0.0}));
  EXPECT_EQ(world.anchors(joint).p_a, Vector3d(0.0, 0.0, 1.0));
  EXPECT_LT((world.anchors(joint).p_b - Vector3d(2.0, 0.1, 0.0)).norm(), 4 * kEpsilon);
}

// ---- time

TEST(Time, IsStepsTimesTick) {
  World world(options(0.01));
  for (int step = 1; step <= 1000; ++step) {
    EXPECT_EQ(world.step().time, step * 0.01);
    EXPECT_EQ(world.report().step, static_cast<std::uint64_t>(step));
  }
  EXPECT_EQ(world.step_count(), 1000u);
}

TEST(Time, GoesOnWhenTheTickChanges) {
  World world(options(0.01));
  run(world, 70);
  const double before = world.time();
  world.set_options(options(0.003));
  EXPECT_EQ(world.time(), before);
  EXPECT_EQ(world.step_count(), 70u);
  run(world, 10);
  EXPECT_EQ(world.time(), before + 10 * 0.003);
  EXPECT_EQ(world.step_count(), 80u);
}

// Time is its value at the last change of the tick plus steps times tick: other options leave no
// trace in its digits.
TEST(Time, IsNotTouchedByOtherOptions) {
  World world(options(0.01));
  World edited = world;
  run(world, 1000);
  for (int i = 0; i < 100; ++i) {
    run(edited, 10);
    WorldOptions options = edited.options();
    options.iterations = 1 + i;
    edited.set_options(options);
  }
  EXPECT_EQ(edited.time(), world.time());
  EXPECT_NE(edited.state_hash(), world.state_hash());  // the number of sweeps changes the motion
  edited.set_options(world.options());
  EXPECT_EQ(edited.state_hash(), world.state_hash());
}

TEST(Time, CanBeSet) {
  World world(options(0.01));
  world.set_time(12.5, 42);
  EXPECT_EQ(world.time(), 12.5);
  EXPECT_EQ(world.step().step, 43u);
  EXPECT_EQ(world.time(), 12.5 + 0.01);
}

TEST(Time, GoesOnInAWorldThatTakesOver) {
  Row5 old;
  run(old.world, 30);
  Row5 next;
  Motor motor;
  motor.bias = 0.1;
  motor.timeout = 0.2;
  next.world.set_motor(next.joints[0], motor);
  next.world.continue_from(old.world);
  EXPECT_EQ(next.world.time(), old.world.time());
  EXPECT_EQ(next.world.step_count(), 30u);
  for (const BodyId id : next.world.body_ids())
    for (const BodyId used : old.bodies) EXPECT_NE(id, used);
  for (const JointId id : next.world.joint_ids())
    for (const JointId used : old.joints) EXPECT_NE(id, used);
  const JointId driven = next.world.find_joint("rod_0");
  EXPECT_EQ(next.world.body(next.world.joint(driven).body_a).name, "ball_0");
  run(next.world, 50);
  EXPECT_NEAR(next.world.joint_state(driven).travel, 0.02, 1e-12);
}

// ---- failure

TEST(Failure, KeepsTheStateBeforeAndGoesOnAfterAnEdit) {
  World world(options(0.01));
  world.add_body(make_floor(0.5));
  const BodyId resting = world.add_body(make_body("resting", Sphere{0.1}, 1.0, {2.0, 0.0, 0.1}));
  const BodyId id = world.add_body(ball_on_x("ball", 0.0));
  Joint rod = make_joint("rod", kWorldBody, {0.0, 0.0, 5.0}, id, Vector3d::Zero());
  rod.motor.bias = 0.1;
  const JointId joint = world.add_joint(rod);
  run(world, 20);
  BodyState state = world.state(id);
  const BodyState good = state;
  state.position.x() = state.linear_velocity.x() = kMostMagnitude;
  world.set_state(id, state);
  const std::uint64_t before = world.state_hash();
  const double travel = world.joint_state(joint).travel;
  for (int i = 0; i < 2; ++i) {
    EXPECT_TRUE(world.step().outcome.failed);
    EXPECT_EQ(world.state_hash(), before);
    EXPECT_EQ(world.joint_state(joint).travel, travel);
    EXPECT_EQ(world.report().step, 20u);
    EXPECT_TRUE(world.contacts().empty());
  }
  world.set_state(id, good);
  EXPECT_FALSE(world.step().outcome.failed);
  EXPECT_EQ(world.step_count(), 21u);
  EXPECT_NEAR(world.state(resting).position.z(), 0.1, 2.0 * kGravity * 1e-4);
}

TEST(Failure, KeepsNoContactsOfTheAttempt) {
  WorldOptions stepping = options(0.01);
  stepping.method = Method::kTimeStepping;
  World world(stepping);
  world.add_body(make_floor(0.5));
  const BodyId falling = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.5}));
  const BodyId far = world.add_body(make_body("far", Sphere{0.1}, 1.0, {9.0, 0.0, 5.0}));
  bool has_touched = false;
  std::size_t bytes = 0;  // size of a snapshot after an attempt, before anything touches
  for (int i = 0; i < 100 && !has_touched; ++i) {
    World attempt = world;
    BodyState state = attempt.state(far);
    state.position.x() = state.linear_velocity.x() = kMostMagnitude;
    attempt.set_state(far, state);
    const std::uint64_t before = attempt.state_hash();
    EXPECT_TRUE(attempt.step().outcome.failed);
    EXPECT_EQ(attempt.state_hash(), before) << i;
    if (i == 0) bytes = write_snapshot(attempt).size();
    EXPECT_EQ(write_snapshot(attempt).size(), bytes) << i;
    EXPECT_FALSE(world.step().outcome.failed);
    has_touched = !world.contacts().empty();
  }
  EXPECT_TRUE(has_touched);
  EXPECT_NEAR(world.state(falling).position.z(), 0.1, 0.02);
}

// ---- report of a step

TEST(Report, EnergyOfAFreeFall) {
  World world(options(0.01));
  Body body = ball_on_x("ball", 0.0);
  body.state.position.z() = 3.0;
  body.state.angular_velocity.x() = 2.0;
  const BodyId id = world.add_body(body);
  const double turning = 0.5 * 0.4 * 0.1 * 0.1 * 4.0;
  EXPECT_NEAR(world.energy(), 3.0 * kGravity + turning, 1e-13);
  for (int n = 1; n <= 100; ++n) {
    world.step();
    // velocities first: ½ g² h² n less energy than at the start; over the kinetic energy, about
    // −1/n
    const double loss = 0.5 * kGravity * kGravity * 1e-4 * n;
    const double kinetic = 0.5 * world.state(id).linear_velocity.squaredNorm() + turning;
    ASSERT_NEAR(world.report().energy.total, 3.0 * kGravity + turning - loss, 1e-11);
    ASSERT_EQ(world.report().energy.total, world.energy());
    ASSERT_NEAR(world.report().energy.drift, -loss / kinetic, 1e-9);
  }
}

TEST(Report, DriftCountsFromTheLastEdit) {
  World world(options(0.01));
  const BodyId id = world.add_body(ball_on_x("ball", 0.0));
  run(world, 100);
  EXPECT_LT(world.report().energy.drift, 0.0);
  world.set_state(id, world.state(id));
  world.step();
  // a step at 9.8 m/s loses ½ g² h² of ½ v²: g² h²/v² = 1e-4
  EXPECT_NEAR(world.report().energy.drift, -1e-4, 1e-5);
}

TEST(Report, NamesTheWorstJoint) {
  Row5 row;
  BodyState state = row.world.state(row.bodies[4]);
  state.position.x() += 0.1;
  row.world.set_state(row.bodies[4], state);
  row.world.step();
  const StepReport& report = row.world.report();
  ASSERT_TRUE(report.joints.worst_closing.has_value());
  EXPECT_EQ(*report.joints.worst_closing, row.joints[3]);
  EXPECT_EQ(report.joints.closing_error, std::abs(row.world.joint_state(row.joints[3]).error));
  EXPECT_GT(report.joints.closing_error, 0.05);
  // joints.worst is a joint that nothing closes
  ASSERT_TRUE(report.joints.worst.has_value());
  EXPECT_NE(*report.joints.worst, row.joints[3]);
  EXPECT_EQ(report.joints.max_error, std::abs(row.world.joint_state(*report.joints.worst).error));
  EXPECT_LT(report.joints.max_error, 1e-3);
}

TEST(Report, SpringsAreNoErrors) {
  World world(options(0.01));
  const BodyId id = world.add_body(ball_on_x("ball", 1.0));
  world.add_joint(hang("spring", id, spring(0.5, 10.0, 0.0)));
  world.step();
  EXPECT_FALSE(world.report().joints.worst.has_value());
  EXPECT_EQ(world.report().joints.max_error, 0.0);
}

TEST(Report, WithoutJointsAndContactsNothingIsSolved) {
  World world(options(0.01));
  world.add_body(ball_on_x("ball", 0.0));
  EXPECT_EQ(world.step().costs.rows, 0u);
  EXPECT_EQ(world.report().costs.iterations, 0u);
}

double counting_clock() {
  static double ticks = 0.0;
  return ticks += 1.0;
}

TEST(Report, StagesAreTimedOnlyWithAClock) {
  World world(options(0.01));
  world.add_body(make_floor(0.5));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.09}));
  world.add_joint(hang("rope", id, rope(1.0)));
  for (const double time : world.step().costs.stage_times) EXPECT_EQ(time, 0.0);
  world.set_clock(counting_clock);
  const StepReport& report = world.step();
  for (std::size_t i = 0; i < kStageCount; ++i)  // two readings a stage; none is integrated
    EXPECT_EQ(report.costs.stage_times[i],
              i == static_cast<std::size_t>(Stage::kIntegration) ? 0.0 : 1.0);
  world.set_clock(nullptr);
  for (const double time : world.step().costs.stage_times) EXPECT_EQ(time, 0.0);
}

TEST(Report, StagesThatAreLeftOutTakeNoTime) {
  World world(options(0.01));
  world.set_clock(counting_clock);
  world.add_body(ball_on_x("ball", 0.0));
  const auto times = world.step().costs.stage_times;
  for (const Stage stage : {Stage::kBroadphase, Stage::kNarrowphase, Stage::kSolve})
    EXPECT_EQ(times[static_cast<std::size_t>(stage)], 0.0) << name(stage);
  EXPECT_EQ(times[static_cast<std::size_t>(Stage::kPositions)], 1.0);
}

World swinging_winch() {
  World world(options(0.01));
  const BodyId load = world.add_body(ball_on_x("load", 0.0));
  Joint cable = hang("cable", load, DistanceJoint{});
  cable.anchor_a = {0.0, 0.0, 3.0};
  cable.motor.amplitude = 0.5;
  cable.motor.frequency = 0.7;
  cable.motor.phase = 1.0;
  cable.motor.bias = -0.1;
  cable.motor.timeout = 0.5;
  world.add_joint(cable);
  return world;
}

TEST(ContinueFrom, TimeGoesOnAndTheMotionIsThatFromZero) {
  World old = swinging_winch();
  for (int i = 0; i < 1234; ++i) old.step();
  World fresh = swinging_winch();
  World continued = swinging_winch();
  continued.continue_from(old);
  EXPECT_EQ(continued.time(), old.time());
  EXPECT_EQ(continued.step_count(), 1234u);
  for (int i = 0; i < 200; ++i) {
    fresh.step();
    continued.step();
  }
  // the phase differs by the rounding of 2π·0.7·12.34 = 54 rad, times the travel of 0.1 m
  EXPECT_NEAR(continued.state(continued.find_body("load")).position.z(),
              fresh.state(fresh.find_body("load")).position.z(), 1e-14);
}

// A gear refers to its joints by ids, which change.
TEST(ContinueFrom, GearsGoOnCouplingTheirJoints) {
  const World old = swinging_winch();
  const auto gears = [] { return shipped("gear_train"); };
  World fresh = gears();
  World continued = gears();
  continued.continue_from(old);
  EXPECT_EQ(continued.state_hash(), fresh.state_hash());
  for (int i = 0; i < 100; ++i) {
    fresh.step();
    continued.step();
  }
  EXPECT_EQ(continued.state_hash(), fresh.state_hash());
}

TEST(ContinueFrom, IdsOfTheOldWorldAreNotUsedAgain) {
  World old = swinging_winch();
  const BodyId old_body = old.find_body("load");
  const JointId old_joint = old.find_joint("cable");
  World world = swinging_winch();
  world.continue_from(old);
  const BodyId body = world.find_body("load");
  const JointId joint = world.find_joint("cable");
  EXPECT_LT(old_body, body);
  EXPECT_LT(old_joint, joint);
  EXPECT_THROW(world.state(old_body), std::invalid_argument);
  EXPECT_THROW(world.joint(old_joint), std::invalid_argument);
  EXPECT_EQ(world.body_ids(), std::vector<BodyId>{body});
  EXPECT_EQ(world.joint(joint).body_b, body);
  EXPECT_EQ(world.joint(joint).body_a, kWorldBody);
  world.step();
  EXPECT_EQ(world.remove_body(body), std::vector<std::string>{"cable"});
}

TEST(Ids, AnEditThatIsUndoneLeavesNothingBehind) {
  World world = swinging_winch();
  const BodyId load = world.find_body("load");
  const auto edit = [&] {
    const BodyId added = world.add_body(ball_on_x("added", 1.0));
    Joint line = make_joint("line", load, Vector3d::Zero(), added, Vector3d::Zero());
    world.add_joint(line);
    world.remove_body(added);
    return added;
  };
  BodyId last = edit();
  const std::size_t size = write_snapshot(world).size();
  for (int k = 0; k < 1000; ++k) {
    const BodyId now = edit();
    EXPECT_LT(last, now);
    last = now;
  }
  EXPECT_EQ(write_snapshot(world).size(), size);
  World continued = swinging_winch();
  continued.continue_from(world);
  EXPECT_EQ(write_snapshot(continued).size(), write_snapshot(swinging_winch()).size());
  EXPECT_LT(last, continued.find_body("load"));
}

// Each world takes over from one with as many ids, so ids double.
TEST(Ids, AWorldWithoutIdsLeftRefusesAndStaysAsItIs) {
  World world = swinging_winch();
  int taken = 0;
  EXPECT_THROW(
      for (; taken < 40; ++taken) {
        const World old = world;
        world.continue_from(old);
      },
      std::invalid_argument);
  EXPECT_GE(taken, 30);  // 2 ids, of 2^32
  EXPECT_EQ(world.body(world.find_body("load")).name, "load");
  const std::uint64_t hash = world.state_hash();
  EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), hash);
  EXPECT_FALSE(world.step().outcome.failed);
}

TEST(Names, OfMethodsAndStages) {
  EXPECT_STREQ(name(Method::kAuto), "auto");
  EXPECT_STREQ(name(Method::kSequentialImpulses), "sequential_impulses");
  EXPECT_STREQ(name(Method::kRungeKutta), "runge_kutta");
  EXPECT_STREQ(name(Method::kEventDriven), "event_driven");
  const std::vector<std::string> expected{"broadphase", "narrowphase", "integration", "rows",
                                          "velocities", "solve",       "positions"};
  for (std::size_t i = 0; i < kStageCount; ++i) EXPECT_EQ(name(static_cast<Stage>(i)), expected[i]);
}

}  // namespace
}  // namespace constraint_sim::engine
