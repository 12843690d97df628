#pragma once

#include "engine/islands/island_lists.h"
#include "engine/islands/island_parts.h"
#include "engine/islands/topology.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Joints without axes that close an error. Their equations have another form.
List<int> open_points_of(const Model& model, const List<JointData>& joint_states,
                         const IslandMembers& members);

/// Compiles the equations of motion of an island with joints.
void compile_island(const Model& model, const Topology& topology, const List<int>& open_points,
                    IslandParts* parts, List<IslandMotion>* motions);

/// Classifies all islands, and compiles the islands that are integrated and have no equations yet,
/// or equations of other laws.
void compile_islands(const Model& model, const State& state, const Topology& topology,
                     IslandLists* lists);

}  // namespace constraint_sim::engine
