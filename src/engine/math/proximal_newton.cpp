#include "engine/math/proximal_newton.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// σ of the first step, at most, and its growth after easy steps, before and after one has failed.
// Solved problems of random scenes ended between 1e3 and 1e8.
constexpr double kFirstSigma = 1.0, kMostSigma = 1e9, kLeastSigma = 1e-6;
constexpr double kGrowth = 4.0, kCarefulGrowth = 2.0;
// Iterations of Newton's method in a proximal step, and the most of an easy one.
constexpr int kMostInner = 8, kMostOfEasy = 3;
// A proximal step ends where M v − Jᵀ D x is at most this multiple of (x − x_k)/σ, both as norms of
// √energy, or at the rounding of its first value. The value is the one between 0.01 and 1000 by
// which most piles of balls were solved in 100 steps: the next step mends an error of the last.
constexpr double kInnerTolerance = 30.0, kInnerRounding = 1e-12;
// Line search: halvings, and the decrease of the square asked for, per share of the change and in
// all.
constexpr int kMostHalvings = 6;
constexpr double kDecrease = 0.2, kLeastDecrease = 0.1;

/// Returns the derivative of nearest_in_cone().
Matrix3d slope_of_nearest(const Vector3d& q, double mu) {
  const double n = q[0];
  const double t = std::sqrt(q[1] * q[1] + q[2] * q[2]);
  if (mu > 0.0 && t <= mu * n) return Matrix3d::Identity();
  if (mu * t <= -n) return Matrix3d::Zero();
  if (mu == 0.0 || t == 0.0) return Vector3d::UnitX().asDiagonal();
  const Vector3d along(1.0, mu * q[1] / t, mu * q[2] / t), across(0.0, -q[2] / t, q[1] / t);
  const double normal = (n + mu * t) / (1.0 + mu * mu);
  return along * along.transpose() / (1.0 + mu * mu) +
         mu * normal / t * across * across.transpose();
}

}  // namespace

double ProximalNewton::solve(const BodyConeBlocks& blocks, const Goal& goal, double residual,
                             StopFlag stop, List<double>* p) {
  blocks_ = &blocks;
  steps_ = 0;
  residual_ = residual;
  analyze();
  from_.assign(p->size(), 0.0);
  for (const Block& block : blocks.all())
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      if (block.d > 0.0) from_[i] = (*p)[i] / block.d;
  blocks.set_velocities(*p, &v_);
  double sigma = kFirstSigma, growth = kGrowth;
  while (steps_ < goal.most_steps && sigma >= kLeastSigma && !is_set(stop)) {
    start_ = v_;
    switch (step(goal, sigma, stop, p)) {
      case End::kSolved:
        return residual_;
      case End::kEasy:
        sigma = std::min(sigma * growth, kMostSigma);
        [[fallthrough]];
      case End::kHard:
        from_ = x_;
        break;
      case End::kFailed:
        v_ = start_;
        sigma /= growth;
        growth = kCarefulGrowth;
    }
  }
  return residual_;
}

void ProximalNewton::analyze() {
  const std::size_t bodies = blocks_->problem().bodies.size();
  const List<std::pair<int, int>>& edges = blocks_->edges();
  change_.resize(6 * bodies);
  if (bodies == analyzed_bodies_ && edges == analyzed_edges_) return;
  analyzed_bodies_ = bodies;
  analyzed_edges_ = edges;
  List<FrontalLu::Body> nodes;
  List<FrontalLu::Link> links;
  for (int body = 0; body < static_cast<int>(bodies); ++body) nodes.push_back({6 * body, 6});
  for (const auto& [a, b] : edges) {
    FrontalLu::Link& link = links.emplace_back();
    link.first = static_cast<int>(6 * bodies);
    link.body = a;
    link.other = b;
  }
  factors_.analyze(nodes, links);
  values_.resize(factors_.entries());
  slots_.clear();
  const auto add_rows = [&](int body, int other) {
    for (int i = 0; i < 6; ++i) slots_.push_back(factors_.slot(6 * body + i, 6 * other));
  };
  for (int body = 0; body < static_cast<int>(bodies); ++body) add_rows(body, body);
  for (const auto& [a, b] : edges) {
    add_rows(a, b);
    add_rows(b, a);
  }
}

// Improves v_ and x_ from the start v_ and from_.
ProximalNewton::End ProximalNewton::step(const Goal& goal, double sigma, StopFlag stop,
                                         List<double>* p) {
  const double first = evaluate(v_, sigma, true);
  double square = first;
  for (int k = 0;; ++k) {
    consider(p);
    if (residual_ <= goal.residual) return End::kSolved;
    double moved = 0.0;
    for (std::size_t i = 0; i < x_.size(); ++i) moved += (x_[i] - from_[i]) * (x_[i] - from_[i]);
    const double near = kInnerTolerance / sigma;
    if (k > 0 && square <= std::max(near * near * moved, kInnerRounding * kInnerRounding * first))
      return k <= kMostOfEasy ? End::kEasy : End::kHard;
    if (k == kMostInner || steps_ >= goal.most_steps || is_set(stop)) return End::kFailed;
    ++steps_;
    if (!find_change()) return End::kFailed;
    const double before = square;
    double share = 1.0;
    for (int halving = 0; halving < kMostHalvings; ++halving, share *= 0.5) {
      next_ = v_;
      for (std::size_t i = 0; i < change_.size(); ++i)
        next_[i / 6][static_cast<Eigen::Index>(i % 6)] += share * change_[i];
      square = evaluate(next_, sigma, false);
      if (square <= (1.0 - kDecrease * share) * before) break;
    }
    if (!(square <= (1.0 - kLeastDecrease) * before)) return End::kFailed;
    v_.swap(next_);
    evaluate(v_, sigma, true);
  }
}

