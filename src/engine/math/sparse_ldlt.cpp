#include "engine/math/sparse_ldlt.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <numeric>
#include <type_traits>

#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

// Pivot, as a share of its diagonal entry, below which even a row to be kept is rounding.
constexpr double kLeastKeptPivot = 1e-20;

// Share of a supernode's entries that may be stored zeros; measured as the fastest.
constexpr double kZeroShare = 0.2;

// Returns the place of each row in an elimination of a forest without fill: leaves first, from all
// ends at once, so that neighbours in the order depend little on each other. Empty where there are
// loops.
List<int> leaves_first_order(int n, const List<std::pair<int, int>>& entries) {
  const auto size = static_cast<std::size_t>(n);
  // Sum of neighbours is the only neighbour of a leaf.
  List<int> degree(size, 0), sum_of_neighbours(size, 0);
  for (const auto& [i, j] : entries) {
    const auto a = static_cast<std::size_t>(i);
    const auto b = static_cast<std::size_t>(j);
    ++degree[a];
    ++degree[b];
    sum_of_neighbours[a] += j;
    sum_of_neighbours[b] += i;
  }
  List<int> order(size, -1), queue;
  for (int i = 0; i < n; ++i)
    if (degree[static_cast<std::size_t>(i)] <= 1) queue.push_back(i);
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const auto leaf = static_cast<std::size_t>(queue[k]);
    order[leaf] = static_cast<int>(k);
    if (degree[leaf] == 0) continue;
    const auto neighbour = static_cast<std::size_t>(sum_of_neighbours[leaf]);
    sum_of_neighbours[neighbour] -= queue[k];
    if (--degree[neighbour] == 1) queue.push_back(static_cast<int>(neighbour));
  }
  if (queue.size() < size) order.clear();
  return order;
}

// Whether each row has an entry in each column, as of one body and its joints.
bool is_complete(std::size_t n, const List<std::pair<int, int>>& entries) {
  if (2 * entries.size() < n * (n - 1)) return false;
  List<char> has(n * n, 0);
  for (const auto& [i, j] : entries)
    has[n * static_cast<std::size_t>(i) + static_cast<std::size_t>(j)] =
        has[n * static_cast<std::size_t>(j) + static_cast<std::size_t>(i)] = 1;
  for (std::size_t i = 0; i < n; ++i) has[n * i + i] = 1;
  return std::find(has.begin(), has.end(), 0) == has.end();
}

// Returns the place of each row in an elimination with little fill.
List<int> little_fill_order(int n, const List<std::pair<int, int>>& entries) {
  List<Eigen::Triplet<double>> triplets;
  triplets.reserve(static_cast<std::size_t>(n) + 2 * entries.size());
  for (int i = 0; i < n; ++i) triplets.emplace_back(i, i, 1.0);
  for (const auto& [i, j] : entries) {
    triplets.emplace_back(i, j, 1.0);
    triplets.emplace_back(j, i, 1.0);
  }
  Eigen::SparseMatrix<double> pattern(n, n);
  pattern.setFromTriplets(triplets.begin(), triplets.end());
  Eigen::AMDOrdering<int>::PermutationType permutation;
  Eigen::AMDOrdering<int>()(pattern, permutation);
  List<int> order(static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) order[static_cast<std::size_t>(permutation.indices()[k])] = k;
  return order;
}

// Calls act(k, count) for k from 0 to n in steps of 4, then for the rest. `count` is a constant, so
// that values per column stay in registers.
template <class Act>
void by_fours(std::size_t n, const Act& act) {
  std::size_t k = 0;
  for (; k + 4 <= n; k += 4) act(k, std::integral_constant<std::size_t, 4>{});
  switch (n - k) {
    case 3:
      act(k, std::integral_constant<std::size_t, 3>{});
      break;
    case 2:
      act(k, std::integral_constant<std::size_t, 2>{});
      break;
    case 1:
      act(k, std::integral_constant<std::size_t, 1>{});
      break;
  }
}

