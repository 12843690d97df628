#include "engine/impulses/energy_account.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {
namespace {

// Smallest gain that is no rounding, as a share of ½ Δvᵀ M Δv.
constexpr double kGain = 1e-6;

// Whether a spring only pulls, or has a force limit.
bool is_bounded(const Row& row) { return std::isfinite(row.lower) || std::isfinite(row.upper); }

// Energy of a spring at the value C of its row: the integral of its force k C within the bounds of
// the row, which are impulses in h.
double spring_energy(const Row& row, double C, double h) {
  const double force = std::clamp(row.stiffness * C, -row.upper / h, -row.lower / h);
  return force * (C - 0.5 * force / row.stiffness);
}

// Rate of a bounce without the rate of a motor [m/s]; 0 for a row without a bounce.
double bounce_of(const Row& row) {
  const double rate = row.target - row.drive;
  const bool is_bounce = row.normal_row == -1 && row.stiffness == 0.0 &&
                         ((row.lower == 0.0 && rate > 0.0) || (row.upper == 0.0 && rate < 0.0));
  return is_bounce ? rate : 0.0;
}

}  // namespace

double largest_scale(double quadratic, double linear, double most) {
  const double root = std::sqrt(linear * linear + 4.0 * quadratic * most);
  const double s =
      linear > 0.0 ? 2.0 * most / (linear + root) : (root - linear) / (2.0 * quadratic);
  return std::clamp(s, 0.0, 1.0);
}

void EnergyAccount::begin(const List<int>& moved, const List<Row>& rows, const RowSystem& system) {
  spring_work_ = 0.0;
  any_springs_ = false;
  if (rows.empty()) return;
  entries_.resize(system.velocities().size());
  spring_rates_.resize(rows.size());
  for (const int body : moved) entries_[body] = Entry{};
  for (const RowResponse& r : system.responses()) entries_[r.component] = Entry{};
}

void EnergyAccount::begin_sums(const List<int>& moved) {
  for (const int body : moved) entries_[body].work = entries_[body].absorbed = 0.0;
}

void EnergyAccount::add(const Row& row, std::size_t i, double J_V, const RowSystem& system,
                        double* driven_work) {
  const RowResponse& r = system.response(i);
  const bool is_given = row.lower == row.upper;  // a given force, treated like loads
  const double drive = is_given ? J_V : row.drive;
  const double rate = J_V - drive;
  entries_[r.component].work += row.impulse * rate;
  if (row.stiffness > 0.0) add_spring(row, i, rate, system);
  *driven_work += row.impulse * drive;
  if (!system.is_moved(row.body_a))
    *driven_work -= row.impulse * r.J_A.dot(system.velocities()[row.body_a]);
  if (!system.is_moved(row.body_b))
    *driven_work -= row.impulse * r.J_B.dot(system.velocities()[row.body_b]);
}

void EnergyAccount::add_spring(const Row& row, std::size_t i, double rate,
                               const RowSystem& system) {
  const RowResponse& r = system.response(i);
  const double h = system.h();
  Entry& part = entries_[r.component];
  double stored = row.stiffness * h * rate * (row.C + 0.5 * h * rate);
  if (is_bounded(row))
    stored = spring_energy(row, row.C + h * rate, h) - spring_energy(row, row.C, h);
  part.work += stored;
  spring_rates_[i] = {rate, rate_of(row, r, system.corrections())};
  part.has_springs = any_springs_ = true;
}

void EnergyAccount::finish_sums(const List<int>& moved, RowSystem* system) {
  for (const int body : moved)
    entries_[system->component_of(body)].absorbed +=
        system->kinetic_energy(body, system->change(to_index(body)));
}

