// Contacts of few bodies, alone and together with ropes, stops, motors and friction.

#include "events.h"
#include "rotation_between.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

const Real kG = kGravity;

Body block(double mass, const Vector3d& size, const Vector3d& position, double friction,
           double restitution = 0.0) {
  Body body = box(mass, size);
  body.shape = Shape::kBox;
  body.start.position = position;
  body.friction = friction;
  body.restitution = restitution;
  return body;
}

/// A plane through x with this normal.
Body wall(double x, const Vector3d& normal, double friction, double restitution) {
  Body body = plane(friction, restitution);
  body.start.position.x() = x;
  body.start.orientation = rotation_between(Vector3d::UnitZ(), normal);
  return body;
}

Vector3d leaning(double slope) {
  return kGravity * Vector3d(std::sin(slope), 0.0, -std::cos(slope));
}

// ---- impacts

/// A ball falls half a metre and bounces until it rests.
Problem bounce(const std::string& name, double restitution, double duration) {
  Problem made = event(name, duration);
  made.bodies = {plane(0.0, restitution), ball(2.0, 0.1, {0.0, 0.0, 0.6}, 0.0, restitution)};
  return along_line(made, Vector3d::UnitZ(), [=](Real t) {
    OnLine now = bouncing_from(0.5L, restitution, kG, t);
    now.x -= 0.5L;
    return now;
  });
}

Problem box_drop(const std::string& name, double restitution) {
  Problem made = event(name, 1.5);
  made.bodies = {plane(0.5, restitution),
                 block(2.0, {0.6, 0.5, 0.4}, {0.0, 0.0, 0.65}, 0.5, restitution)};
  return along_line(made, Vector3d::UnitZ(), [=](Real t) {
    OnLine now = bouncing_from(0.45L, restitution, kG, t);
    now.x -= 0.45L;
    return now;
  });
}

/// A bob that rebounds from a wall below its pivot. y: angle from x, and its rate.
Phase before_a_wall(Real restitution) {
  Phase phase = swing(chain_of(1));
  const auto states = phase.states;
  phase.states = [states](const Reals& y) {
    States both{wall(-0.1, Vector3d::UnitX(), 0.0, 0.0).start};
    both.push_back(states(y).front());
    return both;
  };
  phase.until = [](const Reals& y) { return y[0] + std::acos(Real{-1}) / 2; };
  phase.next = [=](const Reals& y, Reals* start) {
    *start = {y[0], -restitution * y[1]};
    return before_a_wall(restitution);
  };
  return phase;
}

Problem rod_against_wall() {
  Problem made = event("rod_against_wall", 3.0);
  made.bodies = {wall(-0.1, Vector3d::UnitX(), 0.0, 0.8),
                 ball(1.0, 0.1, {1.0, 0.0, 0.0}, 0.0, 0.8)};
  made.joints = {rod(kWorld, 1)};
  return in_phases(made, before_a_wall(0.8), {0, 0}, 0.02);
}

/// A ball between a wall, e = 0.5, and the end of its rope, which stops it.
Problem rope_and_wall() {
  Problem made = event("rope_and_wall", 1.0);
  made.gravity.setZero();
  made.bodies = {wall(0.6, -Vector3d::UnitX(), 0.0, 0.5),
                 ball(2.0, 0.1, Vector3d::Zero(), 0.0, 0.5)};
  made.bodies[1].start.velocity.x() = 4.1;
  made.joints = {rope_to(1, {0.2, 0.0, 0.0}, 0.45)};
  return along_line(made, Vector3d::UnitX(), [](Real t) {
    const Real v = 4.1, hit = 0.5L / v, stops = hit + 0.75L / (v / 2);
    if (t < hit) return OnLine{v * t, v};
    return t < stops ? OnLine{0.5L - v / 2 * (t - hit), -v / 2} : OnLine{-0.25L, 0};
  });
}

/// A ball strikes a block on a slider with friction, e = 1.
Problem struck_block() {
  constexpr double kBall = 1.0, kBlock = 3.0, kFriction = 5.0, kSpeed = 4.1;
  Problem made = event("struck_block", 1.5);
  made.gravity.setZero();
  made.bodies = {block(kBlock, {0.4, 0.4, 0.4}, {1.0, 0.0, 0.0}, 0.5, 1.0),
                 ball(kBall, 0.1, Vector3d::Zero(), 0.5, 1.0)};
  made.bodies[1].start.velocity.x() = kSpeed;
  made.joints = {slider_to(made, 0, Vector3d::UnitX())};
  made.joints[0].friction = kFriction;
  const States start{made.bodies[0].start, made.bodies[1].start};
  made.reference = closed_form(made, [=](long double t) {
    const Real v = kSpeed, hit = 0.7L / v, since = std::max(Real{0}, t - hit);
    const Real V = 2 * kBall * v / (kBall + kBlock), a = kFriction / Real{kBlock};
    const OnLine block = moved({0, since > 0 ? V : 0}, -a, std::min(since, V / a));
    const Real back = (kBall - kBlock) / (kBall + kBlock) * v;
    States states = start;
    states[0].position.x() += static_cast<double>(block.x);
    states[0].velocity.x() = since > 0 ? static_cast<double>(block.v) : 0.0;
    states[1].position.x() = static_cast<double>(since > 0 ? 0.7L + back * since : v * t);
    states[1].velocity.x() = static_cast<double>(since > 0 ? back : v);
    return states;
  });
  return made;
}

