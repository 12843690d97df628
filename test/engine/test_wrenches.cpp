// Forces and torques on bodies: impulse is force times time, at any tick.

#include "constraint_sim/engine/scene.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kBoxMass = 2.5;

/// A weightless box in a general orientation.
struct Floating {
  World world;
  BodyId box;

  explicit Floating(double time_step, const Vector3d& spin = Vector3d::Zero())
      : world(weightless(time_step)) {
    Body body = make_body("box", Box{{0.4, 0.3, 0.5}}, kBoxMass, {1.0, 2.0, 3.0});
    body.state.orientation = Random().orientation();
    body.state.angular_velocity = spin;
    box = world.add_body(body);
  }

  Vector3d velocity() const { return world.state(box).linear_velocity; }
  /// Returns the angular momentum about the centre of mass [kg m²/s].
  Vector3d spin() const {
    const BodyState& state = world.state(box);
    return angular_momentum(world) - kBoxMass * state.position.cross(state.linear_velocity);
  }
};

Wrench force(BodyId body, const Vector3d& force, double start = 0.0, double end = kInfinity) {
  return {body, force, Vector3d::Zero(), start, end};
}

Wrench torque(BodyId body, const Vector3d& torque, double start = 0.0, double end = kInfinity) {
  return {body, Vector3d::Zero(), torque, start, end};
}

// ---- oracles: m Δv = F T, ΔL = τ T

struct Span {
  double time_step, start, duration;
};

class WrenchSpan : public testing::TestWithParam<Span> {};

// Bound: the sum of up to a thousand impulses, each rounded once, and each end of the interval to
// half an ulp of a time below 2 s.
TEST_P(WrenchSpan, GivesForceTimesDuration) {
  const auto [time_step, start, duration] = GetParam();
  const Vector3d F(3.0, -4.0, 5.0);
  Floating floating(time_step);
  floating.world.add_wrench(force(floating.box, F, start, start + duration));
  while (floating.world.time() < start + duration) floating.world.step();
  EXPECT_LT((kBoxMass * floating.velocity() - duration * F).norm(),
            (1000 * kEpsilon * duration + 2 * kEpsilon) * F.norm());
  EXPECT_TRUE(floating.world.wrenches().empty());
  const Vector3d after = floating.velocity();
  run(floating.world, 10);
  EXPECT_EQ(floating.velocity(), after);
}

TEST_P(WrenchSpan, GivesTorqueTimesDuration) {
  const auto [time_step, start, duration] = GetParam();
  for (int axis = 0; axis < 3; ++axis) {
    for (const Vector3d& spin : {Vector3d(Vector3d::Zero()), Vector3d(0.3, -0.2, 0.5)}) {
      Floating floating(time_step, spin);
      const Vector3d before = floating.spin();
      const Vector3d tau = 0.05 * Vector3d::Unit(axis);
      floating.world.add_wrench(torque(floating.box, tau, start, start + duration));
      while (floating.world.time() < start + duration) floating.world.step();
      // L is converted to ω and back at every step: about ten roundings of |L| < 0.1
      EXPECT_LT((floating.spin() - before - duration * tau).norm(), 1e4 * kEpsilon * 0.1) << axis;
      EXPECT_TRUE(floating.velocity().isZero(0.0));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Spans, WrenchSpan,
    testing::Values(Span{0.01, 0.0, 0.25},       // whole ticks
                    Span{0.01, 0.0, 0.123456},   // ends within a tick
                    Span{0.01, 0.0789, 0.5},     // starts and ends within ticks
                    Span{0.01, 0.034, 0.002},    // within a single tick
                    Span{0.01, 0.0396, 0.0009},  // across the border of two ticks
                    Span{0.001, 0.0333333, 0.777777}, Span{0.3, 0.1, 0.7}, Span{2.0, 0.5, 0.25}),
    [](const auto& info) { return "Span" + std::to_string(info.index); });

TEST(Wrenches, OfAForceForEverCarriesExactly) {
  Floating hovering(0.01);
  WorldOptions heavy = hovering.world.options();
  heavy.gravity = {0.0, 0.0, -8.0};  // 2.5 · 8 is exact, and so is the difference
  hovering.world.set_options(heavy);
  hovering.world.set_time(1e6, 0);  // at 1e6 s the tick differs from the difference of two times
  hovering.world.add_wrench(force(hovering.box, {0.0, 0.0, 8.0 * kBoxMass}));
  for (int step = 1; step <= 1000; ++step) {
    hovering.world.step();
    // takes h g and gives (h/m) F, which differ by at most two roundings
    ASSERT_LT(hovering.velocity().norm(), step * 2 * kEpsilon * 0.08);
  }
  EXPECT_EQ(hovering.world.wrenches().size(), 1u);
}

TEST(Wrenches, AddUp) {
  Floating both(0.01);
  both.world.add_wrench(force(both.box, {1.0, 0.0, 0.0}, 0.0, 0.5));
  both.world.add_wrench(force(both.box, {0.0, 2.0, 0.0}, 0.25, 1.0));
  both.world.add_wrench({both.box, {1.0, 0.0, 0.0}, {0.0, 0.0, 0.1}, 0.5, 1.0});
  run(both.world, 100);
  // 1 N for 1 s, 2 N for 0.75 s, 0.1 N m for 0.5 s; a hundred roundings
  EXPECT_LT((kBoxMass * both.velocity() - Vector3d(1.0, 1.5, 0.0)).norm(), 1e-13);
  EXPECT_LT((both.spin() - Vector3d(0.0, 0.0, 0.05)).norm(), 1e-13);
}

TEST(Wrenches, OfOppositeForcesCancel) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 2.0, 3.0}));
  floating.world.add_wrench(force(floating.box, {-1.0, -2.0, -3.0}));
  run(floating.world, 100);
  EXPECT_EQ(floating.velocity(), Vector3d(0.0, 0.0, 0.0));
}

