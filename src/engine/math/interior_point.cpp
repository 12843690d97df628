#include "engine/math/interior_point.h"

#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kMostSteps = 40;              // random problems take 8 to 25
constexpr double kRoundingOfRates = 1e-13;  // error of rates by rounding
constexpr double kStalled = 1e-6;           // steps that lead nowhere are shorter
// Share of the way to the bound that a step goes.
constexpr double kToBound = 0.99;
// Least share of the complementarity that a step aims at.
constexpr double kLeastAim = 1e-4;

// Product x ∘ y of the Jordan algebra.
Vector3d product(const Vector3d& x, const Vector3d& y) {
  Vector3d all = x[0] * y + y[0] * x;
  all[0] = x.dot(y);
  return all;
}

// Longest step from x along d within the cone.
double longest_in_cone(const Vector3d& x, const Vector3d& d) {
  const double x_t = math::hypot(x[1], x[2]), d_t = math::hypot(d[1], d[2]);
  const double a = (d[0] - d_t) * (d[0] + d_t), c = (x[0] - x_t) * (x[0] + x_t);
  const double b = x[0] * d[0] - x[1] * d[1] - x[2] * d[2];
  // The first positive root of a s² + 2 b s + c, with c > 0; d is in the cone where there is none.
  if (a >= 0.0 && b >= 0.0) return kInfinity;
  const double root = std::sqrt(std::max(b * b - a * c, 0.0));
  return b < 0.0 ? c / (root - b) : -(b + root) / a;
}

// Product with x of the Jordan algebra as a matrix.
Matrix3d arrow(const Vector3d& x) {
  Matrix3d all = x[0] * Matrix3d::Identity();
  all.row(0) = x.transpose();
  all.col(0) = x;
  return all;
}

// Direction of the tangents of y, zero without any.
Vector3d tangent_direction(const Vector3d& y) {
  const double length = math::hypot(y[1], y[2]);
  return length > 0.0 ? Vector3d(0.0, y[1] / length, y[2] / length) : Vector3d::Zero();
}

// Effect of rates on x ∘ y, where the normal component of y includes ‖y_t‖.
Matrix3d effect_of_rates(const Vector3d& x, const Vector3d& y) {
  Matrix3d all = arrow(x);
  all += x * tangent_direction(y).transpose();
  return all;
}

}  // namespace

bool InteriorPoint::approach(double within, SolveEffort* effort) {
  const auto parts = static_cast<double>(std::max<std::size_t>(1, cones_.size() + bounds_.size()));
  for (;;) {
    find_rates();
    const double off = Numbers(off_.data(), size()).lpNorm<Eigen::Infinity>();
    const double mean = complementarity(0.0) / parts;
    if (!std::isfinite(mean + ConstNumbers(off_.data(), size()).sum())) return false;
    if (off <= std::max(within, kRoundingOfRates) && mean <= within) return true;
    if (++steps_ > kMostSteps || effort->is_over()) return false;
    effort->spent += cost_of_newton_step(x_.size());
    set_matrix();
    factors_.factor_regular();
    find_direction(0.0, false);
    const double share =
        mean > 0.0 ? complementarity(std::min(1.0, longest_step())) / (parts * mean) : 0.0;
    const double aim = std::min(1.0, std::max(share * share * share, kLeastAim));
    find_direction(aim * mean, true);
    const double step = std::min(1.0, kToBound * longest_step());
    if (!(step > kStalled)) return false;
    take_step(step);
  }
}

// Sets up the problem in numbers with cones and bounds. The impulses of number j are x_j times its
// column of A, and its rate is a row of the problem.
void InteriorPoint::begin(const ConeProblem& problem, double rate, double compliance) {
  rate_ = rate;
  steps_ = 0;
  cones_.clear();
  bounds_.clear();
  numbers_.clear();
  x_.clear();
  const auto add = [&](const Number& number) {
    numbers_.push_back(number);
    x_.push_back(0.0);
    return static_cast<Index>(numbers_.size() - 1);
  };
  for (std::size_t c = 0; c < problem.contacts.size(); ++c) {
    const ConeContact& of = problem.contacts[c];
    if (of.slips || of.friction == 0.0) {
      add_bounds(add({3 * c, 1.0, true, -of.friction * of.direction}), 0.0, kInfinity);
      continue;
    }
    const Index first = add({3 * c, 1.0});
    for (std::size_t k = 1; k < 3; ++k) add({3 * c + k, of.friction});
    cones_.push_back({first});
    x_[static_cast<std::size_t>(first)] = 1.0;
  }
  for (std::size_t k = 0; k < problem.rows.size(); ++k) {
    const BoundedRow& of = problem.rows[k];
    add_bounds(add({3 * problem.contacts.size() + k, 1.0}), of.least / rate, of.most / rate);
  }
  set_rates(problem, compliance);
}

void InteriorPoint::set_rates(const ConeProblem& problem, double compliance) {
  const std::size_t m = numbers_.size(), n = problem.b.size();
  M_.resize(m * m);
  q_.resize(m);
  for (List<double>* of : {&off_, &dx_, &change_}) of->resize(m);
  for (std::size_t i = 0; i < m; ++i)
    q_[i] = numbers_[i].weight * problem.b[numbers_[i].row] / rate_;
  for (std::size_t j = 0; j < m; ++j) {
    const Number& by = numbers_[j];
    const double* const A = problem.A.data() + n * by.row;
    for (std::size_t i = 0; i < m; ++i) {
      const std::size_t row = numbers_[i].row;
      double rate_of_one = by.weight * A[row];
      if (by.is_slip) rate_of_one += by.friction[0] * A[n + row] + by.friction[1] * A[2 * n + row];
      M_[m * j + i] = numbers_[i].weight * rate_of_one;
    }
  }
  for (std::size_t i = 0; i < m; ++i) {
    M_[m * i + i] += compliance * numbers_[i].weight * numbers_[i].weight;
    if (!numbers_[i].is_fixed) continue;
    q_[i] = -x_[i];
    for (std::size_t j = 0; j < m; ++j) M_[m * j + i] = i == j ? 1.0 : 0.0;
  }
}

