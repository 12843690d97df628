#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/body_cone_blocks.h"
#include "engine/math/list.h"
#include "engine/math/proximal_equations.h"
#include "engine/math/row_elimination.h"

namespace constraint_sim::engine {

/// Equations of the contacts and rows with bounds of a BodyConeProblem alone, after RowElimination.
/// The motion is that of impulses w, with rates z = b̂ + Â w, and Newton's method solves w = P_K(x_k
/// − σ z). Keeps its storage.
class CondensedCones final : public ProximalEquations {
 public:
  /// Takes blocks, which must remain while the equations are used; returns false where they do not
  /// fit RowElimination.
  bool set(const BodyConeBlocks& blocks) { return rows_.set(blocks); }

  bool hold_shifts(bool is_held) override {
    is_held_ = is_held;
    return true;
  }
  void begin(const List<double>& p) override;
  void keep_start() override { start_ = w_; }
  void return_to_start() override { w_ = start_; }
  double slope() const override;
  Merit evaluate(double sigma, double share) override;
  void move() override { w_.swap(next_); }
  bool find_change(double sigma) override;
  double squared_distance() const override;
  void take() override;
  double residual() override;
  void keep() override { best_ = x_; }
  void get(List<double>* p) const override { rows_.expand(best_, p); }

 private:
  using Block = BodyConeBlocks::Block;

  bool solve_values();
  void multiply(const List<double>& x, List<double>* product) const;
  void set_rates(const List<double>& impulses);
  void set_shifts();
  ProximalImpulse impulse(std::size_t block, std::size_t at, double sigma, bool with_slope) const;

  RowElimination rows_;
  bool is_held_ = false;
  List<double> shifts_;                     // s, per block
  List<double> from_, x_, best_;            // x_k, x, and the impulses that were kept
  List<double> w_, start_, next_, change_;  // w, at the start of the step, and evaluated last
  List<double> z_, off_, gradient_, at_x_;  // z, w − x, Â (w − x), and Â x
  List<double> values_, solution_;          // matrix of Newton's method, by rows
  List<std::size_t> order_;                 // rows and columns of its factors
};

}  // namespace constraint_sim::engine
