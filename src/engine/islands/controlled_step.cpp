#include "engine/islands/controlled_step.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/collision/narrowphase.h"
#include "engine/constraints/contact.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Factor on the estimate before it is compared with the tolerance, and bounds of the factor by
// which a part changes after one that was accepted and after one that was rejected.
constexpr double kPartSafety = 1.25, kAim = 0.9, kLeastPartGrowth = 0.3, kMostPartGrowth = 2.5,
                 kLeastShrink = 0.1, kMostShrink = 0.6;
// Shortest part, as a share of the time step: in shorter ones the residual of impulses counts.
constexpr double kLeastPart = 1.0 / 512.0;
// Bodies of a group, bodies times solves of its step, and parts that were not solved, beyond which
// parts are accepted whatever their error is.
constexpr std::size_t kMostControlledBodies = 32, kMostWork = 20000;
constexpr int kMostUnsolved = 4;
// Gaps up to which contacts take part in an impact, at least and at most, as shares of the thinner
// shape.
constexpr double kTouches = 1e-6, kMostTouches = 1e-3;
// Share of the error that is allowed which the approach of a closed contact uses up where it is an
// impact.
constexpr double kImpactShare = 0.25;
// Error of a part that is taken whole, as a share of the tolerance.
constexpr double kNegligibleShare = 0.01;
constexpr int kMostSearches = 8;  // parts by which a hit is located

/// Velocity of the first body relative to the second at a point.
Vector3d rate_at(const State& state, const Broadphase::Pair& pair, const Vector3d& p) {
  const BodyState& a = state.states[pair.first];
  const BodyState& b = state.states[pair.second];
  return a.linear_velocity + a.angular_velocity.cross(p - a.position) - b.linear_velocity -
         b.angular_velocity.cross(p - b.position);
}

bool has_feature(const TouchingPair& pair, std::uint32_t feature) {
  const auto& points = pair.manifold.points;
  return std::any_of(points.begin(), points.begin() + pair.manifold.count,
                     [&](const Manifold::Point& point) { return point.feature == feature; });
}

/// Settings of the contacts of a part of `h` [s]: parts close errors as a step does.
ContactStep contacts_of(const WorldOptions& options, double h) {
  ContactStep contacts = contact_step(options, h);
  contacts.beta *= h / options.time_step;
  return contacts;
}

/// Error that residuals of contacts at rest make [m].
double floor_of(const WorldOptions& options) {
  return kConvergedRest * options.gravity.norm() * options.time_step * options.time_step;
}

}  // namespace

ImpulseStepKind ControlledStep::part_kind() const {
  return parts_.bodies().size() > kMostControlledBodies ? ImpulseStepKind::kLargePart
                                                        : ImpulseStepKind::kPart;
}

// Takes a part whole, then in two halves from its start.
ControlledStep::Attempt ControlledStep::attempt(const GroupSurroundings& around, double done,
                                                double h, bool is_free, SequentialImpulses* method,
                                                State* state) {
  const Model& model = around.step.model;
  Attempt attempt;
  parts_.collide(around, done, h, is_free, state);
  parts_.save(*state);
  attempt.impulses =
      parts_.take(around, done, h, contacts_of(model.options, h), part_kind(), method, state);
  const auto note_solved = [&](const ImpulseReport& report) {
    attempt.is_solved = attempt.is_solved && !report.unsolved_body && !report.has_swept;
  };
  note_solved(attempt.impulses);
  list_met(model, state->touching);
  const List<int>& bodies = parts_.bodies();
  const auto is_out_of_range = [&] {
    if (are_in_range(*state, bodies)) return false;
    attempt.is_solved = false;
    attempt.is_whole = true;
    return true;
  };
  if (is_out_of_range()) return attempt;
  const double slow = error_.bound_where_slow(model, h, bodies, parts_.start().bodies, *state);
  attempt.is_whole =
      attempt.is_solved && slow <= kNegligibleShare * model.options.contact_tolerance * h;
  attempt.error = slow;
  if (attempt.is_whole) return attempt;
  error_.begin(bodies, *state);
  parts_.restore(state);
  attempt.impulses = ImpulseReport{};
  attempt.is_solved = true;
  for (const bool is_first : {true, false}) {
    const double start = is_first ? done : done + 0.5 * h;
    parts_.collide(around, start, 0.5 * h, is_free, state);
    error_.begin_half(bodies, *state);
    const ImpulseReport half = parts_.take(
        around, start, 0.5 * h, contacts_of(model.options, 0.5 * h), part_kind(), method, state);
    note_solved(half);
    error_.end_half(model, 0.5 * h, bodies, *state, *method);
    add_impulses(half, &attempt.impulses);
    if (!is_first || is_out_of_range()) break;
    first_half_ = state->touching;
    joints_at_half_.clear();
    for (const int j : parts_.joints()) joints_at_half_.push_back(state->joint_states[j]);
  }
  if (!attempt.is_whole) attempt.error = error_.largest(model, bodies, *state);
  return attempt;
}

