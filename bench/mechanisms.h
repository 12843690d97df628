#pragma once

// Mechanisms of joints with axes, with references in minimal coordinates.

#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "minimal_coordinates.h"

namespace constraint_sim::engine::mechanisms {

using Eigen::Vector3d;
using minimal::Angle;
using minimal::Jet;
using minimal::OneCoordinate;
using minimal::Point;
using minimal::Pose;
using minimal::Poses;
using problems::Real;
using problems::Reals;

inline constexpr int kGround = -1;

/// A joint between numbered bodies, with point and axes in the initial pose, world coordinates.
struct JointAt {
  JointKind kind = JointKind::kHinge;
  int a = kGround, b = 0;
  Vector3d point = Vector3d::Zero();
  Vector3d axis = Vector3d::UnitZ();
  std::optional<Vector3d> second_axis;        ///< fixed in B; of universal joints
  std::optional<Motor> motor = std::nullopt;  ///< motor of the first free coordinate
};

/// Bodies with initial states, joints, and final poses of the bodies.
struct Mechanism {
  std::string name;
  double duration = 0.0;  ///< [s]
  Vector3d gravity{0.0, 0.0, -problems::kGravity};
  std::vector<Body> bodies;
  std::vector<JointAt> joints;
  std::function<void(World*)> add_forces;  ///< springs and wrenches, if any
  std::optional<OneCoordinate>
      reference;  ///< reference with one degree of freedom, and the poses of `bodies`
  Reals start;    ///< initial coordinate and its rate
  Poses end;
  std::uint32_t dependent_rows = 0;
  bool is_judged_by_angles = false;  ///< errors are in rad instead of m
  std::vector<double> steps;         ///< ticks to be tested [s]
  /// Errors of a prototype with dense equations at these ticks.
  std::vector<double> expected_errors;

