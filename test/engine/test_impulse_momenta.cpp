// Momenta of bodies that collide in free space by sequential impulses: corrections of positions
// displace bodies, and may change neither momentum. Oracle: conservation.

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Pairs of bodies, of which cylinders touch by impulses only, that fly towards each other.
World colliding_bodies(unsigned seed, double time_step) {
  Draw random(seed);
  WorldOptions chosen;
  chosen.time_step = time_step;
  chosen.gravity.setZero();
  World world(chosen);
  const auto shape = [&]() -> Shape {
    const double kind = random();
    if (kind < 0.3) return Cylinder{0.15 + 0.05 * random(), 0.45 + 0.15 * random()};
    if (kind < 0.6) return Box{{0.35, 0.3 + 0.1 * random(), 0.3}};
    return Sphere{0.18 + 0.07 * random()};
  };
  for (const double side : {-1.0, 1.0}) {
    for (int i = 0; i < 2; ++i) {
      const Vector3d at(side * (0.8 + 0.05 * random()), 0.7 * (i - 0.5), 0.05 * random());
      Body body = make_body((side < 0.0 ? "a" : "b") + std::to_string(i), shape(),
                            1.7 + 1.2 * random(), at);
      body.state.orientation = random.turn();
      body.state.linear_velocity = {-side * (1.0 + 0.5 * random()), 0.0, 0.0};
      body.state.angular_velocity = random.vector();
      body.friction = 0.3;
      world.add_body(body);
    }
  }
  return world;
}

// Rounding of some hundred steps is 1e-14 of momenta of some 10; corrections that displaced bodies
// without regard to their velocities turned them by up to 3e-3 kg m²/s.
TEST(ImpulseMomenta, AreKeptWhereContactsPushBodiesApart) {
  int by_impulses = 0;
  for (const double h : {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0}) {
    for (unsigned seed = 0; seed < (kSanitizedShare > 1 ? 5 : 60); ++seed) {
      SCOPED_TRACE("seed " + std::to_string(seed) + " at " + std::to_string(h) + " s");
      World world = colliding_bodies(seed, h);
      const Vector3d p = momentum(world), L = angular_momentum(world);
      double lost = 0.0, turned = 0.0;
      bool is_by_impulses = false;
      for (double t = 0.0; t < 2.0; t += h) {
        const StepReport& report = world.step();
        ASSERT_FALSE(report.outcome.failed);
        is_by_impulses |= report.costs.islands[index_of(Method::kTimeStepping)] > 0;
        lost = std::max(lost, (momentum(world) - p).norm());
        turned = std::max(turned, (angular_momentum(world) - L).norm());
      }
      EXPECT_LE(lost, 1e-12);
      EXPECT_LE(turned, 1e-9);
      by_impulses += is_by_impulses ? 1 : 0;
    }
  }
  EXPECT_GT(by_impulses, 20);
}

}  // namespace
}  // namespace constraint_sim::engine
