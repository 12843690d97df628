#include "engine/math/least_norm_solver.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "engine/math/list.h"
#include "engine/math/same_bits.h"

namespace constraint_sim::engine {
namespace {

// A squared norm that is updated by subtraction is summed up anew below this share of its last
// sum, since cancellation has then taken too many digits.
constexpr double kAccurate = 1e-3;

using Two = Eigen::Array2d;

// Two independent sums hide the latency.
double dot(const double* a, const double* b, std::size_t n) {
  Two sums(0.0, 0.0);
  std::size_t i = 0;
  for (; i + 1 < n; i += 2) sums += Eigen::Map<const Two>(a + i) * Eigen::Map<const Two>(b + i);
  return i < n ? sums.sum() + a[i] * b[i] : sums.sum();
}

void subtract(double s, const double* from, std::size_t n, double* to) {
  std::size_t i = 0;
  for (; i + 1 < n; i += 2) Eigen::Map<Two>(to + i) -= s * Eigen::Map<const Two>(from + i);
  if (i < n) to[i] -= s * from[i];
}

}  // namespace

double* LeastNormSolver::resize(std::size_t n) {
  n_ = n;
  given_.resize(n * n);
  return given_.data();
}

// Whether A was factored before in this way. Otherwise makes A ready to be factored in place.
bool LeastNormSolver::has_factors(bool is_lu, double least_pivot) {
  if (is_lu == is_lu_ && least_pivot == least_pivot_ && given_.size() == factored_.size() &&
      have_same_bits(given_.data(), factored_.data(), given_.size()))
    return true;
  is_lu_ = is_lu;
  least_pivot_ = least_pivot;
  A_ = given_;
  std::swap(given_, factored_);
  return false;
}

void LeastNormSolver::factor_regular() {
  if (has_factors(true, 0.0)) return;
  rank_ = n_;
  order_.resize(n_);
  for (std::size_t k = 0; k < n_; ++k) {
    double* const of_k = column(k);
    const auto larger = [](double a, double b) { return std::abs(a) < std::abs(b); };
    const auto pivot =
        static_cast<std::size_t>(std::max_element(of_k + k, of_k + n_, larger) - of_k);
    order_[k] = pivot;
    if (pivot != k)
      for (std::size_t j = 0; j < n_; ++j) std::swap(column(j)[k], column(j)[pivot]);
    const double inverse = 1.0 / of_k[k];
    for (std::size_t i = k + 1; i < n_; ++i) of_k[i] *= inverse;
    for (std::size_t j = k + 1; j < n_; ++j)
      subtract(column(j)[k], of_k + k + 1, n_ - k - 1, column(j) + k + 1);
  }
}

void LeastNormSolver::factor(double least_pivot) {
  if (has_factors(false, least_pivot)) return;
  for (List<double>* of : {&diagonal_, &beta_, &squares_, &exact_}) of->resize(n_);
  order_.resize(n_);
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  double sum = 0.0, least = 0.0;
  for (std::size_t j = 0; j < n_; ++j)
    sum += squares_[j] = exact_[j] = dot(column(j), column(j), n_);
  is_finite_ = std::isfinite(sum);
  for (rank_ = 0; rank_ < n_; ++rank_) {
    const double size = std::sqrt(squares_[swap_in_pivot(rank_)]);
    if (rank_ == 0) least = least_pivot * size;
    if (!(size > least)) break;
    reflect_columns(rank_, size);
  }
  reflect_rows();
}

// Swaps the largest remaining column to k.
std::size_t LeastNormSolver::swap_in_pivot(std::size_t k) {
  const auto first = squares_.begin() + static_cast<std::ptrdiff_t>(k);
  const auto pivot =
      static_cast<std::size_t>(std::max_element(first, squares_.end()) - squares_.begin());
  if (pivot == k) return k;
  std::swap_ranges(column(k), column(k) + n_, column(pivot));
  std::swap(squares_[k], squares_[pivot]);
  std::swap(exact_[k], exact_[pivot]);
  std::swap(order_[k], order_[pivot]);
  return k;
}

void LeastNormSolver::reflect_columns(std::size_t k, double size) {
  const std::size_t left = n_ - k;
  double* const v = column(k) + k;
  diagonal_[k] = v[0] > 0.0 ? -size : size;
  beta_[k] = 1.0 / (size * (size + std::abs(v[0])));
  v[0] -= diagonal_[k];
  for (std::size_t j = k + 1; j < n_; ++j) {
    double* const other = column(j) + k;
    subtract(beta_[k] * dot(v, other, left), v, left, other);
    squares_[j] -= other[0] * other[0];
    if (squares_[j] > kAccurate * exact_[j]) continue;
    exact_[j] = squares_[j] = dot(other + 1, other + 1, left - 1);
  }
}

void LeastNormSolver::reflect_rows() {
  const std::size_t left = n_ - rank_;
  if (left == 0) return;
  head_.resize(rank_);
  tau_.resize(rank_);
  tail_.resize(rank_ * left);
  for (std::size_t k = 0; k < rank_; ++k)
    for (std::size_t j = 0; j < left; ++j) tail_[left * k + j] = column(rank_ + j)[k];
  for (std::size_t k = rank_; k-- > 0;) {
    const double* const tail = tail_.data() + left * k;
    const double square = dot(tail, tail, left), x = diagonal_[k];
    if (square == 0.0) {
      head_[k] = tau_[k] = 0.0;
      continue;
    }
    const double size = std::sqrt(x * x + square);
    diagonal_[k] = x > 0.0 ? -size : size;
    head_[k] = x - diagonal_[k];
    tau_[k] = 1.0 / (size * (size + std::abs(x)));
    for (std::size_t i = 0; i < k; ++i) {
      double& R = column(k)[i];
      double* const other = tail_.data() + left * i;
      const double s = tau_[k] * (head_[k] * R + dot(tail, other, left));
      R -= s * head_[k];
      subtract(s, tail, left, other);
    }
  }
}

void LeastNormSolver::solve(double* b) {
  if (is_lu_)
    solve_by_pivots(b);
  else if (is_finite_)
    solve_by_reflections(b);
  else
    std::fill_n(b, n_, std::numeric_limits<double>::quiet_NaN());
}

void LeastNormSolver::solve_by_pivots(double* b) const {
  const double* const A = A_.data();
  for (std::size_t k = 0; k < n_; ++k) std::swap(b[k], b[order_[k]]);
  for (std::size_t k = 0; k < n_; ++k) subtract(b[k], A + n_ * k + k + 1, n_ - k - 1, b + k + 1);
  for (std::size_t k = n_; k-- > 0;) {
    b[k] /= A[n_ * k + k];
    subtract(b[k], A + n_ * k, k, b);
  }
}

void LeastNormSolver::solve_by_reflections(double* b) {
  const std::size_t left = n_ - rank_;
  for (std::size_t k = 0; k < rank_; ++k) {
    const double* const v = column(k) + k;
    subtract(beta_[k] * dot(v, b + k, n_ - k), v, n_ - k, b + k);
  }
  for (std::size_t k = rank_; k-- > 0;) {
    b[k] /= diagonal_[k];
    subtract(b[k], column(k), k, b);
  }
  std::fill(b + rank_, b + n_, 0.0);
  for (std::size_t k = 0; left > 0 && k < rank_; ++k) {
    const double* const tail = tail_.data() + left * k;
    const double s = tau_[k] * (head_[k] * b[k] + dot(tail, b + rank_, left));
    b[k] -= s * head_[k];
    subtract(s, tail, left, b + rank_);
  }
  x_.resize(n_);
  for (std::size_t k = 0; k < n_; ++k) x_[order_[k]] = b[k];
  std::copy(x_.begin(), x_.end(), b);
}

}  // namespace constraint_sim::engine
