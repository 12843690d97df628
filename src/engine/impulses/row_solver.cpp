#include "engine/impulses/row_solver.h"

#include <algorithm>
#include <cmath>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Bounds on velocity changes by the removal of self-stress, as a share of the velocities by all
// impulses, and of the velocities that the self-stress would cause unless balanced.
constexpr double kDisturbance = 1e-2, kRoundOff = 1e-9;

// Impulse, so far and in total, that makes J V = target − softness·p.
double wanted_impulse(const Row& row, double impulse, double target, double J_V,
                      double effective_mass) {
  return impulse + (target - row.softness * impulse - J_V) * effective_mass;
}

// Energy of a spring that only pulls, at the value C of its row.
double tension_energy(const Row& row, double C) {
  const double stretch = std::max(C, 0.0);
  return 0.5 * row.stiffness * stretch * stretch;
}

}  // namespace

double RowSolver::correction_target(const Row& row, double J_V) {
  if (row.lower == 0.0) return std::min(row.target + row.correction - J_V, row.correction);
  if (row.upper == 0.0) return std::max(row.target + row.correction - J_V, row.correction);
  return row.correction;
}

void RowSolver::begin(const List<int>& moved, const Bodies& bodies) {
  before_.resize(bodies.size());
  for (const int i : moved)
    before_[i] = twist(bodies[i].linear_velocity, bodies[i].angular_velocity);
}

void RowSolver::update_velocities(const List<int>& moved, const Bodies& bodies,
                                  const Masses& masses, const Vector3d& gravity, double h,
                                  List<Row>& rows) {
  h_ = h;
  prepare_bodies(moved, bodies, masses, rows);
  for (const int i : moved) velocities_[i].head<3>() += h * masses[i].weight_share * gravity;
  if (rows.empty()) return;
  by_loads_.resize(bodies.size());
  for (const int i : moved) by_loads_[i] = velocity_change(to_index(i)).head<3>();
  connect(rows);
  respond(rows);
  warm_start(moved, rows);
}

void RowSolver::prepare_bodies(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                               const List<Row>& rows) {
  velocities_.resize(bodies.size());
  corrections_.resize(bodies.size());
  if (rows.empty()) {
    for (const int i : moved) {
      velocities_[i] = twist(bodies[i].linear_velocity, bodies[i].angular_velocity);
      corrections_[i].setZero();
    }
    any_corrections_ = is_to_finish_ = false;
    return;
  }
  inertias_.resize(bodies.size());
  effects_.resize(bodies.size());
  parents_.resize(bodies.size());
  components_.resize(bodies.size());
  const auto prepare = [&](int index, bool is_moved) {
    const std::size_t i = to_index(index);
    velocities_[i] = twist(bodies[i].linear_velocity, bodies[i].angular_velocity);
    corrections_[i].setZero();
    effects_[i].setZero();
    parents_[i] = index;
    components_[i] = Component{};
    Inertia& inertia = inertias_[i];
    inertia.is_moved = is_moved;
    inertia.inverse_mass = is_moved ? masses[i].inverse_mass : 0.0;
    inertia.can_turn = is_moved && masses[i].can_turn();
    if (!inertia.can_turn) return;
    inertia.R = bodies[i].orientation.toRotationMatrix();
    inertia.principal = masses[i].inertia;
    inertia.inverse_W = inertia.R * masses[i].inverse_inertia.asDiagonal() * inertia.R.transpose();
  };
  for (const Row& row : rows)  // kinematic and static bodies
    for (const int body : {row.body_a, row.body_b})
      if (!masses[body].is_movable()) {
        prepare(body, false);
        before_[body] = velocities_[body];
      }
  for (const int i : moved) prepare(i, true);
}

