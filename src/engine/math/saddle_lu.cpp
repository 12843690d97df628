#include "engine/math/saddle_lu.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

// Relative residual of a forest's solution up to which no block was singular.
constexpr double kForestSolved = 1e-10;

// Gaussian elimination with partial pivoting of the n × n part of n rows of m numbers; the other
// columns become the solutions. This step swaps the pivot into row k, and eliminates column k below
// it.
inline bool eliminate_column(double* a, std::size_t k, std::size_t n, std::size_t m) {
  std::size_t pivot = k;
  for (std::size_t i = k + 1; i < n; ++i)
    if (std::abs(a[i * m + k]) > std::abs(a[pivot * m + k])) pivot = i;
  if (!(std::abs(a[pivot * m + k]) > 0.0)) return false;
  double* const __restrict row = a + k * m;
  if (pivot != k) std::swap_ranges(row + k, row + m, a + pivot * m + k);
  const double inverse = 1.0 / row[k];
  for (std::size_t j = k + 1; j < m; ++j) row[j] *= inverse;
  for (std::size_t i = k + 1; i < n; ++i) {
    double* const __restrict other = a + i * m;
    const double factor = other[k];
    for (std::size_t j = k + 1; j < m; ++j) other[j] -= factor * row[j];
  }
  return true;
}

// Back substitution: subtracts the solution of row k from the rows above.
inline void substitute_column(double* a, std::size_t k, std::size_t n, std::size_t m) {
  const double* const __restrict row = a + k * m;
  for (std::size_t i = 0; i < k; ++i) {
    double* const __restrict other = a + i * m;
    const double factor = other[k];
    for (std::size_t j = n; j < m; ++j) other[j] -= factor * row[j];
  }
}

bool eliminate_any(double* a, std::size_t n, std::size_t m) {
  for (std::size_t k = 0; k < n; ++k)
    if (!eliminate_column(a, k, n, m)) return false;
  for (std::size_t k = n; k-- > 1;) substitute_column(a, k, n, m);
  return true;
}

// Elimination with constant sizes, so that all loops are unrolled.
template <std::size_t kM, std::size_t... kColumn>
bool eliminate(double* a, std::index_sequence<kColumn...>) {
  constexpr std::size_t kN = sizeof...(kColumn);
  if (!(eliminate_column(a, kColumn, kN, kM) && ...)) return false;
  (substitute_column(a, kN - 1 - kColumn, kN, kM), ...);
  return true;
}

// Specializes sizes of points on rods, and of bodies on ball joints.
bool eliminate(double* a, std::size_t n, std::size_t m) {
  if (n == 4 && m == 8) return eliminate<8>(a, std::make_index_sequence<4>());
  if (n == 9 && m == 16) return eliminate<16>(a, std::make_index_sequence<9>());
  return eliminate_any(a, n, m);
}

// Subtracts rows of `above` times the solutions from the parent's matrix and right-hand side.
template <std::size_t kDofs, std::size_t kN>
void pass_up(const double* above, const double* solutions, std::size_t some_dofs,
             std::size_t some_n, std::size_t m, double* to, std::size_t stride, double* b) {
  const std::size_t dofs = kDofs > 0 ? kDofs : some_dofs;
  const std::size_t n = kN > 0 ? kN : some_n;
  for (std::size_t i = 0; i < dofs; ++i) {
    double* const __restrict row = to + i * stride;
    for (std::size_t k = 0; k < n; ++k) {
      const double factor = above[i * n + k];
      const double* const __restrict solution = solutions + k * m;
      for (std::size_t j = 0; j < dofs; ++j) row[j] -= factor * solution[j];
      b[i] -= factor * solution[dofs];
    }
  }
}

}  // namespace

void SaddleLu::analyze(const List<Node>& nodes, const List<Link>& links) {
  blocks_.clear();
  node_of_.clear();
  std::size_t end = 0;
  for (const Node& node : nodes) {
    Block block{};
    block.first = node_of_.size();
    block.dofs = static_cast<std::size_t>(node.dofs);
    block.n = block.dofs + static_cast<std::size_t>(node.rows);
    if (node.parent >= 0) {
      block.parent = static_cast<std::size_t>(node.parent);
      block.parent_dofs = static_cast<std::size_t>(nodes[block.parent].dofs);
    }
    block.stride = block.n + block.parent_dofs + 1;
    block.matrix = end;
    block.above = end + block.n * block.stride;
    end = block.above + block.parent_dofs * block.n;
    node_of_.insert(node_of_.end(), block.n, blocks_.size());
    blocks_.push_back(block);
  }
  shape_ = shape_of(nodes, links);
  general_ = FrontalLu{};
  if (shape_ != Shape::kForest) {
    List<FrontalLu::Body> bodies;
    for (const Block& block : blocks_)
      bodies.push_back({static_cast<int>(block.first), static_cast<int>(block.dofs)});
    general_.analyze(bodies, links);
  }
  values_.assign(shape_ == Shape::kGeneral ? general_.entries() : end, 0.0);
  if (shape_ == Shape::kCheckedForest) place_entries();
}

