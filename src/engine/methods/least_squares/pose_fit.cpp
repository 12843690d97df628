#include "engine/methods/least_squares/pose_fit.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/numbers.h"
#include "engine/methods/least_squares/shares.h"

namespace constraint_sim::engine {
namespace {

// Share of the weights on the diagonal where a right-hand side cannot be met.
constexpr double kInconsistentShare = 1e-8;
constexpr int kMostMarquardtSteps = 60;
constexpr double kMostShare = 1e4;
constexpr double kRejectedShare = 1e-6;  // minimum after a rejected step
// Share of the sum of squared errors that is rounding: a step may add it.
constexpr double kErrorSumRounding = 1e-14;

}  // namespace

PoseFit::PoseFit(std::size_t rows, BodyVectors zeros)
    : values_(rows, 0.0), b_(rows, 0.0), change_(std::move(zeros)) {}

// Computes change_ = −M⁻¹Gᵀ (A + µD)⁻¹ C, with D the weights. The part of C that no motion can
// remove is taken out first, by D t = C − µD (A + µD)⁻¹ C with t = (A + µD)⁻¹ A D⁻¹C; rounding then
// falls with the gradient Gᵀ D⁻¹ C instead of C.
void PoseFit::find_correction(double share, const List<double>& compliance, RegularizedRows* rows) {
  clear(&change_);
  rows->factor(share, weights_, &compliance);
  for (std::size_t i = 0; i < b_.size(); ++i) b_[i] = values_[i] / weights_[i];
  rows->add_response(b_, &change_);
  for (std::size_t i = 0; i < b_.size(); ++i) b_[i] = rows->apply(rows->rows()[i], change_);
  rows->solve(&b_);
  for (std::size_t i = 0; i < b_.size(); ++i)
    b_[i] = rows->rows()[i].is_spring ? 0.0 : -weights_[i] * b_[i];
  rows->solve(&b_);
  clear(&change_);
  rows->add_response(b_, &change_);
}

int PoseFit::fit(const IslandBodies& bodies, const RowTargets& targets,
                 const List<double>& compliance, RegularizedRows* rows,
                 Configuration* configuration, RegularizedRows::Geometry* geometry) {
  rows->linearize(*geometry, *geometry, *configuration);
  rows->find_weights(&weights_);
  double sum = targets.errors(*rows, *geometry, weights_, &values_);
  double share = 0.0, before = kInfinity;
  Configuration moved;
  RegularizedRows::Geometry there;
  int iterations = 0;
  while (iterations < kMostMarquardtSteps && share <= kMostShare) {
    const double least = kInconsistentShare * std::sqrt(largest_of(values_) / targets.scale());
    share = std::max(share, std::clamp(least, kLeastShare, kInconsistentShare));
    ++iterations;
    find_correction(share, compliance, rows);
    moved = *configuration;
    const double most = bodies.displace(change_, &moved);
    const bool is_rounding = most < kChangeRounding * targets.scale() && most > 0.5 * before;
    if (!(most > 16.0 * kEpsilon * targets.scale()) || is_rounding) break;
    rows->measure(moved, &there);
    const double next = targets.errors(*rows, there, weights_, &values_);
    if (!(next <= sum * (1.0 + kErrorSumRounding))) {
      share = std::max(10.0 * share, kRejectedShare);
      before = kInfinity;
      targets.errors(*rows, *geometry, weights_, &values_);
      continue;
    }
    sum = next;
    before = most;
    std::swap(*configuration, moved);
    std::swap(*geometry, there);
    share *= 0.2;
    rows->linearize(*geometry, *geometry, *configuration);
  }
  return iterations;
}

}  // namespace constraint_sim::engine
