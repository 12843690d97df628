// Angles with whole turns. Closed forms are the oracle: what keeps its speed between elastic stops
// reads a triangle wave, whatever the time step, and a constant torque a parabola. A body may turn
// by more than a half turn within a step, and come back within it.

#include <string>
#include <utility>
#include <vector>

#include "spinning_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kTurningTimeSteps[] = {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0};
constexpr int kTurningSeeds = kSanitizedShare > 1 ? 2 : 25;

WorldOptions turning_options(double time_step) {
  WorldOptions options;
  options.time_step = time_step;
  options.gravity.setZero();
  return options;
}

/// A wheel of 1 kg on a hinge about z.
JointId add_turning_wheel(World* world, const std::string& name, const Vector3d& at, double speed,
                          const CoordinateLaw& law = {}, double mass = 1.0) {
  Body wheel = make_body(name, Cylinder{0.1, 0.05}, mass, at);
  wheel.no_collision = true;
  wheel.state.angular_velocity.z() = speed;
  Joint hinge;
  hinge.name = name + "_hinge";
  hinge.kind = JointKind::kHinge;
  hinge.anchor_a = at;
  hinge.body_b = world->add_body(wheel);
  hinge.coordinates[0] = law;
  return world->add_joint(hinge);
}

/// Where a coordinate is that starts at 0 with a speed between elastic stops.
double reflected_angle(double lower, double upper, double travelled) {
  const double range = upper - lower;
  double phase = std::fmod(travelled - lower, 2.0 * range);
  if (phase < 0.0) phase += 2.0 * range;
  return lower + (phase < range ? phase : 2.0 * range - phase);
}

double turned_angle(const World& world, JointId id) {
  return world.joint_state(id).coordinates[0].position;
}

// 1e-6 rad: every stop is met to 1e-15 s, some hundred times.
TEST(WholeTurns, AreKeptBetweenElasticStops) {
  Random random;
  for (int seed = 0; seed < kTurningSeeds; ++seed) {
    const double speed = (random() < 0.0 ? -1.0 : 1.0) * std::pow(10.0, 2.0 + 0.8 * random());
    CoordinateLaw law;
    law.lower = -std::pow(10.0, 0.5 * (random() + 1.0));
    law.upper = std::pow(10.0, 0.5 * (random() + 1.0));
    law.limit_restitution = 1.0;
    const double ratio = (random() < 0.0 ? -1.0 : 1.0) * std::pow(10.0, 0.8 * random());
    for (const double h : kTurningTimeSteps) {
      World world(turning_options(h));
      const JointId stopped = add_turning_wheel(&world, "stopped", Vector3d::Zero(), speed, law);
      const JointId geared = add_turning_wheel(&world, "geared", {1.0, 0.0, 0.0}, -speed / ratio);
      Joint gear;
      gear.name = "gear";
      gear.kind = JointKind::kGear;
      gear.coupling.first = stopped;
      gear.coupling.second = geared;
      gear.coupling.ratio = ratio;
      world.add_joint(gear);
      for (int i = 1; i <= static_cast<int>(std::lround(0.5 / h)); ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        const double q = reflected_angle(law.lower, law.upper, speed * world.time());
        ASSERT_NEAR(turned_angle(world, stopped), q, 1e-6) << speed << " at 1/" << 1.0 / h;
        ASSERT_NEAR(turned_angle(world, geared), -q / ratio,
                    1e-6 * std::max(1.0, 1.0 / std::abs(ratio)))
            << speed << " at 1/" << 1.0 / h;
      }
    }
  }
}

// Beside a contact that joins them to a group: a ball that turns about its axis on a floor without
// friction, between elastic stops.
TEST(WholeTurns, AreKeptInContact) {
  for (const double speed : {50.0, 200.0, 700.0}) {
    for (const double h : kTurningTimeSteps) {
      WorldOptions options;
      options.time_step = h;
      World world(options);
      Body floor = make_body("floor", Plane{}, 0.0, Vector3d::Zero());
      floor.type = BodyType::kStatic;
      world.add_body(floor);
      Body ball = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.1});
      ball.state.angular_velocity.z() = speed;
      const BodyId id = world.add_body(ball);
      Joint joint;
      joint.name = "axle";
      joint.kind = JointKind::kCylindrical;
      joint.body_b = id;
      joint.coordinates[1].lower = -0.9;
      joint.coordinates[1].upper = 4.0;
      joint.coordinates[1].limit_restitution = 1.0;
      const JointId axle = world.add_joint(joint);
      for (int i = 1; i <= static_cast<int>(std::lround(0.2 / h)); ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        ASSERT_NEAR(world.joint_state(axle).coordinates[1].position,
                    reflected_angle(-0.9, 4.0, speed * world.time()), 1e-6)
            << speed << " at 1/" << 1.0 / h;
      }
    }
  }
}

