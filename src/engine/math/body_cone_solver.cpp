#include "engine/math/body_cone_solver.h"

#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Penalty ε of rows without bounds: each iteration closes all but about ε of them, and rounding of
// K is 1/ε times that of M.
constexpr double kJointPenalty = 1e-5;
// Penalty within which impulses of redundant rows get the least norm, and repetitions.
constexpr double kSharingPenalty = 1e-6;
constexpr int kSharingSteps = 3, kSharingRounds = 6;
// Share of the largest scaled impulse below which a contact counts as open, and share of Coulomb's
// limit within which it counts as slipping.
constexpr double kOpen = 1e-9, kAtCone = 1e-7;
constexpr int kIterationsPerCheck = 5, kIterationsPerFactor = 10;
// Iterations after which a sufficient residual ends them. Before, the aim is as near, and its
// impulses solve the next step of a stack, too.
constexpr int kSettling = 50;
// Most entries of factors visited by a run of iterations, some 0.1 s of work, and the iterations
// made in any case.
constexpr double kMostEntries = 3e7;
constexpr int kLeastIterations = 30;

/// Returns the point of the cone ‖t‖ ≤ μ n next to q.
Vector3d nearest_in_cone(const Vector3d& q, double mu) {
  const double n = q[0];
  const double t = std::sqrt(q[1] * q[1] + q[2] * q[2]);
  if (t <= mu * n) return q;
  if (mu * t <= -n) return Vector3d::Zero();
  const double normal = (n + mu * t) / (1.0 + mu * mu);
  const double share = mu * normal / t;
  return {normal, share * q[1], share * q[2]};
}

double tangent_norm(const double* p) { return std::sqrt(p[1] * p[1] + p[2] * p[2]); }

Vector3d block_of(const List<double>& p, std::size_t first) {
  return {p[first], p[first + 1], p[first + 2]};
}

}  // namespace

BodyConeSolver::Outcome BodyConeSolver::solve(const BodyConeProblem& problem, const Goal& goal,
                                              StopFlag stop, List<double>* p) {
  set(problem);
  Outcome outcome;
  for (const BodyConeProblem::Row& row : problem.rows)
    outcome.scale = std::max(outcome.scale, std::abs(row.rate));
  outcome.residual = residual(*p);
  const double aim = goal.tolerance * outcome.scale;
  if (outcome.residual <= aim) return outcome;
  analyze();
  const double affordable = kMostEntries / static_cast<double>(1 + factors_.values().size());
  const int most = std::min(goal.most_iterations,
                            kLeastIterations + static_cast<int>(std::min(affordable, 1e6)));
  // A small η converges fastest near a solution and with large mass ratios, relaxation and a
  // larger η far from one.
  constexpr Setting kNear{1.0, 1e-9}, kFar{1.6, 1e-6};
  const bool is_small = problem.rows.size() <= SmallConeSolver::kMostRows;
  const int first = is_small ? 50 : 100;
  run(kNear, aim, goal.sufficient, std::min(most, first), stop, &outcome, p);
  const double enough = std::max(aim, goal.sufficient);
  if (outcome.residual > enough && is_small && first <= most) solve_small(stop, &outcome, p);
  if (outcome.residual > enough) run(kFar, aim, goal.sufficient, most, stop, &outcome, p);
  if (!is_set(stop)) share(aim, &outcome, p);
  return outcome;
}

void BodyConeSolver::set(const BodyConeProblem& problem) {
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
  v_.resize(problem.bodies.size());
}

// ---- the matrix over bodies

void BodyConeSolver::analyze() {
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
  const std::size_t bodies = problem_->bodies.size();
  on_bodies_.resize(bodies);
  on_edges_.resize(edges_.size());
  right_.resize(6 * bodies);
  if (bodies == analyzed_bodies_ && edges_ == analyzed_edges_) return;
  analyzed_bodies_ = bodies;
  analyzed_edges_ = edges_;

  List<std::pair<int, int>> entries;
  const auto visit_entries = [&](const auto& visit) {
    for (int body = 0; body < static_cast<int>(bodies); ++body)
      for (int j = 0; j < 6; ++j)
        for (int i = j; i < 6; ++i) visit(6 * body + i, 6 * body + j);
    for (const auto& [a, b] : edges_)
      for (int j = 0; j < 6; ++j)
        for (int i = 0; i < 6; ++i) visit(6 * b + i, 6 * a + j);
  };
  visit_entries([&](int i, int j) { entries.emplace_back(i, j); });
  factors_.analyze(static_cast<int>(6 * bodies), entries);
  slots_.clear();
  visit_entries([&](int i, int j) { slots_.push_back(factors_.slot(i, j)); });
}

