#pragma once

#include <cstddef>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// A x = b with a square A of a few rows and of any rank: of all x that are off by least the one of
/// least norm. QR factors with column pivots, and R made triangular by reflections from the right
/// (Golub and Van Loan, "Matrix Computations", section 5.5.7); or LU factors where A is known to be
/// regular. Keeps its storage.
class LeastNormSolver {
 public:
  /// Room for n × n numbers, column by column, to be filled before one of the next two.
  double* resize(std::size_t n);
  /// `least_pivot`, of the largest one: columns that add less depend on others.
  void factor(double least_pivot);
  void factor_regular();
  std::size_t rank() const { return rank_; }
  bool is_regular() const { return rank_ == n_; }
  /// b becomes x; of an A that is not finite NaN.
  void solve(double* b);

 private:
  double* column(std::size_t j) { return A_.data() + n_ * j; }
  std::size_t swap_in_pivot(std::size_t k);
  void reflect_columns(std::size_t k, double size);
  void reflect_rows();
  void solve_by_reflections(double* b);
  void solve_by_pivots(double* b) const;

  std::size_t n_ = 0, rank_ = 0;
  bool is_lu_ = false, is_finite_ = true;
  List<double> A_;                  // reflections below, R or T above; or L and U
  List<double> diagonal_;           // of R or T
  List<double> beta_;               // of reflections of columns,
  List<double> head_, tau_, tail_;  // and of rows: tail_ has n − rank numbers of each
  List<double> squares_, exact_;    // of what is left of columns, and when last summed up
  List<std::size_t> order_;         // of columns, or rows that were swapped
  List<double> x_;                  // scratch
};

}  // namespace constraint_sim::engine
