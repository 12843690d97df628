#include "engine/dynamics/robots/mass_factors.h"

#include <utility>

namespace constraint_sim::engine {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MassFactors::MassFactors(MatrixXd M) : factors_(std::move(M)) {
  const VectorXd diagonal = factors_.diagonal();
  for (Index k = factors_.rows(); k-- > 0;) {
    const double share = factors_(k, k) / diagonal[k];
    if (!(share >= least_pivot_)) {  // also where it is not a number
      least_pivot_ = share;
      least_coordinate_ = k;
    }
    for (Index i = 0; i < k; ++i) {
      const double l = factors_(k, i) / factors_(k, k);
      for (Index j = 0; j <= i; ++j) factors_(i, j) -= l * factors_(k, j);
    }
    for (Index i = 0; i < k; ++i) factors_(k, i) /= factors_(k, k);
  }
}

VectorXd MassFactors::solve(VectorXd b) const {
  const Index n = factors_.rows();
  for (Index k = n; k-- > 0;) {
    for (Index i = 0; i < k; ++i) b[i] -= factors_(k, i) * b[k];
    b[k] /= factors_(k, k);
  }
  for (Index k = 0; k < n; ++k)
    for (Index i = 0; i < k; ++i) b[k] -= factors_(k, i) * b[i];
  return b;
}

MatrixXd MassFactors::solve_all(MatrixXd B) const {
  for (Index c = 0; c < B.cols(); ++c) B.col(c) = solve(B.col(c));
  return B;
}

}  // namespace constraint_sim::engine
