#include "engine/math/body_cone_blocks.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {

using Eigen::Vector3d;

Vector3d nearest_in_cone(const Vector3d& q, double mu) {
  const double n = q[0];
  const double t = std::sqrt(q[1] * q[1] + q[2] * q[2]);
  if (t <= mu * n) return q;
  if (mu * t <= -n) return Vector3d::Zero();
  const double normal = (n + mu * t) / (1.0 + mu * mu);
  const double share = mu * normal / t;
  return {normal, share * q[1], share * q[2]};
}

bool reaches(double before, double now, int times, double aim) {
  const double decrease = now / before;
  for (int k = 0; k < times && now > aim && decrease < 1.0; ++k) now *= decrease;
  return now <= aim;
}

double tangent_norm(const double* p) { return std::sqrt(p[1] * p[1] + p[2] * p[2]); }

Vector3d block_of(const List<double>& p, std::size_t first) {
  return {p[first], p[first + 1], p[first + 2]};
}

void BodyConeBlocks::set(const BodyConeProblem& problem) {
  problem_ = &problem;
  blocks_.clear();
  for (std::size_t i = 0; i < problem.rows.size();) {
    Block block{i, problem.rows[i].kind == BodyConeProblem::Kind::kNormal ? std::size_t{3} : 1, 0.0,
                0.0, 0};
    double trace = 0.0;
    for (std::size_t k = parts_begin(i); k < row(i + block.size - 1).parts_end; ++k) {
      const BodyConeProblem::Part& part = problem.parts[k];
      trace += part.J.dot(problem.bodies[part.body].apply_inverse(part.J));
    }
    block.diagonal = trace / static_cast<double>(block.size) + row(i).softness;
    if (block.diagonal > 0.0) block.d = 1.0 / std::sqrt(block.diagonal);
    blocks_.push_back(block);
    i += block.size;
  }
}

void BodyConeBlocks::find_edges() {
  pairs_.clear();
  edge_of_.clear();
  for (Block& block : blocks_) {
    block.edges = edge_of_.size();
    const std::size_t begin = parts_begin(block.first), end = row(block.first).parts_end;
    for (std::size_t k = begin; k < end; ++k)
      for (std::size_t l = k + 1; l < end; ++l) {
        const auto [a, b] = std::minmax(problem_->parts[k].body, problem_->parts[l].body);
        pairs_.push_back({{a, b}, edge_of_.size()});
        edge_of_.push_back(0);
      }
  }
  std::sort(pairs_.begin(), pairs_.end(), [](const Pair& l, const Pair& r) {
    return l.bodies != r.bodies ? l.bodies < r.bodies : l.place < r.place;
  });
  edges_.clear();
  for (const Pair& pair : pairs_) {
    if (edges_.empty() || edges_.back() != pair.bodies) edges_.push_back(pair.bodies);
    edge_of_[pair.place] = edges_.size() - 1;
  }
}

// Returns Jₖᵀ C Jₗ of two bodies of a block.
BodyConeBlocks::Matrix6 BodyConeBlocks::product(const Block& block, const Eigen::Matrix3d& C,
                                                std::size_t k, std::size_t l) const {
  Matrix6 sum = Matrix6::Zero();
  for (std::size_t i = 0; i < block.size; ++i) {
    const Twist& of_k = problem_->parts[parts_begin(block.first + i) + k].J;
    Twist weighted = Twist::Zero();
    for (std::size_t j = 0; j < block.size; ++j) {
      const double weight = C(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      if (weight != 0.0) weighted += weight * problem_->parts[parts_begin(block.first + j) + l].J;
    }
    for (int column = 0; column < 6; ++column) sum.col(column) += weighted[column] * of_k;
  }
  return sum;
}

void BodyConeBlocks::set_velocities(const List<double>& p, List<Twist>* v) const {
  v->assign(problem_->bodies.size(), Twist::Zero());
  for (std::size_t i = 0; i < problem_->rows.size(); ++i) {
    if (p[i] == 0.0) continue;
    for (std::size_t k = parts_begin(i); k < row(i).parts_end; ++k)
      (*v)[problem_->parts[k].body] += p[i] * problem_->parts[k].J;
  }
  for (std::size_t body = 0; body < v->size(); ++body)
    (*v)[body] = problem_->bodies[body].apply_inverse((*v)[body]);
}

double BodyConeBlocks::rate(std::size_t i, const List<Twist>& v) const {
  double sum = 0.0;
  for (std::size_t k = parts_begin(i); k < row(i).parts_end; ++k)
    sum += problem_->parts[k].J.dot(v[problem_->parts[k].body]);
  return sum;
}

double BodyConeBlocks::residual(const List<double>& p, List<Twist>* v) const {
  set_velocities(p, v);
  double largest = 0.0;
  for (const Block& block : blocks_) {
    const double of_block = residual(block, p, *v);
    if (!(of_block <= largest)) largest = of_block;
    if (std::isnan(largest)) return kInfinity;
  }
  return largest;
}

double BodyConeBlocks::residual(const Block& block, const List<double>& p,
                                const List<Twist>& v) const {
  if (block.d == 0.0) return 0.0;
  Vector3d impulse = Vector3d::Zero(), rates = Vector3d::Zero();
  for (std::size_t i = 0; i < block.size; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    impulse[k] = p[block.first + i];
    rates[k] = row(block.first + i).rate + rate(block.first + i, v);
  }
  return residual(block, impulse, rates);
}

double BodyConeBlocks::residual(const Block& block, const Vector3d& p, Vector3d rates) const {
  const BodyConeProblem::Row& first = row(block.first);
  const double step = 1.0 / block.diagonal;
  if (!is_contact(block)) {
    const double u = rates[0] + first.softness * p[0];
    return std::abs(p[0] - std::clamp(p[0] - step * u, first.least, first.most)) * block.diagonal;
  }
  rates[0] += first.friction * tangent_norm(rates.data());
  return (p - nearest_in_cone(p - step * rates, first.friction)).norm() * block.diagonal;
}

}  // namespace constraint_sim::engine
