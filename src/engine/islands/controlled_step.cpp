#include "engine/islands/controlled_step.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/collision/narrowphase.h"
#include "engine/constraints/contact.h"
#include "engine/islands/motion_bounds.h"
#include "engine/islands/swept_hits.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Factor on the estimate before it is compared with the tolerance, and bounds of the factor by
// which a part changes after one that was accepted and after one that was rejected.
constexpr double kSafety = 1.25, kAim = 0.9, kLeastGrowth = 0.3, kMostGrowth = 2.5,
                 kLeastShrink = 0.1, kMostShrink = 0.6;
// Shortest part, as a share of the time step: in shorter ones the residual of impulses counts.
constexpr double kLeastPart = 1.0 / 512.0;
// Bodies of a group, bodies times solves of its step, and parts that were not solved, beyond which
// parts are accepted whatever their error is; and iterations that count for another solve.
constexpr std::size_t kMostBodies = 32, kMostWork = 20000;
constexpr int kMostUnsolved = 4;
constexpr std::uint32_t kIterationsPerSolve = 10;
// Gaps, as shares of the thinner shape: up to which a hit counts as located, and takes part in an
// impact.
constexpr double kLocated = 1e-8, kTouches = 1e-6;
// Error of a part that is taken whole, as a share of the tolerance.
constexpr double kSlow = 0.01;
constexpr int kMostSearches = 8;  // parts by which a hit is located

