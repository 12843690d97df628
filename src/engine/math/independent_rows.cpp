#include "engine/math/independent_rows.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Share of the largest pivot from which a pivot is as good: preferred rows come first among such.
constexpr double kAboutAsLarge = 0.25;

// Returns the row to be added next; -1 where no pivot is above `least`.
Index next_pivot(const VectorXd& left, const List<char>& is_kept, const List<char>& preferred,
                 const List<char>& required, double least) {
  const Index n = left.size();
  Index largest = -1;
  for (Index i = 0; i < n; ++i) {
    if (is_kept[i] || left[i] < least) continue;
    if (required[i]) return i;
    if (largest < 0 || left[i] > left[largest]) largest = i;
  }
  if (largest < 0) return -1;
  const double enough = kAboutAsLarge * left[largest];
  Index first = -1;
  for (Index i = 0; i < n; ++i) {
    if (is_kept[i] || left[i] < enough) continue;
    if (preferred[i]) return i;
    if (first < 0) first = i;
  }
  return first;
}

}  // namespace

IndependentRows choose_independent_rows(Eigen::MatrixXd A, const List<char>& preferred,
                                        const List<char>& required, double least) {
  const Index n = A.rows();
  IndependentRows chosen;
  chosen.is_kept.assign(to_index(n), 0);
  VectorXd scale(n);
  for (Index i = 0; i < n; ++i) scale[i] = A(i, i) > 0.0 ? 1.0 / std::sqrt(A(i, i)) : 0.0;
  A = scale.asDiagonal() * A * scale.asDiagonal();

  VectorXd left = A.diagonal();
  Eigen::MatrixXd L(n, n);
  for (Index k = 0; k < n; ++k) {
    const Index pivot = next_pivot(left, chosen.is_kept, preferred, required, least);
    if (pivot < 0) break;
    chosen.smallest_pivot = std::min(chosen.smallest_pivot, left[pivot]);
    L.col(k) = A.col(pivot);
    for (Index j = 0; j < k; ++j) L.col(k) -= L(pivot, j) * L.col(j);
    L.col(k) /= std::sqrt(left[pivot]);
    left -= L.col(k).cwiseAbs2();
    chosen.is_kept[pivot] = 1;
  }
  return chosen;
}

}  // namespace constraint_sim::engine