/// A motor with a force limit drives a ball against a wall, and stays at its limit.
Problem motor_against_wall() {
  Problem made = event("motor_against_wall", 1.0);
  made.gravity.setZero();
  made.bodies = {wall(1.0, -Vector3d::UnitX(), 0.0, 0.0), ball(2.0, 0.1, Vector3d::Zero())};
  made.joints = {slider_to(made, 1, Vector3d::UnitX())};
  made.joints[0].rate = 2.0;
  made.joints[0].max_force = 12.0;
  return along_line(made, Vector3d::UnitX(), [](Real t) {
    const Real there = 1 / Real{3}, hit = there + (0.9L - 1 / Real{3}) / 2;
    if (t > hit) return OnLine{0.9L, 0};
    return moved(moved({}, 6, std::min(t, there)), 0, std::max(Real{0}, t - there));
  });
}

/// A ball bounces until it rests on an arm, which the stop of its hinge holds.
Problem ball_on_arm() {
  constexpr double kRestitution = 0.5;
  Problem made = event("ball_on_arm", 1.5);
  made.bodies = {block(3.0, {1.0, 0.4, 0.2}, {0.5, 0.0, -0.1}, 0.0, kRestitution),
                 ball(2.0, 0.1, {0.7, 0.0, 0.4}, 0.0, kRestitution)};
  Joint hinge;
  hinge.kind = JointKind::kHinge;
  hinge.anchor_a = {0.0, 0.0, -0.1};
  hinge.anchor_b = {-0.5, 0.0, 0.0};
  hinge.frame_a = hinge.frame_b = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
  hinge.upper = 0.0;  // rotation about y lowers the arm
  made.joints = {hinge};
  return along_line(made, Vector3d::UnitZ(), [](Real t) {
    OnLine now = bouncing_from(0.3L, kRestitution, kG, t);
    now.x -= 0.3L;
    return now;
  });
}

// ---- friction

/// A box on four corners slides along (2, 0.5) and stops.
Problem box_stops() {
  constexpr double kMu = 0.3;
  Problem made = event("box_stops", 1.0);
  made.is_planar = false;
  made.bodies = {plane(kMu, 0.0), block(2.0, {0.6, 0.5, 0.4}, {0.0, 0.0, 0.2}, kMu)};
  const Vector3d velocity(2.0, 0.5, 0.0);
  made.bodies[1].start.velocity = velocity;
  return along_line(made, velocity.normalized(), [=](Real t) {
    const Real v = std::sqrt(4.25L), a = static_cast<Real>(kMu) * kG;
    return moved({0, v}, -a, std::min(t, v / a));
  });
}

/// A block slides down a slope of 20°, below its friction angle, and stops.
Problem block_stops() {
  constexpr double kMu = 0.6;
  const double slope = kPi / 9.0;
  Problem made = event("block_stops", 1.0);
  made.gravity = leaning(slope);
  made.bodies = {plane(kMu, 0.0), block(1.0, {1.0, 1.0, 0.5}, {0.0, 0.0, 0.25}, kMu)};
  made.bodies[1].start.velocity.x() = 1.5;
  return along_line(made, Vector3d::UnitX(), [=](Real t) {
    const Real a = kG * (static_cast<Real>(kMu) * std::cos(static_cast<Real>(slope)) -
                         std::sin(static_cast<Real>(slope)));
    return moved({0, 1.5L}, -a, std::min(t, 1.5L / a));
  });
}