/// Adds a body on a joint of a kind, whose coordinate is its angle about z. Returns joint and
/// coordinate.
std::pair<JointId, std::size_t> add_turning_body(World* world, JointKind kind) {
  Body wheel = make_body("wheel", Cylinder{0.1, 0.05}, 1.0, Vector3d::Zero());
  wheel.no_collision = true;
  Joint joint;
  joint.name = "joint";
  joint.kind = kind;
  joint.body_b = world->add_body(wheel);
  return {world->add_joint(joint), static_cast<std::size_t>(info(kind).coordinates - 1)};
}

// A torque reverses in the middle of the step: the body turns by 40 rad, and is at rest at both
// ends of the step. runge_kutta follows the rotation to its tolerance. Steps of energy_momentum
// rotate a body by 2 atan(θ/2) instead of θ, which its local error reports, but the number of
// turns is right.
TEST(WholeTurns, AreKeptWhereTorquesChangeWithinAStep) {
  for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kEnergyMomentum}) {
    for (const JointKind kind :
         {JointKind::kHinge, JointKind::kCylindrical, JointKind::kPlanar, JointKind::kParallel}) {
      for (const double h : kTurningTimeSteps) {
        WorldOptions options = turning_options(h);
        options.method = method;
        World world(options);
        const auto [id, coordinate] = add_turning_body(&world, kind);
        const double inertia = 0.5 * 0.1 * 0.1;
        const double turned = 40.0;  // [rad] in a step
        for (const double sign : {1.0, -1.0}) {
          Wrench wrench;
          wrench.body = world.joint(id).body_b;
          wrench.torque.z() = sign * turned * inertia / (0.25 * h * h);
          wrench.start = sign > 0.0 ? 0.0 : 0.5 * h;
          wrench.end = wrench.start + 0.5 * h;
          world.add_wrench(wrench);
        }
        ASSERT_FALSE(world.step().outcome.failed);
        EXPECT_NEAR(world.joint_state(id).coordinates[coordinate].position, turned,
                    method == Method::kEnergyMomentum ? kPi : 1e-6)
            << name(method) << " " << name(kind) << " at 1/" << 1.0 / h;
      }
    }
  }
}

// 1e-9 of the angle: rounding of 20 steps, and the tolerance of runge_kutta.
TEST(WholeTurns, AreKeptAtAnySpeed) {
  for (const Method method :
       {Method::kAuto, Method::kRungeKutta, Method::kEventDriven, Method::kSequentialImpulses}) {
    for (const double speed : {10.0, 1000.0, 3000.0, 20000.0}) {
      for (const double h : kTurningTimeSteps) {
        WorldOptions options = turning_options(h);
        options.method = method;
        World world(options);
        const JointId id = add_turning_wheel(&world, "wheel", Vector3d::Zero(), speed);
        run(world, 20);
        EXPECT_NEAR(turned_angle(world, id), speed * world.time(), 1e-9 * speed)
            << name(method) << " " << speed << " rad/s at 1/" << 1.0 / h;
      }
    }
  }
}

// energy_momentum loses no turn in a step, however fast: the pose is off by less than half a turn.
TEST(WholeTurns, AreKeptInStepsOfEnergyMomentum) {
  for (const double speed : {1000.0, 3000.0, 20000.0}) {
    for (const double h : kTurningTimeSteps) {
      WorldOptions options = turning_options(h);
      options.method = Method::kEnergyMomentum;
      World world(options);
      const JointId id = add_turning_wheel(&world, "wheel", Vector3d::Zero(), speed);
      double before = 0.0;
      for (int i = 0; i < 20; ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        EXPECT_NEAR(turned_angle(world, id) - before, speed * h, kPi)
            << speed << " rad/s at 1/" << 1.0 / h;
        before = turned_angle(world, id);
      }
    }
  }
}

