#pragma once

#include <cstdint>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/report.h"
#include "constraint_sim/engine/wrench.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"
#include "engine/model/touching_pair.h"
#include "engine/model/twist.h"

namespace constraint_sim::engine {

/// Part of a joint's impulse that balances itself (self-stress), and the impulse that it was found
/// for [N s].
struct SelfStress {
  RowVector share = RowVector::Zero();
  RowVector impulse = RowVector::Zero();

  bool is_none() const { return share.isZero(0.0) && impulse.isZero(0.0); }
};

/// State of a world, in the order of the lists of Model.
struct State {
  List<BodyState> states;
  List<Twist> corrections;  ///< Baumgarte's part of the velocities in the last step
  bool any_corrections = false;
  List<bool> asleep;  ///< equal for all bodies of an island
  List<JointData> joint_states;
  List<SelfStress> self_stress;
  std::vector<Wrench> wrenches;
  List<TouchingPair> touching;  ///< sorted by TouchingPair::in_order
  List<TouchingPair> resting;   ///< contacts of sleeping bodies, sorted alike

  // Time and step of the last change of the tick, and steps.
  double base_time = 0.0;
  std::uint64_t base_step = 0;
  std::uint64_t step_count = 0;

  /// Subtracts the corrections of the last step from the velocities, and clears them.
  void remove_correction_velocities(const List<int>& bodies) {
    for (const int i : bodies) {
      states[i].linear_velocity -= corrections[i].head<3>();
      states[i].angular_velocity -= corrections[i].tail<3>();
      corrections[i].setZero();
    }
    any_corrections = false;
  }

  /// Simulated time at the end of a step [s].
  double time_of(std::uint64_t step, double time_step) const {
    return base_time + static_cast<double>(step - base_step) * time_step;
  }
  double time(double time_step) const { return time_of(step_count, time_step); }
};

/// Largest distance of the squared length of an orientation from 1. Normalization makes a
/// quaternion zero where its squared length overflows.
inline constexpr double kMostOffUnit = 0.01;
/// Failure of a step that ends in this state: kNotFinite, also without a unit orientation,
/// kOutOfRange, or kNone.
Failure failure_of(const BodyState& body);
/// Whether all of these bodies have states without a failure. Contacts are sought of no others.
bool are_in_range(const State& state, const List<int>& bodies);

}  // namespace constraint_sim::engine