// Adds Jᵀ D W⁻¹ D J.
void BodyConeSolver::add_to_matrix(const Block& block) {
  const double square = block.d * block.d;
  if (square == 0.0) return;
  const std::size_t count = row(block.first).parts_end - parts_begin(block.first);
  std::size_t edge = block.edges;
  for (std::size_t k = 0; k < count; ++k) {
    for (std::size_t l = k; l < count; ++l) {
      Matrix6 sum = Matrix6::Zero();
      int body_k = 0, body_l = 0;
      for (std::size_t i = 0; i < block.size; ++i) {
        const BodyConeProblem::Part& of_i = problem_->parts[parts_begin(block.first + i) + k];
        body_k = of_i.body;
        Twist weighted = Twist::Zero();
        for (std::size_t j = 0; j < block.size; ++j) {
          const BodyConeProblem::Part& of_j = problem_->parts[parts_begin(block.first + j) + l];
          body_l = of_j.body;
          const double weight = square * block.inverse_weight(static_cast<Eigen::Index>(i),
                                                              static_cast<Eigen::Index>(j));
          if (weight != 0.0) weighted += weight * of_j.J;
        }
        for (int column = 0; column < 6; ++column) sum.col(column) += weighted[column] * of_i.J;
      }
      if (k == l)
        on_bodies_[body_k] += sum;
      else if (body_k > body_l)
        on_edges_[edge_of_[edge++]] += sum;
      else
        on_edges_[edge_of_[edge++]] += sum.transpose();
    }
  }
}

// Factors K = M + Jᵀ D W⁻¹ D J.
void BodyConeSolver::factor() {
  for (std::size_t body = 0; body < on_bodies_.size(); ++body) {
    on_bodies_[body].setZero();
    on_bodies_[body].topLeftCorner<3, 3>().diagonal().setConstant(problem_->bodies[body].mass);
    on_bodies_[body].bottomRightCorner<3, 3>() = problem_->bodies[body].inertia;
  }
  for (Matrix6& matrix : on_edges_) matrix.setZero();
  for (const Block& block : blocks_) add_to_matrix(block);
  List<double>& values = factors_.values();
  std::fill(values.begin(), values.end(), 0.0);
  std::size_t slot = 0;
  for (const Matrix6& matrix : on_bodies_)
    for (int j = 0; j < 6; ++j)
      for (int i = j; i < 6; ++i) values[slots_[slot++]] += matrix(i, j);
  for (const Matrix6& matrix : on_edges_)
    for (int j = 0; j < 6; ++j)
      for (int i = 0; i < 6; ++i) values[slots_[slot++]] += matrix(i, j);
  factors_.factor(0.0);
}

// Sets x = (D A D + W)⁻¹ r = W⁻¹ (r − D J K⁻¹ Jᵀ D W⁻¹ r).
void BodyConeSolver::apply_inverse(const List<double>& r, List<double>* x) {
  for (Twist& v : v_) v.setZero();
  const auto weighted = [&](const Block& block, const List<double>& values) {
    if (block.size == 1)
      return Vector3d(block.inverse_weight(0, 0) * values[block.first], 0.0, 0.0);
    return Vector3d(block.inverse_weight * block_of(values, block.first));
  };
  for (const Block& block : blocks_) {
    const Vector3d f = block.d * weighted(block, r);
    for (std::size_t i = 0; i < block.size; ++i)
      for (std::size_t k = parts_begin(block.first + i); k < row(block.first + i).parts_end; ++k)
        v_[problem_->parts[k].body] += f[static_cast<Eigen::Index>(i)] * problem_->parts[k].J;
  }
  for (std::size_t i = 0; i < right_.size(); ++i)
    right_[factors_.place(static_cast<int>(i))] = v_[i / 6][static_cast<Eigen::Index>(i % 6)];
  factors_.solve(right_.data());
  for (std::size_t i = 0; i < right_.size(); ++i)
    v_[i / 6][static_cast<Eigen::Index>(i % 6)] = right_[factors_.place(static_cast<int>(i))];
  x->resize(r.size());
  for (const Block& block : blocks_) {
    Vector3d left = Vector3d::Zero();
    for (std::size_t i = 0; i < block.size; ++i)
      left[static_cast<Eigen::Index>(i)] = r[block.first + i] - block.d * rate(block.first + i);
    const Vector3d result = block.inverse_weight * left;
    for (std::size_t i = 0; i < block.size; ++i)
      (*x)[block.first + i] = result[static_cast<Eigen::Index>(i)];
  }
}

