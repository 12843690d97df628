#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/body_cone_blocks.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves a BodyConeProblem by sweeps that solve one block after the other (projected Gauss-Seidel
/// method), with nonlinear conjugate directions between the sweeps (Silcowitz, Niebe and Erleben,
/// Vis. Comput. 26 (2010) 893). Quick where blocks hardly depend on one another, as in heaps that
/// move; hopeless in tall stacks, where the sweeps end early. Keeps its storage.
class BodyConeSweeps {
 public:
  /// Improves `p`, whose residual is `residual`, until its residual is at most `enough`, or gives
  /// up; returns the residual. See BodyConeBlocks::residual().
  double solve(const BodyConeBlocks& blocks, double enough, double residual, StopFlag stop,
               List<double>* p);
  /// Number of sweeps in the last solution.
  int sweeps() const { return sweeps_; }

 private:
  using Twist = BodyConeProblem::Twist;
  using Block = BodyConeBlocks::Block;

  void prepare();
  double sweep();
  Eigen::Vector3d impulse_of_contact(const Block& block, const Eigen::Matrix3d& A) const;
  void go_on_in_direction();

  const BodyConeBlocks* blocks_ = nullptr;
  int sweeps_ = 0;
  List<Twist> responses_;           // M⁻¹ Jᵀ of each part
  List<Eigen::Matrix3d> matrices_;  // A of each contact, in the order of the blocks
  List<double> p_, from_, direction_;
  List<Twist> v_, v_from_, v_direction_;  // M⁻¹ Jᵀ of the three
  double square_ = 0.0;                   // energy of the last change by a sweep
};

}  // namespace constraint_sim::engine
