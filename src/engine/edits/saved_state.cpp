#include "engine/edits/saved_state.h"

#include <cmath>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/custom_code.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/edits/motor_ends.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

void continue_correction(std::size_t i, const Twist& correction, WorldImpl* world) {
  if (!world->is_movable(i) || world->asleep[i])
    refuse("correction", "is of a dynamic body that is awake");
  for (const Eigen::Vector3d& part :
       {Eigen::Vector3d(correction.head<3>()), Eigen::Vector3d(correction.tail<3>())})
    check_finite("correction", part);
  if (!world->masses[i].can_turn() && !correction.tail<3>().isZero(0.0))
    refuse("correction", "must not turn a point without inertia");
  world->corrections[i] = correction;
  world->any_corrections = true;
  world->bodies[i].state.linear_velocity -= correction.head<3>();
  world->bodies[i].state.angular_velocity -= correction.tail<3>();
}

void continue_joint(std::size_t j, const JointData& saved, WorldImpl* world) {
  const Joint& joint = world->joints[j];
  JointData& state = world->joint_states[j];
  state.travel = saved.travel;
  state.saturated = saved.saturated;
  state.coordinates = saved.coordinates;
  state.expires_at = saved.expires_at;
  state.impulse = saved.impulse;
  state.coupling.constant = saved.coupling.constant;
  state.coupling_impulse = saved.coupling_impulse;
  begin_closing(*world, j, world->time(), world);  // measures the error with the saved travel
  state.closing = saved.closing && is_rigid(joint) && acts(joint, state);
  if (state.closing) {
    state.to_close = saved.to_close;
    state.closing_share = saved.closing_share;
    state.initial_error = saved.initial_error;
  }
  state.coordinates = saved.coordinates;  // begin_closing() read them in another closing frame
  try {
    measure_joint(joint, world->states[world->index(joint.body_a)],
                  world->states[world->index(joint.body_b)],
                  joint_step(world->options, world->time(), world->options.time_step), state);
  } catch (const CustomFailure&) {  // the next step reports the failure
    state.error = kInfinity;
  }
  for (std::size_t i = 0; i < kMaxCoordinates; ++i)
    state.coordinates[i].position = saved.coordinates[i].position;  // to the bit
  world->joint_starts[j].state = state;
  world->joint_starts[j].time = world->time();
  world->edits.note_islands_of(*world, joint);
}

bool is_as_added(const WorldImpl& world, JointId id) {
  const std::size_t j = world.index(id);
  const JointData& state = world.joint_states[j];
  Joint joint = world.joints[j];
  if (info(joint.kind).is_custom) return false;  // adding it might be rejected by its functions
  if (info(joint.kind).couples) {
    if (std::abs(state.coupling.constant) > kMostMagnitude) return false;
    joint.coupling.value = state.coupling.constant;  // scenes save the constant as `value`
  }
  JointData added;
  added.broken = state.broken;
  set_ends(joint, world.time(), &added);
  added.radius = state.radius;
  const BodyState &a = world.states[world.index(joint.body_a)],
                  &b = world.states[world.index(joint.body_b)];
  added.coupling.value = state.coupling.value;
  begin_coordinates(joint, a, b, added);
  begin_joint(joint, a, b, world.time(), added, world.masses[world.index(joint.body_b)].can_turn());
  for (std::size_t i = 0; i < kMaxCoordinates; ++i) {
    const CoordinateState &now = state.coordinates[i], &then = added.coordinates[i];
    if (now.position != then.position || now.held != then.held || now.braking != then.braking ||
        now.expires_at != then.expires_at)
      return false;
  }
  const bool closes_alike = !added.closing || (are_same(state.to_close, added.to_close) &&
                                               state.closing_share == added.closing_share &&
                                               state.initial_error == added.initial_error);
  if (state.coupling.constant != added.coupling.constant || state.coupling_impulse != 0.0)
    return false;
  return state.travel == 0.0 && !state.saturated && state.impulse.isZero(0.0) &&
         state.expires_at == added.expires_at && state.closing == added.closing && closes_alike &&
         world.self_stress[j].is_none();
}

void continue_asleep(const std::vector<BodyId>& ids, WorldImpl* world) {
  for (const BodyId id : ids) world->asleep[world->index(id)] = true;
  world->sleep.continue_from(!ids.empty());  // wakes bodies whose neighbours do not sleep
  world->edits.note_all();
}

void continue_contact(TouchingPair pair, WorldImpl* world) {
  pair.a = static_cast<int>(world->index(pair.id_a));
  pair.b = static_cast<int>(world->index(pair.id_b));
  if (pair.b < pair.a) refuse("body_b", "must have been added after body_a");
  const bool sleeps =
      world->asleep[world->index(pair.id_a)] || world->asleep[world->index(pair.id_b)];
  List<TouchingPair>& pairs = sleeps ? world->resting : world->touching;
  if (!pairs.empty() && !TouchingPair::in_order(pairs.back(), pair))
    refuse("body_a", "contacts must be in the order of their bodies and parts, each once");
  pairs.push_back(pair);
}

}  // namespace constraint_sim::engine
