#include "engine/methods/event_driven/joints/event_motions.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/constraints/joint_kinds.h"
#include "engine/math/box_lcp.h"
#include "engine/methods/event_driven/joints/event_decision.h"
#include "engine/methods/event_driven/joints/event_problem.h"
#include "engine/methods/event_driven/joints/event_reading.h"
#include "engine/methods/event_driven/law_events.h"
#include "engine/methods/event_driven/position_motor.h"

namespace constraint_sim::engine {
namespace {

// Shortest prescribed motion [s]; an event may be at the end of an interval.
constexpr double kShortest = 1e-12;
constexpr double kKeepsTravel = 1e-6;  // [m] a motor holds a length that is off by less

/// Ends the motion of a coordinate to a position. `beyond`: error left of the limit that holds it.
void end_motion(const OneSidedLaw& law, ErrorsToClose* errors, double beyond = 0.0) {
  MovingStart& moving = errors->moving[to_index(law.coordinate)];
  errors->offset[law.function] = beyond;
  moving = {moving.since, beyond != 0.0 ? moving.duration : 0.0, beyond, 0.0, 0.0};
}

bool is_limit(Hold hold) { return hold == Hold::kUpper || hold == Hold::kLower; }

}  // namespace

EventMotions::EventMotions(EventJoints joints)
    : joints_(std::move(joints)),
      states_(laws().size()),
      held_(laws().size(), 0.0),
      braking_(laws().size()),
      is_broken_(joints_.size(), 0),
      joint_states_(joints_.size()),
      prescribed_(joints_.size()),
      bare_prescribed_(joints_.size()),
      base_(joints_.size(), 0.0),
      is_at_end_(joints_.size(), 0) {
  for (std::size_t l = 0; l < joints_.size(); ++l)
    joints_.with_rows(l, states_, &bare_joints_.emplace_back());
  switched_joints_ = bare_joints_;
}

// ---- start of a step or an interval

void EventMotions::begin_step(const List<JointData>& world) {
  for (std::size_t l = 0; l < joints_.size(); ++l) joint_states_[l] = world[joints_.members()[l]];
  for (std::size_t c = 0; c < laws().size(); ++c)
    braking_[c].most = joint_states_[laws()[c].joint].coordinates[laws()[c].coordinate].braking;
}

bool EventMotions::mend_rejected() {
  if (has_started_ || std::find(is_broken_.begin(), is_broken_.end(), 1) == is_broken_.end())
    return false;
  is_broken_.assign(joints_.size(), 0);
  return true;
}

bool EventMotions::begin_interval(const List<JointData>& world, const JointStep& step, double t,
                                  double end) {
  step_ = step;
  start_ = t;
  end_ = end;
  if (!has_started_) states_.assign(laws().size(), {});
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    JointData& state = joint_states_[l];
    const auto coordinates_before = state.coordinates;
    state = world[joints_.members()[l]];
    for (std::size_t i = 0; i < kMaxCoordinates; ++i)
      state.coordinates[i].position = coordinates_before[i].position;
    if (!has_started_) continue;
    const auto [first, last] = joints_.laws_of(l);
    for (std::size_t c = first; c < last; ++c)
      if (laws()[c].is_distance && (laws()[c].drive > 0.0 || std::isfinite(laws()[c].limit_force)))
        state.travel = held_[c];
  }
  bool goes_on = true;
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    const PrescribedMotion before = prescribed_[l];
    if (!has_started_) set_rows(l);
    begin_prescribed(l, t);
    goes_on = goes_on && prescribed_[l].is_driven_as(before) &&
              prescribed_[l].is_closing() == before.is_closing();
    JointData joint_state = joint_states_[l];
    bare_prescribed_[l].begin(bare_joints_[l], step, joint_state);
    is_at_end_[l] = has_length(joints_[l].kind) && joint_state.saturated ? 1 : 0;
  }
  return goes_on;
}

// Sets the rows of a joint to the current states, for its prescribed motion.
void EventMotions::set_rows(std::size_t l) {
  Joint& joint = switched_joints_[l];
  if (is_broken(l))
    joint = joints_[l];
  else
    joints_.with_rows(l, states_, &joint);
  const auto [first, last] = joints_.laws_of(l);
  if (first < last && laws()[first].is_distance) {
    const OneSidedLaw& law = laws()[first];
    const Hold hold = states_[first].hold;
    joint = joints_[l];  // the motor also moves a limit that is not reached
    joint.motor.max_force = 0.0;
    if (joint.distance.is_limited() && !joint.distance.is_soft())
      joint.distance.length = law.limit(hold != Hold::kLower && std::isfinite(law.upper));
    else if (is_limit(hold))
      joint.distance.length = law.limit(hold == Hold::kUpper);
  }
  base_[l] = joint.distance.length.value_or(0.0);
}

