#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/cone_problem.h"
#include "engine/math/interior_point.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/math/solve_effort.h"

namespace constraint_sim::engine {

/// Solves a ConeProblem by Newton's method (Alart and Curnier, Comput. Methods Appl. Mech. Eng. 92
/// (1991) 353): first from all pushed rows together, with p of least norm, then from the end of an
/// interior-point method, else from sweeps with exact solutions per contact (Jean, Comput. Methods
/// Appl. Mech. Eng. 177 (1999) 235). For a singular A, p is of least norm, or nearly so, with each
/// contact's block of A scaled to a trace of 3. Returns false without a solution up to rounding,
/// where convergence is too slow, or where `effort` is over.
class ConeSolver {
 public:
  /// Forgets solutions of the interior-point method. Until then they are tried for problems with
  /// the same contacts.
  void forget() { solutions_ = 0; }
  bool solve(const ConeProblem& problem, List<double>* p, SolveEffort* effort);

 private:
  /// Solution of the interior-point method.
  struct Known {
    List<ConeContact> contacts;
    double largest_rate = 0.0;
    List<double> p;
  };

  using Numbers = Eigen::Map<Eigen::VectorXd>;
  using ConstNumbers = Eigen::Map<const Eigen::VectorXd>;
  using Matrix = Eigen::Map<const Eigen::MatrixXd>;

  void set(const ConeProblem& problem);
  bool find_together(double* p);
  bool find_again(double* p, bool* is_known);
  bool find_inside(double* p);
  void keep(const double* p);
  bool is_strict(const double* p);
  bool find(double* p);
  bool sweep(bool back, double* p);
  void polish(double* p);
  void take_newton(bool is_of_least_norm, double* p);
  void write_newton_contact(Eigen::Index i, const double* p, double* J);
  double residual(const double* p);
  double rounding(const double* p) const;
  bool count_newton();
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
  InteriorPoint interior_point_;
  List<Known> known_;                                 // the latest solutions
  std::size_t solutions_ = 0;                         // since forget()
  List<double> swept_, tried_, x_, u_, off_, right_;  // scratch
};

/// Solves a single contact: A of 3×3, b of 3. Returns false where no normal impulse gives a normal
/// rate.
bool solve_contact(const Eigen::Matrix3d& A, const Eigen::Vector3d& b, const ConeContact& contact,
                   Eigen::Vector3d* p);

}  // namespace constraint_sim::engine
