#pragma once

// Factors of symmetric, possibly singular matrices in long double, and the number types of the
// reference.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace constraint_sim::engine::reference {

using Real = long double;
using Vector3 = Eigen::Matrix<Real, 3, 1>;
using Matrix3 = Eigen::Matrix<Real, 3, 3>;
using Quaternion = Eigen::Quaternion<Real>;
using VectorX = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
using MatrixX = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;

/// Cholesky factorisation with diagonal pivoting of a matrix scaled to a unit diagonal. Stops where
/// pivots are rounding.
class DenseFactors {
 public:
  explicit DenseFactors(MatrixX A) : scale_(A.diagonal()), L_(std::move(A)) {
    constexpr Real kDependent = 1e-13L;
    const Eigen::Index n = L_.rows();
    for (Eigen::Index i = 0; i < n; ++i) scale_[i] = scale_[i] > 0 ? 1 / std::sqrt(scale_[i]) : 0;
    L_ = scale_.asDiagonal() * L_ * scale_.asDiagonal();
    order_.resize(static_cast<std::size_t>(n));
    for (Eigen::Index i = 0; i < n; ++i) order_[static_cast<std::size_t>(i)] = i;
    for (; rank_ < n; ++rank_) {
      Eigen::Index best = 0;
      if (L_.diagonal().tail(n - rank_).maxCoeff(&best) < kDependent) break;
      swap(rank_, rank_ + best);
      smallest_pivot_ = std::min(smallest_pivot_, L_(rank_, rank_));
      L_(rank_, rank_) = std::sqrt(L_(rank_, rank_));
      const Eigen::Index left = n - rank_ - 1;
      L_.col(rank_).tail(left) /= L_(rank_, rank_);
      for (Eigen::Index k = rank_ + 1; k < n; ++k) {
        const Real factor = L_(k, rank_);
        if (factor != 0) L_.col(k).tail(n - k) -= factor * L_.col(rank_).tail(n - k);
      }
    }
  }
  Real smallest_pivot() const { return smallest_pivot_; }
  std::vector<Eigen::Index> kept() const { return {order_.begin(), order_.begin() + rank_}; }
  VectorX solve(const VectorX& b) const {
    VectorX x = VectorX::Zero(b.size());
    if (rank_ == 0) return x;
    VectorX y(rank_);
    for (Eigen::Index i = 0; i < rank_; ++i) y[i] = scale_[at(i)] * b[at(i)];
    const auto L = L_.topLeftCorner(rank_, rank_).template triangularView<Eigen::Lower>();
    L.solveInPlace(y);
    L.transpose().solveInPlace(y);
    for (Eigen::Index i = 0; i < rank_; ++i) x[at(i)] = scale_[at(i)] * y[i];
    return x;
  }

 private:
  Eigen::Index at(Eigen::Index i) const { return order_[static_cast<std::size_t>(i)]; }
  // Swaps rows and columns of a matrix stored in its lower triangle.
  void swap(Eigen::Index i, Eigen::Index k) {
    if (i == k) return;
    const Eigen::Index n = L_.rows();
    L_.row(i).head(i).swap(L_.row(k).head(i));
    std::swap(L_(i, i), L_(k, k));
    for (Eigen::Index j = i + 1; j < k; ++j) std::swap(L_(j, i), L_(k, j));
    for (Eigen::Index j = k + 1; j < n; ++j) std::swap(L_(j, i), L_(j, k));
    std::swap(order_[static_cast<std::size_t>(i)], order_[static_cast<std::size_t>(k)]);
  }

  VectorX scale_;
  Real smallest_pivot_ = 1;
  MatrixX L_;
  std::vector<Eigen::Index> order_;
  Eigen::Index rank_ = 0;
};

}  // namespace constraint_sim::engine::reference