// Sets x = P_K(x_k − σ z) and M v − Jᵀ D x at velocities v; returns the square of the latter, as an
// energy.
double ProximalNewton::evaluate(const List<Twist>& v, double sigma, bool with_matrix) {
  const BodyConeProblem& problem = blocks_->problem();
  x_.assign(from_.size(), 0.0);
  off_.resize(v.size());
  for (std::size_t body = 0; body < v.size(); ++body)
    off_[body] << problem.bodies[body].mass * v[body].head<3>(),
        problem.bodies[body].inertia * v[body].tail<3>();
  if (with_matrix) {
    std::fill(values_.begin(), values_.end(), 0.0);
    for (std::size_t body = 0; body < v.size(); ++body)
      for (int i = 0; i < 3; ++i) {
        values_[slots_[6 * body + to_index(i)] + to_index(i)] = problem.bodies[body].mass;
        for (int j = 0; j < 3; ++j)
          values_[slots_[6 * body + 3 + to_index(i)] + 3 + to_index(j)] =
              problem.bodies[body].inertia(i, j);
      }
  }
  for (const Block& block : blocks_->all()) {
    if (block.d == 0.0) continue;
    if (blocks_->is_contact(block))
      evaluate_contact(block, v, sigma, with_matrix);
    else
      evaluate_single(block, v, sigma, with_matrix);
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      for (std::size_t k = blocks_->parts_begin(i); k < blocks_->row(i).parts_end; ++k)
        off_[problem.parts[k].body] -= block.d * x_[i] * problem.parts[k].J;
  }
  double square = 0.0;
  for (std::size_t body = 0; body < v.size(); ++body)
    square += off_[body].dot(problem.bodies[body].apply_inverse(off_[body]));
  return square;
}

void ProximalNewton::evaluate_contact(const Block& block, const List<Twist>& v, double sigma,
                                      bool with_matrix) {
  const std::size_t first = block.first;
  const double mu = blocks_->row(first).friction;
  Vector3d z;
  for (std::size_t i = 0; i < 3; ++i)
    z[static_cast<Eigen::Index>(i)] =
        block.d * (blocks_->row(first + i).rate + blocks_->rate(first + i, v));
  const double slip = tangent_norm(z.data());
  Matrix3d shift = Matrix3d::Identity();
  if (slip > 0.0) shift.row(0).tail<2>() = mu / slip * z.tail<2>().transpose();
  z[0] += mu * slip;
  const Vector3d q = block_of(from_, first) - sigma * z;
  const Vector3d x = nearest_in_cone(q, mu);
  for (std::size_t i = 0; i < 3; ++i) x_[first + i] = x[static_cast<Eigen::Index>(i)];
  if (with_matrix)
    add_to_matrix(block, sigma * block.d * block.d * slope_of_nearest(q, mu) * shift);
}

// Softness S of the row is part of z: x = P_K(x_k − σ (D (b + J v) + D S D x)).
void ProximalNewton::evaluate_single(const Block& block, const List<Twist>& v, double sigma,
                                     bool with_matrix) {
  const std::size_t i = block.first;
  const BodyConeProblem::Row& row = blocks_->row(i);
  const double yielding = 1.0 + sigma * block.d * block.d * row.softness;
  const double q = (from_[i] - sigma * block.d * (row.rate + blocks_->rate(i, v))) / yielding;
  x_[i] = std::clamp(q, row.least / block.d, row.most / block.d);
  if (!with_matrix || x_[i] != q) return;
  Matrix3d C = Matrix3d::Zero();
  C(0, 0) = sigma * block.d * block.d / yielding;
  add_to_matrix(block, C);
}

void ProximalNewton::add_to_matrix(const Block& block, const Matrix3d& C) {
  blocks_->add_products(
      block, C, true, [&](int body, int other, std::size_t edge, const Matrix6& matrix) {
        const std::size_t rows = body == other
                                     ? 6 * to_index(body)
                                     : 6 * analyzed_bodies_ + 12 * edge + (body < other ? 0 : 6);
        for (int i = 0; i < 6; ++i)
          for (int j = 0; j < 6; ++j)
            values_[slots_[rows + to_index(i)] + to_index(j)] += matrix(i, j);
      });
}

// Sets the change of velocities by a step of Newton's method; false where the matrix is singular.
bool ProximalNewton::find_change() {
  for (std::size_t i = 0; i < change_.size(); ++i)
    change_[i] = -off_[i / 6][static_cast<Eigen::Index>(i % 6)];
  factors_.forget();
  return factors_.solve(values_.data(), change_.data());
}

// Keeps the impulses x where they are the best so far.
void ProximalNewton::consider(List<double>* p) {
  tried_.assign(x_.size(), 0.0);
  for (const Block& block : blocks_->all())
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      tried_[i] = block.d * x_[i];
  const double now = blocks_->residual(tried_, &at_p_);
  if (!(now < residual_)) return;
  residual_ = now;
  p->swap(tried_);
}

}  // namespace constraint_sim::engine
