#include "engine/model/state.h"

namespace constraint_sim::engine {

Eigen::Vector3d TouchingPair::impulse_of(std::uint32_t feature) const {
  for (std::size_t k = 0; k < to_index(manifold.count); ++k)
    if (manifold.points[k].feature == feature) return impulses[k];
  return Eigen::Vector3d::Zero();
}

}  // namespace constraint_sim::engine
