#include "engine/math/cone_solver.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kFreeDirection = 1e-12;  // share of the trace: a direction without compliance
constexpr double kDone = 1e-14;           // share of the largest rate that is rounding
// Share of the largest rate that is rounding where another step gains nothing.
constexpr double kNearlyDone = 1e-12;
constexpr double kStrict = 1e-8;  // share of the largest rate by which a row leaves its bound
// Share of the largest rate that rounding adds along directions without effect.
constexpr double kConeSolved = 1e-9;
constexpr double kRateRounding = 4.0 * kEpsilon;  // share of the terms of a rate that is rounding
// A polish precedes sweeps 0, 1, 2, 4 and so on; 2⁸ + 1 sweeps include the polish before 2⁸.
constexpr int kMostSweeps = 257;
constexpr std::size_t kMostKnown = 8;  // solutions that are kept
// Compliance of the interior-point method, of a response of 1 on average. Newton's method then
// removes its effect. Much less lets rounding choose among the solutions for a singular A.
constexpr double kCompliance = 1e-6;
constexpr int kMostTogether = 8;  // steps of Newton's method with all rows together
// Steps of Newton's method in a polish, and of them those that do not halve the residual.
constexpr int kMostNewton = 40, kMostWorse = 2;
// Most steps of Newton's method for κ; six suffice without bisection.
constexpr int kMostKappaSteps = 100;
constexpr int kMostStalled = 3;  // polishes without halving the residual: rounding

// Costs of a sweep for each row and each pair of rows [substeps of a group with one point]; fitted
// to costs of 3, 18 and 36 rows.
constexpr double kSweepOfRow = 0.02, kSweepOfPair = 7e-5;
/// Returns the cost of a sweep over `rows` rows, in substeps.
double sweep_cost(std::size_t rows) {
  const auto n = static_cast<double>(rows);
  return kSweepOfRow * n + kSweepOfPair * n * n;
}

/// Tangential impulse p_t of a slipping contact as a function of κ, with u_t = −κ p_t, and the
/// normal impulse that goes with it.
class Slipping {
 public:
  Slipping(const Matrix3d& A, const Vector3d& b)
      : row_(A.block<1, 2>(0, 1).transpose() / A(0, 0)), pushed_(-b[0] / A(0, 0)) {
    const Matrix2d S = A.block<2, 2>(1, 1) - A.block<2, 1>(1, 0) * row_.transpose();
    const Vector2d c = b.tail<2>() + A.block<2, 1>(1, 0) * pushed_;
    solver_.computeDirect(S);
    c_ = solver_.eigenvectors().transpose() * c;
    least_ = kFreeDirection * A.trace();
    scale_ = b.norm();
  }

  /// Whether κ = 0, sticking, is possible: no direction without compliance has a rate.
  bool can_stick() const {
    for (Index i = 0; i < 2; ++i)
      if (solver_.eigenvalues()[i] <= least_ && std::abs(c_[i]) > kFreeDirection * scale_)
        return false;
    return true;
  }
  Vector3d impulse(double kappa) const { return in_full(tangential(kappa)); }

  /// Returns κ > 0 for which the impulse is on the cone of friction μ, or infinity. Newton's method
  /// on μ p_n/‖p_t‖ − 1, which is almost linear in κ, within a bracket.
  double kappa_on_cone(double mu, double start) const {
    double low = 0.0, high = kInfinity, kappa = start;
    double least = high;  // error of the last step
    for (int k = 0; k < kMostKappaSteps && low < (1.0 - 2.0 * kEpsilon) * high; ++k) {
      const Vector2d p = tangential(kappa);
      const double r = p.norm(), most = mu * (pushed_ - row_.dot(solver_.eigenvectors() * p));
      const double off = most / r - 1.0;
      (off >= 0.0 ? high : low) = kappa;
      Vector2d slope;
      for (Index i = 0; i < 2; ++i)
        slope[i] = -p[i] / (std::max(solver_.eigenvalues()[i], 0.0) + kappa);
      const double rate =
          (-mu * row_.dot(solver_.eigenvectors() * slope) - most * p.dot(slope) / (r * r)) / r;
      double next = kappa - off / rate;
      const bool is_slow = !(std::abs(off) <= 0.5 * least);
      least = std::abs(off);
      if (std::abs(next - kappa) <= 2.0 * kEpsilon * kappa) return kappa;
      // Bisection by geometric means, since κ spans many orders of magnitude.
      if (is_slow || !(next > low && next < high)) {
        if (!std::isfinite(high))
          next = 16.0 * kappa;
        else
          next = low > 0.0 && high > 4.0 * low ? std::sqrt(low * high) : 0.5 * (low + high);
      }
      kappa = next;
    }
    return high;
  }

