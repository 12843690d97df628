#include "engine/math/body_cone_sweeps.h"

#include <algorithm>
#include <cmath>

#include "engine/math/cone_solver.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Most sweeps, and sweeps after which their number is predicted from the decrease of the changes.
constexpr int kMostBlockSweeps = 60, kSweepsPerPrediction = 5;

}  // namespace

double BodyConeSweeps::solve(const BodyConeBlocks& blocks, double enough, double residual,
                             StopFlag stop, List<double>* p) {
  blocks_ = &blocks;
  prepare();
  p_ = *p;
  blocks.set_velocities(p_, &v_);
  square_ = 0.0;
  double change_before = kInfinity;
  for (sweeps_ = 1;; ++sweeps_) {
    from_ = p_;
    v_from_ = v_;
    const double change = sweep();
    bool ends = sweeps_ == kMostBlockSweeps || is_set(stop) || !(change < kInfinity);
    if (sweeps_ % kSweepsPerPrediction == 0) {
      const int left = (kMostBlockSweeps - sweeps_) / kSweepsPerPrediction;
      ends = ends || !reaches(change_before, change, left, enough);
      change_before = change;
    }
    if (ends || change <= enough) {
      const double now = blocks.residual(p_, &v_);
      if (now < residual) *p = p_;
      residual = std::min(residual, now);
      if (ends || residual <= enough) return residual;
    }
    go_on_in_direction();
  }
}

void BodyConeSweeps::prepare() {
  const BodyConeProblem& problem = blocks_->problem();
  responses_.resize(problem.parts.size());
  for (std::size_t k = 0; k < responses_.size(); ++k)
    responses_[k] = problem.bodies[problem.parts[k].body].apply_inverse(problem.parts[k].J);
  matrices_.clear();
  for (const Block& block : blocks_->all()) {
    if (!blocks_->is_contact(block)) continue;
    Matrix3d& A = matrices_.emplace_back(Matrix3d::Zero());
    const std::size_t parts =
        blocks_->row(block.first).parts_end - blocks_->parts_begin(block.first);
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t k = 0; k < parts; ++k)
          A(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) +=
              problem.parts[blocks_->parts_begin(block.first + i) + k].J.dot(
                  responses_[blocks_->parts_begin(block.first + j) + k]);
  }
}

// Solves each block for itself; returns the largest change, as a rate.
double BodyConeSweeps::sweep() {
  double most = 0.0;
  std::size_t contact = 0;
  for (const Block& block : blocks_->all()) {
    const bool is_contact = blocks_->is_contact(block);
    const Matrix3d* const A = is_contact ? &matrices_[contact++] : nullptr;
    if (block.d == 0.0) continue;
    const BodyConeProblem::Row& row = blocks_->row(block.first);
    Vector3d next = Vector3d::Zero();
    if (is_contact) {
      next = impulse_of_contact(block, *A);
    } else {
      const double u = row.rate + blocks_->rate(block.first, v_) + row.softness * p_[block.first];
      next[0] = std::clamp(p_[block.first] - u / block.diagonal, row.least, row.most);
    }
    double square = 0.0;
    for (std::size_t i = block.first; i < block.first + block.size; ++i) {
      const double change = next[static_cast<Eigen::Index>(i - block.first)] - p_[i];
      p_[i] += change;
      square += change * change;
      for (std::size_t k = blocks_->parts_begin(i); k < blocks_->row(i).parts_end; ++k)
        v_[blocks_->problem().parts[k].body] += change * responses_[k];
    }
    most = std::max(most, std::sqrt(square) * block.diagonal);
    if (std::isnan(square)) return kInfinity;
  }
  return most;
}

Vector3d BodyConeSweeps::impulse_of_contact(const Block& block, const Matrix3d& A) const {
  const double mu = blocks_->row(block.first).friction;
  const Vector3d now = block_of(p_, block.first);
  Vector3d u;
  for (std::size_t i = 0; i < 3; ++i)
    u[static_cast<Eigen::Index>(i)] =
        blocks_->row(block.first + i).rate + blocks_->rate(block.first + i, v_);
  Vector3d next;
  if (solve_contact(A, u - A * now, {mu}, &next)) return next;
  u[0] += mu * tangent_norm(u.data());
  return nearest_in_cone(now - u / block.diagonal, mu);
}

// Repeats a share of the changes before the last, which grow with the rate of convergence.
void BodyConeSweeps::go_on_in_direction() {
  double square = 0.0;
  for (const Block& block : blocks_->all())
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      square += (p_[i] - from_[i]) * (p_[i] - from_[i]) * block.diagonal;
  const bool continues = square <= square_;
  const double share = continues ? square / square_ : 0.0;
  square_ = square;
  if (!continues) {
    direction_.assign(p_.size(), 0.0);
    v_direction_.assign(v_.size(), Twist::Zero());
  }
  for (std::size_t i = 0; i < p_.size(); ++i) {
    const double repeated = share * direction_[i];
    direction_[i] = repeated + p_[i] - from_[i];
    p_[i] += repeated;
  }
  for (std::size_t body = 0; body < v_.size(); ++body) {
    const Twist repeated = share * v_direction_[body];
    v_direction_[body] = repeated + v_[body] - v_from_[body];
    v_[body] += repeated;
  }
}

}  // namespace constraint_sim::engine
