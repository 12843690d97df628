// Gravity compensation: a body falls with (1 − share) g under each method, and energy is kept.

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr std::array<Method, 3> kJointMethods{Method::kRungeKutta, Method::kEnergyMomentum,
                                              Method::kSequentialImpulses};

void compensate_all(World* world, double share) {
  for (const BodyId id : world->body_ids()) {
    Body body = world->body(id);
    body.gravity_compensation = share;
    world->set_body(id, body);
  }
}

World free_ball(double share) {
  WorldOptions options;
  options.time_step = 0.01;
  World world(options);
  Body ball = make_body("ball", Sphere{0.1}, 3.0, {1.0, 2.0, 3.0});
  ball.gravity_compensation = share;
  world.add_body(ball);
  return world;
}

// The parabola x = ½ (1 − s) g t²; 100 steps of a sum of about 1 m round to 1e-14.
TEST(GravityCompensation, AFreeBodyFallsByTheRestOfItsWeight) {
  for (const double share : {0.0, 0.25, 0.7, 1.0}) {
    World world = free_ball(share);
    run(world, 100);
    const BodyState& state = world.state(world.find_body("ball"));
    EXPECT_NEAR(state.position.z(), 3.0 - 0.5 * (1.0 - share) * 9.81, 1e-12) << share;
    EXPECT_NEAR(state.linear_velocity.z(), -(1.0 - share) * 9.81, 1e-12) << share;
  }
  World world = free_ball(1.0);
  run(world, 100);
  EXPECT_EQ(world.state(world.find_body("ball")).position, Vector3d(1.0, 2.0, 3.0));
}

// A share of a half is a power of two: half of the weight has the bits of half of gravity. Scenes
// with rods, hinges, loops, springs and motors, by each method.
TEST(GravityCompensation, HalfOfTheWeightIsHalfOfGravity) {
  for (const char* name : {"double_pendulum", "crane", "slider_crank", "stewart_platform"})
    for (const Method method : kJointMethods) {
      SCOPED_TRACE(std::string(name) + " by " + engine::name(method));
      World lighter = shipped(name, method), weaker = shipped(name, method);
      compensate_all(&lighter, 0.5);
      WorldOptions options = weaker.options();
      options.gravity *= 0.5;
      weaker.set_options(options);
      run(lighter, 50);
      run(weaker, 50);
      for (const BodyId id : lighter.body_ids()) {
        EXPECT_EQ(lighter.state(id).position, weaker.state(id).position);
        EXPECT_EQ(lighter.state(id).linear_velocity, weaker.state(id).linear_velocity);
      }
      EXPECT_EQ(lighter.report().energy.total, weaker.report().energy.total);
    }
}

/// Returns the sum of the energies that a step has to explain: energy less the work of corrections
/// and drives.
double drift_of(World& world, int steps) {
  double booked = 0.0;
  const double before = world.energy();
  for (int i = 0; i < steps; ++i) {
    const StepReport& report = world.step();
    EXPECT_FALSE(report.outcome.failed);
    booked += report.energy.correction_work + report.energy.driven_work;
  }
  return world.energy() - before - booked;
}

// A chain of rods and bodies with another share each, released from the horizontal. Integrated
// energy stays to the tolerance of 1e-10 m/s at speeds of metres per second; sweeps lose some, and
// gain none.
TEST(GravityCompensation, EnergyIsKeptWithSharesOfEachBody) {
  for (const Method method : kJointMethods) {
    WorldOptions options;
    options.time_step = 1e-3;
    options.tolerance = 1e-10;
    options.method = method;
    World world(options);
    BodyId before = kWorldBody;
    for (int i = 1; i <= 4; ++i) {
      Body body =
          make_body("b" + std::to_string(i), Box{{0.4, 0.1, 0.1}}, 1.0 * i, {0.5 * i, 0.0, 0.0});
      body.no_collision = true;
      body.gravity_compensation = 0.3 * (i - 1);
      const BodyId id = world.add_body(body);
      const Vector3d half{0.25, 0.0, 0.0};
      world.add_joint(make_joint("j" + std::to_string(i), before, half, id, -half));
      before = id;
    }
    const double drift = drift_of(world, 1000);
    SCOPED_TRACE(engine::name(method));
    EXPECT_LT(drift, 1e-6);
    if (method != Method::kSequentialImpulses) {
      EXPECT_GT(drift, -1e-6);
    }
    EXPECT_GT(world.state(before).linear_velocity.norm(), 0.1);
  }
}