SaddleLu::Shape SaddleLu::shape_of(const List<Node>& nodes, const List<Link>& links) {
  List<int> links_of(nodes.size(), 0);
  Shape shape = Shape::kForest;
  for (const Link& link : links) {
    const auto body = static_cast<std::size_t>(link.body);
    if (link.more[0] >= 0 || link.more[1] >= 0) return Shape::kGeneral;
    if (link.other >= 0 && link.other != nodes[body].parent) return Shape::kGeneral;
    if (nodes[body].parent < 0) continue;
    if (nodes[body].rows > nodes[body].dofs) return Shape::kGeneral;
    if (++links_of[body] > 1) shape = Shape::kCheckedForest;
  }
  return shape;
}

SaddleLu::Slot SaddleLu::slot(int row, int column) const {
  if (shape_ == Shape::kGeneral) return general_.slot(row, column);
  const auto i = static_cast<std::size_t>(row);
  const auto j = static_cast<std::size_t>(column);
  const Block& of_i = blocks_[node_of_[i]];
  const Block& of_j = blocks_[node_of_[j]];
  if (&of_i == &of_j) return of_i.matrix + (i - of_i.first) * of_i.stride + j - of_j.first;
  if (node_of_[i] < node_of_[j])  // coupling to the parent
    return of_i.matrix + (i - of_i.first) * of_i.stride + of_i.n + j - of_j.first;
  return of_j.above + (i - of_i.first) * of_j.n + j - of_j.first;
}

void SaddleLu::place_entries() {
  slot_of_.clear();
  general_.for_entries([&](std::size_t i, std::size_t j) {
    slot_of_.push_back(slot(static_cast<int>(i), static_cast<int>(j)));
  });
  entries_.assign(slot_of_.size(), 0.0);
  right_side_.assign(size(), 0.0);
}

bool SaddleLu::solve(double* b) {
  if (shape_ == Shape::kForest) return solve_forest(b);
  if (shape_ == Shape::kGeneral) return general_.solve(values_.data(), b);
  return solve_checked(b);
}

bool SaddleLu::solve_checked(double* b) {
  for (std::size_t e = 0; e < entries_.size(); ++e) entries_[e] = values_[slot_of_[e]];
  std::copy(b, b + size(), right_side_.begin());
  if (solve_forest(b) && general_.residual(entries_.data(), right_side_.data(), b) <= kForestSolved)
    return true;
  std::copy(right_side_.begin(), right_side_.end(), b);
  return general_.solve(entries_.data(), b);
}

bool SaddleLu::solve_forest(double* b) {
  double* const values = values_.data();
  for (const Block& block : blocks_) {
    double* const a = values + block.matrix;
    const std::size_t m = block.stride;
    for (std::size_t i = 0; i < block.n; ++i) a[i * m + m - 1] = b[block.first + i];
    if (!eliminate(a, block.n, m)) return false;
    if (block.parent_dofs == 0) continue;
    const Block& parent = blocks_[block.parent];
    const auto pass = block.parent_dofs == 3 && block.n == 4 ? pass_up<3, 4> : pass_up<0, 0>;
    pass(values + block.above, a + block.n, block.parent_dofs, block.n, m, values + parent.matrix,
         parent.stride, b + parent.first);
  }
  for (std::size_t k = blocks_.size(); k-- > 0;) {
    const Block& block = blocks_[k];
    const double* const a = values + block.matrix;
    const std::size_t m = block.stride;
    const double* const above = block.parent_dofs > 0 ? b + blocks_[block.parent].first : nullptr;
    for (std::size_t i = 0; i < block.n; ++i) {
      double x = a[i * m + m - 1];
      for (std::size_t j = 0; j < block.parent_dofs; ++j) x -= a[i * m + block.n + j] * above[j];
      b[block.first + i] = x;
    }
  }
  return true;
}

}  // namespace constraint_sim::engine
