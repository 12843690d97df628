#include "engine/world/robot_coordinates.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "engine/constraints/forms.h"
#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Returns the body that moves by each motion.
List<std::size_t> bodies_of_motions(const JointTree& tree) {
  List<std::size_t> bodies(tree.motions.size());
  for (std::size_t i = 0; i < tree.bodies.size(); ++i)
    for (std::size_t k = tree.bodies[i].first; k < tree.bodies[i].end; ++k) bodies[k] = i;
  return bodies;
}

/// Place of a motion in the order of coordinates: its joint in the order of adding, behind a free
/// base; then coordinates with laws, shifts, turns.
using Place = std::array<std::size_t, 3>;

Place place_of(const RobotInWorld& from, const TreeBody& body, const TreeMotion& motion) {
  const std::size_t joint = body.link == kNoIndex ? 0 : 1 + from.joint_of(body);
  if (body.link != kNoIndex && motion.coordinate >= 0)
    return {joint, 0, to_index(motion.coordinate)};
  return {joint, motion.turns ? 2u : 1u, motion.axis};
}

/// Returns −1 where the coordinate of the joint is −x.
double sense_of(const TreeBody& body, const TreeMotion& motion, std::size_t k) {
  return body.is_of_rotation(k) ? 1.0 : motion.sense;
}

}  // namespace

RobotCoordinates::RobotCoordinates(const RobotInWorld& from)
    : body_of_(bodies_of_motions(from.robot.tree())) {
  choose_leaders(from);
  read_positions(from);
  for (const std::size_t k : leaders_) coordinates_.push_back(coordinate(from, k));
  const JointTree& tree = from.robot.tree();
  for (std::size_t k = 0; k < tree.motions.size(); ++k)
    if (leaders_[column_[k]] != k)
      followers_.push_back({from.model.joint_ids[from.joint_of(tree.bodies[body_of_[k]])],
                            tree.motions[k].coordinate, column_[k],
                            tree.motions[k].sense * factor_[k]});
}

// The first motion in the order of coordinates leads the motions that couplings join with it.
void RobotCoordinates::choose_leaders(const RobotInWorld& from) {
  const JointTree& tree = from.robot.tree();
  List<std::pair<Place, std::size_t>> places;
  for (std::size_t k = 0; k < tree.motions.size(); ++k)
    places.emplace_back(place_of(from, tree.bodies[body_of_[k]], tree.motions[k]), k);
  std::sort(places.begin(), places.end());
  List<std::size_t> coordinate_of_source(tree.motions.size(), kNoIndex);
  column_.resize(tree.motions.size());
  factor_.resize(tree.motions.size());
  for (const auto& [place, k] : places) {
    const TreeMotion& motion = tree.motions[k];
    std::size_t& coordinate = coordinate_of_source[motion.source == kNoIndex ? k : motion.source];
    if (coordinate == kNoIndex) {
      coordinate = leaders_.size();
      leaders_.push_back(k);
    }
    const std::size_t leader = leaders_[coordinate];
    column_[k] = coordinate;
    factor_[k] = motion.factor / tree.motions[leader].factor *
                 sense_of(tree.bodies[body_of_[leader]], tree.motions[leader], leader);
  }
}

void RobotCoordinates::read_positions(const RobotInWorld& from) {
  const JointTree& tree = from.robot.tree();
  for (std::size_t k = 0; k < tree.motions.size(); ++k) {
    const TreeBody& body = tree.bodies[body_of_[k]];
    const TreeMotion& motion = tree.motions[k];
    double& q = position_.emplace_back(std::numeric_limits<double>::quiet_NaN());
    if (body.is_of_rotation(k)) continue;
    q = motion.sense * from.pose.data()[motion.position];
    if (body.link == kNoIndex || motion.coordinate < 0) continue;
    const std::size_t j = from.joint_of(body);
    q += from.model.joints[j].coordinates[motion.coordinate].zero;
    if (motion.turns)
      q = unwound(q, from.state.joint_states[j].coordinates[motion.coordinate].position);
  }
}

RobotCoordinate RobotCoordinates::coordinate(const RobotInWorld& from, std::size_t k) const {
  const JointTree& tree = from.robot.tree();
  const TreeBody& body = tree.bodies[body_of_[k]];
  const TreeMotion& motion = tree.motions[k];
  RobotCoordinate made;
  made.is_angle = motion.turns;
  made.position = position_[k];
  made.velocity = sense_of(body, motion, k) * from.pose.data()[tree.rate_at + k];
  const bool is_free = body.link == kNoIndex;
  if (is_free) {
    made.name = from.model.bodies[from.robot.bodies()[body.body]].name;
  } else {
    const std::size_t j = from.joint_of(body);
    made.joint = from.model.joint_ids[j];
    made.name = from.model.joints[j].name;
    made.coordinate = motion.coordinate;
  }
  if (made.coordinate < 0)
    made.name += std::string(motion.turns ? "/angular_" : "/linear_") + "xyz"[motion.axis];
  else if (body.end - body.first > 1)
    made.name += "/" + std::to_string(motion.coordinate);
  return made;
}

VectorXd RobotCoordinates::motions(const VectorXd& u) const {
  VectorXd x(static_cast<Index>(column_.size()));
  for (std::size_t k = 0; k < column_.size(); ++k) x[k] = factor_[k] * u[column_[k]];
  return x;
}

VectorXd RobotCoordinates::reduced(const VectorXd& f) const {
  VectorXd sum = VectorXd::Zero(static_cast<Index>(leaders_.size()));
  for (std::size_t k = 0; k < column_.size(); ++k) sum[column_[k]] += factor_[k] * f[k];
  return sum;
}

MatrixXd RobotCoordinates::reduced(const MatrixXd& H) const {
  const auto n = static_cast<Index>(leaders_.size());
  MatrixXd sum = MatrixXd::Zero(n, n);
  for (std::size_t k = 0; k < column_.size(); ++k)
    for (std::size_t j = 0; j < column_.size(); ++j)
      sum(column_[k], column_[j]) += factor_[k] * factor_[j] * H(k, j);
  return sum;
}

}  // namespace constraint_sim::engine
