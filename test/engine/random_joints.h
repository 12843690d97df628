#pragma once

// Joints of any kind between bodies at random poses, and poses of bodies that satisfy such a joint.

#include "engine/constraints/joint_kinds.h"
#include "support.h"

namespace constraint_sim::engine {

inline Joint random_joint(JointKind kind, Random* random) {
  Joint joint;
  joint.name = "joint";
  joint.kind = kind;
  joint.anchor_a = random->vector();
  joint.anchor_b = random->vector();
  joint.frame_a = random->orientation();
  joint.frame_b = random->orientation();
  if (kind == JointKind::kScrew) joint.pitch = 0.4;
  return joint;
}

/// Returns body B in a pose that the joint allows on body A: random values of the free coordinates,
/// with a random velocity.
inline BodyState attached(const Joint& joint, const BodyState& a, Random* random) {
  using Eigen::Quaterniond;
  using Eigen::Vector3d;
  const JointForms& kind = forms(joint.kind);
  const Quaterniond frame_A = a.orientation * joint.frame_a;
  Quaterniond frame_B = frame_A * home(kind.alignment);
  Vector3d off = Vector3d::Zero();
  for (int k = 0; k < kind.coordinates; ++k) {
    const ScalarForm& free = kind.coordinate[static_cast<std::size_t>(k)];
    const double amount = (*random)();
    const Quaterniond turn(Eigen::AngleAxisd(amount, Vector3d::UnitZ()));
    const bool is_second = joint.kind == JointKind::kUniversal && k == 1;  // about z_B
    if (!free.is_angle)
      off += frame_A * (amount * Vector3d::Unit(free.product.u.axis));
    else if (is_second)
      frame_B = frame_B * turn;
    else
      frame_B = frame_A * turn * frame_A.conjugate() * frame_B;
  }
  if (kind.alignment == Alignment::kFree) frame_B = random->orientation();
  if (joint.kind == JointKind::kDistance) off = random->vector();
  BodyState b = random->state();
  b.orientation = frame_B * joint.frame_b->conjugate();
  b.position = a.position + a.orientation * joint.anchor_a + off - b.orientation * joint.anchor_b;
  return b;
}

}  // namespace constraint_sim::engine
