// Projections of positions and velocities of EquationsOfMotion onto the joints.

#include <algorithm>
#include <cmath>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/larger.h"
#include "engine/math/numbers.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Vector = Eigen::Map<Vector3d>;

// Velocities near a pose with left-out rows are off by up to the square root of the rows' pivot.
constexpr double kLeftOutRatesAgree = 1e-4;  // share of the largest speed
constexpr int kMostProjectionSteps = 8;
// Share of the scene's size; a larger error is no solution.
constexpr double kProjectionFailed = 1e-10;

}  // namespace

// Computes C of all rows. Returns the largest error of a row that is not redundant [m].
double EquationsOfMotion::find_values() {
  double worst = 0.0;
  worst_redundant_ = 0.0;
  const auto consider = [&](std::size_t row, double error) {
    if (is_redundant_[row])
      worst_redundant_ = std::max(worst_redundant_, error / redundant_off_[row]);
    else
      worst = larger(worst, error);
  };
  for (std::size_t l = 0; l < first_.ball; ++l) {
    const double length = inputs_.length()[l].value;
    value_[l] = 0.5 * (direction_[l].squaredNorm() - length * length);
    consider(l, std::abs(value_[l] / length));
  }
  for (std::size_t l = first_.ball; l < first_.general; ++l)
    Vector(value_.data() + first_row(l)) = d_[l];
  for (const GeneralRow& row : general_rows_) value_[row.row] = value_of(row);
  const std::size_t first_general = first_general_row();
  for (std::size_t i = first_.ball; i < first_general; ++i) consider(i, std::abs(value_[i]));
  for (const CoupledRow& coupled : coupled_) {
    value_[coupled.row] = value_of(coupled);
    consider(coupled.row, coupled.metres * std::abs(value_[coupled.row]));
  }
  for (const GeneralRow& row : general_rows_)
    consider(row.row, row.metres * std::abs(value_[row.row]));
  return worst;
}

// Computes Ċ of all rows.
void EquationsOfMotion::find_rates() {
  for (std::size_t l = 0; l < first_.ball; ++l) rate_[l] = direction_[l].dot(d_dot(l));
  for (std::size_t l = first_.ball; l < first_.general; ++l)
    Vector(rate_.data() + first_row(l)) = d_dot(l);
  for (const GeneralRow& row : general_rows_)
    rate_[row.row] =
        rate(row.form, vectors_[row.link - first_.general], motions_[row.link - first_.general]);
  for (const CoupledRow& coupled : coupled_) {
    rate_[coupled.row] = 0.0;
    for (const CoupledRow::Term& term : coupled.terms)
      rate_[coupled.row] += term.ratio * rate_of(term.link, term.form);
  }
}

// Largest speed of a point that a joint holds [m/s].
double EquationsOfMotion::largest_speed() const {
  double speed = 0.0;
  for (const Vector3d& velocity : velocity_) speed = std::max(speed, velocity.norm());
  for (std::size_t l = 0; l < links_.size(); ++l) {
    if (rotates(links_[l].a))
      speed = std::max(speed, angular_velocity_[links_[l].a].norm() * arm_a_[l].norm());
    if (rotates(links_[l].b))
      speed = std::max(speed, angular_velocity_[links_[l].b].norm() * arm_b_[l].norm());
  }
  return speed;
}

// Whether the velocities meet the rates that prescribed motions demand; rows may contradict each
// other.
bool EquationsOfMotion::prescribed_rates_are_met() {
  find_rates();
  if (!inputs_.is_time_dependent()) return true;
  const double most = kLeftOutRatesAgree * largest_speed();
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (!is_redundant_[i] && std::abs(rate_[i] - inputs_.rate_target()[i]) > most * inputs_.row_length(*this, i))
      return false;
  return true;
}

bool EquationsOfMotion::project(double t, double* y) {
  // An energy noted while no row was left out at the last restart() belongs to a rejected step.
  const bool is_known = knows_energy_ && left_out_for_ > 0;
  if (came_back_ && !is_known) note_energy(t, y);
  return fit_positions(t, y);
}

