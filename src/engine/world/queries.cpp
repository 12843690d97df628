// Bodies and joints of a world by their ids. Markers and messages ask for each of them in every
// round, so these functions are optimized as the stages of a step are.

#include "engine/math/list.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

// Kept out of line: inlined, each index() would reserve stack for the text.
template <class Id>
[[noreturn, gnu::noinline]] void refuse_unknown(const char* field, Id id) {
  refuse(field, "there is none with id " + std::to_string(id.value));
}

}  // namespace

std::size_t Model::index(BodyId id) const {
  const int place = find(id);
  if (place < 0) refuse_unknown("body", id);
  return to_index(place);
}

std::size_t Model::index(JointId id) const {
  const int place = find(id);
  if (place < 0) refuse_unknown("constraint", id);
  return to_index(place);
}

const Body& World::body(BodyId id) const { return impl_->bodies[impl_->index(id)]; }
const BodyState& World::state(BodyId id) const { return impl_->states[impl_->index(id)]; }
const Joint& World::joint(JointId id) const { return impl_->joints[impl_->index(id)]; }
const JointState& World::joint_state(JointId id) const {
  return impl_->joint_states[impl_->index(id)];
}

}  // namespace constraint_sim::engine
