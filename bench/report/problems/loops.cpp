// Mechanisms with closed loops. All bars of the windows are in line twice a turn.

#include "common.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

Vector3d unit(long double angle) {
  return {static_cast<double>(std::cos(angle)), 0.0, static_cast<double>(std::sin(angle))};
}
Vector3d normal(long double angle) {
  return {static_cast<double>(-std::sin(angle)), 0.0, static_cast<double>(std::cos(angle))};
}

/// N + 1 unit point masses on upright rods of 1 m, joined in a row, all moving at 1 m/s along x.
/// With `is_loaded` the last mass is 3 kg and 5 N along x push the first, so that rods between
/// carry a force where they are dependent. θ̈ = −g cos θ − (F/M) sin θ.
Problem four_bar(const std::string& name, int windows, bool is_loaded) {
  Problem made = problem(name, "smooth", 10.0, windows);
  const int count = windows + 1;
  for (int k = 0; k < count; ++k) {
    made.bodies.push_back(point_mass({static_cast<double>(k), 0.0, 1.0},
                                     is_loaded && k == windows ? 3.0 : 1.0, Vector3d::UnitX()));
    made.joints.push_back(rod(kWorld, k, {static_cast<double>(k), 0.0, 0.0}));
    if (k > 0) made.joints.push_back(rod(k - 1, k));
  }
  if (is_loaded) made.bodies.front().force = {5.0, 0.0, 0.0};
  const double mass = count + (is_loaded ? 2.0 : 0.0);
  made.reference = one_angle(made, -kGravity, is_loaded ? -5.0 / mass : 0.0, kPi / 2.0, -1.0,
                             1.0 / 32.0, [=](long double angle, long double rate) {
                               States states(static_cast<std::size_t>(count));
                               for (int k = 0; k < count; ++k) {
                                 State& state = states[static_cast<std::size_t>(k)];
                                 state.position = unit(angle) + Vector3d(k, 0.0, 0.0);
                                 state.velocity = static_cast<double>(rate) * normal(angle);
                               }
                               return states;
                             });
  made.source = "one angle in long double, by extrapolation";
  return made;
}

/// IFToMM's A02: the four-bar with slender bars of 1 kg on ball joints. Bars stay in the plane, so
/// ball joints act as hinges, and the inertia about a bar's own axis does not matter.
Problem bars_four_bar(const std::string& name, int windows, double duration) {
  Problem made = problem(name, "smooth", duration, windows);
  const Vector3d inertia(1.0 / 12.0, 1.0 / 12.0, 1.0 / 12.0);
  const auto states = [windows](long double angle, long double rate) {
    States all;
    for (int k = 0; k <= windows; ++k) {
      State state;
      state.position = 0.5 * unit(angle) + Vector3d(k, 0.0, 0.0);
      state.velocity = 0.5 * static_cast<double>(rate) * normal(angle);
      const double turn = static_cast<double>(static_cast<long double>(kPi) / 2.0L - angle);
      state.orientation = Eigen::AngleAxisd(turn, Vector3d::UnitY());
      state.angular_velocity = {0.0, static_cast<double>(-rate), 0.0};
      all.push_back(state);
    }
    for (int k = 0; k < windows; ++k) {
      State state;
      state.position = unit(angle) + Vector3d(k + 0.5, 0.0, 0.0);
      state.velocity = static_cast<double>(rate) * normal(angle);
      all.push_back(state);
    }
    return all;
  };
  for (const State& start : states(static_cast<long double>(kPi) / 2.0L, -1.0L)) {
    Body body;
    body.inertia = inertia;
    body.start = start;
    made.bodies.push_back(body);
  }
  const Vector3d top(0.0, 0.0, 0.5), left(-0.5, 0.0, 0.0);
  for (int k = 0; k <= windows; ++k)
    made.joints.push_back(ball_joint(kWorld, k, {static_cast<double>(k), 0.0, 0.0}, -top));
  for (int k = 0; k < windows; ++k) {
    const int bar = windows + 1 + k;
    made.joints.push_back(ball_joint(k, bar, top, left));
    made.joints.push_back(ball_joint(bar, k + 1, -left, top));
  }
  const double n = windows;
  const double factor = ((n + 1.0) / 2.0 + n) / ((n + 1.0) / 3.0 + n);
  made.reference = one_angle(made, -kGravity * factor, 0.0, kPi / 2.0, -1.0, 1.0 / 32.0, states);
  made.source = "one angle in long double, by extrapolation; end as published";
  return made;
}

/// A freely rotating ring of twelve masses on twelve rods.
Problem ring() {
  constexpr int kCount = 12;
  Problem made = problem("ring_12", "smooth", 5.0);
  made.gravity = Vector3d::Zero();
  const auto states = [](long double t) {
    States all(kCount);
    for (int k = 0; k < kCount; ++k) {
      const long double angle =
          2.0L * t + 2.0L * 3.14159265358979323846264L * static_cast<long double>(k) / kCount;
      all[static_cast<std::size_t>(k)].position = unit(angle);
      all[static_cast<std::size_t>(k)].velocity = 2.0 * normal(angle);
    }
    return all;
  };
  const States start = states(0.0L);
  for (int k = 0; k < kCount; ++k) {
    const State& state = start[static_cast<std::size_t>(k)];
    made.bodies.push_back(point_mass(state.position, 1.0, state.velocity));
    made.joints.push_back(rod(k, (k + 1) % kCount));
  }
  made.reference = closed_form(made, states);
  made.source = "closed form";
  return made;
}

/// A net: masses 1 m apart in a horizontal square, joined along rows and columns, two corners held.
Problem net(const std::string& name, int side) {
  Problem made = problem(name, "smooth", 1.0, side);
  made.is_planar = false;
  for (int i = 0; i < side; ++i)
    for (int j = 0; j < side; ++j) {
      const int here = static_cast<int>(made.bodies.size());
      made.bodies.push_back(point_mass({static_cast<double>(i), static_cast<double>(j), 0.0}));
      if (i > 0) made.joints.push_back(rod(here - side, here));
      if (j > 0) made.joints.push_back(rod(here - 1, here));
    }
  const double edge = side - 1.0;
  made.joints.push_back(rod(kWorld, 0, {-1.0, -1.0, 0.0}));
  made.joints.push_back(rod(kWorld, side - 1, {-1.0, edge + 1.0, 0.0}));
  return made;
}

std::vector<Problem> make() {
  return {four_bar("four_bar_1", 1, false),
          four_bar("four_bar_10", 10, false),
          four_bar("four_bar_1_loaded", 1, true),
          four_bar("four_bar_10_loaded", 10, true),
          bars_four_bar("n_four_bar_2", 2, 10.0),
          bars_four_bar("n_four_bar_40", 40, 20.0),
          ring(),
          net("net_8", 8),
          net("net_32", 32)};
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
