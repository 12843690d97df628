#include "engine/dynamics/implicit/joint_slopes.h"

#include "engine/math/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;

}  // namespace

void JacobianSlopes::add(VectorRef u, VectorRef other, const JointVectors& v,
                         const VectorSlopes& slopes, std::size_t end) {
  const Vector3d f = v[other];
  const Slope df = slopes.of(other, end);
  switch (u.kind) {
    case VectorKind::kSeparation:
      force += df;
      torque_A -= cross_matrix(v.r_A) * df;
      torque_B += cross_matrix(v.r_B) * df;
      (end == 0 ? torque_A : torque_B) += (end == 0 ? 1.0 : -1.0) * cross_matrix(f) * slopes.arm;
      break;
    case VectorKind::kAxisA:
      torque_A += cross_matrix(v[u]) * df - cross_matrix(f) * slopes.of(u, end);
      break;
    case VectorKind::kAxisB:
      torque_B += cross_matrix(v[u]) * df - cross_matrix(f) * slopes.of(u, end);
      break;
    case VectorKind::kWorldAxis:
    case VectorKind::kCustom:
      break;
  }
}

JointInStep::JointInStep(const ImplicitLink& link, const LinkInStep& state,
                         const ImplicitMotion& motion, const List<double>& unknowns)
    : share(motion.time().share),
      dofs{link.ends[0].dofs, link.ends[1].dofs},
      at_start(state.start()) {
  const bool has_frames = info(link.joint).has_frames;
  at_end.custom = link.custom;
  Vector3d change = Vector3d::Zero();  // change of d
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    VectorSlopes& at = slopes[e];
    Vector3d& arm = e == 0 ? at_end.r_A : at_end.r_B;
    Matrix3d& axes = e == 0 ? at_end.axes_A : at_end.axes_B;
    arm = state.r0[e];
    if (has_frames) axes = state.axes1[e];
    if (end.dofs == 0) {
      change += end.sign * motion.shift(end.point);
      continue;
    }
    change += end.sign * ConstVector(unknowns.data() + end.unknown);
    at.d.leftCols<3>() = end.sign * Matrix3d::Identity();
    if (end.dofs < 6) continue;
    const ImplicitMotion::Turning& turn = motion.turning(end.point);
    const ConstVector w(unknowns.data() + end.unknown + 3);
    const auto advance = [&](const Vector3d& start, Slope* slope) -> Vector3d {
      const Vector3d mean = turn.B * start;
      slope->rightCols<3>() = -turn.B * cross_matrix(mean);
      return start + w.cross(mean);
    };
    arm = advance(e == 0 ? state.r0[0] : state.next_r_B, &at.arm);
    change += end.sign * (arm - state.r0[e]);
    at.d.rightCols<3>() = end.sign * at.arm.rightCols<3>();
    for (int k = 0; has_frames && k < 3; ++k)
      axes.col(k) = advance((e == 0 ? state.axes0[0] : state.next_axes_B).col(k), &at.axes[k]);
  }
  at_end.d = state.d0 + change;
  at_force = between(at_start, at_end, share);
}

JointVectors JointInStep::displaced(std::size_t f, int i, double step) const {
  JointVectors vectors = at_end;
  const VectorSlopes& at = slopes[f];
  vectors.d += step * at.d.col(i);
  (f == 0 ? vectors.r_A : vectors.r_B) += step * at.arm.col(i);
  for (int k = 0; k < 3; ++k)
    (f == 0 ? vectors.axes_A : vectors.axes_B).col(k) +=
        step * at.axes[static_cast<std::size_t>(k)].col(i);
  return vectors;
}

}  // namespace constraint_sim::engine
