// Rotating bodies, free or about a fixed point, and closed forms in three dimensions.

#include "common.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

constexpr char kRigid[] = "quaternion and body rates in long double, by extrapolation";

/// The box of OSRF's benchmark 'boxes'.
Problem free_box(const std::string& name, const Vector3d& velocity, const Vector3d& spin,
                 const Vector3d& gravity) {
  Problem made = problem(name, "smooth", 10.0);
  made.is_planar = false;
  made.gravity = gravity;
  Body body = box(10.0, {0.1, 0.4, 0.9});
  body.start.velocity = velocity;
  body.start.angular_velocity = spin;
  made.bodies = {body};
  made.reference = rigid_motion(made, true, Vector3d::Zero(), 1.0 / 64.0);
  made.source = kRigid;
  return made;
}

/// The first box many times over, 3 m apart, to measure an engine's overhead.
Problem many_free_boxes(int count) {
  Problem made = free_box("free_boxes_" + std::to_string(count), Vector3d::Zero(), {0.1, 5.0, 0.1},
                          Vector3d::Zero());
  made.duration = 1.0;
  const auto one = rigid_motion(made, true, Vector3d::Zero(), 1.0 / 64.0);
  const auto place = [](int i) {
    return Vector3d(3.0 * (i % 100), 3.0 * std::floor(i / 100.0), 0.0);
  };
  made.bodies.resize(static_cast<std::size_t>(count), made.bodies.front());
  for (int i = 0; i < count; ++i)
    made.bodies[static_cast<std::size_t>(i)].start.position = place(i);
  made.reference = [=](int refinement) {
    Trajectory all;
    for (const States& states : one(refinement)) {
      all.emplace_back(count, states.front());
      for (int i = 0; i < count; ++i) all.back()[static_cast<std::size_t>(i)].position += place(i);
    }
    return all;
  };
  return made;
}

/// A box of 1 kg on a ball joint in the middle of its upper face.
Problem hung_box(const std::string& name, const Eigen::Quaterniond& orientation,
                 const Vector3d& spin_B, const Vector3d& size, double step) {
  Problem made = problem(name, "smooth", 5.0);
  made.is_planar = false;
  Body body = box(1.0, size);
  const Vector3d pivot(0.0, 0.0, size.z() / 2.0);
  body.start.orientation = orientation;
  body.start.position = -(orientation * pivot);
  body.start.angular_velocity = orientation * spin_B;
  body.start.velocity = body.start.angular_velocity.cross(body.start.position);
  made.bodies = {body};
  made.joints = {ball_joint(kWorld, 0, Vector3d::Zero(), pivot)};
  made.reference = rigid_motion(made, false, pivot, step);
  made.source = kRigid;
  return made;
}

Eigen::Quaterniond about_y(double angle) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitY()));
}

/// A conical pendulum at 45°: ω² = g / (l cos 45°).
Problem conical_pendulum() {
  Problem made = problem("conical_pendulum", "smooth", 10.0);
  made.is_planar = false;
  const long double radius = std::sqrt(0.5L), depth = std::sqrt(0.5L);
  const long double rate = std::sqrt(static_cast<long double>(kGravity) / depth);
  const auto states = [=](long double t) {
    State state;
    const long double c = std::cos(rate * t), s = std::sin(rate * t);
    state.position = {static_cast<double>(radius * c), static_cast<double>(radius * s),
                      static_cast<double>(-depth)};
    state.velocity = {static_cast<double>(-radius * rate * s),
                      static_cast<double>(radius * rate * c), 0.0};
    return States{state};
  };
  const State start = states(0.0L).front();
  made.bodies = {point_mass(start.position, 1.0, start.velocity)};
  made.joints = {rod(kWorld, 0)};
  made.reference = closed_form(made, states);
  made.source = "closed form";
  return made;
}

/// Two masses on a rod, without gravity: uniform rotation about the moving common centre.
Problem dumbbell() {
  Problem made = problem("dumbbell", "smooth", 10.0);
  made.gravity = Vector3d::Zero();
  const auto states = [](long double t) {
    constexpr long double kRate = 3.0L;
    const Vector3d u(static_cast<double>(std::cos(kRate * t)), 0.0,
                     static_cast<double>(std::sin(kRate * t)));
    const Vector3d n(-u.z() * 3.0, 0.0, u.x() * 3.0);
    const Vector3d velocity(0.5, 0.0, 0.25);
    const Vector3d centre = velocity * static_cast<double>(t);
    States both(2);
    both[0].position = centre - u * (2.0 / 3.0);
    both[0].velocity = velocity - n * (2.0 / 3.0);
    both[1].position = centre + u * (1.0 / 3.0);
    both[1].velocity = velocity + n * (1.0 / 3.0);
    return both;
  };
  const States start = states(0.0L);
  made.bodies = {point_mass(start[0].position, 1.0, start[0].velocity),
                 point_mass(start[1].position, 2.0, start[1].velocity)};
  made.joints = {rod(0, 1)};
  made.reference = closed_form(made, states);
  made.source = "closed form";
  return made;
}

/// A mass on a spring, released at the spring's rest length.
Problem oscillator(const std::string& name, const std::string& group, double stiffness) {
  Problem made = problem(name, group, 5.0);
  const auto states = [=](long double t) {
    const long double g = static_cast<long double>(kGravity),
                      k = static_cast<long double>(stiffness);
    const long double rate = std::sqrt(k);
    State state;
    state.position.z() = static_cast<double>(-1.0L - g / k * (1.0L - std::cos(rate * t)));
    state.velocity.z() = static_cast<double>(-g / k * rate * std::sin(rate * t));
    return States{state};
  };
  made.bodies = {point_mass({0.0, 0.0, -1.0})};
  Joint spring = rod(kWorld, 0);
  spring.kind = JointKind::kSpring;
  spring.stiffness = stiffness;
  made.joints = {spring};
  made.reference = closed_form(made, states);
  made.source = "closed form";
  return made;
}

std::vector<Problem> make() {
  const Vector3d weight(0.0, 0.0, -9.8);
  return {
      free_box("free_box_simple", {-0.9, 0.4, 0.1}, {0.5, 0.0, 0.0}, Vector3d::Zero()),
      free_box("free_box", Vector3d::Zero(), {0.1, 5.0, 0.1}, Vector3d::Zero()),
      free_box("free_box_complex", {-2.0, 2.0, 8.0}, {0.1, 5.0, 0.1}, weight),
      many_free_boxes(10000),
      hung_box("compound_pendulum", about_y(kPi / 2.0), Vector3d::Zero(), {0.1, 0.2, 1.0},
               1.0 / 32.0),
      hung_box("tumbling_pendulum", about_y(2.0), {1.0, 2.0, 5.0}, {0.3, 0.4, 1.0}, 1.0 / 64.0),
      hung_box("top", about_y(kPi - 0.3), {0.0, 0.0, 40.0}, {0.5, 0.5, 0.3}, 1.0 / 128.0),
      conical_pendulum(),
      dumbbell(),
      oscillator("oscillator", "smooth", 100.0),
  };
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
