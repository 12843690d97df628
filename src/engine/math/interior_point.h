#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/cone_problem.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/math/solve_effort.h"

namespace constraint_sim::engine {

/// Solves a ConeProblem by a primal-dual interior-point method: Newton's method with a predictor
/// and a corrector (Mehrotra, SIAM J. Optim. 2 (1992) 575) in the Jordan algebra of second-order
/// cones (Alizadeh and Goldfarb, Math. Program. 95 (2003) 3), with ‖u_t‖ in the equations (De Saxcé
/// and Feng, Math. Comput. Model. 28 (1998) 225).
class InteriorPoint {
 public:
  /// `problem`: with responses of the order of 1; `rate`: its largest rate. `compliance`: added to
  /// the response of each row to itself, so that a singular A has one solution, nearly of least
  /// norm.
  void begin(const ConeProblem& problem, double rate, double compliance);
  /// Goes on until products of impulses and rates, both over the largest rate, are at most `within`
  /// on average. Returns false where `effort` is over or the method does not converge, as without a
  /// solution.
  bool approach(double within, SolveEffort* effort);
  void write(double* p) const;

 private:
  /// Number of the equations: an impulse over its weight. Its rate is a row of the problem times
  /// the weight.
  struct Number {
    std::size_t row;
    double weight;
    bool is_slip = false;
    Eigen::Vector2d friction =
        Eigen::Vector2d::Zero();  ///< impulse of a slip for a normal impulse of 1
    bool is_fixed = false;
  };
  /// Contact that may stick. x is the impulse, and y the rate with a normal rate larger by μ ‖u_t‖;
  /// x_t = p_t/μ and y_t = μ u_t, so that ‖x_t‖ ≤ x_n and ‖y_t‖ ≤ y_n.
  struct Cone {
    Eigen::Index first;  ///< first of its numbers
    Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = x;
    Eigen::Vector3d dx = Eigen::Vector3d::Zero(), dy = dx;
    Eigen::Vector3d off = dx;  ///< y by the impulses, less y
  };
  /// Bound of the number of a slipping contact or of a row. x is the distance from the bound, and y
  /// the part of the rate that goes with it.
  struct Bound {
    Eigen::Index number;
    double sign;  ///< 1: least number, −1: largest
    double x, y = 1.0;
    double dx = 0.0, dy = 0.0;
  };

  using Numbers = Eigen::Map<Eigen::VectorXd>;
  using ConstNumbers = Eigen::Map<const Eigen::VectorXd>;
  using Matrix = Eigen::Map<Eigen::MatrixXd>;
  using ConstMatrix = Eigen::Map<const Eigen::MatrixXd>;

  void add_bounds(Eigen::Index number, double least, double most);
  void set_rates(const ConeProblem& problem, double compliance);
  void find_rates();
  double complementarity(double step) const;
  void set_matrix();
  void find_direction(double target, bool corrects);
  double longest_step() const;
  void take_step(double step);

  Eigen::Index size() const { return static_cast<Eigen::Index>(x_.size()); }

  double rate_ = 1.0;
  int steps_ = 0;
  List<Number> numbers_;
  List<Cone> cones_;
  List<Bound> bounds_;
  List<double> M_, q_;   // rates q + M x
  List<double> x_, dx_;  // numbers
  List<double> off_;     // errors of rates
  List<double> change_;  // change of rates
  LeastNormSolver factors_;
};

}  // namespace constraint_sim::engine
