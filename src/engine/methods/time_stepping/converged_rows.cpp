#include "engine/methods/time_stepping/converged_rows.h"

#include <algorithm>
#include <numeric>

#include "engine/constraints/contact.h"

namespace constraint_sim::engine {
namespace {

// Residual at which the iterations end, as a share of the largest rate without impulses; sufficient
// residual, as a share of the speed that counts as rest; and most iterations.
constexpr double kTolerance = 1e-9, kSufficient = 0.5;
// Residual that is good enough for contacts in motion, as a share of what the step changes, of
// their largest rate, and of the speed that a fall gains in the step: the error of the step itself
// is larger by far. Contacts at rest would be shaken.
constexpr double kMoving = 1e-3;
// Multiple of the residual that is good enough from which a component counts as unsolved.
constexpr double kUnsolved = 2.0;
constexpr int kMostIterations = 300;
// Rate at which a contact approaches, over the speed that counts as rest, up to which the mean
// velocity takes it less than 0.5 % of g h² deep.
constexpr double kGentleImpact = 1e3;
// Bodies of a component beyond which its rows are swept.
constexpr std::size_t kMostSolvedBodies = 500;

bool is_tangent(const Row& row) { return row.normal_row >= 0; }
/// Sign of the rates that open a one-sided row; 0 for rows that act both ways.
double side_of(const Row& row) { return row.lower == 0.0 ? 1.0 : row.upper == 0.0 ? -1.0 : 0.0; }
bool is_second_part(const Row& row) { return row.normal_row == Row::kCoupledPart; }

BodyConeSolver::Goal goal_at(double rest_speed) {
  return {kTolerance, kSufficient * rest_speed, kMostIterations, 0.0, kMoving};
}

}  // namespace

void ConvergedRows::Outcome::add(const Outcome& other) {
  residual = std::max(residual, other.residual);
  iterations = std::max(iterations, other.iterations);
  solved = std::max(solved, other.solved);
  if (unsolved < 0) unsolved = other.unsolved;
  has_swept = has_swept || other.has_swept;
}

// Sorts rows by components, each in the order of the rows.
void ConvergedRows::list_by_component(const List<Row>& rows, const RowSolver& solver) {
  order_.resize(rows.size());
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
    const int of_a = solver.component(a), of_b = solver.component(b);
    return of_a != of_b ? of_a < of_b : a < b;
  });
  begins_.clear();
  for (std::size_t k = 0; k < order_.size(); ++k)
    if (k == 0 || solver.component(order_[k]) != solver.component(order_[k - 1]))
      begins_.push_back(k);
  begins_.push_back(order_.size());
  if (solvers_.size() + 1 < begins_.size()) solvers_.resize(begins_.size() - 1);
}

void ConvergedRows::add_part(int body, const Twist& J, const List<BodyState>& bodies,
                             const List<MassProperties>& masses) {
  const MassProperties& mass = masses[body];
  if (!mass.is_movable()) return;
  if (local_of_[body] < 0) {
    local_of_[body] = static_cast<int>(bodies_.size());
    bodies_.push_back(body);
    BodyConeProblem::Body& added = problem_.bodies.emplace_back();
    added.inverse_mass = mass.inverse_mass;
    added.mass = 1.0 / mass.inverse_mass;
    if (mass.can_turn()) {
      const Eigen::Matrix3d R = bodies[body].orientation.toRotationMatrix();
      added.inertia = R * mass.inertia.asDiagonal() * R.transpose();
      added.inverse_inertia = R * mass.inverse_inertia.asDiagonal() * R.transpose();
    }
  }
  const std::size_t begin = problem_.rows.empty() ? 0 : problem_.rows.back().parts_end;
  for (std::size_t k = begin; k < problem_.parts.size(); ++k)
    if (problem_.parts[k].body == local_of_[body]) {
      problem_.parts[k].J += J;
      return;
    }
  problem_.parts.push_back({local_of_[body], J});
}

void ConvergedRows::add_parts(const Row& row, const List<BodyState>& bodies,
                              const List<MassProperties>& masses) {
  const auto twist_of = [&](int body, const Eigen::Vector3d& force, const Eigen::Vector3d& torque) {
    return twist(force,
                 masses[body].can_turn() ? torque : Eigen::Vector3d(Eigen::Vector3d::Zero()));
  };
  add_part(row.body_a, twist_of(row.body_a, row.J.j1, row.J.j2), bodies, masses);
  add_part(row.body_b, twist_of(row.body_b, row.J.j3, row.J.j4), bodies, masses);
}