/// Settings of energy_momentum in which rotations may be too fast.
std::vector<spinning::Setting> fast_settings(double speed, double time_step) {
  const spinning::Setting plain{Method::kEnergyMomentum, time_step, speed};
  std::vector<spinning::Setting> all(8, plain);
  all[1].mass = 1e-3;
  all[2].mass = 1e3;
  all[3].place = {1e4, -2e4, 3e3};
  all[4].stiff_order = 2;
  all[5].tolerance = 0.0;
  all[6].dissipation = true;
  all[7].method = Method::kAuto;
  return all;
}

// An error of energy_momentum is within its estimate, or the step names the bodies. The estimate of
// a tick leaves out terms of higher order: a factor of 3. A tolerance of 1e-8 m/s allows 1e-9 m in
// 0.1 s, and rounding 1e-12 m a radian.
TEST(WholeTurns, AreRightOrReportedByEnergyMomentum) {
  for (const spinning::Named& scene : spinning::kSpinning) {
    for (const double speed : {1e2, 1e3, 1e4, 1e5}) {
      for (const double h : kTurningTimeSteps) {
        for (const spinning::Setting& setting : fast_settings(speed, h)) {
          if (kSanitizedShare > 1 && h != kTurningTimeSteps[1]) continue;
          spinning::Spinning made = scene.make(setting);
          // errors of the tops grow with time, which no estimate of a tick has
          if (made.reference && (speed > 2e3 || setting.method == Method::kAuto)) continue;
          const int ticks = made.reference ? 1 : 6;
          const spinning::Seen seen = run(made, ticks * h, speed);
          const std::string what = std::string(scene.name) + " " + std::to_string(speed) +
                                   " rad/s at 1/" + std::to_string(1.0 / h) + " in " +
                                   std::to_string(setting.mass) + " kg, " + name(setting.method) +
                                   ", order " + std::to_string(setting.stiff_order) +
                                   (setting.dissipation ? ", dissipating" : "");
          EXPECT_TRUE(seen.is_named ||
                      seen.error <= 3.0 * seen.estimate + 1e-9 + 1e-12 * speed * h * ticks)
              << what << ": " << seen.error << " m, estimated " << seen.estimate << " m";
          EXPECT_TRUE(seen.is_named || seen.angle < 0.1 * ticks) << what << ": " << seen.angle;
        }
      }
    }
  }
}

// Steps that show the rotation name nobody: at most 0.01 rad of error in a tick.
TEST(WholeTurns, AreNotReportedWhereStepsShowThem) {
  for (const auto& [speed, h] :
       {std::pair{100.0, 1.0 / 30.0}, {700.0, 1.0 / 30.0}, {1e4, 1e-3}, {2.5e4, 1e-3}}) {
    for (const auto& make : {spinning::wheel, spinning::beside_a_stiff_spring}) {
      spinning::Spinning made = make({Method::kEnergyMomentum, h, speed});
      const spinning::Seen seen = run(made, 6 * h, speed);
      EXPECT_FALSE(seen.is_named) << speed << " rad/s at 1/" << 1.0 / h;
      EXPECT_LE(seen.angle, 6 * 0.01) << speed << " rad/s at 1/" << 1.0 / h;
    }
  }
}

// An impulse of a limit turns the motion round: the coordinate moves by the velocity after it.
TEST(WholeTurns, FollowTheVelocityOfImpulses) {
  for (const double h : kTurningTimeSteps) {
    WorldOptions options = turning_options(h);
    options.method = Method::kSequentialImpulses;
    World world(options);
    CoordinateLaw law;
    law.lower = -1.0;
    law.upper = 5.0;
    law.limit_restitution = 1.0;
    const JointId id = add_turning_wheel(&world, "wheel", Vector3d::Zero(), 300.0, law);
    double before = 0.0;
    for (int i = 0; i < 60; ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      const CoordinateState& now = world.joint_state(id).coordinates[0];
      // corrections of a limit move it beside, by less than half a turn
      EXPECT_LE(std::abs(now.position - before - h * now.velocity), kPi) << "at 1/" << 1.0 / h;
      before = now.position;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
