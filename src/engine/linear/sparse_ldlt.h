#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace constraint_sim::engine {

/// Factors A = L D Lᵀ of a symmetric positive semidefinite matrix whose pattern stays and whose
/// values change. The pattern is ordered for little fill once (without loops leaves first, and
/// there is none; else approximate minimum degree); after that nothing is allocated. Davis, "Direct
/// Methods for Sparse Linear Systems", SIAM 2006, chapters 4 and 7; left-looking by columns.
class SparseLdlt {
 public:
  /// Where an entry of A goes in values().
  using Slot = std::size_t;

  /// Takes the pattern of an n × n matrix: its entries (i, j), either triangle, repetitions
  /// allowed. The diagonal is always there.
  void analyze(int n, const std::vector<std::pair<int, int>>& entries);

  Slot slot(int i, int j) const;
  /// Entries of A, to be set to zero and summed up before factor(), which overwrites them.
  std::vector<double>& values() { return values_; }

  /// Factors. Where a pivot falls below `least` times the diagonal entry of A, that share of the
  /// entry is added to it, so that the factors exist for dependent rows as well; returns how often.
  /// The smallest pivot so touched, as a share of its entry, is kept in smallest_touched().
  int factor(double least);
  double smallest_touched() const { return smallest_touched_; }

  /// The same, but leaves such rows out altogether, for is_left_out() by place(); solve() is then
  /// not for use.
  int factor_leaving_out(double least);
  bool is_left_out(std::size_t place) const { return left_out_[place] != 0; }

  /// Where row i stands in the elimination, and so in what solve() takes.
  int place(int i) const { return order_[static_cast<std::size_t>(i)]; }
  /// Replaces b by A⁻¹ b, both in the order of the elimination.
  void solve(double* b) const;

 private:
  int factor_forest(double least);
  int factor_any(double least);
  double touch(std::size_t k, double pivot, double least, int* touched);
  void solve_forest(double* b) const;
  void solve_any(double* b) const;

  std::size_t n_ = 0;
  std::vector<int> order_;                 // of original rows: place in the elimination
  std::vector<std::size_t> column_start_;  // of L without diagonal, by columns
  std::vector<std::size_t> row_of_;
  bool is_forest_ = true;  // no loops, no entry twice: no column of L has more than one entry
  std::vector<std::size_t> parent_;     // the first row of each column; n_ where there is none
  std::vector<char> is_updated_;        // whether columns before change this one below the diagonal
  std::vector<std::size_t> row_start_;  // of L without diagonal, by rows
  std::vector<std::size_t> column_of_;  // k of L_jk in row j
  std::vector<std::size_t> place_of_;   // and where it lies among the columns
  // the diagonal in elimination order, then L by columns; A before factor()
  std::vector<double> values_;
  std::vector<double> inverse_diagonal_;
  std::vector<double> work_;
  double smallest_touched_ = 1.0;
  bool leaves_out_ = false;
  std::vector<char> left_out_;  // by place; as of factor_leaving_out()
};

}  // namespace constraint_sim::engine
