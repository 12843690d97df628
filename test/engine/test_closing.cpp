// Joints that are added open: they close from any orientation to the intended solution, and momenta
// of free bodies are kept.

#include "constraint_sim/engine/scene.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/model/joint_data.h"
#include "random_joints.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kClosingTrials = kSanitizedShare > 1 ? 1 : 5;

struct Opening {
  JointKind kind;
  double angle;  // [rad]
};

/// Two boxes in free space, whose joint fitted until B was rotated by the angle about a random axis
/// and moved by a tenth of a metre.
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
  // an axis about which the rotation opens the joint by the full angle
  Vector3d axis = met.axes_B * random.vector();
  const Vector3d z = met.axes_B.col(2), z_A = met.axes_A.col(2);
  if (forms(opening.kind).alignment == Alignment::kParallelZ) axis -= z * z.dot(axis);
  if (forms(opening.kind).alignment == Alignment::kPerpendicularZ) axis = z.cross(z_A);
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
    if (forms(kind).alignment == Alignment::kFree) continue;
    const bool is_universal = forms(kind).alignment == Alignment::kPerpendicularZ;
    const std::vector<double> most_are{5.0, 60.0, 90.0, 120.0, 150.0, 175.0, 179.9};
    // beyond 90° the other solution is nearer
    for (const double degrees : is_universal ? std::vector<double>{5.0, 60.0, 89.9} : most_are)
      list.push_back({kind, degrees * kPi / 180.0});
  }
  return list;
}

class Closing : public testing::TestWithParam<Opening> {};

// Errors are rounding of the bodies' coordinates and orientations. Momenta are exact by
// energy_momentum, and within the tolerance by runge_kutta.
TEST_P(Closing, EndsInTheSolutionThatIsMeantAndKeepsMomenta) {
  for (int trial = 0; trial < kClosingTrials; ++trial) {
    for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
      World world = open_pair(GetParam(), method, 0.02, trial);
      const JointId joint = world.joint_ids().front();
      EXPECT_NEAR(world.joint_state(joint).angle_error, GetParam().angle, 1e-6);
      EXPECT_TRUE(world.joint_state(joint).closing);
      world.step();
      const Vector3d p = momentum(world), L = angular_momentum(world);
      for (int i = 0; i < 40; ++i) {
        ASSERT_FALSE(world.step().outcome.failed) << name(method) << trial;
        ASSERT_NE(world.islands().front().why, MethodReason::kInconsistent)
            << name(method) << trial;
      }
      EXPECT_FALSE(world.joint_state(joint).closing) << name(method) << trial;
      EXPECT_LE(world.joint_state(joint).angle_error, 1e-7) << name(method) << trial;
      EXPECT_LE(world.report().joints.max_error, 1e-13) << name(method) << trial;
      EXPECT_LE((momentum(world) - p).norm(), 1e-11) << name(method) << trial;
      const bool is_exact = method == Method::kEnergyMomentum;
      EXPECT_LE((angular_momentum(world) - L).norm(), is_exact ? 1e-10 : 1e-8)
          << name(method) << trial;
    }
  }
}

// Each step removes a share of the error, as in the tutorial; the remaining error decreases in each
// step.
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

// A scene saved while closing continues to the same place.
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

// A ball joint has a moving frame while it is open, and three rows along the world's axes
// afterwards.
TEST(ClosingBall, KeepsMomentaAndGoesOnFromWhatWasSaved) {
  for (int trial = 0; trial < kClosingTrials; ++trial) {
    for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
      SCOPED_TRACE(testing::Message() << name(method) << trial);
      World world = open_pair({JointKind::kBall, 1.0}, method, 0.02, trial, 0.4);
      const JointId joint = world.joint_ids().front();
      ASSERT_TRUE(world.joint_state(joint).closing);
      world.step();
      const Vector3d p = momentum(world), L = angular_momentum(world);
      World loaded;
      for (int i = 0; i < 40; ++i) {
        if (i == 10) loaded = load_scene(save_scene(world), "saved");
        ASSERT_FALSE(world.step().outcome.failed);
        if (i >= 10) loaded.step();
      }
      EXPECT_FALSE(world.joint_state(joint).closing);
      EXPECT_LE(world.report().joints.max_error, 1e-13);
      EXPECT_LE((momentum(world) - p).norm(), 1e-11);
      const bool is_exact = method == Method::kEnergyMomentum;
      EXPECT_LE((angular_momentum(world) - L).norm(), is_exact ? 1e-10 : 1e-8);
      for (const BodyId id : world.body_ids())
        EXPECT_LE((world.state(id).position - loaded.state(id).position).norm(), 1e-7);
    }
  }
}

