#include "engine/dynamics/kernels/articulated_tree.h"

#include <algorithm>
#include <cmath>

#include "engine/dynamics/kernel_view.h"

namespace constraint_sim::engine {

ArticulatedTree::ArticulatedTree(EquationsOfMotion& equations)
    : tree_(joint_tree_of(equations, *equations.kernel_view().tree)) {
  if (tree_.bodies.empty()) return;
  dynamics_ = TreeDynamics(tree_);
  if (!tree_.closings.empty()) {
    closings_ = TreeClosings(tree_, equations);
    for (const TreeBody& body : tree_.bodies)
      if (body.link != kNoIndex) equations.redundant().require(equations, body.link);
  }
  numbers_.assign(StageMemory::kRows * tree_.size, 0.0);
  work_.assign(tree_.size, 0.0);
  noted_.assign(tree_.motions.size(), 0.0);
  roots_.resize(tree_.bodies.size());
}

bool ArticulatedTree::can_advance(const EquationsOfMotion& equations) const {
  if (tree_.bodies.empty() || is_left_to_rows()) return false;
  const bool has_dependent = equations.delassus().redundant() > 0;
  if (closings_.empty() ? has_dependent : equations.redundant().is_passing()) return false;
  const auto& motions = equations.inputs().motions();
  return std::none_of(motions.begin(), motions.end(),
                      [](const auto& motion) { return motion.second.is_closing(); });
}

void ArticulatedTree::note_size() {
  size_ = 0.0;
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) {
    size_ = std::max(size_, dynamics_.placed(i).centre.cwiseAbs().maxCoeff());
    size_ = std::max(size_, std::sqrt(tree_.bodies[i].squared_gyration));
  }
}

void ArticulatedTree::find_accelerations(Motions* rates) const {
  dynamics_.add_accelerations(tree_);
  rates->linear.resize(tree_.bodies.size());
  rates->angular.resize(tree_.bodies.size());
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) {
    const TreeDynamics::Placed& at = dynamics_.placed(i);
    const SpatialVector acceleration = at.bias + dynamics_.added(i);
    const std::size_t body = tree_.bodies[i].body;
    rates->angular[body] = acceleration.angular;
    rates->linear[body] = acceleration.linear + acceleration.angular.cross(at.centre) +
                          at.motion.angular.cross(dynamics_.velocity(i));
  }
}

}  // namespace constraint_sim::engine