TEST(Wrenches, ActOnTheirBodyAlone) {
  Floating floating(0.01);
  const BodyId other = floating.world.add_body(make_body("other", Sphere{0.1}, 1.0, {9, 9, 9}));
  floating.world.add_wrench(force(other, {1.0, 0.0, 0.0}));
  run(floating.world, 10);
  EXPECT_TRUE(floating.velocity().isZero(0.0));
  EXPECT_GT(floating.world.state(other).linear_velocity.x(), 0.0);
}

// Oracle: friction μ of a floor holds against less than μ m g.
TEST(Wrenches, MeetWhatHoldsTheBody) {
  const auto slides = [](double share) {
    World world(options(0.01));
    world.add_body(make_floor(0.5));
    Body body = make_body("box", Box{{1.0, 1.0, 0.2}}, kBoxMass, {0.0, 0.0, 0.1});
    body.friction = 0.5;
    const BodyId id = world.add_body(body);
    run(world, 50);
    world.add_wrench(force(id, {share * 0.5 * kBoxMass * kGravity, 0.0, 0.0}));
    run(world, 100);
    return world.state(id).linear_velocity.x();
  };
  EXPECT_LT(std::abs(slides(0.9)), 1e-3);
  EXPECT_NEAR(slides(1.5), 0.5 * 0.5 * kGravity, 0.05);  // (1.5 − 1) μ g for 1 s; 2 % for sweeps
}

// ---- their interval

TEST(Wrenches, WaitForTheirStart) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.205));
  run(floating.world, 20);
  EXPECT_TRUE(floating.velocity().isZero(0.0));
  EXPECT_EQ(floating.world.wrenches().size(), 1u);
  floating.world.step();
  EXPECT_NEAR(kBoxMass * floating.velocity().x(), 0.005,
              1e-15);  // half a tick; times are rounded at 0.2
}

TEST(Wrenches, ActNotBeforeTheyAreAdded) {
  Floating floating(0.01);
  run(floating.world, 100);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.0, 1.5));
  run(floating.world, 100);
  EXPECT_NEAR(kBoxMass * floating.velocity().x(), 0.5, 1e-14);
}

TEST(Wrenches, ThatAreOverAreNone) {
  Floating floating(0.01);
  run(floating.world, 100);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.0, floating.world.time()));
  EXPECT_TRUE(floating.world.wrenches().empty());
}

TEST(Wrenches, MoveAlongWhenTheTimeIsSet) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.5, 0.75));
  run(floating.world, 25);
  floating.world.set_time(100.0, 0);
  run(floating.world, 24);
  EXPECT_TRUE(floating.velocity().isZero(0.0));
  run(floating.world, 30);
  EXPECT_NEAR(kBoxMass * floating.velocity().x(), 0.25, 1e-13);  // times are rounded at 100
}

TEST(Wrenches, MoveAlongWhenTheTimeIsSetBack) {
  Floating floating(0.01);
  run(floating.world, 100);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 1.1, 1.35));
  floating.world.set_time(0.0, 0);
  ASSERT_EQ(floating.world.wrenches().size(), 1u);
  run(floating.world, 40);
  EXPECT_NEAR(kBoxMass * floating.velocity().x(), 0.25, 1e-14);  // times are rounded at 1
}

TEST(Wrenches, TooShortForTheTimeThatIsSetAreDropped) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.0, 1e-18));
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.5, 0.5 + 1e-15));
  floating.world.set_time(100.0, 0);
  EXPECT_TRUE(floating.world.wrenches().empty());
}

