#pragma once

#include <vector>

#include "engine/world/world_impl.h"

// The state that a saved scene has beside its bodies and joints.

namespace constraint_sim::engine {

/// Continues a saved body. The next step takes `correction` out of its velocity; reset() returns to
/// the velocity without `correction`.
void continue_correction(std::size_t body, const Twist& correction, WorldImpl* world);
/// Continues the state of a joint.
void continue_joint(std::size_t joint, const JointData& saved, WorldImpl* world);
/// Puts the bodies to sleep that slept when the scene was saved. `ids`: these bodies.
void continue_asleep(const std::vector<BodyId>& ids, WorldImpl* world);
/// Adds a contact that existed when the scene was saved.
void continue_contact(TouchingPair pair, WorldImpl* world);
/// Whether a joint with the settings of this joint, added now, would begin with the same state.
bool is_as_added(const WorldImpl& world, JointId id);

}  // namespace constraint_sim::engine
