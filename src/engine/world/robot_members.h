#pragma once

#include <cstddef>
#include <vector>

#include "engine/dynamics/robots/robot_tree.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Returns the dynamic bodies among `ids`. Throws std::invalid_argument("body: why") where there is
/// none.
List<std::size_t> dynamic_bodies(const Model& model, const std::vector<BodyId>& ids);

/// Returns the joints of the robot with these dynamic bodies, in the order of adding: acting joints
/// between bodies, and gears between their coordinates. Throws std::invalid_argument("body: why")
/// naming a joint where joints close a loop, and where a joint cannot be part of a tree.
List<std::size_t> joints_of_robot(const Model& model, const State& state,
                                  const List<std::size_t>& bodies);

/// Returns the joints with these indices in the world, as RobotTree takes them.
RobotJoints robot_joints(const Model& model, const List<std::size_t>& joints);

/// Throws std::invalid_argument("body: why") where a robot was not compiled as trees with
/// coordinates. `joints`: those of joints_of_robot().
void check_robot(const Model& model, const List<std::size_t>& joints, const RobotTree& robot);

}  // namespace constraint_sim::engine
