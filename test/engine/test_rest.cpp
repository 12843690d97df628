// Islands at rest: which fall asleep, what sleep skips, and what wakes them.

#include "constraint_sim/engine/scene.h"
#include "counted_allocations.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kRestTick = 0.01;
constexpr double kSide = 0.4;  // edge of the boxes [m]

/// Adds `height` boxes on each other, at rest to within the fall of one tick.
void add_pile(World* world, const std::string& name, int height, double x) {
  for (int i = 0; i < height; ++i) {
    Body box = make_body(name + std::to_string(i), Box{Vector3d::Constant(kSide)}, 1.0,
                         {x, 0.0, kSide * (i + 0.5)});
    box.friction = 0.6;
    world->add_body(box);
  }
}

World piles(double sleep_after = 0.5, Method method = Method::kRungeKutta) {
  WorldOptions options;
  options.method = method;
  options.time_step = kRestTick;
  options.iterations = 50;
  options.sleep_after = sleep_after;
  World world(options);
  world.add_body(make_floor(0.6));
  add_pile(&world, "a", 3, 0.0);
  add_pile(&world, "b", 2, 2.0);
  return world;
}

/// Steps for both piles to come to rest, plus half a second.
constexpr int kUntilAsleep = 400;

World asleep(Method method = Method::kRungeKutta) {
  World world = piles(0.5, method);
  run(world, kUntilAsleep);
  EXPECT_EQ(world.report().costs.asleep, 5u);
  return world;
}

Body ball_above(double x, double height) {
  return make_body("ball", Sphere{0.1}, 2.0, {x, 0.0, height});
}

std::vector<BodyState> states(const World& world) {
  std::vector<BodyState> states;
  for (const BodyId id : world.body_ids()) states.push_back(world.state(id));
  return states;
}

bool same_bits(const std::vector<BodyState>& l, const std::vector<BodyState>& r) {
  for (std::size_t i = 0; i < l.size(); ++i) {
    if (l[i].position != r[i].position || l[i].linear_velocity != r[i].linear_velocity ||
        l[i].orientation.coeffs() != r[i].orientation.coeffs() ||
        l[i].angular_velocity != r[i].angular_velocity)
      return false;
  }
  return l.size() == r.size();
}

// ---- falling asleep

TEST(Rest, LeavesEverythingOutAndStillTellsOfIt) {
  World world = asleep();
  const std::vector<BodyState> before = states(world);
  const StepReport& report = world.step();
  EXPECT_TRUE(same_bits(states(world), before));
  for (const BodyState& state : before) EXPECT_TRUE(state.linear_velocity.isZero(0.0));
  EXPECT_EQ(report.costs.rows, 0u);
  EXPECT_EQ(report.contacts.points, 0u);
  EXPECT_EQ(report.costs.iterations, 0u);
  EXPECT_EQ(report.costs.candidate_pairs, 0u);
  for (const Island& island : world.islands()) EXPECT_EQ(island.why, MethodReason::kAtRest);

  // Five weights on the floor, 2 + 1 + 1 on boxes; impulses changed by at most that of 1e-8 m/s in
  // the step in which the boxes fell asleep.
  double force = 0.0;
  for (const Contact& contact : world.contacts()) force += contact.normal_force;
  EXPECT_NEAR(force, (5 + 2 + 1 + 1) * kGravity, 1e-4);
  EXPECT_NEAR(report.energy.total, world.energy(),
              1e-12 * world.energy());  // summed in another order
  EXPECT_GT(report.contacts.max_penetration, 0.0);
}

// Sleep omits the remaining creep at sleep_speed and below: at Baumgarte's rate β a tick 1e-8 m/s ·
// 0.01 s / 0.1, ten times that for a pile's slower settling.
TEST(Rest, IsWhereTheyWouldHaveComeToRest) {
  World awake = piles(kInfinity);
  World world = piles();
  run(awake, 1000);
  run(world, 1000);
  EXPECT_EQ(awake.report().costs.asleep, 0u);
  for (const BodyId id : world.body_ids())
    EXPECT_LE((world.state(id).position - awake.state(id).position).norm(), 1e-8);
}

TEST(Rest, AllocatesNothing) {
  World world = asleep();
  const std::size_t before = counted_allocations();
  run(world, 100);
  EXPECT_EQ(counted_allocations(), before);
}

// Integrated islands sleep only where a step repeats the last one bit by bit.
TEST(Rest, ChangesNothingWhereNothingMoves) {
  const auto drift = [](double sleep_after) {
    WorldOptions options;
    options.gravity.setZero();
    options.sleep_after = sleep_after;
    World world(options);
    world.add_body(make_body("still", Box{Vector3d::Ones()}, 1.0, {1.0, 2.0, 3.0}));
    Body drifting = make_body("drifting", Sphere{0.1}, 1.0, {5.0, 0.0, 0.0});
    drifting.state.linear_velocity.x() = 1e-12;
    world.add_body(drifting);
    run(world, 300);
    return world;
  };
  const World slept = drift(0.5);
  EXPECT_EQ(slept.report().costs.asleep, 1u);
  EXPECT_TRUE(same_bits(states(slept), states(drift(kInfinity))));
}

