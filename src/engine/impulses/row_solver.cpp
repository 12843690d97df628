#include "engine/impulses/row_solver.h"

#include <algorithm>
#include <cmath>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Bounds on velocity changes by the removal of self-stress, as a share of the velocities by all
// impulses, and of the velocities that the self-stress would cause unless balanced.
constexpr double kDisturbance = 1e-2, kUnbalanced = 1e-9;

// Impulse of the correction of a row whose rates are J_V by velocities and J_W by corrections.
[[gnu::always_inline]] inline double wanted_correction(const Row& row, const RowResponse& r,
                                                       double J_V, double J_W) {
  const double lower = row.lower == 0.0 ? 0.0 : row.lower - row.impulse;
  const double upper = row.upper == 0.0 ? 0.0 : row.upper - row.impulse;
  const double target =
      RowSolver::correction_target(row, J_V) - row.yielding * r.K * row.correction_impulse;
  const double wanted = wanted_impulse(row, row.correction_impulse, target, J_W, r.effective_mass);
  // not std::clamp: rounding may have taken the impulse of the row beyond a bound, and lower above
  // upper
  return std::min(std::max(wanted, lower), upper);
}

}  // namespace

double RowSolver::correction_target(const Row& row, double J_V) {
  if (row.lower == 0.0) return std::min(row.target + row.correction - J_V, row.correction);
  if (row.upper == 0.0) return std::max(row.target + row.correction - J_V, row.correction);
  return row.correction;
}

void RowSolver::update_velocities(const List<int>& moved, const Bodies& bodies,
                                  const Masses& masses, const Vector3d& gravity, double h,
                                  List<Row>& rows) {
  system_.load(moved, bodies, masses, gravity, h, rows);
  energy_.begin(moved, rows, system_);
  if (rows.empty()) return;
  guesses_.resize(bodies.size());
  for (const int body : moved) guesses_[body] = Guess{};
  for (const RowResponse& r : system_.responses()) guesses_[r.component] = Guess{};
  warm_start(moved, rows);
}

// Applies the impulses of the previous step as first guess, unless zero is nearer: the sweeps lower
// ½ pᵀ A p + pᵀ (J v − target), which is zero for p = 0. A guess with a positive value is scaled to
// its minimum.
void RowSolver::warm_start(const List<int>& moved, List<Row>& rows) {
  bool any = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].impulse == 0.0) continue;
    push(rows[i], system_.response(i), rows[i].impulse, &system_.effects());
    any = true;
  }
  if (!any) return;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    if (row.impulse == 0.0) continue;
    const RowResponse& r = system_.response(i);
    Guess& part = guesses_[r.component];
    part.linear += row.impulse * (rate_of(row, r, system_.velocities()) - row.target);
    part.quadratic +=
        row.impulse * (rate_of(row, r, system_.effects()) + row.softness * row.impulse);
  }
  bool any_scaled = false;
  for (const int body : moved) {
    Guess& part = guesses_[body];
    if (!system_.is_component(body) || part.linear + 0.5 * part.quadratic <= 0.0) continue;
    part.scale = std::max(0.0, -part.linear / part.quadratic);
    any_scaled = true;
  }
  for (const int body : moved) {
    system_.velocities()[body] +=
        guesses_[system_.component_of(body)].scale * system_.effects()[body];
    system_.effects()[body].setZero();
  }
  if (!any_scaled) return;
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].impulse *= guesses_[system_.response(i).component].scale;
}

