#include "engine/math/box_lcp.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/dense.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kBoxSolved = 1e-11;  // share of the largest residual |a| without x

// Returns zero moved into the bounds; not by Eigen's maximum, which may return zero of either sign.
VectorXd nearest_to_zero(const BoxLcp& problem) {
  VectorXd x(problem.b.size());
  for (Index i = 0; i < x.size(); ++i)
    x[i] = std::min(std::max(0.0, problem.least[i]), problem.most[i]);
  return x;
}

/// Active-set method on a problem scaled to a diagonal of one.
class ActiveSet {
 public:
  explicit ActiveSet(const BoxLcp& problem)
      : problem_(problem),
        x_(nearest_to_zero(problem)),
        a_(problem.b + math::product(problem.A, x_)),
        tolerance_(kBoxSolved *
                   std::max(problem.b.lpNorm<Eigen::Infinity>(), a_.lpNorm<Eigen::Infinity>())) {}

  bool solve();
  const VectorXd& x() const { return x_; }

 private:
  Index find_worst() const;
  bool set_free(Index row);
  bool move(const VectorXd& step, bool is_direction);
  VectorXd solve_free(const VectorXd& b) const;

  const BoxLcp& problem_;
  VectorXd x_, a_;
  double tolerance_;
  List<Index> free_;  // rows between their bounds, linearly independent
};

// Returns the row at a bound with the largest residual away from it; -1: none.
Index ActiveSet::find_worst() const {
  Index worst = -1;
  double most = tolerance_;
  for (Index i = 0; i < a_.size(); ++i) {
    const bool can_move = a_[i] < 0.0 ? x_[i] < problem_.most[i] : x_[i] > problem_.least[i];
    const bool is_free = std::find(free_.begin(), free_.end(), i) != free_.end();
    if (is_free || !can_move || std::abs(a_[i]) <= most) continue;
    most = std::abs(a_[i]);
    worst = i;
  }
  return worst;
}

VectorXd ActiveSet::solve_free(const VectorXd& b) const {
  const auto n = static_cast<Index>(free_.size());
  if (n == 0) return b;
  MatrixXd A(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j)
      A(i, j) = problem_.A(free_[static_cast<std::size_t>(i)], free_[static_cast<std::size_t>(j)]);
  return math::solve_semidefinite(std::move(A), b);
}

// Moves the free rows by a step, or along a direction, until a bound is reached; this row is then
// no longer free. Returns false where no bound ends a direction.
bool ActiveSet::move(const VectorXd& step, bool is_direction) {
  double share = is_direction ? kInfinity : 1.0;
  const auto room = [&](std::size_t k) {
    const Index i = free_[k];
    return (step[static_cast<Index>(k)] > 0.0 ? problem_.most[i] : problem_.least[i]) - x_[i];
  };
  std::size_t first = free_.size();
  for (std::size_t k = 0; k < free_.size(); ++k) {
    const double by = step[static_cast<Index>(k)];
    if (by == 0.0 || !(std::abs(share * by) > std::abs(room(k)))) continue;
    share = room(k) / by;
    first = k;
  }
  if (!std::isfinite(share)) return false;
  for (std::size_t k = 0; k < free_.size(); ++k)
    x_[free_[k]] += k == first ? room(k) : share * step[static_cast<Index>(k)];
  if (first < free_.size()) free_.erase(free_.begin() + static_cast<std::ptrdiff_t>(first));
  a_ = problem_.b + math::product(problem_.A, x_);
  return true;
}

bool ActiveSet::set_free(Index row) {
  VectorXd column(static_cast<Index>(free_.size()));
  for (std::size_t k = 0; k < free_.size(); ++k)
    column[static_cast<Index>(k)] = problem_.A(free_[k], row);
  const VectorXd along = solve_free(column);
  const double pivot = problem_.A(row, row) - math::dot(column, along);
  free_.push_back(row);
  // A dependent row changes together with the rows that it depends on, until a bound is reached.
  if (pivot < kDependent) {
    VectorXd direction(along.size() + 1);
    direction << -along, 1.0;
    if (!move(a_[row] > 0.0 ? VectorXd(-direction) : direction, true)) return false;
  }
  while (!free_.empty()) {
    VectorXd b(static_cast<Index>(free_.size()));
    for (std::size_t k = 0; k < free_.size(); ++k) b[static_cast<Index>(k)] = -a_[free_[k]];
    const std::size_t before = free_.size();
    if (!move(solve_free(b), false)) return false;
    if (free_.size() == before) break;
  }
  return true;
}

bool ActiveSet::solve() {
  for (Index round = 0; round < 20 * (x_.size() + 1); ++round) {
    const Index worst = find_worst();
    if (worst < 0) return true;
    if (!set_free(worst)) return false;
  }
  return false;
}

}  // namespace

double pivot_beside(const MatrixXd& A, const List<Index>& rows, Index row) {
  const auto n = static_cast<Index>(rows.size());
  const VectorXd scale = A.diagonal().cwiseSqrt().cwiseInverse();
  if (n == 0) return 1.0;
  MatrixXd among(n, n);
  VectorXd column(n);
  for (Index i = 0; i < n; ++i) {
    const Index k = rows[static_cast<std::size_t>(i)];
    column[i] = scale[k] * A(k, row) * scale[row];
    for (Index j = 0; j < n; ++j) {
      const Index l = rows[static_cast<std::size_t>(j)];
      among(i, j) = scale[k] * A(k, l) * scale[l];
    }
  }
  return 1.0 - math::dot(column, math::solve_semidefinite(std::move(among), column));
}

double response_beside(const MatrixXd& A, const List<Index>& others, Index row) {
  List<Index> held;
  for (const Index other : others)
    if (pivot_beside(A, held, other) > kDependent) held.push_back(other);
  const double pivot = pivot_beside(A, held, row);
  return A(row, row) * (pivot > kDependent ? pivot : 1.0);
}

bool solve(const BoxLcp& problem, VectorXd* x) {
  const VectorXd scale = problem.A.diagonal().cwiseSqrt().cwiseInverse();
  const BoxLcp scaled{scale.asDiagonal() * problem.A * scale.asDiagonal(),
                      scale.cwiseProduct(problem.b), problem.least.cwiseQuotient(scale),
                      problem.most.cwiseQuotient(scale)};
  ActiveSet set(scaled);
  if (!set.solve()) return false;
  *x = scale.cwiseProduct(set.x());
  for (Index i = 0; i < x->size(); ++i) {  // exactly at the bound
    if (set.x()[i] == scaled.least[i]) (*x)[i] = problem.least[i];
    if (set.x()[i] == scaled.most[i]) (*x)[i] = problem.most[i];
  }
  return true;
}

}  // namespace constraint_sim::engine