// Subtracts rows j and below of L D L_jᵀ from target(i), for the first columns of a block; rows
// count from `begin`.
template <class Target>
void subtract_columns(const double* L, std::size_t rows, std::size_t columns, std::size_t begin,
                      std::size_t j, const Target& target) {
  by_fours(columns, [=](std::size_t k, auto count) {
    const double* const diagonal = L + (rows + 1) * k;
    const double* const from = L + rows * k + begin;
    std::array<double, count> scaled;
    for (std::size_t n = 0; n < count; ++n)
      scaled[n] = diagonal[(rows + 1) * n] * from[rows * n + j];
    for (std::size_t i = j; i < rows - begin; ++i) {
      double sum = 0.0;
      for (std::size_t n = 0; n < count; ++n) sum += scaled[n] * from[rows * n + i];
      target(i) -= sum;
    }
  });
}

}  // namespace

void SparseLdlt::analyze(int n, const List<std::pair<int, int>>& entries) {
  const auto size = n_ = static_cast<std::size_t>(n);
  order_ = leaves_first_order(n, entries);
  is_forest_ = order_.size() == size;
  inverse_diagonal_.assign(size, 0.0);
  left_out_.assign(size, 0);
  is_kept_.assign(size, 0);
  any_left_out_ = false;
  any_kept_ = 0;
  if (!is_forest_ && is_complete(size, entries)) return join_all();
  if (!is_forest_) order_ = little_fill_order(n, entries);

  // Pattern of L by columns: entries of A, and of the children in the elimination tree.
  List<List<int>> below(size);
  for (const auto& [i, j] : entries) {
    const int p = order_[static_cast<std::size_t>(i)];
    const int q = order_[static_cast<std::size_t>(j)];
    if (p != q) below[static_cast<std::size_t>(std::min(p, q))].push_back(std::max(p, q));
  }
  for (List<int>& rows : below) {
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    if (rows.empty()) continue;
    List<int>& parent = below[static_cast<std::size_t>(rows.front())];
    parent.insert(parent.end(), rows.begin() + 1, rows.end());
  }
  if (is_forest_) {
    find_parents(below);
  } else {
    join_columns(below);
    find_updates();
  }
}

void SparseLdlt::find_parents(const List<List<int>>& below) {
  parent_.assign(n_, n_);
  for (std::size_t k = 0; k < n_; ++k)
    if (!below[k].empty()) parent_[k] = static_cast<std::size_t>(below[k].front());
  values_.assign(2 * n_, 0.0);
  work_.assign(n_, 0.0);
}

// Joins all columns to one supernode, in the order of the rows.
void SparseLdlt::join_all() {
  order_.resize(n_);
  std::iota(order_.begin(), order_.end(), 0);
  row_of_.resize(n_);
  std::iota(row_of_.begin(), row_of_.end(), std::size_t{0});
  supernodes_.assign(1, {0, n_, n_, 0, 0, 0});
  supernode_of_.assign(n_, 0);
  updates_.clear();
  targets_.clear();
  values_.assign(n_ * n_, 0.0);
}

// Joins a column to the supernode of its child, the column before, where few of the stored entries
// are zero.
void SparseLdlt::join_columns(const List<List<int>>& below) {
  supernodes_.clear();
  supernode_of_.resize(n_);
  row_of_.clear();
  std::size_t in_vain = 0, entries = 0;
  for (std::size_t k = 0; k < n_; ++k) {
    const List<int>& rows = below[k];
    bool joins = false;
    if (k > 0 && !below[k - 1].empty() && static_cast<std::size_t>(below[k - 1].front()) == k) {
      Supernode& node = supernodes_.back();
      const std::size_t more = node.columns * (rows.size() + 1 - below[k - 1].size());
      const std::size_t all =
          (node.columns + 1) * (node.columns + 2) / 2 + (node.columns + 1) * rows.size();
      joins = static_cast<double>(in_vain + more) <= kZeroShare * static_cast<double>(all);
      if (joins) {
        in_vain += more;
        row_of_.resize(node.rows_at + node.columns++);
      }
    }
    if (!joins) {
      in_vain = 0;
      supernodes_.push_back({k, 1, 0, row_of_.size(), 0, 0});
    }
    supernode_of_[k] = supernodes_.size() - 1;
    row_of_.push_back(k);
    for (const int row : rows) row_of_.push_back(static_cast<std::size_t>(row));
    supernodes_.back().rows = row_of_.size() - supernodes_.back().rows_at;
  }
  for (Supernode& node : supernodes_) {
    node.block = entries;
    entries += node.rows * node.columns;
  }
  values_.assign(entries, 0.0);
}

