// Ropes, stops, motors with a force limit, friction and breaking, without contacts.

#include "events.h"
#include "rotation_between.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

const Real kG = kGravity;

// ---- ropes

Problem slack_rope() {
  const PlanarChain chain = chain_of(1);
  Problem made = with_chain(event("slack_rope", 5.0), chain, 0.05);
  made.is_conservative = true;
  made.joints.push_back(rope_to(0, {0.0, 0.5, 0.0}, 2.0));
  return made;
}

/// A mass falls from 0.3 m below the world's origin until its rope of 1 m is taut.
Problem rope_taut(const std::string& name, double restitution, double duration) {
  Problem made = event(name, duration);
  made.bodies = {point_mass({0.0, 0.0, -0.3}, 2.0)};
  made.joints = {rope_to(0, Vector3d::Zero(), 1.0)};
  made.joints[0].restitution = restitution;
  return along_line(made, Vector3d::UnitZ(), [=](Real t) {
    OnLine now = bouncing_from(0.7L, restitution, kG, t);
    now.x -= 0.7L;
    return now;
  });
}

/// A mass falls beside its anchor until its rope is taut; it keeps the velocity across the rope.
Problem rope_swing() {
  Problem made = event("rope_swing", 3.0);
  made.bodies = {point_mass({0.6, 0.0, 0.0}, 2.0)};
  made.joints = {rope_to(0, Vector3d::Zero(), 1.0)};
  Phase fall = flight(made);
  fall.until = [](const Reals& y) { return 1 - y[0] * y[0] - y[2] * y[2]; };
  fall.next = [](const Reals& y, Reals* start) {
    const Real x = y[0], z = y[2], r = std::hypot(x, z);
    *start = {std::atan2(z, x), (x * y[5] - z * y[3]) / (r * r)};
    return swing(chain_of(1, 0.0, 2.0));
  };
  return in_phases(made, fall, {0.6L, 0, 0, 0, 0, 0}, 0.02);
}

/// A load of 1e4 kg on a rope and a bob of 1 kg on a rod below fall until the rope is taut. The
/// rope stays taut: the bob's weight is negligible.
Problem heavy_rope() {
  Problem made = event("heavy_rope", 2.0);
  made.bodies = {point_mass({0.0, 0.0, -0.8}, 1e4), point_mass({0.6, 0.0, -0.8}, 1.0)};
  made.joints = {rope_to(0, Vector3d::Zero(), 1.0), rod(0, 1)};
  Phase fall = flight(made);
  fall.until = [](const Reals& y) { return 1 + y[2]; };
  fall.next = [](const Reals& y, Reals* start) {
    PlanarChain chain = chain_of(2);
    chain.masses = {1e4, 1.0};
    chain.lengths = {1.0, 0.6};
    const Real down = -std::acos(Real{-1}) / 2;
    *start = {down, 0, 0, y[11] / static_cast<Real>(0.6)};
    return swing(chain);
  };
  return in_phases(made, fall,
                   {0, 0, -static_cast<Real>(0.8), static_cast<Real>(0.6), 0,
                    -static_cast<Real>(0.8), 0, 0, 0, 0, 0, 0},
                   0.01);
}

/// A winch lifts a load, with its largest force until it reaches its speed.
Problem winch() {
  constexpr double kMass = 2.0, kSpeed = 0.5;
  Problem made = event("winch", 1.0);
  made.bodies = {point_mass({0.0, 0.0, -2.0}, kMass)};
  made.joints = {rope_to(0, Vector3d::Zero(), 2.0)};
  made.joints[0].rate = -kSpeed;
  made.joints[0].max_force = 1.4 * kMass * kGravity;
  return along_line(made, Vector3d::UnitZ(), [=](Real t) {
    const Real a = 0.4L * kG, there = kSpeed / a;
    return moved(moved({}, a, std::min(t, there)), 0, std::max(Real{0}, t - there));
  });
}

// ---- stops

/// A slider falls half a metre onto its stop.
Problem stop(const std::string& name, double restitution, double duration) {
  Problem made = event(name, duration);
  made.is_conservative = restitution == 1.0;
  made.bodies = {box(3.0, {0.2, 0.3, 0.4})};
  made.joints = {slider_to(made, 0, Vector3d::UnitZ())};
  made.joints[0].lower = -0.5;
  made.joints[0].restitution = restitution;
  return along_line(made, Vector3d::UnitZ(), [=](Real t) {
    OnLine now = restitution == 1.0 ? OnLine{} : bouncing_from(0.5L, restitution, kG, t);
    if (restitution == 1.0) {
      const Real fall = std::sqrt(1 / kG), phase = std::remainder(t, 2 * fall);
      now = {0.5L - kG * phase * phase / 2, -kG * phase};
    }
    now.x -= 0.5L;
    return now;
  });
}