  /// Builds the scene in its initial state.
  World world(WorldOptions options) const;
  /// Returns the largest final error of a body: position, and rotation times radius of gyration
  /// [m]; or rotation [rad].
  double error(const World& world) const;
};

inline void add_joint(World* world, const std::vector<BodyId>& ids, const JointAt& at) {
  const auto id = [&](int i) {
    return i == kGround ? kWorldBody : ids[static_cast<std::size_t>(i)];
  };
  const auto state = [&](int i) { return i == kGround ? BodyState() : world->state(id(i)); };
  const auto anchor = [&](int i) -> Vector3d {
    return state(i).orientation.conjugate() * (at.point - state(i).position);
  };
  Joint joint;
  joint.name = std::string(name(at.kind)) + "_" + std::to_string(world->joint_ids().size());
  joint.kind = at.kind;
  joint.body_a = id(at.a);
  joint.body_b = id(at.b);
  joint.anchor_a = anchor(at.a);
  joint.anchor_b = anchor(at.b);
  if (info(at.kind).has_frames)
    joint.frame_a = frame_along(state(at.a).orientation.conjugate() * at.axis);
  if (at.second_axis) joint.axis_b = state(at.b).orientation.conjugate() * *at.second_axis;
  joint.coordinates.front().motor = at.motor;
  world->add_joint(joint);
}

inline World Mechanism::world(WorldOptions options) const {
  options.gravity = gravity;
  World world(options);
  std::vector<BodyId> ids;
  for (const Body& body : bodies) ids.push_back(world.add_body(body));
  for (const JointAt& joint : joints) add_joint(&world, ids, joint);
  if (add_forces) add_forces(&world);
  return world;
}

inline double Mechanism::error(const World& world) const {
  double largest = 0.0;
  for (std::size_t i = 0; i < end.size(); ++i) {
    const BodyState& state = world.state(world.find_body(bodies[i].name));
    largest = std::max(
        largest, is_judged_by_angles
                     ? problems::angle_between(state.orientation, minimal::orientation(end[i]))
                     : minimal::error_of(state, minimal::mass_of(bodies[i]), end[i]));
  }
  return largest;
}

/// Errors of a run: of the final state, and the largest of joints.
struct Outcome {
  double error = 0.0;
  double joints = 0.0;  ///< largest joint error of all steps [m]
  std::uint32_t substeps = 0, rejected = 0;
  /// Fewest in a step; singular poses have more.
  std::uint32_t dependent_rows = std::numeric_limits<std::uint32_t>::max();
  bool has_failed = false;  ///< a step failed, or another method took over
};

/// Runs to the end by runge_kutta in ticks of `tick`, one step each with tolerance 0.
inline Outcome run(const Mechanism& mechanism, double tick, double tolerance) {
  WorldOptions options;
  options.method = Method::kRungeKutta;
  options.time_step = tick;
  options.tolerance = tolerance;
  World world = mechanism.world(options);
  Outcome run;
  const auto steps = std::lround(mechanism.duration / tick);
  for (long i = 0; i < steps; ++i) {
    const StepReport& report = world.step();
    run.has_failed = run.has_failed || report.outcome.failed || report.costs.method_changes > 0;
    run.dependent_rows = std::min(run.dependent_rows, report.joints.dependent_rows);
    run.joints = std::max(run.joints, report.joints.max_error);
    run.substeps += report.costs.substeps;
    run.rejected += report.costs.rejected;
  }
  run.error = mechanism.error(world);
  return run;
}

inline Body bar(const std::string& name, double mass, const Vector3d& size) {
  Body body;
  body.name = name;
  body.mass = mass;
  body.shape = Box{size};
  body.no_collision = true;
  return body;
}

/// A hinge about the axis −y, as in all planar mechanisms.
inline JointAt hinge(int a, int b, const Vector3d& point) {
  return {JointKind::kHinge, a, b, point, -Vector3d::UnitY(), std::nullopt};
}

/// Sets initial poses and velocities of a mechanism with one degree of freedom.
inline void place(Mechanism* mechanism, const std::function<Poses(const Jet&)>& poses, double q,
                  double rate) {
  OneCoordinate reference{poses, {}, mechanism->gravity, {}, 0};
  const Poses start = minimal::at(reference, static_cast<Real>(q));
  for (std::size_t i = 0; i < mechanism->bodies.size(); ++i) {
    Body& body = mechanism->bodies[i];
    body.state = minimal::state(start[i], rate);
    reference.bodies.push_back(minimal::mass_of(body));
  }
  mechanism->reference = reference;
  mechanism->start = {static_cast<Real>(q), static_cast<Real>(rate)};
}

/// Computes the final poses by `steps` steps of the reference.
inline void finish(Mechanism* mechanism, int steps) {
  const Reals y = minimal::integrate(*mechanism->reference, mechanism->start,
                                     static_cast<Real>(mechanism->duration), steps);
  mechanism->end = minimal::at(*mechanism->reference, y[0]);
}

inline std::vector<double> common_steps() {
  return {1.0 / 30.0, 1.0 / 60.0, 1.0 / 120.0, 1.0 / 240.0};
}

// ---- open chains

/// Two bars on hinges, released in line and horizontal. Reference: Lagrange's equations of the
/// angles φ₁, φ₂ from x.
inline Mechanism double_hinge_pendulum(int steps = 384) {
  const double l1 = 1.0, l2 = 0.8, m1 = 1.0, m2 = 0.7;
  Mechanism made;
  made.name = "double hinge pendulum";
  made.duration = 3.0;
  made.bodies = {bar("upper", m1, {l1, 0.05, 0.05}), bar("lower", m2, {l2, 0.05, 0.05})};
  made.bodies[0].state.position = {l1 / 2.0, 0.0, 0.0};
  made.bodies[1].state.position = {l1 + l2 / 2.0, 0.0, 0.0};
  made.joints = {hinge(kGround, 0, Vector3d::Zero()), hinge(0, 1, {l1, 0.0, 0.0})};
  const Real length = static_cast<Real>(l1), a1 = length / 2, a2 = static_cast<Real>(l2) / 2;
  const Real mass1 = static_cast<Real>(m1), mass2 = static_cast<Real>(m2);
  const Real M11 =
      minimal::mass_of(made.bodies[0]).inertia[1] + mass1 * a1 * a1 + mass2 * length * length;
  const Real M22 = minimal::mass_of(made.bodies[1]).inertia[1] + mass2 * a2 * a2;
  const Real c = mass2 * length * a2, g = static_cast<Real>(problems::kGravity);
  const auto rate = [=](const Reals& y) {
    const Real M12 = c * std::cos(y[0] - y[1]), k = c * std::sin(y[0] - y[1]);
    const Real b1 = -k * y[3] * y[3] - g * (mass1 * a1 + mass2 * length) * std::cos(y[0]);
    const Real b2 = k * y[2] * y[2] - g * mass2 * a2 * std::cos(y[1]);
    const Real determinant = M11 * M22 - M12 * M12;
    return Reals{y[2], y[3], (M22 * b1 - M12 * b2) / determinant,
                 (M11 * b2 - M12 * b1) / determinant};
  };
  const Reals y = minimal::integrate(rate, Reals(4, 0), 3, steps);
  const Real x = length * std::cos(y[0]), z = length * std::sin(y[0]);
  made.end = {
      minimal::planar(x / 2, z / 2, minimal::angle(y[0])),
      minimal::planar(x + a2 * std::cos(y[1]), z + a2 * std::sin(y[1]), minimal::angle(y[1]))};
  made.steps = common_steps();
  made.expected_errors = {6.9e-7, 3.3e-10, 5.8e-13, 3.4e-15};
  return made;
}

/// A symmetric top on its tip, spinning about its axis z. Reference: Euler's equations about the
/// tip in the body's frame, and the quaternion.
inline Mechanism spinning_top(int steps = 1536) {
  const double m = 1.0, l = 0.3, A = 0.02, C = 0.01;
  Mechanism made;
  made.name = "spinning top on ball";
  made.duration = 3.0;
  Body top = bar("top", m, {0.1, 0.1, 0.1});
  top.inertia = {A, A, C};
  BodyState& state = top.state;
  state.orientation = Eigen::AngleAxisd(0.5, Vector3d::UnitX());
  state.position = state.orientation * Vector3d(0.0, 0.0, l);
  state.angular_velocity = state.orientation * Vector3d(0.0, 0.3, 30.0);
  state.linear_velocity = state.angular_velocity.cross(state.position);
  made.bodies = {top};
  made.joints = {{JointKind::kBall, kGround, 0, Vector3d::Zero(), Vector3d::UnitZ(), {}}};
  const Real length = static_cast<Real>(l), spin_inertia = static_cast<Real>(C);
  const Real tip_inertia = static_cast<Real>(A) + static_cast<Real>(m) * length * length;
  const Real weight = static_cast<Real>(m) * static_cast<Real>(problems::kGravity);
  using Vector = Eigen::Matrix<Real, 3, 1>;
  using Quaternion = Eigen::Quaternion<Real>;
  const auto rate = [=](const Reals& y) {
    const Quaternion q(y[0], y[1], y[2], y[3]);
    const Vector w(y[4], y[5], y[6]);
    // Rᵀe_z, for a quaternion that is not normalized to the last bit
    const Vector up(2 * (q.x() * q.z() - q.w() * q.y()), 2 * (q.y() * q.z() + q.w() * q.x()),
                    q.w() * q.w() - q.x() * q.x() - q.y() * q.y() + q.z() * q.z());
    const Vector torque = Vector(0, 0, length).cross(-weight * up);
    const Quaternion dq = q * Quaternion(0, w.x() / 2, w.y() / 2, w.z() / 2);
    return Reals{dq.w(),
                 dq.x(),
                 dq.y(),
                 dq.z(),
                 (torque.x() + (tip_inertia - spin_inertia) * w.y() * w.z()) / tip_inertia,
                 (torque.y() + (spin_inertia - tip_inertia) * w.z() * w.x()) / tip_inertia,
                 torque.z() / spin_inertia};
  };
  const Real half = 0.25L;
  const Reals y =
      minimal::integrate(rate, {std::cos(half), std::sin(half), 0, 0, 0, 0.3L, 30}, 3, steps);
  const Eigen::Matrix<Real, 3, 3> R =
      Quaternion(y[0], y[1], y[2], y[3]).normalized().toRotationMatrix();
  Pose pose;
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) pose.R(i, k) = R(i, k);
    pose.x[i] = length * R(i, 2);
  }
  made.end = {pose};
  made.steps = common_steps();
  made.expected_errors = {2.5e-7, 4.7e-10, 9.6e-13, 2.9e-14};
  return made;
}

