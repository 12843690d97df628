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
constexpr int kSharingSteps = 3, kSharingRounds = 12;
// Share of the largest scaled impulse below which sharing changes nothing.
constexpr double kShared = 1e-9;
// Share of the largest scaled impulse below which a contact counts as open, and share of Coulomb's
// limit within which it counts as slipping.
constexpr double kOpen = 1e-9, kAtCone = 1e-7;
// Multiple of the residual that a contact exceeds by slipping.
constexpr double kSlips = 100.0;
constexpr int kIterationsPerCheck = 5, kIterationsPerFactor = 10;
// Proximal weight η of the alternations, small as is best near a solution and with large mass
// ratios. The most alternations: their aim is the tolerance, so that their impulses solve the next
// step of a stack, too, while Newton's method ends at a sufficient residual.
constexpr double kEta = 1e-9;
// Least weight ρ of the alternations, where rows are scaled to a diagonal of 1.
constexpr double kLeastRho = 1e-10;
constexpr int kMostAlternations = 50;
// Most steps of Newton's method without the rows without bounds, and first σ without and with them.
constexpr int kMostCondensed = 100;
constexpr double kCondensedSigma = 1e3, kBodiesSigma = 1.0;
// Most entries of factors visited by the alternations and by Newton's method, some 0.1 s of work
// each, the entries that a step of Newton's method counts for, and the least number of its steps.
constexpr double kMostEntries = 3e7, kEntriesPerStep = 10.0;
constexpr int kLeastSteps = 5;
// Ratio of masses from which Newton's method goes on below a residual that is good enough, and the
// most steps for that.
constexpr double kHeavy = 1e3;
constexpr int kMostBeyondEnough = 10;
// Residual that is negligible, as a share of the sufficient one.
constexpr double kNegligible = 1e-4;
// Added to divisors that are zero where nothing acts; below the rounding of any other divisor.
constexpr double kNotZero = 1e-300;

}  // namespace

BodyConeSolver::Outcome BodyConeSolver::solve(const BodyConeProblem& problem, const Goal& goal,
                                              StopFlag stop, List<double>* p) {
  blocks_.set(problem);
  v_.resize(problem.bodies.size());
  inverse_weights_.resize(blocks_.all().size());
  Outcome outcome;
  for (const BodyConeProblem::Row& row : problem.rows)
    outcome.scale = std::max(outcome.scale, std::abs(row.rate));
  outcome.residual = blocks_.residual(*p, &v_);
  const double aim = std::max(goal.tolerance * outcome.scale, kNegligible * goal.sufficient);
  outcome.enough = std::max(aim, goal.sufficient);
  if (outcome.residual <= aim) return outcome;
  const double loose = std::min(goal.share * outcome.residual, goal.loose);
  const bool is_loose = loose > outcome.enough && !has_free_rows();
  if (is_loose) {
    outcome.enough = loose;
    outcome.residual = sweeps_.solve(blocks_, outcome.enough, outcome.residual, stop, p);
    outcome.iterations += sweeps_.sweeps();
    if (outcome.residual <= outcome.enough || is_set(stop)) return outcome;
  }
  analyze();
  const bool is_condensed = condensed_.set(blocks_);
  if (is_condensed)
    solve_by_newton({aim, std::min(goal.most_iterations, kMostCondensed), kCondensedSigma}, stop,
                    &condensed_, &outcome, p);
  if ((!is_condensed || outcome.residual > outcome.enough) && !is_set(stop))
    alternate(is_loose ? outcome.enough : aim, std::min(goal.most_iterations, kMostAlternations),
              stop, &outcome, p);
  // Heavy bodies on light ones would sink by a residual that is good enough for others.
  const bool is_refined = !is_loose && has_heavy_bodies();
  const double newton_aim = is_refined ? aim : outcome.enough;
  if (outcome.residual > newton_aim && !is_set(stop)) {
    const double entries = 1.0 + static_cast<double>(factors_.values().size());
    const int affordable = kLeastSteps + static_cast<int>(kMostEntries / entries);
    const int most = outcome.residual > outcome.enough ? goal.most_iterations : kMostBeyondEnough;
    all_rows_.set(blocks_);
    solve_by_newton({newton_aim, std::min(most, affordable), kBodiesSigma}, stop, &all_rows_,
                    &outcome, p);
  }
  if (goal.is_shared && !is_set(stop)) share(aim, &outcome, p);
  return outcome;
}

