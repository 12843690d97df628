// A body on a joint of every kind: on the world, on a free base, and behind one to five hinges of
// each. Oracle: the dense reference in long double (bench/reference_mechanics.h), which shares no
// code with the engine: positions to 1e-6 m and 100 times the estimate, energy to 1e-6.

#include "random_joints.h"
#include "sanitized.h"
#include "scene_judge.h"

namespace constraint_sim::engine::random_scenes {
namespace {

// Numbers of hinges before the joint. Dense rows of five hinges take half of the time of all.
const std::vector<int> kHinges = kSanitizedShare > 1 ? std::vector<int>{0, 1}
                                 : kIsLongRun        ? std::vector<int>{0, 1, 2, 3, 4, 5}
                                                     : std::vector<int>{0, 1, 3};

/// A chain of hinges with a joint of `kind` at its end. A free base is the first body.
Scene hanging_scene(JointKind kind, int hinges, bool is_free, engine::Random* random) {
  Scene scene;
  scene.options.time_step = 1.0 / 60.0;
  const auto hang = [&](JointKind by) {
    Joint joint = random_joint(by, random);
    joint.anchor_a *= 0.5;
    joint.anchor_b *= 0.5;
    const bool is_first = scene.bodies.empty();
    Body body = make_body("body_" + std::to_string(scene.bodies.size()), Box{{0.5, 0.4, 0.3}},
                          1.0 + 0.5 * (*random)(), Vector3d::Zero());
    body.no_collision = true;
    body.state = attached(joint, is_first ? BodyState{} : scene.bodies.back().state, random);
    joint.name += "_" + std::to_string(scene.joints.size());
    joint.body_a = is_first ? kWorldBody : BodyId{static_cast<std::uint32_t>(scene.bodies.size())};
    scene.bodies.push_back(body);
    joint.body_b = BodyId{static_cast<std::uint32_t>(scene.bodies.size())};
    if (!info(by).has_frames) joint.frame_b.reset();
    if (by == JointKind::kDistance) {
      const BodyState a = is_first ? BodyState{} : scene.bodies[scene.bodies.size() - 2].state;
      joint.distance.length = (body.state.position + body.state.orientation * joint.anchor_b -
                               a.position - a.orientation * joint.anchor_a)
                                  .norm();
    }
    scene.joints.push_back(joint);
  };
  if (is_free) {
    Body base = make_body("base", Box{{0.6, 0.5, 0.4}}, 2.0, Vector3d::Zero());
    base.no_collision = true;
    base.state = random->state();
    scene.bodies.push_back(base);
  }
  for (int i = 0; i < hinges; ++i) hang(JointKind::kHinge);
  hang(kind);
  const Mechanics mechanics(scene);
  std::vector<Pose> poses = mechanics.start_at(0);
  mechanics.project(0, &poses);
  for (std::size_t i = 0; i < scene.bodies.size(); ++i) {
    scene.bodies[i].state.linear_velocity = poses[i].v.cast<double>();
    scene.bodies[i].state.angular_velocity = poses[i].w.cast<double>();
  }
  return scene;
}

class HangingJoints : public testing::TestWithParam<JointKind> {};

TEST_P(HangingJoints, MoveAsDenseRowsDo) {
  engine::Random random;
  for (const bool is_free : {false, true}) {
    for (const int hinges : kHinges) {
      const Judge judge(hanging_scene(GetParam(), hinges, is_free, &random));
      EXPECT_TRUE(judge.has_motion()) << hinges;
      for (const Setting& setting : kSettings) {
        if (setting.method == Method::kSequentialImpulses) continue;  // first order only
        const Finding finding = judge.judge(setting);
        EXPECT_EQ(finding.what, "") << finding.detail << " by " << setting.name << " behind "
                                    << hinges << " hinges" << (is_free ? " on a free base" : "");
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, HangingJoints,
                         testing::Values(JointKind::kDistance, JointKind::kBall, JointKind::kHinge,
                                         JointKind::kSlider, JointKind::kCylindrical,
                                         JointKind::kPlanar, JointKind::kUniversal,
                                         JointKind::kWeld, JointKind::kPointOnLine,
                                         JointKind::kPointOnPlane, JointKind::kParallel,
                                         JointKind::kScrew),
                         [](const auto& kind) { return std::string(name(kind.param)); });

}  // namespace
}  // namespace constraint_sim::engine::random_scenes
