#pragma once

#include "engine/constraints/anchor_pair.h"

namespace constraint_sim::engine {

// The ball joint: both anchors in one point, three rows along the axes e_i of the world.
//   C_i = e_i·d,  J_i = (−e_i, −r_A × e_i, e_i, r_B × e_i)
// This is also what a distance joint of length zero becomes, whose own gradient vanishes.

inline int write_ball_rows(const AnchorPair& anchors, Row* rows) {
  for (int i = 0; i < 3; ++i) {
    rows[i].J = anchors.along(Eigen::Vector3d::Unit(i));
    rows[i].C = anchors.d[i];
  }
  return 3;
}

}  // namespace constraint_sim::engine