// Starts the prescribed motion of a joint at t.
void EventMotions::begin_prescribed(std::size_t l, double t) {
  JointData joint_state = joint_states_[l];
  const auto [first, last] = joints_.laws_of(l);
  for (std::size_t c = first; c < last; ++c) {
    const OneSidedLaw& law = laws()[c];
    if (law.is_rope()) continue;
    CoordinateState& coordinate = joint_state.coordinates[law.coordinate];
    const Hold hold = states_[c].hold;
    if (is_limit(hold)) {
      const double beyond = law.beyond_at_start(joint_state.to_close);
      const bool is_open = (hold == Hold::kUpper) == (beyond > 0.0);
      coordinate.held = law.limit(hold == Hold::kUpper);
      end_motion(law, &joint_state.to_close, is_open ? beyond : 0.0);
    } else if (hold == Hold::kBrake) {
      end_motion(law, &joint_state.to_close);
    } else if (hold != Hold::kNone && !(law.goal && hold == Hold::kDrive)) {
      coordinate.held = held_[c];
      end_motion(law, &joint_state.to_close);
    }
  }
  JointStep step = step_;
  step.t = t;
  step.h = std::max(end_ - t, kShortest);
  prescribed_[l].begin(switched_joints_[l], step, joint_state);
  for (std::size_t c = first; c < last; ++c)
    if (states_[c].hold == Hold::kBrake && laws()[c].goal)
      prescribed_[l].brake(laws()[c].coordinate, held_[c], braking_[c].along);
}

// ---- demands

MovingFrame EventMotions::frame(std::size_t l, double t) const {
  if (!prescribed_[l].moves_frame()) return {};
  return prescribed_[l].frame(t, joints_[l].anchor_b, joints_[l].frame_b->toRotationMatrix());
}

Prescribed EventMotions::limit(std::size_t c, bool upper_one, double t) const {
  const OneSidedLaw& law = laws()[c];
  const PrescribedMotion& motion = prescribed_[law.joint];
  const JointData& state = joint_states_[law.joint];
  if (law.is_coupling) {
    Prescribed at_limit = motion.closing(t).coupling();
    at_limit.value += state.coupling.constant;
    return at_limit;
  }
  const double offset = motion.is_closing() ? law.beyond_at_start(state.to_close) : 0.0;
  const bool is_open = (upper_one ? offset > 0.0 : offset < 0.0);
  const Prescribed error =
      offset != 0.0 ? error_of_limit(law, offset, motion.closing(state.to_close, t)) : Prescribed{};
  Prescribed at_limit;
  if (law.is_distance) {
    at_limit = motion.length(t);
    at_limit.value -= base_[law.joint];
    if (offset != 0.0 && !is_open) {
      at_limit.value -= error.value;
      at_limit.rate -= error.rate;
      at_limit.acceleration -= error.acceleration;
    }
  } else if (is_open) {
    at_limit = error;
  }
  at_limit.value += law.limit(upper_one);
  return at_limit;
}

double EventMotions::travel(std::size_t joint, double t) const {
  const PrescribedMotion& motion = prescribed_[joint];
  const Prescribed error = motion.closing(joint_states_[joint].to_close, t).of(0);
  return motion.length(t).value - error.value - base_[joint];
}

Prescribed EventMotions::rest(std::size_t c, double t) const {
  const OneSidedLaw& law = laws()[c];
  return rest_of(law, law.is_distance ? prescribed_[law.joint].length(t) : Prescribed{});
}

// Prescribed motion of a motor with a goal, for decisions.
Prescribed EventMotions::motion_to_goal(std::size_t c, double t) const {
  const OneSidedLaw& law = laws()[c];
  const ErrorsToClose& errors = joint_states_[law.joint].to_close;
  Prescribed motion = about_to_start(
      [&](double at) { return prescribed_[law.joint].closing(errors, at).of(law.function); }, t,
      StartAhead(end_ - start_, step_.closing_time));
  motion.value += *law.goal;
  return motion;
}

