#include "engine/linear/sparse_ldlt.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <limits>

namespace constraint_sim::engine {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Place of each row in an elimination of a forest without fill: leaves first, from all ends at
// once, so that neighbours in the order depend little on each other. Empty if there are loops.
std::vector<int> leaves_first_order(int n, const std::vector<std::pair<int, int>>& entries) {
  const auto size = static_cast<std::size_t>(n);
  std::vector<int> degree(size, 0), sum_of_neighbours(size, 0);  // the sum tells a leaf's only one
  for (const auto& [i, j] : entries) {
    const auto a = static_cast<std::size_t>(i);
    const auto b = static_cast<std::size_t>(j);
    ++degree[a];
    ++degree[b];
    sum_of_neighbours[a] += j;
    sum_of_neighbours[b] += i;
  }
  std::vector<int> order(size, -1), queue;
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

// place of each row in an elimination with little fill
std::vector<int> little_fill_order(int n, const std::vector<std::pair<int, int>>& entries) {
  std::vector<Eigen::Triplet<double>> triplets;
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
  std::vector<int> order(static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) order[static_cast<std::size_t>(permutation.indices()[k])] = k;
  return order;
}

}  // namespace

void SparseLdlt::analyze(int n, const std::vector<std::pair<int, int>>& entries) {
  const auto size = n_ = static_cast<std::size_t>(n);
  order_ = leaves_first_order(n, entries);
  is_forest_ = order_.size() == size;
  if (!is_forest_) order_ = little_fill_order(n, entries);

  // pattern of L, column by column: that of A and of the children in the elimination tree
  std::vector<std::vector<int>> columns(size);
  for (const auto& [i, j] : entries) {
    const int p = order_[static_cast<std::size_t>(i)];
    const int q = order_[static_cast<std::size_t>(j)];
    if (p != q) columns[static_cast<std::size_t>(std::min(p, q))].push_back(std::max(p, q));
  }
  column_start_.assign(1, 0);
  row_of_.clear();
  for (int k = 0; k < n; ++k) {
    std::vector<int>& rows = columns[static_cast<std::size_t>(k)];
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    for (const int row : rows) row_of_.push_back(static_cast<std::size_t>(row));
    column_start_.push_back(row_of_.size());
    if (rows.empty()) continue;
    std::vector<int>& parent = columns[static_cast<std::size_t>(rows.front())];
    parent.insert(parent.end(), rows.begin() + 1, rows.end());
    std::vector<int>().swap(rows);
  }

  // the same by rows
  row_start_.assign(size + 1, 0);
  for (const std::size_t row : row_of_) ++row_start_[row + 1];
  for (std::size_t i = 0; i < size; ++i) row_start_[i + 1] += row_start_[i];
  column_of_.resize(row_of_.size());
  place_of_.resize(row_of_.size());
  std::vector<std::size_t> next(row_start_.begin(), row_start_.end() - 1);
  for (std::size_t k = 0; k < size; ++k) {
    for (std::size_t p = column_start_[k]; p < column_start_[k + 1]; ++p) {
      const std::size_t to = next[row_of_[p]]++;
      column_of_[to] = k;
      place_of_[to] = p;
    }
  }
  parent_.assign(size, size);
  for (std::size_t k = 0; k < size; ++k)
    if (column_start_[k + 1] > column_start_[k]) parent_[k] = row_of_[column_start_[k]];
  is_updated_.assign(size, false);
  for (std::size_t k = 0; k < size; ++k)
    for (std::size_t p = column_start_[k]; p + 1 < column_start_[k + 1]; ++p)
      is_updated_[row_of_[p]] = true;
  values_.assign(size + row_of_.size(), 0.0);
  inverse_diagonal_.assign(size, 0.0);
  work_.assign(size, 0.0);
}

SparseLdlt::Slot SparseLdlt::slot(int i, int j) const {
  const int p = order_[static_cast<std::size_t>(i)];
  const int q = order_[static_cast<std::size_t>(j)];
  if (p == q) return static_cast<Slot>(p);
  const auto column = static_cast<std::size_t>(std::min(p, q));
  const auto begin = row_of_.begin() + static_cast<std::ptrdiff_t>(column_start_[column]);
  const auto end = row_of_.begin() + static_cast<std::ptrdiff_t>(column_start_[column + 1]);
  const auto found = std::lower_bound(begin, end, static_cast<std::size_t>(std::max(p, q)));
  return n_ + static_cast<Slot>(found - row_of_.begin());
}

int SparseLdlt::factor(double least) {
  return is_forest_ ? factor_forest(least) : factor_any(least);
}

// No column has more than one entry, so none but its parent's pivot changes.
int SparseLdlt::factor_forest(double least) {
  const double* const diagonal = values_.data();
  double* lower = values_.data() + n_;
  double* const taken = work_.data();  // off the pivots by their children; zero before and after
  double* const inverses = inverse_diagonal_.data();
  const std::size_t* const parents = parent_.data();
  const std::size_t n = n_;
  int touched = 0;
  smallest_touched_ = 1.0;
  for (std::size_t k = 0; k < n; ++k) {
    double pivot = diagonal[k] - taken[k];
    taken[k] = 0.0;
    if (pivot < least * diagonal[k]) pivot = touch(k, pivot, least, &touched);
    if (pivot == 0.0) pivot = kInfinity;  // of an empty row
    // two divisions, since the next pivot waits for the second alone
    inverses[k] = 1.0 / pivot;
    if (parents[k] == n) continue;
    taken[parents[k]] += *lower * *lower / pivot;
    *lower++ *= inverses[k];
  }
  return touched;
}

int SparseLdlt::factor_leaving_out(double least) {
  left_out_.assign(n_, 0);
  leaves_out_ = true;
  const int left_out = factor(least);
  leaves_out_ = false;
  return left_out;
}

double SparseLdlt::touch(std::size_t k, double pivot, double least, int* touched) {
  const double entry = values_[k];
  smallest_touched_ = std::min(smallest_touched_, pivot / entry);
  ++*touched;
  if (leaves_out_) {
    left_out_[k] = 1;
    return 0.0;
  }
  return pivot + least * entry;
}

int SparseLdlt::factor_any(double least) {
  double* const diagonal = values_.data();
  double* const lower = values_.data() + n_;
  int touched = 0;
  smallest_touched_ = 1.0;
  for (std::size_t j = 0; j < n_; ++j) {
    const std::size_t begin = column_start_[j];
    const std::size_t end = column_start_[j + 1];
    if (is_updated_[j])
      for (std::size_t p = begin; p < end; ++p) work_[row_of_[p]] = lower[p];

    double pivot = diagonal[j];
    for (std::size_t r = row_start_[j]; r < row_start_[j + 1]; ++r) {
      const std::size_t k = column_of_[r];
      const std::size_t at = place_of_[r];
      const double scaled = lower[at] * diagonal[k];
      pivot -= lower[at] * scaled;
      for (std::size_t p = at + 1; p < column_start_[k + 1]; ++p)
        work_[row_of_[p]] -= lower[p] * scaled;
    }
    if (pivot < least * diagonal[j]) pivot = touch(j, pivot, least, &touched);
    const double inverse = pivot != 0.0 ? 1.0 / pivot : 0.0;  // 0 of an empty row
    diagonal[j] = pivot;
    inverse_diagonal_[j] = inverse;
    if (is_updated_[j])
      for (std::size_t p = begin; p < end; ++p) lower[p] = work_[row_of_[p]];
    for (std::size_t p = begin; p < end; ++p) lower[p] *= inverse;
  }
  return touched;
}

void SparseLdlt::solve(double* b) const { is_forest_ ? solve_forest(b) : solve_any(b); }

void SparseLdlt::solve_forest(double* b) const {
  const double* lower = values_.data() + n_;
  const double* const inverses = inverse_diagonal_.data();
  const std::size_t* const parents = parent_.data();
  const std::size_t n = n_;
  for (std::size_t k = 0; k < n; ++k)
    if (parents[k] < n) b[parents[k]] -= *lower++ * b[k];
  for (std::size_t k = n; k-- > 0;) {
    const double x = b[k] * inverses[k];
    b[k] = parents[k] < n ? x - *--lower * b[parents[k]] : x;
  }
}

void SparseLdlt::solve_any(double* b) const {
  const double* const lower = values_.data() + n_;
  for (std::size_t k = 0; k < n_; ++k)
    for (std::size_t p = column_start_[k]; p < column_start_[k + 1]; ++p)
      b[row_of_[p]] -= lower[p] * b[k];
  for (std::size_t k = n_; k-- > 0;) {
    double sum = b[k] * inverse_diagonal_[k];
    for (std::size_t p = column_start_[k]; p < column_start_[k + 1]; ++p)
      sum -= lower[p] * b[row_of_[p]];
    b[k] = sum;
  }
}

}  // namespace constraint_sim::engine
