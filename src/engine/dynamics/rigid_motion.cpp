#include "engine/dynamics/rigid_motion.h"

#include <Eigen/Eigenvalues>

#include "engine/math/cross_matrix.h"
#include "engine/math/dense.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

// Share of the largest principal moment of inertia below which a moment is rounding: points in a
// line have none about the line, and do not rotate about it.
constexpr double kNoMoment = 1e-12;

}  // namespace

RigidMotion as_one_body(const List<double>& mass, const List<Vector3d>& inertia,
                        const List<Vector3d>& position, const List<Eigen::Quaterniond>& orientation,
                        const BodyVectors& velocity) {
  RigidMotion body;
  for (std::size_t i = 0; i < mass.size(); ++i) {
    body.mass += mass[i];
    body.centre += mass[i] * position[i];
    body.velocity += mass[i] * velocity.linear[i];
  }
  body.centre /= body.mass;
  body.velocity /= body.mass;
  Matrix3d total = Matrix3d::Zero();
  for (std::size_t i = 0; i < mass.size(); ++i) {
    const Matrix3d r = cross_matrix(position[i] - body.centre);
    total -= mass[i] * r * r;
    body.momentum += mass[i] * r * (velocity.linear[i] - body.velocity);
    if (i >= inertia.size()) continue;
    const Matrix3d R = orientation[i].toRotationMatrix();
    const Matrix3d J = R * inertia[i].asDiagonal() * R.transpose();
    total += J;
    body.momentum += J * velocity.angular[i];
  }
  const auto [values, vectors] = math::eigensystem(total);
  for (Eigen::Index k = 0; k < 3; ++k) {
    const Vector3d axis = vectors.col(k);
    if (values[k] > kNoMoment * values.maxCoeff())
      body.inverse_inertia += axis * axis.transpose() / values[k];
  }
  return body;
}

}  // namespace constraint_sim::engine
