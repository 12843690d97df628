#include "engine/methods/event_driven/contacts/load_sharing.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Acts = ContactEquations::Acts;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Share of the mean normal force; contacts with less can bear more.
constexpr double kLeastNormalShare = 1e-3;
constexpr int kMostSharingRounds = 4;  // rounds of Newton's method
constexpr double kLeastStep = 0.1;     // least step of a round
constexpr double kWorthwhile = 1.05;   // growth of the margin that a round has to reach
constexpr double kBeyond = 0.1;        // share of the mean normal force, and of the round before

// Factor L of the inverse Hessian L Lᵀ of the barrier at x in a cone; without friction along the
// normal only. The inverse is x xᵀ − D J/2 with D = xᵀ J x, and x scaled to a slope of 1.
Matrix3d metric_in_cone(const Vector3d& x, double friction) {
  Matrix3d L = Matrix3d::Zero();
  if (friction == 0.0) {
    L(0, 0) = x[0];
    return L;
  }
  const Vector3d scaled(friction * x[0], x[1], x[2]);
  const double t = scaled.tail<2>().norm();
  const double D = std::max((scaled[0] - t) * (scaled[0] + t), 0.0);
  Matrix3d inverse = scaled * scaled.transpose();
  inverse.diagonal() += 0.5 * D * Vector3d(-1.0, 1.0, 1.0);
  L = inverse.llt().matrixL();
  L.row(0) /= friction;
  return L;
}

// Largest acceleration of a contact that other forces change [m/s²].
double change_of_accelerations(const ContactProblem& problem, const List<double>& forces) {
  const std::size_t n = forces.size();
  double largest = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    double change = 0.0;
    for (std::size_t j = 0; j < n; ++j)
      change += problem.cone.A[n * j + i] * (problem.force[j] - forces[j]);
    largest = std::max(largest, std::abs(change));
  }
  return largest;
}

}  // namespace

// Lists the acting contacts: one column along the normal, with slip friction, for a slipping
// contact, three columns for a sticking contact. Held coordinates have a row only, since their
// forces stay.
void LoadSharing::list_contacts(const ContactProblem& problem, const ContactEquations& equations) {
  shares_.clear();
  for (const TouchingContact& touching : problem.responses.contacts()) {
    const ContactEquations::Contact& contact = equations.contacts()[touching.contact];
    if (contact.acts == Acts::kOpen) continue;
    Share share{touching.contact,  touching.column, contact.friction,
                touching.is_rough, false,           Vector2d::Zero()};
    share.sticks = touching.is_rough && contact.acts == Acts::kSticks;
    if (touching.is_rough && !share.sticks)
      share.direction = touching.frame.rightCols<2>().transpose() * contact.direction;
    shares_.push_back(share);
  }
}

// Mean normal force of the contacts between the two bodies of a contact.
double LoadSharing::mean_beside(const ContactPairs& pairs, const Share& of,
                                const List<double>& force) const {
  double sum = 0.0, count = 0.0;
  for (const Share& other : shares_) {
    if (!pairs.are_of_one(other.contact, of.contact)) continue;
    sum += std::max(force[other.column], 0.0);
    count += 1.0;
  }
  return sum / count;
}

// Least margin of a contact to its nearest bound, as a share of the mean normal force.
double LoadSharing::least_margin(const ContactPairs& pairs, const List<double>& force) const {
  double least = kInfinity;
  for (const Share& of : shares_) {
    double left = force[of.column];
    if (of.sticks)
      left = std::min(left,
                      of.friction * left - math::hypot(force[of.column + 1], force[of.column + 2]));
    const double mean = mean_beside(pairs, of, force);
    if (left != 0.0 || mean != 0.0) least = std::min(least, left / mean);
  }
  return least;
}

