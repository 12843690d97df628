#include "engine/methods/event_driven/contacts/contact_reports.h"

#include <algorithm>
#include <cmath>

#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

using Acts = ContactEquations::Acts;

bool is_saturated(const ContactEquations& equations, const GroupCoordinate& of,
                  const OneSidedState& state) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  return (joints[of.joint].is_at_end && of.is_one_sided) ||
         is_at_force_limit(
             of.law, state, [&](bool upper_one) { return joints.limit(bodies, of, upper_one); },
             [&] { return joints.zeta(bodies, of); });
}

}  // namespace

void ContactReports::begin_step(const ContactEquations& equations) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  last_states_.clear();
  was_saturated_.clear();
  for (const GroupCoordinate& of : joints.coordinates()) {
    const GroupJoints::Reading now = joints.read(bodies, of, nullptr);
    const bool was_saturated =
        joints[of.joint].was_saturated &&
        was_at_force_limit(
            of.law, joints.coordinates(),
            [](const GroupCoordinate& other) -> const OneSidedLaw& { return other.law; }, now,
            joints.rest(bodies, of), [&] { return joints.zeta(bodies, of); });
    was_saturated_.push_back(was_saturated ? 1 : 0);
    last_states_.push_back(
        state_of_motion(of.law, now, was_saturated, joints.rest(bodies, of),
                        [&](bool upper_one) { return joints.limit(bodies, of, upper_one); }));
  }
}

void ContactReports::end_interval(const ContactEquations& equations) {
  const GroupJoints& joints = equations.joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    const GroupCoordinate& of = joints.coordinates()[c];
    last_states_[c] = of.state;
    was_saturated_[c] = is_saturated(equations, of, of.state) ? 1 : 0;
  }
}

void ContactReports::add_break(double t, std::size_t joint) {
  list_.push_back({EventKind::kBroken, t, -1, -1, 0.0, static_cast<int>(joint)});
}

void ContactReports::add(const ContactChange& change, const ContactEquations& equations,
                         ContactPairs* pairs) {
  const GroupJoints& joints = equations.joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    const GroupCoordinate& of = joints.coordinates()[c];
    if (!of.is_one_sided) continue;
    const double hit = change.impulses.coordinates[c];
    OneSidedState then = change.is_begin ? last_states_[c] : change.states[c];
    if (change.is_begin && hit != 0.0) then.hold = Hold::kNone;
    const bool was = change.is_begin ? was_saturated_[c] != 0 : is_saturated(equations, of, then);
    add_changes(
        of.law, then, of.state, hit, was, is_saturated(equations, of, of.state),
        change.is_begin && change.interval_start <= 0.0, [&](EventKind kind, double impulse) {
          const bool rests = kind == EventKind::kLimitReached || kind == EventKind::kRopeTaut;
          add({kind, change.t, -1, static_cast<int>(c), impulse},
              rests ? change.rests_in.coordinates[c] : 0.0);
        });
  }
  List<ContactPair>& list = pairs->list();
  for (std::size_t first = 0, last = 0; first < list.size(); first = last) {
    while (last < list.size() && list[last].has_bodies_of(list[first])) ++last;
    add_pairs(change, equations, first, last, &list);
  }
}

// Reports two bodies, whose pairs of shapes are those from `first` to before `last`.
void ContactReports::add_pairs(const ContactChange& change, const ContactEquations& equations,
                               std::size_t first, std::size_t last, List<ContactPair>* pairs) {
  bool was = false, is = false, stuck = false, sticks = false, is_still = false, is_rough = false;
  double impulse = 0.0, rests_in = 0.0;
  for (std::size_t p = first; p < last; ++p) {
    ContactPair& pair = (*pairs)[p];
    const bool has_friction = pair.friction > 0.0;
    was = was || pair.held;
    stuck = stuck || (has_friction && pair.stuck);
    is_still = is_still || (has_friction && pair.is_still);
    is_rough = is_rough || has_friction;
    pair.forget();
    for (std::size_t c = pair.first; c < pair.first + pair.count; ++c) {
      const Acts now = equations.contacts()[c].acts;
      was = was || change.acts[c] != Acts::kOpen;
      stuck = stuck || change.acts[c] == Acts::kSticks;
      is = is || now != Acts::kOpen;
      sticks = sticks || now == Acts::kSticks;
      impulse += change.impulses.contacts[c];
      rests_in = std::max(rests_in, change.rests_in.contacts[c]);
    }
  }
  // A contact that already exists at the first step is not reported as an event.
  if (change.is_begin && !was && impulse == 0.0) {
    was = is;
    stuck = sticks;
  }
  // At the start of a step, friction at its bound does not tell sticking from slipping. A pair that
  // does not move and sticks now stuck before as well.
  if (change.is_begin && is_still && sticks) stuck = true;
  const auto add_one = [&](EventKind kind, double of, double later) {
    add({kind, change.t, static_cast<int>(first), -1, of}, later);
  };
  const double later = is ? rests_in : 0.0;
  if (!was && (is || impulse > 0.0)) add_one(EventKind::kContactBegan, impulse, later);
  if (was && impulse > 0.0) add_one(EventKind::kHit, impulse, later);
  if ((was || impulse > 0.0) && !is) add_one(EventKind::kContactEnded, 0.0, 0.0);
  if (was && is && stuck != sticks && is_rough)
    add_one(sticks ? EventKind::kSticks : EventKind::kSlips, 0.0, 0.0);
}

// Adds a reported event. An event now replaces a rest reported for later.
void ContactReports::add(const Report& report, double rests_in) {
  for (Report& other : list_)
    if (other.pair == report.pair && other.coordinate == report.coordinate)
      other.time = std::min(other.time, report.time);
  list_.push_back(report);
  list_.back().time += rests_in;
}

void ContactReports::write(const ContactEquations& equations, std::size_t c,
                           JointData* state) const {
  const GroupJoints& joints = equations.joints();
  const GroupCoordinate& of = joints.coordinates()[c];
  const OneSidedLaw& law = of.law;
  if (of.is_one_sided) {
    state->saturated = false;
    for (std::size_t d = 0; d < was_saturated_.size(); ++d)
      if (joints.coordinates()[d].joint == of.joint && was_saturated_[d]) state->saturated = true;
  }
  if (law.drive == 0.0 && !std::isfinite(law.limit_force)) return;
  const double q = joints.read(equations.bodies(), of, nullptr).q;
  if (!law.is_distance) {
    CoordinateState& coordinate = state->coordinates[static_cast<std::size_t>(law.coordinate)];
    coordinate.braking = of.braking;
    coordinate.held = law.goal && of.braking == 0.0 ? *law.goal : q;
    if (law.goal) {
      const ErrorsToClose& errors = joints[of.joint].to_close;
      state->to_close.offset[law.function] = errors.offset[law.function];
      state->to_close.moving[to_index(law.coordinate)] = errors.moving[to_index(law.coordinate)];
    }
  } else if (law.drive > 0.0)
    state->travel = q - joints[of.joint].joint.distance.length.value_or(0.0);
  else
    state->travel += of.yield_displacement;
}

}  // namespace constraint_sim::engine
