#include "engine/math/dense.h"

#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace constraint_sim::engine::math {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double dot(const VectorXd& a, const VectorXd& b) {
  double sum = 0.0;
  for (Index i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

VectorXd product(const MatrixXd& A, const VectorXd& x) {
  VectorXd y = VectorXd::Zero(A.rows());
  for (Index j = 0; j < A.cols(); ++j) {
    const double x_j = x[j];
    for (Index i = 0; i < A.rows(); ++i) y[i] += A(i, j) * x_j;
  }
  return y;
}

// Overwrites the lower triangle of A with L, and its diagonal with D.
VectorXd solve_semidefinite(MatrixXd A, VectorXd b) {
  const Index n = b.size();
  std::vector<Index> swapped(static_cast<std::size_t>(n));
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < n; ++i)
      if (std::abs(A(i, i)) > std::abs(A(pivot, pivot))) pivot = i;
    swapped[static_cast<std::size_t>(k)] = pivot;
    if (pivot != k) {  // swaps rows and columns in the lower triangle
      std::swap(b[k], b[pivot]);
      std::swap(A(k, k), A(pivot, pivot));
      for (Index j = 0; j < k; ++j) std::swap(A(k, j), A(pivot, j));
      for (Index i = k + 1; i < pivot; ++i) std::swap(A(i, k), A(pivot, i));
      for (Index i = pivot + 1; i < n; ++i) std::swap(A(i, k), A(i, pivot));
    }
    if (!(std::abs(A(k, k)) > std::numeric_limits<double>::min())) {
      A(k, k) = 0.0;
      for (Index i = k + 1; i < n; ++i) A(i, k) = 0.0;
      continue;
    }
    for (Index j = k + 1; j < n; ++j) {
      const double share = A(j, k) / A(k, k);
      for (Index i = j; i < n; ++i) A(i, j) -= share * A(i, k);
    }
    for (Index i = k + 1; i < n; ++i) A(i, k) /= A(k, k);
  }
  for (Index k = 0; k < n; ++k)
    for (Index i = k + 1; i < n; ++i) b[i] -= A(i, k) * b[k];
  for (Index k = 0; k < n; ++k) b[k] = A(k, k) != 0.0 ? b[k] / A(k, k) : 0.0;
  for (Index k = n; k-- > 0;)
    for (Index i = k + 1; i < n; ++i) b[k] -= A(i, k) * b[i];
  for (Index k = n; k-- > 0;) std::swap(b[k], b[swapped[static_cast<std::size_t>(k)]]);
  return b;
}

Eigensystem eigensystem(Matrix3d A) {
  constexpr int kMostJacobiSweeps = 20;  // five suffice
  // Share of the diagonal below which an entry changes no digit of it.
  constexpr double kNoEntry = 1e-18;
  Matrix3d V = Matrix3d::Identity();
  for (int sweep = 0; sweep < kMostJacobiSweeps; ++sweep) {
    if (A(1, 0) == 0.0 && A(2, 0) == 0.0 && A(2, 1) == 0.0) break;
    for (const auto& [p, q] : {std::pair<Index, Index>{0, 1}, {0, 2}, {1, 2}}) {
      const double off = A(q, p);
      if (!(std::abs(off) > kNoEntry * (std::abs(A(p, p)) + std::abs(A(q, q))))) {
        A(p, q) = A(q, p) = 0.0;
        continue;
      }
      // Tangent of the angle of the rotation that makes the entry zero.
      const double half_cotangent = (A(q, q) - A(p, p)) / (2.0 * off);
      const double t =
          (half_cotangent >= 0.0 ? 1.0 : -1.0) /
          (std::abs(half_cotangent) + std::sqrt(1.0 + half_cotangent * half_cotangent));
      const double c = 1.0 / std::sqrt(1.0 + t * t), s = t * c;
      A(p, p) -= t * off;
      A(q, q) += t * off;
      A(p, q) = A(q, p) = 0.0;
      const Index r = 3 - p - q;
      const double a_rp = A(r, p), a_rq = A(r, q);
      A(r, p) = A(p, r) = c * a_rp - s * a_rq;
      A(r, q) = A(q, r) = s * a_rp + c * a_rq;
      for (Index i = 0; i < 3; ++i) {
        const double v_p = V(i, p), v_q = V(i, q);
        V(i, p) = c * v_p - s * v_q;
        V(i, q) = s * v_p + c * v_q;
      }
    }
  }
  return {A.diagonal(), V};
}

}  // namespace constraint_sim::engine::math