/// A ball on a slope of 30°. It rolls with 5/7 g sin α; for friction below 2/7 tan α it slides with
/// g (sin α − μ cos α) and turns with ω̇ = 5/2 μ g cos α / r.
Problem ball_on_slope(const std::string& name, double friction) {
  constexpr double kRadius = 0.2;
  const double slope = kPi / 6.0;
  Problem made = event(name, 1.5, 4.0);
  made.gravity = leaning(slope);
  made.bodies = {plane(friction, 0.0), ball(1.0, kRadius, {0.0, 0.0, kRadius}, friction)};
  made.reference = closed_form(made, [=](long double t) {
    const Real s = std::sin(static_cast<Real>(slope)), c = std::cos(static_cast<Real>(slope));
    const Real mu = static_cast<Real>(friction), r = static_cast<Real>(kRadius);
    const bool rolls = mu > 2 * s / (7 * c);
    const Real a = rolls ? kG * s * 5 / 7 : kG * (s - mu * c);
    const Real spin = rolls ? a / r : 5 * mu * kG * c / (2 * r);
    States states(2);
    states[1].position = {static_cast<double>(a * t * t / 2), 0.0, kRadius};
    states[1].velocity.x() = static_cast<double>(a * t);
    states[1].angular_velocity.y() = static_cast<double>(spin * t);
    states[1].orientation =
        Eigen::AngleAxisd(static_cast<double>(spin * t * t / 2), Vector3d::UnitY());
    return states;
  });
  return made;
}

/// A winch pulls a box over a floor, with (F − μ m g)/m up to its speed.
Problem winch_and_box() {
  constexpr double kForce = 30.0, kMass = 5.0, kSpeed = 0.8, kMu = 0.3;
  Problem made = event("winch_and_box", 1.0);
  made.bodies = {plane(kMu, 0.0), block(kMass, {0.6, 0.5, 0.4}, {5.0, 0.0, 0.2}, kMu)};
  made.joints = {rope_to(1, {0.0, 0.0, 0.2}, 5.0)};
  made.joints[0].rate = -kSpeed;
  made.joints[0].max_force = kForce;
  return along_line(made, -Vector3d::UnitX(), [=](Real t) {
    const Real a = (kForce - static_cast<Real>(kMu) * kMass * kG) / kMass;
    const Real there = static_cast<Real>(kSpeed) / a;
    return moved(moved({}, a, std::min(t, there)), 0, std::max(Real{0}, t - there));
  });
}

// ---- rocking

constexpr double kWidth = 0.4, kHeight = 1.2;

/// Rocking about an edge. y: tilt to one side, and its rate.
Phase on_edge(int side) {
  const Real w = kWidth, h = kHeight, radius = std::hypot(w, h) / 2, slender = std::atan(w / h);
  const Real stiffness = 3 * kG / (4 * radius);  // m g R over 4/3 m R²
  Phase phase;
  phase.rates = [=](const Reals& y) { return Reals{y[1], -stiffness * std::sin(slender - y[0])}; };
  phase.states = [=](const Reals& y) {
    const Real lean = slender - y[0];
    const auto signed_by_side = [&](Real x) { return static_cast<double>(side * x); };
    State state;
    state.position = {signed_by_side(w / 2 - radius * std::sin(lean)), 0.0,
                      static_cast<double>(radius * std::cos(lean))};
    state.orientation = Eigen::AngleAxisd(signed_by_side(y[0]), Vector3d::UnitY());
    state.velocity = {signed_by_side(radius * std::cos(lean) * y[1]), 0.0,
                      static_cast<double>(radius * std::sin(lean) * y[1])};
    state.angular_velocity = {0.0, signed_by_side(y[1]), 0.0};
    return States{State{}, state};
  };
  phase.until = [](const Reals& y) { return y[0]; };
  phase.next = [=](const Reals& y, Reals* start) {  // Housner
    const Real sine = std::sin(slender);
    *start = {-y[0], -y[1] * (1 - 3 * sine * sine / 2)};
    return on_edge(-side);
  };
  return phase;
}

/// A block rocks from one edge to the other, with Housner's loss at each change.
Problem rocking_block() {
  Problem made = event("rocking_block", 1.2);
  const Real tilt = std::atan(static_cast<Real>(kWidth) / kHeight) / 2;
  const Phase first = on_edge(1);
  made.bodies = {plane(2.0, 0.0), block(10.0, {kWidth, 1.0, kHeight}, Vector3d::Zero(), 2.0)};
  made.bodies[1].start = first.states({tilt, 0})[1];
  return in_phases(made, first, {tilt, 0}, 0.02);
}

std::vector<Problem> make() {
  return {bounce("bounce_inelastic", 0.0, 1.0),
          bounce("bounce_half", 0.5, 1.5),
          bounce("bounce_until_rest", 0.9, 6.5),
          box_drop("box_drop_inelastic", 0.0),
          box_drop("box_drop_half", 0.5),
          rod_against_wall(),
          rope_and_wall(),
          struck_block(),
          motor_against_wall(),
          ball_on_arm(),
          box_stops(),
          block_stops(),
          ball_on_slope("ball_rolls_down", 0.4),
          ball_on_slope("ball_slips_down", 0.1),
          winch_and_box(),
          rocking_block()};
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