// Connects bodies to components by their rows.
void RowSolver::connect(const List<Row>& rows) {
  const auto join = [this](int body_a, int body_b) {
    const int a = component_of(body_a);
    const int b = component_of(body_b);
    parents_[std::max(a, b)] = std::min(a, b);
  };
  const auto moved_body = [this](const Row& row) {
    return inertias_[row.body_a].is_moved ? row.body_a : row.body_b;
  };
  for (const Row& row : rows) {
    if (row.normal_row == Row::kCoupledPart) join(moved_body(*(&row - 1)), moved_body(row));
    if (!inertias_[row.body_a].is_moved || !inertias_[row.body_b].is_moved) continue;
    join(row.body_a, row.body_b);
  }
}

int RowSolver::component_of(int body) {
  while (parents_[body] != body) {
    parents_[body] = parents_[parents_[body]];
    body = parents_[body];
  }
  return body;
}

// Computes M⁻¹ Jᵀ and the effective mass of each row, at the positions before the step.
void RowSolver::respond(const List<Row>& rows) {
  responses_.resize(rows.size());
  any_corrections_ = is_to_finish_ = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const Inertia& a = inertias_[row.body_a];
    const Inertia& b = inertias_[row.body_b];
    Response& r = responses_[i];
    r.J_A = twist(row.J.j1, row.J.j2);
    r.J_B = twist(row.J.j3, row.J.j4);
    const auto apply_inverse_mass = [](const Inertia& inertia, const Twist& J) {
      Twist result = Twist::Zero();
      result.head<3>() = inertia.inverse_mass * J.head<3>();
      if (inertia.can_turn) result.tail<3>() = inertia.inverse_W * J.tail<3>();
      return result;
    };
    r.response_a = apply_inverse_mass(a, r.J_A);
    r.response_b = apply_inverse_mass(b, r.J_B);
    r.K = r.J_A.dot(r.response_a) + r.J_B.dot(r.response_b);
    if (row.normal_row == Row::kCoupledPart) join_parts(rows[i - 1], row, &r);
    const double constraint_mass = r.K + row.softness;
    r.effective_mass = constraint_mass > 0.0 ? 1.0 / constraint_mass : 0.0;
    r.component = component_of(a.is_moved ? row.body_a : row.body_b);
    if (!a.is_moved || !b.is_moved) components_[r.component].is_attached = true;
    if (row.correction == 0.0) continue;
    components_[r.component].corrects = any_corrections_ = is_to_finish_ = true;
  }
  for (Response& r : responses_) r.corrects = any_corrections_ && components_[r.component].corrects;
}

// Joins both parts of a coupled row: K = J M⁻¹ Jᵀ of the sum of the parts.
void RowSolver::join_parts(const Row& first, const Row& second, Response* of_second) {
  Response& of_first = *(of_second - 1);
  double across = 0.0;
  if (first.body_a == second.body_a) across += of_first.J_A.dot(of_second->response_a);
  if (first.body_a == second.body_b) across += of_first.J_A.dot(of_second->response_b);
  if (first.body_b == second.body_a) across += of_first.J_B.dot(of_second->response_a);
  if (first.body_b == second.body_b) across += of_first.J_B.dot(of_second->response_b);
  of_first.K = of_second->K += of_first.K + 2.0 * across;
  of_first.effective_mass = of_first.K > 0.0 ? 1.0 / of_first.K : 0.0;
}

[[gnu::always_inline]] inline double RowSolver::velocity_along(const Row& row, const Response& r,
                                                               const List<Twist>& velocities) {
  const Twist* const v = velocities.data();
  return r.J_A.dot(v[row.body_a]) + r.J_B.dot(v[row.body_b]);
}

[[gnu::always_inline]] inline void RowSolver::push(const Row& row, const Response& r,
                                                   double impulse, List<Twist>* velocities) {
  Twist* const v = velocities->data();
  v[row.body_a] += impulse * r.response_a;
  v[row.body_b] += impulse * r.response_b;
}