// ---- loops in a plane

inline Poses slider_crank_poses(const Jet& theta) {
  const Jet r = 0.3L, l = 1, half = 0.5L;
  const Angle crank = minimal::angle(theta);
  const Jet x = r * crank.c, z = r * crank.s, reach = sqrt(l * l - z * z);
  return {minimal::planar(half * x, half * z, crank),
          minimal::planar(x + half * reach, half * z, minimal::direction(reach, -z)),
          minimal::planar(x + reach, 0, {})};
}

/// Crank, rod, and a slide along x, under gravity. The coordinate is the crank's angle.
inline Mechanism slider_crank(int steps = 384) {
  Mechanism made;
  made.name = "slider-crank";
  made.duration = 3.0;
  made.bodies = {bar("crank", 1.0, {0.3, 0.05, 0.05}), bar("rod", 0.5, {1.0, 0.05, 0.05}),
                 bar("slide", 0.3, {0.1, 0.1, 0.1})};
  const double start = 0.3, rate = 5.0;
  place(&made, slider_crank_poses, start, rate);
  const Vector3d pin(0.3 * std::cos(start), 0.0, 0.3 * std::sin(start));
  const Vector3d slide = made.bodies[2].state.position;
  made.joints = {hinge(kGround, 0, Vector3d::Zero()),
                 hinge(0, 1, pin),
                 hinge(1, 2, slide),
                 {JointKind::kSlider, kGround, 2, slide, Vector3d::UnitX(), {}}};
  made.dependent_rows = 3;
  finish(&made, steps);
  made.steps = common_steps();
  made.expected_errors = {4.3e-8, 1.2e-10, 2.4e-13, 9e-15};
  return made;
}

