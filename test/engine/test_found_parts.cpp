// Steps that events begin and impulses end, since they take more than `event_work`. Oracles: closed
// forms of a ball that goes to and fro.

#include "by_events.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kHitSpeed = 10.0, kHalfRoom = 0.05, kBallRadius = 0.1, kTenHits = 0.1;

Body moving_ball() {
  Body ball = with_surface(make_body("ball", Sphere{kBallRadius}, 1.0, Vector3d::Zero()), 0.1, 1.0);
  ball.state.linear_velocity = kHitSpeed * Vector3d::UnitX();
  return ball;
}

/// Returns a joint along x whose first coordinate has stops.
Joint between_stops(JointKind kind) {
  Joint joint;
  joint.name = "joint";
  joint.kind = kind;
  joint.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
  joint.coordinates[0].lower = -kHalfRoom;
  joint.coordinates[0].upper = kHalfRoom;
  joint.coordinates[0].limit_restitution = 1.0;
  return joint;
}

/// Makes a ball that moves along x between walls, or stops of a slider, that give all its speed
/// back, and hits one every 0.01 s, first after 0.005 s. A step has ten hits.
World between_walls(bool has_slider, double work, double contact_tolerance) {
  WorldOptions options = by_events(kTenHits);
  options.gravity.setZero();
  options.event_work = work;
  options.contact_tolerance = contact_tolerance;
  World world(options);
  const BodyId id = world.add_body(moving_ball());
  if (has_slider) {
    Joint slider = between_stops(JointKind::kSlider);
    slider.body_b = id;
    world.add_joint(slider);
    return world;
  }
  for (const double side : {-1.0, 1.0})
    world.add_body(plane(side < 0.0 ? "left" : "right",
                         side * (kHalfRoom + kBallRadius) * Vector3d::UnitX(),
                         -side * Vector3d::UnitX(), 0.0, 1.0));
  return world;
}

// The hits found before the work was used up are those of the closed form, and are reported. The
// handover is at the last of them or after it. Impulses take the rest of the step alone: the ball
// stays as fast as it was, and within the room by what impulses move in this rest.
TEST(FoundParts, AreKept) {
  for (const bool has_slider : {false, true}) {
    for (const double contact_tolerance : {0.0, 1e-4}) {
      World world = between_walls(has_slider, 12.0, contact_tolerance);
      const StepReport& report = world.step();
      ASSERT_TRUE(uses_impulses(world.islands()[0].method)) << has_slider << contact_tolerance;
      std::vector<double> hits;
      double handover = kTenHits;
      for (const Event& event : world.events()) {
        if (event.impulse > 0.0) hits.push_back(event.time);
        if (event.kind == EventKind::kHandedOver) handover = event.time;
      }
      ASSERT_GE(hits.size(), 2u) << has_slider << contact_tolerance;
      ASSERT_LT(hits.size(), 10u);
      EXPECT_GE(report.costs.events, hits.size());
      for (std::size_t k = 0; k < hits.size(); ++k)
        EXPECT_NEAR(hits[k], 0.005 + 0.01 * static_cast<double>(k), 1e-9) << has_slider << k;
      EXPECT_GE(handover, hits.back());
      const BodyState& ball = world.body(world.body_ids().front()).state;
      EXPECT_NEAR(std::abs(ball.linear_velocity.x()), kHitSpeed, 1e-9);
      EXPECT_LT(std::abs(ball.position.x()), kHalfRoom + (kTenHits - hits.back()) * kHitSpeed);
      if (has_slider) continue;
      // Impulses locate the hits of fast bodies, so the rest is exact but for the gap of a hit.
      EXPECT_NEAR(ball.position.x(), 0.0, 1e-6);
      ASSERT_EQ(world.contacts().size(), 2u);
      for (const Contact& contact :
           world.contacts())  // five hits in each step, each turns m v round
        EXPECT_NEAR(contact.force.norm(), 5.0 * 2.0 * kHitSpeed / kTenHits, 1e-6)
            << contact_tolerance;
    }
  }
}