// ---- residual

// Sets v = M⁻¹ Jᵀ p.
void BodyConeSolver::set_velocities(const List<double>& p) {
  for (Twist& v : v_) v.setZero();
  for (std::size_t i = 0; i < problem_->rows.size(); ++i) {
    if (p[i] == 0.0) continue;
    for (std::size_t k = parts_begin(i); k < row(i).parts_end; ++k)
      v_[problem_->parts[k].body] += p[i] * problem_->parts[k].J;
  }
  for (std::size_t body = 0; body < v_.size(); ++body)
    v_[body] = problem_->bodies[body].apply_inverse(v_[body]);
}

// Returns J v of a row.
double BodyConeSolver::rate(std::size_t i) const {
  double sum = 0.0;
  for (std::size_t k = parts_begin(i); k < row(i).parts_end; ++k)
    sum += problem_->parts[k].J.dot(v_[problem_->parts[k].body]);
  return sum;
}

double BodyConeSolver::residual(const List<double>& p) {
  set_velocities(p);
  double largest = 0.0;
  for (const Block& block : blocks_) {
    const double of_block = residual(block, p);
    if (!(of_block <= largest)) largest = of_block;
    if (std::isnan(largest)) return kInfinity;
  }
  return largest;
}

double BodyConeSolver::residual(const Block& block, const List<double>& p) const {
  if (block.d == 0.0) return 0.0;
  const BodyConeProblem::Row& first = row(block.first);
  const double step = 1.0 / block.diagonal;
  const double u = first.rate + rate(block.first) + first.softness * p[block.first];
  if (!is_contact(block)) {
    const double next = std::clamp(p[block.first] - step * u, first.least, first.most);
    return std::abs(p[block.first] - next) * block.diagonal;
  }
  Vector3d rates(u, row(block.first + 1).rate + rate(block.first + 1),
                 row(block.first + 2).rate + rate(block.first + 2));
  rates[0] += first.friction * tangent_norm(rates.data());
  const Vector3d now = block_of(p, block.first);
  return (now - nearest_in_cone(now - step * rates, first.friction)).norm() * block.diagonal;
}

// ---- iterations

// Returns an estimate of the largest eigenvalue of D A D, by powers.
double BodyConeSolver::largest_eigenvalue() {
  List<double>& w = tried_;
  w.resize(problem_->rows.size());
  for (std::size_t i = 0; i < w.size(); ++i)  // any start with a share of every direction
    w[i] = 1.0 + 0.37 * static_cast<double>(i * 7 % 11);
  double largest = 1.0;
  for (int k = 0; k < 8; ++k) {
    double square = 0.0;
    for (const double value : w) square += value * value;
    if (square == 0.0) return 1.0;
    const double share = 1.0 / std::sqrt(square);
    for (const Block& block : blocks_)
      for (std::size_t i = 0; i < block.size; ++i) w[block.first + i] *= share * block.d;
    set_velocities(w);
    square = 0.0;
    for (const Block& block : blocks_)
      for (std::size_t i = block.first; i < block.first + block.size; ++i) {
        w[i] = block.d * (rate(i) + row(i).softness * w[i]);
        square += w[i] * w[i];
      }
    largest = std::sqrt(square);
  }
  return largest;
}

// Starts from impulses p: z = D u, raised into the dual cone.
void BodyConeSolver::start(const List<double>& p) {
  const std::size_t n = p.size();
  x_.assign(n, 0.0);
  z_.assign(n, 0.0);
  r_.resize(n);
  set_velocities(p);
  for (const Block& block : blocks_) {
    if (block.d == 0.0) continue;
    const std::size_t i = block.first;
    for (std::size_t k = 0; k < block.size; ++k) {
      x_[i + k] = p[i + k] / block.d;
      z_[i + k] = block.d * (row(i + k).rate + rate(i + k) + row(i + k).softness * p[i + k]);
    }
    if (!is_contact(block)) continue;
    const double shift = row(i).friction * tangent_norm(&z_[i]);
    z_[i] = std::max(z_[i] + shift, shift);
  }
  y_ = x_;
}

void BodyConeSolver::set_weights(const Setting& setting, double rho) {
  for (Block& block : blocks_) {
    const double scaled_softness = block.d * block.d * row(block.first).softness;
    const bool is_free = !is_contact(block) && !has_bounds(block);
    const double weight = (is_free ? kJointPenalty : rho + setting.eta) + scaled_softness;
    block.inverse_weight.setZero();
    block.inverse_weight.diagonal().setConstant(1.0 / weight);
  }
}