 private:
  /// Returns the tangential impulse for κ, in the basis of the eigenvectors.
  Vector2d tangential(double kappa) const {
    Vector2d p;
    for (Index i = 0; i < 2; ++i) {
      const double s = std::max(solver_.eigenvalues()[i], 0.0) + kappa;
      p[i] = s > (kappa > 0.0 ? 0.0 : least_) ? -c_[i] / s : 0.0;
    }
    return p;
  }
  Vector3d in_full(const Vector2d& p) const {
    Vector3d all;
    all.tail<2>() = solver_.eigenvectors() * p;
    all[0] = pushed_ - row_.dot(all.tail<2>());
    return all;
  }

  Vector2d row_;   // effect of tangential impulses along the normal
  double pushed_;  // normal impulse without friction
  Eigen::SelfAdjointEigenSolver<Matrix2d> solver_;
  Vector2d c_;
  double least_, scale_;
};

}  // namespace

bool solve_contact(const Matrix3d& A, const Vector3d& b, const ConeContact& contact, Vector3d* p) {
  p->setZero();
  if (b[0] >= 0.0) return true;
  if (!(A(0, 0) > kFreeDirection * A.trace())) return false;
  const double mu = contact.friction;
  if (contact.slips || mu == 0.0) {
    Vector3d along = Vector3d::UnitX();
    along.tail<2>() = -mu * contact.direction;
    const double response = A.row(0).dot(along);
    // Friction pushes the bodies together (Painlevé).
    if (!(response > kFreeDirection * A.trace())) return false;
    *p = -b[0] / response * along;
    return true;
  }
  const Slipping slipping(A, b);
  const auto beyond = [&](const Vector3d& q) { return q.tail<2>().norm() - mu * q[0]; };
  if (slipping.can_stick()) {
    *p = slipping.impulse(0.0);
    if (beyond(*p) <= 0.0) return true;
  }
  const double kappa = slipping.kappa_on_cone(mu, A.trace());
  if (!std::isfinite(kappa)) return false;
  *p = slipping.impulse(kappa);
  const double length = p->tail<2>().norm();
  if (length > mu * (*p)[0]) p->tail<2>() *= mu * (*p)[0] / length;
  return (*p)[0] >= 0.0;
}

namespace {

// Whether contacts have the same friction and slip or not alike.
bool are_alike(const List<ConeContact>& a, const List<ConeContact>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const ConeContact& left, const ConeContact& right) {
                      return left.slips == right.slips && left.friction == right.friction;
                    });
}

Vector3d into_cone(const Vector3d& x, double mu) {
  const double t = x.tail<2>().norm();
  if (t <= mu * x[0]) return x;
  if (mu * t <= -x[0]) return Vector3d::Zero();
  Vector3d on;
  on[0] = (x[0] + mu * t) / (1.0 + mu * mu);
  on.tail<2>() = x.tail<2>() * (mu * on[0] / t);
  return on;
}

}  // namespace

