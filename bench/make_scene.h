#pragma once

// Builders of bodies, joints and options for scenes of tests and benchmarks.

#include <Eigen/Geometry>
#include <string>

#include "constraint_sim/engine/world.h"
#include "joint_type.h"

namespace constraint_sim::engine {

inline constexpr double kGravity = 9.81;

/// Options with the tutorial's method: sequential impulses, with Baumgarte stabilization of errors
/// left by edits.
inline WorldOptions options(double time_step, double gravity = kGravity) {
  WorldOptions options;
  options.method = Method::kSequentialImpulses;
  options.time_step = time_step;
  options.gravity = {0.0, 0.0, -gravity};
  return options;
}

inline WorldOptions weightless(double time_step) { return options(time_step, 0.0); }

inline Body make_body(const std::string& name, const Shape& shape, double mass,
                      const Eigen::Vector3d& position) {
  Body body;
  body.name = name;
  body.shape = shape;
  body.mass = mass;
  body.state.position = position;
  return body;
}

/// A plane through the origin, turned about y by `slope` [rad]; downhill is (cos slope, 0, −sin
/// slope).
inline Body make_floor(double friction, double slope = 0.0) {
  Body floor = make_body("floor", Plane{}, 0.0, Eigen::Vector3d::Zero());
  floor.type = BodyType::kStatic;
  floor.friction = friction;
  floor.state.orientation = Eigen::AngleAxisd(slope, Eigen::Vector3d::UnitY());
  return floor;
}

inline Joint make_joint(const std::string& name, BodyId a, const Eigen::Vector3d& anchor_a,
                        BodyId b, const Eigen::Vector3d& anchor_b,
                        const JointType& type = DistanceJoint{}) {
  Joint joint;
  joint.name = name;
  joint.body_a = a;
  joint.anchor_a = anchor_a;
  joint.body_b = b;
  joint.anchor_b = anchor_b;
  type.write(&joint);
  return joint;
}

/// A joint from the world's origin to the centre of a body.
inline Joint hang(const std::string& name, BodyId body, const JointType& type = DistanceJoint{}) {
  return make_joint(name, kWorldBody, Eigen::Vector3d::Zero(), body, Eigen::Vector3d::Zero(), type);
}

inline DistanceJoint rod(double length) {
  DistanceJoint joint;
  joint.length = length;
  return joint;
}

inline DistanceJoint between(double min_length, double max_length) {
  DistanceJoint joint;
  joint.min_length = min_length;
  joint.max_length = max_length;
  return joint;
}

inline DistanceJoint rope(double max_length) { return between(0.0, max_length); }

inline DistanceJoint spring(double length, double stiffness, double damping) {
  DistanceJoint joint = rod(length);
  joint.stiffness = stiffness;
  joint.damping = damping;
  return joint;
}

}  // namespace constraint_sim::engine
