// What the events of an EventDriven are, and where in a substep the first one is.

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/methods/event_span.h"
#include "engine/methods/first_root.h"

namespace constraint_sim::engine {
namespace {

constexpr double kTouching = EventDriven::kTouching;
constexpr double kResting = EventDriven::kResting;
constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
constexpr double kForceShare = 1e-9;    // of the largest force: less is rounding
constexpr double kLocated = 1e-15;      // [s], and of the time
constexpr int kMostLocations = 80;      // substeps taken again for one event
constexpr int kMostNewton = 40;         // of these by models, the others by halves
constexpr double kLeavesFor = 1e-9;     // of a substep: what comes back before has not left
constexpr double kLocatedForce = 1e-3;  // of the tolerance of forces
constexpr std::size_t kStagesWatched = 12;

}  // namespace

// ---- what is watched

// what is watched of a coordinate, which has been read, and with what force its row holds it
void EventDriven::watch_force(const Span& span, std::size_t c, const Reading& reading, double t,
                              std::vector<Watched>* list) const {
  const OneSidedLaw& law = laws_[c];
  const EquationsOfMotion& equations = span.motion->equations();
  const auto found =
      std::find(equations.joints().begin(), equations.joints().end(), static_cast<int>(law.joint));
  const auto link = static_cast<std::size_t>(found - equations.joints().begin());
  const double soft = law.soft.force(reading.q, reading.rate);
  const double rate = states_[c].hold == Hold::kDrive ? zeta(span, c, t).rate
                      : states_[c].hold == Hold::kStill
                          ? 0.0
                          : limit(c, states_[c].hold == Hold::kUpper, t).rate;
  const ForceBounds bounds = force_bounds(law, states_[c].hold, rate, zeta(span, c, t).rate);
  Watched watched;
  watched.law = static_cast<int>(c);
  watched.tolerance = kForceShare * equations.largest_force();
  const auto watch_side = [&](double bound, signed char side) {
    if (!std::isfinite(bound)) return;
    const auto margin = [&](double force) { return side * (bound - force + soft); };
    watched.side = side;
    watched.value = margin(equations.force(link)[law.function]);
    watched.early = 0.0;
    // a force that leaves its bounds within the substep and comes back shows in the stages
    for (std::size_t i = 1; law.soft.is_none() && watched.early == 0.0 && i < kStagesWatched; ++i)
      if (span.accuracy.order == 8 &&
          margin(equations.stage_force(link, i)[law.function]) < -watched.tolerance)
        watched.early = DormandPrince8::kC[i];
    list->push_back(watched);
  };
  watch_side(bounds.least, -1);
  watch_side(bounds.most, 1);
}

// What events wait for, in an order that depends on what rows do alone.
void EventDriven::watch(const Span& span, double t, std::vector<Watched>* list) {
  list->clear();
  const EquationsOfMotion& equations = span.motion->equations();
  equations.find_accelerations(span.motion->state(), span.motion->derivative(), &rates_);
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    const OneSidedLaw& law = laws_[c];
    const OneSidedState& state = states_[c];
    if (is_broken_[law.joint]) continue;
    const Reading reading = read(span, law, t, equations, rates_);
    Watched watched;
    watched.law = static_cast<int>(c);
    const auto watch_rate = [&](double direction, const Course& of) {
      watched.known = 1;
      watched.value = direction * (reading.rate - of.rate);
      watched.rate = direction * (reading.acceleration - of.acceleration);
      watched.tolerance = kEpsilon * (std::abs(reading.rate) + std::abs(of.rate));
      list->push_back(watched);
    };
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(law.limit(upper_one)) || state.is_at(upper_one)) continue;
      const Course at_limit = limit(c, upper_one, t);
      const double direction = upper_one ? -1.0 : 1.0;
      watched.known = 2;
      watched.value = direction * (reading.q - at_limit.value);
      watched.rate = direction * (reading.rate - at_limit.rate);
      watched.acceleration = direction * (reading.acceleration - at_limit.acceleration);
      watched.tolerance = 4.0 * kEpsilon * (std::abs(reading.q) + std::abs(at_limit.value));
      list->push_back(watched);
    }
    if (state.hold != Hold::kNone) watch_force(span, c, reading, t, list);
    if (state.slip != 0) watch_rate(state.slip, {});
    if (state.drive != 0) watch_rate(state.drive, zeta(span, c, t));
    if (state.yield != 0) watch_rate(state.yield, limit(c, state.yield > 0, t));
  }
  if (!breaking_.empty() && equations.redundant_rows() == 0) watch_breaking(span, t, list);
}

