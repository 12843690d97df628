#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Efforts of motors alone, without those of springs, dampers, friction, limits and couplings,
/// which CoordinateState::effort includes. Refers to a world that must not change.
class ActuatorEfforts {
 public:
  explicit ActuatorEfforts(const engine::World& world);

  /// Returns the effort of the motor of each coordinate of a joint [N or N m]; 0 without a motor.
  /// A servo's follows from its law at the end of the step. The effort of a motor that prescribes a
  /// rate is the mean over the step. A motor at its force limit has that limit.
  std::array<double, engine::kMaxCoordinates> of(engine::JointId joint) const;

 private:
  double coupled(engine::JointId joint, std::size_t coordinate) const;

  const engine::World& world_;
  // efforts of gears and screws, by joint id and coordinate
  std::map<std::pair<std::uint32_t, std::size_t>, double> coupled_;
};

}  // namespace constraint_sim
