#pragma once

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/anchor_pair.h"

namespace constraint_sim::engine {

// The distance joint, the tutorial's constraint scaled by ‖d‖ so that it is in metres:
//   C = ‖d‖ − L                      d = x_B + r_B − x_A − r_A,  n = d/‖d‖
//   Ċ = n·ḋ                          so J = (−n, −r_A × n, n, r_B × n)
//   K = J M⁻¹ Jᵀ                     the tutorial's "constraint mass"
// L is the length plus the motor's travel. Each limit has a one-sided row, with its own end for L.

/// n; of coincident anchors, where C has no gradient, the x axis of the world.
Eigen::Vector3d direction(const AnchorPair& anchors);

/// How much longer than it should be [m]; within limits 0. `travel` is the motor's.
double distance_error(const DistanceJoint& joint, double distance, double travel);

/// Writes the rows of the joint and returns how many: one for a rod or spring, one for each
/// limit. C and J are set; of a spring `softness` stays 0. Limits are one-sided in `lower`,
/// `upper`.
int write_distance_rows(const DistanceJoint& joint, const AnchorPair& anchors, double travel,
                        Row* rows);

/// Whether the anchors are free between the limits, with no length of their own.
inline bool is_between_limits(const DistanceJoint& joint) {
  return joint.is_limited() && !joint.is_soft();
}

/// The lowest travel [m] that leaves a length to wind at: a motor stops at 1 % of it.
double least_travel(const DistanceJoint& joint);

}  // namespace constraint_sim::engine