// Lists pairs whose open contacts took an impulse.
void ControlledStep::list_met(const Model& model, const List<TouchingPair>& touching) {
  met_.clear();
  for (const TouchingPair& pair : touching) {
    const double open = -kLocatedGap * thinner_of(model, pair.shapes());
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      if (pair.manifold.points[k].depth >= open || pair.impulses[k].isZero(0.0)) continue;
      met_.push_back(pair.shapes());
      break;
    }
  }
}

// Accepts an attempted part: adds its impulses, error and joint forces to the sums of the step.
void ControlledStep::accept(const GroupSurroundings& around, double h, const Attempt& attempt,
                            State* state) {
  const Model& model = around.step.model;
  const List<int>& joints = parts_.joints();
  add_impulses(attempt.impulses, &outcome_.impulses);
  outcome_.error += attempt.is_solved ? attempt.error : std::numeric_limits<double>::quiet_NaN();
  if (!attempt.is_whole) {
    add_contacts(first_half_, &sums_);
    List<JointData> after;
    for (std::size_t k = 0; k < joints.size(); ++k) {
      after.push_back(state->joint_states[joints[k]]);
      state->joint_states[joints[k]] = joints_at_half_[k];
    }
    parts_.sum_joints(model, 0.5 * h, state);
    for (std::size_t k = 0; k < joints.size(); ++k) state->joint_states[joints[k]] = after[k];
    outcome_.substeps += 1;
  }
  const double last = attempt.is_whole ? h : 0.5 * h;
  add_contacts(state->touching, &sums_);
  parts_.sum_joints(model, last, state);
  outcome_.substeps += 1;
  parts_.keep_guesses(last, state->touching, *state);
}

// Returns the time until the first of the contacts of `met_` closes [s], by parts without open
// contacts; 0 where it is not found. Leaves the group at the start of the part.
double ControlledStep::locate_impact(const GroupSurroundings& around, double done, double h,
                                     SequentialImpulses* method, State* state) {
  const Model& model = around.step.model;
  const List<Broadphase::Pair> met = met_;
  double t = h, least = 0.0, most = h;
  parts_.restore(state);
  for (int search = 0; search < kMostSearches; ++search) {
    parts_.collide(around, done, t, true, state);
    parts_.save(*state);
    parts_.take(around, done, t, contacts_of(model.options, t), part_kind(), method, state);
    if (!are_in_range(*state, parts_.bodies())) break;
    GroupParts::place_kinematic(around, done + t, state);
    double off = kInfinity;  // time from here to the impact [s]
    bool is_located = false;
    for (const Broadphase::Pair& ends : met) {
      const double near = kLocatedGap * thinner_of(model, ends);
      const Manifold manifold =
          engine::collide(model, *state, ends, kMarginShare * thinner_of(model, ends));
      const TouchingPair* const closed = find_contact(parts_.start().touching, ends);
      for (std::size_t k = 0; k < to_index(manifold.count); ++k) {
        const Manifold::Point& point = manifold.points[k];
        if (closed != nullptr && has_feature(*closed, point.feature)) continue;
        const double rate = -rate_at(*state, ends, point.position).dot(manifold.normal);
        const double gap = -point.depth;
        if (!(rate > 0.0) || gap / rate >= off) continue;
        off = gap / rate;
        is_located = std::abs(gap) <= near;
      }
    }
    parts_.restore(state);
    if (is_located) return t;
    (off < 0.0 ? most : least) = t;
    const double next = t + off;
    t = next > least && next < most ? next : 0.5 * (least + most);
  }
  parts_.restore(state);
  return 0.0;
}

