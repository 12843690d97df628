#pragma once

// Parts shared by the files of problems.

#include <cmath>
#include <string>

#include "../references.h"
#include "engine/math/numbers.h"

namespace constraint_sim::report {

using engine::kPi;
inline constexpr double kGravity = 9.81;  // [m/s²]

inline Eigen::Vector3d box_inertia(double mass, const Eigen::Vector3d& size) {
  const Eigen::Vector3d s = size.cwiseAbs2();
  return mass / 12.0 * Eigen::Vector3d(s.y() + s.z(), s.z() + s.x(), s.x() + s.y());
}

inline Problem problem(const std::string& name, const std::string& group, double duration,
                       double length = 1.0) {
  Problem made;
  made.name = name;
  made.group = group;
  made.duration = duration;
  made.length = length;
  return made;
}

/// A problem for the stability grid only.
inline Problem extreme(const std::string& name, const std::string& group, double length = 1.0) {
  Problem made = problem(name, group, 2.0, length);
  made.is_graded = false;
  return made;
}

/// A chain of unit masses on rods of 1 m, released at rest along x, or hanging for angle −π/2.
inline PlanarChain chain_of(int links, double angle = 0.0, double mass = 1.0, double rod = 1.0) {
  const auto n = static_cast<std::size_t>(links);
  PlanarChain chain;
  chain.masses.assign(n, mass);
  chain.lengths.assign(n, rod);
  chain.angles.assign(n, angle);
  chain.rates.assign(n, 0.0);
  return chain;
}

/// Adds a chain to the problem, and its motion in minimal coordinates integrated with `step` [s].
inline Problem with_chain(Problem made, const PlanarChain& chain, double step) {
  made.gravity = {0.0, 0.0, -chain.gravity};
  add_chain(chain, &made);
  made.reference = chain_motion(made, chain, step);
  made.source = "angles of the rods in long double, by extrapolation";
  return made;
}

inline Joint ball_joint(int a, int b, const Eigen::Vector3d& anchor_a,
                        const Eigen::Vector3d& anchor_b) {
  Joint joint;
  joint.kind = JointKind::kBall;
  joint.a = a;
  joint.b = b;
  joint.anchor_a = anchor_a;
  joint.anchor_b = anchor_b;
  return joint;
}

inline Joint rod(int a, int b, const Eigen::Vector3d& anchor_a = Eigen::Vector3d::Zero()) {
  Joint joint;
  joint.a = a;
  joint.b = b;
  joint.anchor_a = anchor_a;
  return joint;
}

inline Body point_mass(const Eigen::Vector3d& position, double mass = 1.0,
                       const Eigen::Vector3d& velocity = Eigen::Vector3d::Zero()) {
  Body body;
  body.mass = mass;
  body.start.position = position;
  body.start.velocity = velocity;
  return body;
}

inline Body box(double mass, const Eigen::Vector3d& size) {
  Body body;
  body.mass = mass;
  body.inertia = box_inertia(mass, size);
  body.size = size;
  return body;
}

inline Body plane(double friction, double restitution) {
  Body body;
  body.is_static = true;
  body.shape = Shape::kPlane;
  body.friction = friction;
  body.restitution = restitution;
  return body;
}

inline Body ball(double mass, double radius, const Eigen::Vector3d& position, double friction = 0.0,
                 double restitution = 0.0) {
  Body body = point_mass(position, mass);
  body.inertia = Eigen::Vector3d::Constant(0.4 * mass * radius * radius);
  body.shape = Shape::kSphere;
  body.size.x() = radius;
  body.friction = friction;
  body.restitution = restitution;
  return body;
}

}  // namespace constraint_sim::report