void BodyConeSolver::solve_by_newton(const ProximalNewton::Goal& goal, StopFlag stop,
                                     ProximalEquations* equations, Outcome* outcome,
                                     List<double>* p) {
  tried_ = *p;
  newton_.solve(goal, outcome->residual, stop, equations, &tried_);
  outcome->iterations += newton_.steps();
  const double now = blocks_.residual(tried_, &v_);  // also of rows that the equations left out
  if (!(now < outcome->residual)) return;
  outcome->residual = now;
  p->swap(tried_);
}

bool BodyConeSolver::has_heavy_bodies() const {
  const auto [lightest, heaviest] =
      std::minmax_element(problem().bodies.begin(), problem().bodies.end(),
                          [](const auto& a, const auto& b) { return a.mass < b.mass; });
  return heaviest->mass > kHeavy * lightest->mass;
}

bool BodyConeSolver::has_free_rows() const {
  return std::any_of(blocks_.all().begin(), blocks_.all().end(), [this](const Block& block) {
    return !blocks_.is_contact(block) && !blocks_.has_bounds(block);
  });
}

// ---- the matrix over bodies

void BodyConeSolver::analyze() {
  blocks_.find_edges();
  const std::size_t bodies = problem().bodies.size();
  on_bodies_.resize(bodies);
  on_edges_.resize(blocks_.edges().size());
  right_.resize(6 * bodies);
  if (bodies == analyzed_bodies_ && blocks_.edges() == analyzed_edges_) return;
  analyzed_bodies_ = bodies;
  analyzed_edges_ = blocks_.edges();

  List<std::pair<int, int>> entries;
  const auto visit_entries = [&](const auto& visit) {
    for (int body = 0; body < static_cast<int>(bodies); ++body)
      for (int j = 0; j < 6; ++j)
        for (int i = j; i < 6; ++i) visit(6 * body + i, 6 * body + j);
    for (const auto& [a, b] : analyzed_edges_)
      for (int j = 0; j < 6; ++j)
        for (int i = 0; i < 6; ++i) visit(6 * b + i, 6 * a + j);
  };
  visit_entries([&](int i, int j) { entries.emplace_back(i, j); });
  factors_.analyze(static_cast<int>(6 * bodies), entries);
  slots_.clear();
  visit_entries([&](int i, int j) { slots_.push_back(factors_.slot(i, j)); });
}

// Adds Jᵀ D W⁻¹ D J.
void BodyConeSolver::add_to_matrix(const Block& block, const Eigen::Matrix3d& inverse_weight) {
  if (block.d == 0.0) return;
  blocks_.add_products(block, block.d * block.d * inverse_weight, false,
                       [&](int body, int other, std::size_t edge, const Matrix6& matrix) {
                         if (body == other)
                           on_bodies_[body] += matrix;
                         else
                           on_edges_[edge] += matrix.transpose();
                       });
}

// Factors K = M + Jᵀ D W⁻¹ D J.
void BodyConeSolver::factor() {
  for (std::size_t body = 0; body < on_bodies_.size(); ++body) {
    on_bodies_[body].setZero();
    on_bodies_[body].topLeftCorner<3, 3>().diagonal().setConstant(problem().bodies[body].mass);
    on_bodies_[body].bottomRightCorner<3, 3>() = problem().bodies[body].inertia;
  }
  for (Matrix6& matrix : on_edges_) matrix.setZero();
  for (std::size_t b = 0; b < blocks_.all().size(); ++b)
    add_to_matrix(blocks_.all()[b], inverse_weights_[b]);
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
  for (std::size_t b = 0; b < blocks_.all().size(); ++b) {
    const Block& block = blocks_.all()[b];
    const Vector3d f =
        block.d * (block.size == 1 ? Vector3d(inverse_weights_[b](0, 0) * r[block.first], 0.0, 0.0)
                                   : Vector3d(inverse_weights_[b] * block_of(r, block.first)));
    for (std::size_t i = 0; i < block.size; ++i)
      for (std::size_t k = blocks_.parts_begin(block.first + i); k < row(block.first + i).parts_end;
           ++k)
        v_[problem().parts[k].body] += f[static_cast<Eigen::Index>(i)] * problem().parts[k].J;
  }
  for (std::size_t i = 0; i < right_.size(); ++i)
    right_[factors_.place(static_cast<int>(i))] = v_[i / 6][static_cast<Eigen::Index>(i % 6)];
  factors_.solve(right_.data());
  for (std::size_t i = 0; i < right_.size(); ++i)
    v_[i / 6][static_cast<Eigen::Index>(i % 6)] = right_[factors_.place(static_cast<int>(i))];
  x->resize(r.size());
  for (std::size_t b = 0; b < blocks_.all().size(); ++b) {
    const Block& block = blocks_.all()[b];
    Vector3d left = Vector3d::Zero();
    for (std::size_t i = 0; i < block.size; ++i)
      left[static_cast<Eigen::Index>(i)] =
          r[block.first + i] - block.d * blocks_.rate(block.first + i, v_);
    const Vector3d result = inverse_weights_[b] * left;
    for (std::size_t i = 0; i < block.size; ++i)
      (*x)[block.first + i] = result[static_cast<Eigen::Index>(i)];
  }
}

