// Start and end of an interval of EquationsOfMotion: states, loads and the start of the motion.

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

}  // namespace

void EquationsOfMotion::gather_state(const List<BodyState>& states, double* y) const {
  double* v = y + layout().v_at;
  double* q = y + layout().q_at;
  double* L = y + layout().L_at;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const BodyState& state = states[bodies_[i]];
    Vector(y + 3 * i) = state.position;
    Vector(v + 3 * i) = state.linear_velocity;
    if (!rotates(i)) continue;
    Eigen::Map<Eigen::Vector4d>(q + 4 * i) = state.orientation.coeffs();
    Vector(L + 3 * i) = apply_inertia(inertia_[i], state.orientation, state.angular_velocity);
  }
}

void EquationsOfMotion::scatter_state(const double* y, List<BodyState>* states) {
  scale_ = std::max(fixed_scale_, largest_coordinate(y));
  const double* v = y + layout().v_at;
  const double* q = y + layout().q_at;
  const double* L = y + layout().L_at;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    BodyState& state = (*states)[bodies_[i]];
    state.position = ConstVector(y + 3 * i);
    state.linear_velocity = ConstVector(v + 3 * i);
    if (!rotates(i)) continue;
    state.orientation.coeffs() = Eigen::Map<const Eigen::Vector4d>(q + 4 * i);
    state.angular_velocity =
        apply_inertia(inertia_[i].cwiseInverse(), state.orientation, ConstVector(L + 3 * i));
  }
}

void EquationsOfMotion::begin(double t, const List<BodyState>& states, const Vector3d& gravity,
                              const List<AppliedWrench>& loads,
                              const List<PrescribedMotion>& motions, double since_tick) {
  if (inputs_.begin(*this, t, states, gravity, loads, motions, since_tick)) has_chosen_ = false;
  inputs_.place_fixed_points(*this, t, &position_, &velocity_);
  angles_.set_time(t);
  knows_energy_ = false;
  fixed_scale_ = inputs_.scale();
  for (std::size_t p = bodies_.size(); p < position_.size(); ++p)
    fixed_scale_ = std::max(fixed_scale_, position_[p].cwiseAbs().maxCoeff());
}

// Largest coordinate of bodies in y, and of coupled coordinates as last noted [m].
double EquationsOfMotion::largest_coordinate(const double* y) const {
  double largest =
      Eigen::VectorXd::Map(y, static_cast<Eigen::Index>(3 * bodies_.size())).cwiseAbs().maxCoeff();
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms)
      largest = std::max(largest, coupled.metres * std::abs(term.ratio * term.position));
  return largest;
}

bool EquationsOfMotion::rates_are_met(double t, const double* y) {
  inputs_.update(*this, t);
  update_kinematics(t, y);
  set_velocities(y);
  find_rates();
  for (const auto& [l, motion] : inputs_.motions()) {
    if (!is_rod(l)) continue;
    const double off = (rate_[l] - inputs_.rate_target()[l]) / inputs_.length()[l].value;
    const double speed = std::max(std::abs(inputs_.length()[l].rate), d_dot(l).norm());
    if (std::abs(off) > 1e-12 * speed + 16.0 * kEpsilon * scale_) return false;
  }
  return true;
}

bool EquationsOfMotion::start(double t, double* y, double* dydt) {
  scale_ = std::max(fixed_scale_, largest_coordinate(y));
  is_inconsistent_ = false;
  time_ = t;
  substep_ = 0.0;  // nothing has moved since the previous substep
  came_back_ = is_passing();
  if (came_back_ && !knows_energy_) note_energy(t, y);
  if (has_chosen_) return meet(t, y) && restart(y, dydt);
  // Some mechanisms are redundant only where the joints are met.
  const int not_yet = choose_rows(t, y);
  if (!meet(t, y)) return false;
  if (not_yet > 0) {
    choose_rows(t, y);
    if (!meet(t, y)) return false;
  }
  return limit_redundant_rows() && restart(y, dydt);
}

// Projects positions at the start of an interval, where no factors need be near. Redundant rows
// found to be needed get a force again, one or several at a time.
bool EquationsOfMotion::meet(double t, double* y) {
  for (;;) {
    if (!factors_are_there_) {
      inputs_.update(*this, t);
      update_kinematics(t, y);
      factor(kLeastPivotOfProjections);
    }
    const std::size_t redundant = redundant_rows();
    if (fit_positions(t, y)) return true;
    if (redundant_rows() == redundant) return false;
  }
}

void EquationsOfMotion::begin_step(const List<JointState>& states) {
  for (SoftCoordinate& soft : softs_) {
    const auto i = to_index(soft.function - info(links_[soft.link].kind).rows);
    const CoordinateState& state = states[joints_[soft.link]].coordinates[i];
    soft.position = state.position;
    soft.rate = state.velocity;
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.constant = states[joints_[coupled.link]].coupling.constant;
    for (CoupledRow::Term& term : coupled.terms) {
      const CoordinateState& state = states[joints_[term.link]].coordinates[term.coordinate];
      term.position = state.position;
      term.rate = state.velocity;
    }
  }
  angles_.begin([&](std::size_t l) -> const JointState& { return states[to_index(joints_[l])]; });
  std::fill(impulses_.begin(), impulses_.end(), 0.0);
  dependent_rows_ = 0;
  momentary_error_ = 0.0;
}

}  // namespace constraint_sim::engine
