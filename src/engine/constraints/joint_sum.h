#pragma once

#include "constraint_sim/engine/joint.h"

namespace constraint_sim::engine {

/// What impulses did to a joint in the parts of a tick.
struct JointSum {
  RowVector rows = RowVector::Zero();        ///< to warm start
  RowVector done = RowVector::Zero();        ///< with what acts on coordinates
  double coupled_rows = 0.0, coupled = 0.0;  ///< the same of a coupling

  /// Adds what a part of `h` did. A joint that broke by it alone is whole again.
  void add(const Joint& joint, double h, JointState* state);
  /// Sets the mean forces of a tick of `h`, and breaks the joint where they are too much.
  void finish(const Joint& joint, const BodyState& a, const BodyState& b, double h,
              JointState* state) const;
};

}  // namespace constraint_sim::engine
