// Joints that are added open: from any orientation, to the solution that is meant, with the momenta
// of free bodies kept.

#include "constraint_sim/engine/scene.h"
#include "engine/constraints/joint_kinds.h"
#include "random_joints.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kTrials = kSanitizedShare > 1 ? 1 : 5;

struct Opening {
  JointKind kind;
  double angle;  // [rad]
};

/// Two boxes in free space in a joint that was met before B was turned by the angle about a random
/// axis, and moved by a tenth of a metre.
World open_pair(const Opening& opening, Method method, double h, int trial, double gap = 0.1) {
  Random random;
  for (int i = 0; i < 31 * trial; ++i) random();
  WorldOptions chosen = weightless(h);
  chosen.method = method;
  chosen.tolerance = 1e-11;
  Joint joint = random_joint(opening.kind, &random);
  joint.anchor_a *= 0.3;
  joint.anchor_b *= 0.3;
  Body a = make_body("a", Box{{0.3, 0.5, 0.9}}, 2.0, Vector3d::Zero());
  Body b = make_body("b", Box{{0.8, 0.2, 0.4}}, 3.0, Vector3d::Zero());
  a.state = random.state();
  a.state.angular_velocity *= 0.3;
  b.state = attached(joint, a.state, &random);
  const JointVectors met(joint, a.state, b.state);
  // about an axis that opens the joint by all of the angle
  Vector3d axis = met.axes_B * random.vector();
  const Vector3d z = met.axes_B.col(2), z_A = met.axes_A.col(2);
  if (info(opening.kind).alignment == Alignment::kParallelZ) axis -= z * z.dot(axis);
  if (info(opening.kind).alignment == Alignment::kPerpendicularZ) axis = z.cross(z_A);
  b.state.orientation = Eigen::AngleAxisd(opening.angle, axis.normalized()) * b.state.orientation;
  b.state.position += gap * random.vector();
  b.state.linear_velocity =
      a.state.linear_velocity + a.state.angular_velocity.cross(b.state.position - a.state.position);
  b.state.angular_velocity = a.state.angular_velocity;
  a.no_collision = b.no_collision = true;
  World world(chosen);
  joint.body_a = world.add_body(a);
  joint.body_b = world.add_body(b);
  world.add_joint(joint);
  return world;
}

std::vector<Opening> openings() {
  std::vector<Opening> list;
  for (const JointKind kind : joint_kinds()) {
    if (info(kind).alignment == Alignment::kFree) continue;
    for (const double degrees : {5.0, 60.0, 90.0, 120.0, 150.0, 175.0, 179.9}) {
      const bool is_universal = info(kind).alignment == Alignment::kPerpendicularZ;
      if (is_universal && degrees > 89.9) continue;  // further, the other side is nearer
      list.push_back({kind, degrees * kPi / 180.0});
    }
  }
  return list;
}

class Closing : public testing::TestWithParam<Opening> {};

// Errors are rounding of the bodies' coordinates and turns. Momenta are exact by energy_momentum,
// and to the tolerance by runge_kutta.
TEST_P(Closing, EndsInTheSolutionThatIsMeantAndKeepsMomenta) {
  for (int trial = 0; trial < kTrials; ++trial) {
    for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
      World world = open_pair(GetParam(), method, 0.02, trial);
      const JointId joint = world.joint_ids().front();
      EXPECT_NEAR(world.joint_state(joint).angle_error, GetParam().angle, 1e-6);
      EXPECT_TRUE(world.joint_state(joint).closing);
      world.step();
      const Vector3d p = momentum(world), L = angular_momentum(world);
      for (int i = 0; i < 40; ++i) {
        ASSERT_FALSE(world.step().failed) << name(method) << trial;
        ASSERT_NE(world.islands().front().why, MethodReason::kInconsistent)
            << name(method) << trial;
      }
      EXPECT_FALSE(world.joint_state(joint).closing) << name(method) << trial;
      EXPECT_LE(world.joint_state(joint).angle_error, 1e-7) << name(method) << trial;
      EXPECT_LE(world.report().max_constraint_error, 1e-13) << name(method) << trial;
      EXPECT_LE((momentum(world) - p).norm(), 1e-11) << name(method) << trial;
      const bool is_exact = method == Method::kEnergyMomentum;
      EXPECT_LE((angular_momentum(world) - L).norm(), is_exact ? 1e-10 : 1e-8)
          << name(method) << trial;
    }
  }
}

// A share of the error a step, as the tutorial has it; what is left is less each step.
TEST_P(Closing, EndsThereByImpulses) {
  World world = open_pair(GetParam(), Method::kSequentialImpulses, 0.01, 1);
  WorldOptions chosen = world.options();
  chosen.iterations = 100;
  world.set_options(chosen);
  for (int i = 0; i < 200; ++i) world.step();
  const JointState& state = world.joint_state(world.joint_ids().front());
  EXPECT_LE(state.angle_error, 0.01);
  EXPECT_LE(state.error, 0.01);
}

