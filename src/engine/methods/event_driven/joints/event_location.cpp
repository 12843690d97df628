// Watched values of EventDriven, and the location of the first event in a substep.

#include <algorithm>
#include <cmath>

#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_span.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

constexpr std::size_t kStagesWatched = 12;

}  // namespace

// ---- watched values

// Watches the force with which a row holds a coordinate against its bounds; `reading`: the
// coordinate.
void EventDriven::watch_force(const Span& span, std::size_t c, const Reading& reading, double t,
                              List<Watched>* list) const {
  const OneSidedLaw& law = laws_[c];
  const EquationsOfMotion& equations = span.motion->equations();
  const auto found =
      std::find(equations.joints().begin(), equations.joints().end(), static_cast<int>(law.joint));
  const auto link = static_cast<std::size_t>(found - equations.joints().begin());
  double soft = law.soft.force(reading.q, reading.rate);
  if (law.servo_most > 0.0) soft += clamped_servo_force(law, reading, rest(c, t));
  const auto zeta_of = [&] { return zeta(span, c, t, reading.q); };
  const double rate =
      rate_held_at(
          states_[c].hold, [&](bool upper_one) { return limit(c, upper_one, t); }, zeta_of)
          .rate;
  const ForceBounds bounds = force_bounds(law, states_[c].hold, rate, zeta_of().rate);
  Watched watched;
  watched.law = static_cast<int>(c);
  watched.tolerance = kForceShare * equations.largest_force();
  const auto watch_side = [&](double bound, signed char side) {
    if (!std::isfinite(bound)) return;
    const auto margin = [&](double force) { return side * (bound - force + soft); };
    watched.side = side;
    watched.value = margin(equations.forces().force(equations, link, 0)[law.function]);
    watched.early = 0.0;
    // Stages show a force that leaves its bounds within the substep and returns.
    const bool is_alone = law.soft.is_none() && law.servo_most == 0.0;
    for (std::size_t i = 1; is_alone && watched.early == 0.0 && i < kStagesWatched; ++i)
      if (span.accuracy.order == 8 &&
          margin(equations.forces().force(equations, link, i)[law.function]) < -watched.tolerance)
        watched.early = DormandPrince8::kC[i];
    list->push_back(watched);
  };
  watch_side(bounds.least, -1);
  watch_side(bounds.most, 1);
}

// Lists all watched values, in an order that depends only on the states of rows.
void EventDriven::watch(const Span& span, double t, List<Watched>* list) {
  list->clear();
  const EquationsOfMotion& equations = span.motion->equations();
  find_accelerations(equations, span.motion->state(), span.motion->derivative(), &rates_);
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    const OneSidedLaw& law = laws_[c];
    const OneSidedState& state = states_[c];
    if (is_broken_[law.joint]) continue;
    const Reading reading = read(span, law, t, equations, rates_);
    const auto limit_of = [&](bool upper_one) { return limit(c, upper_one, t); };
    const auto zeta_of = [&] { return zeta(span, c, t, reading.q); };
    const auto add = [&](const WatchedValue& value) {
      Watched watched;
      static_cast<WatchedValue&>(watched) = value;
      watched.law = static_cast<int>(c);
      list->push_back(watched);
    };
    watch_limits(law, state, reading, limit_of, add);
    if (state.hold != Hold::kNone) watch_force(span, c, reading, t, list);
    watch_rates(law, state, braking_[c], reading, limit_of, zeta_of, add);
    if (law.has_servo()) watch_servo(law, state, reading, rest(c, t), add);
    if (state.hold == Hold::kBrake) add(watched_end(held_[c] - t, braking_[c]));
  }
  if (!breaking_.empty() && equations.delassus().redundant() == 0) watch_breaking(span, t, list);
}

void EventDriven::watch_breaking(const Span& span, double t, List<Watched>* list) const {
  const EquationsOfMotion& equations = span.motion->equations();
  for (const Breaking& breaking : breaking_) {
    const auto found = std::find(equations.joints().begin(), equations.joints().end(),
                                 static_cast<int>(breaking.joint));
    if (found == equations.joints().end()) continue;
    const RowVector force = equations.forces().force(
        equations, static_cast<std::size_t>(found - equations.joints().begin()), 0);
    const Joint& joint = joints_[breaking.joint];
    Watched watched;
    watched.breaks = static_cast<int>(breaking.joint);
    double strongest = std::abs(force[0]), turning = 0.0;
    if (!has_length(joint.kind)) {
      const auto [a, b] = ends_[breaking.joint];
      const World::JointWrench wrench = wrench_of(joint, body(span, static_cast<int>(a), t),
                                                  body(span, static_cast<int>(b), t), force, 1.0);
      strongest = wrench.force.norm();
      turning = wrench.torque.norm();
    }
    for (const auto& [most, is] :
         {std::pair(breaking.force, strongest), std::pair(breaking.torque, turning)}) {
      if (!std::isfinite(most)) continue;
      watched.value = most - is;
      watched.tolerance = kForceShare * most;
      list->push_back(watched);
    }
  }
}

// Ends the substep from `start` at the first event, and leaves the state there. Keeps the whole
// substep where there is no event.
bool EventDriven::locate(Span* span, const SubstepSpan& start, double h,
                         std::optional<Crossing>* event) {
  RungeKutta& motion = *span->motion;
  const auto go_to = [&](double share, bool is_start) {
    if (is_start)
      motion.return_to_start();
    else if (!motion.repeat_substep(rest_of(*span), span->accuracy, start.t, share * h))
      return false;
    span->left = is_start ? start : gone_on(start, share * h);
    motion.equations().scatter_state(motion.state(), span->states);
    watch(*span, span->left.t, &watched_.after);
    return true;
  };
  return watched_.locate(start.t, h, go_to, event);
}

}  // namespace constraint_sim::engine