// Solves the problem by the first method that finds a solution. Slips, whose friction moves other
// contacts, may need sweeps.
bool ConeSolver::solve(const ConeProblem& problem, List<double>* p, SolveEffort* effort) {
  p->resize(problem.b.size());
  if (effort->is_over()) return false;
  effort_ = effort;
  effort->spent += cost_of_newton_step(p->size());  // cost of the setup
  set(problem);
  bool is_known = false;
  bool is_found = find_again(p->data(), &is_known) || (!is_known && find_together(p->data()));
  if (!is_found && find_inside(p->data())) {
    is_found = true;
    keep(p->data());
  }
  if (!is_found) {
    start(p->data());
    is_found = find(p->data());
  }
  unscale(problem, p->data());
  return is_found;
}

void ConeSolver::set(const ConeProblem& problem) {
  scaled_ = problem;
  const auto n = problem.b.size();
  scale_.resize(n);
  const Matrix of(problem.A.data(), size(), size());
  for (Index i = 0; i < end_of_contacts(); i += 3) {
    const double trace = of.block<3, 3>(i, i).trace();
    std::fill_n(scale_.begin() + i, 3, trace > 0.0 ? std::sqrt(3.0 / trace) : 0.0);
  }
  for (Index i = end_of_contacts(); i < size(); ++i) {
    const double response = of(i, i);
    BoundedRow& row = scaled_.rows[row_at(i)];
    double& scale = scale_[static_cast<std::size_t>(i)];
    scale = response > 0.0 ? std::sqrt(1.0 / response) : 0.0;
    row.least = response > 0.0 ? row.least / scale : 0.0;
    row.most = response > 0.0 ? row.most / scale : 0.0;
  }
  largest_rate_ = 0.0;
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = 0; i < n; ++i) scaled_.A[n * j + i] *= scale_[i] * scale_[j];
    scaled_.b[j] *= scale_[j];
    largest_rate_ = std::max(largest_rate_, std::abs(scaled_.b[j]));
  }
}

// Converts p to the units of `problem`; impulses at a bound are exactly the bound.
void ConeSolver::unscale(const ConeProblem& problem, double* p) const {
  for (Index i = 0; i < size(); ++i) {
    const double scale = scale_[static_cast<std::size_t>(i)], x = p[i];
    p[i] = scale * x;
    if (i < end_of_contacts() || scale == 0.0) continue;
    const BoundedRow &here = scaled_.rows[row_at(i)], &there = problem.rows[row_at(i)];
    if (x == here.most) p[i] = there.most;
    if (x == here.least) p[i] = there.least;
  }
}

void ConeSolver::start(double* p) const {
  std::fill_n(p, end_of_contacts(), 0.0);
  for (Index i = end_of_contacts(); i < size(); ++i) p[i] = within(i, 0.0);
}

double ConeSolver::within(Index i, double x) const {
  const BoundedRow& row = scaled_.rows[row_at(i)];
  return std::min(std::max(x, row.least), row.most);
}

const double* ConeSolver::rates(const double* p) {
  u_ = scaled_.b;
  Numbers u(u_.data(), size());
  for (Index j = 0; j < size(); ++j)
    if (p[j] != 0.0) u += matrix().col(j) * p[j];
  return u_.data();
}

/// Solves by Newton's method from all pushed rows acting together. Also returns false without
/// strict complementarity, since other rows might then share an impulse.
bool ConeSolver::find_together(double* p) {
  start(p);
  double before = residual(p);
  if (before <= kDone * largest_rate_) return true;
  for (int k = 0, worse = 0; k < kMostTogether && worse < kMostWorse && count_newton(); ++k) {
    take_newton(true, p);
    const double now = residual(p);
    worse += now > 0.5 * before ? 1 : 0;
    const bool is_done =
        now <= kDone * largest_rate_ ||
        (now > 0.5 * before && std::max(now, before) <= kNearlyDone * largest_rate_);
    if (is_done) return is_strict(p);
    before = now;
  }
  return false;
}

