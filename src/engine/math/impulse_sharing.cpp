#include "engine/math/impulse_sharing.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "engine/math/least_norm_solver.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector2d;

constexpr double kNoRate = 1e-8;       // share of the largest rate; less is zero
constexpr double kNoDirection = 1e-6;  // share of a unit impulse; less is no other sharing

double shared_response(const ConeProblem& problem, std::size_t row, std::size_t column) {
  return problem.A[problem.b.size() * column + row];
}

}  // namespace

double ImpulseSharing::indeterminate_rate(const ConeProblem& problem, const List<double>& p) {
  if (!list_loaded(problem, p) || unknowns_.size() < 2) return 0.0;
  set_matrix(problem);
  factors_.factor(LeastNormSolver::kDependentPivot);
  if (factors_.is_regular()) return 0.0;
  double largest = 0.0;
  for (std::size_t i = 0; i < unknowns_.size(); ++i) {
    if (!find_direction(i)) continue;
    for (const double sign : {1.0, -1.0})
      largest = std::max(largest, change_along(sign, problem, p));
  }
  return largest;
}

// Lists the rows that bear a load or may bear one without a change of their rates. Returns whether
// any slips.
bool ImpulseSharing::list_loaded(const ConeProblem& problem, const List<double>& p) {
  rows_.clear();
  unknowns_.clear();
  scale_.clear();
  u_ = problem.b;
  for (std::size_t j = 0; j < p.size(); ++j)
    for (std::size_t i = 0; i < p.size(); ++i) u_[i] += shared_response(problem, i, j) * p[j];
  double fastest = 0.0;
  for (const double rate : problem.b) fastest = std::max(fastest, std::abs(rate));
  const double none = kNoRate * fastest;
  bool slips = false;
  const std::size_t of_contacts = 3 * problem.contacts.size();
  for (std::size_t c = 0; c < problem.contacts.size(); ++c) {
    const std::size_t column = 3 * c;
    if (u_[column] > none) continue;
    LoadedRow row{column, 3, problem.contacts[c].friction, Vector2d::Zero(), 0.0, kInfinity};
    const Vector2d slip(u_[column + 1], u_[column + 2]);
    if (slip.norm() > none) {
      row.size = 1;
      row.direction = slip.normalized();
      slips = true;
    }
    rows_.push_back(row);
  }
  for (std::size_t k = 0; k < problem.rows.size(); ++k) {
    const BoundedRow& bounds = problem.rows[k];
    const std::size_t column = of_contacts + k;
    if (std::abs(u_[column]) > none || !(bounds.least < bounds.most)) continue;
    rows_.push_back({column, 1, 0.0, Vector2d::Zero(), bounds.least, bounds.most});
  }
  for (const LoadedRow& row : rows_)
    for (std::size_t k = 0; k < row.size; ++k) {
      unknowns_.push_back(row.column + k);
      const double own = shared_response(problem, row.column + k, row.column + k);
      scale_.push_back(own > 0.0 ? 1.0 / std::sqrt(own) : 1.0);
    }
  return slips;
}

// Fills G, the rates of loaded rows by unit impulses. Rates and impulses are scaled so that the
// diagonal of A has ones.
void ImpulseSharing::set_matrix(const ConeProblem& problem) {
  const std::size_t count = unknowns_.size();
  matrix_.resize(count * count);
  std::size_t j = 0;
  for (const LoadedRow& row : rows_)
    for (std::size_t k = 0; k < row.size; ++k, ++j)
      for (std::size_t i = 0; i < count; ++i) {
        double rate = shared_response(problem, unknowns_[i], row.column + k);
        for (std::size_t t = 0; t < 2 && !row.direction.isZero(0.0); ++t)
          rate -= row.friction * row.direction[static_cast<Eigen::Index>(t)] *
                  shared_response(problem, unknowns_[i], row.column + 1 + t);
        matrix_[count * j + i] = scale_[i] * rate * scale_[j];
      }
  std::copy(matrix_.begin(), matrix_.end(), factors_.resize(count));
}

// Projects a unit impulse on all impulses without effect on loaded rows: z = e − x with the least
// x of G x = G e. Returns false where nothing is left.
bool ImpulseSharing::find_direction(std::size_t unit) {
  const std::size_t count = unknowns_.size();
  const auto first = matrix_.begin() + static_cast<std::ptrdiff_t>(count * unit);
  least_.assign(first, first + static_cast<std::ptrdiff_t>(count));
  factors_.solve(least_.data());
  z_.assign(u_.size(), 0.0);
  double largest = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const double part = (i == unit ? 1.0 : 0.0) - least_[i];
    largest = std::max(largest, std::abs(part));
    z_[unknowns_[i]] = scale_[i] * part;
  }
  for (const LoadedRow& row : rows_)
    for (std::size_t t = 0; t < 2 && !row.direction.isZero(0.0); ++t)
      z_[row.column + 1 + t] =
          -row.friction * row.direction[static_cast<Eigen::Index>(t)] * z_[row.column];
  return largest > kNoDirection;
}

// Largest change of a rate of a contact within the bounds along ±z.
double ImpulseSharing::change_along(double sign, const ConeProblem& problem,
                                    const List<double>& p) const {
  const std::size_t n = p.size();
  double most = 0.0, fastest = 0.0;
  for (const double impulse : p) most += std::abs(impulse);
  for (const double part : z_) fastest = std::max(fastest, std::abs(part));
  double distance = most / fastest;  // where no bound ends it, as between walls
  for (const LoadedRow& row : rows_) distance = std::min(distance, distance_to_bound(row, sign, p));
  double largest = 0.0;
  for (std::size_t i = 0; i < 3 * problem.contacts.size(); ++i) {
    double change = 0.0;
    for (std::size_t j = 0; j < n; ++j) change += shared_response(problem, i, j) * z_[j];
    largest = std::max(largest, distance * std::abs(change));
  }
  return largest;
}

// Distance along ±z, in units of z, to the bound of the first impulse of a row, or of the friction
// of a sticking one.
double ImpulseSharing::distance_to_bound(const LoadedRow& row, double sign,
                                         const List<double>& p) const {
  const double rate = sign * z_[row.column], now = p[row.column];
  double distance = kInfinity;
  if (rate < 0.0) distance = std::max(0.0, (now - row.least) / -rate);
  if (rate > 0.0) distance = std::max(0.0, (row.most - now) / rate);
  if (row.size < 3) return distance;
  // μ² p_n² − ‖p_t‖² = a s² + 2 b s + c = 0
  const Vector2d t(p[row.column + 1], p[row.column + 2]);
  const Vector2d t_rate(sign * z_[row.column + 1], sign * z_[row.column + 2]);
  const double squared = row.friction * row.friction;
  const double a = squared * rate * rate - t_rate.squaredNorm();
  const double b = squared * now * rate - t.dot(t_rate);
  const double c = std::max(0.0, squared * now * now - t.squaredNorm());
  const double root = std::sqrt(std::max(0.0, b * b - a * c));
  if (b < 0.0) return b * b < a * c ? distance : std::min(distance, c / (root - b));
  return a < 0.0 ? std::min(distance, (b + root) / -a) : distance;
}

}  // namespace constraint_sim::engine
