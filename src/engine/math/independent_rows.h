#pragma once

#include <Eigen/Core>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// A largest set of independent rows of a mechanism; all other rows depend on them.
struct IndependentRows {
  List<char> is_kept;
  double smallest_pivot = 1.0;  ///< smallest pivot of the rows kept
};

/// Chooses rows by a Cholesky factorization with diagonal pivots of the Delassus matrix `A` = G M⁻¹
/// Gᵀ, scaled to a unit diagonal, so that units do not matter. Rows are added until no pivot
/// exceeds `least` (Higham, "Accuracy and Stability of Numerical Algorithms", section 10.3). Rows
/// marked by `required` come first. Among pivots within a factor of four, rows marked by
/// `preferred` come first, then the first by index, so that the choice does not alternate with
/// rounding.
IndependentRows choose_independent_rows(Eigen::MatrixXd A, const List<char>& preferred,
                                        const List<char>& required, double least);

}  // namespace constraint_sim::engine
