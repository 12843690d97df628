#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "constraint_sim/engine/robot_dynamics.h"
#include "engine/dynamics/robots/robot_tree.h"
#include "engine/dynamics/robots/tree_state.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// A robot in its world: `joints` are the indices in the world of the joints of `robot`.
struct RobotInWorld {
  const Model& model;
  const State& state;
  const List<std::size_t>& joints;
  const RobotTree& robot;
  const TreeState& pose;

  std::size_t joint_of(const TreeBody& body) const { return joints[robot.joints()[body.link]]; }
};

/// Coordinates of a robot, in the order of RobotDynamics, and the motions of its tree by them:
/// ẋ = G u̇, where each row of G has one entry.
class RobotCoordinates {
 public:
  explicit RobotCoordinates(const RobotInWorld& from);

  const std::vector<RobotCoordinate>& all() const { return coordinates_; }
  const std::vector<RobotFollower>& followers() const { return followers_; }

  /// Returns G u.
  Eigen::VectorXd motions(const Eigen::VectorXd& u) const;
  /// Returns Gᵀ f.
  Eigen::VectorXd reduced(const Eigen::VectorXd& f) const;
  /// Returns Gᵀ H G.
  Eigen::MatrixXd reduced(const Eigen::MatrixXd& H) const;
  /// Position of a motion along the coordinate of its joint, as RobotCoordinate [m or rad].
  double position(std::size_t motion) const { return position_[motion]; }
  /// Coordinate that a motion follows.
  std::size_t coordinate_of(std::size_t motion) const { return column_[motion]; }

 private:
  void choose_leaders(const RobotInWorld& from);
  void read_positions(const RobotInWorld& from);
  RobotCoordinate coordinate(const RobotInWorld& from, std::size_t motion) const;

  List<std::size_t> body_of_;  // body that moves, per motion
  List<double> position_;      // per motion, as RobotCoordinate
  List<std::size_t> leaders_;  // motion of each coordinate
  List<std::size_t> column_;   // coordinate, per motion
  List<double> factor_;        // entry of G, per motion
  std::vector<RobotCoordinate> coordinates_;
  std::vector<RobotFollower> followers_;
};

}  // namespace constraint_sim::engine
