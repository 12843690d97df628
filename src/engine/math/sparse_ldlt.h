#pragma once

#include <cstddef>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Factors A = L D Lᵀ, symmetric positive semidefinite, with a constant pattern and changing
/// values. The pattern is ordered once for little fill; later calls allocate nothing. Patterns
/// without loops are eliminated leaves first, without fill. Others use approximate minimum degree,
/// with neighbouring columns of similar pattern as one dense block, a supernode: Davis,
/// Rajamanickam, Sid-Lakhdar, "A survey of direct methods for sparse linear systems", Acta Numerica
/// 25 (2016), section 9.
class SparseLdlt {
 public:
  /// Index of an entry of A in values().
  using Slot = std::size_t;

  /// Takes the pattern of an n × n matrix: its entries (i, j), either triangle, repetitions
  /// allowed. The diagonal is always included.
  void analyze(int n, const List<std::pair<int, int>>& entries);

  Slot slot(int i, int j) const;
  /// Entries of A, to be set to zero and summed before factor(), which overwrites them.
  List<double>& values() { return values_; }

  /// Factors A and returns the number of rows left out. A row whose pivot is below `least` times
  /// its diagonal entry of A depends on earlier rows and is left out: its solution is 0.
  int factor(double least);
  bool is_left_out(std::size_t place) const { return left_out_[place] != 0; }
  /// Smallest pivot of the last factor(), as a share of its diagonal entry; 1 without rows.
  double smallest_pivot() const { return smallest_pivot_; }

  /// Makes factor() keep a row unless its pivot is rounding, whatever `least` is: its pivot is
  /// small by a mass ratio, not since the row depends on others.
  void keep(std::size_t place) { is_kept_[place] = any_kept_ = 1; }
  bool is_kept(std::size_t place) const { return is_kept_[place] != 0; }
  /// Undoes all calls of keep().
  void keep_none();

  /// Visits all data that solve() and the next factor() depend on; see engine/support/memory.h.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.values_);
    visit(self.inverse_diagonal_);
    visit(self.smallest_pivot_);
    visit(self.left_out_);
    visit(self.is_kept_);
    visit.beside(self.any_left_out_);
    visit.beside(self.any_kept_);
  }

  /// Returns the place of row i in the elimination, and in the vectors of solve().
  int place(int i) const { return order_[static_cast<std::size_t>(i)]; }
  /// Replaces b by A⁻¹ b, both in the order of the elimination.
  void solve(double* b) const;

 private:
  /// Columns of one dense block of L, with D on its diagonal. Its own rows come first, then the
  /// rows below.
  struct Supernode {
    std::size_t first, columns;  // first column in the elimination, number of columns
    std::size_t rows;            // number of rows of the block
    std::size_t rows_at;         // index of its rows in row_of_
    std::size_t block;           // index of the block in values_, by columns
    std::size_t updates_end;     // end of its updates in updates_
  };
  /// Update of this supernode by an earlier one: its rows from `begin` on, the first `columns` of
  /// which are columns here.
  struct Update {
    std::size_t from, begin, columns;
    std::size_t targets;  // index in targets_ of the places of its rows in this block
  };

  void find_parents(const List<List<int>>& below);
  void join_all();
  void join_columns(const List<List<int>>& below);
  void find_updates();
  std::size_t row_in_block(const Supernode& node, std::size_t row) const;
  int factor_forest(double least);
  int factor_supernodes(double least);
  void subtract(const Update& update, const Supernode& node);
  int eliminate(const Supernode& node, double least);
  double leave_out(std::size_t k, double entry, double pivot, int* left_out);
  void solve_forest(double* b) const;
  void solve_supernodes(double* b) const;

  std::size_t n_ = 0;
  List<int> order_;  // place in the elimination of each original row
  // Whether there are no loops and no repeated entries, so that a column of L has at most one
  // entry.
  bool is_forest_ = true;
  List<std::size_t> parent_;        // for a forest: row of the entry in each column; n_: none
  List<Supernode> supernodes_;      // for other patterns
  List<std::size_t> supernode_of_;  // supernode of each column
  List<std::size_t> row_of_;        // rows of all blocks, one after the other
  List<Update> updates_;            // updates, in the order of their targets
  List<std::size_t> targets_;
  // Entries of A before factor(): for a forest the diagonal, then the entries below it; otherwise
  // the blocks.
  List<double> values_;
  List<double> inverse_diagonal_;
  List<double> work_;  // scratch for a forest
  double smallest_pivot_ = 1.0;
  bool any_left_out_ = false;
  List<char> left_out_, is_kept_;  // flags by place
  char any_kept_ = 0;
};

}  // namespace constraint_sim::engine
