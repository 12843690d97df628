#include "engine/constraints/rows.h"

#include "engine/constraints/custom_code.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Adds Uᵀf to J.
void add_transposed_map(VectorRef u, const Vector3d& f, const JointVectors& vectors, Jacobian* J) {
  switch (u.kind) {
    case VectorKind::kSeparation:
      J->j1 -= f;
      J->j2 -= vectors.r_A.cross(f);
      J->j3 += f;
      J->j4 += vectors.r_B.cross(f);
      break;
    case VectorKind::kAxisA:
      J->j2 += vectors[u].cross(f);
      break;
    case VectorKind::kAxisB:
      J->j4 += vectors[u].cross(f);
      break;
    case VectorKind::kWorldAxis:
    case VectorKind::kCustom:
      break;
  }
}

}  // namespace

double product_value(RowForm row, const JointVectors& vectors) {
  return (row.is_square() ? 0.5 : 1.0) * vectors[row.u].dot(vectors[row.v]);
}

Jacobian product_jacobian(RowForm row, const JointVectors& vectors) {
  Jacobian J;
  add_transposed_map(row.u, vectors[row.v], vectors, &J);
  if (!row.is_square()) add_transposed_map(row.v, vectors[row.u], vectors, &J);
  return J;
}

double product_rate(RowForm row, const JointVectors& vectors, const JointMotion& motion) {
  const double of_u = motion.rate(row.u, vectors).dot(vectors[row.v]);
  return row.is_square() ? of_u : of_u + vectors[row.u].dot(motion.rate(row.v, vectors));
}

double product_gamma(RowForm row, const JointVectors& vectors, const JointMotion& motion) {
  const double twice = 2.0 * motion.rate(row.u, vectors).dot(motion.rate(row.v, vectors)) +
                       motion.bias(row.u, vectors).dot(vectors[row.v]) +
                       vectors[row.u].dot(motion.bias(row.v, vectors));
  return row.is_square() ? 0.5 * twice : twice;
}

double value(RowForm row, const JointVectors& vectors) {
  return row.is_custom() ? vectors.custom->value(vectors) : product_value(row, vectors);
}

Jacobian jacobian(RowForm row, const JointVectors& vectors) {
  return row.is_custom() ? vectors.custom->jacobian(vectors) : product_jacobian(row, vectors);
}

double rate(RowForm row, const JointVectors& vectors, const JointMotion& motion) {
  return row.is_custom() ? vectors.custom->rate(vectors, motion)
                         : product_rate(row, vectors, motion);
}

double gamma(RowForm row, const JointVectors& vectors, const JointMotion& motion) {
  return row.is_custom() ? vectors.custom->gamma(vectors, motion)
                         : product_gamma(row, vectors, motion);
}

Vector3d direction(RowForm row, const JointVectors& vectors) {
  if (row.is_custom()) return vectors.custom->jacobian(vectors).j3;
  Vector3d sum = Vector3d::Zero();
  if (row.u.kind == VectorKind::kSeparation) sum += vectors[row.v];
  if (row.v.kind == VectorKind::kSeparation && !row.is_square()) sum += vectors[row.u];
  return sum;
}

}  // namespace constraint_sim::engine
