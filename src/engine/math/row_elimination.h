#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>

#include "engine/math/body_cone_blocks.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::engine {

/// Eliminates the rows without bounds of a BodyConeProblem, with rows scaled by D. In blocks of
/// free and bounded rows of D A D, without the softness of bounded rows,
///   Â = A_BB − A_BF A_FF⁻¹ A_FB,  b̂ = b_B − A_BF A_FF⁻¹ b_F
/// is dense: the elimination is for few bounded rows on bodies that many free rows join, as a robot
/// on its feet. Free rows that depend on others get no impulse. Bounded rows that free rows hold
/// have zeros in Â. Keeps its storage, the order of elimination while the rows stay, and the
/// factors while A_FF stays, as for the corrections of a step.
class RowElimination {
 public:
  using Block = BodyConeBlocks::Block;

  /// Sets Â and b̂; returns false where that is not worth its cost: with many bounded rows, few free
  /// ones, or many rows on a body, as on the hub of a wheel, which make A_FF dense.
  bool set(const BodyConeBlocks& blocks);

  /// Number of bounded rows.
  std::size_t size() const { return bounded_.size(); }
  /// Blocks of the bounded rows; rows are numbered in the order of these blocks.
  const List<Block>& bounded() const { return bounds_; }
  const BodyConeBlocks& blocks() const { return *blocks_; }
  /// Â by rows, and b̂.
  const List<double>& A() const { return A_; }
  const List<double>& b() const { return b_; }
  /// Returns the entries of bounded rows in impulses p of all rows, over D.
  void pick(const List<double>& p, List<double>* x) const;
  /// Sets impulses of all rows from x of the bounded ones: x_F = −A_FF⁻¹ (b_F + A_FB x).
  void expand(const List<double>& x, List<double>* p) const;

 private:
  using Twist = BodyConeProblem::Twist;
  /// Place of a row of the problem, and its scale D.
  struct Place {
    enum Kind { kNone, kFree, kBounded } kind = kNone;
    std::size_t index = 0;  ///< in free_ or bounded_
    double scale = 0.0;
  };
  /// Part of a row on a body.
  struct Part {
    Place place;
    Twist J, inverse;  ///< scaled Jacobian, and M⁻¹ Jᵀ
  };

  bool list_rows();
  bool list_parts();
  template <class Visit>
  void visit_pairs(const Visit& visit) const;
  void analyze();
  void factor();
  void solve_couplings();
  void eliminate();

  const BodyConeBlocks* blocks_ = nullptr;
  List<Place> places_;                // per row
  List<std::size_t> free_, bounded_;  // rows
  List<Block> bounds_;                // blocks of bounded rows
  List<Part> parts_;                  // body after body
  List<std::size_t> parts_end_;       // per body
  // A_FF: its pattern, and the slots of its entries.
  List<std::pair<int, int>> entries_, analyzed_;
  List<SparseLdlt::Slot> slots_;
  SparseLdlt eliminated_;
  List<double> matrix_, factored_;  // A_FF, and the one that has factors
  // A_BF and A_BF A_FF⁻¹, by rows, and A_FF⁻¹ D b, in the order of the elimination.
  List<double> couplings_, solved_, free_rate_;
  // A_BF and A_BF A_FF⁻¹ of the problem before: rows that come again need no solution.
  List<double> known_couplings_, known_solved_;
  List<std::size_t> coupled_;
  List<double> A_, b_;  // Â by rows, and b̂
};

}  // namespace constraint_sim::engine
