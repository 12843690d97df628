#pragma once

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/anchor_pair.h"
#include "engine/constraints/row.h"

namespace constraint_sim::engine {

// The distance joint, the tutorial's constraint divided by ‖d‖, so that C is in metres:
//   C = ‖d‖ − L                      d = x_B + r_B − x_A − r_A,  n = d/‖d‖
//   Ċ = n·ḋ                          so J = (−n, −r_A × n, n, r_B × n)
//   K = J M⁻¹ Jᵀ                     the tutorial's "constraint mass"
// L is the length plus the motor's travel. Each limit is a one-sided row with its own L.

/// Most rows of the joint: the spring and both limits.
inline constexpr int kMaxDistanceRows = 3;

/// Returns n = d/‖d‖; for coincident anchors, where C has no gradient, the x axis of the world.
Eigen::Vector3d direction(const AnchorPair& anchors);

/// Returns the error of the length [m], positive where it is too long; 0 between limits, and where
/// a spring that only pulls is slack. `travel` is the motor's travel [m].
double distance_error(const DistanceJoint& joint, double distance, double travel);

/// Writes C, J and bounds of the rows of the joint and returns their number, at most
/// kMaxDistanceRows: one for a rod or spring, one for each limit. `softness` of a spring stays 0.
/// Rows of limits are one-sided by `lower` and `upper`.
int write_distance_rows(const DistanceJoint& joint, const AnchorPair& anchors, double travel,
                        Row* rows);

/// Returns the length that the k-th row of write_distance_rows() holds at a travel of 0 [m].
double length_of_row(const DistanceJoint& joint, int k);

/// Whether the anchors are free between limits, without a rod or spring.
inline bool is_between_limits(const DistanceJoint& joint) {
  return joint.is_limited() && !joint.is_soft();
}

/// Returns the lowest travel of the motor [m], which leaves 1 % of the length.
double least_travel(const DistanceJoint& joint);

}  // namespace constraint_sim::engine
