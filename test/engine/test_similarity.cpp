// Similarity: a scene of shapes 0.2 mm or 10 km large under the gravity of the scene of 1 m moves
// alike, with times longer by the root of the lengths, only where tolerances of contacts follow
// the size of the shapes. Oracle: the closed form, or the scene of 1 m.

#include "constraint_sim/engine/plan.h"
#include "engine/collision/contact_tolerances.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr std::array<double, 4> kLengths{2e-4, 1e-2, 1e2, 1e4};
constexpr double kG = 9.81;

/// A scene of 1 m, and its copy with another length.
struct Similar {
  explicit Similar(double length) : L(length), T(std::sqrt(length)) {}

  Body box(const std::string& name, const Vector3d& size, const Vector3d& at) const {
    return make_body(name, Box{L * size}, L * L * L, L * at);
  }
  Body ball(const std::string& name, double radius, const Vector3d& at) const {
    return make_body(name, Sphere{L * radius}, L * L * L, L * at);
  }
  static Body floor() { return of(make_floor(0.0), 0.4, 0.3); }
  static Body of(Body body, double friction, double restitution) {
    body.friction = friction;
    body.restitution = restitution;
    return body;
  }
  Body moving(Body body, const Vector3d& v, const Vector3d& w) const {
    body.state.linear_velocity = T * v;
    body.state.angular_velocity = w / T;
    return body;
  }
  /// World with the given method, and ticks of `h` at 1 m. The tolerance is a speed.
  World world(double h, Method method = Method::kAuto) const {
    WorldOptions chosen = options(T * h);
    chosen.method = method;
    chosen.tolerance *= T;
    chosen.sleep_after = kInfinity;
    return World(chosen);
  }

  double L, T;
};

/// Largest difference of positions, as shares of the length, and of orientations.
double difference(const World& a, double L_a, const World& b, double L_b) {
  double most = 0.0;
  for (const BodyId id : a.body_ids()) {
    const BodyState &l = a.state(id), &r = b.state(id);
    most = std::max(most, (l.position / L_a - r.position / L_b).norm());
    most = std::max(most, l.orientation.angularDistance(r.orientation));
  }
  return most;
}

/// Makes the scene at each length by `make(similar)`, runs it for `duration` at 1 m, and expects
/// it within `tolerance` of the scene of 1 m.
template <class Make>
void expect_similar(Make make, double duration, double tolerance, const std::string& what) {
  for (const double h : {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0}) {
    const int ticks = static_cast<int>(std::lround(duration / h));
    World one = make(Similar(1.0), h);
    run(one, ticks);
    for (const double length : kLengths) {
      SCOPED_TRACE(what + " of " + std::to_string(length) + " m at 1/" + std::to_string(1.0 / h) +
                   " s");
      World other = make(Similar(length), h);
      run(other, ticks);
      EXPECT_LE(difference(one, 1.0, other, length), tolerance);
      EXPECT_TRUE(faults_of(other).empty());
    }
  }
}

TEST(Similarity, TolerancesKeepTheirValuesNearOneMetre) {
  for (const double size : {kSmallShape, 0.3, 1.0, kLargeShape}) {
    const ContactTolerances here(size);
    EXPECT_EQ(here.touching, ContactTolerances{}.touching);
    EXPECT_EQ(here.resting, ContactTolerances{}.resting);
  }
  EXPECT_DOUBLE_EQ(ContactTolerances(1e-4).overlap, 1e-9);
  EXPECT_DOUBLE_EQ(ContactTolerances(1e-4).end_of_slip, 1e-8);
  EXPECT_DOUBLE_EQ(ContactTolerances(1e3).touching, 1e-8);
  // Rounding at a distance, not size, bounds the tolerances of a small shape far from the origin
  EXPECT_DOUBLE_EQ(size_of_contact(Sphere{1e-4}, Plane{}, 1e3), 1.0);
}