// Trees of four boxes 1 km away, some held at their centres, all joints open by up to half a metre.
// Coordinates there are rounded to 1e-13 m, so the angular momentum about the origin is known to
// about 1e-10 relative, here 1e-7; momenta do not depend on positions.
TEST(ClosingBall, OfRandomTreesKeepsMomenta) {
  Random random;
  for (int trial = 0; trial < 4 * kClosingTrials; ++trial) {
    const double h = trial % 2 == 0 ? 0.02 : 0.1;
    for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
      SCOPED_TRACE(testing::Message() << name(method) << trial);
      WorldOptions options = weightless(h);
      options.method = method;
      options.tolerance = 1e-11;
      World world(options);
      std::vector<BodyId> bodies;
      for (int i = 0; i < 4; ++i) {
        Body box = make_body("b" + std::to_string(i), Box{{0.8, 0.5, 0.3}}, 1.0 + i,
                             Vector3d(1000.0 + i, 0.0, 0.0) + 0.3 * random.vector());
        box.state.orientation = random.state().orientation;
        box.state.angular_velocity = 0.3 * random.vector();
        box.no_collision = true;
        bodies.push_back(world.add_body(box));
      }
      for (std::size_t i = 1; i < bodies.size(); ++i) {
        const auto share = 0.5 * (random() + 1.0) * static_cast<double>(i);
        const BodyId parent = bodies[static_cast<std::size_t>(share)];
        const Vector3d on_child =
            (trial + i) % 3 == 0 ? Vector3d::Zero().eval() : (0.3 * random.vector()).eval();
        world.add_joint(make_joint("j" + std::to_string(i), parent, 0.3 * random.vector(),
                                   bodies[i], on_child, JointKind::kBall));
      }
      world.step();
      const Vector3d p = momentum(world), L = angular_momentum(world);
      for (int i = 0; i < 40; ++i) ASSERT_FALSE(world.step().outcome.failed);
      for (const JointId id : world.joint_ids()) EXPECT_FALSE(world.joint_state(id).closing);
      EXPECT_LE(world.report().joints.max_error, 1e-12);
      EXPECT_LE((momentum(world) - p).norm(), 1e-10);
      EXPECT_LE((angular_momentum(world) - L).norm(), 1e-7);
    }
  }
}

// Joints that hold a point of B on a line or in a plane of A have no orientation to close, only a
// distance.
TEST(ClosingPoint, KeepsMomenta) {
  for (const JointKind kind : {JointKind::kPointOnLine, JointKind::kPointOnPlane}) {
    for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
      for (const double degrees : {5.0, 90.0, 179.9}) {
        SCOPED_TRACE(testing::Message() << name(kind) << " by " << name(method) << degrees);
        World world = open_pair({kind, degrees * kPi / 180.0}, method, 0.02, 1);
        const JointId joint = world.joint_ids().front();
        EXPECT_GT(world.joint_state(joint).error, 1e-3);
        ASSERT_TRUE(world.joint_state(joint).closing);
        world.step();
        const Vector3d p = momentum(world), L = angular_momentum(world);
        for (int i = 0; i < 40; ++i) ASSERT_FALSE(world.step().outcome.failed);
        EXPECT_FALSE(world.joint_state(joint).closing);
        EXPECT_LE(world.report().joints.max_error, 1e-13);
        EXPECT_LE((momentum(world) - p).norm(), 1e-11);
        const bool is_exact = method == Method::kEnergyMomentum;
        EXPECT_LE((angular_momentum(world) - L).norm(), is_exact ? 1e-10 : 1e-8);
      }
    }
  }
}

