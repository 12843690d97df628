#include "engine/dynamics/robots/robot_tree.h"

#include <numeric>
#include <utility>

namespace constraint_sim::engine {
namespace {

List<int> all_of(const RobotJoints& robot) {
  List<int> indices(robot.joints.size());
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

}  // namespace

// A list of open joints keeps the bodies in the order of the world, where an island of ball joints
// would be sorted along its chain.
RobotTree::RobotTree(const RobotJoints& robot, const List<MassProperties>& masses, std::size_t body)
    : IslandModel(all_of(robot), robot.joints, robot.ends, masses, robot.couplings, {},
                  List<char>(robot.joints.size(), 0)) {
  if (robot.joints.empty()) {
    bodies_.push_back(static_cast<int>(body));
    rotating_ = masses[body].can_turn() ? 1 : 0;
    inverse_mass_.push_back(masses[body].inverse_mass);
    inertia_.push_back(masses[body].inertia);
    radius_of_gyration_.push_back(masses[body].radius_of_gyration());
  }
  BodyTree tree = tree_of(*this);
  tree_ = whole_joint_tree_of(*this, tree);
  nodes_ = std::move(tree.nodes);
}

}  // namespace constraint_sim::engine