// Makes Newton steps with the factors of the last stage, and with new factors where those do not
// converge. Leaves kinematics evaluated at y.
bool EquationsOfMotion::fit_positions(double t, double* y) {
  const std::size_t bodies = bodies_.size();
  double* const q = y + layout().q_at;
  time_ = t;
  inputs_.update(*this, t);
  double before = kInfinity;
  double rounding = 0.0;
  bool factors_are_near = true;
  for (int i = 0;; ++i) {
    for (std::size_t k = 0; k < rotating_; ++k) Eigen::Map<Eigen::Vector4d>(q + 4 * k).normalize();
    update_kinematics(t, y);
    const double error = find_values();
    if (i == 0) rounding = kEpsilon * std::max(scale_, error);  // scale_ is 0 for a single point
    if (error <= rounding) return !restore_redundant_if_off();
    if (!(error <= 0.5 * before)) {
      if (error <= 16.0 * rounding) return !restore_redundant_if_off();
      if (!factors_are_near || !std::isfinite(error))
        return error <= kProjectionFailed * scale_ && !restore_redundant_if_off();
      factors_are_near = false;
      factor(kLeastPivotOfProjections);
    }
    if (i == kMostProjectionSteps)
      return error <= kProjectionFailed * scale_ && !restore_redundant_if_off();
    before = error;

    for (std::size_t r = 0; r < rows_.size(); ++r) solution_[rows_[r].unknown] = -value_[r];
    solve(solution_.data());
    apply_jacobian_transpose(solution_.data());
    for (std::size_t k = 0; k < bodies; ++k)
      Vector(y + 3 * k) += inverse_mass_[k] * constraint_force_[k];
    for (std::size_t k = 0; k < rotating_; ++k) {
      double rate[4];
      write_quaternion_rate(inverse_inertia_[k] * constraint_torque_[k], q + 4 * k, rate);
      for (std::size_t e = 0; e < 4; ++e) q[4 * k + e] += rate[e];
    }
  }
}

// Projects velocities after project(), and evaluates the derivative of the first stage with the
// same factors.
bool EquationsOfMotion::restart(double* y, double* dydt) {
  const std::size_t bodies = bodies_.size();
  ldlt_.keep_none();
  factor(kLeastPivotOfProjections);
  set_velocities(y);
  if (!rows_.empty()) {
    const double projected = projected_energy_;
    find_rates();
    for (std::size_t i = 0; i < rows_.size(); ++i)
      solution_[rows_[i].unknown] = inputs_.rate_target()[i] - rate_[i];
    solve(solution_.data());
    apply_jacobian_transpose(solution_.data());
    double* const v = y + layout().v_at;
    double* const L = y + layout().L_at;
    for (std::size_t k = 0; k < bodies; ++k)
      Vector(v + 3 * k) += inverse_mass_[k] * constraint_force_[k];
    for (std::size_t k = 0; k < rotating_; ++k) Vector(L + 3 * k) += constraint_torque_[k];
    for (std::size_t i = 0; i < rows_.size(); ++i)
      projected_energy_ += 0.5 * solution_[rows_[i].unknown] * (inputs_.rate_target()[i] - rate_[i]);
    multipliers_to_forces(solution_.data());
    for (std::size_t i = 0; i < rows_.size(); ++i) impulses_[i] += solution_[i];
    set_velocities(y);
    if (redundant_rows() > 0) {
      // Near dependence the kept rows determine redundant rows only to rounding over small pivots.
      if (choose_again(time_, y)) return meet(time_, y) && restart(y, dydt);
      if (!redundant_rates_are_met()) return !is_inconsistent_ && restart(y, dydt);
    }
    if (left_out_ > 0 && !prescribed_rates_are_met()) {
      is_inconsistent_ = true;
      return false;
    }
    note_left_out();
    came_back_ = false;
    if (knows_energy_ && keep_energy(y)) projected_energy_ = projected;
    knows_energy_ = false;
    if (left_out_ > 0) note_energy(time_, y);
  }
  if (left_out_ > 0) factor(kLeastPivotOfForces);
  if (!softs_.empty() || !coupled_.empty() || !angles_.empty()) note_positions();
  accelerate(0, y, dydt);
  return true;
}

}  // namespace constraint_sim::engine
