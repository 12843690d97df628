#pragma once

#include <cstddef>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Factors and solves symmetric positive definite tridiagonal systems from both ends towards the
/// middle, so that two recurrences run in parallel (van der Vorst, "Large tridiagonal and block
/// tridiagonal linear systems on vector and parallel computers", Parallel Computing 5, 1987).
class TridiagonalLdlt {
 public:
  void resize(std::size_t n) {
    diagonal_.assign(n, 0.0);
    off_diagonal_.assign(n, 0.0);
    inverse_.assign(n, 0.0);
  }

  /// Diagonal of A, which is kept.
  double* diagonal() { return diagonal_.data(); }
  /// Off-diagonal of A, the entry (k, k + 1) at k, which is overwritten.
  double* off_diagonal() { return off_diagonal_.data(); }

  /// Factors, and replaces b by A⁻¹ b. Returns false, with both invalid, where a pivot is not above
  /// `least` times its diagonal entry.
  [[gnu::always_inline]] bool factor_and_solve(double least, double* b) {
    const double* const diagonal = diagonal_.data();
    double* const link = off_diagonal_.data();
    double* const inverse = inverse_.data();
    const std::size_t n = diagonal_.size();
    const std::size_t middle = n / 2;
    bool is_regular = true;
    Carried down, up;
    const auto eliminate = [&](std::size_t k, std::size_t l, Carried* carried) {
      const double pivot = diagonal[k] - carried->pivot;
      is_regular = is_regular && pivot > least * diagonal[k];
      const double off_diagonal = link[l];
      carried->pivot = off_diagonal * off_diagonal / pivot;  // depends on no other division
      const double inverse_pivot = 1.0 / pivot;
      const double L = off_diagonal * inverse_pivot;
      const double reduced = b[k] - carried->b;
      carried->b = L * reduced;
      inverse[k] = inverse_pivot;
      link[l] = L;
      b[k] = reduced;
    };
    for (std::size_t i = 0, j = n - 1; i + 1 < j; ++i, --j) {
      eliminate(i, i, &down);
      eliminate(j, j - 1, &up);
    }
    if (n % 2 == 0) eliminate(middle - 1, middle - 1, &down);
    const double entry = diagonal[middle];
    const double pivot = entry - (down.pivot + up.pivot);
    const double inverse_pivot = inverse[middle] = 1.0 / pivot;
    substitute_back((b[middle] - (down.b + up.b)) * inverse_pivot, b);
    return is_regular && pivot > least * entry;
  }

  /// Replaces b by A⁻¹ b for the last A factored.
  void solve(double* b) const {
    const double* const link = off_diagonal_.data();
    const std::size_t n = diagonal_.size();
    const std::size_t middle = n / 2;
    double down = 0.0, up = 0.0;
    const auto eliminate = [&](std::size_t k, std::size_t l, double* carried) {
      const double reduced = b[k] - *carried;
      *carried = link[l] * reduced;
      b[k] = reduced;
    };
    for (std::size_t i = 0, j = n - 1; i + 1 < j; ++i, --j) {
      eliminate(i, i, &down);
      eliminate(j, j - 1, &up);
    }
    if (n % 2 == 0) eliminate(middle - 1, middle - 1, &down);
    substitute_back((b[middle] - (down + up)) * inverse_[middle], b);
  }

 private:
  struct Carried {  // sums carried from a row to the next
    double pivot = 0.0, b = 0.0;
  };

  // Substitutes back from the solution in the middle.
  void substitute_back(double x_middle, double* b) const {
    const double* const link = off_diagonal_.data();
    const double* const inverse = inverse_.data();
    const std::size_t n = diagonal_.size();
    const std::size_t middle = n / 2;
    double down = x_middle, up = x_middle;
    const auto substitute = [&](std::size_t k, std::size_t l, double* x) {
      *x = b[k] * inverse[k] - link[l] * *x;
      b[k] = *x;
    };
    b[middle] = x_middle;
    if (n % 2 == 0) substitute(middle - 1, middle - 1, &up);
    for (std::size_t i = (n - 1) / 2; i-- > 0;) {
      const std::size_t j = n - 1 - i;
      substitute(i, i, &up);
      substitute(j, j - 1, &down);
    }
  }

  List<double> diagonal_;
  List<double> off_diagonal_;  // off-diagonal of A; after factoring, of L
  List<double> inverse_;       // inverses of the pivots
};

}  // namespace constraint_sim::engine