/// A motor moves the crank's angle as c(t) = 0.3 + 4 t + 0.3 sin 3t, whatever the forces.
inline Mechanism driven_slider_crank() {
  Mechanism made = slider_crank();
  made.name = "slider-crank, driven";
  place(&made, slider_crank_poses, 0.3, 4.9);
  Motor motor;
  motor.bias = 4.0;
  motor.amplitude = 0.9;
  motor.frequency = static_cast<double>(3 / (2 * minimal::kPi));
  motor.phase = static_cast<double>(minimal::kPi / 2);
  made.joints.front().motor = motor;
  const Real t = static_cast<Real>(made.duration);
  made.end = minimal::at(*made.reference, 0.3L + 4 * t + 0.3L * std::sin(3 * t));
  made.expected_errors.assign(made.steps.size(), 0.0);  // zero up to rounding
  return made;
}

inline Poses four_bar_poses(const Jet& theta) {
  const Real a = 0.3L, b = 0.9L, c = 0.8L;
  const Jet half = 0.5L, foot = 1;
  const Angle crank = minimal::angle(theta);
  const Point P{Jet(a) * crank.c, Jet(a) * crank.s};
  const Point Q = minimal::meet(P, b, {foot, 0}, c, 1);
  return {minimal::planar(half * P.x, half * P.y, crank),
          minimal::planar(half * (P.x + Q.x), half * (P.y + Q.y),
                          minimal::direction(Q.x - P.x, Q.y - P.y)),
          minimal::planar(half * (Q.x + foot), half * Q.y, minimal::direction(Q.x - foot, Q.y))};
}

/// A rotating crank of 0.3 m, a coupler of 0.9 m and a rocker of 0.8 m; feet 1 m apart.
inline Mechanism four_bar(int steps = 768) {
  Mechanism made;
  made.name = "four-bar of hinges";
  made.duration = 3.0;
  made.bodies = {bar("crank", 1.0, {0.3, 0.05, 0.05}), bar("coupler", 0.9, {0.9, 0.05, 0.05}),
                 bar("rocker", 0.8, {0.8, 0.05, 0.05})};
  const double start = 0.7, rate = 6.0;
  place(&made, four_bar_poses, start, rate);
  const Vector3d foot(1.0, 0.0, 0.0);
  const Vector3d P = 2.0 * made.bodies[0].state.position;
  const Vector3d Q = 2.0 * made.bodies[2].state.position - foot;
  made.joints = {hinge(kGround, 0, Vector3d::Zero()), hinge(0, 1, P), hinge(1, 2, Q),
                 hinge(kGround, 2, foot)};
  made.dependent_rows = 3;
  finish(&made, steps);
  made.steps = common_steps();
  made.expected_errors = {8.5e-6, 2.0e-8, 3.8e-11, 6.9e-14};
  return made;
}

// ---- loops in space

inline constexpr double kShaftAngle = 40.0 / 180.0 * 3.14159265358979323846;

inline Vector3d output_direction() { return {std::cos(kShaftAngle), 0.0, std::sin(kShaftAngle)}; }

/// Poses of both shafts; the second turns by θ₂, tan θ₂ = cos β tan θ.
inline Poses universal_shaft_poses(const Jet& theta) {
  const Vector3d along = output_direction();
  const Angle input = minimal::angle(theta);
  const Angle output = minimal::direction(input.c, Jet(std::cos(Real{kShaftAngle})) * input.s);
  Poses poses(2);
  poses[0].x = {Jet(-0.5L), Jet(0), Jet(0)};
  poses[0].R = minimal::rotation(Vector3d::UnitX(), input);
  poses[1].x = {Jet(0.5L * static_cast<Real>(along.x())), Jet(0),
                Jet(0.5L * static_cast<Real>(along.z()))};
  poses[1].R = minimal::rotation(along, output) *
               minimal::rotation(-Vector3d::UnitY(), minimal::angle(Real{kShaftAngle}));
  return poses;
}