// Whether a contact that was closed where the part began approaches faster than `speed` [m/s].
bool ControlledStep::approaches_closed(const Model& model, double speed, const State& state) const {
  for (const TouchingPair& pair : parts_.start().touching) {
    const double closed = -kTouches * thinner_of(model, pair.shapes());
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      const Manifold::Point& point = pair.manifold.points[k];
      if (point.depth >= closed &&
          -rate_at(state, pair.shapes(), point.position).dot(pair.manifold.normal) > speed)
        return true;
    }
  }
  return false;
}

// Applies the impact of a contact that was closed where the rejected part began, or finds the time
// until a contact closes. False where no impact made the error; the group is at the start of the
// part then.
bool ControlledStep::turn_to_impact(const GroupSurroundings& around, double done, double part,
                                    double allowed, SequentialImpulses* method, double* until_hit,
                                    State* state) {
  parts_.restore(state);
  if (approaches_closed(around.step.model, kImpactShare * allowed / part, *state)) {
    apply_impacts(around, done, 0.0, method, state);
    return true;
  }
  if (!met_.empty()) *until_hit = locate_impact(around, done, part, method, state);
  return *until_hit > 0.0;
}

// Applies the impacts of the contacts that are closed, in no time.
void ControlledStep::apply_impacts(const GroupSurroundings& around, double done, double gap,
                                   SequentialImpulses* method, State* state) {
  const WorldOptions& options = around.step.model.options;
  const double instant = kInstantDuration * options.time_step;
  parts_.collide(around, done, options.time_step, false, state);
  for (TouchingPair& pair : state->touching) {
    const double thinner = thinner_of(around.step.model, pair.shapes());
    const double near = std::clamp(gap, kTouches * thinner, kMostTouches * thinner);
    int kept = 0;
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      if (pair.manifold.points[k].depth < -near) continue;
      Manifold::Point& point = pair.manifold.points[to_index(kept)];
      point = pair.manifold.points[k];
      point.depth = 0.0;
      pair.impulses[to_index(kept++)].setZero();
    }
    pair.manifold.count = kept;
  }
  state->touching.erase(
      std::remove_if(state->touching.begin(), state->touching.end(),
                     [](const TouchingPair& pair) { return pair.manifold.count == 0; }),
      state->touching.end());
  const ImpulseReport impulses =
      parts_.take(around, done, instant, contact_step(options, kLeastPart * options.time_step),
                  ImpulseStepKind::kInstant, method, state);
  add_impulses(impulses, &outcome_.impulses);
  if (impulses.unsolved_body) outcome_.error = std::numeric_limits<double>::quiet_NaN();
  add_contacts(state->touching, &sums_);
  parts_.sum_joints(around.step.model, instant, state);
  ++outcome_.hits;
}

// Sets the results of the whole step.
void ControlledStep::finish(const GroupSurroundings& around, List<TouchingPair>* contacts,
                            State* state) {
  for (const int body : around.awake.kinematic) state->states[body] = around.at_start[body];
  parts_.finish_joints(around.step, state);
  for (TouchingPair& pair : sums_)
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k)
      if (!pair.impulses[k].isZero(0.0))
        pair.manifold.points[k].depth = std::max(pair.manifold.points[k].depth, 0.0);
  *contacts = std::move(sums_);
  outcome_.has_left_any = outcome_.has_left_any || parts_.has_left_any();
  outcome_.impulses.stage_times = parts_.stage_times();
}