// What is saved on the way goes on, to the same place.
TEST_P(Closing, GoesOnFromWhatWasSaved) {
  for (const Method method : {Method::kRungeKutta, Method::kSequentialImpulses}) {
    World world = open_pair(GetParam(), method, 0.02, 2);
    for (int i = 0; i < 10; ++i) world.step();
    const std::string saved = save_scene(world);
    World loaded = load_scene(saved, "saved");
    EXPECT_EQ(save_scene(loaded), saved);
    for (int i = 0; i < 30; ++i) {
      world.step();
      loaded.step();
    }
    for (const BodyId id : world.body_ids())
      EXPECT_LE((world.state(id).position - loaded.state(id).position).norm(), 1e-7);
  }
}

INSTANTIATE_TEST_SUITE_P(Openings, Closing, testing::ValuesIn(openings()), [](const auto& param) {
  return std::string(name(param.param.kind)) + "_" +
         std::to_string(static_cast<int>(param.param.angle * 180.0 / kPi + 0.5));
});

// The smooth methods follow the same course of the frame.
TEST(ClosingFrame, IsFollowedAlike) {
  const Opening opening{JointKind::kHinge, 2.0};
  World exact = open_pair(opening, Method::kRungeKutta, 0.01, 3);
  World implicit = open_pair(opening, Method::kEnergyMomentum, 0.001, 3);
  for (int i = 0; i < 60; ++i) exact.step();
  for (int i = 0; i < 600; ++i) implicit.step();
  for (const BodyId id : exact.body_ids())
    EXPECT_LE((exact.state(id).position - implicit.state(id).position).norm(), 1e-6);
}

// Open on a body that is fixed, on either side, with a motor that runs meanwhile.
TEST(ClosingFrame, GoesHomeOnFixedBodiesWhileAMotorRuns) {
  for (const bool world_is_b : {false, true}) {
    for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
      WorldOptions chosen = options(0.01);
      chosen.method = method;
      World world(chosen);
      Body bar = make_body("bar", Box{{1.0, 0.1, 0.1}}, 1.0, {0.5, 0.0, 0.1});
      bar.state.orientation = Eigen::AngleAxisd(1.0, Vector3d::UnitX());
      bar.no_collision = true;
      const BodyId id = world.add_body(bar);
      Joint hinge = make_joint("hinge", kWorldBody, Vector3d::Zero(), id, {-0.5, 0.0, 0.0},
                               JointKind::kHinge);
      hinge.frame_a = frame_along(Vector3d::UnitY());
      hinge.frame_b = hinge.frame_a;
      if (world_is_b) {
        std::swap(hinge.body_a, hinge.body_b);
        std::swap(hinge.anchor_a, hinge.anchor_b);
      }
      hinge.coordinates[0].motor.emplace();
      hinge.coordinates[0].motor->bias = 0.5;
      const JointId joint = world.add_joint(hinge);
      const double start = world.joint_state(joint).coordinates[0].position;
      for (int i = 0; i < 100; ++i) ASSERT_FALSE(world.step().failed);
      EXPECT_LE(world.report().max_constraint_error, 1e-13) << name(method) << world_is_b;
      EXPECT_NEAR(world.joint_state(joint).coordinates[0].position, start + 0.5, 1e-12);
    }
  }
}

// A coordinate that a motor holds is that of the moving frame, so a world loaded meanwhile closes
// what is left in the time that is left, and does not begin anew.
TEST(ClosingFrame, GoesOnFromWhatWasSavedWhileAMotorRuns) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    WorldOptions chosen = options(0.01);
    chosen.method = method;
    World world(chosen);
    Body bar = make_body("bar", Box{{1.0, 0.1, 0.1}}, 1.0, {0.1, 0.05, 0.1});
    bar.state.orientation = Eigen::AngleAxisd(1.0, Vector3d::UnitX());
    bar.no_collision = true;
    Joint joint = make_joint("joint", kWorldBody, Vector3d::Zero(), world.add_body(bar),
                             {-0.1, 0.0, 0.0}, JointKind::kCylindrical);
    joint.frame_b = Quaterniond::Identity();
    joint.coordinates[0].motor.emplace();
    joint.coordinates[0].motor->bias = 0.5;
    const JointId id = world.add_joint(joint);
    for (int i = 0; i < 20; ++i) world.step();
    ASSERT_TRUE(world.joint_state(id).closing);
    World loaded = load_scene(save_scene(world), "saved");
    for (int i = 0; i < 20; ++i) {
      world.step();
      loaded.step();
    }
    EXPECT_EQ(loaded.joint_state(loaded.joint_ids().front()).closing_since, 0.0) << name(method);
    for (const BodyId body : world.body_ids())
      EXPECT_LE((world.state(body).position - loaded.state(body).position).norm(), 1e-7);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