/// Solves by Newton's method from the known solution with the least residual. A row of events, as
/// of a box that rocks to rest, poses two or three problems in turn. `is_known`: whether a problem
/// with the same contacts has been solved.
bool ConeSolver::find_again(double* p, bool* is_known) {
  *is_known = false;
  double least = kInfinity;
  for (std::size_t k = 0; k < std::min(solutions_, known_.size()); ++k) {
    const Known& known = known_[k];
    if (known.p.size() != scaled_.b.size() || !are_alike(known.contacts, scaled_.contacts))
      continue;
    *is_known = true;
    tried_ = known.p;
    for (double& x : tried_) x *= largest_rate_ / known.largest_rate;
    const double now = residual(tried_.data());
    if (!(now < least)) continue;
    least = now;
    std::copy(tried_.begin(), tried_.end(), p);
  }
  if (least == kInfinity) return false;
  polish(p);
  return residual(p) <= rounding(p);
}

/// Keeps a solution, in the place of the oldest one.
void ConeSolver::keep(const double* p) {
  const std::size_t place = solutions_++ % kMostKnown;
  if (known_.size() <= place) known_.resize(place + 1);
  known_[place].contacts = scaled_.contacts;
  known_[place].largest_rate = largest_rate_;
  known_[place].p.assign(p, p + size());
}

/// Solves by the interior-point method, to the accuracy from which Newton's method finds the
/// solution. With strict complementarity that is the first one. Returns false, and leaves p as it
/// was, where the residual remains too large.
bool ConeSolver::find_inside(double* p) {
  double least = kConeSolved * largest_rate_;
  bool is_found = false;
  interior_point_.begin(scaled_, largest_rate_, kCompliance);
  tried_.resize(scaled_.b.size());
  for (const double within : {1e-10, 1e-14, 1e-18}) {
    if (!interior_point_.approach(within, effort_)) break;
    interior_point_.write(tried_.data());
    polish(tried_.data());
    const double now = residual(tried_.data());
    if (!(now <= least)) continue;
    is_found = true;
    least = now;
    std::copy(tried_.begin(), tried_.end(), p);
    if (now <= kNearlyDone * largest_rate_) break;
  }
  return is_found;
}

/// Whether strict complementarity holds: a rate keeps each row at its bound by a margin.
bool ConeSolver::is_strict(const double* p) {
  const double* const u = rates(p);
  const double least = kStrict * largest_rate_;
  for (Index i = 0; i < end_of_contacts(); i += 3) {
    const ConeContact& of = contact(i);
    if (p[i] <= 0.0 && !(u[i] > least)) return false;
    const bool is_at_cone = math::hypot(p[i + 1], p[i + 2]) >= (1.0 - kStrict) * of.friction * p[i];
    if (p[i] > 0.0 && !of.slips && of.friction > 0.0 && is_at_cone &&
        !(math::hypot(u[i + 1], u[i + 2]) > least))
      return false;
  }
  for (Index i = end_of_contacts(); i < size(); ++i) {
    const BoundedRow& row = scaled_.rows[row_at(i)];
    const bool is_at_bound = row.least < row.most && (p[i] == row.least || p[i] == row.most);
    if (is_at_bound && !(std::abs(u[i]) > least)) return false;
  }
  return true;
}

/// Solves from p on by sweeps and Newton's method, or finds the p with the least residual; returns
/// whether p is a solution.
bool ConeSolver::find(double* p) {
  List<double>&x = swept_, &tried = tried_;
  x.assign(p, p + size());
  double least = residual(p);
  const auto consider = [&](const List<double>& other) {
    const double now = residual(other.data());
    if (!(now < least)) return;
    least = now;
    std::copy(other.begin(), other.end(), p);
  };
  double before = least;
  for (int k = 0, stalled = 0; least > rounding(p) && k < kMostSweeps; ++k) {
    if (effort_->is_over()) return false;
    effort_->spent += sweep_cost(x.size());
    if ((k & (k - 1)) == 0) {
      tried = x;
      polish(tried.data());
      consider(tried);
      stalled = least <= kConeSolved * largest_rate_ && least > 0.5 * before ? stalled + 1 : 0;
      if (stalled == kMostStalled) break;
      before = least;
    }
    if (!sweep(k % 2 == 1, x.data())) return false;
    consider(x);
  }
  return least <= kConeSolved * largest_rate_;
}

