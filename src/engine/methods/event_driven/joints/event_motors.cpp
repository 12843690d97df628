// Demands of motors and servos with a force limit in EventDriven, and detection of motors that do
// not follow their prescribed motions.

#include <cmath>

#include "engine/math/box_lcp.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_span.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
// Rest position of a servo.
Prescribed EventDriven::rest(std::size_t c, double t) const {
  const OneSidedLaw& law = laws_[c];
  return engine::rest_of(law, law.is_distance ? courses_[law.joint].length(t) : Prescribed{});
}

// Prescribed motion of a motor with a goal.
Prescribed EventDriven::course_of(std::size_t c, double t) const {
  const OneSidedLaw& law = laws_[c];
  const double offset = joint_states_[law.joint].closing_offset[law.function];
  const Prescribed share = courses_[law.joint].share_to_close(t);
  return {*law.goal + offset * share.value, offset * share.rate, offset * share.acceleration};
}

// Rate and acceleration that a motor with a force limit demands at q. For a motor with a goal,
// `value` is the position of its prescribed motion.
Prescribed EventDriven::zeta(const Span& span, std::size_t c, double t, double q) const {
  const OneSidedLaw& law = laws_[c];
  if (law.is_distance) return courses_[law.joint].length(t);
  if (law.drive == 0.0) return {};
  if (law.goal && states_[c].hold == Hold::kBrake)
    return rate_until(*law.goal, std::copysign(braking_[c], q - *law.goal), held_[c] - t);
  if (law.goal && braking_[c] > 0.0) return rate_to_goal(*law.goal, braking_[c], q);
  if (law.goal) return course_of(c, t);
  Motor motor = *joints_[law.joint].coordinates[law.coordinate].motor;
  const JointState& state = joint_states_[law.joint];
  if (motor.timeout > 0.0 && state.coordinates[law.coordinate].expires_at <= span.all.t)
    motor.bias = 0.0;
  return motor_course(motor, motor_phase(motor, t), 0.0);
}

// Whether the motor or servo of a law is saturated, or its winch is at the end of the travel.
bool EventDriven::is_saturated(const Span& span, std::size_t c, const OneSidedState& state,
                               double t, double q) const {
  return is_at_end_[laws_[c].joint] ||
         is_at_force_limit(
             laws_[c], state, [&](bool upper_one) { return limit(c, upper_one, t); },
             [&] { return zeta(span, c, t, q); });
}

// Whether the law was saturated at the end of the last step, as reported.
bool EventDriven::was_saturated(const Span& span, std::size_t c, const Reading& now) const {
  const double t = span.left.t;
  return span.around.told[members_[laws_[c].joint]].saturated &&
         was_at_force_limit(
             laws_[c], laws_, [](const OneSidedLaw& law) -> const OneSidedLaw& { return law; }, now,
             rest(c, t), [&] { return zeta(span, c, t, now.q); });
}

// Notes which joints are saturated at the end of the interval.
void EventDriven::note_saturated(const Span& span) {
  for (const OneSidedLaw& law : laws_) joint_states_[law.joint].saturated = false;
  const double t = span.left.end;
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    if (!has_force_limit(laws_[c]) && !is_at_end_[laws_[c].joint]) continue;
    const double q = read(span, laws_[c], t, span.motion->equations(), rates_).q;
    if (is_saturated(span, c, states_[c], t, q)) joint_states_[laws_[c].joint].saturated = true;
  }
}

// Finds the motors that do not follow their prescribed motions, before states are decided. A motor
// that has just lost its motion brakes with the deceleration by half of its force, while other
// motors hold.
void EventDriven::find_lost(const Span& span, const Rows& rows) {
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    if (!laws_[c].goal || !rows.is_free[c]) continue;
    const Prescribed course = course_of(c, span.left.t);
    const Reading& reading = rows.reading[c];
    if (std::abs(reading.q - course.value) <= kTouching &&
        std::abs(reading.rate - course.rate) <= kResting)
      braking_[c] = 0.0;
    else if (braking_[c] == 0.0)
      braking_[c] = braking_of(rows, c);
  }
}

// Finds the motors that lose their prescribed motions in the decided states.
void EventDriven::note_lost(const Rows& rows, const List<OneSidedState>& next) {
  for (std::size_t c = 0; c < laws_.size(); ++c)
    if (laws_[c].goal && next[c].drive != 0 && braking_[c] == 0.0)
      braking_[c] = braking_of(rows, c);
}

double EventDriven::braking_of(const Rows& rows, std::size_t c) const {
  List<Eigen::Index> others;
  for (std::size_t d = 0; d < laws_.size(); ++d)
    if (d != c && laws_[d].drive > 0.0 && rows.is_free[d] && !is_broken_[laws_[d].joint])
      others.push_back(static_cast<Eigen::Index>(d));
  return 0.5 * laws_[c].drive * response_beside(rows.A, others, static_cast<Eigen::Index>(c));
}

}  // namespace constraint_sim::engine
