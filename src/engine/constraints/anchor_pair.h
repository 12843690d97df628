#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/model/jacobian.h"

namespace constraint_sim::engine {

/// Arms and separation of the two anchors of a joint. r: arm from a body's centre to its anchor; d:
/// from anchor A to anchor B; world axes [m].
struct AnchorPair {
  Eigen::Vector3d r_A, r_B, p_A, d;

  [[gnu::always_inline]] AnchorPair(const Joint& joint, const BodyState& a, const BodyState& b)
      : r_A(arm(a, joint.anchor_a)),
        r_B(arm(b, joint.anchor_b)),
        p_A(a.position + r_A),
        d(b.position + r_B - p_A) {}

  /// Returns the arm in world axes; an anchor at the centre needs no rotation.
  static Eigen::Vector3d arm(const BodyState& body, const Eigen::Vector3d& anchor) {
    if (anchor.isZero(0.0)) return anchor;
    return body.orientation * anchor;
  }

  /// Returns ḋ = v_B + ω_B × r_B − v_A − ω_A × r_A.
  Eigen::Vector3d d_dot(const BodyState& a, const BodyState& b) const {
    return b.linear_velocity + b.angular_velocity.cross(r_B) - a.linear_velocity -
           a.angular_velocity.cross(r_A);
  }

  /// Returns the Jacobian of n·d for a constant n: J = (−n, −r_A × n, n, r_B × n).
  Jacobian along(const Eigen::Vector3d& n) const { return {-n, -r_A.cross(n), n, r_B.cross(n)}; }
};

}  // namespace constraint_sim::engine
