#include "engine/constraints/joint_vectors.h"

#include "engine/constraints/anchor_pair.h"
#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

JointVectors::JointVectors(const Joint& joint, const BodyState& a, const BodyState& b) {
  const AnchorPair anchors(joint, a, b);
  r_A = anchors.r_A;
  r_B = anchors.r_B;
  d = anchors.d;
  custom = joint.custom.code.get();
  if (!info(joint.kind).has_frames) return;
  axes_A = (a.orientation * joint.frame_a).toRotationMatrix();
  axes_B =
      (b.orientation * joint.frame_b.value_or(Eigen::Quaterniond::Identity())).toRotationMatrix();
}

JointVectors::JointVectors(const Joint& joint, const BodyState& a, const BodyState& b,
                           const MovingFrame& frame_b)
    : JointVectors(joint, a, b) {
  if (!frame_b.moves) return;
  const Vector3d r = b.orientation * frame_b.anchor;
  d += r - r_B;
  r_B = r;
  axes_B = b.orientation.toRotationMatrix() * frame_b.axes;
}

JointVectors between(const JointVectors& start, const JointVectors& end, double share) {
  JointVectors vectors;
  vectors.custom = start.custom;
  vectors.r_A = start.r_A + share * (end.r_A - start.r_A);
  vectors.r_B = start.r_B + share * (end.r_B - start.r_B);
  vectors.d = start.d + share * (end.d - start.d);
  vectors.axes_A = start.axes_A + share * (end.axes_A - start.axes_A);
  vectors.axes_B = start.axes_B + share * (end.axes_B - start.axes_B);
  return vectors;
}

JointMotion::JointMotion(const JointVectors& vectors, const BodyState& a, const BodyState& b)
    : w_A(a.angular_velocity), w_B(b.angular_velocity) {
  const Vector3d around_A = w_A.cross(vectors.r_A), around_B = w_B.cross(vectors.r_B);
  d_dot = b.linear_velocity + around_B - a.linear_velocity - around_A;
  d_bias = w_B.cross(around_B) - w_A.cross(around_A);
}

void JointMotion::add(const MovingFrame& frame_b, const Eigen::Matrix3d& R_B) {
  const Vector3d rate = R_B * frame_b.anchor_rate;
  d_dot += rate;
  d_bias += 2.0 * w_B.cross(rate) + R_B * frame_b.anchor_acceleration;
  spin = R_B * frame_b.spin;
  spin_bias = R_B * frame_b.spin_rate + w_B.cross(spin);
}

Vector3d JointMotion::rate(VectorRef u, const JointVectors& vectors) const {
  switch (u.kind) {
    case VectorKind::kSeparation:
      return d_dot;
    case VectorKind::kAxisA:
      return w_A.cross(vectors[u]);
    case VectorKind::kAxisB:
      return (w_B + spin).cross(vectors[u]);
    case VectorKind::kWorldAxis:
    case VectorKind::kCustom:
      break;
  }
  return Vector3d::Zero();
}

Vector3d JointMotion::bias(VectorRef u, const JointVectors& vectors) const {
  switch (u.kind) {
    case VectorKind::kSeparation:
      return d_bias;
    case VectorKind::kAxisA:
      return w_A.cross(w_A.cross(vectors[u]));
    case VectorKind::kAxisB:
      return (w_B + spin).cross((w_B + spin).cross(vectors[u])) + spin_bias.cross(vectors[u]);
    case VectorKind::kWorldAxis:
    case VectorKind::kCustom:
      break;
  }
  return Vector3d::Zero();
}

}  // namespace constraint_sim::engine
