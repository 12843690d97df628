#pragma once

#include <array>
#include <cstddef>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves unsymmetric systems A x = b of bodies and the rows between them, of any graph, by a
/// multifrontal LU (Duff & Reid, SIAM J. Sci. Stat. Comput. 5 (1984) 633; Davis, Rajamanickam,
/// Sid-Lakhdar, Acta Numerica 25 (2016), section 11). The pattern is symmetric and constant. Bodies
/// are ordered once for little fill; rows are eliminated with the first of their bodies that has
/// room, or with the last. Unknowns without a sufficient pivot in a front are delayed to its
/// parent, so singular blocks of a regular matrix do no harm. Factors are reused while refinement
/// converges fast. Allocates only while arrays grow.
class FrontalLu {
 public:
  /// Unknowns of a body, beginning with `first`.
  struct Body {
    int first = 0;
    int dofs = 0;
  };
  /// Rows, with as many unknowns, that couple with one body or two, and the two bodies with each
  /// other. With up to four bodies, pairs with `more` are coupled by other links, if at all.
  struct Link {
    int first = 0;
    int rows = 0;
    int body = -1;
    int other = -1;                   ///< -1: the world
    std::array<int, 2> more{-1, -1};  ///< third and fourth body, or -1
  };

  void analyze(const List<Body>& bodies, const List<Link>& links);
  /// Number of entries; solve() takes their values row by row.
  std::size_t entries() const { return column_.size(); }
  std::size_t slot(int row, int column) const;

  /// Calls act(row, column) for each entry.
  template <class Act>
  void for_entries(const Act& act) const {
    for (std::size_t i = 0; i < n_; ++i)
      for (std::size_t s = row_begin_[i]; s < row_begin_[i + 1]; ++s) act(i, column_[s]);
  }

  /// Returns the largest entry of b − A x, as a share of the largest sum of |terms|.
  double residual(const double* values, const double* b, const double* x);
  /// Replaces b by A⁻¹ b; false where A is singular.
  bool solve(const double* values, double* b);
  /// Drops the factors, so that the next solution depends on its matrix alone.
  void forget() { has_factors_ = false; }

 private:
  static double at_last(double residual, double share, int steps);

  /// A dense matrix by rows. Its unknowns are first delayed ones of children, then its own, which
  /// the front may eliminate, then its border: unknowns of later fronts that couple with them.
  struct Front {
    std::size_t own = 0, border = 0;
    std::size_t unknowns = 0;         // index in unknown_ of its own unknowns, then its border
    std::size_t entries_end = 0;      // end in entry_ of the entries of A that first appear here
    std::size_t children_end = 0;     // end in child_
    std::size_t place_in_parent = 0;  // index in place_ of the places of its border in the parent
    bool is_root = false;
  };
  /// Result of the last factorization of a front: U with `size` columns and L below, each with
  /// `pivots`.
  struct Factor {
    std::size_t size = 0, pivots = 0;
    std::size_t delayed = 0;  // number of unknowns delayed to the parent
    std::size_t values = 0;   // index in factor_
    std::size_t indices = 0;  // index in index_ of its rows, then its columns
    std::size_t block = 0;    // index in stack_ of the block for the parent
  };
  struct Entry {
    std::size_t slot;
    std::size_t row, column;  // place in the front
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
  List<std::size_t> row_begin_, column_;  // pattern of A
  List<Front> fronts_;                    // fronts, children before parents
  List<std::size_t> unknown_, child_, place_;
  List<Entry> entry_;

  List<Factor> factors_;
  List<double> factor_, stack_;
  List<std::size_t> index_;
  std::size_t factor_end_ = 0, stack_end_ = 0, index_end_ = 0;
  List<double> solution_, residual_, change_;
  List<double> front_;  // gathered vector of the largest front
  int worthwhile_ = 0;  // number of refinement steps that cost less than new factors
  bool has_factors_ = false;
};

}  // namespace constraint_sim::engine