void SparseLdlt::find_updates() {
  List<List<Update>> of_node(supernodes_.size());
  for (std::size_t s = 0; s < supernodes_.size(); ++s) {
    const Supernode& node = supernodes_[s];
    const std::size_t* const row = row_of_.data() + node.rows_at;
    for (std::size_t begin = node.columns, end = begin; begin < node.rows; begin = end) {
      const std::size_t to = supernode_of_[row[begin]];
      while (end < node.rows && supernode_of_[row[end]] == to) ++end;
      of_node[to].push_back({s, begin, end - begin, 0});
    }
  }
  updates_.clear();
  targets_.clear();
  for (std::size_t s = 0; s < supernodes_.size(); ++s) {
    for (Update& update : of_node[s]) {
      update.targets = targets_.size();
      const Supernode& from = supernodes_[update.from];
      for (std::size_t i = update.begin; i < from.rows; ++i)
        targets_.push_back(row_in_block(supernodes_[s], row_of_[from.rows_at + i]));
      updates_.push_back(update);
    }
    supernodes_[s].updates_end = updates_.size();
  }
}

std::size_t SparseLdlt::row_in_block(const Supernode& node, std::size_t row) const {
  const auto begin = row_of_.begin() + static_cast<std::ptrdiff_t>(node.rows_at);
  const auto end = begin + static_cast<std::ptrdiff_t>(node.rows);
  return static_cast<std::size_t>(std::lower_bound(begin, end, row) - begin);
}

SparseLdlt::Slot SparseLdlt::slot(int i, int j) const {
  const auto p = static_cast<std::size_t>(order_[static_cast<std::size_t>(i)]);
  const auto q = static_cast<std::size_t>(order_[static_cast<std::size_t>(j)]);
  const std::size_t column = std::min(p, q), row = std::max(p, q);
  if (is_forest_) return p == q ? p : n_ + column;
  const Supernode& node = supernodes_[supernode_of_[column]];
  return node.block + node.rows * (column - node.first) + row_in_block(node, row);
}

int SparseLdlt::factor(double least) {
  if (any_left_out_) std::fill(left_out_.begin(), left_out_.end(), 0);
  any_left_out_ = false;
  return is_forest_ ? factor_forest(least) : factor_supernodes(least);
}

void SparseLdlt::keep_none() {
  if (any_kept_) std::fill(is_kept_.begin(), is_kept_.end(), 0);
  any_kept_ = 0;
}

// In a forest a column has at most one entry, so a pivot changes only the pivot of its parent.
int SparseLdlt::factor_forest(double least) {
  const double* const diagonal = values_.data();
  double* const lower = values_.data() + n_;
  // Sums that children subtract from pivots; zero before and after.
  double* const taken = work_.data();
  double* const inverses = inverse_diagonal_.data();
  const std::size_t* const parents = parent_.data();
  const std::size_t n = n_;
  int left_out = 0;
  double smallest = 1.0;
  for (std::size_t k = 0; k < n; ++k) {
    double pivot = diagonal[k] - taken[k];
    taken[k] = 0.0;
    if (pivot < smallest * diagonal[k]) {
      smallest = pivot / diagonal[k];
      if (smallest < least) pivot = leave_out(k, diagonal[k], pivot, &left_out);
    } else if (smallest < least && pivot < least * diagonal[k]) {
      pivot = leave_out(k, diagonal[k], pivot, &left_out);
    }
    if (pivot == 0.0) pivot = kInfinity;  // row left out or empty
    // Two divisions, since the next pivot only waits for the second.
    inverses[k] = 1.0 / pivot;
    if (parents[k] == n) continue;
    taken[parents[k]] += lower[k] * lower[k] / pivot;
    lower[k] *= inverses[k];
  }
  smallest_pivot_ = smallest;
  return left_out;
}

// Returns the pivot to continue with in place of a small one: 0, unless the row is to be kept.
double SparseLdlt::leave_out(std::size_t k, double entry, double pivot, int* left_out) {
  if (is_kept_[k] && pivot > kLeastKeptPivot * entry) return pivot;
  left_out_[k] = 1;
  any_left_out_ = true;
  ++*left_out;
  return 0.0;
}

int SparseLdlt::factor_supernodes(double least) {
  int left_out = 0;
  smallest_pivot_ = 1.0;
  std::size_t u = 0;
  for (const Supernode& node : supernodes_) {
    for (std::size_t k = 0; k < node.columns; ++k)  // entries of A until eliminate()
      inverse_diagonal_[node.first + k] = values_[node.block + (node.rows + 1) * k];
    for (; u < node.updates_end; ++u) subtract(updates_[u], node);
    left_out += eliminate(node, least);
  }
  return left_out;
}

