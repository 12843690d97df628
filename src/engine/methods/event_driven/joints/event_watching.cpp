#include "engine/methods/event_driven/joints/event_watching.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/joint_load.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

// Prescribed motion of a held coordinate, up to a constant value.
Prescribed held_motion(const EventMotions& motions, std::size_t c, double t) {
  const OneSidedLaw& law = motions.laws()[c];
  const PrescribedMotion& motion = motions.prescribed()[law.joint];
  if (law.is_coupling) return motion.closing(t).coupling();
  return law.is_distance ? motion.length(t) : motion.target(law.function, t);
}

// Watches the force with which a row holds a coordinate against its bounds; `reading`: the
// coordinate at time t.
void watch_force(const EventMotions& motions, std::size_t c, const EventReading& reading, double t,
                 const StagedSubstep& last, const EquationsOfMotion& equations,
                 List<WatchedByJoints>* list) {
  const OneSidedLaw& law = motions.laws()[c];
  const auto found =
      std::find(equations.joints().begin(), equations.joints().end(), static_cast<int>(law.joint));
  const auto link = static_cast<std::size_t>(found - equations.joints().begin());
  const Hold hold = motions.states()[c].hold;
  // Reading at another time in the substep: the coordinate moves as prescribed.
  const auto reading_at = [&](double time) {
    EventReading then = reading;
    if (time == t) return then;
    const Prescribed now = held_motion(motions, c, t), before = held_motion(motions, c, time);
    then.q -= now.value - before.value;
    then.rate -= now.rate - before.rate;
    return then;
  };
  const auto rate_at = [&](double time) {
    return rate_held_at(
        hold, [&](bool upper_one) { return motions.limit(c, upper_one, time); },
        [&] { return motions.zeta(c, time, reading_at(time).q); });
  };
  const Prescribed at = rate_at(t);
  const ForceBounds bounds = force_bounds(law, hold, at, motions.zeta(c, t, reading.q));
  // Bounds jump where the demand of a motor passes the rate of the coordinate, or reverses.
  const bool have_jumps = law.drive > 0.0 || at.rate != 0.0 || at.acceleration != 0.0;
  const auto bounds_at = [&](double time) {
    if (time == t || !have_jumps) return bounds;
    return force_bounds(law, hold, rate_at(time), motions.zeta(c, time, reading_at(time).q));
  };
  // Forces of the row include springs, dampers and servos.
  const bool has_soft = law.servo_most > 0.0 || !law.soft.is_none();
  const auto soft_at = [&](double time) {
    if (!has_soft) return 0.0;
    const EventReading then = reading_at(time);
    double soft = law.soft.force(then.q, then.rate);
    if (law.servo_most > 0.0) soft += clamped_servo_force(law, then, motions.rest(c, time));
    return soft;
  };
  WatchedByJoints watched;
  watched.law = static_cast<int>(c);
  watched.tolerance = kForceShare * equations.largest_force();
  const auto watch_side = [&](double ForceBounds::*side_of, signed char side) {
    if (!std::isfinite(bounds.*side_of)) return;
    const auto margin = [&](std::size_t stage) {
      const double time = t - last.until_end(stage);
      const double force = equations.forces().force(equations, link, stage)[law.function];
      return side * (bounds_at(time).*side_of - force + soft_at(time));
    };
    watched.side = side;
    watched.value = margin(0);
    // Stages show a force that leaves its bounds within the substep and returns.
    watched.early = last.early_below(margin, watched.value, watched.tolerance);
    list->push_back(watched);
  };
  watch_side(&ForceBounds::least, -1);
  watch_side(&ForceBounds::most, 1);
}

void watch_breaking(const EventMotions& motions, const EventBodies& bodies, double t,
                    const StagedSubstep& last, const EquationsOfMotion& equations,
                    List<WatchedByJoints>* list) {
  const EventJoints& joints = motions.joints();
  for (const EventJoints::Breaking& breaking : joints.breaking()) {
    const auto found = std::find(equations.joints().begin(), equations.joints().end(),
                                 static_cast<int>(breaking.joint));
    if (found == equations.joints().end()) continue;
    const auto link = static_cast<std::size_t>(found - equations.joints().begin());
    const Joint& joint = joints[breaking.joint];
    WatchedByJoints watched;
    watched.breaks = static_cast<int>(breaking.joint);
    const auto [a, b] = joints.ends(breaking.joint);
    // Stages are evaluated at the current pose, with the present force of a coupling.
    const BodyState of_a = bodies.at(a, t), of_b = bodies.at(b, t);
    const auto load = [&](std::size_t stage) {
      return load_of(joint, of_a, of_b, equations.forces().force(equations, link, stage),
                     equations.forces().coupled_force(equations, link));
    };
    for (const auto& [most, of] : {std::pair(breaking.force, &JointLoad::force),
                                   std::pair(breaking.torque, &JointLoad::torque)}) {
      if (!std::isfinite(most)) continue;
      const auto margin = [&, bound = most, of = of](std::size_t stage) {
        return bound - load(stage).*of;
      };
      watched.value = margin(0);
      watched.tolerance = kForceShare * most;
      watched.early = last.early_below(margin, watched.value, watched.tolerance);
      list->push_back(watched);
    }
  }
}

}  // namespace

double longest_substep(const EventMotions& motions) {
  double longest = kInfinity;
  for (std::size_t c = 0; c < motions.laws().size(); ++c) {
    const OneSidedLaw& law = motions.laws()[c];
    if (law.drive == 0.0 || motions.is_broken(law.joint)) continue;
    const Joint& joint = motions.joints()[law.joint];
    const Motor& motor =
        law.is_distance ? joint.motor : *joint.coordinates[to_index(law.coordinate)].motor;
    longest = std::min(longest, longest_substep(law, motions.states()[c].hold, motor_rate(motor)));
  }
  return longest;
}

void watch_joints(const EventMotions& motions, const EventBodies& bodies, double t,
                  const StagedSubstep& last, RungeKutta* motion, Motions* rates,
                  List<WatchedByJoints>* list) {
  list->clear();
  const EquationsOfMotion& equations = motion->equations();
  motion->find_accelerations(t, rates);
  for (std::size_t c = 0; c < motions.laws().size(); ++c) {
    const OneSidedLaw& law = motions.laws()[c];
    const OneSidedState& state = motions.states()[c];
    if (motions.is_broken(law.joint)) continue;
    const EventReading reading = read_law(motions, bodies, law, t, equations, *rates);
    const auto limit_of = [&](bool upper_one) { return motions.limit(c, upper_one, t); };
    const auto zeta_of = [&] { return motions.zeta(c, t, reading.q); };
    const auto add = [&](const WatchedValue& value) {
      WatchedByJoints watched;
      static_cast<WatchedValue&>(watched) = value;
      watched.law = static_cast<int>(c);
      list->push_back(watched);
    };
    watch_limits(law, state, reading, limit_of, add);
    if (state.hold != Hold::kNone) watch_force(motions, c, reading, t, last, equations, list);
    watch_rates(law, state, motions.braking(c), reading, limit_of, zeta_of, add);
    if (law.has_servo()) watch_servo(law, state, reading, motions.rest(c, t), add);
    if (state.hold == Hold::kBrake) add(watched_end(motions.held(c) - t, motions.braking(c)));
  }
  if (!motions.joints().breaking().empty() && equations.delassus().redundant() == 0)
    watch_breaking(motions, bodies, t, last, equations, list);
}

}  // namespace constraint_sim::engine
