#pragma once

#include <cstddef>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves A x = b in the least-squares sense for a square A of a few rows and of any rank; returns
/// the x of least norm. QR factorization with column pivots, with R made triangular by reflections
/// from the right (Golub and Van Loan, "Matrix Computations", section 5.5.7), or LU where A is
/// known to be regular. Keeps its storage, and its factors while A has the same bits, as where
/// bodies move without rotating.
class LeastNormSolver {
 public:
  /// Columns of rows of contacts and joints, scaled to like sizes, are dependent where they add
  /// less than this share of the largest pivot: rounding leaves shares of 1e-15, while rows that
  /// depend on each other by a small angle add about the square of the angle [rad].
  static constexpr double kDependentPivot = 1e-10;

  /// Returns storage for n × n numbers by columns, to be filled before factor() or
  /// factor_regular().
  double* resize(std::size_t n);
  /// Factors by QR. Columns that add less than `least_pivot` times the largest pivot count as
  /// dependent.
  void factor(double least_pivot);
  void factor_regular();
  std::size_t rank() const { return rank_; }
  bool is_regular() const { return rank_ == n_; }
  /// Replaces b by x; by NaN where A is not finite.
  void solve(double* b);

 private:
  bool has_factors(bool is_lu, double least_pivot);
  double* column(std::size_t j) { return A_.data() + n_ * j; }
  std::size_t swap_in_pivot(std::size_t k);
  void reflect_columns(std::size_t k, double size);
  void reflect_rows();
  void solve_by_reflections(double* b);
  void solve_by_pivots(double* b) const;

  std::size_t n_ = 0, rank_ = 0;
  bool is_lu_ = false, is_finite_ = true;
  double least_pivot_ = 0.0;        // QR: argument of factor()
  List<double> given_, factored_;   // A as filled by the caller, and A whose factors are known
  List<double> A_;                  // QR: reflections below the diagonal, R or T above; LU: L and U
  List<double> diagonal_;           // diagonal of R or T
  List<double> beta_;               // factors of the reflections of columns
  List<double> head_, tau_, tail_;  // reflections of rows; tail_ has n − rank numbers per row
  List<double> squares_, exact_;    // squared norms of remaining columns, now and when last summed
  List<std::size_t> order_;         // order of columns, or swapped rows
  List<double> x_;                  // scratch
};

}  // namespace constraint_sim::engine
