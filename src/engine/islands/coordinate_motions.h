#pragma once

#include <array>
#include <cstddef>

#include "engine/constraints/closing_errors.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Motions of the coordinates of a joint, with which the coordinates go on to positions of motors.
class CoordinateMotions {
 public:
  using Flags = std::array<bool, kMaxCoordinates>;

  CoordinateMotions(const Model& model, const State& state, std::size_t joint);

  /// Returns the coordinates that a position motor moves along a prescribed motion.
  Flags are_prescribed() const;
  /// Sends coordinates to the positions of their motors at the present time. Before,
  /// begin_closing() or measure_joint() has measured the joint.
  void send(const Model& model, const Flags& is_sent, State* state) const;

 private:
  std::size_t joint_;
  std::array<MotionBefore, kMaxCoordinates> motions_;
};

}  // namespace constraint_sim::engine
