#include "engine/islands/coordinate_motions.h"

#include <cmath>

#include "engine/constraints/joint.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

JointStep step_from_now(const Model& model, const State& state) {
  const double h = model.options.time_step;
  return joint_step(model.options, state.time(h), h);
}

}  // namespace

CoordinateMotions::CoordinateMotions(const Model& model, const State& state, std::size_t joint)
    : joint_(joint) {
  const Joint& moved = model.joints[joint];
  JointData now = state.joint_states[joint];
  if (info(moved.kind).coordinates == 0 || !acts(moved, now)) return;
  const JointStep step = step_from_now(model, state);
  measure_joint(moved, state.states[model.index(moved.body_a)],
                state.states[model.index(moved.body_b)], step, now);
  for (int i = 0; i < info(moved.kind).coordinates; ++i)
    motions_[to_index(i)] = motion_before(moved, now, i, step.t, step.closing_time);
}

CoordinateMotions::Flags CoordinateMotions::are_prescribed() const {
  Flags are{};
  for (std::size_t i = 0; i < kMaxCoordinates; ++i)
    are[i] = motions_[i].left > 0.0 && std::isfinite(motions_[i].left);
  return are;
}

void CoordinateMotions::send(const Model& model, const Flags& is_sent, State* state) const {
  const Joint& joint = model.joints[joint_];
  JointData& joint_state = state->joint_states[joint_];
  const JointStep step = step_from_now(model, *state);
  if (step.closing_time == 0.0 || !acts(joint, joint_state)) return;
  for (int i = 0; i < info(joint.kind).coordinates; ++i)
    if (is_sent[to_index(i)])
      send_coordinate(joint, i, motions_[to_index(i)], step.t, step.closing_time, joint_state);
}

}  // namespace constraint_sim::engine
