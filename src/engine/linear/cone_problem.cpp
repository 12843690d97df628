#include "engine/linear/cone_problem.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
constexpr double kSingular = 1e-12;           // of the trace: a direction that nothing moves along
constexpr double kDone = 1e-14;               // of the largest rate: rounding
constexpr double kRounding = 4.0 * kEpsilon;  // of what rates are the sums of
constexpr double kSolved = 1e-9;  // the same, of what rounding adds along what has no effect
constexpr int kMostSweeps = 1025;
constexpr double kCompliance = 1e-6;  // beside one of 1 on average
constexpr int kMostPasses = 4;
constexpr int kMostNewton = 40, kMostWorse = 6;
constexpr int kMostSteps = 100;  // to a factor of slip: six do, where none is bisected
constexpr int kMostStalled = 3;  // times without half of what is left: rounding

/// The tangential impulse of a contact that slips, by the factor κ with u_t = −κ p_t that it slips
/// with; and the normal one that goes with it.
class Slipping {
 public:
  Slipping(const Matrix3d& A, const Vector3d& b)
      : row_(A.block<1, 2>(0, 1).transpose() / A(0, 0)), pushed_(-b[0] / A(0, 0)) {
    const Matrix2d S = A.block<2, 2>(1, 1) - A.block<2, 1>(1, 0) * row_.transpose();
    const Vector2d c = b.tail<2>() + A.block<2, 1>(1, 0) * pushed_;
    solver_.computeDirect(S);
    c_ = solver_.eigenvectors().transpose() * c;
    least_ = kSingular * A.trace();
    scale_ = b.norm();
  }

  /// 0 is to stick; where a direction that nothing moves along has a rate, that is none.
  bool can_stick() const {
    for (Index i = 0; i < 2; ++i)
      if (solver_.eigenvalues()[i] <= least_ && std::abs(c_[i]) > kSingular * scale_) return false;
    return true;
  }
  Vector3d impulse(double kappa) const { return in_full(tangential(kappa)); }