// A scene or snapshot could not be loaded with them.
TEST(Wrenches, AreNotMovedBeyondTheBounds) {
  Floating floating(1e6);  // shorter ticks are lost beside such times
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 1e7, 2e7));
  EXPECT_NE(refusal([&] {
              floating.world.set_time(1e20, 0);
            }).find("moves a wrench on 'box' beyond 1e20 s, got 1e+20"),
            std::string::npos);
  EXPECT_EQ(floating.world.time(), 0.0);
  EXPECT_EQ(floating.world.wrenches().front().start, 1e7);
  floating.world.set_time(9e19, 0);
  EXPECT_EQ(save_scene(load_scene(save_scene(floating.world))), save_scene(floating.world));
}

TEST(Wrenches, KeepTheirSpanWhenTheTickChanges) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.1, 0.6));
  run(floating.world, 33);
  floating.world.set_options(weightless(0.007));
  run(floating.world, 50);
  EXPECT_NEAR(kBoxMass * floating.velocity().x(), 0.5, 1e-14);
}

// ---- edits

TEST(Wrenches, AreCleared) {
  Floating floating(0.01);
  const BodyId other = floating.world.add_body(make_body("other", Sphere{0.1}, 1.0, {9, 9, 9}));
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}));
  floating.world.add_wrench(force(other, {2.0, 0.0, 0.0}));
  floating.world.add_wrench(force(floating.box, {3.0, 0.0, 0.0}, 5.0));
  floating.world.clear_wrenches(floating.box);
  ASSERT_EQ(floating.world.wrenches().size(), 1u);
  EXPECT_EQ(floating.world.wrenches()[0].body, other);
  run(floating.world, 10);
  EXPECT_TRUE(floating.velocity().isZero(0.0));
}

TEST(Wrenches, GoWithTheirBody) {
  Floating floating(0.01);
  const BodyId first = floating.world.add_body(make_body("first", Sphere{0.1}, 1.0, {9, 9, 9}));
  const BodyId second = floating.world.add_body(make_body("second", Sphere{0.1}, 1.0, {-9, 9, 9}));
  floating.world.add_wrench(force(first, {1.0, 0.0, 0.0}));
  floating.world.add_wrench(force(second, {1.0, 0.0, 0.0}));
  floating.world.remove_body(first);
  ASSERT_EQ(floating.world.wrenches().size(), 1u);
  run(floating.world, 10);
  EXPECT_NEAR(floating.world.state(second).linear_velocity.x(), 0.1, 1e-15);
}

TEST(Wrenches, GoOnInACopy) {
  Floating original(0.01);
  original.world.add_wrench({original.box, {1.0, 2.0, 3.0}, {0.1, 0.2, 0.3}, 0.05, 0.123});
  run(original.world, 10);
  World copy = original.world;
  copy.clear_wrenches(original.box);
  EXPECT_EQ(original.world.wrenches().size(), 1u);
  copy = original.world;
  run(original.world, 10);
  run(copy, 10);
  EXPECT_EQ(copy.state_hash(), original.world.state_hash());
}

TEST(Wrenches, FindTheirBodyInAWorldThatTakesOver) {
  Floating old(0.01);
  old.world.add_wrench(force(old.box, {5.0, 0.0, 0.0}));
  run(old.world, 77);
  Floating next(0.01);
  next.world.add_wrench(force(next.box, {1.0, 0.0, 0.0}, 0.1, 0.3));
  next.world.continue_from(old.world);
  ASSERT_EQ(next.world.wrenches().size(), 1u);
  run(next.world, 50);
  EXPECT_NEAR(momentum(next.world).x(), 0.2, 1e-14);
}

TEST(Wrenches, StayWhenAStepFails) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}, 0.0, 0.005));
  floating.world.add_wrench(force(floating.box, {kMostMagnitude, 0.0, 0.0}));
  floating.world.add_wrench(force(floating.box, {kMostMagnitude, 0.0, 0.0}));
  Body light = make_body("light", Sphere{0.1}, 1e-9, {9, 9, 9});
  floating.world.add_wrench(force(floating.world.add_body(light), {kMostMagnitude, 0.0, 0.0}));
  const std::uint64_t before = floating.world.state_hash();
  EXPECT_TRUE(floating.world.step().outcome.failed);
  EXPECT_EQ(floating.world.state_hash(), before);
  EXPECT_EQ(floating.world.wrenches().size(), 4u);
  floating.world.clear_wrenches(floating.world.find_body("light"));
  floating.world.clear_wrenches(floating.box);
  EXPECT_FALSE(floating.world.step().outcome.failed);
}

// ---- their work

TEST(Wrenches, WorkShowsAsDrift) {
  Floating floating(0.01);
  floating.world.add_wrench(force(floating.box, {1.0, 0.0, 0.0}));
  run(floating.world, 10);
  EXPECT_NEAR(floating.world.report().energy.drift, 1.0, 1e-14);  // all energy came from work
}

}  // namespace
}  // namespace constraint_sim::engine
