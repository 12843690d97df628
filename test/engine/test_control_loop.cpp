// Forces set anew while a mechanism moves, as a controller sets them in each tick. Oracles: closed
// forms, worlds whose equations were compiled after the edit, and worlds that act by wrenches.

#include <cmath>

#include "bars_on_hinges.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/math/list.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Motor pushing(double force) {
  Motor motor;
  motor.force = force;
  return motor;
}

Motor going_to(double position, double frequency, double max_force = 0.0) {
  Motor motor;
  motor.position = position;
  motor.servo_frequency = frequency;
  motor.max_force = max_force;
  return motor;
}

WorldOptions without_gravity(double time_step) {
  WorldOptions options;
  options.gravity.setZero();
  options.time_step = time_step;
  return options;
}

/// A load of 2 kg on a level rail.
struct OnRail {
  static constexpr double kMass = 2.0;
  World world;
  JointId rail;

  explicit OnRail(double time_step, double friction = 0.0) : world(without_gravity(time_step)) {
    const Body load = make_body("load", Box{{0.2, 0.2, 0.2}}, kMass, Vector3d::Zero());
    Joint joint;
    joint.name = "rail";
    joint.kind = JointKind::kSlider;
    joint.frame_a = frame_along(Vector3d::UnitX());
    joint.coordinates[0].friction = friction;
    joint.coordinates[0].motor = pushing(0.0);
    joint.body_b = world.add_body(load);
    rail = world.add_joint(joint);
  }
  double position() const { return world.joint_state(rail).coordinates[0].position; }
  double velocity() const { return world.joint_state(rail).coordinates[0].velocity; }
};

double force_of_tick(int k) { return 3.0 * std::sin(0.7 * k) + 0.2 * k; }

// Bound: the parabola of each of 100 ticks is exact, and rounded some ten times.
TEST(ControlLoop, MovesALoadByForcesOfEachTick) {
  for (const double h : {0.1, 0.01, 0.001}) {
    OnRail on_rail(h);
    double x = 0.0, v = 0.0;
    for (int k = 0; k < 100; ++k) {
      const double a = force_of_tick(k) / OnRail::kMass;
      on_rail.world.set_motor(on_rail.rail, 0, pushing(force_of_tick(k)));
      on_rail.world.step();
      x += h * (v + 0.5 * h * a);
      v += h * a;
      ASSERT_NEAR(on_rail.position(), x, 1e3 * kEpsilon * (1.0 + std::abs(x)));
      ASSERT_NEAR(on_rail.velocity(), v, 1e3 * kEpsilon * (1.0 + std::abs(v)));
      ASSERT_NEAR(on_rail.world.joint_state(on_rail.rail).coordinates[0].effort, force_of_tick(k),
                  1e3 * kEpsilon * 30.0);
    }
  }
}

/// Advances a load of mass m with friction f by a constant force F for h [s].
void slide(double F, double f, double m, double h, double* x, double* v) {
  while (h > 0.0) {
    const double sign = *v != 0.0 ? std::copysign(1.0, *v) : std::copysign(1.0, F);
    if (*v == 0.0 && std::abs(F) <= f) return;
    const double a = (F - sign * f) / m;
    const double stops_in = *v != 0.0 && a * *v < 0.0 ? -*v / a : h;
    const double span = std::min(h, stops_in);
    *x += span * (*v + 0.5 * span * a);
    *v = stops_in < h ? 0.0 : *v + span * a;
    h -= span;
  }
}

// Forces pass the friction of 2 N in both directions, at rest and in motion. Bound: a stop is
// located to rates of 1e-9 m/s.
TEST(ControlLoop, MovesALoadAgainstFriction) {
  constexpr double kFriction = 2.0;
  for (const double h : {0.1, 0.01, 0.001}) {
    OnRail on_rail(h, kFriction);
    double x = 0.0, v = 0.0;
    for (int k = 0; k < 200; ++k) {
      const double force = 4.0 * std::sin(0.3 * k + 0.1);
      on_rail.world.set_motor(on_rail.rail, 0, pushing(force));
      on_rail.world.step();
      slide(force, kFriction, OnRail::kMass, h, &x, &v);
      ASSERT_NEAR(on_rail.position(), x, 1e-9 * (k + 1) * h + 1e-12) << h << ", tick " << k;
      ASSERT_NEAR(on_rail.velocity(), v, 2e-9 * (k + 1)) << h << ", tick " << k;
    }
    EXPECT_EQ(on_rail.world.report().costs.method_changes, 0u);
  }
}

