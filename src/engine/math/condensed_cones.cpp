#include "engine/math/condensed_cones.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "engine/math/dense_front.h"

namespace constraint_sim::engine {

using Eigen::Matrix3d;
using Eigen::Vector3d;

void CondensedCones::multiply(const List<double>& x, List<double>* result) const {
  const std::size_t n = x.size();
  result->assign(n, 0.0);
  for (std::size_t j = 0; j < n; ++j) {
    const double x_j = x[j];
    if (x_j == 0.0) continue;
    const double* const column = &rows_.A()[j * n];
    for (std::size_t i = 0; i < n; ++i) (*result)[i] += column[i] * x_j;
  }
}

void CondensedCones::begin(const List<double>& p) {
  rows_.pick(p, &from_);
  w_ = x_ = from_;
  set_shifts();
  change_.assign(rows_.size(), 0.0);
}

void CondensedCones::take() {
  from_ = x_;
  set_shifts();
}

void CondensedCones::set_rates(const List<double>& impulses) {
  multiply(impulses, &z_);
  for (std::size_t i = 0; i < z_.size(); ++i) z_[i] += rows_.b()[i];
}

void CondensedCones::set_shifts() {
  set_rates(w_);
  shifts_.assign(rows_.bounded().size(), 0.0);
  std::size_t at = 0;
  for (std::size_t b = 0; b < rows_.bounded().size(); at += rows_.bounded()[b++].size)
    if (rows_.blocks().is_contact(rows_.bounded()[b]))
      shifts_[b] = rows_.blocks().row(rows_.bounded()[b].first).friction * tangent_norm(&z_[at]);
}

ProximalImpulse CondensedCones::impulse(std::size_t b, std::size_t at, double sigma,
                                        bool with_slope) const {
  const Block& block = rows_.bounded()[b];
  const auto entries = [&](const List<double>& of) {
    return block.size == 3 ? block_of(of, at) : Vector3d(of[at], 0.0, 0.0);
  };
  return proximal_impulse(
      rows_.blocks().scaled(block, is_held_ ? std::optional(shifts_[b]) : std::nullopt),
      entries(from_), entries(z_), sigma, with_slope);
}

ProximalEquations::Merit CondensedCones::evaluate(double sigma, double share) {
  next_ = w_;
  if (share != 0.0)
    for (std::size_t i = 0; i < next_.size(); ++i) next_[i] += share * change_[i];
  set_rates(next_);
  off_.resize(next_.size());
  Merit merit{0.0, 0.0};
  for (std::size_t i = 0; i < next_.size(); ++i)
    merit.potential += 0.5 * next_[i] * (z_[i] - rows_.b()[i]);
  std::size_t at = 0;
  for (std::size_t b = 0; b < rows_.bounded().size(); ++b) {
    const ProximalImpulse found = impulse(b, at, sigma, false);
    merit.potential += found.potential;
    for (std::size_t i = 0; i < rows_.bounded()[b].size; ++i, ++at) {
      x_[at] = found.x[static_cast<Eigen::Index>(i)];
      off_[at] = next_[at] - x_[at];
    }
  }
  multiply(off_, &gradient_);
  for (std::size_t i = 0; i < off_.size(); ++i) merit.square += off_[i] * gradient_[i];
  merit.square = std::max(merit.square, 0.0);
  if (!is_held_) merit.potential = std::numeric_limits<double>::quiet_NaN();
  return merit;
}

// (I + S Â) δw = x − w, with S the slopes.
bool CondensedCones::find_change(double sigma) {
  const std::size_t n = rows_.size();
  values_.assign(n * n, 0.0);
  std::size_t at = 0;
  for (std::size_t b = 0; b < rows_.bounded().size(); at += rows_.bounded()[b++].size) {
    const Matrix3d slope = impulse(b, at, sigma, true).slope;
    for (std::size_t i = 0; i < rows_.bounded()[b].size; ++i) {
      double* const row = &values_[(at + i) * n];
      for (std::size_t k = 0; k < rows_.bounded()[b].size; ++k) {
        const double s = slope(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
        if (s == 0.0) continue;
        const double* const a = &rows_.A()[(at + k) * n];
        for (std::size_t j = 0; j < n; ++j) row[j] += s * a[j];
      }
      row[at + i] += 1.0;
      change_[at + i] = -off_[at + i];
    }
  }
  return solve_values();
}

// Replaces change_ by the solution with the matrix values_, by elimination with partial pivoting;
// false where the matrix is singular.
bool CondensedCones::solve_values() {
  const std::size_t n = rows_.size();
  order_.resize(2 * n);
  for (std::size_t i = 0; i < n; ++i) order_[i] = order_[n + i] = i;
  if (DenseFront(values_.data(), n, n, order_.data(), order_.data() + n).eliminate() < n)
    return false;
  solution_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    solution_[i] = change_[order_[i]];
    for (std::size_t k = 0; k < i; ++k) solution_[i] -= values_[i * n + k] * solution_[k];
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t k = i + 1; k < n; ++k) solution_[i] -= values_[i * n + k] * solution_[k];
    solution_[i] /= values_[i * n + i];
  }
  for (std::size_t i = 0; i < n; ++i) change_[order_[n + i]] = solution_[i];
  return true;
}

double CondensedCones::slope() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < gradient_.size(); ++i) sum += gradient_[i] * change_[i];
  return sum;
}

double CondensedCones::squared_distance() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < x_.size(); ++i) sum += (x_[i] - from_[i]) * (x_[i] - from_[i]);
  return sum;
}

double CondensedCones::residual() {
  multiply(x_, &at_x_);
  double largest = 0.0;
  std::size_t at = 0;
  for (const Block& block : rows_.bounded()) {
    Vector3d rates = Vector3d::Zero(), p = Vector3d::Zero();
    for (std::size_t i = 0; i < block.size; ++i, ++at) {
      p[static_cast<Eigen::Index>(i)] = block.d * x_[at];
      rates[static_cast<Eigen::Index>(i)] = (rows_.b()[at] + at_x_[at]) / block.d;
    }
    const double of_block = rows_.blocks().residual(block, p, rates);
    if (!(of_block <= largest)) largest = of_block;
  }
  return largest;
}

}  // namespace constraint_sim::engine
