// Slips that are slow beside the effect of friction within a substep: a body begins to slip with
// slightly more force than friction holds. Oracles: closed forms.

#include "by_events.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

class SlowSlipsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, SlowSlipsAt, testing::ValuesIn(each_setting(Method::kEventDriven)));

// A force (1 + ε) μ m g pushes a box that stands on its corners: ε μ g t²/2. Stages that follow the
// direction of the slip would need 1/ε of them; the bound is that of a handful of events.
TEST_P(SlowSlipsAt, ABoxIsPushedBeyondFriction) {
  constexpr double kMass = 2.0;
  for (const double mu : {0.1, 0.3, 0.49}) {
    for (const double over : {1e-1, 1e-2, 1e-3, 1e-4}) {
      World world(by_events(GetParam()));
      world.add_body(with_surface(make_floor(0.0), mu, 0.0));
      const BodyId box = world.add_body(
          with_surface(make_body("box", Box{{0.4, 0.3, 0.8}}, kMass, {0.0, 0.0, 0.4}), mu, 0.0));
      Wrench push;
      push.body = box;
      push.force.x() = (1.0 + over) * mu * kMass * kGravity;
      world.add_wrench(push);
      unsigned rejected = 0;
      while (world.time() < 0.3 - 1e-9) {
        rejected += world.step().costs.rejected;
        ASSERT_FALSE(is_by_impulses(world)) << mu << ' ' << over << ' ' << world.time();
      }
      const double t = world.time();
      const Vector3d place(0.5 * over * mu * kGravity * t * t, 0.0, 0.4);
      EXPECT_LT((world.state(box).position - place).norm(), 1e-14) << mu << ' ' << over;
      EXPECT_LE(rejected, 20u) << mu << ' ' << over;
    }
  }
}

// A spring whose end moves at a constant rate u pulls a box: it sticks until the spring has μ m g,
// then is at u (t − sin(ωt)/ω), and at rest again after 2π/ω.
TEST_P(SlowSlipsAt, ASpringPullsABoxUntilItSlips) {
  constexpr double kMass = 2.0, kMu = 0.2, kRate = 0.25;
  for (const double stiffness : {10.0, 40.0, 400.0}) {
    World world(by_events(GetParam()));
    world.add_body(with_surface(make_floor(0.0), kMu, 0.0));
    const BodyId box = world.add_body(
        with_surface(make_body("box", Box{{0.6, 0.5, 0.2}}, kMass, {0.0, 0.0, 0.1}), kMu, 0.0));
    Body puller = make_body("puller", Sphere{0.05}, 1.0, {1.0, 0.0, 0.1});
    puller.state.linear_velocity.x() = kRate;
    const BodyId end = world.add_body(puller);
    Joint rail =
        make_joint("rail", kWorldBody, {1.0, 0.0, 0.1}, end, Vector3d::Zero(), JointKind::kSlider);
    rail.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
    rail.coordinates[0].motor.emplace();
    rail.coordinates[0].motor->bias = kRate;
    world.add_joint(rail);
    world.add_joint(make_joint("spring", box, Vector3d::Zero(), end, Vector3d::Zero(),
                               spring(1.0, stiffness, 0.0)));
    const double slips = kMu * kMass * kGravity / (stiffness * kRate);
    const double omega = std::sqrt(stiffness / kMass);
    while (world.time() < slips + 1.9 * kPi / omega) {
      const StepReport& report = world.step();
      ASSERT_FALSE(is_by_impulses(world)) << stiffness << ' ' << world.time();
      EXPECT_LE(report.costs.substeps + report.costs.rejected, 60u)
          << stiffness << ' ' << world.time();
      const double t = std::max(world.time() - slips, 0.0);
      const Vector3d place(kRate * (t - std::sin(omega * t) / omega), 0.0, 0.1);
      // a tick of 1/30 s is half a radian of the stiffest spring
      ASSERT_LT((world.state(box).position - place).norm(), 1e-10) << stiffness << ' ' << t;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