Prescribed EventMotions::zeta(std::size_t c, double t, double q) const {
  const OneSidedLaw& law = laws()[c];
  if (law.is_distance) return prescribed_[law.joint].length(t);
  if (law.drive == 0.0) return {};
  if (law.goal && braking_[c].most == 0.0) return motion_to_goal(c, t);
  if (law.goal && states_[c].hold == Hold::kBrake)
    return rate_until(*law.goal, braking_[c].along, held_[c] - t);
  if (law.goal) return rate_to_goal(*law.goal, braking_[c].most, q);
  const MotorRate motor =
      motor_rate(*joints_[law.joint].coordinates[law.coordinate].motor,
                 joint_states_[law.joint].coordinates[law.coordinate].expires_at, start_);
  return motor_motion(motor, motor_phase(motor, t), 0.0);
}

bool EventMotions::is_saturated(std::size_t c, const OneSidedState& state, double t,
                                double q) const {
  return is_at_end_[laws()[c].joint] ||
         is_at_force_limit(
             laws()[c], state, [&](bool upper_one) { return limit(c, upper_one, t); },
             [&] { return zeta(c, t, q); });
}

// ---- changes

void EventMotions::note_positions(const EventBodies& bodies, double t,
                                  const EquationsOfMotion& equations) {
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    const JointForms& kind = forms(joints_[l].kind);
    if (kind.coordinates == 0) continue;
    const auto& ends = joints_.ends(l);
    const JointVectors vectors(joints_[l], bodies.at(ends.first, t), bodies.at(ends.second, t),
                               frame(l, t));
    for (int i = 0; i < kind.coordinates; ++i) {
      double& position = joint_states_[l].coordinates[to_index(i)].position;
      const ScalarForm& form = kind.coordinate[to_index(i)];
      position = reading(form, value(form, vectors), joints_[l].coordinates[to_index(i)].zero,
                         counted_position(equations, l, i, position));
    }
  }
}

void EventMotions::find_lost(const EventProblem& problem, double t) {
  for (std::size_t c = 0; c < laws().size(); ++c) {
    if (!laws()[c].goal || !problem.is_free(c)) continue;
    judge_motion(
        problem.reading(c), motion_to_goal(c, t), *laws()[c].goal,
        [&] { return braking_of(problem, c); },
        [&] { end_motion(laws()[c], &joint_states_[laws()[c].joint].to_close); },
        &braking_[c].most);
  }
}

bool EventMotions::note_lost(const EventProblem& problem, const EventDecision& next) {
  bool any = false;
  for (std::size_t c = 0; c < laws().size(); ++c) {
    if (!laws()[c].goal || next.states[c].drive == 0 || next.leaves[c] == 0 ||
        braking_[c].most > 0.0)
      continue;
    braking_[c].most = braking_of(problem, c);
    any = any || braking_[c].most > 0.0;
  }
  return any;
}

double EventMotions::braking_of(const EventProblem& problem, std::size_t c) const {
  List<Eigen::Index> others;
  for (std::size_t d = 0; d < laws().size(); ++d)
    if (d != c && laws()[d].drive > 0.0 && problem.is_free(d) && !is_broken(laws()[d].joint))
      others.push_back(problem.column(d));
  return 0.5 * laws()[c].drive * response_beside(problem.A(), others, problem.column(c));
}

void EventMotions::change_states(const EventProblem& problem, const List<OneSidedState>& next,
                                 double t) {
  List<char> is_changed(joints_.size(), 0);
  for (std::size_t c = 0; c < laws().size(); ++c) {
    const OneSidedLaw& law = laws()[c];
    if (has_started_ && states_[c].hold == Hold::kDrive && !law.is_distance)
      held_[c] = prescribed_[law.joint].target(law.function, t).value + law.zero;
    if (has_started_ && next[c] == states_[c]) continue;
    is_changed[law.joint] = 1;
    const double q = problem.reading(c).q;
    if (law.is_distance) {
      hold_length(c, q, next[c], t);
    } else {
      held_[c] = q;
      if (next[c].hold == Hold::kBrake) {
        const double rate = problem.reading(c).rate;
        held_[c] = t + std::abs(rate) / braking_[c].most;
        braking_[c].along = std::copysign(braking_[c].most, -rate);
      }
    }
  }
  for (std::size_t l = 0; l < joints_.size(); ++l)
    if (is_changed[l]) hold_motors(l, t);
  states_ = next;
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    if (!is_changed[l]) continue;
    set_rows(l);
    begin_prescribed(l, t);
  }
}