// Adds the bounds of a number, and starts the number between them.
void InteriorPoint::add_bounds(Index number, double least, double most) {
  const double inside = std::min(1.0, 0.5 * (most - least));
  const double x = std::min(std::max(0.0, least + inside), most - inside);
  x_[static_cast<std::size_t>(number)] = x;
  numbers_[static_cast<std::size_t>(number)].is_fixed = least == most;
  if (least == most) return;
  for (const double sign : {1.0, -1.0}) {
    const double at = sign > 0.0 ? least : most;
    if (std::isfinite(at)) bounds_.push_back({number, sign, std::abs(x - at)});
  }
}

// Finds by how much the rates of the present impulses differ from those of the cones and bounds.
void InteriorPoint::find_rates() {
  const Index m = size();
  Numbers off(off_.data(), m);
  off = ConstNumbers(q_.data(), m) + ConstMatrix(M_.data(), m, m) * ConstNumbers(x_.data(), m);
  for (Cone& cone : cones_) {
    cone.off = off.segment<3>(cone.first) - cone.y;
    cone.off[0] += math::hypot(cone.y[1], cone.y[2]);
    off.segment<3>(cone.first) = cone.off;
  }
  for (const Bound& bound : bounds_) off[bound.number] -= bound.sign * bound.y;
}

// Sum of distances from bounds times rates, after a step.
double InteriorPoint::complementarity(double step) const {
  double sum = 0.0;
  for (const Cone& of : cones_) sum += (of.x + step * of.dx).dot(of.y + step * of.dy);
  for (const Bound& of : bounds_) sum += (of.x + step * of.dx) * (of.y + step * of.dy);
  return sum;
}

// Writes the equations of a step: for cones x ∘ dy + dx ∘ y with dy by dx, for bounds the rates.
void InteriorPoint::set_matrix() {
  const Index m = size();
  Matrix J(factors_.resize(x_.size()), m, m);
  J = ConstMatrix(M_.data(), m, m);
  for (const Cone& of : cones_) {
    const Matrix3d K = effect_of_rates(of.x, of.y);
    const auto rows = J.middleRows<3>(of.first);
    for (Index j = 0; j < m; ++j) {
      const Vector3d rates = rows.col(j);
      J.block<3, 1>(of.first, j) = K * rates;
    }
    J.block<3, 3>(of.first, of.first) += arrow(of.y);
  }
  for (const Bound& of : bounds_) J(of.number, of.number) += of.y / of.x;
}

// Finds the direction in which the products x ∘ y reach `target`. `corrects`: less the products of
// the last direction.
void InteriorPoint::find_direction(double target, bool corrects) {
  const Index m = size();
  Numbers dx(dx_.data(), m);
  dx = -ConstNumbers(off_.data(), m);
  for (const Cone& of : cones_) {
    Vector3d left = target * Vector3d::UnitX() - product(of.x, of.y);
    if (corrects) left -= product(of.dx, of.dy);
    dx.segment<3>(of.first) = left - effect_of_rates(of.x, of.y) * of.off;
  }
  for (const Bound& of : bounds_)
    dx[of.number] += of.sign * (target - of.x * of.y - (corrects ? of.dx * of.dy : 0.0)) / of.x;
  factors_.solve(dx_.data());
  Numbers change(change_.data(), m);
  change.noalias() = ConstMatrix(M_.data(), m, m) * dx;
  for (Cone& of : cones_) {
    of.dx = dx.segment<3>(of.first);
    of.dy = change.segment<3>(of.first) + of.off;
    of.dy[0] += tangent_direction(of.y).dot(of.dy);
  }
  for (Bound& of : bounds_) {
    const double before = corrects ? of.dx * of.dy : 0.0;
    of.dx = of.sign * dx[of.number];
    of.dy = (target - before) / of.x - of.y - of.y / of.x * of.dx;
  }
}

// Longest step along the direction within all cones and bounds.
double InteriorPoint::longest_step() const {
  double longest = kInfinity;
  for (const Cone& of : cones_)
    longest = std::min({longest, longest_in_cone(of.x, of.dx), longest_in_cone(of.y, of.dy)});
  for (const Bound& of : bounds_) {
    if (of.dx < 0.0) longest = std::min(longest, -of.x / of.dx);
    if (of.dy < 0.0) longest = std::min(longest, -of.y / of.dy);
  }
  return longest;
}

void InteriorPoint::take_step(double step) {
  Numbers(x_.data(), size()) += step * ConstNumbers(dx_.data(), size());
  for (Cone& of : cones_) {
    of.x += step * of.dx;
    of.y += step * of.dy;
  }
  for (Bound& of : bounds_) {
    of.x += step * of.dx;
    of.y += step * of.dy;
  }
}

void InteriorPoint::write(double* p) const {
  for (std::size_t i = 0; i < x_.size(); ++i) {
    const Number& of = numbers_[i];
    const double x = rate_ * x_[i];
    p[of.row] = of.weight * x;
    if (of.is_slip) Eigen::Map<Vector2d>(p + of.row + 1) = of.friction * x;
  }
}

}  // namespace constraint_sim::engine
