#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/body_cone_blocks.h"
#include "engine/math/frontal_lu.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves a BodyConeProblem by proximal steps (Rockafellar, SIAM J. Control Optim. 14 (1976) 877).
/// With x = D⁻¹ p and z = D (u + μ ‖u_t‖ n) at velocities v, a step from x_k is the solution of
///   M v = Jᵀ D x,  x = P_K(x_k − σ z),
/// by Newton's method. Its matrix over bodies, M + σ Jᵀ D P_K′ D (1 + μ n t̂ᵀ) J with t̂ the
/// direction of u_t, is sparse, unsymmetric, and regular with redundant rows, too. The larger σ,
/// the nearer is x to a solution, and the smaller is the set of starts from which Newton's method
/// converges: σ grows after steps that were easy, and falls after steps that failed. Keeps its
/// storage, and the order of elimination while bodies and their neighbours stay.
class ProximalNewton {
 public:
  struct Goal {
    double residual;  ///< at which the steps end, as a rate
    int most_steps;   ///< most steps of Newton's method
  };

  /// Improves `p`, whose residual is `residual`, until the goal is reached; returns the residual.
  /// Edges of `blocks` must be listed.
  double solve(const BodyConeBlocks& blocks, const Goal& goal, double residual, StopFlag stop,
               List<double>* p);
  /// Number of steps of Newton's method in the last solution.
  int steps() const { return steps_; }

 private:
  using Twist = BodyConeProblem::Twist;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Block = BodyConeBlocks::Block;
  /// How a proximal step ends; kEasy after few iterations.
  enum class End { kSolved, kEasy, kHard, kFailed };

  void analyze();
  End step(const Goal& goal, double sigma, StopFlag stop, List<double>* p);
  double evaluate(const List<Twist>& v, double sigma, bool with_matrix);
  void evaluate_contact(const Block& block, const List<Twist>& v, double sigma, bool with_matrix);
  void evaluate_single(const Block& block, const List<Twist>& v, double sigma, bool with_matrix);
  void add_to_matrix(const Block& block, const Eigen::Matrix3d& C);
  bool find_change();
  void consider(List<double>* p);

  const BodyConeBlocks* blocks_ = nullptr;
  int steps_ = 0;
  double residual_ = 0.0;  // least of all iterates

  List<double> from_, x_, tried_;  // x_k, x, and impulses whose residual is evaluated
  List<Twist> v_, start_, next_, at_p_;
  List<Twist> off_;  // M v − Jᵀ D x
  // Matrix: its values, and the places of rows of the 6×6 blocks of bodies and edges in them.
  FrontalLu factors_;
  List<double> values_, change_;
  List<std::size_t> slots_;
  std::size_t analyzed_bodies_ = 0;
  List<std::pair<int, int>> analyzed_edges_;
};

}  // namespace constraint_sim::engine