BodyConeSolver::Change BodyConeSolver::iterate(const Setting& setting, double rho) {
  for (const Block& block : blocks_) {
    const bool is_free = !is_contact(block) && !has_bounds(block);
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      r_[i] = -block.d * row(i).rate +
              (is_free ? kJointPenalty * x_[i] : setting.eta * x_[i] + rho * y_[i] + z_[i]);
    if (is_contact(block))
      r_[block.first] -= row(block.first).friction * tangent_norm(&z_[block.first]);
  }
  tried_.swap(x_);  // x of the iteration before
  apply_inverse(r_, &x_);
  double primal = 0.0, dual = 0.0, most_x = 0.0, most_z = 0.0;
  for (const Block& block : blocks_) {
    const std::size_t first = block.first;
    if (!is_contact(block) && !has_bounds(block)) {
      y_[first] = x_[first];
      continue;
    }
    if (block.d == 0.0) continue;
    Vector3d relaxed = Vector3d::Zero(), next;
    for (std::size_t k = 0; k < block.size; ++k)
      relaxed[static_cast<Eigen::Index>(k)] =
          setting.relaxation * x_[first + k] + (1.0 - setting.relaxation) * y_[first + k];
    if (is_contact(block))
      next = nearest_in_cone(relaxed - block_of(z_, first) / rho, row(first).friction);
    else
      next[0] = std::clamp(relaxed[0] - z_[first] / rho, row(first).least / block.d,
                           row(first).most / block.d);
    for (std::size_t k = 0; k < block.size; ++k) {
      const std::size_t i = first + k;
      const double y = next[static_cast<Eigen::Index>(k)];
      dual = std::max(dual, std::abs(setting.eta * (x_[i] - tried_[i]) + rho * (y - y_[i])));
      z_[i] -= rho * (relaxed[static_cast<Eigen::Index>(k)] - y);
      y_[i] = y;
      primal = std::max(primal, std::abs(x_[i] - y));
      most_x = std::max({most_x, std::abs(x_[i]), std::abs(y)});
      most_z = std::max({most_z, std::abs(z_[i]), std::abs(block.d * row(i).rate)});
    }
  }
  constexpr double kTiny = 1e-300;
  return {primal / (most_x + kTiny), dual / (most_z + kTiny)};
}

void BodyConeSolver::run(const Setting& setting, double aim, double sufficient, int most_iterations,
                         StopFlag stop, Outcome* outcome, List<double>* p) {
  start(*p);
  const double L = largest_eigenvalue();
  double rho = std::sqrt(L * setting.eta) * math::fifth_root(L / setting.eta);
  double factored = 0.0;
  best_.resize(p->size());
  for (int k = 0; k < most_iterations && !is_set(stop); ++k) {
    if (rho != factored) {
      set_weights(setting, rho);
      factor();
      factored = rho;
    }
    const Change change = iterate(setting, rho);
    ++outcome->iterations;
    if (k < 2 || (k + 1) % kIterationsPerCheck == 0) {
      for (const Block& block : blocks_)
        for (std::size_t i = block.first; i < block.first + block.size; ++i)
          best_[i] = block.d * y_[i];
      const double now = residual(best_);
      if (now < outcome->residual) {
        outcome->residual = now;
        *p = best_;
      }
      if (outcome->residual <= (k + 1 < kSettling ? aim : std::max(aim, sufficient))) return;
    }
    if ((k + 1) % kIterationsPerFactor == 0) {
      constexpr double kTiny = 1e-300;
      const double factor = std::sqrt(change.primal / (change.dual + kTiny));
      if (factor > 3.0 || factor < 1.0 / 3.0)
        rho = std::clamp(rho * std::clamp(factor, 0.01, 10.0), 1e-10, 10.0 * std::max(L, 8.0));
    }
  }
}

// Takes the dense solution where it is nearer.
void BodyConeSolver::solve_small(StopFlag stop, Outcome* outcome, List<double>* p) {
  if (is_set(stop)) return;
  best_ = *p;
  small_.solve(*problem_, stop, &best_);
  const double now = residual(best_);
  if (now >= outcome->residual) return;
  outcome->residual = now;
  *p = best_;
}

// ---- sharing of redundant impulses