// Applies the impulses of the previous step as first guess, unless zero is nearer: the sweeps lower
// ½ pᵀ A p + pᵀ (J v − target), which is zero for p = 0. A guess with a positive value is scaled to
// its minimum.
void RowSolver::warm_start(const List<int>& moved, List<Row>& rows) {
  bool any = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].impulse == 0.0) continue;
    push(rows[i], responses_[i], rows[i].impulse, &effects_);
    any = true;
  }
  if (!any) return;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    if (row.impulse == 0.0) continue;
    const Response& r = responses_[i];
    Component& part = components_[r.component];
    part.linear += row.impulse * (velocity_along(row, r, velocities_) - row.target);
    part.quadratic += row.impulse * (velocity_along(row, r, effects_) + row.softness * row.impulse);
  }
  bool any_scaled = false;
  for (const int body : moved) {
    Component& part = components_[body];
    if (parents_[body] != body || part.linear + 0.5 * part.quadratic <= 0.0) continue;
    part.scale = std::max(0.0, -part.linear / part.quadratic);
    any_scaled = true;
  }
  for (const int body : moved) {
    velocities_[body] += components_[component_of(body)].scale * effects_[body];
    effects_[body].setZero();
  }
  if (!any_scaled) return;
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].impulse *= components_[responses_[i].component].scale;
}

// Makes damped Jacobi sweeps on A n = 0. The diagonal is K times the number of rows on a body,
// which bounds A. The sweeps leave the part of n without effect on velocities.
void RowSolver::lose_self_stress(List<Row>& rows, List<LoopRow>* loop_rows, double part,
                                 int sweeps) {
  loop_rows_of_.assign(before_.size(), 0);
  for (const LoopRow& loop : *loop_rows) {
    ++loop_rows_of_[rows[loop.row].body_a];
    ++loop_rows_of_[rows[loop.row].body_b];
  }
  const auto count = [&](int body) { return inertias_[body].is_moved ? loop_rows_of_[body] : 0; };
  List<Component>& parts = components_;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (const LoopRow& loop : *loop_rows) {
      push(rows[loop.row], responses_[loop.row], loop.share, &effects_);
      parts[responses_[loop.row].component].linear = 0.0;
      parts[responses_[loop.row].component].free = 0.0;
    }
    for (LoopRow& loop : *loop_rows) {
      const Row& row = rows[loop.row];
      const Response& r = responses_[loop.row];
      const int most = std::max(count(row.body_a), count(row.body_b));
      const double effect = velocity_along(row, r, effects_);
      parts[r.component].linear += loop.share * effect;
      parts[r.component].free += most * r.K * loop.share * loop.share;
      loop.share -= effect * r.effective_mass / most;
    }
    for (const LoopRow& loop : *loop_rows) {
      effects_[rows[loop.row].body_a].setZero();
      effects_[rows[loop.row].body_b].setZero();
    }
  }
  for (LoopRow& loop : *loop_rows) {
    Row& row = rows[loop.row];
    const Component& known = parts[responses_[loop.row].component];
    const double most = kDisturbance * std::sqrt(std::max(known.quadratic, 0.0)) +
                        kRoundOff * std::sqrt(known.free);
    const double effect = std::sqrt(std::max(known.linear, 0.0));
    const double change = -loop.share * (part * effect > most ? most / effect : part);
    push(row, responses_[loop.row], change, &velocities_);
    row.impulse += change;
    loop.share += change;
  }
}

[[gnu::always_inline]] inline double RowSolver::wanted_correction(const Row& row, const Response& r,
                                                                  double J_V, double J_W) const {
  const double lower = row.lower == 0.0 ? 0.0 : row.lower - row.impulse;
  const double upper = row.upper == 0.0 ? 0.0 : row.upper - row.impulse;
  const double target = correction_target(row, J_V) - row.yielding * r.K * row.correction_impulse;
  const double wanted = wanted_impulse(row, row.correction_impulse, target, J_W, r.effective_mass);
  // not std::clamp: rounding may have taken the impulse of the row beyond a bound, and lower above
  // upper
  return std::min(std::max(wanted, lower), upper);
}

