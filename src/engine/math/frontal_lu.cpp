#include "engine/math/frontal_lu.h"

#include <algorithm>
#include <cmath>

#include "engine/math/dense_front.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

// Residual that ends a refinement, as a share of the largest sum of |terms|; least gain per step;
// most steps; and residual that is accepted with new factors.
constexpr double kRefined = 1e-10;
constexpr double kLeastRefinementGain = 0.3;
constexpr int kMostRefinements = 10;
constexpr double kRefinementSolved = 1e-8;
// Cost of an entry of the factors in a refinement, in operations of a factorization. A refinement
// loads each entry from memory for one operation.
constexpr double kMemory = 4.0;

// Enlarges a list with a reserve, since numbers of delayed unknowns vary.
template <class Number>
void make_room(List<Number>* list, std::size_t size) {
  if (list->size() < size) list->resize(size + size / 4);
}

// ---- parts of a substitution

// Subtracts a x from y, rows × columns. Four independent sums at a time hide the latency.
void subtract_products(const double* a, std::size_t stride, std::size_t rows, std::size_t columns,
                       const double* x, double* y) {
  std::size_t i = 0;
  for (; i + 4 <= rows; i += 4) {
    const double* const row = a + i * stride;
    double p = y[i], q = y[i + 1], r = y[i + 2], s = y[i + 3];
    for (std::size_t k = 0; k < columns; ++k) {
      p -= row[k] * x[k];
      q -= row[stride + k] * x[k];
      r -= row[2 * stride + k] * x[k];
      s -= row[3 * stride + k] * x[k];
    }
    y[i] = p;
    y[i + 1] = q;
    y[i + 2] = r;
    y[i + 3] = s;
  }
  for (; i < rows; ++i)
    for (std::size_t k = 0; k < columns; ++k) y[i] -= a[i * stride + k] * x[k];
}

// Replaces x by l⁻¹ x, with l of size n and unit diagonal.
void subtract_triangle(const double* l, std::size_t stride, std::size_t n, double* x) {
  for (std::size_t k = 0; k < n; k += 4) {
    const std::size_t end = std::min(k + 4, n);
    subtract_products(l + k * stride, stride, end - k, k, x, x + k);
    for (std::size_t i = k + 1; i < end; ++i)
      for (std::size_t j = k; j < i; ++j) x[i] -= l[i * stride + j] * x[j];
  }
}

}  // namespace

// ---- numerical factorization and solution

bool FrontalLu::factor(const double* values) {
  factor_end_ = stack_end_ = index_end_ = 0;
  std::size_t longest = 0;
  double operations = 0.0, entries = static_cast<double>(column_.size());
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    assemble(f, values);
    const Front& front = fronts_[f];
    Factor& factor = factors_[f];
    std::size_t* const rows = index_.data() + factor.indices;
    const std::size_t summed = factor.size - front.border;
    factor.pivots =
        DenseFront(factor_.data() + factor.values, factor.size, summed, rows, rows + factor.size)
            .eliminate();
    factor.delayed = summed - factor.pivots;
    if (front.is_root && factor.delayed > 0) return false;
    store(f);
    longest = std::max(longest, factor.size);
    const auto size = static_cast<double>(factor.size), n = static_cast<double>(factor.pivots);
    operations += n * (size * (size - n) + n * n / 3.0);
    entries += n * (2.0 * size - n);
  }
  make_room(&front_, longest);
  const double refinements = operations / (kMemory * entries);
  worthwhile_ = static_cast<int>(std::min(refinements, 1.0 * kMostRefinements));
  return true;
}

// Assembles the matrix of a front at the end of factor_, from entries of A and the blocks of its
// children.
void FrontalLu::assemble(std::size_t f, const double* values) {
  const Front& front = fronts_[f];
  Factor& factor = factors_[f];
  const std::size_t children = f > 0 ? fronts_[f - 1].children_end : 0;
  std::size_t delayed = 0;
  for (std::size_t c = children; c < front.children_end; ++c)
    delayed += factors_[child_[c]].delayed;
  factor.size = delayed + front.own + front.border;
  factor.values = factor_end_;
  factor.indices = index_end_;
  const std::size_t end = factor_end_ + factor.size * factor.size;
  make_room(&factor_, end);
  make_room(&index_, index_end_ + 2 * factor.size);
  double* const a = factor_.data() + factor.values;
  std::fill_n(a, factor.size * factor.size, 0.0);
  std::size_t* const rows = index_.data() + factor.indices;
  for (std::size_t k = 0; k < front.own + front.border; ++k)
    rows[delayed + k] = rows[factor.size + delayed + k] = unknown_[front.unknowns + k];

  const std::size_t corner = delayed * (factor.size + 1);
  for (std::size_t e = f > 0 ? fronts_[f - 1].entries_end : 0; e < front.entries_end; ++e)
    a[corner + entry_[e].row * factor.size + entry_[e].column] += values[entry_[e].slot];
  std::size_t delayed_at = 0;
  for (std::size_t c = children; c < front.children_end; ++c) {
    add_child(child_[c], delayed_at, delayed, &factor);
    delayed_at += factors_[child_[c]].delayed;
  }
  if (children < front.children_end) stack_end_ = factors_[child_[children]].block;
}

