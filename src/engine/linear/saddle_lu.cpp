#include "engine/linear/saddle_lu.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace constraint_sim::engine {
namespace {

// Gauss's elimination with partial pivoting of the n × n part of n rows of m numbers; the other
// columns become the solutions. One step: row k becomes that of the pivot, and those below lose it.
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

// and the way back: the solutions of the rows above lose that of row k
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

// The same with the sizes as constants, so that all loops are rolled out.
template <std::size_t kM, std::size_t... kColumn>
bool eliminate(double* a, std::index_sequence<kColumn...>) {
  constexpr std::size_t kN = sizeof...(kColumn);
  if (!(eliminate_column(a, kColumn, kN, kM) && ...)) return false;
  (substitute_column(a, kN - 1 - kColumn, kN, kM), ...);
  return true;
}

// sizes of points on rods, and of bodies on ball joints, are worth code of their own
bool eliminate(double* a, std::size_t n, std::size_t m) {
  if (n == 4 && m == 8) return eliminate<8>(a, std::make_index_sequence<4>());
  if (n == 9 && m == 16) return eliminate<16>(a, std::make_index_sequence<9>());
  return eliminate_any(a, n, m);
}

// rows of `above` times the solutions, off the parent's matrix and right-hand side
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

void SaddleLu::analyze(std::vector<Node> nodes, const std::vector<std::pair<int, int>>& loops) {
  blocks_.clear();
  node_of_.clear();
  general_ = GeneralPointer{};
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
  if (loops.empty())
    values_.assign(end, 0.0);
  else
    analyze_general(loops);
}

void SaddleLu::analyze_general(const std::vector<std::pair<int, int>>& loops) {
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](std::size_t i, std::size_t j) {
    entries.emplace_back(static_cast<int>(i), static_cast<int>(j), 1.0);
  };
  for (const Block& block : blocks_) {
    for (std::size_t i = 0; i < block.n; ++i) {
      for (std::size_t j = 0; j < block.n; ++j) add(block.first + i, block.first + j);
      for (std::size_t j = 0; j < block.parent_dofs; ++j) {
        add(block.first + i, blocks_[block.parent].first + j);
        add(blocks_[block.parent].first + j, block.first + i);
      }
    }
  }
  for (const auto& [i, j] : loops) entries.emplace_back(i, j, 1.0);
  const auto n = static_cast<int>(size());
  general_.pointer = std::make_unique<General>();
  general_->matrix.resize(n, n);
  general_->matrix.setFromTriplets(entries.begin(), entries.end());
  general_->matrix.makeCompressed();
  values_.assign(static_cast<std::size_t>(general_->matrix.nonZeros()), 0.0);
}

SaddleLu::Slot SaddleLu::slot(int row, int column) const {
  if (!is_forest()) {
    const auto& matrix = general_->matrix;
    const int* const begin = matrix.innerIndexPtr() + matrix.outerIndexPtr()[column];
    const int* const end = matrix.innerIndexPtr() + matrix.outerIndexPtr()[column + 1];
    return static_cast<Slot>(std::lower_bound(begin, end, row) - matrix.innerIndexPtr());
  }
  const auto i = static_cast<std::size_t>(row);
  const auto j = static_cast<std::size_t>(column);
  const Block& of_i = blocks_[node_of_[i]];
  const Block& of_j = blocks_[node_of_[j]];
  if (&of_i == &of_j) return of_i.matrix + (i - of_i.first) * of_i.stride + j - of_j.first;
  if (node_of_[i] < node_of_[j])  // the coupling to its parent
    return of_i.matrix + (i - of_i.first) * of_i.stride + of_i.n + j - of_j.first;
  return of_j.above + (i - of_i.first) * of_j.n + j - of_j.first;
}

bool SaddleLu::solve(double* b) {
  if (is_forest()) return solve_forest(b);
  std::copy(values_.begin(), values_.end(), general_->matrix.valuePtr());
  if (!general_->is_analyzed) {
    general_->lu.analyzePattern(general_->matrix);
    general_->is_analyzed = true;
  }
  general_->lu.factorize(general_->matrix);
  if (general_->lu.info() != Eigen::Success) return false;
  const auto n = static_cast<Eigen::Index>(size());
  general_->solution = general_->lu.solve(Eigen::VectorXd::Map(b, n));
  Eigen::VectorXd::Map(b, n) = general_->solution;
  return true;
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
