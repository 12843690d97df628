#include "engine/math/body_equations.h"

#include <algorithm>
#include <limits>
#include <optional>

namespace constraint_sim::engine {

using Eigen::Matrix3d;
using Eigen::Vector3d;

void BodyEquations::set(const BodyConeBlocks& blocks) {
  blocks_ = &blocks;
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

void BodyEquations::begin(const List<double>& p) {
  from_.assign(p.size(), 0.0);
  for (const Block& block : blocks_->all())
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      if (block.d > 0.0) from_[i] = p[i] / block.d;
  blocks_->set_velocities(p, &v_);
  std::fill(change_.begin(), change_.end(), 0.0);
}

ProximalImpulse BodyEquations::impulse(std::size_t b, const List<Twist>& v, double sigma,
                                       bool with_slope) const {
  const Block& block = blocks_->all()[b];
  Vector3d x_k = Vector3d::Zero(), z = Vector3d::Zero();
  for (std::size_t i = 0; i < block.size; ++i) {
    const std::size_t row = block.first + i;
    x_k[static_cast<Eigen::Index>(i)] = from_[row];
    z[static_cast<Eigen::Index>(i)] = block.d * (blocks_->row(row).rate + blocks_->rate(row, v));
  }
  return proximal_impulse(blocks_->scaled(block, std::nullopt), x_k, z, sigma, with_slope);
}

ProximalEquations::Merit BodyEquations::evaluate(double sigma, double share) {
  const BodyConeProblem& problem = blocks_->problem();
  next_ = v_;
  if (share != 0.0)
    for (std::size_t i = 0; i < change_.size(); ++i)
      next_[i / 6][static_cast<Eigen::Index>(i % 6)] += share * change_[i];
  x_.assign(from_.size(), 0.0);
  off_.resize(next_.size());
  Merit merit{0.0, std::numeric_limits<double>::quiet_NaN()};
  for (std::size_t body = 0; body < next_.size(); ++body)
    off_[body] << problem.bodies[body].mass * next_[body].head<3>(),
        problem.bodies[body].inertia * next_[body].tail<3>();
  for (std::size_t b = 0; b < blocks_->all().size(); ++b) {
    const Block& block = blocks_->all()[b];
    if (block.d == 0.0) continue;
    const Vector3d x = impulse(b, next_, sigma, false).x;
    for (std::size_t i = block.first; i < block.first + block.size; ++i) {
      x_[i] = x[static_cast<Eigen::Index>(i - block.first)];
      for (std::size_t k = blocks_->parts_begin(i); k < blocks_->row(i).parts_end; ++k)
        off_[problem.parts[k].body] -= block.d * x_[i] * problem.parts[k].J;
    }
  }
  for (std::size_t body = 0; body < next_.size(); ++body)
    merit.square += off_[body].dot(problem.bodies[body].apply_inverse(off_[body]));
  return merit;
}

bool BodyEquations::find_change(double sigma) {
  set_inertia();
  for (std::size_t b = 0; b < blocks_->all().size(); ++b) {
    const Block& block = blocks_->all()[b];
    if (block.d > 0.0) add_to_matrix(block, block.d * block.d * impulse(b, v_, sigma, true).slope);
  }
  for (std::size_t i = 0; i < change_.size(); ++i)
    change_[i] = -off_[i / 6][static_cast<Eigen::Index>(i % 6)];
  factors_.forget();
  return factors_.solve(values_.data(), change_.data());
}

void BodyEquations::set_inertia() {
  const List<BodyConeProblem::Body>& bodies = blocks_->problem().bodies;
  std::fill(values_.begin(), values_.end(), 0.0);
  for (std::size_t body = 0; body < bodies.size(); ++body)
    for (int i = 0; i < 3; ++i) {
      values_[slots_[6 * body + to_index(i)] + to_index(i)] = bodies[body].mass;
      for (int j = 0; j < 3; ++j)
        values_[slots_[6 * body + 3 + to_index(i)] + 3 + to_index(j)] = bodies[body].inertia(i, j);
    }
}

void BodyEquations::add_to_matrix(const Block& block, const Matrix3d& C) {
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

double BodyEquations::squared_distance() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < x_.size(); ++i) sum += (x_[i] - from_[i]) * (x_[i] - from_[i]);
  return sum;
}

double BodyEquations::residual() {
  tried_.assign(x_.size(), 0.0);
  for (const Block& block : blocks_->all())
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      tried_[i] = block.d * x_[i];
  return blocks_->residual(tried_, &at_p_);
}

}  // namespace constraint_sim::engine
