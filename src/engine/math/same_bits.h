#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstring>

namespace constraint_sim::engine {

/// Whether numbers are equal to the bit; 0 and −0 differ.
inline bool have_same_bits(const double* a, const double* b, std::size_t n) {
  return std::memcmp(a, b, n * sizeof(double)) == 0;
}

template <int n>
bool have_same_bits(const Eigen::Matrix<double, n, 1>& a, const Eigen::Matrix<double, n, 1>& b) {
  return have_same_bits(a.data(), b.data(), n);
}

}  // namespace constraint_sim::engine