/// A bar of 2 kg on a hinge at its end; y: angle downwards, and its rate.
Phase bar(Real arm, Real inertia, Real stop, Real restitution) {
  Phase phase;
  phase.rates = [=](const Reals& y) {
    return Reals{y[1], 2 * kG * arm * std::cos(y[0]) / inertia};
  };
  phase.states = [=](const Reals& y) {
    const double c = static_cast<double>(arm * std::cos(y[0]));
    const double s = static_cast<double>(arm * std::sin(y[0])), w = static_cast<double>(y[1]);
    State state;
    state.position = {c, 0.0, -s};
    state.orientation = Eigen::AngleAxisd(static_cast<double>(y[0]), Vector3d::UnitY());
    state.velocity = {-s * w, 0.0, -c * w};
    state.angular_velocity = {0.0, w, 0.0};
    return States{state};
  };
  phase.until = [=](const Reals& y) { return stop - y[0]; };
  phase.next = [=](const Reals& y, Reals* start) {
    *start = {y[0], -restitution * y[1]};
    return bar(arm, inertia, stop, restitution);
  };
  return phase;
}

/// The bar swings down from level to a stop, and rebounds.
Problem hinge_limit() {
  Problem made = event("hinge_limit", 2.0);
  made.bodies = {box(2.0, {1.0, 0.1, 0.2})};
  made.bodies[0].start.position.x() = 0.5;
  Joint hinge;
  hinge.kind = JointKind::kHinge;
  hinge.anchor_b = {-0.5, 0.0, 0.0};
  hinge.frame_a = hinge.frame_b = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
  hinge.upper = 1.2;  // rotation about y is down
  hinge.restitution = 0.6;
  made.joints = {hinge};
  const Real inertia = static_cast<Real>(made.bodies[0].inertia.y()) + 0.5L;
  return in_phases(made, bar(0.5L, inertia, hinge.upper, hinge.restitution), {0, 0}, 0.02);
}

// ---- motors with a force limit

Problem motor(const std::string& name, double mass, double gravity, double force, double rate,
              double speed, const std::function<OnLine(Real)>& motion) {
  Problem made = event(name, 1.0);
  made.gravity = {0.0, 0.0, -gravity};
  made.bodies = {box(mass, {0.2, 0.3, 0.4})};
  made.bodies[0].start.velocity.z() = speed;
  made.joints = {slider_to(made, 0, Vector3d::UnitZ())};
  made.joints[0].rate = rate;
  made.joints[0].max_force = force;
  return along_line(made, Vector3d::UnitZ(), motion);
}

/// Returns a motion whose acceleration changes once, at time `change`.
std::function<OnLine(Real)> in_two(OnLine start, Real before, Real change, Real after) {
  return [=](Real t) {
    return moved(moved(start, before, std::min(t, change)), after, std::max(Real{0}, t - change));
  };
}

Problem motor_speeds_up() {
  return motor("motor_speeds_up", 2.0, 0.0, 5.0, 1.3, 0.0, in_two({}, 2.5L, 1.3L / 2.5L, 0));
}

Problem motor_lifts() {
  const Real a = 0.3L * kG;
  return motor("motor_lifts", 2.0, kGravity, 1.3 * 2.0 * kGravity, 0.7, 0.0,
               in_two({}, a, 0.7L / a, 0));
}

/// The motor brakes a load that rises too fast, and cannot hold it then.
Problem motor_overloaded() {
  const Real brakes = -1.6L * kG;
  return motor("motor_overloaded", 2.0, kGravity, 0.6 * 2.0 * kGravity, 0.7, 2.5,
               in_two({0, 2.5L}, brakes, (0.7L - 2.5L) / brakes, -0.4L * kG));
}

// ---- friction along a coordinate

Problem on_slider(const std::string& name, double duration, double mass, double speed,
                  const Vector3d& gravity) {
  Problem made = event(name, duration);
  made.gravity = gravity;
  made.bodies = {box(mass, {0.2, 0.3, 0.4})};
  made.bodies[0].start.velocity.x() = speed;
  made.joints = {slider_to(made, 0, Vector3d::UnitX())};
  return made;
}

Problem friction_stops() {
  Problem made = on_slider("friction_stops", 1.2, 2.0, 1.1, Vector3d::Zero());
  made.joints[0].friction = 3.0;
  return along_line(made, Vector3d::UnitX(), [](Real t) {
    return moved({0, static_cast<Real>(1.1)}, -1.5L, std::min(t, static_cast<Real>(1.1) / 1.5L));
  });
}

