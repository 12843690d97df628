#pragma once

#include "engine/islands/islands.h"
#include "engine/islands/method_choice.h"
#include "engine/islands/topology.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Bounds of the frequencies at which springs move each body [rad/s].
struct FastestSprings {
  List<double> springs;  ///< springs and dampers without a force limit
  List<double> limited;  ///< springs and servos with a force limit, and springs that only pull

  FastestSprings(const Model& model, const List<JointData>& joint_states,
                 const List<JointEnds>& ends);
};

/// Properties of an island that decide its method.
IslandTraits traits_of(const Model& model, const IslandMembers& members,
                       const FastestSprings& fastest);

}  // namespace constraint_sim::engine