[[gnu::always_inline]] inline void RowSolver::correct(Row& row, const Response& r, double J_V) {
  const double b = wanted_correction(row, r, J_V, velocity_along(row, r, corrections_));
  if (b == row.correction_impulse) return;
  push(row, r, b - row.correction_impulse, &corrections_);
  row.correction_impulse = b;
}

[[gnu::always_inline]] inline void RowSolver::solve_row(Row& row, const Response& r) {
  const double J_V = velocity_along(row, r, velocities_);
  const double p = std::clamp(wanted_impulse(row, row.impulse, row.target, J_V, r.effective_mass),
                              row.lower, row.upper);
  const double change = p - row.impulse;
  if (change != 0.0) push(row, r, change, &velocities_);
  row.impulse = p;
  if (r.corrects) correct(row, r, J_V + change * r.K);
}

RowSolver::Outcome RowSolver::solve(const List<int>& moved, List<Row>& rows, int iterations,
                                    StopFlag stop) {
  Row* const end = rows.data() + rows.size();
  for (int sweep = 0; sweep < iterations && !is_set(stop); ++sweep) {
    const Response* response = responses_.data();
    for (Row* row = rows.data(); row != end; ++row, ++response) {
      if (!solve_next(row, response, rows)) continue;
      ++row;
      ++response;
    }
  }
  return finish_solve(moved, rows);
}

[[gnu::always_inline]] inline bool RowSolver::solve_next(Row* row, const Response* response,
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
      if (solve_next(&rows[which[place]], &responses_[which[place]], rows)) ++place;
}

RowSolver::Outcome RowSolver::finish_solve(const List<int>& moved, List<Row>& rows) {
  Outcome outcome = account(moved, rows);
  if (limit_energy(moved, rows)) outcome = account(moved, rows);
  return outcome;
}

// Share of ½ Δvᵀ M Δv in a gain that is no rounding.
constexpr double kGain = 1e-6;

bool RowSolver::lower_bounces(const List<int>& moved, bool to_zero, List<Row>& rows) {
  // Lowering all bounces b by a share λ takes λ Σ pᵢ bᵢ²/(bᵢ − uᵢ) of the energy, with u the rates
  // before, to first order where impulses are those of the bounces alone.
  constexpr double kSurplus = 1.25;
  account(moved, rows);
  const auto bounce_of = [](const Row& row) {  // [m/s] without the rate of a motor
    const double rate = row.target - row.drive;
    const bool is_bounce = row.normal_row == -1 && row.stiffness == 0.0 &&
                           ((row.lower == 0.0 && rate > 0.0) || (row.upper == 0.0 && rate < 0.0));
    return is_bounce ? rate : 0.0;
  };
  for (const int body : moved) components_[body].linear = 0.0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double bounce = bounce_of(rows[i]);
    const double share = bounce / (bounce - rate_before(rows[i], i));
    if (share > 0.0)
      components_[responses_[i].component].linear += rows[i].impulse * share * bounce;
  }
  bool any = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Component& part = components_[responses_[i].component];
    const double gain = part.work - part.absorbed - part.allowed;
    const double bounce = bounce_of(rows[i]);
    if (bounce == 0.0 || part.has_limited_springs || gain <= kGain * part.absorbed) continue;
    const bool is_part = !to_zero && kSurplus * gain < part.linear;
    rows[i].target -= is_part ? kSurplus * gain / part.linear * bounce : bounce;
    any = true;
  }
  return any;
}

double RowSolver::rate(const Row& row, std::size_t i) const {
  return velocity_along(row, responses_[i], velocities_);
}

double RowSolver::rate_before(const Row& row, std::size_t i) const {
  return velocity_along(row, responses_[i], before_);
}

void RowSolver::set_impulse(std::size_t i, double impulse, List<Row>* rows) {
  const std::size_t end = (*rows)[i].normal_row == Row::kCoupled ? i + 2 : i + 1;
  for (std::size_t k = i; k < end; ++k) {
    Row& row = (*rows)[k];
    if (impulse != row.impulse) push(row, responses_[k], impulse - row.impulse, &velocities_);
    row.impulse = impulse;
  }
}