/// Solves contact after contact, forwards or backwards (projected Gauss-Seidel). Returns false
/// where a contact has no solution.
bool ConeSolver::sweep(bool back, double* p) {
  rates(p);
  Numbers u(u_.data(), size()), all(p, size());
  for (Index k = 0; k < end_of_contacts(); k += 3) {
    const Index i = back ? end_of_contacts() - 3 - k : k;
    const Matrix3d own = matrix().block<3, 3>(i, i);
    const Vector3d before = all.segment<3>(i);
    Vector3d b = u.segment<3>(i) - own * before, now;
    if (std::abs(b[0]) <= kFreeDirection * largest_rate_ &&
        own(0, 0) <= kFreeDirection * own.trace())
      b[0] = 0.0;
    if (!solve_contact(own, b, contact(i), &now)) return false;
    all.segment<3>(i) = now;
    u += matrix().middleCols<3>(i) * (now - before);
  }
  for (Index k = end_of_contacts(); k < size(); ++k) {
    const Index i = back ? end_of_contacts() + size() - 1 - k : k;
    const double before = p[i];
    if (matrix()(i, i) > 0.0) p[i] = within(i, before - u[i] / matrix()(i, i));
    u += matrix().col(i) * (p[i] - before);
  }
  return true;
}

/// Returns the distance of p from a solution, as a rate: the largest change of a contact's impulse
/// by a step along its rate and back into its cone. It is 0 for solutions only, and infinite where
/// rounding of A p exceeds the accepted residual.
double ConeSolver::residual(const double* p) {
  const ConstNumbers all(p, size());
  if (size() > 0 && kEpsilon * all.lpNorm<Eigen::Infinity>() > kConeSolved * largest_rate_)
    return kInfinity;
  const double* const rate = rates(p);
  const ConstNumbers u(rate, size());
  double worst = 0.0;
  const auto consider = [&](double value) {
    if (!(value <= worst)) worst = value;  // keeps a NaN
  };
  for (Index i = 0; i < end_of_contacts(); i += 3) {
    const ConeContact& of = contact(i);
    if (of.slips || of.friction == 0.0) {
      consider(std::abs(std::min(p[i], u[i])));
      consider((all.segment<2>(i + 1) + of.friction * p[i] * of.direction).norm());
      continue;
    }
    Vector3d step = u.segment<3>(i);
    step[0] += of.friction * step.tail<2>().norm();
    const Vector3d here = all.segment<3>(i);
    consider((here - into_cone(here - step, of.friction)).norm());
  }
  for (Index i = end_of_contacts(); i < size(); ++i)
    consider(std::abs(p[i] - within(i, p[i] - u[i])));
  return worst;
}

/// Returns a residual that rounding explains: impulses that oppose each other are larger than their
/// sums.
double ConeSolver::rounding(const double* p) const {
  double largest = 0.0;
  for (Index i = 0; i < size(); ++i) {
    double terms = 0.0;
    for (Index j = 0; j < size(); ++j) terms += std::abs(matrix()(i, j) * p[j]);
    largest =
        std::max(largest, i < end_of_contacts() ? (1.0 + contact(i).friction) * terms : terms);
  }
  return std::min(std::max(kDone * largest_rate_, kRateRounding * largest),
                  kConeSolved * largest_rate_);
}

// Books the cost of a step of Newton's method. Returns false where the effort is over.
bool ConeSolver::count_newton() {
  effort_->spent += cost_of_newton_step(scaled_.b.size());
  return !effort_->is_over();
}

/// Improves p by Newton's method on which contacts are open, stick and slip; keeps the best p.
void ConeSolver::polish(double* p) {
  List<double>& x = x_;
  x.assign(p, p + size());
  double before = residual(p), least = before;
  for (int k = 0, worse = 0; least > rounding(p) && k < kMostNewton && worse < kMostWorse; ++k) {
    if (!count_newton()) return;
    take_newton(false, x.data());
    const double now = residual(x.data());
    if (now < least) {
      least = now;
      std::copy(x.begin(), x.end(), p);
    }
    worse += now > 0.5 * before ? 1 : 0;
    before = now;
  }
}