/// Bars on hinges with random limits, friction, springs and motors.
World random_arm(Draw* random, int seed) {
  World world = bars_on_hinges({}, std::vector<double>(to_index(1 + seed % 7), 1.0), 0.4);
  const auto chance = [&](double share) { return random->between(0.0, 1.0) < share; };
  const auto number = [&](double low, double high) { return random->between(low, high); };
  for (const JointId id : world.joint_ids()) {
    CoordinateLaw law = world.joint(id).coordinates[0];
    if (chance(0.4)) {
      law.lower = -number(0.5, 2.5);
      law.upper = number(0.5, 2.5);
    }
    if (chance(0.3)) law.friction = number(0.1, 0.5);
    if (chance(0.5)) law.damping = number(0.01, 0.3);
    if (chance(0.3)) law.stiffness = number(1.0, 20.0);
    if (chance(0.3))
      law.motor = pushing(number(-3.0, 3.0));
    else if (chance(0.3))
      law.motor = going_to(number(-1.0, 1.0), number(0.5, 4.0));
    else if (chance(0.3))
      law.motor = going_to(number(-1.0, 1.0), 2.0, number(1.0, 20.0));
    world.set_law(id, 0, law);
  }
  return world;
}

/// Changes some numbers, and now and then the kind of a law.
void change_a_law(World* world, Draw* random) {
  const std::vector<JointId> ids = world->joint_ids();
  const JointId id = ids[static_cast<std::size_t>(random->below(static_cast<int>(ids.size())))];
  CoordinateLaw law = world->joint(id).coordinates[0];
  const int what = random->below(7);
  const double number = random->between(0.1, 1.0);
  if (what == 0 && law.motor && law.motor->force) law.motor->force = 6.0 * number - 3.0;
  if (what <= 1 && law.motor && law.motor->position) law.motor->position = 2.0 * number - 1.0;
  if (what == 2) law.motor = pushing(number);
  if (what == 3 && law.friction > 0.0) law.friction = 0.5 * number;
  if (what == 4) law.damping = 0.3 * number;
  if (what == 5 && law.is_limited()) law.lower = -2.5 * number;
  if (what == 6) law.motor.reset();
  world->set_law(id, 0, law);
}

// Reading a snapshot compiles all equations for the laws that were set.
TEST(ControlLoop, FollowsLawsAsEquationsCompiledAnew) {
  for (int seed = 0; seed < 100 / kSeedShare; ++seed) {
    Draw random(static_cast<unsigned>(seed));
    World world = random_arm(&random, seed);
    for (int k = 0; k < 40; ++k) {
      change_a_law(&world, &random);
      World compiled = read_snapshot(write_snapshot(world));
      world.step();
      compiled.step();
      ASSERT_EQ(world.state_hash(), compiled.state_hash()) << seed << ", tick " << k;
    }
  }
}

// A gear reads its hinges from where `position` says they are.
TEST(ControlLoop, FollowsTheZeroOfAHingeThatAGearCouples) {
  World world = bars_on_hinges({}, {1.0, 1.0}, 0.4);
  const std::vector<JointId> hinges = world.joint_ids();
  Joint gear;
  gear.name = "gear";
  gear.kind = JointKind::kGear;
  gear.coupling = {hinges[0], hinges[1], 0.5, 0.0, false};
  world.add_joint(gear);
  run(world, 5);
  CoordinateLaw law = world.joint(hinges[0]).coordinates[0];
  law.position = world.joint_state(hinges[0]).coordinates[0].position + 0.05;
  world.set_law(hinges[0], 0, law);
  World compiled = read_snapshot(write_snapshot(world));
  run(world, 20);
  run(compiled, 20);
  EXPECT_EQ(world.state_hash(), compiled.state_hash());
}

// An edit of a joint that does not act leaves nothing behind that a later edit would meet.
TEST(ControlLoop, ForgetsLawsOfJointsThatDoNotAct) {
  World world = bars_on_hinges({}, {1.0, 1.0}, 0.4);
  const std::vector<JointId> hinges = world.joint_ids();
  world.set_enabled(hinges[1], false);
  run(world, 3);
  world.set_motor(hinges[1], 0, pushing(1.0));
  run(world, 3);
  World again = read_snapshot(write_snapshot(world));
  for (World* of : {&world, &again}) of->set_motor(hinges[0], 0, pushing(1.0));
  EXPECT_EQ(world.state_hash(), again.state_hash());
  run(world, 5);
  run(again, 5);
  EXPECT_EQ(world.state_hash(), again.state_hash());
}

