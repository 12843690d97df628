// Rotation without torque in steps of impulses. Oracles: energy and angular momentum, which a step
// conserves where its equation is solved, and the order of the error.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "draw.h"
#include "engine/impulses/free_turn.h"

namespace constraint_sim::engine {
namespace {

constexpr double kStep = 0.01;  // [s]

/// A body with random moments, `size` at most [kg m²], and a spin that turns it by `angle` [rad] in
/// a step where its least moment is as large as the others, by less otherwise.
struct Spinning {
  MassProperties mass;
  BodyState state;

  Spinning(double size, double decades, double angle, Draw* draw) {
    mass.inverse_mass = 1.0;
    for (int i = 0; i < 3; ++i)
      mass.inertia[i] = size * std::pow(10.0, draw->between(-decades, 0.0));
    mass.inverse_inertia = mass.inertia.cwiseInverse();
    state.orientation = draw->turn();
    const double slowest = mass.inertia.minCoeff() / mass.inertia.maxCoeff();
    state.angular_velocity = angle * slowest / kStep * draw->vector().normalized();
  }
  Eigen::Vector3d momentum() const {
    return apply_inertia(mass.inertia, state.orientation, state.angular_velocity);
  }
  double twice_energy() const { return state.angular_velocity.dot(momentum()); }
  void turn(double duration, int steps) {
    for (int i = 0; i < steps; ++i) advance_orientation(mass, duration / steps, &state);
  }
};

// Moments over six decades, with ratios up to 1000, and turns from 1e-8 rad on. Some ten roundings
// of 1e-16 add up in a step, and the squares of moments amplify them where ratios are large.
TEST(FreeTurn, ConservesEnergyAndMomentum) {
  Draw draw(7);
  for (int k = 0; k < 20000; ++k) {
    const double size = std::pow(10.0, draw.between(-3.0, 3.0));
    Spinning body(size, 3.0, 0.3 * std::pow(10.0, draw.between(-8.0, 0.0)), &draw);
    const Eigen::Vector3d L = body.momentum();
    const double energy = body.twice_energy();
    body.turn(kStep, 1);
    EXPECT_LT((body.momentum() - L).norm(), 1e-12 * L.norm()) << k;
    EXPECT_NEAR(body.twice_energy(), energy, 1e-12 * energy) << k;
  }
}

// Half the step has a quarter of the error: the order is two.
TEST(FreeTurn, IsOfSecondOrder) {
  Draw draw(8);
  double whole = 0.0, half = 0.0;
  for (int k = 0; k < 200; ++k) {
    const Spinning start(1.0, 0.5, 0.3, &draw);
    const auto after = [&](int steps) {
      Spinning body = start;
      body.turn(10.0 * kStep, steps);
      return body.state.orientation.coeffs();
    };
    const Eigen::Vector4d exact = after(1280);
    whole += (after(10) - exact).norm();
    half += (after(20) - exact).norm();
  }
  std::printf("mean errors %.2e and %.2e\n", whole / 200.0, half / 200.0);
  EXPECT_NEAR(whole / half, 4.0, 0.2);
}

}  // namespace
}  // namespace constraint_sim::engine
