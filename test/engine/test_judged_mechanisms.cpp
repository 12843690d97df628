// Random mechanisms of joints of all kinds against a reference in long double, by all methods and
// in several guises (bench/random_mechanisms.h), and that reference against minimal coordinates.
// constraint_sim_random_mechanisms does the same with any number of mechanisms.

#include <gtest/gtest.h>

#include "mechanisms.h"
#include "random_mechanisms.h"
#include "sanitized.h"

namespace constraint_sim::engine::random_scenes {
namespace {

constexpr std::uint64_t kMechanisms = kSanitizedShare > 1 ? 3 : 48;
constexpr std::uint64_t kMechanismsATest = kSanitizedShare > 1 ? 1 : 6;

class JudgedMechanisms : public testing::TestWithParam<std::uint64_t> {};

TEST_P(JudgedMechanisms, AreNeverSilentlyWrong) {
  for (std::uint64_t seed = GetParam(); seed < GetParam() + kMechanismsATest; ++seed) {
    const Verdict verdict = judge_mechanism(seed);
    EXPECT_TRUE(verdict.has_motion) << seed;
    for (const Finding& finding : verdict.findings) ADD_FAILURE() << line_of(verdict, finding);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, JudgedMechanisms,
                         testing::Range(std::uint64_t{1}, kMechanisms + 1, kMechanismsATest));

Scene scene_of(const World& world) {
  Scene scene;
  scene.options = world.options();
  for (const BodyId id : world.body_ids()) {
    scene.bodies.push_back(world.body(id));
    scene.bodies.back().state = world.state(id);
  }
  for (const JointId id : world.joint_ids()) scene.joints.push_back(world.joint(id));
  return scene;
}

// Dense rows in long double, with others projected away, and one or two coordinates have nothing in
// common. 1e-9 m: some hundred steps of a tolerance of 1e-12, which these motions amplify tenfold.
TEST(MechanicsReference, MovesAsMinimalCoordinatesDo) {
  for (const mechanisms::Mechanism& mechanism :
       {mechanisms::double_hinge_pendulum(), mechanisms::slider_crank(),
        mechanisms::universal_shaft(), mechanisms::bricard()}) {
    World world = mechanism.world({});
    const Mechanics mechanics(scene_of(world));
    reference::Integrator integrator(mechanics, 1e-12, 200000);
    integrator.advance_to(mechanism.duration);
    ASSERT_TRUE(integrator.is_valid()) << mechanism.name;
    EXPECT_LE(mechanics.worst_joint(integrator.poses(), mechanism.duration).first, 1e-15)
        << mechanism.name;
    for (std::size_t i = 0; i < mechanism.bodies.size(); ++i) {
      const Pose& pose = integrator.poses()[i];
      BodyState state;
      state.position = (pose.x + mechanics.origin()).cast<double>();
      state.orientation = pose.q.cast<double>();
      world.set_state(world.find_body(mechanism.bodies[i].name), state);
    }
    EXPECT_LE(mechanism.error(world), 1e-9) << mechanism.name;
  }
}

// A joint off by little more than its bound is found out; in scenes it may be off by 1e-6 m.
TEST(JudgeOfMechanisms, HoldsJointsToRounding) {
  const Setting setting = {"runge_kutta", Method::kRungeKutta, 8};
  const Scene scene = MechanismGenerator(2).make();
  World world = make_world(scene);
  EXPECT_EQ(Judge(scene, true).judge(setting, &world).what, "");
  for (const bool is_strict : {true, false}) {
    Scene off = scene;
    off.joints.front().anchor_b.x() += 1e-8;  // which the engine keeps, and the scene has not
    off.joints.front().baumgarte = 0.0;
    World other = make_world(off);
    const std::string found = Judge(scene, is_strict).judge(setting, &other).what;
    EXPECT_EQ(found, is_strict ? "joints" : "");
  }
}

}  // namespace
}  // namespace constraint_sim::engine::random_scenes
