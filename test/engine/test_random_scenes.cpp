// shards: 2
// Random scenes, by all methods and in several variants: no error is unreported. The criteria, and
// the reference in long double, are in bench/scene_judge.h. constraint_sim_random_scenes does so
// with any number of scenes.

#include <gtest/gtest.h>

#include <vector>

#include "problems.h"
#include "sanitized.h"
#include "scene_judge.h"

namespace constraint_sim::engine::random_scenes {
namespace {

const std::uint64_t kScenes = 60 / kSeedShare;
constexpr std::uint64_t kScenesATest = kSanitizedShare > 1 ? 1 : 6;

class RandomScenes : public testing::TestWithParam<std::uint64_t> {};

TEST_P(RandomScenes, AreNeverSilentlyWrong) {
  for (std::uint64_t seed = GetParam(); seed < GetParam() + kScenesATest; ++seed) {
    const Verdict verdict = judge_seed(seed);
    for (const Finding& finding : verdict.findings)
      if (finding.is_silent()) ADD_FAILURE() << line_of(verdict, finding);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, RandomScenes,
                         testing::Range(std::uint64_t{1}, kScenes + 1, kScenesATest));

const std::vector<std::uint64_t> kOffOnce = {374, 505};

// Seeds of redundant rods between points beside rotating bodies: rounding of their self-stress must
// not count as an imbalance, which makes rows momentary.
TEST(SpareRods, BetweenPointsKeepTheMotion) {
  for (const std::uint64_t seed : kOffOnce) {
    const Verdict verdict = judge_seed(seed);
    for (const Finding& finding : verdict.findings) ADD_FAILURE() << line_of(verdict, finding);
  }
}

// Seed of a scene with all joints doubled, whose kept rows become dependent at a pose: they must be
// chosen again a finite number of times.
TEST(SpareRods, AreChosenAgainAFiniteNumberOfTimes) {
  const Verdict verdict = judge_seed(87, "variants");
  for (const Finding& finding : verdict.findings) ADD_FAILURE() << line_of(verdict, finding);
}

// Seed where rows return in a rejected substep: velocities must be scaled to the energy before that
// substep.
TEST(SpareRods, ComeBackWithTheEnergyThereWas) {
  const Verdict verdict = judge_seed(207, "runge_kutta_5");
  for (const Finding& finding : verdict.findings) ADD_FAILURE() << line_of(verdict, finding);
}

// ---- the judge itself

/// A pendulum of 1 m from the horizontal, as a scene.
Scene pendulum() {
  Scene scene;
  Body body;
  body.name = "bob";
  body.mass = 1.0;
  body.state.position = {1.0, 0.0, 0.0};
  scene.bodies.push_back(body);
  Joint joint;
  joint.name = "rod";
  joint.body_b = BodyId{1};
  DistanceJoint rod;
  rod.length = 1.0;
  joint.distance = rod;
  scene.joints.push_back(joint);
  return scene;
}

// θ̈ = −g cos θ by extrapolation in one angle. Bound 1e-11 m: the tolerance of a step is 1e-12.
TEST(Reference, FollowsAPendulum) {
  const Mechanics mechanics(pendulum());
  const Motion motion = reference_motion(mechanics);
  ASSERT_EQ(motion.samples.size(), 10u);
  const Eigen::Vector3d exact = problems::chain_reference(1, 1.0).front();
  const reference::Vector3 x = motion.samples.back()[0].x + mechanics.origin();
  EXPECT_LE((x.cast<double>() - exact).norm(), 1e-11);
}

// The box of OSRF's benchmark, whose orientation after 10 s is known exactly; here half of that
// time forwards and backwards, since motion without forces is reversible: 1e-9 rad for tolerances
// of 1e-12.
TEST(Reference, TurnsABoxForthAndBack) {
  Scene scene;
  Body box;
  box.name = "box";
  box.shape = Box{{0.1, 0.4, 0.9}};
  box.mass = 10.0;
  box.state.angular_velocity = {0.1, 5.0, 0.1};
  scene.bodies.push_back(box);
  const Mechanics mechanics(scene);
  reference::Integrator there(mechanics, 1e-12, 100000);
  there.advance_to(1.0);
  ASSERT_TRUE(there.is_valid());
  Scene back = scene;
  back.bodies[0].state.orientation = there.poses()[0].q.cast<double>();
  back.bodies[0].state.angular_velocity = -there.poses()[0].w.cast<double>();
  const Mechanics again(back);
  reference::Integrator here(again, 1e-12, 100000);
  here.advance_to(1.0);
  const auto angle = 2.0 * here.poses()[0].q.vec().norm();
  EXPECT_LE(static_cast<double>(angle), 1e-9);
}

// The judge finds a world that differs from the scene, in each class of findings that it can show.
TEST(Judge, FindsWhatIsOff) {
  const Setting setting = {"auto", Method::kAuto, 8};
  EXPECT_EQ(Judge(pendulum()).judge(setting).what, "");
  const auto judge_other = [&](const std::function<void(World*)>& change) {
    World world = make_world(pendulum());
    change(&world);
    return Judge(pendulum()).judge(setting, &world).what;
  };
  EXPECT_EQ(judge_other([](World* world) { world->set_broken(world->find_joint("rod"), true); }),
            "joints");
  EXPECT_EQ(judge_other([](World* world) {
              WorldOptions options = world->options();
              options.gravity.z() = -9.80;
              world->set_options(options);
            }),
            "energy falls");
  EXPECT_EQ(judge_other([](World* world) {
              BodyState state = world->state(world->find_body("bob"));
              state.linear_velocity.y() = 1e-5;
              world->set_state(world->find_body("bob"), state);
            }),
            "state");
}

}  // namespace
}  // namespace constraint_sim::engine::random_scenes
