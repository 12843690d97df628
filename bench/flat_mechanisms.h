#pragma once

// Larger mechanisms of hinges in a plane: Andrews' squeezer and rows of parallelograms.

#include "mechanisms.h"

namespace constraint_sim::engine::mechanisms {

// ---- Andrews' squeezer: names and numbers of Hairer & Wanner II, section VII.7

struct Squeezer {
  static constexpr Real xa = -0.06934L, ya = -0.00227L, xb = -0.03635L, yb = 0.03273L;
  static constexpr Real xc = 0.014L, yc = 0.072L, c0 = 4530, l0 = 0.07785L, drive = 0.033L;
  static constexpr Real rr = 0.007L, ra = 0.00092L, d = 0.028L, da = 0.0115L;
  static constexpr Real ss = 0.035L, sa = 0.01874L, sb = 0.01043L, sc = 0.018L, sd = 0.02L;
  static constexpr Real e = 0.02L, ea = 0.01421L, zt = 0.04L, ta = 0.02308L, tb = 0.00916L;
  static constexpr Real zf = 0.02L, fa = 0.01421L, u = 0.04L, ua = 0.01228L, ub = 0.00449L;
  static constexpr double kStart = -0.0617138900142764496358948458001;  ///< β [rad]

  /// Joints between the bars at the crank's angle β.
  struct Pins {
    Point crank, P, K, L;
  };
  static Pins pins(const Jet& beta) {
    const Angle crank = minimal::angle(beta);
    const Point O{Jet(rr) * crank.c, Jet(rr) * crank.s}, A{xa, ya}, B{xb, yb};
    const Point P = minimal::meet(O, d, B, ss, 1);
    return {O, P, minimal::meet(A, zt, P, e, 1), minimal::meet(A, u, P, zf, -1)};
  }
  /// Returns the pose of a bar whose x axis points from `from` to `to`; its centre is `point` plus
  /// `along` and `left` in that frame.
  static Pose body(const Point& point, const Point& from, const Point& to, Real along, Real left) {
    const Angle turn = minimal::direction(to.x - from.x, to.y - from.y);
    Pose pose;
    pose.x = {point.x + turn.c * Jet(along) - turn.s * Jet(left),
              point.y + turn.s * Jet(along) + turn.c * Jet(left), Jet(0)};
    pose.R = minimal::rotation(Vector3d::UnitZ(), turn);
    return pose;
  }
  static Poses poses(const Jet& beta) {
    const Pins at = pins(beta);
    const Point O{0, 0}, A{xa, ya}, B{xb, yb};
    return {body(O, O, at.crank, ra, 0), body(at.crank, at.crank, at.P, da, 0),
            body(B, B, at.P, sa, sb),    body(at.K, at.K, at.P, e - ea, 0),
            body(A, A, at.K, ta, tb),    body(at.L, at.L, at.P, zf - fa, 0),
            body(A, A, at.L, ua, -ub)};
  }
  /// Point of the third body where the spring acts, in the frame from B to P.
  static constexpr Real hook_along = sc, hook_left = sd;
  static Jet spring_energy(const Jet& beta) {
    const Pose hook = body({xb, yb}, {xb, yb}, pins(beta).P, hook_along, hook_left);
    const Jet dx = hook.x[0] - Jet(xc), dy = hook.x[1] - Jet(yc);
    const Jet stretch = sqrt(dx * dx + dy * dy) - Jet(l0);
    return Jet(c0 / 2) * stretch * stretch;
  }
};

inline Vector3d point_of(const Point& p) {
  return {static_cast<double>(p.x.v), static_cast<double>(p.y.v), 0.0};
}

inline void add_squeezer_forces(World* world) {
  const auto of = [](Real value) { return static_cast<double>(value); };
  Wrench drive;
  drive.body = world->find_body("crank");
  drive.torque = {0.0, 0.0, of(Squeezer::drive)};
  world->add_wrench(drive);
  Joint spring;
  spring.name = "spring";
  spring.anchor_a = {of(Squeezer::xc), of(Squeezer::yc), 0.0};
  spring.body_b = world->find_body("triangle");
  spring.anchor_b = {of(Squeezer::hook_along - Squeezer::sa),
                     of(Squeezer::hook_left - Squeezer::sb), 0.0};
  spring.distance.length = of(Squeezer::l0);
  spring.distance.stiffness = of(Squeezer::c0);
  world->add_joint(spring);
}

/// Andrews' squeezer: seven bodies on ten hinges, driven by a torque, from rest. The crank turns
/// 2.5 times in 0.03 s.
inline Mechanism squeezer(int steps = 384) {
  Mechanism made;
  made.name = "Andrews' squeezer";
  made.duration = 0.03;
  made.gravity.setZero();
  made.is_judged_by_angles = true;
  const std::pair<double, double> masses[] = {
      {0.04325, 2.194e-6}, {0.00365, 4.410e-7}, {0.02373, 5.255e-6}, {0.00706, 5.667e-7},
      {0.07050, 1.169e-5}, {0.00706, 5.667e-7}, {0.05498, 1.912e-5}};
  const char* const names[] = {"crank", "rod",       "triangle", "upper_rod",
                               "upper", "lower_rod", "lower"};
  for (std::size_t i = 0; i < 7; ++i) {
    Body body = bar(names[i], masses[i].first, {0.01, 0.01, 0.01});
    body.inertia.setConstant(
        masses[i].second);  // the motion is planar: only the third moment counts
    made.bodies.push_back(body);
  }
  place(&made, Squeezer::poses, Squeezer::kStart, 0.0);
  made.reference->potential = Squeezer::spring_energy;
  made.reference->force = Squeezer::drive;
  const Squeezer::Pins pins = Squeezer::pins(Real{Squeezer::kStart});
  const Vector3d A = point_of({Squeezer::xa, Squeezer::ya});
  const Vector3d B = point_of({Squeezer::xb, Squeezer::yb});
  const Vector3d P = point_of(pins.P), K = point_of(pins.K), L = point_of(pins.L);
  const auto add = [&](int a, int b, const Vector3d& at) {
    made.joints.push_back({JointKind::kHinge, a, b, at, Vector3d::UnitZ(), {}});
  };
  add(kGround, 0, Vector3d::Zero());
  add(0, 1, point_of(pins.crank));
  add(1, 2, P);
  add(2, 3, P);
  add(2, 5, P);
  add(kGround, 2, B);
  add(3, 4, K);
  add(kGround, 4, A);
  add(5, 6, L);
  add(kGround, 6, A);
  made.add_forces = add_squeezer_forces;
  made.dependent_rows = 9;
  finish(&made, steps);
  made.steps = {2e-4, 1e-4, 5e-5};
  made.expected_errors = {8.4e-10, 1.7e-12, 3e-13};
  return made;
}

// ---- rows of parallelograms, passing singular poses

/// IFToMM's A02: N + 1 upright slender bars of 1 kg and 1 m, hinged to the ground 1 m apart, and N
/// bars between their tops. It starts upright with the tops at 1 m/s. All bars are in line twice a
/// turn. θ̈ = −g cos θ ((N + 1)/2 + N)/((N + 1)/3 + N).
inline Mechanism parallelograms(int windows, double duration) {
  Mechanism made;
  made.name = "parallelograms, N = " + std::to_string(windows);
  made.duration = duration;
  const auto add_bar = [&](const std::string& name, const BodyState& state) {
    Body body = bar(name, 1.0, {1.0, 0.05, 0.05});
    body.inertia = {1.0 / 1200.0, 1.0 / 12.0, 1.0 / 12.0};
    body.state = state;
    made.bodies.push_back(body);
  };
  const auto upright = [](int k, const Jet& theta) {
    const Angle angle = minimal::angle(theta);
    return minimal::planar(Jet(k) + Jet(0.5L) * angle.c, Jet(0.5L) * angle.s, angle);
  };
  const auto level = [](int k, const Jet& theta) {
    const Angle angle = minimal::angle(theta);
    return minimal::planar(Jet(k) + Jet(0.5L) + angle.c, angle.s, {});
  };
  const Jet start(minimal::kPi / 2, 1, 0);
  for (int k = 0; k <= windows; ++k)
    add_bar("upright_" + std::to_string(k), minimal::state(upright(k, start), -1.0));
  for (int k = 0; k < windows; ++k)
    add_bar("level_" + std::to_string(k), minimal::state(level(k, start), -1.0));
  for (int k = 0; k <= windows; ++k) {
    made.joints.push_back(hinge(kGround, k, {static_cast<double>(k), 0.0, 0.0}));
    const Vector3d top(static_cast<double>(k), 0.0, 1.0);
    if (k > 0) made.joints.push_back(hinge(k, windows + k, top));
    if (k < windows) made.joints.push_back(hinge(k, windows + 1 + k, top));
  }
  const auto n = static_cast<Real>(windows);
  const Real factor = ((n + 1) / 2 + n) / ((n + 1) / 3 + n);
  const Reals y = minimal::integrate(
      [&](const Reals& q) {
        return Reals{q[1], -factor * static_cast<Real>(problems::kGravity) * std::cos(q[0])};
      },
      {minimal::kPi / 2, -1}, static_cast<Real>(duration),
      static_cast<int>(std::ceil(96.0 * duration)));
  for (int k = 0; k <= windows; ++k) made.end.push_back(upright(k, y[0]));
  for (int k = 0; k < windows; ++k) made.end.push_back(level(k, y[0]));
  made.dependent_rows = static_cast<std::uint32_t>(3 * windows);
  return made;
}

}  // namespace constraint_sim::engine::mechanisms