// ---- iterations

// Returns an estimate of the largest eigenvalue of D A D, by power iteration.
double BodyConeSolver::largest_eigenvalue() {
  List<double>& w = tried_;
  w.resize(problem().rows.size());
  for (std::size_t i = 0; i < w.size(); ++i)  // any start with a share of every direction
    w[i] = 1.0 + 0.37 * static_cast<double>(i * 7 % 11);
  double largest = 1.0;
  for (int k = 0; k < 8; ++k) {
    double square = 0.0;
    for (const double value : w) square += value * value;
    if (square == 0.0) return 1.0;
    const double share = 1.0 / std::sqrt(square);
    for (const Block& block : blocks_.all())
      for (std::size_t i = 0; i < block.size; ++i) w[block.first + i] *= share * block.d;
    blocks_.set_velocities(w, &v_);
    square = 0.0;
    for (const Block& block : blocks_.all())
      for (std::size_t i = block.first; i < block.first + block.size; ++i) {
        w[i] = block.d * (blocks_.rate(i, v_) + row(i).softness * w[i]);
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
  blocks_.set_velocities(p, &v_);
  for (const Block& block : blocks_.all()) {
    if (block.d == 0.0) continue;
    const std::size_t i = block.first;
    for (std::size_t k = 0; k < block.size; ++k) {
      x_[i + k] = p[i + k] / block.d;
      z_[i + k] =
          block.d * (row(i + k).rate + blocks_.rate(i + k, v_) + row(i + k).softness * p[i + k]);
    }
    if (!blocks_.is_contact(block)) continue;
    const double shift = row(i).friction * tangent_norm(&z_[i]);
    z_[i] = std::max(z_[i] + shift, shift);
  }
  y_ = x_;
}

void BodyConeSolver::set_weights(double rho) {
  for (std::size_t b = 0; b < blocks_.all().size(); ++b) {
    const Block& block = blocks_.all()[b];
    const double scaled_softness = block.d * block.d * row(block.first).softness;
    const bool is_free = !blocks_.is_contact(block) && !blocks_.has_bounds(block);
    const double weight = (is_free ? kJointPenalty : rho + kEta) + scaled_softness;
    inverse_weights_[b] = 1.0 / weight * Eigen::Matrix3d::Identity();
  }
}

BodyConeSolver::Change BodyConeSolver::iterate(double rho) {
  for (const Block& block : blocks_.all()) {
    const bool is_free = !blocks_.is_contact(block) && !blocks_.has_bounds(block);
    for (std::size_t i = block.first; i < block.first + block.size; ++i)
      r_[i] = -block.d * row(i).rate +
              (is_free ? kJointPenalty * x_[i] : kEta * x_[i] + rho * y_[i] + z_[i]);
    if (blocks_.is_contact(block))
      r_[block.first] -= row(block.first).friction * tangent_norm(&z_[block.first]);
  }
  tried_.swap(x_);  // x of the iteration before
  apply_inverse(r_, &x_);
  double primal = 0.0, dual = 0.0, most_x = 0.0, most_z = 0.0;
  for (const Block& block : blocks_.all()) {
    const std::size_t first = block.first;
    if (!blocks_.is_contact(block) && !blocks_.has_bounds(block)) {
      y_[first] = x_[first];
      continue;
    }
    if (block.d == 0.0) continue;
    Vector3d next;
    if (blocks_.is_contact(block))
      next = nearest_in_cone(block_of(x_, first) - block_of(z_, first) / rho, row(first).friction);
    else
      next[0] = std::clamp(x_[first] - z_[first] / rho, row(first).least / block.d,
                           row(first).most / block.d);
    for (std::size_t k = 0; k < block.size; ++k) {
      const std::size_t i = first + k;
      const double y = next[static_cast<Eigen::Index>(k)];
      dual = std::max(dual, std::abs(kEta * (x_[i] - tried_[i]) + rho * (y - y_[i])));
      z_[i] -= rho * (x_[i] - y);
      y_[i] = y;
      primal = std::max(primal, std::abs(x_[i] - y));
      most_x = std::max({most_x, std::abs(x_[i]), std::abs(y)});
      most_z = std::max({most_z, std::abs(z_[i]), std::abs(block.d * row(i).rate)});
    }
  }
  return {primal / (most_x + kNotZero), dual / (most_z + kNotZero)};
}

void BodyConeSolver::alternate(double aim, int most, StopFlag stop, Outcome* outcome,
                               List<double>* p) {
  start(*p);
  const double L = largest_eigenvalue();
  double rho = std::sqrt(L * kEta) * math::fifth_root(L / kEta);
  double factored = 0.0, before = kInfinity;
  best_.resize(p->size());
  for (int k = 0; k < most && !is_set(stop); ++k) {
    if (rho != factored) {
      set_weights(rho);
      factor();
      factored = rho;
    }
    const Change change = iterate(rho);
    ++outcome->iterations;
    if (k < 2 || (k + 1) % kIterationsPerCheck == 0) {
      for (const Block& block : blocks_.all())
        for (std::size_t i = block.first; i < block.first + block.size; ++i)
          best_[i] = block.d * y_[i];
      const double now = blocks_.residual(best_, &v_);
      if (now < outcome->residual) {
        outcome->residual = now;
        *p = best_;
      }
      if (outcome->residual <= aim) return;
      const int checks = (most - k) / kIterationsPerCheck;
      const bool reaches_aim = k < kIterationsPerCheck || reaches(before, now, checks, aim);
      if (outcome->residual <= outcome->enough && !reaches_aim) return;
      before = now;
    }
    if ((k + 1) % kIterationsPerFactor == 0) {
      const double factor = std::sqrt(change.primal / (change.dual + kNotZero));
      if (factor > 3.0 || factor < 1.0 / 3.0)
        rho = std::clamp(rho * std::clamp(factor, 0.01, 10.0), kLeastRho, 10.0 * std::max(L, 8.0));
    }
  }
}

// ---- sharing of redundant impulses

// Sets the freedom of each block at a solution p within `residual`. A contact slips where its rate
// says so, since its impulse may be on the border of the cone while it sticks.
void BodyConeSolver::set_freedoms(const List<double>& p, double residual) {
  blocks_.set_velocities(p, &v_);
  double most = 0.0;
  for (const Block& block : blocks_.all())
    if (block.d > 0.0) most = std::max(most, std::abs(p[block.first]) / block.d);
  freedoms_.resize(blocks_.all().size());
  for (std::size_t b = 0; b < freedoms_.size(); ++b) {
    const Block& block = blocks_.all()[b];
    const BodyConeProblem::Row& first = row(block.first);
    const double normal = p[block.first], margin = kOpen * most * block.d;
    freedoms_[b] = Freedom::kNone;
    if (block.d == 0.0) continue;
    if (!blocks_.is_contact(block)) {
      if (first.softness == 0.0 && normal - first.least > margin && first.most - normal > margin)
        freedoms_[b] = Freedom::kAll;
    } else if (normal > margin) {
      double rates[3] = {};
      for (std::size_t i = 1; i < 3; ++i)
        rates[i] = row(block.first + i).rate + blocks_.rate(block.first + i, v_);
      const bool slips =
          tangent_norm(&p[block.first]) >= (1.0 - kAtCone) * first.friction * normal &&
          tangent_norm(rates) > kSlips * residual;
      freedoms_[b] = slips || first.friction == 0.0 ? Freedom::kAlong : Freedom::kAll;
    }
  }
}

// Sets weights so that apply_inverse() acts within the freedoms; returns whether there are any.
bool BodyConeSolver::set_free_weights(const List<double>& p) {
  constexpr double kFree = 1.0 / kSharingPenalty;
  bool any = false;
  for (std::size_t b = 0; b < freedoms_.size(); ++b) {
    const Block& block = blocks_.all()[b];
    Eigen::Matrix3d& inverse_weight = inverse_weights_[b];
    inverse_weight.setZero();
    if (freedoms_[b] == Freedom::kNone) continue;
    any = true;
    if (block.size == 1) {
      inverse_weight(0, 0) = kFree;
    } else if (freedoms_[b] == Freedom::kAll) {
      inverse_weight.diagonal().setConstant(kFree);
    } else {
      const Vector3d along = block_of(p, block.first).normalized();
      inverse_weight = kFree * along * along.transpose();
    }
  }
  return any;
}

// Returns the share of the change x_, at most 1, after which a block meets a bound.
double BodyConeSolver::share_to_bound(std::size_t b, const List<double>& p) const {
  if (freedoms_[b] == Freedom::kNone) return 1.0;
  const Block& block = blocks_.all()[b];
  const std::size_t i = block.first;
  const auto share_within = [](double room, double speed) {
    return speed > room ? room / speed : 1.0;
  };
  if (!blocks_.is_contact(block)) {
    const double change = block.d * x_[i];
    return std::min(share_within(p[i] - row(i).least, -change),
                    share_within(row(i).most - p[i], change));
  }
  const double mu = row(i).friction;
  const Vector3d now = block_of(p, i), change = block.d * block_of(x_, i);
  const double of_normal = share_within(now[0], -change[0]);
  if (freedoms_[b] == Freedom::kAlong) return of_normal;
  // root of ‖t + s t'‖² = μ² (n + s n')²
  const double a = change[1] * change[1] + change[2] * change[2] - mu * mu * change[0] * change[0];
  const double half = now[1] * change[1] + now[2] * change[2] - mu * mu * now[0] * change[0];
  // Not positive, since the impulse is within its cone; rounding may take it slightly beyond.
  const double c = std::min(now[1] * now[1] + now[2] * now[2] - mu * mu * now[0] * now[0], 0.0);
  if (a + 2.0 * half + c <= 0.0) return of_normal;
  const double root = std::sqrt(std::max(half * half - a * c, 0.0));
  const double s = half > 0.0 ? -c / (half + root) : (root - half) / a;
  return std::clamp(s, 0.0, of_normal);
}

// Takes the part of x = D⁻¹ p out that leaves the bodies as they are. A block that meets a bound
// loses a freedom, and the others go on.
void BodyConeSolver::share(double aim, Outcome* outcome, List<double>* p) {
  x_.resize(p->size());
  set_freedoms(*p, std::max(aim, outcome->residual));
  for (int round = 0; round < kSharingRounds; ++round) {
    if (!set_free_weights(*p)) return;
    factor();
    for (const Block& block : blocks_.all())
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
    if (change <= kShared * before) return;
    double share = 1.0;
    for (std::size_t b = 0; b < freedoms_.size(); ++b)
      share = std::min(share, share_to_bound(b, *p));
    best_ = *p;
    for (const Block& block : blocks_.all())
      for (std::size_t i = block.first; i < block.first + block.size; ++i)
        best_[i] += share * block.d * x_[i];
    const double now = blocks_.residual(best_, &v_);
    if (now > std::max(aim, outcome->residual)) return;
    outcome->residual = now;
    if (share < 1.0) lose_freedoms(share, *p);
    *p = best_;
    if (share == 1.0) return;
  }
}

// Takes a freedom from each block that meets a bound within `share` of the change x_. A contact at
// its bound may still change along its impulse; any other block changes no more.
void BodyConeSolver::lose_freedoms(double share, const List<double>& p) {
  for (std::size_t b = 0; b < freedoms_.size(); ++b) {
    if (share_to_bound(b, p) > share) continue;
    const bool keeps_along = blocks_.all()[b].size == 3 && freedoms_[b] == Freedom::kAll;
    freedoms_[b] = keeps_along ? Freedom::kAlong : Freedom::kNone;
  }
}

}  // namespace constraint_sim::engine
