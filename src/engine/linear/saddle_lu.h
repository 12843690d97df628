#pragma once

#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace constraint_sim::engine {

/// Solves the unsymmetric systems of Newton's steps on bodies and the rows between them, whose
/// pattern stays. Nodes that form a forest are eliminated from the leaves to the roots, with
/// partial pivoting within each: O(nodes), and nothing is allocated. Whatever has loops is left to
/// Eigen::SparseLU, which allocates.
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

  /// `loops`: entries (i, j) that are neither within a node nor between a node and the dofs of its
  /// parent, both triangles. Without any the nodes are a forest.
  void analyze(std::vector<Node> nodes, const std::vector<std::pair<int, int>>& loops);
  bool is_forest() const { return general_ == nullptr; }

  Slot slot(int i, int j) const;
  /// Entries of the matrix, to be set to zero and summed up before solve(), which overwrites them.
  std::vector<double>& values() { return values_; }
  std::size_t size() const { return node_of_.size(); }

  /// Replaces b by A⁻¹ b; false where A is singular.
  bool solve(double* b);

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

  bool solve_forest(double* b);
  void analyze_general(const std::vector<std::pair<int, int>>& loops);

  /// What only loops need. A copy factors anew, and has the same to the last bit.
  struct General {
    Eigen::SparseMatrix<double> matrix;
    Eigen::SparseLU<Eigen::SparseMatrix<double>> lu;
    Eigen::VectorXd solution;
    bool is_analyzed = false;
    General() = default;
    explicit General(const Eigen::SparseMatrix<double>& pattern) : matrix(pattern) {}
  };
  struct GeneralPointer {
    std::unique_ptr<General> pointer;
    GeneralPointer() = default;
    GeneralPointer(const GeneralPointer& other)
        : pointer(other.pointer ? std::make_unique<General>(other.pointer->matrix) : nullptr) {}
    GeneralPointer(GeneralPointer&&) noexcept = default;
    GeneralPointer& operator=(GeneralPointer other) noexcept {
      pointer = std::move(other.pointer);
      return *this;
    }
    ~GeneralPointer() = default;
    General* operator->() const { return pointer.get(); }
    bool operator==(std::nullptr_t) const { return pointer == nullptr; }
  };

  std::vector<Block> blocks_;
  std::vector<std::size_t> node_of_;  // of unknowns
  std::vector<double> values_;
  GeneralPointer general_;
};

}  // namespace constraint_sim::engine