// A body that another share lets fall at 0.3 g bounces without loss: at h = 1 m it returns after
// 2 √(2 h / 0.3 g) to its height, by events (sphere: in closed form beside others; box: by rows).
TEST(GravityCompensation, ElasticBouncesKeepTheEnergyOfTheRest) {
  for (const Shape& shape : {Shape(Sphere{0.1}), Shape(Box{{0.2, 0.2, 0.2}})}) {
    WorldOptions options;
    options.time_step = 0.01;
    World world(options);
    Body ball = make_body("ball", shape, 2.0, {0.0, 0.0, 1.1});
    ball.gravity_compensation = 0.7;
    ball.restitution = 1.0;
    const BodyId id = world.add_body(ball);
    world.add_body(make_floor(0.0));
    const double before = world.energy();
    const double g = 0.3 * 9.81, fall = std::sqrt(2.0 / g);
    while (world.time() < 2.0 * fall) {
      run(world, 1);
      const double since_top = fall - std::abs(world.time() - fall);
      EXPECT_NEAR(world.state(id).position.z(), 1.1 - 0.5 * g * since_top * since_top, 1e-9);
    }
    EXPECT_NEAR(world.report().energy.total, before, 1e-9 * before);
    EXPECT_EQ(world.report().costs.islands[index_of(Method::kSequentialImpulses)], 0u);
  }
}

// A block of 2 kg at rest presses on the floor with (1 − s) m g, under each kind of contact.
TEST(GravityCompensation, AFloorCarriesTheRest) {
  for (const Method method : {Method::kEventDriven, Method::kSequentialImpulses}) {
    WorldOptions options;
    options.time_step = 0.01;
    options.method = method;
    options.sleep_after = kInfinity;
    World world(options);
    Body block = make_body("block", Box{{0.2, 0.2, 0.2}}, 2.0, {0.0, 0.0, 0.1});
    block.gravity_compensation = 0.6;
    world.add_body(block);
    world.add_body(make_floor(0.5));
    run(world, 100);
    double force = 0.0;
    for (const Contact& contact : world.contacts()) force += contact.normal_force;
    EXPECT_NEAR(force, 0.4 * 2.0 * 9.81, 1e-9) << engine::name(method);
  }
}

TEST(GravityCompensation, IsSavedAndPartOfTheHash) {
  World world = free_ball(0.7);
  run(world, 3);
  EXPECT_NE(world.state_hash(), [] {
    World other = free_ball(0.6);
    run(other, 3);
    return other.state_hash();
  }());
  World again = load_scene(save_scene(world));
  EXPECT_EQ(again.body(again.find_body("ball")).gravity_compensation, 0.7);
  EXPECT_EQ(again.state_hash(), world.state_hash());
  World restored = read_snapshot(write_snapshot(world));
  EXPECT_EQ(restored.state_hash(), world.state_hash());
  run(world, 10);
  run(again, 10);
  run(restored, 10);
  EXPECT_EQ(again.state_hash(), world.state_hash());
  EXPECT_EQ(restored.state_hash(), world.state_hash());
}

TEST(GravityCompensation, IsBetweenNothingAndAll) {
  for (const double share : {-0.1, 1.1, kNaN}) {
    World world;
    Body ball = make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero());
    ball.gravity_compensation = share;
    EXPECT_NE(refusal([&] { world.add_body(ball); }).find("gravity_compensation"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