void FrontalLu::add_child(std::size_t child, std::size_t delayed_at, std::size_t delayed,
                          Factor* to) {
  const Factor& from = factors_[child];
  const std::size_t left = from.size - from.pivots;
  const std::size_t* const place = place_.data() + fronts_[child].place_in_parent;
  const auto place_of = [&](std::size_t k) {
    return k < from.delayed ? delayed_at + k : delayed + place[k - from.delayed];
  };
  std::size_t* const rows = index_.data() + to->indices;
  const std::size_t* const of_child = index_.data() + from.indices + from.pivots;
  for (std::size_t k = 0; k < from.delayed; ++k) {
    rows[delayed_at + k] = of_child[k];
    rows[to->size + delayed_at + k] = of_child[from.size + k];
  }
  for (std::size_t i = 0; i < left; ++i) {
    const double* const row = stack_.data() + from.block + i * left;
    double* const target = factor_.data() + to->values + place_of(i) * to->size;
    for (std::size_t j = 0; j < from.delayed; ++j) target[delayed_at + j] += row[j];
    for (std::size_t j = from.delayed; j < left; ++j)
      target[delayed + place[j - from.delayed]] += row[j];
  }
}

// Stores U and L one after the other, and the remaining block on the stack.
void FrontalLu::store(std::size_t f) {
  Factor& factor = factors_[f];
  const std::size_t left = factor.size - factor.pivots;
  double* const a = factor_.data() + factor.values;
  factor.block = stack_end_;
  stack_end_ += left * left;
  make_room(&stack_, stack_end_);
  double* L = a + factor.pivots * factor.size;
  for (std::size_t i = 0; i < left; ++i) {
    const double* const row = a + (factor.pivots + i) * factor.size;
    std::copy(row + factor.pivots, row + factor.size, stack_.data() + factor.block + i * left);
    L = std::copy(row, row + factor.pivots, L);
  }
  factor_end_ = static_cast<std::size_t>(L - factor_.data());
  index_end_ += 2 * factor.size;
}

// Solves L U x = b front by front, with the entries of b or x gathered in front_.
void FrontalLu::substitute(double* b, double* x) {
  double* const local = front_.data();
  for (const Factor& factor : factors_) {
    const std::size_t n = factor.pivots, size = factor.size;
    const double* const U = factor_.data() + factor.values;
    const std::size_t* const rows = index_.data() + factor.indices;
    for (std::size_t i = 0; i < size; ++i) local[i] = b[rows[i]];
    subtract_triangle(U, size, n, local);
    subtract_products(U + n * size, n, size - n, n, local, local + n);
    for (std::size_t i = 0; i < size; ++i) b[rows[i]] = local[i];
  }
  for (std::size_t f = factors_.size(); f-- > 0;) {
    const Factor& factor = factors_[f];
    const std::size_t n = factor.pivots, size = factor.size;
    const double* const U = factor_.data() + factor.values;
    const std::size_t* const rows = index_.data() + factor.indices;
    const std::size_t* const columns = rows + size;
    for (std::size_t i = 0; i < n; ++i) local[i] = b[rows[i]];
    for (std::size_t i = n; i < size; ++i) local[i] = x[columns[i]];
    subtract_products(U + n, size, n, size - n, local + n, local);
    for (std::size_t i = n; i-- > 0;) {
      double sum = local[i];
      for (std::size_t k = i + 1; k < n; ++k) sum -= U[i * size + k] * local[k];
      x[columns[i]] = local[i] = sum / U[i * size + i];
    }
  }
}

double FrontalLu::residual(const double* values, const double* b, const double* x) {
  double largest = 0.0, most = 0.0;
  for (std::size_t i = 0; i < n_; ++i) {
    double sum = b[i], size = std::abs(b[i]);
    for (std::size_t s = row_begin_[i]; s < row_begin_[i + 1]; ++s) {
      const double term = values[s] * x[column_[s]];
      sum -= term;
      size += std::abs(term);
    }
    residual_[i] = sum;
    if (!(std::abs(sum) <= largest)) largest = std::abs(sum);
    most = std::max(most, size);
  }
  return most > 0.0 ? largest / most : 0.0;
}

// Predicts the residual after more steps of refinement, each of which multiplies it by `share`.
double FrontalLu::at_last(double residual, double share, int steps) {
  for (; steps > 0; --steps) residual *= share;
  return residual;
}

// Solves into solution_ with refinement; returns false where the residual stays above `enough`.
bool FrontalLu::refine(const double* values, const double* b, int steps, double enough) {
  std::fill(solution_.begin(), solution_.end(), 0.0);
  std::copy(b, b + n_, residual_.begin());
  double before = 1.0;
  for (int k = 1; k <= steps; ++k) {
    substitute(residual_.data(), change_.data());
    for (std::size_t i = 0; i < n_; ++i) solution_[i] += change_[i];
    const double share = residual(values, b, solution_.data());
    if (share <= kRefined) return true;
    if (!(share <= kLeastRefinementGain * before &&
          at_last(share, share / before, steps - k) <= kRefined))
      return share <= enough;
    before = share;
  }
  return before <= enough;
}

bool FrontalLu::solve(const double* values, double* b) {
  bool done = has_factors_ && worthwhile_ > 0 && refine(values, b, worthwhile_, 0.0);
  if (!done) {
    has_factors_ = factor(values);
    done = has_factors_ && refine(values, b, kMostRefinements, kRefinementSolved);
  }
  if (done) std::copy(solution_.begin(), solution_.end(), b);
  return done;
}

}  // namespace constraint_sim::engine
