#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "constraint_sim/engine/event.h"
#include "engine/constraints/closing_errors.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/constraints/prescribed.h"
#include "engine/math/integrate.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/event_watch.h"
#include "engine/methods/event_driven/tension_events.h"

namespace constraint_sim::engine {

// Functions of time and of one-sided laws that the event-driven methods share: the rate at which a
// law may hold a coordinate, forces after it yields, watched values, and events to report.
// `limit(upper_one)` returns position and motion of a limit, `zeta()` the rate and acceleration
// that the motor demands; for a motor with a goal its `value` is the prescribed position. A reading
// has position `q`, `rate` and `acceleration` of a coordinate.

/// Acceleration of a coordinate, as a share of its acceleration without joints, up to which the
/// joints hold the coordinate.
inline constexpr double kHeld = 1e-12;
/// Work of an impulse, as a share of the exchanged energy, up to which the work is rounding.
inline constexpr double kNoWork = 1e-12;
/// Distance of a force from its bound, as a share of the bound, up to which the force is at the
/// bound.
inline constexpr double kAtBound = 1e-6;
/// Force, as a share of the largest force of the island, up to which the force is rounding.
inline constexpr double kForceShare = 1e-9;
inline constexpr int kMostImpacts = 2000;  ///< impacts at one time
/// Passes of impacts at one time until velocities are as small as rounding.
inline constexpr int kMostImpactPasses = 8;
inline constexpr int kMostUnchanged = 100;  ///< events in a step that change no state

/// How a decision of states sees prescribed motions that are about to start: by their direction
/// after a time, with slight accelerations, which are the same share of all accelerations then.
struct StartAhead {
  double time = 0.0;  ///< [s]; 0: motions are seen as they are
  double share = 0.0;