/// Velocity of the first body relative to the second at a point.
Vector3d rate_at(const State& state, const Broadphase::Pair& pair, const Vector3d& p) {
  const BodyState& a = state.states[pair.first];
  const BodyState& b = state.states[pair.second];
  return a.linear_velocity + a.angular_velocity.cross(p - a.position) - b.linear_velocity -
         b.angular_velocity.cross(p - b.position);
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

bool ControlledStep::is_large() const { return divided_.group().bodies.size() > kMostBodies; }

void ControlledStep::begin(const GroupSurroundings& around, const ImpulseGroup& group,
                           const List<TouchingPair>& contacts, const State& state) {
  divided_.begin(around.step, group);
  divided_.begin_joint_sums();
  outcome_ = Outcome{};
  work_ = 0;
  sums_.clear();
  guesses_ = contacts;
  keep_guesses(around.step.model.options.time_step, state);
}

// Takes over the forces of contacts in guesses_, and of joints, from a part of `h` [s].
void ControlledStep::keep_guesses(double h, const State& state) {
  for (TouchingPair& pair : guesses_)
    for (Vector3d& impulse : pair.impulses) impulse /= h;
  joint_guesses_.clear();
  for (const int j : divided_.group().joints)
    joint_guesses_.push_back(
        {state.joint_states[j].impulse / h, state.joint_states[j].coupling.impulse / h});
}

void ControlledStep::save(const State& state) {
  start_.bodies.clear();
  start_.corrections.clear();
  start_.joints.clear();
  for (const int body : divided_.group().bodies) {
    start_.bodies.push_back(state.states[body]);
    start_.corrections.push_back(state.corrections[body]);
  }
  for (const int j : divided_.group().joints) start_.joints.push_back(state.joint_states[j]);
  start_.touching = state.touching;
  start_.any_corrections = state.any_corrections;
}

void ControlledStep::restore(State* state) const {
  const ImpulseGroup& group = divided_.group();
  for (std::size_t i = 0; i < group.bodies.size(); ++i) {
    state->states[group.bodies[i]] = start_.bodies[i];
    state->corrections[group.bodies[i]] = start_.corrections[i];
  }
  for (std::size_t k = 0; k < group.joints.size(); ++k)
    state->joint_states[group.joints[k]] = start_.joints[k];
  state->touching = start_.touching;
  state->any_corrections = start_.any_corrections;
}

// Finds the contacts of a part of `h` [s] that begins `done` [s] after the start of the step;
// `is_free`: without contacts that are open.
void ControlledStep::collide(const GroupSurroundings& around, double done, double h, bool is_free,
                             State* state) {
  const Model& model = around.step.model;
  for (const int body : around.awake.kinematic)
    state->states[body] = moved(around.at_start[body], MassProperties{}, Vector3d::Zero(), done);
  state->touching.clear();
  for (const Broadphase::Pair& ends : near_) {
    const auto a = to_index(ends.first), b = to_index(ends.second);
    Manifold manifold = engine::collide(PlacedShape(model.bodies[a], state->states[a]),
                                        PlacedShape(model.bodies[b], state->states[b]),
                                        contact_margin(around.step, *state, ends, h));
    if (is_free) {
      const double open = -kLocated * thinner_of(model, ends);
      int kept = 0;
      for (int k = 0; k < manifold.count; ++k)
        if (manifold.points[to_index(k)].depth >= open)
          manifold.points[to_index(kept++)] = manifold.points[to_index(k)];
      manifold.count = kept;
    }
    if (manifold.count == 0) continue;
    TouchingPair& pair = state->touching.emplace_back(new_contact(model, ends));
    pair.manifold = manifold;
    const TouchingPair* known =
        model.options.warm_starting ? find_contact(guesses_, ends) : nullptr;
    for (std::size_t k = 0; known != nullptr && k < to_index(manifold.count); ++k)
      pair.impulses[k] = h * known->impulse_of(manifold.points[k].feature);
  }
}

// Takes a part of `h` [s] with the present contacts.
ImpulseReport ControlledStep::take(const GroupSurroundings& around, double done, double h,
                                   const ContactStep& contacts, ImpulseStepKind kind,
                                   SequentialImpulses* method, State* state) {
  const ImpulseGroup& group = divided_.group();
  for (std::size_t k = 0; k < group.joints.size(); ++k) {
    JointState& joint = state->joint_states[group.joints[k]];
    joint.impulse = h * joint_guesses_[k].rows;
    joint.coupling.impulse = h * joint_guesses_[k].coupled;
  }
  const ImpulseReport report =
      divided_.advance(around.step, around.wrenches, done, h, contacts, kind, method, state);
  work_ += group.bodies.size() * (1 + report.iterations / kIterationsPerSolve);
  return report;
}

// Longest part in which no pair comes nearer than its gap, or than contacts with a gap can tell
// [s]: the plane between two shapes keeps them apart as long as they do not close the gap along its
// normal (Mirtich 1996).
double ControlledStep::longest_part(const GroupSurroundings& around, const State& state,
                                    double left) const {
  const StepContext& step = around.step;
  const Model& model = step.model;
  double longest = left;
  for (const Broadphase::Pair& pair : near_) {
    const BodyState& a = state.states[pair.first];
    const BodyState& b = state.states[pair.second];
    const double known = kMarginShare * thinner_of(model, pair);
    if (max_point_displacement(step, a, pair.first, longest) +
            max_point_displacement(step, b, pair.second, longest) <=
        known)
      continue;
    const Separation apart = separation_of(model, state, pair);
    const double far = (a.position - b.position).norm();
    const double closing = longest * model.options.gravity.norm() -
                           apart.normal.dot(a.linear_velocity - b.linear_velocity) +
                           a.angular_velocity.norm() * reach_of(model.bodies[pair.first], far) +
                           b.angular_velocity.norm() * reach_of(model.bodies[pair.second], far);
    if (closing * longest > std::max(apart.gap, known))
      longest = std::max(apart.gap, known) / closing;
  }
  return longest;
}

// Takes a part whole, then in two halves from its start.
ControlledStep::Attempt ControlledStep::attempt(const GroupSurroundings& around, double done,
                                                double h, bool is_free, SequentialImpulses* method,
                                                State* state) {
  const Model& model = around.step.model;
  Attempt attempt;
  collide(around, done, h, is_free, state);
  save(*state);
  attempt.impulses =
      take(around, done, h, contacts_of(model.options, h), part_kind(), method, state);
  const auto note_solved = [&](const ImpulseReport& report) {
    attempt.is_solved = attempt.is_solved && !report.unsolved_body;
  };
  note_solved(attempt.impulses);
  list_met(model, state->touching);
  const List<int>& bodies = divided_.group().bodies;
  const double slow = error_.bound_where_slow(model, h, bodies, start_.bodies, *state);
  attempt.is_whole = attempt.is_solved && slow <= kSlow * model.options.contact_tolerance * h;
  attempt.error = slow;
  if (attempt.is_whole) return attempt;
  error_.begin(bodies, *state);
  restore(state);
  attempt.impulses = ImpulseReport{};
  attempt.is_solved = true;
  for (const bool is_first : {true, false}) {
    const double start = is_first ? done : done + 0.5 * h;
    collide(around, start, 0.5 * h, is_free, state);
    error_.begin_half(bodies, *state);
    const ImpulseReport half = take(around, start, 0.5 * h, contacts_of(model.options, 0.5 * h),
                                    part_kind(), method, state);
    note_solved(half);
    error_.end_half(model, 0.5 * h, bodies, *state, *method);
    add_impulses(half, &attempt.impulses);
    if (!is_first) break;
    first_half_ = state->touching;
    joints_at_half_.clear();
    for (const int j : divided_.group().joints) joints_at_half_.push_back(state->joint_states[j]);
  }
  attempt.error = error_.largest(model, bodies, *state);
  return attempt;
}

// Lists pairs whose open contacts took an impulse.
void ControlledStep::list_met(const Model& model, const List<TouchingPair>& touching) {
  met_.clear();
  for (const TouchingPair& pair : touching) {
    const double open = -kLocated * thinner_of(model, pair.ends());
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      if (pair.manifold.points[k].depth >= open || pair.impulses[k].isZero(0.0)) continue;
      met_.push_back(pair.ends());
      break;
    }
  }
}

