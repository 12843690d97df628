#include "engine/math/small_cone_solver.h"

namespace constraint_sim::engine {
namespace {

constexpr double kMostSmallSteps = 50.0;  // limit in steps of Newton's method

}  // namespace

void SmallConeSolver::set(const BodyConeProblem& problem, const List<double>& p) {
  const auto is_single = [&](std::size_t i) {
    return problem.rows[i].kind == BodyConeProblem::Kind::kSingle;
  };
  order_.clear();
  for (const bool singles : {false, true})
    for (std::size_t i = 0; i < problem.rows.size(); ++i)
      if (is_single(i) == singles) order_.push_back(i);
  const std::size_t n = order_.size();
  const auto parts_begin = [&](std::size_t i) {
    return i == 0 ? 0 : problem.rows[i - 1].parts_end;
  };
  dense_.A.resize(n * n);
  dense_.b.resize(n);
  dense_.contacts.clear();
  dense_.rows.clear();
  p_.resize(n);
  velocities_.resize(problem.bodies.size());
  for (std::size_t k = 0; k < n; ++k) {
    const BodyConeProblem::Row& row = problem.rows[order_[k]];
    for (BodyConeProblem::Twist& v : velocities_) v.setZero();
    for (std::size_t part = parts_begin(order_[k]); part < row.parts_end; ++part) {
      const auto& [body, J] = problem.parts[part];
      velocities_[body] = problem.bodies[body].apply_inverse(J);
    }
    for (std::size_t l = 0; l < n; ++l) {
      double rate = 0.0;
      for (std::size_t part = parts_begin(order_[l]); part < problem.rows[order_[l]].parts_end;
           ++part)
        rate += problem.parts[part].J.dot(velocities_[problem.parts[part].body]);
      dense_.A[k * n + l] = rate;
    }
    dense_.A[k * n + k] += row.softness;
    dense_.b[k] = row.rate;
    p_[k] = p[order_[k]];
    if (row.kind == BodyConeProblem::Kind::kNormal)
      dense_.contacts.emplace_back().friction = row.friction;
    if (row.kind == BodyConeProblem::Kind::kSingle) dense_.rows.push_back({row.least, row.most});
  }
}

void SmallConeSolver::solve(const BodyConeProblem& problem, StopFlag stop, List<double>* p) {
  set(problem, *p);
  SolveEffort effort{kMostSmallSteps * ConeSolver::cost_of_a_step(order_.size()), stop};
  solver_.solve(dense_, &p_, &effort);
  for (std::size_t k = 0; k < order_.size(); ++k) (*p)[order_[k]] = p_[k];
}

}  // namespace constraint_sim::engine
