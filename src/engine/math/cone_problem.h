#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// How a contact of a ConeProblem acts.
struct ConeContact {
  double friction = 0.0;  ///< μ
  bool slips = false;     ///< already, so that its friction has a direction
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();  ///< unit, of the slip
};

/// Between which bounds a row of a ConeProblem acts.
struct BoundedRow {
  double least = 0.0, most = 0.0;
};

/// Contacts with Coulomb's friction: three numbers each, along the normal and two tangents; then
/// rows with bounds, one number each. u = b + A p, and for each contact
///   u_n ≥ 0, p_n ≥ 0, one of them 0; ‖p_t‖ ≤ μ p_n, and p_t = −μ p_n u_t/‖u_t‖ where u_t ≠ 0,
///   or of one that slips p_t = −μ p_n times its direction;
/// and for each row
///   u = 0, or p at the least and u ≥ 0, or p at the most and u ≤ 0.
struct ConeProblem {
  List<double> A;  ///< symmetric, positive semidefinite
  List<double> b;
  List<ConeContact> contacts;
  List<BoundedRow> rows = {};
};

/// What a solution may take, and has taken. The unit is a substep of one body with one contact, 7
/// µs.
struct SolveEffort {
  double most = kInfinity;
  StopFlag stop = nullptr;
  double spent = 0.0;

  bool is_over() const { return spent > most || is_set(stop); }
};

/// Solves it by Newton's method on which contacts are open, stick and slip (Alart and Curnier,
/// Comput. Methods Appl. Mech. Eng. 92 (1991) 353): at first with all that is pushed together, each
/// step to the p of least norm. Where that does not get there it is begun from sweeps over the
/// contacts, each solved exactly (Jean, Comput. Methods Appl. Mech. Eng. 177 (1999) 235), and over
/// the rows. Where A is singular p is about the one of least norm, rates of each contact scaled to
/// a trace of 3 of its A. False where it does not get there: it has no solution, or friction and
/// many contacts make it take too long, or `effort` is over. A residual of rounding is none.
class ConeSolver {
 public:
  bool solve(const ConeProblem& problem, List<double>* p, SolveEffort* effort);
  /// What a step of Newton's method costs, as SolveEffort has it.
  static double cost_of_a_step(std::size_t rows);

 private:
  using Numbers = Eigen::Map<Eigen::VectorXd>;
  using ConstNumbers = Eigen::Map<const Eigen::VectorXd>;
  using Matrix = Eigen::Map<const Eigen::MatrixXd>;

  void set(const ConeProblem& problem);
  bool find_together(double* p);
  bool is_strict(const double* p);
  bool find(double* p);
  bool sweep(bool back, double* p);
  void polish(double* p);
  void take_newton(bool is_of_least_norm, double* p);
  void write_newton_contact(Eigen::Index i, const double* p, double* J);
  double residual(const double* p);
  double rounding(const double* p) const;
  bool count_newton();
  bool find_with_compliance(double compliance, double* p);
  void start(double* p) const;
  void unscale(const ConeProblem& problem, double* p) const;

  Eigen::Index size() const { return static_cast<Eigen::Index>(scaled_.b.size()); }
  Eigen::Index end_of_contacts() const {
    return 3 * static_cast<Eigen::Index>(scaled_.contacts.size());
  }
  Matrix matrix() const { return {scaled_.A.data(), size(), size()}; }
  /// Rates u = b + A p.
  const double* rates(const double* p);
  const ConeContact& contact(Eigen::Index row) const {
    return scaled_.contacts[static_cast<std::size_t>(row / 3)];
  }
  std::size_t row_at(Eigen::Index i) const {
    return static_cast<std::size_t>(i - end_of_contacts());
  }
  double within(Eigen::Index i, double x) const;

  // The problem with the rates of each contact scaled so that its A has a trace of 3: masses of
  // many orders are then alike. What is solved for is scaled the other way.
  ConeProblem scaled_;
  List<double> scale_;
  double largest_rate_ = 0.0;
  SolveEffort* effort_ = nullptr;
  LeastNormSolver factors_;
  List<double> swept_, tried_, x_, u_, off_, right_, stiff_A_, stiff_b_;  // scratch
};

/// The impulse of one contact on its own: A of 3×3, b of 3. False where no impulse along the normal
/// moves it along the normal.
bool solve_contact(const Eigen::Matrix3d& A, const Eigen::Vector3d& b, const ConeContact& contact,
                   Eigen::Vector3d* p);

}  // namespace constraint_sim::engine