void EventDriven::watch_breaking(const Span& span, double t, std::vector<Watched>* list) const {
  const EquationsOfMotion& equations = span.motion->equations();
  for (const Breaking& breaking : breaking_) {
    const auto found = std::find(equations.joints().begin(), equations.joints().end(),
                                 static_cast<int>(breaking.joint));
    if (found == equations.joints().end()) continue;
    const RowVector force =
        equations.force(static_cast<std::size_t>(found - equations.joints().begin()));
    const Joint& joint = joints_[breaking.joint];
    Watched watched;
    watched.breaks = static_cast<int>(breaking.joint);
    double strongest = std::abs(force[0]), turning = 0.0;
    if (!if_distance(joint)) {
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

namespace {

// where a force has its event: just beyond its bound, so that it is told from one that stays; a
// force that starts there may be beyond by its tolerance
template <class Watched>
double aim_of(const Watched& start) {
  return (start.value > start.tolerance ? -kLocatedForce : -1.0) * start.tolerance;
}

// the first root in a substep of h from one end to the other, of what was watched at both and where
// the substep starts
template <class Watched>
std::optional<double> first_crossing(const Watched& from, const Watched& to, double h,
                                     const Watched& start, bool is_all) {
  if (from.known == 0) {
    const double aim = aim_of(start);
    if (!(to.value < (is_all ? -to.tolerance : aim))) return std::nullopt;
    return std::clamp((from.value - aim) / (from.value - to.value), 0.0, 1.0);
  }
  const auto root_of = [&](auto p, double resting, bool is_still) -> std::optional<double> {
    const bool is_falling =
        from.rate < -resting || (from.rate < 0.0 && from.value > from.tolerance && !is_still);
    if (from.value > resting || is_falling) {
      p[0] = std::max(p[0], 0.0);
      return first_root(p);
    }
    if (!is_still && from.rate > 0.0) {
      auto from_zero = p;
      from_zero[0] = 0.0;
      const auto root = first_root_after_zero(from_zero);
      if (!root || *root > kLeavesFor) return root;
    }
    const double start = std::min(p[0], 0.0);  // less is what it starts with, or rounding
    for (double& c : p) c += resting - start;
    return first_root(p);
  };
  const double p0 = from.value, p1 = to.value, v0 = h * from.rate, v1 = h * to.rate;
  if (from.known == 1)
    return root_of(Bernstein<4>{p0, p0 + v0 / 3.0, p1 - v1 / 3.0, p1}, kResting, false);
  const double a0 = h * h * from.acceleration, a1 = h * h * to.acceleration;
  return root_of(Bernstein<6>{p0, p0 + v0 / 5.0, p0 + 2.0 * v0 / 5.0 + a0 / 20.0,
                              p1 - 2.0 * v1 / 5.0 + a1 / 20.0, p1 - v1 / 5.0, p1},
                 kTouching, std::abs(from.rate) <= kResting);
}

}  // namespace

// The earliest crossing that models of what is watched have between two places, h apart. `is_all`:
// these are both ends of a substep.
std::optional<EventDriven::Crossing> EventDriven::earliest(const std::vector<Watched>& from,
                                                           const std::vector<Watched>& to, double h,
                                                           bool is_all) const {
  std::optional<Crossing> first;
  for (std::size_t k = 0; k < from.size(); ++k) {
    if (k < is_muted_.size() && is_muted_[k]) continue;
    std::optional<double> root = first_crossing(from[k], to[k], h, before_[k], is_all);
    if (!root && is_all && to[k].early > 0.0) root = to[k].early;
    if (root && (!first || *root < first->share)) first = Crossing{*root, k};
  }
  return first;
}

// what has passed its event between two places
std::optional<std::size_t> EventDriven::find_passed(const std::vector<Watched>& from,
                                                    const std::vector<Watched>& to) const {
  for (std::size_t k = 0; k < from.size(); ++k) {
    if (k < is_muted_.size() && is_muted_[k]) continue;
    const bool is_still =
        from[k].known == 2 && from[k].value <= kTouching && std::abs(from[k].rate) <= kResting;
    if (to[k].known == 0 ? to[k].value < aim_of(from[k])
        : is_still       ? to[k].value < -kTouching
                         : to[k].value < -to[k].tolerance && to[k].rate < 0.0)
      return k;
  }
  return std::nullopt;
}

// Ends the substep from `start` on where the first event is, and leaves that in after_. Or there is
// none after all, and the whole substep stays.
bool EventDriven::locate(Span* span, const SubstepSpan& start, double h,
                         std::optional<Crossing>* event) {
  RungeKutta& motion = *span->motion;
  const double t = start.t, least = kLocated * std::max(1.0, std::abs(t));
  double low = 0.0, high = 1.0, here = 1.0;
  bool is_passed = find_passed(before_, after_).has_value();
  int low_for = 0, high_for = 0;  // times in a row that the other end has moved
  low_ = before_;
  high_ = after_;
  const auto go_to = [&](double share) {
    here = share;
    if (share * h <= least)
      motion.return_to_start();
    else if (!motion.repeat_substep(rest_of(*span), span->accuracy, t, share * h))
      return false;
    span->left = start;
    if (share * h > least) {
      span->left.left = start.left - share * h;
      span->left.t = start.end - span->left.left;
    }
    motion.equations().store(motion.state(), span->states);
    watch(*span, span->left.t, &after_);
    return true;
  };
  for (int i = 0; i < kMostLocations; ++i) {
    const std::optional<Crossing> next =
        i == 0 ? *event : earliest(low_, high_, (high - low) * h, false);
    if (!next && !is_passed) break;
    double share = low + (next ? next->share : 1.0) * (high - low);
    if (i >= kMostNewton) share = 0.5 * (low + high);
    const bool is_last = is_passed && (high - low) * h <= 2.0 * least;
    if (is_last) share = high;
    if (!go_to(share)) return false;
    if (next) *event = next;
    const Watched& there = after_[(*event)->which];
    const bool is_there =
        there.known == 0 ? std::abs(there.value - aim_of(before_[(*event)->which])) <=
                               0.5 * kLocatedForce * there.tolerance
                         : there.rate < 0.0 && std::abs(there.value) <=
                                                   std::max(there.tolerance, -least * there.rate);
    if (is_there || is_last || share * h <= least) return true;
    if (find_passed(before_, after_)) {
      high = share;
      high_ = after_;
      is_passed = true;
      low_for = 0;
      if (++high_for > 1)
        for (Watched& w : low_)
          if (w.known == 0 && w.value > 0.0) w.value *= 0.5;  // Illinois
    } else {
      low = share;
      low_ = after_;
      high_for = 0;
      if (++low_for > 1)
        for (Watched& w : high_)
          if (w.known == 0 && w.value < -4.0 * w.tolerance) w.value *= 0.5;
    }
  }
  if (here != high && !go_to(high)) return false;
  if (!is_passed) event->reset();
  return true;
}

}  // namespace constraint_sim::engine