// Takes a step on the equations of Alart and Curnier (Comput. Methods Appl. Mech. Eng. 92 (1991)
// 353), J p = right to first order: to the p of least norm, or by the least step.
void ConeSolver::take_newton(bool is_of_least_norm, double* p) {
  rates(p);
  const Index n = size();
  double* const J = factors_.resize(scaled_.b.size());
  std::fill_n(J, n * n, 0.0);
  off_.assign(p, p + n);
  right_.assign(scaled_.b.size(), 0.0);
  Numbers off(off_.data(), n), right(right_.data(), n), all(p, n);
  for (Index i = 0; i < n; ++i) J[n * i + i] = 1.0;
  for (Index i = 0; i < end_of_contacts(); i += 3) write_newton_contact(i, p, J);
  for (Index i = end_of_contacts(); i < n; ++i) {
    const double u = u_[static_cast<std::size_t>(i)], x = p[i] - u, bound = within(i, x);
    if (x == bound) {
      for (Index j = 0; j < n; ++j) J[n * j + i] = matrix()(i, j);
      off[i] = u;
      right[i] = -scaled_.b[static_cast<std::size_t>(i)];
    } else {
      off[i] = p[i] - bound;
      right[i] = bound;
    }
  }
  factors_.factor(kFreeDirection);
  factors_.solve(is_of_least_norm ? right_.data() : off_.data());
  if (is_of_least_norm)
    all = right;
  else
    all -= off;
}

// Writes rows i to i + 2, of a contact, into J, which has rows of the identity there.
void ConeSolver::write_newton_contact(Index i, const double* p, double* J) {
  const Index n = size();
  const ConeContact& of = contact(i);
  const double* const u = u_.data() + i;
  const double along = p[i] - u[0];
  const Vector2d across(p[i + 1] - u[1], p[i + 2] - u[2]);
  const auto at = [&](Index k, Index column) -> double& { return J[n * column + i + k]; };
  const auto is_zero = [&](Index k) {  // sets the rate u_k to zero
    const auto row = static_cast<std::size_t>(i + k);
    for (Index j = 0; j < n; ++j) at(k, j) = matrix()(i + k, j);
    off_[row] = u[k];
    right_[row] = -scaled_.b[row];
  };
  if (along > 0.0) is_zero(0);
  if (of.slips || of.friction == 0.0) {
    for (Index k = 1; k < 3; ++k) {
      off_[static_cast<std::size_t>(i + k)] += of.friction * p[i] * of.direction[k - 1];
      at(k, i) += of.friction * of.direction[k - 1];
    }
  } else if (along > 0.0 && across.norm() <= of.friction * along) {
    is_zero(1);
    is_zero(2);
  } else if (along > 0.0) {
    const double most = of.friction * std::max(p[i], 0.0), length = across.norm();
    const Vector2d d = across / length;
    const Matrix2d turn = most / length * (Matrix2d::Identity() - d * d.transpose());
    const Vector2d pushed = turn * Vector2d(scaled_.b[static_cast<std::size_t>(i + 1)],
                                            scaled_.b[static_cast<std::size_t>(i + 2)]);
    for (Index k = 1; k < 3; ++k) {
      const auto row = static_cast<std::size_t>(i + k);
      off_[row] -= most * d[k - 1];
      right_[row] = (most - of.friction * p[i]) * d[k - 1] - pushed[k - 1];  // J p − off
      for (Index j = 0; j < n; ++j)
        at(k, j) += turn(k - 1, 0) * matrix()(i + 1, j) + turn(k - 1, 1) * matrix()(i + 2, j);
      at(k, i) -= of.friction * d[k - 1];
      at(k, i + 1) -= turn(k - 1, 0);
      at(k, i + 2) -= turn(k - 1, 1);
    }
  }
}

}  // namespace constraint_sim::engine