// Forces across the slider do not depend on the motion, so their means over the step are those of
// statics, from both parts together. A wrench begins before the handover and ends after it.
TEST(FoundParts, KeepTheirShareOfTheForcesOfJoints) {
  for (const double event_work : {8.0, 12.0}) {
    WorldOptions options = by_events(kTenHits);
    options.event_work = event_work;
    World world(options);
    Joint slider = between_stops(JointKind::kSlider);
    slider.body_b = world.add_body(moving_ball());
    const JointId id = world.add_joint(slider);
    Wrench wrench;
    wrench.body = slider.body_b;
    wrench.torque = {0.2, 0.0, 0.3};
    world.add_wrench(wrench);
    Wrench passing;
    passing.body = slider.body_b;
    passing.force = {0.0, 3.0, 0.0};
    passing.start = 0.1 * kTenHits;
    passing.end = 0.7 * kTenHits;
    world.add_wrench(passing);
    world.step();
    ASSERT_TRUE(uses_impulses(world.islands()[0].method)) << event_work;
    EXPECT_GE(world.events().size(), 3u);
    EXPECT_GT(world.events().back().time, passing.start) << event_work;
    EXPECT_LT(world.events().back().time, passing.end) << event_work;
    const World::JointWrench by_joint = world.joint_wrench(id);
    const Eigen::Matrix3d frame = slider.frame_a.toRotationMatrix();
    const Vector3d force = frame * by_joint.force, torque = frame * by_joint.torque;
    EXPECT_NEAR(force.y(), -0.6 * 3.0, 1e-6) << event_work;
    EXPECT_NEAR(force.z(), 9.81, 1e-6) << event_work;
    EXPECT_LT((torque + wrench.torque).norm(), 1e-6) << event_work;
  }
}

// A motor turns the ball against a constant torque, by whole turns: at a constant rate, or at that
// of a sine, whose angle is its integral.
TEST(FoundParts, KeepTurnsAndMotors) {
  constexpr double kRate = 200.0;  // three turns in the step
  for (const double frequency : {0.0, 7.0}) {
    WorldOptions options = by_events(kTenHits);
    options.gravity.setZero();
    options.event_work = 12.0;
    World world(options);
    Joint joint = between_stops(JointKind::kCylindrical);
    Motor& motor = joint.coordinates[1].motor.emplace();
    motor.bias = kRate;
    motor.amplitude = frequency > 0.0 ? 50.0 : 0.0;
    motor.frequency = frequency;
    Body ball = moving_ball();
    ball.state.angular_velocity = kRate * Vector3d::UnitX();
    joint.body_b = world.add_body(ball);
    const JointId id = world.add_joint(joint);
    Wrench wrench;
    wrench.body = joint.body_b;
    wrench.torque = {0.5, 0.0, 0.0};
    world.add_wrench(wrench);
    world.step();
    ASSERT_TRUE(uses_impulses(world.islands()[0].method));
    EXPECT_GE(world.events().size(), 3u);
    const CoordinateState& turn = world.joint_state(id).coordinates[1];
    const double phase = 2.0 * kPi * frequency * kTenHits;
    const double mean =
        kRate + (frequency > 0.0 ? motor.amplitude * (1.0 - std::cos(phase)) / phase : 0.0);
    EXPECT_NEAR(turn.position, mean * kTenHits, 1e-6) << frequency;
    EXPECT_NEAR(turn.bias, mean, 1e-6) << frequency;
    if (frequency > 0.0) continue;
    EXPECT_NEAR(turn.velocity, kRate, 1e-9);
    EXPECT_NEAR(turn.effort, -0.5, 1e-6);
  }
}

// A wrench that begins within a step divides it. The rate of a motor is the mean over the step, of
// both coordinates.
TEST(FoundParts, ForcesThatBeginInAStepLeaveTheRatesOfMotors) {
  for (const Method method : {Method::kRungeKutta, Method::kEventDriven, Method::kTimeStepping}) {
    WorldOptions options;
    options.method = method;
    options.time_step = kTenHits;
    options.contact_tolerance = 1e-4;
    World world(options);
    Joint joint;
    joint.name = "joint";
    joint.kind = JointKind::kCylindrical;
    joint.body_b = world.add_body(make_body("ball", Sphere{kBallRadius}, 1.0, Vector3d::Zero()));
    for (const std::size_t i : {0, 1}) {
      Motor& motor = joint.coordinates[i].motor.emplace();
      motor.amplitude = 2.0;
      motor.frequency = i == 0 ? 3.0 : 4.0;
    }
    const JointId id = world.add_joint(joint);
    Wrench wrench;
    wrench.body = joint.body_b;
    wrench.force.x() = 1.0;
    wrench.start = 0.3 * kTenHits;
    world.add_wrench(wrench);
    world.step();
    for (const std::size_t i : {0, 1}) {
      const Motor& motor = *joint.coordinates[i].motor;
      const double phase = 2.0 * kPi * motor.frequency * kTenHits;
      const double mean = motor.amplitude * (1.0 - std::cos(phase)) / phase;
      const JointState& state = world.joint_state(id);
      EXPECT_NEAR(i == 0 ? state.bias : state.coordinates[i].bias, mean, 1e-12)
          << static_cast<int>(method) << i;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