// Sets the travel of a length that changes to state `next`. A length that was not held continues
// from where it is.
void EventMotions::hold_length(std::size_t c, double q, const OneSidedState& next, double t) {
  const OneSidedLaw& law = laws()[c];
  const OneSidedState& before = states_[c];
  JointData& state = joint_states_[law.joint];
  held_[c] = state.travel = travel(law.joint, t);
  double off = 0.0;
  if (next.hold == Hold::kDrive)
    off = q - prescribed_[law.joint].length(t).value;
  else if (before.yield != 0 &&
           (is_limit(next.hold) || next.yield != 0 || next.hold == Hold::kNone))
    off = q - limit(c, before.yield > 0, t).value;
  if (!(std::abs(off) > kKeepsTravel) && before.yield == 0 && before.drive == 0) return;
  held_[c] += off;
  state.travel = held_[c];
  state.closing = false;
}

// Motors without force limit continue from their position.
void EventMotions::hold_motors(std::size_t l, double t) {
  const JointForms& kind = forms(joints_[l].kind);
  for (std::size_t i = 0; i < to_index(kind.coordinates); ++i) {
    const CoordinateLaw& law = joints_[l].coordinates[i];
    if (!is_held(law)) continue;
    const int function = kind.rows + static_cast<int>(i);
    const Prescribed error = prescribed_[l].closing(joint_states_[l].to_close, t).of(function);
    joint_states_[l].coordinates[i].held =
        prescribed_[l].target(function, t).value - error.value + law.zero;
  }
}

// ---- end of an interval

void EventMotions::finish(const EventBodies& bodies, const EquationsOfMotion& equations,
                          const Motions& rates, double t) {
  const auto q_of = [&](const OneSidedLaw& law) {
    return read_law(*this, bodies, law, t, equations, rates).q;
  };
  for (std::size_t c = 0; c < laws().size(); ++c) {
    const OneSidedLaw& law = laws()[c];
    const OneSidedState& state = states_[c];
    if (law.is_distance) {
      held_[c] = travel(law.joint, t);
      // A length that has yielded is held where it is.
      if (state.drive != 0 || state.yield != 0)
        held_[c] += q_of(law) - (state.drive != 0 ? prescribed_[law.joint].length(t)
                                                  : limit(c, state.yield > 0, t))
                                    .value;
    } else if (state.hold == Hold::kDrive) {
      held_[c] = prescribed_[law.joint].target(law.function, t).value + law.zero;
    }
  }
  for (const OneSidedLaw& law : laws()) joint_states_[law.joint].saturated = false;
  for (std::size_t c = 0; c < laws().size(); ++c) {
    const OneSidedLaw& law = laws()[c];
    if (!has_force_limit(law) && !is_at_end_[law.joint]) continue;
    if (is_saturated(c, states_[c], t, q_of(law))) joint_states_[law.joint].saturated = true;
  }
}

void EventMotions::write(std::size_t l, JointData* state,
                         std::array<double, kMaxCoordinates>* positions) const {
  for (std::size_t i = 0; i < kMaxCoordinates; ++i)
    (*positions)[i] = joint_states_[l].coordinates[i].position;
  if (is_broken(l)) state->broken = true;
  const auto [first, last] = joints_.laws_of(l);
  for (std::size_t c = first; c < last; ++c) {
    const OneSidedLaw& law = laws()[c];
    state->saturated = joint_states_[l].saturated;
    if (law.drive == 0.0 && law.limit_force == kInfinity) continue;
    if (law.is_distance) {
      state->travel = held_[c];
      if (states_[c].is_saturated()) state->closing = false;
      continue;
    }
    CoordinateState& coordinate = state->coordinates[law.coordinate];
    coordinate.held = position(l, law.coordinate);
    if (law.goal) {
      coordinate.braking = braking_[c].most;
      const ErrorsToClose& errors = joint_states_[l].to_close;
      state->to_close.offset[law.function] = errors.offset[law.function];
      state->to_close.moving[to_index(law.coordinate)] = errors.moving[to_index(law.coordinate)];
      if (!(braking_[c].most > 0.0)) coordinate.held = *law.goal;
    } else if (states_[c].hold == Hold::kDrive) {
      coordinate.held = held_[c];
    }
  }
}

}  // namespace constraint_sim::engine