  StartAhead() = default;
  StartAhead(double interval, double closing_time) {
    // Half would not do: a motion that ends with the interval has no acceleration in its middle.
    constexpr double kStartShare = 0.25;
    constexpr double kSlight = 0.2;  // acceleration of a motion that closes 1 m or 1 rad [1/s²]
    if (!(closing_time > 0.0)) return;
    time = kStartShare * std::min(interval, closing_time);
    share = kSlight / std::abs(closing_motion(time, closing_time).acceleration);
  }
};

/// Prescribed motion for a decision of states at time t, so that what a motion makes slip or
/// saturate when it starts does so at once.
template <class Motion>
Prescribed about_to_start(const Motion& motion, double t, const StartAhead& ahead) {
  Prescribed now = motion(t);
  if (ahead.time > 0.0 && now.rate == 0.0 && now.acceleration == 0.0)
    now.acceleration = ahead.share * motion(t + ahead.time).acceleration;
  return now;
}

inline signed char sign_of(double x) {
  return static_cast<signed char>(x > 0.0 ? 1 : (x < 0.0 ? -1 : 0));
}

/// Rest of a substep that began at `start`, after `done` [s]. The rest is zero where the time
/// cannot resolve it, as at an event at the end of a tick.
inline RemainingInterval remaining_after(const RemainingInterval& start, double done) {
  RemainingInterval now = start;
  now.left = start.left - done;
  now.t = start.end - now.left;
  if (now.t + now.left == now.t) now.left = 0.0;
  return now;
}

/// Prescribed error of a limit that is open by `beyond` at the start.
inline Prescribed error_of_limit(const OneSidedLaw& law, double beyond,
                                 const ClosingErrors& closing) {
  return law.goal ? closing.of_limit(law.function, beyond) : closing.of(law.function);
}

/// Whether the prescribed motion of a motor with a goal leads off a limit, or comes to rest at the
/// limit.
inline bool leads_off(const OneSidedLaw& law, bool upper_one, const Prescribed& motion) {
  if (!law.goal) return false;
  const double direction = upper_one ? -1.0 : 1.0;
  return direction * (*law.goal - law.limit(upper_one)) > kTouching ||
         (direction * (*law.goal - law.limit(upper_one)) >= -kTouching &&
          direction * motion.acceleration > 0.0);
}

/// Longest substep in which the demand of a motor at its force limit passes the rate of the
/// coordinate no more often than polynomials through both ends show [s]: an eighth of its period.
inline double longest_substep(const OneSidedLaw& law, Hold hold, const MotorRate& motor) {
  const bool is_followed = hold == Hold::kDrive || hold == Hold::kBrake;
  if (law.drive == 0.0 || is_followed || motor.amplitude == 0.0 || motor.frequency == 0.0)
    return kInfinity;
  return 0.125 / motor.frequency;
}

/// Rules of find_hold(), beside a law and its coordinate.
struct HoldRules {
  double resting = kResting;  ///< rate that counts as zero [m/s or rad/s]
  /// Deceleration of a motor with a goal that does not follow its prescribed motion; 0: it follows.
  double braking = 0.0;
  /// Whether a motor that follows its prescribed motion has the force to move the coordinate off a
  /// touched limit, or to stop it there.
  bool is_strong_enough = true;
};

/// Returns the law that may hold a coordinate at its position and rate. Where there is none,
/// returns nothing and sets the acting forces in `state`, which starts empty. `before`: state until
/// now.
template <class Reading, class Limit, class Zeta>
std::optional<Hold> find_hold(const OneSidedLaw& law, const OneSidedState& before,
                              const Reading& reading, Limit limit, Zeta zeta,
                              const HoldRules& rules, OneSidedState* state) {
  const double resting = rules.resting;
  const bool is_lost = rules.braking > 0.0;
  for (const bool upper_one : {false, true}) {
    if (!std::isfinite(law.limit(upper_one))) continue;
    const Prescribed at_limit = limit(upper_one);
    const double direction = upper_one ? -1.0 : 1.0;
    // The yielding limit is at the current length.
    const bool has_yielded = before.yield == -direction;
    const double gap = direction * (reading.q - at_limit.value);
    const double rate = direction * (reading.rate - at_limit.rate);
    if (rules.is_strong_enough && !is_lost && gap >= -kTouching && gap <= kTouching &&
        leads_off(law, upper_one, zeta()))
      continue;
    const bool has_yet_to_hit = gap > 0.0 && rate < -resting && !std::isfinite(law.limit_force);
    if (!has_yielded && (gap > kTouching || has_yet_to_hit)) continue;
    if (std::abs(rate) <= resting) return upper_one ? Hold::kUpper : Hold::kLower;
    if (rate < 0.0) state->yield = sign_of(-direction);
  }
  if (state->yield != 0) return std::nullopt;
  if (law.goal && !is_lost) return Hold::kDrive;
  if (law.friction > 0.0 && std::abs(reading.rate) <= resting) return Hold::kStill;
  if (law.drive > 0.0) {
    const double off = reading.rate - zeta().rate;
    if (is_lost && brakes_to_goal(reading.q - *law.goal, reading.rate, rules.braking))
      return Hold::kBrake;
    if (!is_lost && std::abs(off) <= resting) return Hold::kDrive;
    state->drive = sign_of(off);
  }
  if (law.friction > 0.0) state->slip = sign_of(reading.rate);
  return std::nullopt;
}

/// Rate and acceleration at which a law holds the coordinate.
template <class Limit, class Zeta>
Prescribed rate_held_at(Hold hold, Limit limit, Zeta zeta) {
  switch (hold) {
    case Hold::kUpper:
    case Hold::kLower:
      return limit(hold == Hold::kUpper);
    case Hold::kDrive:
    case Hold::kBrake:
      return zeta();
    case Hold::kNone:
    case Hold::kStill:
      break;
  }
  return {};
}

/// State of a coordinate that was held at `rate` and leaves this rate to a side.
inline OneSidedState state_leaving(const OneSidedLaw& law, Hold hold, double rate, double zeta_rate,
                                   signed char side) {
  const auto beside = [&](double at) {
    const double off = rate - at;
    return std::abs(off) <= kResting ? side : sign_of(off);
  };
  OneSidedState state;
  if (law.friction > 0.0) state.slip = beside(0.0);
  if (law.drive > 0.0) state.drive = beside(zeta_rate);
  if (std::isfinite(law.limit_force) &&
      ((hold == Hold::kUpper && side > 0) || (hold == Hold::kLower && side < 0)))
    state.yield = side;
  return state;
}

/// Adds the gaps of limits that are not reached, by `add(WatchedValue)`.
template <class Reading, class Limit, class Add>
void watch_limits(const OneSidedLaw& law, const OneSidedState& state, const Reading& reading,
                  Limit limit, Add add) {
  for (const bool upper_one : {false, true}) {
    if (!std::isfinite(law.limit(upper_one)) || state.is_at(upper_one)) continue;
    const Prescribed at_limit = limit(upper_one);
    const double direction = upper_one ? -1.0 : 1.0;
    WatchedValue watched;
    watched.known = 2;
    watched.value = direction * (reading.q - at_limit.value);
    watched.rate = direction * (reading.rate - at_limit.rate);
    watched.acceleration = direction * (reading.acceleration - at_limit.acceleration);
    watched.tolerance = 4.0 * kEpsilon * (std::abs(reading.q) + std::abs(at_limit.value));
    add(watched);
  }
}

/// Watched value of a saturated motor with a goal: zero where its rate allows to brake to rest at
/// the goal. With u = q̇ and e = q − g the value is u|u| + 2 b e, which is smooth where e passes 0.
template <class Reading>
WatchedValue watched_rate_to_goal(const OneSidedLaw& law, double direction, double braking,
                                  const Reading& reading) {
  constexpr double kReadingRounding = 1e-14;  // [m or rad] rounding of a coordinate read from poses
  const double u = reading.rate, off = reading.q - *law.goal;
  WatchedValue watched;
  watched.known = 1;
  watched.value = direction * (u * std::abs(u) + 2.0 * braking * off);
  watched.rate = direction * (2.0 * std::abs(u) * reading.acceleration + 2.0 * braking * u);
  watched.tolerance =
      kEpsilon * u * u +
      2.0 * braking * (kReadingRounding + kEpsilon * (std::abs(reading.q) + std::abs(*law.goal)));
  return watched;
}

/// Watched value of a braking motor, zero where the motor comes to rest. `left`: time until then
/// [s].
inline WatchedValue watched_end(double left, double braking) {
  WatchedValue watched;
  watched.known = 1;
  watched.value = braking * left;
  watched.rate = -braking;
  watched.tolerance = kEpsilon * braking * std::abs(left);
  return watched;
}

/// Adds the margin of a servo to its force limit, or of a saturated servo's demand beyond it, as a
/// share of the limit. Of a spring that only pulls, adds watch_tension().
template <class Reading, class Add>
void watch_servo(const OneSidedLaw& law, const OneSidedState& state, const Reading& reading,
                 const Prescribed& rest, Add add) {
  if (law.only_pulls) return watch_tension(law, state, reading, rest, add);
  if (law.servo_most == 0.0) return;
  const double force = servo_force(law, reading, rest) / law.servo_most;
  const double rate = servo_force_rate(law, reading, rest) / law.servo_most;
  WatchedValue watched;
  watched.known = 1;
  watched.tolerance = 4.0 * kEpsilon / law.servo_most *
                      (law.servo_most + law.servo.K * (std::abs(reading.q) + std::abs(rest.value)) +
                       law.servo.C * (std::abs(reading.rate) + std::abs(rest.rate)));
  for (const double side : {1.0, -1.0}) {
    const bool is_there = state.servo == (side > 0.0 ? Servo::kMost : Servo::kLeast);
    if (!is_there && state.servo != Servo::kFollows) continue;
    const double inside = is_there ? -1.0 : 1.0;
    watched.value = inside * (1.0 - side * force);
    watched.rate = -inside * side * rate;
    add(watched);
  }
}

/// State of a servo from now on. At the edge the rate of its force decides.
template <class Reading>
Servo servo_from(const OneSidedLaw& law, Servo before, const Reading& reading,
                 const Prescribed& rest) {
  if (law.only_pulls) return tension_from(law, before, reading, rest);
  if (law.servo_most == 0.0) return Servo::kNone;
  const double force = servo_force(law, reading, rest) / law.servo_most;
  const Servo beyond = force > 0.0 ? Servo::kMost : Servo::kLeast;
  const double margin = 1.0 - std::abs(force);
  const double rate =
      (force > 0.0 ? 1.0 : -1.0) * servo_force_rate(law, reading, rest) / law.servo_most;
  const double edge = kServoEdge + kServoEdgeTime * std::abs(rate);
  if (margin > edge) return Servo::kFollows;
  if (margin < -edge) return beyond;
  if (rate != 0.0) return rate > 0.0 ? beyond : Servo::kFollows;
  return before == Servo::kFollows ? Servo::kFollows : beyond;
}

/// Adds the rates of slipping coordinates, saturated motors and yielding limits. `braking`:
/// deceleration of a motor that has lost its prescribed motion.
template <class Reading, class Limit, class Zeta, class Add>
void watch_rates(const OneSidedLaw& law, const OneSidedState& state, double braking,
                 const Reading& reading, Limit limit, Zeta zeta, Add add) {
  const auto watch_rate = [&](double direction, const Prescribed& of) {
    WatchedValue watched;
    watched.known = 1;
    watched.value = direction * (reading.rate - of.rate);
    watched.rate = direction * (reading.acceleration - of.acceleration);
    watched.tolerance = kEpsilon * (std::abs(reading.rate) + std::abs(of.rate));
    add(watched);
  };
  if (state.slip != 0) watch_rate(state.slip, {});
  if (state.drive != 0 && law.goal)
    add(watched_rate_to_goal(law, state.drive, braking, reading));
  else if (state.drive != 0)
    watch_rate(state.drive, zeta());
  if (state.yield != 0) watch_rate(state.yield, limit(state.yield > 0));
}

/// Whether a motor or a servo is saturated, also where a limit or friction holds the coordinate
/// against a motor.
template <class Limit, class Zeta>
bool is_at_force_limit(const OneSidedLaw& law, const OneSidedState& state, Limit limit, Zeta zeta) {
  if (state.is_saturated()) return true;
  if (law.drive == 0.0 || state.hold == Hold::kNone || state.hold == Hold::kDrive ||
      state.hold == Hold::kBrake)
    return false;
  const Prescribed held = rate_held_at(state.hold, limit, zeta), asked = zeta();
  return std::abs(held.rate - asked.rate) > kResting ||  // also where the motor reverses
         std::abs(held.acceleration - asked.acceleration) > kResting;
}

inline bool has_force_limit(const OneSidedLaw& law) {
  return law.drive > 0.0 || law.servo_most > 0.0 || std::isfinite(law.limit_force);
}

/// Whether a law was saturated when the step begins, for a joint that is reported as saturated. Of
/// several laws with a force limit, those count that do not move as demanded.
template <class Laws, class LawOf, class Reading, class Zeta>
bool was_at_force_limit(const OneSidedLaw& law, const Laws& all, LawOf law_of, const Reading& now,
                        const Prescribed& rest, Zeta zeta) {
  if (law.is_distance) return true;
  if (!has_force_limit(law)) return false;
  const auto count = std::count_if(all.begin(), all.end(), [&](const auto& other) {
    const OneSidedLaw& of = law_of(other);
    return of.joint == law.joint && has_force_limit(of);
  });
  if (count == 1) return true;
  if (law.servo_most > 0.0)
    return std::abs(servo_force(law, now, rest)) >= (1.0 - kServoEdge) * law.servo_most;
  return std::abs(now.rate - zeta().rate) > kResting;
}

/// State of a law before a step, from the motion at its end and the reported saturation of the
/// motor. `rest`: rest position of a servo.
template <class Reading, class Limit>
OneSidedState state_of_motion(const OneSidedLaw& law, const Reading& now, bool saturated,
                              const Prescribed& rest, Limit limit) {
  OneSidedState state;
  if (law.only_pulls) state.servo = tension_from(law, Servo::kSlack, now, rest);
  const bool yields = saturated && std::isfinite(law.limit_force);
  for (const bool upper_one : {false, true}) {
    if (!std::isfinite(law.limit(upper_one))) continue;
    const Prescribed at_limit = limit(upper_one);
    if ((upper_one ? -1.0 : 1.0) * (now.q - at_limit.value) > kTouching) continue;
    if (std::abs(now.rate - at_limit.rate) <= kResting)
      state.hold = upper_one ? Hold::kUpper : Hold::kLower;
    else if (yields)
      state.yield = static_cast<signed char>(upper_one ? 1 : -1);
  }
  if (saturated && state.yield == 0) state.drive = 1;
  const bool is_driven = law.drive > 0.0 && !saturated;
  if (law.friction > 0.0 && state.hold == Hold::kNone && !is_driven &&
      std::abs(now.rate) > kResting)
    state.slip = sign_of(now.rate);
  return state;
}

/// Adds the events of a change of state, by `add(kind, impulse)`. `hit`: impulse of a limit, > 0
/// for the lower limit. `was_saturated`, `is_saturated`: of the motor. `is_begin`: the state before
/// is unknown.
template <class Add>
void add_changes(const OneSidedLaw& law, const OneSidedState& before, const OneSidedState& next,
                 double hit, bool was_saturated, bool is_saturated, bool is_begin, Add add) {
  for (const bool upper_one : {false, true}) {
    const bool is_hit = upper_one ? hit < 0.0 : hit > 0.0;
    const bool was = is_begin ? next.is_at(upper_one) && !is_hit : before.is_at(upper_one);
    const bool is_rope = law.is_rope() && upper_one;
    if (!was && (is_hit || next.is_at(upper_one)))
      add(is_rope ? EventKind::kRopeTaut : EventKind::kLimitReached, is_hit ? std::abs(hit) : 0.0);
    if ((was || is_hit) && !next.is_at(upper_one))
      add(is_rope ? EventKind::kRopeSlack : EventKind::kLimitLeft, 0.0);
  }
  if (is_begin) return;
  const auto compare = [&](bool was, bool is, EventKind begins, EventKind ends) {
    if (was != is) add(is ? begins : ends, 0.0);
  };
  compare(was_saturated, is_saturated, EventKind::kSaturated, EventKind::kReleased);
  compare(before.slip != 0, next.slip != 0, EventKind::kSlips, EventKind::kSticks);
  if (law.only_pulls)
    compare(before.servo == Servo::kFollows, next.servo == Servo::kFollows, EventKind::kRopeTaut,
            EventKind::kRopeSlack);
}

}  // namespace constraint_sim::engine
