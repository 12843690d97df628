#pragma once

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Impulses of a joint, summed over the parts of a tick.
struct JointSum {
  RowVector rows = RowVector::Zero();  ///< impulses for warm starting
  RowVector done = RowVector::Zero();  ///< impulses per row and coordinate, laws included
  /// Impulses of a coupling, for warm starting and in total.
  double coupled_rows = 0.0, coupled = 0.0;

  /// Adds the impulses of a part of length `h` [s], and repairs a joint that broke in this part:
  /// finish() decides by the mean of the tick.
  void add(const Joint& joint, double h, JointData* state);
  /// Sets the mean forces of a tick of length `h` [s], and breaks the joint where they exceed its
  /// limits.
  void finish(const Joint& joint, const BodyState& a, const BodyState& b, double h,
              JointData* state) const;
};

}  // namespace constraint_sim::engine
