#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/body_cone_problem.h"
#include "engine/math/list.h"
#include "engine/math/small_cone_solver.h"
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
/// Where this converges slowly and rows are few, SmallConeSolver takes over. Impulses of redundant
/// rows get the least norm of x that gives the bodies the same motion, with each contact remaining
/// open, sticking or slipping in its direction, so that equal corners of a box carry equal loads.
/// Keeps its storage, and the order of elimination while bodies and their neighbours stay.
class BodyConeSolver {
 public:
  /// Quality of a solution. The residual of a contact is that of the natural map,
  /// ‖p − P_K(p − (u + μ ‖u_t‖ n)/a)‖ a with a the mean diagonal entry of its block of A.
  struct Outcome {
    double residual = 0.0;  ///< largest of all rows, as rates
    double scale = 0.0;     ///< largest |b|
    int iterations = 0;     ///< 0 where the given impulses were a solution

    bool is_within(double tolerance) const { return residual <= tolerance * scale; }
  };
  /// When a solution is good enough.
  struct Goal {
    double tolerance;         ///< residual at which iterations end, as a share of the largest |b|
    double sufficient = 0.0;  ///< residual at which they end after kSettling iterations, as a rate
    int most_iterations;      ///< with either setting; fewer where the matrix is large
  };

  /// Solves from the impulses in `p` to the goal, or gives up; `p` is then the best of all
  /// iterations.
  Outcome solve(const BodyConeProblem& problem, const Goal& goal, StopFlag stop, List<double>* p);

 private:
  using Twist = BodyConeProblem::Twist;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  /// A single row, or the three rows of a contact.
  struct Block {
    std::size_t first, size;  ///< rows
    double diagonal;          ///< mean diagonal entry of its block of A
    double d;                 ///< 1/√diagonal; 0 where no impulse moves a body
    std::size_t edges;        ///< begin of the edges between its bodies in edge_of_
    Eigen::Matrix3d inverse_weight = Eigen::Matrix3d::Zero();  ///< W⁻¹
  };
  struct Pair {
    std::pair<int, int> bodies;
    std::size_t place;  ///< in edge_of_
  };
  /// Constants of a run of iterations.
  struct Setting {
    double relaxation, eta;
  };
  /// Change of the iterates by an iteration, relative to their size.
  struct Change {
    double primal = 0.0, dual = 0.0;
  };

  void set(const BodyConeProblem& problem);
  void analyze();
  void factor();
  void add_to_matrix(const Block& block);
  void apply_inverse(const List<double>& r, List<double>* x);
  void set_velocities(const List<double>& p);
  double rate(std::size_t row) const;
  double residual(const List<double>& p);
  double residual(const Block& block, const List<double>& p) const;
  double largest_eigenvalue();
  void start(const List<double>& p);
  void set_weights(const Setting& setting, double rho);
  Change iterate(const Setting& setting, double rho);
  void run(const Setting& setting, double aim, double sufficient, int most_iterations,
           StopFlag stop, Outcome* outcome, List<double>* p);
  void solve_small(StopFlag stop, Outcome* outcome, List<double>* p);
  void share(double aim, Outcome* outcome, List<double>* p);
  bool free_directions(const List<double>& p);
  double way_to_bound(const Block& block, const List<double>& p) const;

  const BodyConeProblem::Row& row(std::size_t i) const { return problem_->rows[i]; }
  std::size_t parts_begin(std::size_t i) const { return i == 0 ? 0 : row(i - 1).parts_end; }
  bool is_contact(const Block& block) const {
    return row(block.first).kind == BodyConeProblem::Kind::kNormal;
  }
  bool has_bounds(const Block& block) const {
    return row(block.first).least > -kInfinity || row(block.first).most < kInfinity;
  }

  const BodyConeProblem* problem_ = nullptr;
  List<Block> blocks_;
  List<std::size_t> edge_of_;  // edges between the bodies of each block
  List<Pair> pairs_;           // pairs of bodies while edges are listed
  List<char> is_held_;         // blocks that sharing leaves as they are
  List<double> x_, y_, z_, r_, best_, tried_;

  // K, by bodies and edges, which are pairs of bodies that a block has in common.
  List<std::pair<int, int>> edges_, analyzed_edges_;
  std::size_t analyzed_bodies_ = 0;
  List<Matrix6> on_bodies_, on_edges_;
  List<SparseLdlt::Slot> slots_;
  SparseLdlt factors_;
  SmallConeSolver small_;
  List<Twist> v_;  // M⁻¹ Jᵀ p
  List<double> right_;
};

}  // namespace constraint_sim::engine