// Takes over the result of an attempt.
void ControlledStep::accept(const GroupSurroundings& around, double h, const Attempt& attempt,
                            State* state) {
  const Model& model = around.step.model;
  const ImpulseGroup& group = divided_.group();
  add_impulses(attempt.impulses, &outcome_.impulses);
  outcome_.error += attempt.is_solved ? attempt.error : std::numeric_limits<double>::quiet_NaN();
  if (!attempt.is_whole) {
    add_contacts(first_half_, &sums_);
    List<JointState> after;
    for (std::size_t k = 0; k < group.joints.size(); ++k) {
      after.push_back(state->joint_states[group.joints[k]]);
      state->joint_states[group.joints[k]] = joints_at_half_[k];
    }
    divided_.sum_joints(model, 0.5 * h, state);
    for (std::size_t k = 0; k < group.joints.size(); ++k)
      state->joint_states[group.joints[k]] = after[k];
    outcome_.substeps += 1;
  }
  const double last = attempt.is_whole ? h : 0.5 * h;
  add_contacts(state->touching, &sums_);
  divided_.sum_joints(model, last, state);
  outcome_.substeps += 1;
  guesses_ = state->touching;
  keep_guesses(last, *state);
}

// Returns the time until the first of the contacts of `met_` closes [s], by parts without open
// contacts; 0 where it is not found. Leaves the group at the start of the part.
double ControlledStep::locate_impact(const GroupSurroundings& around, double done, double h,
                                     SequentialImpulses* method, State* state) {
  const Model& model = around.step.model;
  const List<Broadphase::Pair> met = met_;
  double t = h, least = 0.0, most = h;
  restore(state);
  for (int search = 0; search < kMostSearches; ++search) {
    collide(around, done, t, true, state);
    save(*state);
    take(around, done, t, contacts_of(model.options, t), part_kind(), method, state);
    double off = kInfinity;  // time from here to the impact [s]
    bool is_located = false;
    for (const Broadphase::Pair& ends : met) {
      const double near = kLocated * thinner_of(model, ends);
      const Manifold manifold =
          engine::collide(PlacedShape(model.bodies[ends.first], state->states[ends.first]),
                          PlacedShape(model.bodies[ends.second], state->states[ends.second]),
                          kMarginShare * thinner_of(model, ends));
      for (std::size_t k = 0; k < to_index(manifold.count); ++k) {
        const double rate =
            -rate_at(*state, ends, manifold.points[k].position).dot(manifold.normal);
        const double gap = -manifold.points[k].depth;
        if (!(rate > 0.0) || gap / rate >= off) continue;
        off = gap / rate;
        is_located = std::abs(gap) <= near;
      }
    }
    restore(state);
    if (is_located) return t;
    (off < 0.0 ? most : least) = t;
    const double next = t + off;
    t = next > least && next < most ? next : 0.5 * (least + most);
  }
  return 0.0;
}

