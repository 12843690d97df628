#include "engine/methods/least_squares/rate_fit.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/methods/least_squares/shares.h"

namespace constraint_sim::engine {
namespace {

// Share of the weights on the diagonal where rates cannot be met. Rates then cause velocities of up
// to 1/(2 sqrt(share)) times the rates.
constexpr double kInconsistentRates = 1e-6;
constexpr double kMet = 1e-6;             // [m]
constexpr double kRateMet = 1e-6;         // share of the largest speed
constexpr double kRateMetAtRest = 1e-12;  // [1/s] share of the scene's size

}  // namespace

RateFit::RateFit(std::size_t rows, BodyVectors zeros)
    : b_(rows, 0.0), drive_rates_(rows, 0.0), drive_(std::move(zeros)) {}

double RateFit::fit(const RowTargets& targets, const Configuration& configuration,
                    const RegularizedRows::Geometry& geometry, RegularizedRows* rows,
                    BodyVectors* velocity, List<double>* impulses) {
  rows->linearize(geometry, geometry, configuration);
  rows->find_weights(&weights_);
  find_drive(targets, rows);
  rows->factor(kLeastShare, weights_, nullptr);
  double work = 0.0;
  for (int pass = 0; pass < 2; ++pass) {
    for (std::size_t i = 0; i < b_.size(); ++i) {
      const RegularizedRows::Row& row = rows->rows()[i];
      b_[i] = row.is_spring ? 0.0 : drive_rates_[i] - rows->apply(row, *velocity);
    }
    rows->solve(&b_);
    rows->add_response(b_, velocity);
    for (std::size_t i = 0; i < b_.size(); ++i) {
      (*impulses)[i] += b_[i];
      work += b_[i] * drive_rates_[i];
    }
  }
  return work;
}

void RateFit::find_drive(const RowTargets& targets, RegularizedRows* rows) {
  clear(&drive_);
  std::fill(drive_rates_.begin(), drive_rates_.end(), 0.0);
  if (!targets.is_driven()) return;
  List<double> rates(b_.size(), 0.0);
  for (std::size_t i = 0; i < rates.size(); ++i)
    if (!rows->rows()[i].is_spring) rates[i] = targets.rate_of_bodies(*rows, i);
  solve_drive(kLeastShare, rates, rows);
  double off = 0.0;
  for (std::size_t i = 0; i < rates.size(); ++i)
    off = std::max(off, std::abs(drive_rates_[i] - rates[i]));
  if (!(off <= kReachable * largest_of(rates))) solve_drive(kInconsistentRates, rates, rows);
}

void RateFit::solve_drive(double share, const List<double>& rates, RegularizedRows* rows) {
  clear(&drive_);
  std::fill(drive_rates_.begin(), drive_rates_.end(), 0.0);
  rows->factor(share, weights_, nullptr);
  for (int pass = 0; pass < 2; ++pass) {
    for (std::size_t i = 0; i < b_.size(); ++i) b_[i] = rates[i] - drive_rates_[i];
    rows->solve(&b_);
    rows->add_response(b_, &drive_);
    for (std::size_t i = 0; i < b_.size(); ++i)
      if (!rows->rows()[i].is_spring) drive_rates_[i] = rows->apply(rows->rows()[i], drive_);
  }
}

bool RateFit::can_be_met(const RowTargets& targets, const List<double>& values,
                         double largest_speed, const BodyVectors& velocity, RegularizedRows* rows) {
  if (!(largest_of(values) <= kMet)) return false;
  double speed = largest_speed, off = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (rows->rows()[i].is_spring) continue;
    const double rate = targets.rate_of_bodies(*rows, i);
    speed = std::max(speed, std::abs(rate));
    off = std::max(off, std::abs(rate - rows->apply(rows->rows()[i], velocity)));
  }
  if (off > kRateMet * speed + kRateMetAtRest * targets.scale()) return false;
  // Tests the part of C that no displacement can remove.
  rows->factor(kLeastShare, weights_, nullptr);
  b_ = values;
  rows->solve(&b_);
  for (std::size_t i = 0; i < b_.size(); ++i)
    if (std::abs(kLeastShare * weights_[i] * b_[i]) > kReachable * targets.scale()) return false;
  return true;
}

}  // namespace constraint_sim::engine
