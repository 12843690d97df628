#pragma once

// A program for one scene alone, as a yardstick for the cost of the engine's generality: the same
// Runge-Kutta pair and projection, without reports, edits and other joints.

#include <cstddef>
#include <vector>

#include "engine/math/integrate.h"

namespace constraint_sim::engine::hand_written {

/// Steps problems::chain() with fixed steps: unit masses, rods of 1 m, one tridiagonal system a
/// stage.
class Chain {
 public:
  explicit Chain(std::size_t links)
      : n_(links), y_(6 * links, 0.0), next_(y_), k_(kStages * 6 * links) {
    for (auto* list : {&dx_, &dy_, &dz_, &diagonal_, &off_, &lambda_}) list->assign(links + 1, 0.0);
    for (std::size_t i = 0; i < links; ++i) y_[3 * i] = static_cast<double>(i + 1);
    place(y_.data());
    factor();
    accelerate(y_.data(), k_.data());
  }

  void step(double h) { step(h, std::make_index_sequence<kStages - 1>()); }
  const double* positions() const { return y_.data(); }

 private:
  using Pair = DormandPrince8;
  static constexpr std::size_t kStages = Pair::kStages;

  template <std::size_t kStage>
  void combine(double h) {
    runge_kutta::combine<Pair, kStage>(y_.data(), k_.data(), 6 * n_, h, next_.data());
  }

  template <std::size_t kStage>
  void stage(double h) {
    combine<kStage>(h);
    place(next_.data());
    factor();
    accelerate(next_.data(), k_.data() + kStage * 6 * n_);
  }

  template <std::size_t... kBefore>
  void step(double h, std::index_sequence<kBefore...>) {
    (stage<kBefore + 1>(h), ...);
    combine<kStages>(h);
    double* const x = next_.data();
    double* const v = x + 3 * n_;
    for (int i = 0; i < 2; ++i) {  // projects positions, with the factors of the last stage
      place(x);
      for (std::size_t r = 0; r < n_; ++r)
        lambda_[r] = 0.5 * (1.0 - dx_[r] * dx_[r] - dy_[r] * dy_[r] - dz_[r] * dz_[r]);
      solve();
      push(x);
    }
    place(x);
    factor();
    for (std::size_t r = 0; r < n_; ++r) {
      double rate = dx_[r] * v[3 * r] + dy_[r] * v[3 * r + 1] + dz_[r] * v[3 * r + 2];
      if (r > 0) rate -= dx_[r] * v[3 * r - 3] + dy_[r] * v[3 * r - 2] + dz_[r] * v[3 * r - 1];
      lambda_[r] = -rate;
    }
    solve();
    push(v);
    y_.swap(next_);
    accelerate(y_.data(), k_.data());
  }

  void place(const double* x) {
    dx_[0] = x[0];
    dy_[0] = x[1];
    dz_[0] = x[2];
    for (std::size_t r = 1; r < n_; ++r) {
      dx_[r] = x[3 * r] - x[3 * r - 3];
      dy_[r] = x[3 * r + 1] - x[3 * r - 2];
      dz_[r] = x[3 * r + 2] - x[3 * r - 1];
    }
  }

  void factor() {
    for (std::size_t r = 0; r < n_; ++r) {
      double pivot = (r == 0 ? 1.0 : 2.0) * (dx_[r] * dx_[r] + dy_[r] * dy_[r] + dz_[r] * dz_[r]);
      if (r > 0) {
        const double a = -(dx_[r] * dx_[r - 1] + dy_[r] * dy_[r - 1] + dz_[r] * dz_[r - 1]);
        off_[r] = a * diagonal_[r - 1];
        pivot -= a * off_[r];
      }
      diagonal_[r] = 1.0 / pivot;
    }
  }

  void solve() {
    for (std::size_t r = 1; r < n_; ++r) lambda_[r] -= off_[r] * lambda_[r - 1];
    for (std::size_t r = n_; r-- > 0;)
      lambda_[r] = lambda_[r] * diagonal_[r] - (r + 1 < n_ ? off_[r + 1] * lambda_[r + 1] : 0.0);
  }

  void push(double* to) const {  // adds Gᵀλ, with unit masses
    for (std::size_t r = 0; r < n_; ++r) {
      const double next = r + 1 < n_ ? lambda_[r + 1] : 0.0;
      to[3 * r] += lambda_[r] * dx_[r] - next * dx_[r + 1];
      to[3 * r + 1] += lambda_[r] * dy_[r] - next * dy_[r + 1];
      to[3 * r + 2] += lambda_[r] * dz_[r] - next * dz_[r + 1];
    }
  }

  void accelerate(const double* y, double* rate) {
    const double* v = y + 3 * n_;
    lambda_[0] = -(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + kGravity * dz_[0];
    for (std::size_t r = 1; r < n_; ++r) {
      const double a = v[3 * r] - v[3 * r - 3];
      const double b = v[3 * r + 1] - v[3 * r - 2];
      const double c = v[3 * r + 2] - v[3 * r - 1];
      lambda_[r] = -(a * a + b * b + c * c);
    }
    solve();
    for (std::size_t e = 0; e < 3 * n_; ++e) rate[e] = v[e];
    double* const to = rate + 3 * n_;
    for (std::size_t r = 0; r < n_; ++r) {
      to[3 * r] = to[3 * r + 1] = 0.0;
      to[3 * r + 2] = -kGravity;
    }
    push(to);
  }

  static constexpr double kGravity = 9.81;

  std::size_t n_;
  std::vector<double> y_, next_, k_;
  std::vector<double> dx_, dy_, dz_, diagonal_, off_, lambda_;
};

}  // namespace constraint_sim::engine::hand_written
