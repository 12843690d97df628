#pragma once

#include <array>

#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

/// Edits of one joint of a world, whose new settings were checked before.
class JointEdits {
 public:
  struct LawChange {
    bool law = false, motor = false;  ///< the timeout of a changed motor begins now
  };
  using LawChanges = std::array<LawChange, kMaxCoordinates>;

  JointEdits(WorldImpl* world, std::size_t joint) : world_(*world), j_(joint) {}

  /// Sets the state of a joint that was just added.
  void start();
  /// Replaces the settings by `joint`, which is valid and filled in. The caller notes the edit.
  void replace(const Joint& joint, const LawChanges& changes);
  /// Sets the law of a coordinate. `is_motor_set`: the timeout of the motor begins now.
  void set_law(std::size_t coordinate, const CoordinateLaw& law, bool is_motor_set);
  /// Begins a joint anew that starts or ceases to act.
  void restart();
  /// Lets the velocity motors of a joint that was just measured hold its present coordinates.
  void hold_from_here();

 private:
  /// Disables or breaks a coupling where a joint that it couples starts disabled or broken.
  void end_with_coupled(const Coupling& coupling);
  /// Updates the state of a coordinate to a changed law. Returns whether a motor holds another
  /// position.
  bool follow_law(std::size_t coordinate, const CoordinateLaw& before, bool is_motor_set);
  /// Adds the change of a coordinate's zero to the values and constants of its couplings.
  void shift_couplings(int coordinate, double change);

  WorldImpl& world_;
  std::size_t j_;
};

}  // namespace constraint_sim::engine