/// A mass moves up a slope of 30° and down again, with friction of 30 % of its weight along the
/// slope.
Problem friction_slope() {
  const double down = kGravity * std::sin(kPi / 6.0);
  Problem made =
      on_slider("friction_slope", 1.5, 2.0, -2.0, {down, 0.0, -kGravity * std::cos(kPi / 6.0)});
  made.joints[0].friction = 0.3 * 2.0 * down;
  const Real g = static_cast<Real>(down), turns = 2 / (1.3L * g);
  return along_line(made, Vector3d::UnitX(), in_two({0, -2}, 1.3L * g, turns, 0.7L * g));
}

Joint spring_to(double stiffness) {
  Joint spring;
  spring.kind = JointKind::kSpring;
  spring.anchor_a = {-1.0, 0.0, 0.0};
  spring.length = 1.0;
  spring.stiffness = stiffness;
  return spring;
}

/// An oscillator with dry friction: it swings about ±f/k alternately, until it sticks.
Problem dry_oscillator() {
  constexpr double kMass = 1.0, kFriction = 1.5, kStiffness = 20.0, kStart = 0.5;
  Problem made = on_slider("dry_oscillator", 3.0, kMass, 0.0, Vector3d::Zero());
  made.bodies[0].start.position.x() = kStart;
  made.joints = {slider_to(made, 0, Vector3d::UnitX()), spring_to(kStiffness)};
  made.joints[0].friction = kFriction;
  return along_line(made, Vector3d::UnitX(), [](Real t) {
    const Real omega = std::sqrt(static_cast<Real>(kStiffness / kMass));
    const Real shift = static_cast<Real>(kFriction) / kStiffness;
    const Real half = std::acos(Real{-1}) / omega;
    Real x = kStart;
    for (; t > half && std::abs(x) > shift; t -= half) x = (x > 0 ? 2 : -2) * shift - x;
    if (std::abs(x) <= shift) return OnLine{x - kStart, 0};
    const Real about = x > 0 ? shift : -shift;
    return OnLine{about + (x - about) * std::cos(omega * t) - kStart,
                  -omega * (x - about) * std::sin(omega * t)};
  });
}

/// A mass on a moving belt. Friction f accelerates it to the belt's speed, until the spring pulls
/// with f; then it slips back.
Problem stick_slip() {
  constexpr double kMass = 1.5, kFriction = 2.0, kStiffness = 30.0, kBelt = 0.25;
  Problem made = on_slider("stick_slip", 1.6, kMass, 0.0, Vector3d::Zero());
  made.joints.push_back(spring_to(kStiffness));
  made.joints[0].rate = kBelt;
  made.joints[0].max_force = kFriction;
  return along_line(made, Vector3d::UnitX(), [](Real t) {
    const Real omega = std::sqrt(static_cast<Real>(kStiffness / kMass));
    const Real y = static_cast<Real>(kFriction) / kStiffness;  // deflection at sliding
    const Real sticks = std::asin(kBelt / (y * omega)) / omega;
    const Real slips = sticks + y * std::cos(omega * sticks) / kBelt;
    if (t < sticks) return OnLine{y * (1 - std::cos(omega * t)), y * omega * std::sin(omega * t)};
    if (t < slips) return OnLine{y - kBelt * (slips - t), kBelt};
    const Real since = omega * (t - slips);
    return OnLine{y + kBelt / omega * std::sin(since), kBelt * std::cos(since)};
  });
}

// ---- breaking

/// A bob released at the height of its pivot; the tension of its rod is 3 m g sin φ, φ from level.
Problem rod_breaks() {
  Problem made = event("rod_breaks", 1.0);
  add_chain(chain_of(1), &made);
  made.is_conservative = true;
  const Real force = 0.6L * 3 * kG;
  made.joints[0].break_force = static_cast<double>(force);
  Phase swinging = swing(chain_of(1));
  swinging.until = [=](const Reals& y) { return force - (y[1] * y[1] - kG * std::sin(y[0])); };
  swinging.next = [made](const Reals& y, Reals* start) {
    const Real c = std::cos(y[0]), s = std::sin(y[0]);
    *start = {c, 0, s, -s * y[1], 0, c * y[1]};
    return flight(made);
  };
  return in_phases(made, swinging, {0, 0}, 0.02);
}

std::vector<Problem> make() {
  return {slack_rope(),
          rope_taut("rope_taut", 0.0, 1.0),
          rope_taut("rope_bounces", 0.5, 2.0),
          rope_swing(),
          heavy_rope(),
          winch(),
          stop("stop_inelastic", 0.0, 1.0),
          stop("stop_elastic", 1.0, 5.0),
          stop("stop_until_rest", 0.9, 6.5),
          hinge_limit(),
          motor_speeds_up(),
          motor_lifts(),
          motor_overloaded(),
          friction_stops(),
          friction_slope(),
          dry_oscillator(),
          stick_slip(),
          rod_breaks()};
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
