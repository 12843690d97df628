#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/cone_problem.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Budget and cost of a solution. The unit is a substep of a body with a contact, 7 µs.
struct SolveEffort {
  double most = kInfinity;
  StopFlag stop = nullptr;
  double spent = 0.0;

  bool is_over() const { return spent > most || is_set(stop); }
};

/// Solves a ConeProblem by Newton's method (Alart and Curnier, Comput. Methods Appl. Mech. Eng. 92
/// (1991) 353): first from all pushed rows together, with p of least norm, else from sweeps with
/// exact solutions per contact (Jean, Comput. Methods Appl. Mech. Eng. 177 (1999) 235). For a
/// singular A, p is approximately of least norm, with each contact's block of A scaled to a trace
/// of 3. Returns false without a solution up to rounding, where convergence is too slow, or where
/// `effort` is over.
class ConeSolver {
 public:
  bool solve(const ConeProblem& problem, List<double>* p, SolveEffort* effort);
  /// Returns the cost of a step of Newton's method, in units of SolveEffort.
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
  /// Returns the rates u = b + A p.
  const double* rates(const double* p);
  const ConeContact& contact(Eigen::Index row) const {
    return scaled_.contacts[static_cast<std::size_t>(row / 3)];
  }
  std::size_t row_at(Eigen::Index i) const {
    return static_cast<std::size_t>(i - end_of_contacts());
  }
  double within(Eigen::Index i, double x) const;

  // Problem with the rates of each contact scaled to a block of A with a trace of 3, so that masses
  // of many orders become similar. Impulses are scaled inversely.
  ConeProblem scaled_;
  List<double> scale_;
  double largest_rate_ = 0.0;
  SolveEffort* effort_ = nullptr;
  LeastNormSolver factors_;
  List<double> swept_, tried_, x_, u_, off_, right_, stiff_A_, stiff_b_;  // scratch
};

/// Solves a single contact: A of 3×3, b of 3. Returns false where no normal impulse gives a normal
/// rate.
bool solve_contact(const Eigen::Matrix3d& A, const Eigen::Vector3d& b, const ConeContact& contact,
                   Eigen::Vector3d* p);

}  // namespace constraint_sim::engine