// Where B cannot rotate, the offset closes along a straight line in space.
TEST(ClosingBall, OfAPointGoesStraight) {
  World world = open_pair({JointKind::kBall, 0.3}, Method::kRungeKutta, 0.02, 0);
  const BodyId box = world.body_ids().front();
  const BodyId point = world.add_body(
      make_body("point", Point{}, 0.5, world.state(box).position + Vector3d::Ones()));
  const JointId id = world.add_joint(
      make_joint("tie", box, {0.2, 0.0, 0.0}, point, Vector3d::Zero(), JointKind::kBall));
  const auto separation = [&]() -> Vector3d {
    const BodyState state = world.state(box);
    return world.state(point).position - state.position -
           state.orientation * Vector3d(0.2, 0.0, 0.0);
  };
  const Vector3d before = separation();
  for (int i = 0; i < 15; ++i) world.step();
  EXPECT_GT(separation().norm(), 0.2);
  EXPECT_LE(separation().normalized().cross(before.normalized()).norm(), 1e-12);
  for (int i = 0; i < 15; ++i) world.step();
  EXPECT_LE(separation().norm(), 1e-14);
  EXPECT_FALSE(world.joint_state(id).closing);
}

// Both smooth methods follow the same motion of the frame.
TEST(ClosingFrame, IsFollowedAlike) {
  const Opening opening{JointKind::kHinge, 2.0};
  World exact = open_pair(opening, Method::kRungeKutta, 0.01, 3);
  World implicit = open_pair(opening, Method::kEnergyMomentum, 0.001, 3);
  for (int i = 0; i < 60; ++i) exact.step();
  for (int i = 0; i < 600; ++i) implicit.step();
  for (const BodyId id : exact.body_ids())
    EXPECT_LE((exact.state(id).position - implicit.state(id).position).norm(), 1e-6);
}

// A joint to a fixed body on either side, opened, with a motor running.
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
      for (int i = 0; i < 100; ++i) ASSERT_FALSE(world.step().outcome.failed);
      EXPECT_LE(world.report().joints.max_error, 1e-13) << name(method) << world_is_b;
      EXPECT_NEAR(world.joint_state(joint).coordinates[0].position, start + 0.5, 1e-12);
    }
  }
}

// The coordinate held by a motor is that of the moving frame, so a loaded world closes the
// remaining error in the remaining time and does not start anew.
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
    EXPECT_EQ(joint_data(loaded, loaded.joint_ids().front()).to_close.since, 0.0) << name(method);
    for (const BodyId body : world.body_ids())
      EXPECT_LE((world.state(body).position - loaded.state(body).position).norm(), 1e-7);
  }
}

// A rope or rod to a body whose twist is set before each tick closes nevertheless.
TEST(ClosingDistance, GoesOnWhileAKinematicBodyIsDriven) {
  WorldOptions chosen = options(0.005);
  chosen.method = Method::kAuto;
  World world(chosen);
  Body hook = make_body("hook", Sphere{0.05}, 1.0, {0.0, 0.0, 3.0});
  hook.type = BodyType::kKinematic;
  const BodyId driven = world.add_body(hook);
  const BodyId load = world.add_body(make_body("load", Sphere{0.1}, 5.0, {1.0, 0.0, 2.0}));
  Joint rod;
  rod.name = "rod";
  rod.body_a = driven;
  rod.body_b = load;
  rod.distance.length = 1.0;
  const JointId id = world.add_joint(rod);
  EXPECT_TRUE(world.joint_state(id).closing);
  while (world.time() < 0.6) {
    BodyState state = world.state(driven);
    state.linear_velocity.x() = std::sin(5.0 * world.time());
    world.set_state(driven, state);
    world.step();
  }
  EXPECT_FALSE(world.joint_state(id).closing);
  EXPECT_LT(std::abs(world.joint_state(id).error), 1e-12);
}

}  // namespace
}  // namespace constraint_sim::engine
