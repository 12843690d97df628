#pragma once

#include <cstddef>

#include "engine/math/frontal_lu.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves the unsymmetric systems of Newton's method on bodies and the rows between them, with a
/// constant pattern. A forest is eliminated from leaves to roots, with partial pivoting per node,
/// in O(nodes). Graphs with loops use FrontalLu. So do forests whose node has more rows than
/// degrees of freedom, since its block is singular. A node with several links may be singular in
/// some poses: the residual detects this, and FrontalLu solves again. Solutions of forests allocate
/// nothing, others only while arrays grow.
class SaddleLu {
 public:
  /// Index of an entry in values().
  using Slot = std::size_t;

  /// A body with rows that hold it. Its unknowns follow the unknowns of the previous node; its
  /// first `dofs` unknowns couple with its children.
  struct Node {
    int dofs = 0;
    int rows = 0;
    int parent = -1;  ///< index of a later node, or -1
  };
  /// Link whose `body` is the node that its rows belong to.
  using Link = FrontalLu::Link;

  void analyze(const List<Node>& nodes, const List<Link>& links);

  Slot slot(int i, int j) const;
  /// Entries of the matrix, to be set to zero and summed before solve(), which overwrites them.
  List<double>& values() { return values_; }
  std::size_t size() const { return node_of_.size(); }

  /// Replaces b by A⁻¹ b; false where A is singular.
  bool solve(double* b);
  /// Makes the next solution depend on its matrix alone, to the last bit.
  void forget() { general_.forget(); }

 private:
  /// Matrix of a node, [own block | coupling to the parent | right-hand side] by rows, and the
  /// coupling of the parent's dofs to the node.
  struct Block {
    std::size_t first;        // first unknown
    std::size_t n, dofs;      // number of unknowns, and of dofs among them
    std::size_t parent_dofs;  // dofs of the parent; 0: a root
    std::size_t parent;       // index of the parent
    std::size_t matrix, stride;
    std::size_t above;  // index of parent_dofs rows of n numbers
  };
  enum class Shape {
    kForest,
    kCheckedForest,  // blocks may be singular though the matrix is regular
    kGeneral,
  };

  static Shape shape_of(const List<Node>& nodes, const List<Link>& links);
  void place_entries();
  bool solve_forest(double* b);
  bool solve_checked(double* b);

  Shape shape_ = Shape::kForest;
  List<Block> blocks_;
  List<std::size_t> node_of_;  // node of each unknown
  List<double> values_;
  FrontalLu general_;
  // ---- for a checked forest: places and values of the entries of general_; right-hand side
  List<Slot> slot_of_;
  List<double> entries_, right_side_;
};

}  // namespace constraint_sim::engine
