// Trees of joints with axes by their own elimination, as long trees have it, or in joint
// coordinates, as short ones; against the rows of the same mechanism, and where rows lose the force
// on a light link. Comparisons with the independent reference, moved, reordered, with laws and with
// a moving base, are in test_random_mechanisms.cpp and test_judged_mechanisms.cpp.

#include "bars_on_hinges.h"
#include "random_joints.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Bars of 1 kg and 1 m on hinges, the last of `load` kg.
World arm_of_bars(int bars, double load) {
  WorldOptions chosen;
  chosen.method = Method::kRungeKutta;
  chosen.gravity = {0.0, 0.3, -kGravity};
  chosen.tolerance = 1e-9;
  std::vector<double> masses(static_cast<std::size_t>(bars), 1.0);
  masses.back() = load;
  return bars_on_hinges(chosen, masses);
}

// A pivot per hinge keeps the accuracy that the Delassus matrix loses by adding 1 / m of the load
// to 1 / m of links. Tolerances: rounding of some hundred steps for energy, and of 3 m for joints.
TEST(TreeOfBodies, HoldsAnyLoadOnLightLinks) {
  for (const double load : {1.0, 1e3, 1e6, 1e9, 1e12}) {
    World world = arm_of_bars(3, load);
    for (int i = 0; i < 100; ++i) {
      ASSERT_FALSE(world.step().outcome.failed) << load;
      ASSERT_LE(world.report().joints.max_error, 1e-14) << load;
      ASSERT_LE(std::abs(world.report().energy.drift), 1e-12) << load;
    }
  }
}

// A second hinge on the axis of the first makes rows redundant, for which the tree is not used.
TEST(TreeOfBodies, MovesAsTheRowsOfTheSameMechanismDo) {
  for (const int bars : {1, 2, 5, 26}) {
    World tree = arm_of_bars(bars, 2.0), rows = arm_of_bars(bars, 2.0);
    Joint again = rows.joint(rows.joint_ids().front());
    again.name = "again";
    again.anchor_a.y() += 0.1;
    again.anchor_b = {-0.5, 0.1, 0.0};
    rows.add_joint(again);
    for (int i = 0; i < 50; ++i) {
      tree.step();
      rows.step();
    }
    EXPECT_EQ(rows.report().joints.dependent_rows, 5u);
    for (const BodyId id : tree.body_ids()) {
      EXPECT_LE((tree.state(id).position - rows.state(id).position).norm(), 1e-9) << bars;
      EXPECT_LE((tree.state(id).angular_velocity - rows.state(id).angular_velocity).norm(), 1e-8);
    }
    for (std::size_t j = 1; j < tree.joint_ids().size(); ++j) {
      const JointId id = tree.joint_ids()[j];
      EXPECT_LE((tree.joint_wrench(id).force - rows.joint_wrench(id).force).norm(), 1e-6);
      EXPECT_LE((tree.joint_wrench(id).torque - rows.joint_wrench(id).torque).norm(), 1e-6);
    }
  }
}

// In free space the root hangs on nothing: the other bodies move it.
TEST(TreeOfBodies, KeepsMomentaInFreeSpace) {
  WorldOptions chosen = weightless(0.01);
  chosen.method = Method::kRungeKutta;
  chosen.tolerance = 1e-10;
  World world(chosen);
  Random random;
  std::vector<BodyId> ids;
  for (int i = 0; i < 6; ++i) {
    Body body =
        make_body("body_" + std::to_string(i), Box{{0.5, 0.3, 0.2}}, 1.0 + i, Vector3d::Zero());
    body.no_collision = true;
    body.state = random.state();
    if (i == 0) {
      ids.push_back(world.add_body(body));
      continue;
    }
    Joint joint = random_joint(i % 2 == 0 ? JointKind::kHinge : JointKind::kUniversal, &random);
    joint.name = "joint_" + std::to_string(i);
    joint.body_a = ids[static_cast<std::size_t>((i - 1) / 2)];
    body.state = attached(joint, world.state(joint.body_a), &random);
    ids.push_back(world.add_body(body));
    joint.body_b = ids.back();
    world.add_joint(joint);
  }
  world.step();
  const Vector3d p = momentum(world), L = angular_momentum(world);
  const double energy = world.energy();
  for (int i = 0; i < 200; ++i) ASSERT_FALSE(world.step().outcome.failed);
  EXPECT_LE((momentum(world) - p).norm(), 1e-11 * p.norm());
  EXPECT_LE((angular_momentum(world) - L).norm(), 1e-8 * L.norm());  // the tolerance
  EXPECT_NEAR(world.energy(), energy, 1e-8 * energy);
}

// Two hinges on one axis and a third body on a slack rope: as many joints as a tree of three
// bodies, but no tree.
TEST(TreeOfBodies, IsNotWhatHasAsManyJoints) {
  WorldOptions chosen = weightless(0.01);
  chosen.method = Method::kAuto;
  chosen.tolerance = 1e-10;
  World world(chosen);
  std::vector<BodyId> ids;
  for (int i = 0; i < 3; ++i) {
    Body body = make_body("body_" + std::to_string(i), Box{{0.5, 0.3, 0.2}}, 1.0,
                          Vector3d(0.8 * i, 0.0, 0.0));
    body.no_collision = true;
    body.state.angular_velocity = {0.3, -0.2, 0.1 * i};
    ids.push_back(world.add_body(body));
  }
  for (const double z : {-0.2, 0.2}) {
    Joint hinge;
    hinge.name = "hinge_" + std::to_string(z);
    hinge.kind = JointKind::kHinge;
    hinge.body_a = ids[0];
    hinge.body_b = ids[1];
    hinge.anchor_a = {0.4, 0.0, z};
    hinge.anchor_b = {-0.4, 0.0, z};
    world.add_joint(hinge);
  }
  world.add_joint(
      make_joint("slack", ids[1], Vector3d(0.1, 0.0, 0.0), ids[2], Vector3d::Zero(), rope(5.0)));
  world.step();
  const Vector3d p = momentum(world), L = angular_momentum(world);
  const double energy = world.energy();
  for (int i = 0; i < 100; ++i) ASSERT_FALSE(world.step().outcome.failed);
  EXPECT_EQ(world.report().joints.dependent_rows, 5u);
  EXPECT_LE(world.report().joints.max_error, 1e-13);
  EXPECT_LE((momentum(world) - p).norm(), 1e-12);
  EXPECT_LE((angular_momentum(world) - L).norm(), 1e-9);  // the tolerance
  EXPECT_NEAR(world.energy(), energy, 1e-9);
}

}  // namespace
}  // namespace constraint_sim::engine