void RowSolver::set_correction(std::size_t i, double impulse, List<Row>* rows) {
  const std::size_t end = (*rows)[i].normal_row == Row::kCoupled ? i + 2 : i + 1;
  for (std::size_t k = i; k < end; ++k) {
    Row& row = (*rows)[k];
    push(row, responses_[k], impulse - row.correction_impulse, &corrections_);
    row.correction_impulse = impulse;
  }
}

// Solves a row of two parts, which get equal impulses.
void RowSolver::solve_coupled(Row* row, const Response* r) {
  const auto rate = [&](const List<Twist>& velocities) {
    return velocity_along(row[0], r[0], velocities) + velocity_along(row[1], r[1], velocities);
  };
  const auto push_both = [&](double impulse, List<Twist>* velocities) {
    push(row[0], r[0], impulse, velocities);
    push(row[1], r[1], impulse, velocities);
  };
  const double J_V = rate(velocities_);
  const double p =
      std::clamp(wanted_impulse(row[0], row[0].impulse, row[0].target, J_V, r[0].effective_mass),
                 row[0].lower, row[0].upper);
  const double change = p - row[0].impulse;
  push_both(change, &velocities_);
  row[0].impulse = row[1].impulse = p;
  if (!r[0].corrects) return;
  const double b = wanted_correction(row[0], r[0], J_V + change * r[0].K, rate(corrections_));
  push_both(b - row[0].correction_impulse, &corrections_);
  row[0].correction_impulse = row[1].correction_impulse = b;
}

// Solves both tangents with one mass, since otherwise sliding would not be braked straight against
// its direction; then projects the impulse onto Coulomb's disk.
void RowSolver::solve_friction(double normal_impulse, Row* row, const Response* response) {
  const double limit = row->friction * normal_impulse;
  const double mass = std::min(response[0].effective_mass, response[1].effective_mass);
  const double p_1 = wanted_impulse(row[0], row[0].impulse, row[0].target,
                                    velocity_along(row[0], response[0], velocities_), mass);
  const double p_2 = wanted_impulse(row[1], row[1].impulse, row[1].target,
                                    velocity_along(row[1], response[1], velocities_), mass);
  const double length = std::sqrt(p_1 * p_1 + p_2 * p_2);
  const double share = length > limit ? limit / length : 1.0;
  push(row[0], response[0], share * p_1 - row[0].impulse, &velocities_);
  push(row[1], response[1], share * p_2 - row[1].impulse, &velocities_);
  row[0].impulse = share * p_1;
  row[1].impulse = share * p_2;
}

// ---- energy

double largest_scale(double quadratic, double linear, double most) {
  const double root = std::sqrt(linear * linear + 4.0 * quadratic * most);
  const double s =
      linear > 0.0 ? 2.0 * most / (linear + root) : (root - linear) / (2.0 * quadratic);
  return std::clamp(s, 0.0, 1.0);
}

// Kinetic energy ½ vᵀ M v.
double RowSolver::kinetic_energy(int body, const Twist& v) const {
  const Inertia& inertia = inertias_[body];
  double twice = v.head<3>().squaredNorm() / inertia.inverse_mass;
  if (inertia.can_turn) {
    const Vector3d w = inertia.R.transpose() * v.tail<3>();
    twice += w.dot(inertia.principal.cwiseProduct(w));
  }
  return 0.5 * twice;
}