// Sets weights so that apply_inverse() acts within the directions in which a solution may change
// without another state of a contact. Returns whether there are any.
bool BodyConeSolver::free_directions(const List<double>& p) {
  double most = 0.0;
  for (const Block& block : blocks_)
    if (block.d > 0.0) most = std::max(most, std::abs(p[block.first]) / block.d);
  bool any = false;
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    Block& block = blocks_[b];
    block.inverse_weight.setZero();
    if (is_held_[b] != 0 || block.d == 0.0) continue;
    const BodyConeProblem::Row& first = row(block.first);
    const double normal = p[block.first];
    constexpr double kFree = 1.0 / kSharingPenalty;
    if (!is_contact(block)) {
      const double margin = kOpen * most * block.d;
      if (first.softness > 0.0 || normal - first.least <= margin || first.most - normal <= margin)
        continue;
      block.inverse_weight(0, 0) = kFree;
    } else {
      if (normal / block.d <= kOpen * most) continue;
      const double tangent = tangent_norm(&p[block.first]);
      if (first.friction == 0.0) {
        block.inverse_weight(0, 0) = kFree;
      } else if (tangent < (1.0 - kAtCone) * first.friction * normal) {
        block.inverse_weight.diagonal().setConstant(kFree);
      } else {
        const Vector3d along = block_of(p, block.first).normalized();
        block.inverse_weight = kFree * along * along.transpose();
      }
    }
    any = true;
  }
  return any;
}

// Returns the share of the change x_, at most 1, after which a block meets a bound.
double BodyConeSolver::way_to_bound(const Block& block, const List<double>& p) const {
  const std::size_t i = block.first;
  const auto way = [](double room, double speed) { return speed > room ? room / speed : 1.0; };
  if (!is_contact(block)) {
    const double change = block.d * x_[i];
    return std::min(way(p[i] - row(i).least, -change), way(row(i).most - p[i], change));
  }
  const double mu = row(i).friction;
  const Vector3d now = block_of(p, i), change = block.d * block_of(x_, i);
  const double of_normal = way(now[0], -change[0]);
  if (mu == 0.0 || tangent_norm(now.data()) >= (1.0 - kAtCone) * mu * now[0]) return of_normal;
  // root of ‖t + s t'‖² = μ² (n + s n')²
  const double a = change[1] * change[1] + change[2] * change[2] - mu * mu * change[0] * change[0];
  const double b = now[1] * change[1] + now[2] * change[2] - mu * mu * now[0] * change[0];
  const double c = now[1] * now[1] + now[2] * now[2] - mu * mu * now[0] * now[0];  // < 0
  if (a + 2.0 * b + c <= 0.0) return of_normal;
  const double root = std::sqrt(std::max(b * b - a * c, 0.0));
  const double s = b > 0.0 ? -c / (b + root) : (root - b) / a;
  return std::clamp(s, 0.0, of_normal);
}

// Takes the part of x = D⁻¹ p out that leaves the bodies as they are. Where a contact meets the
// border of its cone, it is held there and the others go on.
void BodyConeSolver::share(double aim, Outcome* outcome, List<double>* p) {
  is_held_.assign(blocks_.size(), 0);
  for (int round = 0; round < kSharingRounds; ++round) {
    if (!free_directions(*p)) return;
    factor();
    for (const Block& block : blocks_)
      for (std::size_t i = block.first; i < block.first + block.size; ++i)
        x_[i] = block.d > 0.0 ? (*p)[i] / block.d : 0.0;
    double before = 0.0, change = 0.0;
    for (const double x : x_) before = std::max(before, std::abs(x));
    for (int k = 0; k < kSharingSteps; ++k) {
      r_ = x_;
      apply_inverse(r_, &x_);
      for (double& x : x_) x *= kSharingPenalty;
    }
    for (double& x : x_) {
      x = -x;
      change = std::max(change, std::abs(x));
    }
    if (change <= kOpen * before) return;
    double share = 1.0;
    for (std::size_t b = 0; b < blocks_.size(); ++b)
      if (is_held_[b] == 0) share = std::min(share, way_to_bound(blocks_[b], *p));
    best_ = *p;
    for (const Block& block : blocks_)
      for (std::size_t i = block.first; i < block.first + block.size; ++i)
        best_[i] += share * block.d * x_[i];
    const double now = residual(best_);
    if (now > std::max(aim, outcome->residual)) return;
    outcome->residual = now;
    const bool is_done = share == 1.0;
    for (std::size_t b = 0; b < blocks_.size() && !is_done; ++b)
      if (is_held_[b] == 0 && way_to_bound(blocks_[b], *p) <= share) is_held_[b] = 1;
    *p = best_;
    if (is_done) return;
  }
}

}  // namespace constraint_sim::engine