TEST(Rest, IsNotWhatMerelyTurnsRound) {
  World world;
  const BodyId bob = world.add_body(make_body("bob", Point{}, 1.0, {1.0, 0.0, 0.0}));
  world.add_joint(hang("rod", bob));
  for (int i = 0; i < 500; ++i) EXPECT_EQ(world.step().costs.asleep, 0u);
}

/// A box on the floor, with an element that will move it although it stands still so far.
struct HeldBox {
  const char* name;
  void (*add)(World* world, BodyId box);
};

class RestOfHeld : public testing::TestWithParam<HeldBox> {};

TEST_P(RestOfHeld, WaitsForWhatDrivesIt) {
  World world = piles();
  const BodyId box = world.find_body("b1");
  GetParam().add(&world, box);
  run(world, kUntilAsleep);
  EXPECT_EQ(world.report().costs.asleep, 3u);  // the other pile
}

Joint on_top(BodyId body, BodyId box) {
  return make_joint("joint", body, Vector3d::Zero(), box, Vector3d::Zero());
}

INSTANTIATE_TEST_SUITE_P(
    , RestOfHeld,
    testing::Values(
        HeldBox{"Wrench",
                [](World* world, BodyId box) {
                  Wrench wrench;
                  wrench.body = box;
                  wrench.force.z() = -1.0;
                  wrench.start = 100.0;
                  wrench.end = 101.0;
                  world->add_wrench(wrench);
                }},
        HeldBox{"Motor",
                [](World* world, BodyId box) {
                  Joint joint = make_joint("joint", kWorldBody, {2.0, 0.0, 3.0}, box,
                                           Vector3d::Zero(), rope(5.0));
                  joint.motor.bias = 1e-9;
                  world->add_joint(joint);
                }},
        HeldBox{
            "TurningFloor",
            [](World* world, BodyId) {
              Body table = make_body("table", Sphere{0.1}, 0.0, {2.0, 0.0, 2 * kSide + 0.1 - 1e-7});
              table.type = BodyType::kKinematic;
              table.state.angular_velocity.z() = 1.0;
              world->add_body(table);
            }},
        HeldBox{"JointToWhatTurns",
                [](World* world, BodyId box) {
                  Body hook = make_body("hook", Point{}, 0.0, {2.0, 0.0, 3.0});
                  hook.type = BodyType::kKinematic;
                  hook.state.angular_velocity.z() = 1.0;
                  Joint joint = on_top(world->add_body(hook), box);
                  joint.distance = rope(5.0);
                  world->add_joint(joint);
                }}),
    [](const testing::TestParamInfo<HeldBox>& info) { return std::string(info.param.name); });

// ---- waking

// The motion after waking is the same to the bit, whether a pile slept for one second or for ten.
TEST(Rest, EndsTheSameHoweverLongItWas) {
  const auto push = [](int slept, Method method) {
    World world = asleep(method);
    run(world, slept);
    const BodyId id = world.find_body("a1");
    BodyState state = world.state(id);
    state.linear_velocity = {1.0, 0.5, 0.0};
    world.set_state(id, state);
    run(world, 60);
    EXPECT_EQ(world.report().costs.asleep, 2u);  // pile b continues to sleep
    return states(world);
  };
  for (const Method method : {Method::kRungeKutta, Method::kAuto})  // impulses, event-driven
    EXPECT_TRUE(same_bits(push(100, method), push(1000, method))) << name(method);
}

TEST(Rest, GoesOnInACopy) {
  World world = asleep();
  world.add_body(ball_above(0.05, 2.0));
  World copy = world;
  run(world, 150);
  run(copy, 150);
  EXPECT_EQ(copy.state_hash(), world.state_hash());
}

// Oracle: the same blow on a world that never slept. Until the blow they differ by at most 1e-8 m,
// which a pile hit in its middle line amplifies by at most a thousand in 0.3 s: impulses of a blow
// are solved to a thousandth, so that the last bits choose among sweeps.
TEST(Rest, EndsInTimeForABlow) {
  const auto blow = [](double sleep_after) {
    World world = piles(sleep_after);
    run(world, 1000);
    world.add_body(ball_above(0.0, 1.5));
    run(world, 50);
    return states(world);
  };
  const std::vector<BodyState> slept = blow(0.5), awake = blow(kInfinity);
  for (std::size_t i = 0; i < slept.size(); ++i)
    EXPECT_LE((slept[i].position - awake[i].position).norm(), 1e-5) << i;
}

/// An edit, and what it wakes of two piles of three and two boxes.
struct WakingEdit {
  const char* name;
  std::uint32_t sleeping_after;
  void (*apply)(World* world);
};

class RestUntil : public testing::TestWithParam<WakingEdit> {};

TEST_P(RestUntil, TouchedByAnEdit) {
  World world = asleep();
  GetParam().apply(&world);
  EXPECT_EQ(world.step().costs.asleep, GetParam().sleeping_after);
}

