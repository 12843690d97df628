#pragma once

#include "constraint_sim/engine/joint.h"

namespace constraint_sim::engine {

/// A kind of joint, or a distance joint with its settings, for scenes of tests and benchmarks.
struct JointType {
  JointKind kind = JointKind::kDistance;
  DistanceJoint distance;

  JointType(JointKind a_kind) : kind(a_kind) {}  // NOLINT: both are meant to convert
  JointType(const DistanceJoint& a_distance) : distance(a_distance) {}
  explicit JointType(const Joint& joint) : kind(joint.kind), distance(joint.distance) {}

  void write(Joint* joint) const {
    joint->kind = kind;
    joint->distance = distance;
  }
};

}  // namespace constraint_sim::engine
