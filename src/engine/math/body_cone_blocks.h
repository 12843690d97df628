#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <utility>

#include "engine/math/body_cone_problem.h"
#include "engine/math/list.h"
#include "engine/math/proximal_equations.h"

namespace constraint_sim::engine {

/// Blocks of a BodyConeProblem, their scales and residuals, and the bodies that they connect. Keeps
/// its storage.
class BodyConeBlocks {
 public:
  using Twist = BodyConeProblem::Twist;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  /// A single row, or the three rows of a contact.
  struct Block {
    std::size_t first, size;  ///< rows
    double diagonal;          ///< mean diagonal entry of its block of A
    double d;                 ///< 1/√diagonal; 0 where no impulse moves a body
    std::size_t edges;        ///< begin of the edges between its bodies in edge_of_
  };

  /// Lists the blocks of `problem`, which must remain while the blocks are used.
  void set(const BodyConeProblem& problem);
  /// Lists the pairs of bodies, lower index first, that a block has in common.
  void find_edges();

  const BodyConeProblem& problem() const { return *problem_; }
  const BodyConeProblem::Row& row(std::size_t i) const { return problem_->rows[i]; }
  std::size_t parts_begin(std::size_t i) const { return i == 0 ? 0 : row(i - 1).parts_end; }
  const List<Block>& all() const { return blocks_; }
  const List<std::pair<int, int>>& edges() const { return edges_; }
  bool is_contact(const Block& block) const {
    return row(block.first).kind == BodyConeProblem::Kind::kNormal;
  }
  bool has_bounds(const Block& block) const {
    return row(block.first).least > -kInfinity || row(block.first).most < kInfinity;
  }

  /// Returns the law of a block in rows scaled by its d.
  ProximalBlock scaled(const Block& block, std::optional<double> shift) const {
    const BodyConeProblem::Row& first = row(block.first);
    return {is_contact(block),     first.friction,      shift, block.d * block.d * first.softness,
            first.least / block.d, first.most / block.d};
  }

  /// Sets v = M⁻¹ Jᵀ p.
  void set_velocities(const List<double>& p, List<Twist>* v) const;
  /// Returns J v of a row.
  double rate(std::size_t row, const List<Twist>& v) const;
  /// Returns the largest residual of all blocks, and leaves M⁻¹ Jᵀ p in `v`. A contact has the
  /// residual of the natural map, ‖p − P_K(p − (u + μ ‖u_t‖ n)/a)‖ a, with a the mean diagonal
  /// entry in its block of A.
  double residual(const List<double>& p, List<Twist>* v) const;
  /// Returns the residual of a block that can move, with impulses p and rates b + J v.
  double residual(const Block& block, const Eigen::Vector3d& p, Eigen::Vector3d rates) const;

  /// Calls add(body, other, edge, 6×6 matrix) for the terms of Jᵀ C J of a block with C of 3×3, for
  /// each pair of its bodies with body ≤ other or, where `is_whole`, in both orders. `edge` is the
  /// place of the pair in edges(), and 0 for body = other.
  template <class Add>
  void add_products(const Block& block, const Eigen::Matrix3d& C, bool is_whole,
                    const Add& add) const {
    const std::size_t count = row(block.first).parts_end - parts_begin(block.first);
    std::size_t edge = block.edges;
    for (std::size_t k = 0; k < count; ++k)
      for (std::size_t l = k; l < count; ++l) {
        const std::size_t place = k == l ? 0 : edge_of_[edge++];
        const bool is_ordered = body_of(block, k) <= body_of(block, l);
        const std::size_t a = is_ordered ? k : l, b = is_ordered ? l : k;
        add(body_of(block, a), body_of(block, b), place, product(block, C, a, b));
        if (is_whole && k != l)
          add(body_of(block, b), body_of(block, a), place, product(block, C, b, a));
      }
  }

 private:
  struct Pair {
    std::pair<int, int> bodies;
    std::size_t place;  ///< in edge_of_
  };

  double residual(const Block& block, const List<double>& p, const List<Twist>& v) const;
  int body_of(const Block& block, std::size_t part) const {
    return problem_->parts[parts_begin(block.first) + part].body;
  }
  Matrix6 product(const Block& block, const Eigen::Matrix3d& C, std::size_t k, std::size_t l) const;

  const BodyConeProblem* problem_ = nullptr;
  List<Block> blocks_;
  List<std::size_t> edge_of_;  // edges between the bodies of a block, block after block
  List<Pair> pairs_;           // pairs of bodies while edges are listed
  List<std::pair<int, int>> edges_;
};

/// Returns the point of the cone ‖t‖ ≤ μ n next to q.
Eigen::Vector3d nearest_in_cone(const Eigen::Vector3d& q, double mu);

/// Returns whether `times` more decreases like the last, from `before` to `now`, lead to `aim`.
bool reaches(double before, double now, int times, double aim);

/// Returns the length of the tangential part of the block at `p`.
double tangent_norm(const double* p);

/// Returns the three entries of a contact.
Eigen::Vector3d block_of(const List<double>& p, std::size_t first);

}  // namespace constraint_sim::engine