// Computes the largest change by another sweep, and the work of the impulses.
RowSolver::Outcome RowSolver::account(const List<int>& moved, const List<Row>& rows) {
  Outcome outcome;
  for (const int body : moved) components_[body].work = components_[body].absorbed = 0.0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const Response& r = responses_[i];
    const double J_V = velocity_along(row, r, velocities_);
    if (row.normal_row == -1 || row.normal_row == Row::kCoupled) {
      const bool is_coupled = row.normal_row == Row::kCoupled;
      const auto rate_of_all = [&](const List<Twist>& velocities, double of_row) {
        return is_coupled ? of_row + velocity_along(rows[i + 1], responses_[i + 1], velocities)
                          : of_row;
      };
      const double J_all = rate_of_all(velocities_, J_V);
      const double p = wanted_impulse(row, row.impulse, row.target, J_all, r.effective_mass);
      double change = std::abs(std::clamp(p, row.lower, row.upper) - row.impulse);
      if (r.corrects) {
        const double J_W = rate_of_all(corrections_, velocity_along(row, r, corrections_));
        change = std::max(change,
                          std::abs(wanted_correction(row, r, J_all, J_W) - row.correction_impulse));
      }
      outcome.residual = std::max(outcome.residual, change * (r.K + row.softness));
    }
    const bool is_given = row.lower == row.upper;  // a given force, treated like loads
    const double drive = is_given ? J_V : row.drive;
    const double rate = J_V - drive;
    components_[r.component].work += row.impulse * rate;
    if (row.stiffness > 0.0) {
      double stored = row.stiffness * h_ * rate * (row.C + 0.5 * h_ * rate);
      if (row.upper == 0.0)
        stored = tension_energy(row, row.C + h_ * rate) - tension_energy(row, row.C);
      components_[r.component].work += stored;
      responses_[i].rate = rate;
      responses_[i].correction_rate = velocity_along(row, r, corrections_);
      components_[r.component].has_springs = is_to_finish_ = true;
      if (std::isfinite(row.upper) && row.upper != 0.0)
        components_[r.component].has_limited_springs = true;
    }
    outcome.driven_work += row.impulse * drive;
    if (!inertias_[row.body_a].is_moved)
      outcome.driven_work -= row.impulse * r.J_A.dot(velocities_[row.body_a]);
    if (!inertias_[row.body_b].is_moved)
      outcome.driven_work -= row.impulse * r.J_B.dot(velocities_[row.body_b]);
  }
  for (const int body : moved)
    components_[component_of(body)].absorbed +=
        kinetic_energy(body, velocities_[body] - before_[body]);
  return outcome;
}

// Scales the impulses of components that would gain energy. Returns whether there were any. With D
// = M⁻¹ Jᵀ p and a = Δv − D the gain at a scale s is −½|a|² + s pᵀ(J v₀ − ζ) + ½ s² |D|², which is
// not positive at s = 0.
bool RowSolver::limit_energy(const List<int>& moved, List<Row>& rows) {
  bool any = false;
  for (const int body : moved) {
    Component& part = components_[body];
    part.linear = part.quadratic = part.free = 0.0;
    part.scale = 1.0;
    const double rounding = part.allowed > 0.0 ? kGain * part.absorbed : 0.0;
    part.gains = parents_[body] == body && !part.has_springs &&
                 part.work > part.absorbed + part.allowed + rounding;
    any = any || part.gains;
  }
  if (!any) return false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    Component& part = components_[responses_[i].component];
    if (!part.gains) continue;
    push(row, responses_[i], row.impulse, &effects_);
    part.linear += row.impulse * (velocity_along(row, responses_[i], before_) - row.drive);
  }
  for (const int body : moved) {
    Component& part = components_[component_of(body)];
    if (!part.gains) continue;
    part.quadratic += kinetic_energy(body, effects_[body]);
    part.free += kinetic_energy(body, velocities_[body] - before_[body] - effects_[body]);
  }
  for (const int body : moved) {
    Component& part = components_[body];
    if (!part.gains || part.quadratic <= 0.0) continue;
    part.scale = largest_scale(part.quadratic, part.linear, part.free + part.allowed);
  }
  for (const int body : moved) {
    const Component& part = components_[component_of(body)];
    if (part.gains) velocities_[body] -= (1.0 - part.scale) * effects_[body];
    effects_[body].setZero();
  }
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].impulse *= components_[responses_[i].component].scale;
  return true;
}

}  // namespace constraint_sim::engine