bool EnergyAccount::lower_bounces(const List<int>& moved, bool to_zero, const RowSystem& system,
                                  List<Row>* rows) {
  // Lowering all bounces b by a share λ takes λ Σ pᵢ bᵢ²/(bᵢ − uᵢ) of the energy, with u the rates
  // before, to first order where impulses are those of the bounces alone.
  constexpr double kSurplus = 1.25;
  for (const int body : moved) entries_[body].linear = 0.0;
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const Row& row = (*rows)[i];
    const double bounce = bounce_of(row);
    const double share = bounce / (bounce - rate_of(row, system.response(i), system.before()));
    if (share > 0.0) entries_[system.response(i).component].linear += row.impulse * share * bounce;
  }
  bool any = false;
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const Entry& part = entries_[system.response(i).component];
    const double gain = part.work - part.absorbed - part.allowed;
    const double bounce = bounce_of((*rows)[i]);
    if (bounce == 0.0 || gain <= kGain * part.absorbed) continue;
    const bool is_part = !to_zero && kSurplus * gain < part.linear;
    (*rows)[i].target -= is_part ? kSurplus * gain / part.linear * bounce : bounce;
    any = true;
  }
  return any;
}

// Finds the components that would gain energy. Returns whether there are any.
bool EnergyAccount::mark_gains(const List<int>& moved, const RowSystem& system) {
  bool any = false;
  for (const int body : moved) {
    Entry& part = entries_[body];
    part.linear = part.quadratic = part.free = 0.0;
    part.scale = 1.0;
    const double rounding = part.allowed > 0.0 ? kGain * part.absorbed : 0.0;
    part.gains = system.is_component(body) && !part.has_springs &&
                 part.work > part.absorbed + part.allowed + rounding;
    any = any || part.gains;
  }
  return any;
}

// With D = M⁻¹ Jᵀ p and a = Δv − D the gain at a scale s is −½|a|² + s pᵀ(J v₀ − ζ) + ½ s² |D|²,
// which is not positive at s = 0.
bool EnergyAccount::limit(const List<int>& moved, RowSystem* system, List<Row>* rows) {
  if (!mark_gains(moved, *system)) return false;
  List<Twist>& effects = system->effects();
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const Row& row = (*rows)[i];
    const RowResponse& r = system->response(i);
    Entry& part = entries_[r.component];
    if (!part.gains) continue;
    push(row, r, row.impulse, &effects);
    part.linear += row.impulse * (rate_of(row, r, system->before()) - row.drive);
  }
  for (const int body : moved) {
    Entry& part = entries_[system->component_of(body)];
    if (!part.gains) continue;
    part.quadratic += system->kinetic_energy(body, effects[body]);
    part.free += system->kinetic_energy(
        body, system->velocities()[body] - system->before()[body] - effects[body]);
  }
  for (const int body : moved) {
    Entry& part = entries_[body];
    if (!part.gains || part.quadratic <= 0.0) continue;
    part.scale = largest_scale(part.quadratic, part.linear, part.free + part.allowed);
  }
  for (const int body : moved) {
    const Entry& part = entries_[system->component_of(body)];
    if (part.gains) system->velocities()[body] -= (1.0 - part.scale) * effects[body];
    effects[body].setZero();
  }
  for (std::size_t i = 0; i < rows->size(); ++i)
    (*rows)[i].impulse *= entries_[system->response(i).component].scale;
  return true;
}

void EnergyAccount::finish_spring(const Row& row, std::size_t i, double C,
                                  const RowSystem& system) {
  const double h = system.h();
  const double by_v = row.C + h * spring_rates_[i].by_v;
  const double by_all = by_v + h * spring_rates_[i].by_corrections;
  double& work = entries_[system.response(i).component].work;
  if (is_bounded(row)) {
    const double energy = spring_energy(row, by_all, h);
    work += spring_energy(row, C, h) - energy;
    spring_work_ += energy - spring_energy(row, by_v, h);
  } else {
    work += 0.5 * row.stiffness * (C * C - by_all * by_all);
    spring_work_ += 0.5 * row.stiffness * (by_all * by_all - by_v * by_v);
  }
}

}  // namespace constraint_sim::engine