/// Two shafts in bearings at an angle of 40°, joined by a universal joint.
inline Mechanism universal_shaft(int steps = 384) {
  Mechanism made;
  made.name = "universal shaft";
  made.duration = 3.0;
  made.bodies = {bar("input", 1.0, {1.0, 0.1, 0.1}), bar("output", 1.5, {1.0, 0.1, 0.1})};
  made.bodies[0].inertia = {0.02, 0.05, 0.05};
  made.bodies[1].inertia = {0.03, 0.06, 0.06};
  place(&made, universal_shaft_poses, 0.0, 6.0);
  const Vector3d along = output_direction();
  const Vector3d across(-along.z(), 0.0, along.x());  // the cross's axis on the output at θ = 0
  made.joints = {{JointKind::kHinge, kGround, 0, -Vector3d::UnitX(), Vector3d::UnitX(), {}},
                 {JointKind::kHinge, kGround, 1, along, along, {}},
                 {JointKind::kUniversal, 0, 1, Vector3d::Zero(), Vector3d::UnitY(), across}};
  made.dependent_rows = 3;
  finish(&made, steps);
  made.steps = common_steps();
  made.expected_errors = {5.3e-12, 2.4e-14, 6e-16, 6e-16};
  return made;
}

/// A motor turns the first shaft at 6 rad/s.
inline Mechanism driven_universal_shaft() {
  Mechanism made = universal_shaft();
  made.name = "universal shaft, driven";
  Motor motor;
  motor.bias = 6.0;
  made.joints.front().motor = motor;
  made.end = minimal::at(*made.reference, 6 * static_cast<Real>(made.duration));
  made.expected_errors.assign(made.steps.size(), 0.0);
  return made;
}

/// Bricard's threefold symmetric six-bar of a cube: unit links with hinges normal to both
/// neighbours, at alternating angles α and β with cos α + cos β + cos α cos β = 0. The sixth link,
/// the ground, is last, and in its place if the loop closes.
inline Poses bricard_poses(const Jet& alpha) {
  const Jet one = 1;
  const Jet cosine = -cos(alpha) / (one + cos(alpha));
  const Angle turns[2] = {minimal::angle(alpha), {cosine, sqrt(one - cosine * cosine)}};
  const Angle twists[2] = {{0, 1}, {0, -1}};
  Poses poses;
  minimal::Matrix R = minimal::Matrix::Identity();
  minimal::Vector end(one, Jet(0), Jet(0));
  for (int i = 0; i < 6; ++i) {
    R = R * minimal::rotation(Vector3d::UnitZ(), turns[i % 2]);
    Pose link;
    link.x = end + minimal::Vector(R.col(0) * Jet(0.5L));
    end += R.col(0);
    R = R * minimal::rotation(Vector3d::UnitX(), twists[i % 2]);
    link.R = R;
    poses.push_back(link);
  }
  return poses;
}

inline Mechanism bricard(int steps = 64) {
  Mechanism made;
  made.name = "Bricard six-bar";
  made.duration = 0.4;
  made.gravity = {0.0, -problems::kGravity, 0.0};
  for (int i = 0; i < 5; ++i)
    made.bodies.push_back(bar("link_" + std::to_string(i), 1.0, {1.0, 0.05, 0.05}));
  const double start = static_cast<double>(minimal::kPi / 2), rate = 1.0;
  place(
      &made,
      [](const Jet& alpha) {
        Poses poses = bricard_poses(alpha);
        poses.pop_back();
        return poses;
      },
      start, rate);
  Vector3d pin(1.0, 0.0, 0.0), axis = Vector3d::UnitZ();
  for (int i = 0; i < 5; ++i) {
    made.joints.push_back({JointKind::kHinge, i - 1, i, pin, axis, {}});
    const BodyState& state = made.bodies[static_cast<std::size_t>(i)].state;
    pin = state.position + 0.5 * (state.orientation * Vector3d::UnitX());
    axis = state.orientation * Vector3d::UnitZ();
  }
  made.joints.push_back({JointKind::kHinge, kGround, 4, pin, axis, {}});
  made.dependent_rows = 1;
  finish(&made, steps);
  made.steps = common_steps();
  made.expected_errors = {1.8e-9, 5.4e-13, 4e-16, 4e-16};
  return made;
}

}  // namespace constraint_sim::engine::mechanisms
