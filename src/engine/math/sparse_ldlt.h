#pragma once

#include <cstddef>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Factors A = L D Lᵀ of a symmetric positive semidefinite matrix whose pattern stays and whose
/// values change. The pattern is ordered for little fill once; after that nothing is allocated.
/// Without loops that is leaves first, and there is no fill. Else it is approximate minimum degree,
/// and neighbouring columns of nearly the same pattern are kept and worked on as one dense block, a
/// supernode: Davis, Rajamanickam, Sid-Lakhdar, "A survey of direct methods for sparse linear
/// systems", Acta Numerica 25 (2016), section 9.
class SparseLdlt {
 public:
  /// Where an entry of A goes in values().
  using Slot = std::size_t;

  /// Takes the pattern of an n × n matrix: its entries (i, j), either triangle, repetitions
  /// allowed. The diagonal is always there.
  void analyze(int n, const List<std::pair<int, int>>& entries);

  Slot slot(int i, int j) const;
  /// Entries of A, to be set to zero and summed up before factor(), which overwrites them.
  List<double>& values() { return values_; }

  /// Factors. A row whose pivot falls below `least` times its diagonal entry of A depends on the
  /// rows before it and is left out: its solution is 0. Returns how many rows are left out.
  int factor(double least);
  bool is_left_out(std::size_t place) const { return left_out_[place] != 0; }
  /// Smallest pivot that factor() met, as a share of its diagonal entry; 1 without rows.
  double smallest_pivot() const { return smallest_pivot_; }

  /// A row to be kept by factor() unless its pivot is below round-off, whatever `least` is: the
  /// pivot is small because of a mass ratio, and not because the row depends on others.
  void keep(std::size_t place) { is_kept_[place] = any_kept_ = 1; }
  bool is_kept(std::size_t place) const { return is_kept_[place] != 0; }
  /// Forgets all of keep().
  void keep_none();

  /// Visits all that solve() and the next factor() go by, as engine/memory.h says.
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

  /// Where row i stands in the elimination, and so in what solve() takes.
  int place(int i) const { return order_[static_cast<std::size_t>(i)]; }
  /// Replaces b by A⁻¹ b, both in the order of the elimination.
  void solve(double* b) const;

 private:
  /// Columns of one dense block of L, D on its diagonal: first their own rows, then those below.
  struct Supernode {
    std::size_t first, columns;  // in the elimination
    std::size_t rows;            // of the block
    std::size_t rows_at;         // where they are in row_of_
    std::size_t block;           // where the block is in values_, column by column
    std::size_t updates_end;     // of updates_ of this one
  };
  /// What a supernode before takes off the rows of this one: its rows from `begin` on, the first of
  /// them columns here.
  struct Update {
    std::size_t from, begin, columns;
    std::size_t targets;  // where their rows in this block are in targets_
  };

  void find_parents(const List<List<int>>& below);
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
  List<int> order_;             // of original rows: place in the elimination
  bool is_forest_ = true;       // no loops, no entry twice: no column of L has more than one entry
  List<std::size_t> parent_;    // of a forest: the row of each column; n_ where there is none
  List<Supernode> supernodes_;  // otherwise
  List<std::size_t> supernode_of_;  // of columns
  List<std::size_t> row_of_;        // of all blocks, one after the other
  List<Update> updates_;            // in the order of what they update
  List<std::size_t> targets_;
  // A before factor(). Of a forest the diagonal, then the entry below it; otherwise the blocks.
  List<double> values_;
  List<double> inverse_diagonal_;
  List<double> work_;  // of a forest
  double smallest_pivot_ = 1.0;
  bool any_left_out_ = false;
  List<char> left_out_, is_kept_;  // by place
  char any_kept_ = 0;
};

}  // namespace constraint_sim::engine
