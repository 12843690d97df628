#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace constraint_sim::engine {

/// Gaussian elimination of a dense matrix by rows. The first `summed` unknowns may be eliminated,
/// with pivots by rows, and by columns where a column has no pivot of sufficient size.
class DenseFront {
 public:
  DenseFront(double* values, std::size_t size, std::size_t summed, std::size_t* rows,
             std::size_t* columns)
      : a_(values), size_(size), summed_(summed), rows_(rows), columns_(columns) {}

  /// Eliminates each of the first `summed` unknowns that has a pivot; returns their number.
  /// Eliminated unknowns come first, with L and U in place; `rows` and `columns` are swapped alike.
  std::size_t eliminate() {
    std::size_t done = 0, end = summed_;  // columns from `end` on had no pivot
    for (std::size_t before = 0; done < end;) {
      const std::size_t width = std::min(kPanel, end - done);
      const std::size_t pivots = eliminate_panel(done, width);
      update(done, pivots, done + width);
      done += pivots;
      for (std::size_t k = width - pivots; k-- > 0;) swap_columns(done + k, --end);
      if (done == end && end < summed_ && done > before) {  // skipped columns may have a pivot now
        before = done;
        end = summed_;
      }
    }
    return done;
  }

 private:
  /// Least size of a pivot, as a share of the largest entry of its column.
  static constexpr double kThreshold = 0.01;
  /// Number of columns that are eliminated before the columns to their right are updated.
  static constexpr std::size_t kPanel = 8;

  // Eliminates the columns of a panel; columns without a pivot go behind the others.
  std::size_t eliminate_panel(std::size_t begin, std::size_t width) {
    std::size_t done = begin;
    for (std::size_t end = begin + width; done < end;) {
      std::size_t pivot = done;
      double largest = 0.0;
      for (std::size_t i = done; i < summed_; ++i) {
        const double size = std::abs(a_[i * size_ + done]);
        if (!(size <= largest)) {
          largest = size;
          pivot = i;
        }
      }
      double below = 0.0;
      for (std::size_t i = summed_; i < size_; ++i)
        below = std::max(below, std::abs(a_[i * size_ + done]));
      if (!(largest > 0.0) || largest < kThreshold * below) {
        swap_columns(done, --end);
        continue;
      }
      if (pivot != done) {
        std::swap_ranges(a_ + pivot * size_, a_ + (pivot + 1) * size_, a_ + done * size_);
        std::swap(rows_[pivot], rows_[done]);
      }
      const double* const __restrict row = a_ + done * size_;
      const double inverse = 1.0 / row[done];
      for (std::size_t i = done + 1; i < size_; ++i) {
        double* const __restrict other = a_ + i * size_;
        const double factor = other[done] *= inverse;
        if (factor == 0.0) continue;
        for (std::size_t j = done + 1; j < begin + width; ++j) other[j] -= factor * row[j];
      }
      ++done;
    }
    return done - begin;
  }

  // Applies the pivots of a panel to the columns from `right` on.
  void update(std::size_t begin, std::size_t pivots, std::size_t right) {
    for (std::size_t k = begin; k < begin + pivots; ++k)
      for (std::size_t i = k + 1; i < begin + pivots; ++i)
        for (std::size_t j = right; j < size_; ++j)
          a_[i * size_ + j] -= a_[i * size_ + k] * a_[k * size_ + j];
    const std::size_t below = begin + pivots;
    const auto take = [&](std::size_t k, auto subtract_some) {
      subtract_some(a_ + below * size_ + k, a_ + k * size_ + right, a_ + below * size_ + right,
                    size_ - below, size_ - right, size_);
    };
    std::size_t k = begin;
    for (; k + 4 <= below; k += 4) take(k, subtract<4>);
    for (; k < below; ++k) take(k, subtract<1>);
  }

  // Subtracts l u from a, rows × columns, where l has kPivots columns. Two rows at a time share
  // their loads.
  template <std::size_t kPivots>
  static void subtract(const double* l, const double* u, double* a, std::size_t rows,
                       std::size_t columns, std::size_t stride) {
    std::size_t i = 0;
    for (; i + 2 <= rows; i += 2) {
      double* const __restrict first = a + i * stride;
      double* const __restrict second = first + stride;
      const double* const x = l + i * stride;
      const double* const y = x + stride;
      for (std::size_t j = 0; j < columns; ++j) {
        double p = first[j], q = second[j];
        for (std::size_t k = 0; k < kPivots; ++k) {
          p -= x[k] * u[k * stride + j];
          q -= y[k] * u[k * stride + j];
        }
        first[j] = p;
        second[j] = q;
      }
    }
    for (; i < rows; ++i) {
      double* const __restrict row = a + i * stride;
      const double* const x = l + i * stride;
      for (std::size_t j = 0; j < columns; ++j)
        for (std::size_t k = 0; k < kPivots; ++k) row[j] -= x[k] * u[k * stride + j];
    }
  }

  void swap_columns(std::size_t j, std::size_t k) {
    if (j == k) return;
    for (std::size_t i = 0; i < size_; ++i) std::swap(a_[i * size_ + j], a_[i * size_ + k]);
    std::swap(columns_[j], columns_[k]);
  }

  double* a_;
  std::size_t size_, summed_;
  std::size_t* rows_;
  std::size_t* columns_;
};

}  // namespace constraint_sim::engine