void ConvergedRows::forget_bodies() {
  for (const int body : bodies_) local_of_[body] = -1;
  bodies_.clear();
  problem_.clear();
  problem_rows_.clear();
  impulses_.clear();
}

// Rates without impulses are the present ones without the effect of the first guesses.
void ConvergedRows::set_velocity_problem(std::size_t begin, std::size_t end,
                                         const List<BodyState>& bodies,
                                         const List<MassProperties>& masses, const List<Row>& rows,
                                         const RowSolver& solver) {
  for (std::size_t k = begin; k < end; ++k) {
    const Row& row = rows[order_[k]];
    if (is_second_part(row)) continue;
    add_parts(row, bodies, masses);
    double rate = solver.rate(row, order_[k]) - row.target;
    if (row.normal_row == Row::kCoupled) {
      add_parts(rows[order_[k] + 1], bodies, masses);
      rate += solver.rate(rows[order_[k] + 1], order_[k] + 1);
    }
    BodyConeProblem::Row& added = problem_.rows.emplace_back();
    added.parts_end = problem_.parts.size();
    added.rate = rate;
    added.softness = row.softness;
    added.least = row.lower;
    added.most = row.upper;
    if (is_tangent(row)) {
      added.kind = BodyConeProblem::Kind::kTangent;
      BodyConeProblem::Row& normal =
          problem_.rows[problem_.rows.size() - (order_[k] - to_index(row.normal_row)) - 1];
      normal.kind = BodyConeProblem::Kind::kNormal;
      normal.friction = row.friction;
    }
    problem_rows_.push_back(order_[k]);
    impulses_.push_back(row.impulse);
  }
  by_guesses_.assign(problem_.bodies.size(), Twist::Zero());
  std::size_t part = 0;
  for (std::size_t i = 0; i < problem_.rows.size(); ++i)
    for (; part < problem_.rows[i].parts_end; ++part)
      by_guesses_[problem_.parts[part].body] += impulses_[i] * problem_.parts[part].J;
  for (std::size_t body = 0; body < by_guesses_.size(); ++body)
    by_guesses_[body] = problem_.bodies[body].apply_inverse(by_guesses_[body]);
  part = 0;
  for (BodyConeProblem::Row& row : problem_.rows)
    for (; part < row.parts_end; ++part)
      row.rate -= problem_.parts[part].J.dot(by_guesses_[problem_.parts[part].body]);
}

// Returns the largest rate of the rows before the step.
double ConvergedRows::largest_rate(std::size_t begin, std::size_t end, const List<Row>& rows,
                                   const RowSolver& solver) const {
  double most = 0.0;
  for (std::size_t k = begin; k < end; ++k)
    most = std::max(most, std::abs(solver.rate_before(rows[order_[k]], order_[k])));
  return most;
}

// Returns whether there is anything to correct.
bool ConvergedRows::set_correction_problem(std::size_t begin, std::size_t end,
                                           const List<BodyState>& bodies,
                                           const List<MassProperties>& masses, bool is_anew,
                                           const List<Row>& rows, const RowSolver& solver) {
  const auto corrects = [&](std::size_t i) {
    return rows[i].correction != 0.0 || rows[i].correction_impulse != 0.0;
  };
  if (std::none_of(order_.begin() + static_cast<std::ptrdiff_t>(begin),
                   order_.begin() + static_cast<std::ptrdiff_t>(end), corrects))
    return false;
  for (std::size_t k = begin; k < end; ++k) {
    const Row& row = rows[order_[k]];
    if (is_second_part(row) || is_tangent(row)) continue;
    add_parts(row, bodies, masses);
    double rate = solver.rate(row, order_[k]);
    if (row.normal_row == Row::kCoupled) {
      add_parts(rows[order_[k] + 1], bodies, masses);
      rate += solver.rate(rows[order_[k] + 1], order_[k] + 1);
    }
    BodyConeProblem::Row& added = problem_.rows.emplace_back();
    added.parts_end = problem_.parts.size();
    added.rate = -RowSolver::correction_target(row, rate);
    added.softness = row.softness + row.yielding * solver.inverse_mass(order_[k]);
    // around 0 also where rounding has taken the impulse of the row beyond its own bounds
    added.least = row.lower == 0.0 ? 0.0 : std::min(row.lower - row.impulse, 0.0);
    added.most = row.upper == 0.0 ? 0.0 : std::max(row.upper - row.impulse, 0.0);
    problem_rows_.push_back(order_[k]);
    impulses_.push_back(is_anew ? 0.0 : row.correction_impulse);
  }
  return true;
}

