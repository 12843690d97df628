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
  double* v = y + v_at_;
  double* q = y + q_at_;
  double* L = y + L_at_;
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
  const double* v = y + v_at_;
  const double* q = y + q_at_;
  const double* L = y + L_at_;
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
                              const List<PrescribedMotion>& courses, double since_tick) {
  std::fill_n(applied_acceleration_.begin(), bodies_.size(), gravity);
  for (Vector3d& torque : applied_torque_) torque.setZero();
  for (const AppliedWrench& load : loads) {
    const auto found = std::find(bodies_.begin(), bodies_.end(), load.body);
    if (found == bodies_.end()) continue;
    const auto i = static_cast<std::size_t>(found - bodies_.begin());
    applied_acceleration_[i] += inverse_mass_[i] * load.force;
    if (rotates(i)) applied_torque_[i] += load.torque;
  }

  tick_start_ = t - since_tick;
  angles_.set_time(t);
  fixed_points_move_ = false;
  for (FixedPoint& point : fixed_points_) {
    point.start = states[point.body];
    fixed_points_move_ = fixed_points_move_ || !point.start.linear_velocity.isZero(0.0) ||
                         !point.start.angular_velocity.isZero(0.0);
  }
  fixed_scale_ = 0.0;

  knows_energy_ = false;
  has_jumped_ = rates_jump(courses);
  courses_.clear();
  asked_at_ = std::numeric_limits<double>::quiet_NaN();
  std::fill(rate_target_.begin(), rate_target_.end(), 0.0);
  std::fill(acceleration_target_.begin(), acceleration_target_.end(), 0.0);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const PrescribedMotion& course = courses[joints_[l]];
    if (is_changing_[l] == course.is_constant()) {
      has_jumped_ = true;
      has_chosen_ = false;
    }
    is_changing_[l] = !course.is_constant();
    assert(!is_ball(l) || course.is_constant());  // other ball joints are compiled as open
    if (is_changing_[l]) courses_.emplace_back(l, course);
    length_[l] = is_by_offset(l) ? Prescribed{} : course.length(t);
    fixed_scale_ = std::max(fixed_scale_, length_[l].value);
    if (is_general(l)) {
      if (course.moves_frame())
        set_frame(l, course.frame(t, links_[l].anchor_b, links_[l].frame_b));
      else if (frame_b(l).moves)
        set_frame(l, {links_[l].anchor_b, links_[l].frame_b});
      fixed_scale_ = std::max(fixed_scale_, links_[l].radius);
      if (couples(links_[l].kind)) update_prescribed_coupling(l, course, t);
      for (std::size_t k = 0; k < rows_of(l); ++k) {
        double& target = value_target_[first_row(l) + k];
        target = course.target(links_[l].function[k], t).value;
        if (links_[l].function[k] >= info(links_[l].kind).rows)
          fixed_scale_ = std::max(fixed_scale_, std::abs(target) / row_length(first_row(l) + k));
      }
    }
    if (rotates(links_[l].a)) fixed_scale_ = std::max(fixed_scale_, links_[l].anchor_a.norm());
    if (rotates(links_[l].b)) fixed_scale_ = std::max(fixed_scale_, links_[l].anchor_b.norm());
  }
  is_time_dependent_ = !courses_.empty() || fixed_points_move_;
  update_fixed_points(t);
  for (std::size_t p = bodies_.size(); p < position_.size(); ++p)
    fixed_scale_ = std::max(fixed_scale_, position_[p].cwiseAbs().maxCoeff());
}

// Whether a motor demands another rate from t on: the time of its motion is over, or the motor was
// set anew while another motor or a sinusoid continues.
bool EquationsOfMotion::rates_jump(const List<PrescribedMotion>& courses) const {
  for (const auto& [l, before] : courses_)
    if (!courses[joints_[l]].is_driven_as(before)) return true;
  return false;
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
  update_prescribed(t);
  update_kinematics(t, y);
  set_velocities(y);
  find_rates();
  for (const auto& [l, course] : courses_) {
    if (!is_rod(l)) continue;
    const double off = (rate_[l] - rate_target_[l]) / length_[l].value;
    const double speed = std::max(std::abs(length_[l].rate), d_dot(l).norm());
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
      update_prescribed(t);
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
