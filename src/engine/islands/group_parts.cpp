#include "engine/islands/group_parts.h"

#include <algorithm>

#include "engine/islands/motion_bounds.h"
#include "engine/islands/swept_hits.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kRoomRounding = 1e-9;  // rounding of displacements, as a share
// Iterations that count for another solve.
constexpr std::uint32_t kIterationsPerSolve = 10;

}  // namespace

void GroupParts::begin(const GroupSurroundings& around, const ImpulseGroup& group, double done,
                       const List<Broadphase::Pair>& near, const List<TouchingPair>& contacts,
                       const State& state) {
  const double step = around.step.model.options.time_step;
  divided_.begin(around.step, group);
  divided_.begin_joint_sums();
  work_ = 0;
  has_left_any_ = false;
  stage_times_ = {};
  near_ = near;
  const bool is_found = done > 0.0;
  note_rooms(around, is_found ? 0.0 : step, state);
  keep_guesses(is_found ? done : step, contacts, state);
}

void GroupParts::keep_guesses(double h, const List<TouchingPair>& contacts, const State& state) {
  guesses_ = contacts;
  for (TouchingPair& pair : guesses_)
    for (Vector3d& impulse : pair.impulses) impulse /= h;
  joint_guesses_.clear();
  for (const int j : divided_.group().joints)
    joint_guesses_.push_back(
        {state.joint_states[j].impulse / h, state.joint_states[j].coupling_impulse / h});
}

void GroupParts::save(const State& state) {
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

void GroupParts::restore(State* state) const {
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

void GroupParts::place_kinematic(const GroupSurroundings& around, double t, State* state) {
  for (const int body : around.awake.kinematic)
    state->states[body] = moved(around.at_start[body], MassProperties{}, Vector3d::Zero(), t);
}

void GroupParts::collide(const GroupSurroundings& around, double done, double h, bool is_free,
                         State* state) {
  const Model& model = around.step.model;
  place_kinematic(around, done, state);
  state->touching.clear();
  for (const Broadphase::Pair& ends : near_) {
    Manifold manifold =
        engine::collide(model, *state, ends, contact_margin(around.step, *state, ends, h));
    if (is_free) {
      const double open = -kLocatedGap * thinner_of(model, ends);
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

ImpulseReport GroupParts::take(const GroupSurroundings& around, double done, double h,
                               const ContactStep& contacts, ImpulseStepKind kind,
                               SequentialImpulses* method, State* state) {
  const ImpulseGroup& group = divided_.group();
  for (std::size_t k = 0; k < group.joints.size(); ++k) {
    JointData& joint = state->joint_states[group.joints[k]];
    joint.impulse = h * joint_guesses_[k].rows;
    joint.coupling_impulse = h * joint_guesses_[k].coupled;
  }
  ImpulseReport report =
      divided_.advance(around.step, around.wrenches, done, h, contacts, kind, method, state);
  for (std::size_t i = 0; i < kStageCount; ++i)  // also of parts that are not kept
    stage_times_[i] += report.stage_times[i];
  report.stage_times = {};
  work_ += group.bodies.size() * (1 + report.iterations / kIterationsPerSolve);
  return report;
}

// Longest part in which no pair comes nearer than its gap, or than contacts with a gap can tell
// [s]: the plane between two shapes keeps them apart as long as they do not close the gap along its
// normal (Mirtich 1996).
double GroupParts::longest_part(const GroupSurroundings& around, const State& state,
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
                           a.angular_velocity.norm() * swing_radius(model.bodies[pair.first], far) +
                           b.angular_velocity.norm() * swing_radius(model.bodies[pair.second], far);
    if (closing * longest > std::max(apart.gap, known))
      longest = std::max(apart.gap, known) / closing;
  }
  return longest;
}

// Notes how far the bounds of bodies reach that near_ was found by.
void GroupParts::note_rooms(const GroupSurroundings& around, double left, const State& state) {
  rooms_.clear();
  for (const int body : divided_.group().bodies)
    rooms_.push_back(
        {state.states[body].position, max_distance(around.step, state.states[body], body, left)});
}

// Finds the pairs that may touch in the rest of the step again, where a body may leave the bounds
// by which they were found, as after an impact.
void GroupParts::find_pairs_again(const GroupSurroundings& around, double left,
                                  Broadphase* broadphase, const State& state) {
  const List<int>& bodies = divided_.group().bodies;
  bool may_leave = false;
  for (std::size_t i = 0; i < bodies.size() && !may_leave; ++i) {
    const BodyState& body = state.states[bodies[i]];
    may_leave = (body.position - rooms_[i].center).norm() +
                    max_distance(around.step, body, bodies[i], left) >
                (1.0 + kRoomRounding) * rooms_[i].radius;
  }
  if (!may_leave) return;
  near_ = divided_.find_pairs(around.step, state, around.moving_shapes, left, broadphase,
                              &has_left_any_);
  note_rooms(around, left, state);
}

}  // namespace constraint_sim::engine