// x = v²/(2 μ g) to the stop. The end of a slip is located to end_of_slip: (1e-7 m/s)²/(2 μ g) is
// below rounding, and 1e-12 leaves room for rounding of the scaled numbers.
TEST(Similarity, BoxesSlideToAStop) {
  const auto make = [](const Similar& of, double h) {
    World world = of.world(h);
    world.add_body(of.floor());
    world.add_body(
        of.of(of.moving(of.box("box", {1, 1, 0.5}, {0, 0, 0.25}), {2, 0, 0}, {0, 0, 0}), 0.4, 0.0));
    return world;
  };
  expect_similar(make, 2.0, 1e-12, "a sliding box");
  for (const double length : kLengths) {
    const Similar of(length);
    World world = make(of, 1.0 / 60.0);
    run(world, 120);
    const double x = world.state(world.body_ids()[1]).position.x() / length;
    EXPECT_NEAR(x, 4.0 / (2.0 * 0.4 * kG), 1e-10) << length;
  }
}

// A ball above a floor, with the motion and restitution given.
World ball_above_floor(const Similar& of, double h, double height, const Vector3d& v,
                       const Vector3d& w, double restitution) {
  World world = of.world(h);
  world.add_body(of.floor());
  world.add_body(of.of(of.moving(of.ball("ball", 0.5, {0, 0, height}), v, w), 0.4, restitution));
  return world;
}

// Bounces of a ball and rolling after sliding; the closed form of rolling is 5/7 v.
TEST(Similarity, BallsRollAndBounce) {
  const auto roll = [](const Similar& of, double h) {
    return ball_above_floor(of, h, 0.5, {2, 0.5, 0}, {0, 0, 0}, 0.0);
  };
  expect_similar(roll, 2.0, 1e-12, "a rolling ball");
  for (const double length : kLengths) {
    const Similar of(length);
    World world = roll(of, 1.0 / 60.0);
    run(world, 120);
    EXPECT_NEAR(world.state(world.body_ids()[1]).linear_velocity.x() / of.T, 10.0 / 7.0, 1e-9)
        << length;
  }
  const auto bounce = [](const Similar& of, double h) {
    return ball_above_floor(of, h, 1.5, {0.3, 0.1, 0}, {1, 2, 3}, 0.7);
  };
  expect_similar(bounce, 2.0, 1e-10, "a bouncing ball");
}

// Many events: the error at an event, some 1e-7 of the speeds, grows by each later bounce.
TEST(Similarity, BoxesTumbleAndPushEachOther) {
  const auto tumble = [](const Similar& of, double h) {
    World world = of.world(h);
    world.add_body(of.floor());
    Body box = of.of(of.moving(of.box("box", {1, 0.8, 0.6}, {0, 0, 0.9}), {2, 0.5, 0}, {1, 3, 0.5}),
                     0.4, 0.3);
    box.state.orientation = Quaterniond(0.9, 0.2, 0.1, 0.05).normalized();
    world.add_body(box);
    return world;
  };
  expect_similar(tumble, 2.0, 1e-6, "a tumbling box");
  const auto push = [](const Similar& of, double h) {
    World world = of.world(h);
    world.add_body(of.floor());
    for (const auto& [name, x, v] : {std::tuple("a", 0.0, 3.0), std::tuple("b", 0.9, 0.0)})
      world.add_body(
          of.of(of.moving(of.box(name, {0.5, 0.5, 0.5}, {x, 0.05 * x, 0.25}), {v, 0, 0}, {0, 0, 0}),
                0.3, 0.0));
    return world;
  };
  // Corners that hit share the impulse by rounding: a box of 10 mm, with the tolerances of 1 m,
  // ends 1.1e-4 aside.
  expect_similar(push, 2.0, 5e-4, "a pushed box");
}

// A plate that turns on a hinge, with a box that slips off: joints beside contacts, whose rows
// between axes are not met to a share of the size. No impact, so that only rounding grows: 3e-14.
TEST(Similarity, BoxesSlipOffHingedPlates) {
  const auto make = [](const Similar& of, double h) {
    World world = of.world(h);
    const BodyId plate =
        world.add_body(of.of(of.box("plate", {2, 1, 0.1}, {1, 0, -0.05}), 0.5, 0.0));
    world.add_body(of.of(of.box("box", {0.4, 0.4, 0.3}, {1.2, 0, 0.15}), 0.5, 0.0));
    Joint hinge = make_joint("hinge", kWorldBody, of.L * Vector3d(0, 0, -0.05), plate,
                             of.L * Vector3d(-1, 0, 0), JointKind::kHinge);
    hinge.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
    world.add_joint(hinge);
    return world;
  };
  expect_similar(make, 1.0, 1e-12, "a box on a hinged plate");
}

}  // namespace
}  // namespace constraint_sim::engine
