#pragma once

#include <Eigen/Core>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Rows of a mechanism that all its other rows follow from.
struct IndependentRows {
  List<char> is_kept;
  double smallest_pivot = 1.0;  ///< of the rows kept
};

/// Chooses by a Cholesky factorization with diagonal pivots of `A` = G M⁻¹ Gᵀ, dense. The diagonal
/// is scaled to one, so that units and lengths do not matter, and rows are added until no pivot is
/// above `least`. Higham, "Accuracy and Stability of Numerical Algorithms", section 10.3.
/// Of pivots within a factor of four, a row that `preferred` marks comes first, then the first by
/// index, so that a choice does not alternate with the rounding. Rows that `required` marks come
/// before all others.
IndependentRows choose_independent_rows(Eigen::MatrixXd A, const List<char>& preferred,
                                        const List<char>& required, double least);

}  // namespace constraint_sim::engine
