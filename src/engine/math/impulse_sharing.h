#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/cone_problem.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Finds how far the rates of contacts depend on the sharing of impulses among them.
///
/// Rows depend on each other where there are impulses z with G z = 0. Such z, added to a solution,
/// change no rate of a loaded row: of a normal, of a tangent of a sticking contact, or of a row
/// within its bounds. They do change rates where contacts slip. The friction of a slipping contact
/// is in proportion to its normal impulse, F = n − μ û, and slips may have different directions, as
/// under a box that slides and rotates on four corners. Solutions are found by adding the
/// projections of unit impulses on all z until a row is at its bound. Slip directions count as
/// constant, which is exact to first order in the change. Keeps its storage.
class ImpulseSharing {
 public:
  /// Returns the largest change of u = b + A p between the solution `p` and other solutions of the
  /// problem.
  double indeterminate_rate(const ConeProblem& problem, const List<double>& p);

 private:
  /// Loaded contact or row. Its impulses begin at `column`.
  struct LoadedRow {
    std::size_t column;
    std::size_t size;  ///< impulses: 3 of a sticking contact, 1 otherwise
    double friction;
    Eigen::Vector2d direction;  ///< slip direction; zero without slip
    double least, most;         ///< bounds of the first impulse
  };

  bool list_loaded(const ConeProblem& problem, const List<double>& p);
  void set_matrix(const ConeProblem& problem);
  bool find_direction(std::size_t unit);
  double change_along(double sign, const ConeProblem& problem, const List<double>& p) const;
  double distance_to_bound(const LoadedRow& row, double sign, const List<double>& p) const;

  List<double> u_;  // rates
  List<LoadedRow> rows_;
  List<std::size_t> unknowns_;  // columns of the impulses that z may change
  List<double> scale_;          // per unknown
  List<double> matrix_, z_;     // G by columns; impulses without effect on loaded rows
  List<double> least_;          // scratch
  LeastNormSolver factors_;
};

}  // namespace constraint_sim::engine
