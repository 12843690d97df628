#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/prescribed.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Frame of a joint on body B, in B's frame. While a joint with axes closes, the frame moves from
/// the pose that met the rows when closing began to its home pose. Rows then stay near the intended
/// solution from any orientation, and forces act at a single point.
///   p(t) = p + s o,  F(t) = F exp([s ϑ]×),  s from 1 to 0
struct MovingFrame {
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  bool moves = false;
  Eigen::Vector3d anchor_rate = Eigen::Vector3d::Zero();          ///< [m/s]
  Eigen::Vector3d anchor_acceleration = Eigen::Vector3d::Zero();  ///< [m/s²]
  Eigen::Vector3d spin = Eigen::Vector3d::Zero();       ///< angular velocity relative to B [rad/s]
  Eigen::Vector3d spin_rate = Eigen::Vector3d::Zero();  ///< [rad/s²]

  MovingFrame() = default;
  /// Makes the frame at home.
  MovingFrame(const Eigen::Vector3d& anchor_b, const Eigen::Matrix3d& frame_b)
      : anchor(anchor_b), axes(frame_b) {}
  /// Makes the frame at a share `s` of the way from home to the start of closing. `shift` is o [m],
  /// `turn` is ϑ [rad] in the joint's frame on B.
  MovingFrame(const Eigen::Vector3d& anchor_b, const Eigen::Matrix3d& frame_b,
              const Eigen::Vector3d& shift, const Eigen::Vector3d& turn, const Prescribed& s)
      : anchor(anchor_b + s.value * shift),
        axes(frame_b * rotation(s.value * turn).toRotationMatrix()),
        moves(true),
        anchor_rate(s.rate * shift),
        anchor_acceleration(s.acceleration * shift),
        spin(frame_b * (s.rate * turn)),
        spin_rate(frame_b * (s.acceleration * turn)) {}
};

}  // namespace constraint_sim::engine
