#include "engine/model/principal_axes.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace constraint_sim::engine {

using Eigen::Matrix3d;
using Eigen::Vector3d;

PrincipalAxes principal_axes(const Matrix3d& tensor, double rounding) {
  const Vector3d off(tensor(0, 1), tensor(1, 2), tensor(2, 0));
  PrincipalAxes principal{off.lpNorm<Eigen::Infinity>() <= rounding, Matrix3d::Identity(),
                          tensor.diagonal()};
  if (principal.is_along) return principal;
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(tensor);
  const Matrix3d found = solver.eigenvectors();
  std::array<int, 3> order{0, 1, 2}, best = order;
  double most = -1.0;
  do {
    double sum = 0.0;
    for (int i = 0; i < 3; ++i) sum += std::abs(found(i, order[static_cast<std::size_t>(i)]));
    if (sum > most) most = sum, best = order;
  } while (std::next_permutation(order.begin(), order.end()));
  Matrix3d& axes = principal.axes;
  for (int i = 0; i < 3; ++i) {
    const int k = best[static_cast<std::size_t>(i)];
    axes.col(i) = found(i, k) < 0.0 ? Vector3d(-found.col(k)) : Vector3d(found.col(k));
    principal.moments[i] = solver.eigenvalues()[k];
  }
  if (axes.determinant() < 0.0) axes.col(2) = -axes.col(2);
  return principal;
}

}  // namespace constraint_sim::engine