// Adds the outcome of the present component.
void ConvergedRows::add(const BodyConeSolver::Outcome& solved, Outcome* outcome) const {
  outcome->iterations = std::max(outcome->iterations, solved.iterations);
  outcome->residual = std::max(outcome->residual, solved.residual);
  const double most = kUnsolved * solved.enough;
  outcome->solved = std::max(outcome->solved, most);
  if (solved.residual > most && outcome->unsolved < 0) outcome->unsolved = bodies_.front();
}

ConvergedRows::Outcome ConvergedRows::solve(const List<BodyState>& bodies,
                                            const List<MassProperties>& masses,
                                            const Accuracy& accuracy, StopFlag stop,
                                            List<Row>* rows, RowSolver* solver) {
  Outcome outcome;
  BodyConeSolver::Goal goal = goal_at(accuracy.rest_speed);
  swept_.clear();
  local_of_.assign(bodies.size(), -1);
  list_by_component(*rows, *solver);
  is_swept_.assign(bodies.size(), 0);
  loose_.assign(begins_.size(), 0.0);
  corrected_.assign(begins_.size(), Outcome{});
  for (std::size_t c = 0; c + 1 < begins_.size() && !is_set(stop); ++c) {
    forget_bodies();
    set_velocity_problem(begins_[c], begins_[c + 1], bodies, masses, *rows, *solver);
    if (problem_.bodies.size() > kMostSolvedBodies) {
      for (std::size_t k = begins_[c]; k < begins_[c + 1]; ++k) swept_.push_back(order_[k]);
      outcome.iterations = std::max(outcome.iterations, accuracy.sweeps);
      outcome.has_swept = true;
      is_swept_[to_index(solver->component(order_[begins_[c]]))] = 1;
      continue;
    }
    const double fastest = largest_rate(begins_[c], begins_[c + 1], *rows, *solver);
    if (!accuracy.is_unique)
      goal.loose = kMoving * std::min(fastest, accuracy.rest_speed / kConvergedRest);
    loose_[c] = goal.loose;
    add(solvers_[c].solve(problem_, goal, stop, &impulses_), &outcome);
    for (std::size_t i = 0; i < problem_rows_.size(); ++i)
      solver->set_impulse(problem_rows_[i], impulses_[i], rows);
  }
  forget_bodies();
  solver->sweep(swept_, accuracy.sweeps, stop, *rows);
  return outcome;
}

void ConvergedRows::correct(const List<BodyState>& bodies, const List<MassProperties>& masses,
                            double rest_speed, const List<Start>& starts, StopFlag stop,
                            List<Row>* rows, RowSolver* solver) {
  BodyConeSolver::Goal goal = goal_at(rest_speed);
  for (std::size_t c = 0; c + 1 < begins_.size() && !is_set(stop); ++c) {
    const int component = solver->component(order_[begins_[c]]);
    const Start start = starts[to_index(component)];
    if (is_swept(component) || start == Start::kKept ||
        !set_correction_problem(begins_[c], begins_[c + 1], bodies, masses, start == Start::kAnew,
                                *rows, *solver))
      continue;
    goal.loose = loose_[c];
    goal.is_shared = start != Start::kAgain;
    corrected_[c] = Outcome{};
    add(solvers_[c].solve(problem_, goal, stop, &impulses_), &corrected_[c]);
    for (std::size_t i = 0; i < problem_rows_.size(); ++i)
      solver->set_correction(problem_rows_[i], impulses_[i], rows);
    forget_bodies();
  }
}

ConvergedRows::Outcome ConvergedRows::corrected() const {
  Outcome outcome;
  for (const Outcome& of_component : corrected_) outcome.add(of_component);
  return outcome;
}

