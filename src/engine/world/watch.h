#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "constraint_sim/engine/id.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Finds errors that nothing closes, and energy that rises without a cause. Decides nothing.
class Watch {
 public:
  /// Steps after which energies are looked at.
  static constexpr int kWindow = 16;

  /// A joint that is off by more than kUnclosedError or kUnclosedAngle.
  struct Open {
    JointId id;
    double error = 0.0;  ///< from which it has to fall [m]
    double age = 0.0;    ///< time in which it has not [s]
    double closing_since = 0.0;
  };
  List<Open> open, open_before;  ///< in the order of adding

  /// A pair of bodies whose contact impulses hold, in the order of their places.
  struct HeldPair {
    BodyId a, b;
    double overlapping = 0.0;                        ///< for how long too deep [s]
    Eigen::Vector3d slid = Eigen::Vector3d::Zero();  ///< slip of A on B while friction holds [m]
  };
  List<HeldPair> held, held_before;
  /// Bodies that have moved faster than bodies at rest since the last edit; by index, or empty.
  List<char> has_moved;

  // of the window
  int steps = 0;
  double booked = 0.0;  ///< work on islands that impulses advance [J]
  bool any_wrench_ended = false, awake_changed = false;

  double integrated_corrections = 0.0;  ///< work of corrections on smooth islands, in this step [J]

  // of all islands that impulses advance
  double gain = 0.0;  ///< without a cause, since it was least [J]

  // what was found
  double energy_rise = 0.0;  ///< [J]
  BodyId energy_rise_body;
  std::vector<JointId> unclosed;
};

}  // namespace constraint_sim::engine
