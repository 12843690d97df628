#pragma once

#include <cstddef>

#include "engine/math/frontal_lu.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves the unsymmetric systems of Newton's steps on bodies and the rows between them, whose
/// pattern stays. Nodes that form a forest are eliminated from the leaves to the roots, with
/// partial pivoting within each: O(nodes). Whatever has loops is left to FrontalLu. So is a forest
/// where a node has more rows than it moves, some of them to the world, since its own block is
/// singular then; where it has several links, its block may be in some poses: the residual shows
/// it, and FrontalLu solves again. Nothing is allocated by the solutions of forests, and by others
/// once their arrays have had their largest size.
class SaddleLu {
 public:
  /// Where an entry goes in values().
  using Slot = std::size_t;

  /// A body with rows that hold it. Its unknowns follow those of the node before, `dofs` first;
  /// these are what its children couple to.
  struct Node {
    int dofs = 0;
    int rows = 0;
    int parent = -1;  ///< a later node, or -1
  };
  /// `body` of it is the node that its rows belong to.
  using Link = FrontalLu::Link;

  void analyze(const List<Node>& nodes, const List<Link>& links);

  Slot slot(int i, int j) const;
  /// Entries of the matrix, to be set to zero and summed up before solve(), which overwrites them.
  List<double>& values() { return values_; }
  std::size_t size() const { return node_of_.size(); }

  /// Replaces b by A⁻¹ b; false where A is singular.
  bool solve(double* b);
  /// Lets the next solution depend on its matrix alone, to the last bit.
  void forget() { general_.forget(); }

 private:
  /// A node's matrix [own block | coupling to the parent | right-hand side] by rows, and what the
  /// parent's dofs have of it.
  struct Block {
    std::size_t first;        // unknown
    std::size_t n, dofs;      // unknowns; of these, dofs
    std::size_t parent_dofs;  // 0: a root
    std::size_t parent;       // block
    std::size_t matrix, stride;
    std::size_t above;  // parent_dofs rows of n
  };
  enum class Shape {
    kForest,
    kCheckedForest,  // blocks may be singular though the matrix is not
    kGeneral,
  };

  static Shape shape_of(const List<Node>& nodes, const List<Link>& links);
  void place_entries();
  bool solve_forest(double* b);
  bool solve_checked(double* b);

  Shape shape_ = Shape::kForest;
  List<Block> blocks_;
  List<std::size_t> node_of_;  // of unknowns
  List<double> values_;
  FrontalLu general_;
  // ---- of a checked forest: where general_ has its entries, and those; b
  List<Slot> slot_of_;
  List<double> entries_, right_side_;
};

}  // namespace constraint_sim::engine