// Gives both bodies of a row the same kind of motion where the mean velocity would take one
// into the other: in a stack that falls, the upper box moves as the lower one that hits the floor.
// Returns whether a motion changed.
bool ConvergedRows::carry_motions(const List<Row>& rows, double rest_speed, bool joints_by_mean,
                                  const RowSolver& solver) {
  bool has_changed = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    Motion &of_a = motions_[row.body_a], &of_b = motions_[row.body_b];
    if (of_a == of_b || is_tangent(row)) continue;
    const double change = of_a < of_b ? row.J.j1.dot(solver.velocity_change(row.body_a).head<3>())
                                      : row.J.j3.dot(solver.velocity_change(row.body_b).head<3>());
    const double side = joints_by_mean ? side_of(row) : 1.0;
    const double aim = side > 0.0   ? std::min(row.target, 0.0)
                       : side < 0.0 ? std::max(row.target, 0.0)
                                    : row.target;
    const double off = solver.rate(row, i) - 0.5 * change - aim;
    const double approach = side == 0.0 ? std::abs(off) : -side * off;
    if (!(approach > kGentleImpact * rest_speed)) continue;
    of_a = of_b = std::max(of_a, of_b);
    has_changed = true;
  }
  return has_changed;
}

void ConvergedRows::find_gains(const List<int>& moved, const List<Row>& rows, double rest_speed,
                               bool joints_by_mean, RowSolver* solver) {
  motions_.assign(local_of_.size(), Motion::kMean);
  const auto move = [&](const Row& row, Motion motion) {
    for (const int body : {row.body_a, row.body_b})
      motions_[body] = std::max(motions_[body], motion);
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    if (is_tangent(row)) continue;
    const bool is_contact = row.lower == 0.0 && row.component < 0 && row.coordinate < 0;
    const double side = side_of(row);
    if (!is_contact && !joints_by_mean)
      move(row, Motion::kEnd);
    else if (side != 0.0 && row.impulse != 0.0 &&
             side * solver->rate_before(row, i) < -kGentleImpact * rest_speed)
      move(row,
           side * (solver->rate(row, i) + solver->rate_before(row, i)) < -kGentleImpact * rest_speed
               ? Motion::kEnd
               : Motion::kImpact);
  }
  for (const std::size_t i : swept_) move(rows[i], Motion::kEnd);
  while (carry_motions(rows, rest_speed, joints_by_mean, *solver)) {
  }
  gains_.assign(motions_.size(), {});
  for (const int body : moved) {
    Gains& gains = gains_[solver->component_of(body)];
    if (motions_[body] == Motion::kMean) gains.mean += solver->gain_by_mean(body);
    if (motions_[body] == Motion::kImpact) gains.impact += solver->gain_by_mean(body);
  }
}

void ConvergedRows::allow_gains(const List<int>& moved, const List<Row>& rows, double rest_speed,
                                bool joints_by_mean, RowSolver* solver) {
  find_gains(moved, rows, rest_speed, joints_by_mean, solver);
  for (const int body : moved) {
    const Gains& gains = gains_[solver->component_of(body)];
    solver->allow_gain(body, -std::min(gains.mean, 0.0) - std::min(gains.impact, 0.0));
  }
}

void ConvergedRows::find_mean_shares(const List<int>& moved, const List<Row>& rows,
                                     double rest_speed, bool joints_by_mean, RowSolver* solver) {
  find_gains(moved, rows, rest_speed, joints_by_mean, solver);
  shares_.assign(motions_.size(), 0.0);
  for (const int body : moved) {
    const int component = solver->component_of(body);
    const Gains& gains = gains_[component];
    const double surplus = solver->gain(component) + gains.mean;
    double of_mean = 1.0, of_impact = 0.0;
    if (surplus > 0.0 && gains.impact < 0.0) of_impact = std::min(1.0, -surplus / gains.impact);
    const double left = surplus + of_impact * gains.impact;
    if (left > 0.0 && gains.mean > 0.0) of_mean = std::max(0.0, 1.0 - left / gains.mean);
    if (motions_[body] == Motion::kMean) shares_[body] = of_mean;
    if (motions_[body] == Motion::kImpact) shares_[body] = of_impact;
  }
}

}  // namespace constraint_sim::engine