// Subtracts L D Lᵀ of an earlier supernode from the columns of this one.
void SparseLdlt::subtract(const Update& update, const Supernode& node) {
  const Supernode& from = supernodes_[update.from];
  const double* const L = values_.data() + from.block;
  const std::size_t* const target = targets_.data() + update.targets;
  for (std::size_t j = 0; j < update.columns; ++j) {
    double* const column = values_.data() + node.block + node.rows * target[j];
    subtract_columns(L, from.rows, from.columns, update.begin, j,
                     [=](std::size_t i) -> double& { return column[target[i]]; });
  }
}

// Eliminates within the block, after the updates by earlier supernodes.
int SparseLdlt::eliminate(const Supernode& node, double least) {
  double* const L = values_.data() + node.block;
  const std::size_t rows = node.rows;
  int left_out = 0;
  for (std::size_t k = 0; k < node.columns; ++k) {
    double* const column = L + rows * k;
    subtract_columns(L, rows, k, 0, k, [=](std::size_t i) -> double& { return column[i]; });
    double& inverse = inverse_diagonal_[node.first + k];
    const double entry = inverse;
    if (column[k] < smallest_pivot_ * entry) smallest_pivot_ = column[k] / entry;
    if (column[k] < least * entry)
      column[k] = leave_out(node.first + k, entry, column[k], &left_out);
    // A row that is left out or empty has a pivot of 0, and gets 0 in place of the inverse.
    const double factor = column[k] != 0.0 ? 1.0 / column[k] : 0.0;
    inverse = factor;
    for (std::size_t i = k + 1; i < rows; ++i) column[i] *= factor;
  }
  return left_out;
}

void SparseLdlt::solve(double* b) const { is_forest_ ? solve_forest(b) : solve_supernodes(b); }

void SparseLdlt::solve_forest(double* b) const {
  const double* const lower = values_.data() + n_;
  const double* const inverses = inverse_diagonal_.data();
  const std::size_t* const parents = parent_.data();
  const std::size_t n = n_;
  for (std::size_t k = 0; k < n; ++k)
    if (parents[k] < n) b[parents[k]] -= lower[k] * b[k];
  for (std::size_t k = n; k-- > 0;) {
    const double x = b[k] * inverses[k];
    b[k] = parents[k] < n ? x - lower[k] * b[parents[k]] : x;
  }
}

void SparseLdlt::solve_supernodes(double* b) const {
  for (const Supernode& node : supernodes_) {
    const double* const L = values_.data() + node.block;
    const std::size_t* const row = row_of_.data() + node.rows_at;
    const std::size_t rows = node.rows;
    double* const x = b + node.first;
    for (std::size_t k = 1; k < node.columns; ++k)
      for (std::size_t i = 0; i < k; ++i) x[k] -= L[rows * i + k] * x[i];
    by_fours(node.columns, [=](std::size_t k, auto count) {
      for (std::size_t i = node.columns; i < rows; ++i) {
        double sum = 0.0;
        for (std::size_t n = k; n < k + count; ++n) sum += L[rows * n + i] * x[n];
        b[row[i]] -= sum;
      }
    });
  }
  for (std::size_t s = supernodes_.size(); s-- > 0;) {
    const Supernode& node = supernodes_[s];
    const double* const L = values_.data() + node.block;
    const std::size_t* const row = row_of_.data() + node.rows_at;
    const std::size_t rows = node.rows;
    double* const x = b + node.first;
    by_fours(node.columns, [=](std::size_t k, auto count) {
      std::array<double, count> sum{};
      for (std::size_t n = 0; n < count; ++n)
        sum[n] = x[k + n] * inverse_diagonal_[node.first + k + n];
      for (std::size_t i = node.columns; i < rows; ++i)
        for (std::size_t n = 0; n < count; ++n) sum[n] -= L[rows * (k + n) + i] * b[row[i]];
      for (std::size_t n = 0; n < count; ++n) x[k + n] = sum[n];
    });
    for (std::size_t k = node.columns; k-- > 1;)
      for (std::size_t i = 0; i < k; ++i) x[i] -= L[rows * i + k] * x[k];
  }
}

}  // namespace constraint_sim::engine