// A load that rests on its lower limit, which then is raised by 0.4 m: the error is closed within
// half a second, as one that a joint has when it is added, and no faster than twice the mean.
TEST(ControlLoop, ClosesTheErrorOfALimitThatIsMovedBeyondTheLoad) {
  WorldOptions options;
  options.time_step = 0.01;
  World world(options);
  Joint joint;
  joint.name = "rail";
  joint.kind = JointKind::kSlider;
  joint.coordinates[0].lower = -0.5;
  joint.coordinates[0].upper = 1.0;
  joint.body_b = world.add_body(make_body("load", Box{{0.2, 0.2, 0.2}}, 2.0, Vector3d::Zero()));
  const JointId rail = world.add_joint(joint);
  run(world, 100);
  const auto position = [&] { return world.joint_state(rail).coordinates[0].position; };
  ASSERT_NEAR(position(), -0.5, 1e-9);
  CoordinateLaw law = world.joint(rail).coordinates[0];
  law.lower = -0.1;
  world.set_law(rail, 0, law);
  double before = position();
  for (int k = 0; k < 60; ++k) {
    world.step();
    ASSERT_LT(position() - before, 2.0 * 0.4 / options.closing_time * options.time_step) << k;
    before = position();
  }
  EXPECT_NEAR(position(), -0.1, 1e-9);
  EXPECT_FALSE(world.joint_state(rail).closing);
}

/// Largest distance between the bodies of two worlds [m].
double largest_distance(const World& a, const World& b) {
  std::vector<BodyId> ids;
  a.body_ids(&ids);
  double largest = 0.0;
  for (const BodyId id : ids)
    largest = std::max(largest, (a.state(id).position - b.state(id).position).norm());
  return largest;
}

// Bound: both worlds integrate to a local error of 1e-8 m/s; the arm of three bars amplifies errors
// less than ten times in half a second.
TEST(ControlLoop, MovesAnArmAsOneOfAnotherMethodIsMoved) {
  WorldOptions by_rows;
  by_rows.method = Method::kEnergyMomentum;
  by_rows.time_step = 0.0005;
  World arm = bars_on_hinges({}, {1.0, 1.0, 1.0}, 0.4, 0.05);
  World reference = bars_on_hinges(by_rows, {1.0, 1.0, 1.0}, 0.4, 0.05);
  const auto steps = static_cast<int>(std::lround(arm.options().time_step / by_rows.time_step));
  for (int k = 0; k < 30; ++k) {
    for (World* world : {&arm, &reference})
      for (const JointId id : world->joint_ids())
        world->set_motor(id, 0, pushing(4.0 * std::sin(0.5 * k)));
    arm.step();
    run(reference, steps);
  }
  EXPECT_LT(largest_distance(arm, reference), 1e-7);
}

// ---- wrenches that stay

// Whatever acts on one arm, the other one goes on with the bits that it has alone.
TEST(ControlLoop, ForcesOnOneArmLeaveTheOtherAlone) {
  World both = bars_on_hinges({}, {1.0, 1.0}, 0.4);
  World alone = both;
  const Body other = make_body("other", Box{{0.2, 0.2, 0.2}}, 1.0, {0.0, 5.0, 0.0});
  Joint ball;
  ball.name = "ball";
  ball.kind = JointKind::kBall;
  ball.anchor_a = {0.0, 5.0, 1.0};
  ball.anchor_b = {0.0, 0.0, 1.0};
  const BodyId id = both.add_body(other);
  ball.body_b = id;
  both.add_joint(ball);
  for (int k = 0; k < 50; ++k) {
    const double now = both.time();
    Wrench wrench{id, Vector3d(std::sin(0.3 * k), 1.0, 0.0), Vector3d::Zero(), now, now};
    wrench.end += both.options().time_step;
    if (k % 3 > 0) both.add_wrench(wrench);
    both.step();
    alone.step();
    std::vector<BodyId> ids;
    alone.body_ids(&ids);
    for (const BodyId body : ids)
      ASSERT_EQ(both.state(body).position, alone.state(body).position) << "tick " << k;
  }
}

// A force along z in place of gravity. Bound: rounding of 100 steps of an arm about 1 m long.
TEST(ControlLoop, AConstantForceActsAsGravity) {
  World falling = bars_on_hinges({}, {1.0, 2.0, 0.5}, 0.4);
  WorldOptions options = falling.options();
  const Vector3d gravity = options.gravity;
  options.gravity.setZero();
  World pushed = bars_on_hinges(options, {1.0, 2.0, 0.5}, 0.4);
  std::vector<BodyId> ids;
  pushed.body_ids(&ids);
  for (const BodyId id : ids)
    if (id != kWorldBody)
      pushed.add_wrench({id, pushed.body(id).mass * gravity, Vector3d::Zero(), 0.0, kInfinity});
  for (int k = 0; k < 100; ++k) {
    falling.step();
    pushed.step();
    ASSERT_LT(largest_distance(falling, pushed), 1e4 * kEpsilon) << "tick " << k;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