INSTANTIATE_TEST_SUITE_P(
    , RestUntil,
    testing::Values(
        WakingEdit{"Nothing", 5, [](World*) {}},
        WakingEdit{"BodyElsewhere", 5, [](World* world) { world->add_body(ball_above(9.0, 9.0)); }},
        WakingEdit{"BodyOnTop", 2, [](World* world) { world->add_body(ball_above(0.0, 1.29)); }},
        WakingEdit{"StaticBody", 0,
                   [](World* world) {
                     Body post = make_body("post", Sphere{0.1}, 0.0, {9.0, 0.0, 0.0});
                     post.type = BodyType::kStatic;
                     world->add_body(post);
                   }},
        WakingEdit{"State", 3,
                   [](World* world) {
                     const BodyId id = world->find_body("b1");
                     BodyState state = world->state(id);
                     state.linear_velocity.x() = 1.0;
                     world->set_state(id, state);
                   }},
        WakingEdit{"Wrench", 3,
                   [](World* world) {
                     Wrench wrench;
                     wrench.body = world->find_body("b0");
                     wrench.force.x() = 1.0;
                     wrench.end = world->time() + 1.0;
                     world->add_wrench(wrench);
                   }},
        WakingEdit{"RemovalBelow", 2,
                   [](World* world) { world->remove_body(world->find_body("a0")); }},
        WakingEdit{"RemovalOfTheFloor", 0,
                   [](World* world) { world->remove_body(world->find_body("floor")); }},
        WakingEdit{"JointBetweenThem", 0,
                   [](World* world) {
                     world->add_joint(make_joint("tie", world->find_body("a2"), Vector3d::Zero(),
                                                 world->find_body("b1"), Vector3d::Zero(),
                                                 rope(5.0)));
                   }},
        WakingEdit{"Gravity", 0,
                   [](World* world) {
                     WorldOptions options = world->options();
                     options.gravity.z() = 1.0;
                     world->set_options(options);
                   }},
        WakingEdit{"Reset", 0, [](World* world) { world->reset(); }}),
    [](const testing::TestParamInfo<WakingEdit>& info) { return std::string(info.param.name); });

// Without the floor all boxes fall, without the lowest box the others do.
TEST(Rest, EndsWhereTheGroundGoes) {
  World world = asleep();
  world.remove_body(world.find_body("a0"));
  world.step();
  EXPECT_NEAR(world.state(world.find_body("a2")).linear_velocity.z(), -kGravity * kRestTick, 1e-9);
  world.remove_body(world.find_body("floor"));
  const double before = world.state(world.find_body("b0")).linear_velocity.z();
  world.step();
  EXPECT_NEAR(world.state(world.find_body("b0")).linear_velocity.z(), before - kGravity * kRestTick,
              1e-9);
}

TEST(Rest, EndsForAMotorAndForATornJoint) {
  for (const bool tears : {false, true}) {
    WorldOptions options;
    options.time_step = kRestTick;
    options.method = Method::kSequentialImpulses;
    World world(options);
    const BodyId load = world.add_body(make_body("load", Point{}, 1.0, {0.0, 0.0, -1.0}));
    const JointId joint = world.add_joint(hang("rope", load, rope(1.0)));
    run(world, kUntilAsleep);
    ASSERT_EQ(world.report().costs.asleep, 1u);
    EXPECT_NEAR(world.joint_state(joint).force, -kGravity, 1e-6);
    if (tears) {
      world.set_broken(joint, true);
    } else {
      Motor motor;
      motor.bias = 0.5;
      world.set_motor(joint, motor);
    }
    run(world, 100);
    EXPECT_EQ(world.report().costs.asleep, 0u);
    EXPECT_LT(world.state(load).position.z(), -1.4);
  }
}

TEST(Rest, EndsWhenAKinematicBodyPushes) {
  World world = asleep();
  Body pusher = make_body("pusher", Sphere{0.1}, 0.0, {-3.0, 0.0, 0.2});
  pusher.type = BodyType::kKinematic;
  pusher.state.linear_velocity.x() = 1.0;
  world.add_body(pusher);
  run(world, 250);  // 0.2 m before the pile
  EXPECT_EQ(world.report().costs.asleep, 5u);
  run(world, 100);
  EXPECT_GT(world.state(world.find_body("a0")).position.x(), 0.4);
}

TEST(Rest, GoesOnInASceneThatWasSaved) {
  const World world = asleep();
  World again = load_scene(save_scene(world));
  EXPECT_EQ(again.options().sleep_after, 0.5);
  EXPECT_EQ(again.step().costs.asleep, 5u);
  run(again, 100);
  EXPECT_TRUE(same_bits(states(again), states(world)));
}

TEST(Rest, IsNotForAWorldThatAsksForNone) {
  World world = piles(kInfinity);
  run(world, 2 * kUntilAsleep);
  EXPECT_EQ(world.report().costs.asleep, 0u);
}

}  // namespace
}  // namespace constraint_sim::engine
