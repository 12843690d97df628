#pragma once

// A reference integrator that shares no code with the engine: mechanics in long double
// (reference_mechanics.h) by extrapolation of Gragg, Bulirsch and Stoer, with a projection after
// each step.

#include "reference_mechanics.h"

namespace constraint_sim::engine::reference {

/// Integrates a mechanism with automatic steps; is_valid() is false once the result is unreliable.
class Integrator {
 public:
  /// `tolerance` of one step [m]; gives up after `most_evaluations`.
  Integrator(const Mechanics& mechanics, double tolerance, long most_evaluations, int columns = 8)
      : mechanics_(mechanics),
        tolerance_(static_cast<Real>(tolerance)),
        left_(most_evaluations),
        columns_(columns),
        poses_(mechanics.start_at(0)),
        readings_(mechanics.start_readings()) {
    is_valid_ = mechanics_.project(0, &poses_) < kFits;
  }

  bool is_valid() const { return is_valid_; }
  long left() const { return left_; }  ///< evaluations
  std::vector<Pose>& poses() { return poses_; }
  const std::vector<Pose>& poses() const { return poses_; }
  const Readings& readings() const { return readings_; }

  void advance_to(double end) {
    const auto to = static_cast<Real>(end);
    while (is_valid_ && t_ < to) {
      const bool is_last = t_ + h_ * 1.0001L >= to;
      const Real h = is_last ? to - t_ : h_;
      auto [next, error] = step(h);
      for (const Pose& pose : next)
        if (!(pose.x.allFinite() && pose.q.coeffs().allFinite())) error = 1;
      const Real power = 1 / static_cast<Real>(2 * columns_ - 1);
      const Real factor =
          std::clamp(Real{0.8L} * std::pow(tolerance_ / std::max(error, Real{1e-30L}), power),
                     Real{0.2L}, Real{2});
      if (error > tolerance_) {
        h_ = h * std::min(factor, Real{0.7L});
      } else {
        t_ = is_last ? to : t_ + h;
        readings_ = mechanics_.read_on(poses_, next, h, readings_);
        poses_ = std::move(next);
        for (std::size_t i = 0; i < poses_.size(); ++i)
          mechanics_.place_kinematic(i, t_, &poses_[i]);
        if (!(mechanics_.project(t_, &poses_, readings_) < kFits)) is_valid_ = false;
        if (!is_last || factor < 1) h_ = h * factor;
      }
      if (left_ <= 0 || h_ < 1e-9L) is_valid_ = false;
    }
  }

 private:
  static constexpr Real kFits = 1e-9L;

  // Derivative y' of a flat state.
  struct Slope {
    Vector3 x, v, w;
    Eigen::Matrix<Real, 4, 1> q;
  };
  std::vector<Slope> slopes(const std::vector<Pose>& poses, Real t) {
    --left_;
    const std::vector<Pose> a = mechanics_.accelerations(poses, t, kept_);
    std::vector<Slope> s(poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const Quaternion w(0, poses[i].w.x(), poses[i].w.y(), poses[i].w.z());
      s[i] = {poses[i].v, a[i].v, a[i].w, (w * poses[i].q).coeffs() / 2};
    }
    return s;
  }
  static void add(Real h, const std::vector<Slope>& s, std::vector<Pose>* poses) {
    for (std::size_t i = 0; i < s.size(); ++i) {
      (*poses)[i].x += h * s[i].x;
      (*poses)[i].v += h * s[i].v;
      (*poses)[i].w += h * s[i].w;
      (*poses)[i].q.coeffs() += h * s[i].q;
    }
  }
  // Computes a + factor (a − b).
  static void combine(const std::vector<Pose>& a, Real factor, std::vector<Pose>* b) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      Pose& p = (*b)[i];
      p.x = a[i].x + factor * (a[i].x - p.x);
      p.v = a[i].v + factor * (a[i].v - p.v);
      p.w = a[i].w + factor * (a[i].w - p.w);
      p.q.coeffs() = a[i].q.coeffs() + factor * (a[i].q.coeffs() - p.q.coeffs());
    }
  }

  std::pair<std::vector<Pose>, Real> step(Real H) {
    std::vector<std::vector<Pose>> table;
    std::vector<Pose> second;
    kept_ = mechanics_.independent_rows(poses_, t_);
    const std::vector<Slope> first = slopes(poses_, t_);
    for (int j = 1; j <= columns_; ++j) {
      const int n = 2 * j;
      const Real h = H / static_cast<Real>(n);
      std::vector<Pose> before = poses_, now = poses_;
      add(h, first, &now);
      for (int k = 1; k < n; ++k) {
        add(2 * h, slopes(now, t_ + static_cast<Real>(k) * h), &before);
        std::swap(before, now);
      }
      add(h, slopes(now, t_ + H), &before);
      combine(now, -Real{1} / 2, &before);  // the mean of both
      table.push_back(std::move(before));
      for (int k = j - 2; k >= 0; --k) {
        const Real ratio = static_cast<Real>(j) / static_cast<Real>(k + 1);
        combine(table[static_cast<std::size_t>(k) + 1], 1 / (ratio * ratio - 1),
                &table[static_cast<std::size_t>(k)]);
      }
      if (j == columns_ - 1) second = table.front();
    }
    Real error = 0;
    for (std::size_t i = 0; i < second.size(); ++i) {
      const Pose& a = table.front()[i];
      error = std::max({error, (a.x - second[i].x).norm(), H * (a.v - second[i].v).norm()});
      if (mechanics_.is_movable(i) && mechanics_.radius(i) > 0.0)
        error = std::max(error, static_cast<Real>(mechanics_.radius(i)) *
                                    (a.q.coeffs() - second[i].q.coeffs()).norm());
    }
    return {table.front(), error};
  }

  const Mechanics& mechanics_;
  Real tolerance_;
  long left_;
  int columns_;
  std::vector<Pose> poses_;
  Readings readings_;
  std::vector<Eigen::Index> kept_;
  Real t_ = 0, h_ = 0.01L;
  bool is_valid_ = true;
};

}  // namespace constraint_sim::engine::reference