// Lets the contacts that are closed meet in no time.
void ControlledStep::meet(const GroupSurroundings& around, double done, double gap,
                          SequentialImpulses* method, State* state) {
  const WorldOptions& options = around.step.model.options;
  const double instant = kInstant * options.time_step;
  collide(around, done, options.time_step, false, state);
  for (TouchingPair& pair : state->touching) {
    const double near = std::max(gap, kTouches * thinner_of(around.step.model, pair.ends()));
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
  const ImpulseReport impulses =
      take(around, done, instant, contact_step(options, kLeastPart * options.time_step),
           ImpulseStepKind::kInstant, method, state);
  add_impulses(impulses, &outcome_.impulses);
  if (impulses.unsolved_body) outcome_.error = std::numeric_limits<double>::quiet_NaN();
  add_contacts(state->touching, &sums_);
  divided_.sum_joints(around.step.model, instant, state);
  ++outcome_.hits;
}

ControlledStep::Outcome ControlledStep::advance(const GroupSurroundings& around,
                                                const ImpulseGroup& group,
                                                const List<Broadphase::Pair>& near,
                                                List<TouchingPair>* contacts,
                                                Broadphase* broadphase, SequentialImpulses* method,
                                                State* state) {
  const WorldOptions& options = around.step.model.options;
  const double step = options.time_step, tolerance = options.contact_tolerance;
  begin(around, group, *contacts, *state);
  near_ = near;
  const double shortest = kLeastPart * step;
  double lump = 0.5 * tolerance * step, h = step;  // lump: error left for what jumps [m]
  double done = 0.0, until_hit = 0.0;              // until_hit: time to a located impact, or 0 [s]
  int unsolved = 0;
  while (done < step && !is_set(around.step.stop) && are_in_range(*state, group.bodies)) {
    const double left = step - done;
    const bool is_free = until_hit > 0.0,
               is_spent = is_large() || work_ > kMostWork || unsolved > kMostUnsolved;
    const double most = longest_part(around, *state, left);
    outcome_.has_left_any = outcome_.has_left_any || most < std::min(left, shortest);
    h = std::max(shortest, is_spent ? most : std::min(h, most));
    double part = is_free ? until_hit : h;
    if (part > (1.0 - kLeastPart) * left) part = left;
    const Attempt tried = attempt(around, done, part, is_free, method, state);
    const double allowed = std::max(floor_of(options), 0.5 * tolerance * part + 0.5 * lump);
    const double ratio = allowed / (kSafety * tried.error);
    if (is_spent || part <= shortest || (tried.is_solved && ratio >= 1.0)) {
      accept(around, part, tried, state);
      lump -= std::max(0.0, tried.error - 0.5 * tolerance * part);
      lump = std::max(lump, 0.0);
      done = part == left ? step : done + part;
      h = part * std::clamp(kAim * std::sqrt(ratio), kLeastGrowth, kMostGrowth);
      if (!is_free) continue;
      until_hit = 0.0;
      h = step;
      meet(around, done, 4.0 * tried.error, method, state);
      near_ = divided_.find_pairs(around.step, *state, around.moving_shapes, step - done,
                                  broadphase, &outcome_.has_left_any);
      continue;
    }
    ++outcome_.rejected;
    unsolved += tried.is_solved ? 0 : 1;
    until_hit = 0.0;
    if (!is_free && !met_.empty() && outcome_.hits < kMostHits)
      until_hit = locate_impact(around, done, part, method, state);
    else
      restore(state);
    if (until_hit == 0.0)
      h = part *
          (tried.is_solved ? std::clamp(kAim * std::sqrt(ratio), kLeastShrink, kMostShrink) : 0.5);
  }
  for (const int body : around.awake.kinematic) state->states[body] = around.at_start[body];
  divided_.finish_joints(around.step, state);
  for (TouchingPair& pair : sums_)
    for (Manifold::Point& point : pair.manifold.points) point.depth = std::max(point.depth, 0.0);
  *contacts = std::move(sums_);
  return outcome_;
}

}  // namespace constraint_sim::engine
