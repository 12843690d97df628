#include "engine/constraints/joint_sum.h"

#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_load.h"

namespace constraint_sim::engine {

void JointSum::add(const Joint& joint, double h, JointData* state) {
  const JointForms& kind = forms(joint.kind);
  state->broken = false;
  rows += state->impulse;
  coupled_rows += state->coupling_impulse;
  coupled += h * state->coupling.effort;
  if (has_length(joint.kind)) {
    done[0] += h * state->force;
    return;
  }
  done.head(kind.rows) += state->impulse.head(kind.rows);
  for (int i = 0; i < kind.coordinates; ++i)
    done[kind.rows + i] += h * state->coordinates[i].effort;
}

void JointSum::finish(const Joint& joint, const BodyState& a, const BodyState& b, double h,
                      JointData* state) const {
  state->impulse = rows;
  state->coupling_impulse = coupled_rows;
  state->coupling.effort = coupled / h;
  if (has_length(joint.kind))
    state->force = done[0] / h;
  else
    note_force(joint, done, h, *state);
  state->broken = is_overloaded(joint, a, b, done, h, *state);
}

}  // namespace constraint_sim::engine
