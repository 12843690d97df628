// A box between two fingers whose motors have force limits, by the methods of impulses. Oracle:
// Coulomb's law. Fingers that press with F each hold the mass m where 2 μ F ≥ m g, else it falls
// with the acceleration g − 2 μ F/m.

#include <string>
#include <tuple>

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kPress = 20.0, kFriction = 0.5, kGravity = 9.81;
constexpr double kMostMass = 2.0 * kFriction * kPress / kGravity;

enum class Drive { kPosition, kRate };

struct Grasp {
  World world;
  BodyId box, table;

  Grasp(Method method, double time_step, Drive drive, double mass)
      : world(options(method, time_step)) {
    Body plate = make_body("table", Box{{0.04, 0.04, 0.02}}, 1.0, {0.0, 0.0, -0.03});
    plate.type = BodyType::kStatic;
    table = world.add_body(plate);
    Body held = make_body("box", Box{{0.04, 0.04, 0.04}}, mass, Vector3d::Zero());
    held.friction = kFriction;
    box = world.add_body(held);
    for (const double side : {-1.0, 1.0}) {
      const std::string name = side < 0.0 ? "left" : "right";
      Body finger = make_body(name, Box{{0.02, 0.03, 0.06}}, 0.1, {0.05 * side, 0.0, 0.0});
      finger.friction = kFriction;
      finger.gravity_compensation = 1.0;
      const BodyId id = world.add_body(finger);
      Joint guide = make_joint(name + "_guide", kWorldBody, {0.05 * side, 0.0, 0.0}, id,
                               Vector3d::Zero(), JointKind::kSlider);
      guide.frame_a = frame_along({-side, 0.0, 0.0});
      Motor& motor = guide.coordinates[0].motor.emplace();
      motor.max_force = kPress;
      if (drive == Drive::kPosition)
        motor.position = 0.04;
      else
        motor.bias = 0.1;
      world.add_joint(guide);
    }
  }

  static WorldOptions options(Method method, double time_step) {
    WorldOptions options;
    options.method = method;
    options.time_step = time_step;
    options.sleep_after = kInfinity;
    return options;
  }

  void run_for(double time) {
    const int n = static_cast<int>(std::round(time / world.options().time_step));
    for (int i = 0; i < n; ++i) ASSERT_FALSE(world.step().outcome.failed);
  }
};

using Case = std::tuple<Method, double, Drive>;
class Grasps : public testing::TestWithParam<Case> {};

TEST_P(Grasps, HoldWhatFrictionAllows) {
  const auto [method, time_step, drive] = GetParam();
  for (const double share : {0.3, 0.99}) {
    Grasp grasp(method, time_step, drive, share * kMostMass);
    grasp.run_for(1.0);
    grasp.world.remove_body(grasp.table);
    const Vector3d start = grasp.world.state(grasp.box).position;
    grasp.run_for(1.0);
    // Impulses are solved to 1e-8 m/s at most; measured 1.5e-10 m.
    EXPECT_LT((grasp.world.state(grasp.box).position - start).norm(), 1e-8) << share;
    for (const JointId id : grasp.world.joint_ids()) {
      EXPECT_TRUE(grasp.world.joint_state(id).saturated);
      EXPECT_NEAR(std::abs(grasp.world.joint_state(id).force), kPress, 1e-6);
    }
  }
}

TEST_P(Grasps, DropWhatFrictionDoesNotHold) {
  const auto [method, time_step, drive] = GetParam();
  for (const double share : {1.01, 3.0}) {
    Grasp grasp(method, time_step, drive, share * kMostMass);
    grasp.run_for(1.0);
    grasp.world.remove_body(grasp.table);
    const double start = grasp.world.state(grasp.box).position.z();
    const double begin = grasp.world.time();
    const double a = kGravity * (1.0 - 1.0 / share);
    grasp.run_for(std::min(0.2, std::sqrt(2.0 * 0.02 / a)));
    const double time = grasp.world.time() - begin;
    EXPECT_NEAR(start - grasp.world.state(grasp.box).position.z(), 0.5 * a * time * time, 1e-8)
        << share;
  }
}

INSTANTIATE_TEST_SUITE_P(Ways, Grasps,
                         testing::Combine(testing::Values(Method::kAuto, Method::kTimeStepping),
                                          testing::Values(1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0,
                                                          1.0 / 1000.0),
                                          testing::Values(Drive::kPosition, Drive::kRate)));

// A motor to a position that is too weak for its prescribed motion arrives all the same, by the
// method of the tutorial: at most at a rate of its distance in a second, from which its force stops
// it. It never acts with more than its force.
TEST(WeakMotors, ReachTheirPositionByImpulses) {
  for (const double time_step : {1.0 / 30.0, 1.0 / 240.0, 1.0 / 1000.0})
    for (const double force : {1.0, 5.0, 20.0}) {
      World world(Grasp::options(Method::kSequentialImpulses, time_step));
      Body body = make_body("body", Sphere{0.1}, 1.0, Vector3d::Zero());
      body.gravity_compensation = 1.0;
      const BodyId id = world.add_body(body);
      Joint slider = make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(),
                                JointKind::kSlider);
      Motor& motor = slider.coordinates[0].motor.emplace();
      motor.position = 0.8;
      motor.max_force = force;
      const JointId joint = world.add_joint(slider);
      double most = 0.0;
      const int n = static_cast<int>(std::round(20.0 / time_step));
      for (int i = 0; i < n; ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        most = std::max(most, world.joint_state(joint).coordinates[0].position);
        ASSERT_LE(std::abs(world.joint_state(joint).force), force * (1.0 + 1e-12));
      }
      EXPECT_NEAR(world.joint_state(joint).coordinates[0].position, 0.8, 1e-12);
      EXPECT_LE(most, 0.8 + 1e-12);
    }
}

}  // namespace
}  // namespace constraint_sim::engine
