#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/report.h"
#include "constraint_sim/engine/wrench.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"
#include "engine/model/shape_pair.h"
#include "engine/model/twist.h"

namespace constraint_sim::engine {

/// Two convex shapes of bodies in contact, with the contact impulses of the last step. A pair that
/// is about to hit has no points.
struct TouchingPair {
  static std::array<Eigen::Vector3d, 8> no_impulses() {
    std::array<Eigen::Vector3d, 8> impulses;
    impulses.fill(Eigen::Vector3d::Zero());
    return impulses;
  }

  int a = 0, b = 0;
  BodyId id_a, id_b;           ///< ids stay when removals move the indices
  int part_a = 0, part_b = 0;  ///< numbers of the shapes in their bodies
  Manifold manifold;
  /// Impulse of each point on A, world [N s].
  std::array<Eigen::Vector3d, 8> impulses = no_impulses();
  std::array<ContactState, 8> contact_states{};  ///< state of each point after the last step

  std::pair<int, int> ends() const { return {a, b}; }
  ShapePair shapes() const { return {a, b, part_a, part_b}; }
  /// Orders pairs by the indices of their bodies, then by their parts.
  static bool in_order(const TouchingPair& l, const TouchingPair& r) {
    return l.shapes() < r.shapes();
  }
  /// Returns the impulse of the point with this feature in the last step; zero for a new point.
  Eigen::Vector3d impulse_of(std::uint32_t feature) const;
};

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