// Makes damped Jacobi sweeps on A n = 0. The diagonal is K times the number of rows on a body,
// which bounds A. The sweeps leave the part of n without effect on velocities.
void RowSolver::lose_self_stress(List<Row>& rows, List<LoopRow>* loop_rows, double part,
                                 int sweeps) {
  loop_rows_of_.assign(system_.before().size(), 0);
  for (const LoopRow& loop : *loop_rows) {
    ++loop_rows_of_[rows[loop.row].body_a];
    ++loop_rows_of_[rows[loop.row].body_b];
  }
  const auto count = [&](int body) { return system_.is_moved(body) ? loop_rows_of_[body] : 0; };
  List<Guess>& parts = guesses_;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (const LoopRow& loop : *loop_rows) {
      push(rows[loop.row], system_.response(loop.row), loop.share, &system_.effects());
      parts[system_.response(loop.row).component].linear = 0.0;
      parts[system_.response(loop.row).component].free = 0.0;
    }
    for (LoopRow& loop : *loop_rows) {
      const Row& row = rows[loop.row];
      const RowResponse& r = system_.response(loop.row);
      const int most = std::max(count(row.body_a), count(row.body_b));
      const double effect = rate_of(row, r, system_.effects());
      parts[r.component].linear += loop.share * effect;
      parts[r.component].free += most * r.K * loop.share * loop.share;
      loop.share -= effect * r.effective_mass / most;
    }
    for (const LoopRow& loop : *loop_rows) {
      system_.effects()[rows[loop.row].body_a].setZero();
      system_.effects()[rows[loop.row].body_b].setZero();
    }
  }
  for (LoopRow& loop : *loop_rows) {
    Row& row = rows[loop.row];
    const Guess& known = parts[system_.response(loop.row).component];
    const double most = kDisturbance * std::sqrt(std::max(known.quadratic, 0.0)) +
                        kUnbalanced * std::sqrt(known.free);
    const double effect = std::sqrt(std::max(known.linear, 0.0));
    const double change = -loop.share * (part * effect > most ? most / effect : part);
    push(row, system_.response(loop.row), change, &system_.velocities());
    row.impulse += change;
    loop.share += change;
  }
}

[[gnu::always_inline]] inline void RowSolver::correct(Row& row, const RowResponse& r, double J_V) {
  const double b = wanted_correction(row, r, J_V, rate_of(row, r, system_.corrections()));
  if (b == row.correction_impulse) return;
  push(row, r, b - row.correction_impulse, &system_.corrections());
  row.correction_impulse = b;
}

[[gnu::always_inline]] inline void RowSolver::solve_row(Row& row, const RowResponse& r) {
  const double J_V = rate_of(row, r, system_.velocities());
  const double p = std::clamp(wanted_impulse(row, row.impulse, row.target, J_V, r.effective_mass),
                              row.lower, row.upper);
  const double change = p - row.impulse;
  if (change != 0.0) push(row, r, change, &system_.velocities());
  row.impulse = p;
  if (r.corrects) correct(row, r, J_V + change * r.K);
}

RowSolver::Outcome RowSolver::solve(const List<int>& moved, List<Row>& rows, int iterations,
                                    StopFlag stop) {
  Row* const end = rows.data() + rows.size();
  for (int sweep = 0; sweep < iterations && !is_set(stop); ++sweep) {
    const RowResponse* response = system_.responses().data();
    for (Row* row = rows.data(); row != end; ++row, ++response) {
      if (!solve_next(row, response, rows)) continue;
      ++row;
      ++response;
    }
  }
  return finish_solve(moved, rows);
}

[[gnu::always_inline]] inline bool RowSolver::solve_next(Row* row, const RowResponse* response,
                                                         List<Row>& rows) {
  if (row->normal_row == -1) {
    solve_row(*row, *response);
    return false;
  }
  if (row->normal_row == Row::kCoupled)
    solve_coupled(row, response);
  else
    solve_friction(rows[row->normal_row].impulse, row, response);
  return true;
}

void RowSolver::sweep(const List<std::size_t>& which, int iterations, StopFlag stop,
                      List<Row>& rows) {
  for (int k = 0; k < iterations && !is_set(stop); ++k)
    for (std::size_t place = 0; place < which.size(); ++place)
      if (solve_next(&rows[which[place]], &system_.response(which[place]), rows)) ++place;
}

RowSolver::Outcome RowSolver::finish_solve(const List<int>& moved, List<Row>& rows) {
  Outcome outcome = measure(moved, rows);
  if (energy_.limit(moved, &system_, &rows)) outcome = measure(moved, rows);
  return outcome;
}

bool RowSolver::lower_bounces(const List<int>& moved, bool to_zero, List<Row>& rows) {
  measure(moved, rows);
  return energy_.lower_bounces(moved, to_zero, system_, &rows);
}

void RowSolver::set_impulse(std::size_t i, double impulse, List<Row>* rows) {
  const std::size_t end = (*rows)[i].normal_row == Row::kCoupled ? i + 2 : i + 1;
  for (std::size_t k = i; k < end; ++k) {
    Row& row = (*rows)[k];
    if (impulse != row.impulse)
      push(row, system_.response(k), impulse - row.impulse, &system_.velocities());
    row.impulse = impulse;
  }
}