// Computes the search direction at the present forces, in `step_`. With G the effect of forces on
// rows, x the forces and L Lᵀ the inverse Hessian of the barrier, Newton's step is x − L y, where y
// is the least solution of G L y = G x. `beyond`: relaxation of bounds, as a share of the mean
// normal force. Returns false where only one distribution exists.
bool LoadSharing::find_step(const ContactPairs& pairs, const ContactProblem& problem,
                            const ContactEquations& equations, double beyond) {
  const List<double>&force = problem.force, &response = problem.cone.A;
  const std::size_t n = force.size();
  List<std::size_t> rows;
  for (const Share& of : shares_)
    for (std::size_t k = 0; k < (of.sticks ? 3 : 1); ++k) rows.push_back(of.column + k);
  const std::size_t columns = rows.size();
  const List<std::size_t>& coordinates = problem.responses.coordinates();
  for (std::size_t k = 0; k < coordinates.size(); ++k)
    if (equations.joints().coordinates()[coordinates[k]].state.hold != Hold::kNone)
      rows.push_back(problem.responses.of_contacts() + k);
  const std::size_t count = rows.size();
  double* const M = factors_.resize(count);
  std::fill_n(M, count * count, 0.0);
  List<double> right(count, 0.0);
  List<Matrix3d> metrics;
  List<Vector3d> places;
  std::size_t first = 0;
  for (const Share& of : shares_) {
    const Eigen::Index size = of.sticks ? 3 : 1;
    Vector3d x(force[of.column] + beyond * mean_beside(pairs, of, force), 0.0, 0.0);
    if (of.sticks) x.tail<2>() << force[of.column + 1], force[of.column + 2];
    places.push_back(x);
    metrics.push_back(metric_in_cone(x, of.sticks ? of.friction : 0.0));
    for (std::size_t i = 0; i < count; ++i) {
      const double* const A = response.data() + n * of.column + rows[i];
      const double own = response[n * rows[i] + rows[i]];
      Vector3d G(A[0], 0.0, 0.0);
      if (of.is_rough && !of.sticks)
        G[0] -= of.friction * (of.direction[0] * A[n] + of.direction[1] * A[2 * n]);
      if (of.sticks) G.tail<2>() << A[n], A[2 * n];
      if (own > 0.0) G /= std::sqrt(own);
      right[i] += G.dot(x);
      const Vector3d by = metrics.back().transpose() * G;
      for (Eigen::Index k = 0; k < size; ++k)
        M[count * (first + static_cast<std::size_t>(k)) + i] = by[k];
    }
    first += static_cast<std::size_t>(size);
  }
  factors_.factor(LeastNormSolver::kDependentPivot);
  if (factors_.rank() == columns) return false;
  factors_.solve(right.data());
  step_.assign(n, 0.0);
  first = 0;
  for (std::size_t k = 0; k < shares_.size(); ++k) {
    const Share& of = shares_[k];
    Vector3d y(right[first], 0.0, 0.0);
    if (of.sticks) y.tail<2>() << right[first + 1], right[first + 2];
    first += of.sticks ? 3 : 1;
    Vector3d step = places[k] - metrics[k] * y;
    if (of.is_rough && !of.sticks) step.tail<2>() = -of.friction * step[0] * of.direction;
    for (std::size_t i = 0; i < (of.is_rough ? 3 : 1); ++i)
      step_[of.column + i] = step[static_cast<Eigen::Index>(i)];
  }
  return true;
}

double LoadSharing::share(const ContactPairs& pairs, CountedSolver* solver, ContactProblem* problem,
                          ContactEquations* equations) {
  List<double>& force = problem->force;
  list_contacts(*problem, *equations);
  const List<double> unshared = force;
  const double first = least_margin(pairs, force);
  double margin = first;
  List<double> next;
  double beyond = kBeyond;
  for (int round = 0; round < kMostSharingRounds; ++round, beyond *= kBeyond) {
    solver->add(cost_of_newton_step(force.size()));
    if (!find_step(pairs, *problem, *equations, beyond)) return 0.0;
    const double before = margin;
    for (double step = 1.0; margin == before && step > kLeastStep; step *= 0.5) {
      next = force;
      for (std::size_t i = 0; i < next.size(); ++i) next[i] += step * step_[i];
      const double now = least_margin(pairs, next);
      if (now > 0.0 && now > kWorthwhile * margin) margin = now;
    }
    if (margin == before) break;
    force = next;
  }
  if (!(margin > first)) return 0.0;
  for (const Share& of : shares_) {
    const double mean = mean_beside(pairs, of, force);
    ContactEquations::Contact& contact = equations->contacts()[of.contact];
    if (mean > 0.0) contact.normal_share = std::max(force[of.column] / mean, kLeastNormalShare);
    contact.tangent_share = std::sqrt(contact.normal_share);
  }
  return change_of_accelerations(*problem, unshared);
}

}  // namespace constraint_sim::engine
