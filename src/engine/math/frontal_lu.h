#pragma once

#include <array>
#include <cstddef>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves unsymmetric systems A x = b of bodies and the rows between them, of any graph: a
/// multifrontal LU (Duff & Reid, SIAM J. Sci. Stat. Comput. 5 (1984) 633; Davis, Rajamanickam,
/// Sid-Lakhdar, Acta Numerica 25 (2016), section 11). The pattern is symmetric and stays. Bodies
/// are ordered for little fill once; rows go with the first of their bodies that has room for them,
/// or the last. Pivots are taken within fronts, by rows, and by columns where a column has none of
/// sufficient size: what has none in a front is delayed to its parent, so that a singular block
/// of a regular matrix does no harm. Factors are kept as long as refinement with them converges
/// fast. Nothing is allocated once arrays have had their largest size.
class FrontalLu {
 public:
  /// Unknowns of a body, from `first` on.
  struct Body {
    int first = 0;
    int dofs = 0;
  };
  /// Rows, and as many unknowns, that couple with one body or two, and each of these with the
  /// other; or with up to four, whose pairs others couple where they do.
  struct Link {
    int first = 0;
    int rows = 0;
    int body = -1;
    int other = -1;                   ///< -1: the world
    std::array<int, 2> more{-1, -1};  ///< further ones, or -1
  };

  void analyze(const List<Body>& bodies, const List<Link>& links);
  /// Entries in the order of the values that solve() takes: row by row.
  std::size_t entries() const { return column_.size(); }
  std::size_t slot(int row, int column) const;

  /// Calls act(row, column) for each.
  template <class Act>
  void for_entries(const Act& act) const {
    for (std::size_t i = 0; i < n_; ++i)
      for (std::size_t s = row_begin_[i]; s < row_begin_[i + 1]; ++s) act(i, column_[s]);
  }

  /// Largest entry of b − A x, as a share of what it is the difference of.
  double residual(const double* values, const double* b, const double* x);
  static double at_last(double residual, double share, int steps);
  /// Replaces b by A⁻¹ b; false where A is singular.
  bool solve(const double* values, double* b);
  /// Drops the factors, so that the next solution depends on its matrix alone.
  void forget() { has_factors_ = false; }

 private:
  /// A dense matrix by rows: unknowns that it may eliminate, its own after those that its children
  /// have delayed, and those of later fronts that they couple with, its border.
  struct Front {
    std::size_t own = 0, border = 0;
    std::size_t unknowns = 0;         // where they are in unknown_; own, then border
    std::size_t entries_end = 0;      // of entry_: what of A is first needed here
    std::size_t children_end = 0;     // of child_
    std::size_t place_in_parent = 0;  // of the border, in place_
    bool is_root = false;
  };
  /// Of the last factorisation: U with `size` columns and L below, each with `pivots`.
  struct Factor {
    std::size_t size = 0, pivots = 0;
    std::size_t delayed = 0;  // to the parent
    std::size_t values = 0;   // in factor_
    std::size_t indices = 0;  // of rows, then of columns, in index_
    std::size_t block = 0;    // in stack_: what the parent gets
  };
  struct Entry {
    std::size_t slot;
    std::size_t row, column;  // of the front
  };
  struct Groups;

  void find_pattern(const List<Body>& bodies, const List<Link>& links);
  static Groups find_groups(const List<Body>& bodies, const List<Link>& links);
  static void find_borders(Groups* groups);
  static void join(Groups* groups);
  void make_fronts(const Groups& groups);
  void add_front(const Groups& groups, std::size_t g, const List<std::size_t>& children,
                 List<std::size_t>* place);

  bool factor(const double* values);
  void assemble(std::size_t f, const double* values);
  void add_child(std::size_t child, std::size_t delayed_at, std::size_t delayed, Factor* to);
  void store(std::size_t f);
  bool refine(const double* values, const double* b, int steps, double enough);
  void substitute(double* b, double* x);

  std::size_t n_ = 0;
  List<std::size_t> row_begin_, column_;  // pattern
  List<Front> fronts_;                    // children before parents
  List<std::size_t> unknown_, child_, place_;
  List<Entry> entry_;

  List<Factor> factors_;
  List<double> factor_, stack_;
  List<std::size_t> index_;
  std::size_t factor_end_ = 0, stack_end_ = 0, index_end_ = 0;
  List<double> solution_, residual_, change_;
  List<double> front_;  // of the longest front
  int worthwhile_ = 0;  // refinements that cost less than new factors
  bool has_factors_ = false;
};

}  // namespace constraint_sim::engine