void RowSolver::set_correction(std::size_t i, double impulse, List<Row>* rows) {
  const std::size_t end = (*rows)[i].normal_row == Row::kCoupled ? i + 2 : i + 1;
  for (std::size_t k = i; k < end; ++k) {
    Row& row = (*rows)[k];
    push(row, system_.response(k), impulse - row.correction_impulse, &system_.corrections());
    row.correction_impulse = impulse;
  }
}

// Solves a row of two parts, which get equal impulses.
void RowSolver::solve_coupled(Row* row, const RowResponse* r) {
  const auto rate = [&](const List<Twist>& velocities) {
    return rate_of(row[0], r[0], velocities) + rate_of(row[1], r[1], velocities);
  };
  const auto push_both = [&](double impulse, List<Twist>* velocities) {
    push(row[0], r[0], impulse, velocities);
    push(row[1], r[1], impulse, velocities);
  };
  const double J_V = rate(system_.velocities());
  const double p =
      std::clamp(wanted_impulse(row[0], row[0].impulse, row[0].target, J_V, r[0].effective_mass),
                 row[0].lower, row[0].upper);
  const double change = p - row[0].impulse;
  push_both(change, &system_.velocities());
  row[0].impulse = row[1].impulse = p;
  if (!r[0].corrects) return;
  const double b =
      wanted_correction(row[0], r[0], J_V + change * r[0].K, rate(system_.corrections()));
  push_both(b - row[0].correction_impulse, &system_.corrections());
  row[0].correction_impulse = row[1].correction_impulse = b;
}

// Solves both tangents with one mass, since otherwise sliding would not be braked straight against
// its direction; then projects the impulse onto Coulomb's disk.
void RowSolver::solve_friction(double normal_impulse, Row* row, const RowResponse* response) {
  const double limit = row->friction * normal_impulse;
  const double mass = std::min(response[0].effective_mass, response[1].effective_mass);
  const double p_1 = wanted_impulse(row[0], row[0].impulse, row[0].target,
                                    rate_of(row[0], response[0], system_.velocities()), mass);
  const double p_2 = wanted_impulse(row[1], row[1].impulse, row[1].target,
                                    rate_of(row[1], response[1], system_.velocities()), mass);
  const double length = std::sqrt(p_1 * p_1 + p_2 * p_2);
  const double share = length > limit ? limit / length : 1.0;
  push(row[0], response[0], share * p_1 - row[0].impulse, &system_.velocities());
  push(row[1], response[1], share * p_2 - row[1].impulse, &system_.velocities());
  row[0].impulse = share * p_1;
  row[1].impulse = share * p_2;
}

// Change of the impulse of row i by another sweep; parts of a coupled row are changed together.
double RowSolver::change_by_sweep(const List<Row>& rows, std::size_t i, double J_V) const {
  const Row& row = rows[i];
  const RowResponse& r = system_.response(i);
  const bool is_coupled = row.normal_row == Row::kCoupled;
  const auto rate_of_all = [&](const List<Twist>& velocities, double of_row) {
    return is_coupled ? of_row + rate_of(rows[i + 1], system_.response(i + 1), velocities) : of_row;
  };
  const double J_all = rate_of_all(system_.velocities(), J_V);
  const double p = wanted_impulse(row, row.impulse, row.target, J_all, r.effective_mass);
  const double change = std::abs(std::clamp(p, row.lower, row.upper) - row.impulse);
  if (!r.corrects) return change;
  const List<Twist>& corrections = system_.corrections();
  const double J_W = rate_of_all(corrections, rate_of(row, r, corrections));
  return std::max(change, std::abs(wanted_correction(row, r, J_all, J_W) - row.correction_impulse));
}

// Measures the largest change by another sweep, and the energy.
RowSolver::Outcome RowSolver::measure(const List<int>& moved, const List<Row>& rows) {
  Outcome outcome;
  energy_.begin_sums(moved);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const RowResponse& r = system_.response(i);
    const double J_V = rate_of(row, r, system_.velocities());
    if (row.normal_row == -1 || row.normal_row == Row::kCoupled)
      outcome.residual =
          std::max(outcome.residual, change_by_sweep(rows, i, J_V) * (r.K + row.softness));
    energy_.add(row, i, J_V, system_, &outcome.driven_work);
  }
  energy_.finish_sums(moved, &system_);
  return outcome;
}

}  // namespace constraint_sim::engine
