#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>

#include "engine/math/body_cone_blocks.h"
#include "engine/math/frontal_lu.h"
#include "engine/math/list.h"
#include "engine/math/proximal_equations.h"

namespace constraint_sim::engine {

/// Equations of all rows of a BodyConeProblem, with velocities v of the bodies as the motion:
/// M v = Jᵀ D x. The matrix of Newton's method, M + σ Jᵀ D P_K′ D (1 + n s′) J with s′ the
/// derivative of s, is sparse, unsymmetric, and regular with redundant rows, too. Keeps its
/// storage, and the order of elimination while bodies and their neighbours stay.
class BodyEquations final : public ProximalEquations {
 public:
  /// Takes blocks whose edges are listed, and which must remain while the equations are used.
  void set(const BodyConeBlocks& blocks);

  bool hold_shifts(bool is_held) override { return !is_held; }
  void begin(const List<double>& p) override;
  void keep_start() override { start_ = v_; }
  void return_to_start() override { v_ = start_; }
  double slope() const override { return 0.0; }
  Merit evaluate(double sigma, double share) override;
  void move() override { v_.swap(next_); }
  bool find_change(double sigma) override;
  double squared_distance() const override;
  void take() override { from_ = x_; }
  double residual() override;
  void keep() override { best_.swap(tried_); }
  void get(List<double>* p) const override { *p = best_; }

 private:
  using Twist = BodyConeProblem::Twist;
  using Block = BodyConeBlocks::Block;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;

  ProximalImpulse impulse(std::size_t block, const List<Twist>& v, double sigma,
                          bool with_slope) const;
  void set_inertia();
  void add_to_matrix(const Block& block, const Eigen::Matrix3d& C);

  const BodyConeBlocks* blocks_ = nullptr;
  List<double> from_, x_, tried_, best_;  // x_k, x, and impulses
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