// Begins the sums of the step with the part of it that is over, of `done` [s].
void ControlledStep::begin_sums(const Model& model, double done, const List<TouchingPair>& contacts,
                                State* state) {
  sums_.clear();
  if (done == 0.0) return;
  sums_ = contacts;
  parts_.sum_joints(model, done, state);
}

ControlledStep::Outcome ControlledStep::advance(const GroupSurroundings& around,
                                                const ImpulseGroup& group, double start,
                                                const List<Broadphase::Pair>& near,
                                                List<TouchingPair>* contacts,
                                                Broadphase* broadphase, SequentialImpulses* method,
                                                State* state) {
  const WorldOptions& options = around.step.model.options;
  const double step = options.time_step, tolerance = options.contact_tolerance;
  parts_.begin(around, group, start, near, *contacts, *state);
  outcome_ = Outcome{};
  begin_sums(around.step.model, start, *contacts, state);
  const bool is_large = group.bodies.size() > kMostControlledBodies;
  const double shortest = kLeastPart * step;
  double lump = 0.5 * tolerance * step, h = step;  // lump: error left for what jumps [m]
  double done = start, until_hit = 0.0;            // until_hit: time to a located impact, or 0 [s]
  int unsolved = 0;
  while (done < step && !is_set(around.step.stop) && are_in_range(*state, group.bodies)) {
    const double left = step - done;
    const bool is_free = until_hit > 0.0;
    const bool is_spent = is_large || parts_.work() > kMostWork || unsolved > kMostUnsolved;
    GroupParts::place_kinematic(around, done, state);
    parts_.find_pairs_again(around, left, broadphase, *state);
    const double most = parts_.longest_part(around, *state, left);
    outcome_.has_left_any = outcome_.has_left_any || most < std::min(left, shortest);
    h = std::max(shortest, is_spent ? most : std::min(h, most));
    double part = std::min(left, is_free ? until_hit : h);
    if (!is_free && most >= left && part > (1.0 - kLeastPart) * left) part = left;
    Attempt tried = attempt(around, done, part, is_free, method, state);
    const double allowed = std::max(floor_of(options), 0.5 * tolerance * part + 0.5 * lump);
    const double ratio = tried.is_solved ? allowed / (kPartSafety * tried.error) : 0.0;
    if (!is_spent && !is_free && ratio < 1.0 && outcome_.hits < kMostHits) {
      if (turn_to_impact(around, done, part, allowed, method, &until_hit, state)) {
        ++outcome_.rejected;
        h = step;
        continue;
      }
      if (part <= shortest) tried = attempt(around, done, part, is_free, method, state);
    }
    if (is_spent || part <= shortest || ratio >= 1.0) {
      accept(around, part, tried, state);
      lump -= std::max(0.0, tried.error - 0.5 * tolerance * part);
      lump = std::max(lump, 0.0);
      done = part == left ? step : done + part;
      h = part * std::clamp(kAim * std::sqrt(ratio), kLeastPartGrowth, kMostPartGrowth);
      if (!is_free) continue;
      until_hit = 0.0;
      h = step;
      apply_impacts(around, done, 4.0 * tried.error, method, state);
      continue;
    }
    unsolved += tried.is_solved ? 0 : 1;
    parts_.restore(state);
    ++outcome_.rejected;
    until_hit = 0.0;
    h = part *
        (tried.is_solved ? std::clamp(kAim * std::sqrt(ratio), kLeastShrink, kMostShrink) : 0.5);
  }
  finish(around, contacts, state);
  return outcome_;
}

}  // namespace constraint_sim::engine
