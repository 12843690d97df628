#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/body_cone_blocks.h"
#include "engine/math/body_cone_problem.h"
#include "engine/math/body_cone_sweeps.h"
#include "engine/math/body_equations.h"
#include "engine/math/condensed_cones.h"
#include "engine/math/list.h"
#include "engine/math/proximal_newton.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::engine {

/// Solves a BodyConeProblem by the alternating direction method of multipliers (Boyd et al., Found.
/// Trends Mach. Learn. 3 (2011) 1; for contacts Carpentier et al., Robotics: Science and Systems
/// 2024). With D scaling the diagonal blocks of A to a trace of the number of their rows, x = D⁻¹ p
/// and s = μ ‖z_t‖ n, an iteration is
///   x = (D A D + W)⁻¹ r,  r = −D b − s + η x + ρ y + z,  W = ρ + η
///   y = P_K(x − z/ρ),     z ← z − ρ (x − y).
/// Rows without bounds have r = −D b + ε x and W = ε instead, and y = x. The inverse is that of a
/// matrix over bodies, sparse in the graph of contacts: with K = M + Jᵀ D W⁻¹ D J and K g = Jᵀ D
/// W⁻¹ r it is x = W⁻¹ (r − D J g). Redundant rows do no harm: K is positive definite.
///
/// ProximalNewton takes over where 50 iterations are not enough, and comes before them where
/// CondensedCones fit the problem. Impulses of redundant rows get
/// the least norm of x that gives the bodies the same motion, with each contact remaining open,
/// sticking or slipping in its direction, so that equal corners of a box carry equal loads. Where
/// a looser solution is good enough, BodyConeSweeps come first; their impulses are not the least.
/// Keeps its storage, and the order of elimination while bodies and their neighbours stay.
class BodyConeSolver {
 public:
  /// Quality of a solution, see BodyConeBlocks::residual().
  struct Outcome {
    double residual = 0.0;  ///< largest of all rows, as rates
    double enough = 0.0;    ///< residual that is good enough
    double scale = 0.0;     ///< largest |b|
    int iterations = 0;     ///< 0 where the given impulses were a solution

    bool is_within(double tolerance) const { return residual <= tolerance * scale; }
  };
  /// When a solution is good enough.
  struct Goal {
    double tolerance;         ///< residual at which iterations end, as a share of the largest |b|
    double sufficient = 0.0;  ///< residual at which Newton's method ends as well, as a rate
    int most_iterations;      ///< most of either method; fewer where the matrix is large
    /// Residual that is good enough where all rows are contacts or have bounds, as a rate, and as a
    /// share of the residual of the given impulses, which is what a step changes; the smaller
    /// counts.
    double loose = 0.0, share = 0.0;
    bool is_shared = true;  ///< whether impulses of redundant rows get the least norm
  };

  /// Solves from the impulses in `p` to the goal, or gives up; `p` is then the best of all
  /// iterations.
  Outcome solve(const BodyConeProblem& problem, const Goal& goal, StopFlag stop, List<double>* p);

 private:
  using Twist = BodyConeProblem::Twist;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Block = BodyConeBlocks::Block;
  /// Change of the iterates by an iteration, relative to their size.
  struct Change {
    double primal = 0.0, dual = 0.0;
  };

  /// Directions in which sharing may change the impulse of a block: all, along itself, none.
  enum class Freedom : char { kAll, kAlong, kNone };

  bool has_free_rows() const;
  bool has_heavy_bodies() const;
  void solve_by_newton(const ProximalNewton::Goal& goal, StopFlag stop,
                       ProximalEquations* equations, Outcome* outcome, List<double>* p);
  void analyze();
  void factor();
  void add_to_matrix(const Block& block, const Eigen::Matrix3d& inverse_weight);
  void apply_inverse(const List<double>& r, List<double>* x);
  double largest_eigenvalue();
  void start(const List<double>& p);
  void set_weights(double rho);
  Change iterate(double rho);
  void alternate(double aim, int most, StopFlag stop, Outcome* outcome, List<double>* p);
  void share(double aim, Outcome* outcome, List<double>* p);
  void set_freedoms(const List<double>& p, double residual);
  bool set_free_weights(const List<double>& p);
  double share_to_bound(std::size_t block, const List<double>& p) const;
  void lose_freedoms(double share, const List<double>& p);

  const BodyConeProblem& problem() const { return blocks_.problem(); }
  const BodyConeProblem::Row& row(std::size_t i) const { return blocks_.row(i); }

  BodyConeBlocks blocks_;
  List<Freedom> freedoms_;  // one for each block
  List<double> x_, y_, z_, r_, best_, tried_;

  // K, by bodies and edges.
  List<Eigen::Matrix3d> inverse_weights_;  // W⁻¹, one for each block
  List<std::pair<int, int>> analyzed_edges_;
  std::size_t analyzed_bodies_ = 0;
  List<Matrix6> on_bodies_, on_edges_;
  List<SparseLdlt::Slot> slots_;
  SparseLdlt factors_;
  CondensedCones condensed_;
  BodyEquations all_rows_;
  ProximalNewton newton_;
  BodyConeSweeps sweeps_;
  List<Twist> v_;  // M⁻¹ Jᵀ p
  List<double> right_;
};

}  // namespace constraint_sim::engine
