// The joint kind that scripts/try_extending adds: frames keep their orientation, and anchor B moves
// in A's x-y plane. Rows of all kinds are compared with finite differences in JointRows.

#include "constraint_sim/engine/scene.h"
#include "engine/constraints/joint_kinds.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

TEST(XyTable, IsInTheTables) {
  EXPECT_EQ(joint_kind_named("xy_table"), JointKind::kXyTable);
  EXPECT_EQ(info(JointKind::kXyTable).coordinates, 2);
  EXPECT_FALSE(info(JointKind::kXyTable).is_angle[0] || info(JointKind::kXyTable).is_angle[1]);
  EXPECT_EQ(joint_kinds().back(), JointKind::kXyTable);
}

// A table at a slope α: ½ g sin α t² downhill and v t across, without rotation, although the anchor
// is beside the centre of mass. Coordinates of the joint have the same values.
TEST(XyTable, FallsDownASlopeAsAParabola) {
  for (const Method method : kSmoothMethods) {
    WorldOptions chosen = options(1.0 / 30.0);
    chosen.method = method;
    World world(chosen);
    const double slope = 0.3, speed = 0.7;
    Body table = make_body("table", Box{{0.3, 0.2, 0.1}}, 2.0, {0.4, 0.3, 0.2});
    table.state.linear_velocity = {0.0, speed, 0.0};
    const BodyId id = world.add_body(table);
    Joint joint = make_joint("slides", kWorldBody, {0.4, 0.0, 0.2}, id, {0.0, -0.3, 0.0},
                             JointKind::kXyTable);
    joint.frame_a = Eigen::AngleAxisd(slope, Vector3d::UnitY());
    const JointId held = world.add_joint(joint);
    run(world, 60);
    const double t = world.time(), fall = 0.5 * kGravity * std::sin(slope) * t * t;
    const Vector3d moved(fall * std::cos(slope), speed * t, -fall * std::sin(slope));
    // rounding of 6 m in 60 ticks
    EXPECT_LE((world.state(id).position - table.state.position - moved).norm(), 1e-12)
        << name(method);
    EXPECT_LE(world.state(id).orientation.vec().norm(), 1e-14) << name(method);
    EXPECT_NEAR(world.joint_state(held).coordinates[0].position, fall, 1e-12) << name(method);
    EXPECT_NEAR(world.joint_state(held).coordinates[1].position, speed * t, 1e-12) << name(method);
  }
}

TEST(XyTable, IsReadAndSavedByScenes) {
  const World world = load_scene(
      "bodies: [{name: a, mass: 1, shape: {sphere: {radius: 0.1}}, position: [1, 0, 0]}]\n"
      "constraints: [{name: j, type: xy_table, body_b: a, anchor_a: [1, 0, 0]}]\n");
  const std::string saved = save_scene(world);
  EXPECT_NE(saved.find("xy_table"), std::string::npos) << saved;
  EXPECT_EQ(save_scene(load_scene(saved)), saved);
}

}  // namespace
}  // namespace constraint_sim::engine