  /// κ > 0 where the impulse is on the cone of friction μ, or infinity: Newton's method on
  /// μ p_n/‖p_t‖ − 1, which is close to linear in κ, within a bracket.
  double kappa_on_cone(double mu, double start) const {
    double low = 0.0, high = std::numeric_limits<double>::infinity(), kappa = start;
    double least = high;  // that the last step was off by
    for (int k = 0; k < kMostSteps && low < (1.0 - 2.0 * kEpsilon) * high; ++k) {
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
      if (is_slow || !(next > low && next < high)) {  // κ spans many orders: means of logarithms
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
  /// along the eigenvectors
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

  Vector2d row_;   // of what tangential impulses do along the normal
  double pushed_;  // the normal impulse without friction
  Eigen::SelfAdjointEigenSolver<Matrix2d> solver_;
  Vector2d c_;
  double least_, scale_;
};

}  // namespace

bool solve_contact(const Matrix3d& A, const Vector3d& b, const ConeContact& contact, Vector3d* p) {
  p->setZero();
  if (b[0] >= 0.0) return true;
  if (!(A(0, 0) > kSingular * A.trace())) return false;
  const double mu = contact.friction;
  if (contact.slips || mu == 0.0) {
    Vector3d along = Vector3d::UnitX();
    along.tail<2>() = -mu * contact.direction;
    const double response = A.row(0).dot(along);
    if (!(response > kSingular * A.trace())) return false;  // friction pushes it in: Painlevé
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

/// A problem with the rates of each contact scaled so that its A has a trace of 3: masses of many
/// orders are then alike. What is solved for is scaled the other way.
class ScaledProblem {
 public:
  explicit ScaledProblem(const ConeProblem& problem)
      : scale_(problem.b.size()), scaled_{problem.A, problem.b, problem.contacts, problem.rows} {
    for (Index i = 0; i < contacts(); ++i) {
      const double trace = problem.A.block<3, 3>(3 * i, 3 * i).trace();
      scale_.segment<3>(3 * i).setConstant(trace > 0.0 ? std::sqrt(3.0 / trace) : 0.0);
    }
    for (Index i = end_of_contacts(); i < scale_.size(); ++i) {
      const double response = problem.A(i, i);
      BoundedRow& row = scaled_.rows[row_at(i)];
      scale_[i] = response > 0.0 ? std::sqrt(1.0 / response) : 0.0;
      row.least = response > 0.0 ? row.least / scale_[i] : 0.0;
      row.most = response > 0.0 ? row.most / scale_[i] : 0.0;
    }
    scaled_.A = scale_.asDiagonal() * problem.A * scale_.asDiagonal();
    scaled_.b = scale_.cwiseProduct(problem.b);
    size_ = scaled_.b.size() > 0 ? scaled_.b.lpNorm<Eigen::Infinity>() : 0.0;
  }
  Index contacts() const { return static_cast<Index>(scaled_.contacts.size()); }
  Index end_of_contacts() const { return 3 * contacts(); }
  /// Of `problem`, which this is; at its bounds to the bit.
  VectorXd unscaled(const ConeProblem& problem, const VectorXd& p) const {
    VectorXd all = scale_.cwiseProduct(p);
    for (Index i = end_of_contacts(); i < p.size(); ++i) {
      const BoundedRow &here = scaled_.rows[row_at(i)], &there = problem.rows[row_at(i)];
      if (scale_[i] == 0.0) continue;
      if (p[i] == here.most) all[i] = there.most;
      if (p[i] == here.least) all[i] = there.least;
    }
    return all;
  }
  VectorXd start() const {
    VectorXd p = VectorXd::Zero(scale_.size());
    for (Index i = end_of_contacts(); i < p.size(); ++i) p[i] = within(i, 0.0);
    return p;
  }
  double size() const { return size_; }
  /// Fitted to what 3, 18 and 36 rows cost.
  double sweep_cost() const {
    const auto n = static_cast<double>(scale_.size());
    return 0.02 * n + 7e-5 * n * n;
  }
  double newton_cost() const {
    const auto n = static_cast<double>(scale_.size());
    return 0.15 + 1.8e-3 * n * n + 2.3e-5 * n * n * n;
  }

  /// The same with rates that rise by so much of the impulse beyond p.
  ScaledProblem with_compliance(double compliance, const VectorXd& p) const {
    ScaledProblem other = *this;
    other.scaled_.A.diagonal().array() += compliance;
    other.scaled_.b -= compliance * p;
    return other;
  }

  /// A solution from p on, or what is closest to one. False where it is not.
  bool find(VectorXd* p, SolveEffort* effort) const {
    VectorXd x = *p, tried = x;
    double least = residual(x);
    const auto consider = [&](const VectorXd& other) {
      const double now = residual(other);
      if (!(now < least)) return;
      least = now;
      *p = other;
    };
    double before = least;
    for (int k = 0, stalled = 0; least > rounding(*p) && k < kMostSweeps; ++k) {
      if (effort->is_over()) return false;
      effort->spent += sweep_cost();
      if ((k & (k - 1)) == 0) {
        tried = x;
        polish(&tried, effort);
        consider(tried);
        stalled = least <= kSolved * size_ && least > 0.5 * before ? stalled + 1 : 0;
        if (stalled == kMostStalled) break;
        before = least;
      }
      if (!sweep(k % 2 == 1, &x)) return false;
      consider(x);
    }
    return least <= kSolved * size_;
  }

 private:
  /// One contact after the other, there or back. False where one has no answer.
  bool sweep(bool back, VectorXd* p) const {
    VectorXd u = rates(*p);
    for (Index k = 0; k < contacts(); ++k) {
      const Index i = 3 * (back ? contacts() - 1 - k : k);
      const Matrix3d A = scaled_.A.block<3, 3>(i, i);
      const Vector3d before = p->segment<3>(i);
      Vector3d b = u.segment<3>(i) - A * before, now;
      if (std::abs(b[0]) <= kSingular * size_ && A(0, 0) <= kSingular * A.trace()) b[0] = 0.0;
      if (!solve_contact(A, b, contact(i), &now)) return false;
      p->segment<3>(i) = now;
      u += scaled_.A.middleCols<3>(i) * (now - before);
    }
    const Index end = p->size();
    for (Index k = end_of_contacts(); k < end; ++k) {
      const Index i = back ? end_of_contacts() + end - 1 - k : k;
      const double before = (*p)[i];
      if (scaled_.A(i, i) > 0.0) (*p)[i] = within(i, before - u[i] / scaled_.A(i, i));
      u += scaled_.A.col(i) * ((*p)[i] - before);
    }
    return true;
  }

 public:
  /// How far p is from a solution, as a rate: the largest change of a contact's impulse by a step
  /// along its rate, and back into its cone. 0 of a solution alone, and infinite where rounding of
  /// what p does is more than a solution may be off.
  double residual(const VectorXd& p) const {
    if (p.size() > 0 && kEpsilon * p.lpNorm<Eigen::Infinity>() > kSolved * size_)
      return std::numeric_limits<double>::infinity();
    const VectorXd u = rates(p);
    double worst = 0.0;
    const auto consider = [&](double value) {
      if (!(value <= worst)) worst = value;  // a NaN stays
    };
    for (Index i = 0; i < end_of_contacts(); i += 3) {
      const ConeContact& of = contact(i);
      if (of.slips || of.friction == 0.0) {
        consider(std::abs(std::min(p[i], u[i])));
        consider((p.segment<2>(i + 1) + of.friction * p[i] * of.direction).norm());
        continue;
      }
      Vector3d rate = u.segment<3>(i);
      rate[0] += of.friction * rate.tail<2>().norm();
      const Vector3d here = p.segment<3>(i);
      consider((here - into_cone(here - rate, of.friction)).norm());
    }
    for (Index i = end_of_contacts(); i < p.size(); ++i)
      consider(std::abs(p[i] - within(i, p[i] - u[i])));
    return worst;
  }

  /// A residual that is one of rounding: impulses that hold each other are larger than their sums.
  double rounding(const VectorXd& p) const {
    if (p.size() == 0) return 0.0;
    VectorXd terms = scaled_.A.cwiseAbs() * p.cwiseAbs();
    for (Index i = 0; i < contacts(); ++i)
      terms.segment<3>(3 * i) *= 1.0 + scaled_.contacts[static_cast<std::size_t>(i)].friction;
    return std::min(std::max(kDone * size_, kRounding * terms.maxCoeff()), kSolved * size_);
  }

  /// Newton's method on which contacts are open, stick and slip, from p on. Leaves its best.
  void polish(VectorXd* p, SolveEffort* effort) const {
    VectorXd x = *p;
    double before = residual(x), least = before;
    for (int k = 0, worse = 0; least > rounding(*p) && k < kMostNewton && worse < kMostWorse; ++k) {
      effort->spent += newton_cost();
      if (effort->is_over() || !take_newton(&x)) return;
      const double now = residual(x);
      if (now < least) {
        least = now;
        *p = x;
      }
      worse += now > 0.5 * before ? 1 : 0;
      before = now;
    }
  }

 private:
  const ConeContact& contact(Index row) const {
    return scaled_.contacts[static_cast<std::size_t>(row / 3)];
  }
  std::size_t row_at(Index i) const { return static_cast<std::size_t>(i - end_of_contacts()); }
  double within(Index i, double x) const {
    const BoundedRow& row = scaled_.rows[row_at(i)];
    return std::min(std::max(x, row.least), row.most);
  }
  VectorXd rates(const VectorXd& p) const { return scaled_.b + scaled_.A * p; }

  static Vector3d into_cone(const Vector3d& x, double mu) {
    const double t = x.tail<2>().norm();
    if (t <= mu * x[0]) return x;
    if (mu * t <= -x[0]) return Vector3d::Zero();
    Vector3d on;
    on[0] = (x[0] + mu * t) / (1.0 + mu * mu);
    on.tail<2>() = x.tail<2>() * (mu * on[0] / t);
    return on;
  }

  // The equations of Alart and Curnier (Comput. Methods Appl. Mech. Eng. 92 (1991) 353), and the
  // least step to where they hold.
  bool take_newton(VectorXd* p) const {
    const VectorXd u = rates(*p);
    Eigen::MatrixXd J = Eigen::MatrixXd::Identity(p->size(), p->size());
    VectorXd off = *p;
    for (Index i = 0; i < end_of_contacts(); i += 3) {
      const ConeContact& of = contact(i);
      const double along = (*p)[i] - u[i];
      const Vector2d across = p->segment<2>(i + 1) - u.segment<2>(i + 1);
      if (along > 0.0) {
        J.row(i) = scaled_.A.row(i);
        off[i] = u[i];
      }
      if (of.slips || of.friction == 0.0) {
        off.segment<2>(i + 1) += of.friction * (*p)[i] * of.direction;
        J.block<2, 1>(i + 1, i) += of.friction * of.direction;
      } else if (along > 0.0 && across.norm() <= of.friction * along) {
        J.middleRows<2>(i + 1) = scaled_.A.middleRows<2>(i + 1);
        off.segment<2>(i + 1) = u.segment<2>(i + 1);
      } else if (along > 0.0) {
        const double most = of.friction * std::max((*p)[i], 0.0), length = across.norm();
        const Vector2d d = across / length;
        const Matrix2d turn = most / length * (Matrix2d::Identity() - d * d.transpose());
        off.segment<2>(i + 1) -= most * d;
        J.block<2, 1>(i + 1, i) -= of.friction * d;
        J.block<2, 2>(i + 1, i + 1) -= turn;
        J.middleRows<2>(i + 1) += turn * scaled_.A.middleRows<2>(i + 1);
      }
    }
    for (Index i = end_of_contacts(); i < p->size(); ++i) {
      const double x = (*p)[i] - u[i], bound = within(i, x);
      if (x == bound) {
        J.row(i) = scaled_.A.row(i);
        off[i] = u[i];
      } else {
        off[i] = (*p)[i] - bound;
      }
    }
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> factors;
    factors.setThreshold(kSingular);
    factors.compute(J);
    *p -= factors.solve(off);
    return p->allFinite();
  }

  VectorXd scale_;
  ConeProblem scaled_;
  double size_;  // of the largest rate
};

}  // namespace

// Where A is singular impulses are shared as those of least norm: a small compliance, taken away
// again by passes from what the one before found.
bool solve(const ConeProblem& problem, VectorXd* p, SolveEffort* effort) {
  const ScaledProblem scaled(problem);
  if (effort->is_over()) return false;
  effort->spent += scaled.newton_cost();  // to set it up
  VectorXd x = scaled.start();
  for (int pass = 0; pass < kMostPasses && scaled.residual(x) > scaled.rounding(x); ++pass)
    if (!scaled.with_compliance(kCompliance, x).find(&x, effort)) break;
  const bool is_found = scaled.find(&x, effort);
  *p = scaled.unscaled(problem, x);
  return is_found;
}

}  // namespace constraint_sim::engine
