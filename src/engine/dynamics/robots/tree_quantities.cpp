#include "engine/dynamics/robots/tree_quantities.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Rate of a motion that moves with `motion`.
SpatialVector carried_motion(const SpatialVector& motion, const SpatialVector& of) {
  return {motion.angular.cross(of.linear) + motion.linear.cross(of.angular),
          motion.angular.cross(of.angular)};
}

/// Rate of a force, or of a momentum, that moves with `motion`.
SpatialVector carried_force(const SpatialVector& motion, const SpatialVector& of) {
  return {motion.angular.cross(of.linear),
          motion.angular.cross(of.angular) + motion.linear.cross(of.linear)};
}

}  // namespace

TreeQuantities::TreeQuantities(const JointTree& tree, const TreeState& state,
                               const List<Vector3d>& gravity)
    : tree_(tree), dynamics_(tree), gravity_(gravity) {
  const std::size_t motions = tree.motions.size();
  rates_ = VectorXd::Map(state.data() + tree.rate_at, static_cast<Eigen::Index>(motions));
  dynamics_.place(tree, state.roots(), state.data());
  const List<Vector3d> no_torque(gravity.size(), Vector3d::Zero());
  dynamics_.evaluate(tree, gravity.data(), no_torque.data());
  mass_.setZero(static_cast<Eigen::Index>(motions), static_cast<Eigen::Index>(motions));
  for (std::size_t k = 0; k < motions; ++k)
    for (std::size_t j = k; j != kNoIndex; j = tree.motions[j].before)
      mass_(k, j) = mass_(j, k) = dynamics_.entry(k, tree.motions[j].depth);

  List<SpatialVector> weights;
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) weights.push_back(weight_on(i));
  bias_.resize(static_cast<Eigen::Index>(motions));
  weight_.resize(static_cast<Eigen::Index>(motions));
  for (std::size_t i = tree.bodies.size(); i-- > 0;) {
    const TreeBody& body = tree.bodies[i];
    for (std::size_t k = body.first; k < body.end; ++k) {
      bias_[k] = dynamics_.direction(k).dot(dynamics_.transmitted(i));
      weight_[k] = -dynamics_.direction(k).dot(weights[i]);
    }
    if (body.parent != kNoIndex) weights[body.parent] = weights[body.parent] + weights[i];
  }
}

SpatialVector TreeQuantities::weight_on(std::size_t i) const {
  const Vector3d weight = tree_.bodies[i].mass * gravity_[tree_.bodies[i].body];
  return {weight, centre(i).cross(weight)};
}

// Returns the momentum of a body at a motion, about the origin; a force at an acceleration.
SpatialVector TreeQuantities::momentum(std::size_t i, const SpatialVector& motion) const {
  const Matrix3d& axes = dynamics_.placed(i).axes;
  const Vector3d linear = tree_.bodies[i].mass * (motion.linear + motion.angular.cross(centre(i)));
  const Vector3d spin = axes.transpose() * motion.angular;
  const Vector3d own = axes * Vector3d(tree_.bodies[i].inertia * spin);
  return {linear, own + centre(i).cross(linear)};
}

TreeQuantities::PointMotion TreeQuantities::motion_of(std::size_t i, const Vector3d& arm) const {
  const TreeDynamics::Placed& at = dynamics_.placed(i);
  const Vector3d point = at.centre + axes(i) * arm;
  PointMotion found;
  found.J.setZero(6, mass_.cols());
  for (std::size_t b = i; b != kNoIndex; b = tree_.bodies[b].parent)
    for (std::size_t k = tree_.bodies[b].first; k < tree_.bodies[b].end; ++k) {
      const SpatialVector& direction = dynamics_.direction(k);
      found.J.col(k) << direction.linear + direction.angular.cross(point), direction.angular;
    }
  const Vector3d velocity = at.motion.linear + at.motion.angular.cross(point);
  found.velocity << velocity, at.motion.angular;
  found.bias << at.bias.linear + at.bias.angular.cross(point) + at.motion.angular.cross(velocity),
      at.bias.angular;
  return found;
}

// ---- derivatives, seen from axes that are carried along
//
// A displacement along direction S of motion j carries all bodies behind j. Seen from axes that are
// carried, these bodies stay, and what is before j moves by −S: velocity and acceleration before j
// change by v × S and a × S, weights by −S × weight. The forces on bodies before j change by the
// turned force S ×* F of the subtree in addition. (As Carpentier and Mansard, "Analytical
// Derivatives of Rigid Body Dynamics Algorithms", 2018, by other means.)

TreeQuantities::Forces TreeQuantities::forces(const VectorXd& acceleration) const {
  const std::size_t bodies = tree_.bodies.size();
  Forces found;
  List<SpatialVector> added(bodies);
  for (std::size_t i = 0; i < bodies; ++i) {
    const TreeBody& body = tree_.bodies[i];
    const TreeDynamics::Placed& at = dynamics_.placed(i);
    if (body.parent != kNoIndex) added[i] = added[body.parent];
    for (std::size_t k = body.first; k < body.end; ++k)
      added[i] = added[i] + dynamics_.direction(k) * acceleration[k];
    found.acceleration.push_back(at.bias + added[i]);
    found.momentum.push_back(momentum(i, at.motion));
    found.of_subtree.push_back(momentum(i, found.acceleration[i]) +
                               carried_force(at.motion, found.momentum[i]) - weight_on(i));
  }
  for (std::size_t i = bodies; i-- > 0;)
    if (const std::size_t parent = tree_.bodies[i].parent; parent != kNoIndex)
      found.of_subtree[parent] = found.of_subtree[parent] + found.of_subtree[i];
  return found;
}

// Writes how the force on body i, behind the displaced motion, changes.
void TreeQuantities::add_change(const Displaced& displaced, const Forces& forces, std::size_t i,
                                Changes* changes) const {
  const SpatialVector& S = dynamics_.direction(displaced.motion);
  const SpatialVector& v = dynamics_.placed(i).motion;
  const SpatialVector& h = forces.momentum[i];
  const SpatialVector relative = carried_motion(displaced.velocity_before, S);  // v_before × S

  const SpatialVector by_position = carried_motion(displaced.acceleration_before, S) +
                                    carried_motion(relative, v - displaced.velocity_before);
  const Vector3d turned = -S.angular.cross(weight_on(i).linear);
  changes->by_position[i] = momentum(i, by_position) + carried_force(relative, h) +
                            carried_force(v, momentum(i, relative)) -
                            SpatialVector{turned, centre(i).cross(turned)};
  const SpatialVector by_rate = relative + carried_motion(S, v - displaced.velocity_behind);
  changes->by_rate[i] =
      momentum(i, by_rate) + carried_force(S, h) + carried_force(v, momentum(i, S));
}

void TreeQuantities::write_column(const Displaced& displaced, const Forces& forces,
                                  Changes* changes, Derivatives* derivatives) const {
  const std::size_t j = displaced.motion, first = displaced.body;
  std::fill(changes->is_moved.begin(), changes->is_moved.end(), 0);
  for (std::size_t i = first; i < tree_.bodies.size(); ++i) {
    const std::size_t parent = tree_.bodies[i].parent;
    if (i != first && (parent == kNoIndex || changes->is_moved[parent] == 0)) continue;
    changes->is_moved[i] = 1;
    add_change(displaced, forces, i, changes);
  }
  const auto write = [&](std::size_t k, const SpatialVector& position, const SpatialVector& rate) {
    derivatives->by_position(k, j) = dynamics_.direction(k).dot(position);
    derivatives->by_rate(k, j) = dynamics_.direction(k).dot(rate);
  };
  const TreeBody& body = tree_.bodies[first];
  // Directions of a rotation by three angles are all carried by each of them.
  const std::size_t carried = body.is_of_rotation(j) ? body.end - 3 : j;
  for (std::size_t i = tree_.bodies.size(); i-- > first;) {
    if (changes->is_moved[i] == 0) continue;
    const std::size_t begin = i == first ? carried : tree_.bodies[i].first;
    for (std::size_t k = begin; k < tree_.bodies[i].end; ++k)
      write(k, changes->by_position[i], changes->by_rate[i]);
    if (i == first) break;
    for (auto* of : {&changes->by_position, &changes->by_rate})
      (*of)[tree_.bodies[i].parent] = (*of)[tree_.bodies[i].parent] + (*of)[i];
  }
  const SpatialVector by_position =
      changes->by_position[first] + carried_force(dynamics_.direction(j), forces.of_subtree[first]);
  for (std::size_t k = tree_.motions[carried].before; k != kNoIndex; k = tree_.motions[k].before)
    write(k, by_position, changes->by_rate[first]);
}

TreeQuantities::Derivatives TreeQuantities::derivatives(const VectorXd& acceleration) const {
  const Forces found = forces(acceleration);
  Derivatives derivatives;
  derivatives.by_position.setZero(mass_.rows(), mass_.cols());
  derivatives.by_rate = derivatives.by_position;
  Changes changes;
  changes.by_position.resize(tree_.bodies.size());
  changes.by_rate.resize(tree_.bodies.size());
  changes.is_moved.resize(tree_.bodies.size());
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) {
    const TreeBody& body = tree_.bodies[i];
    SpatialVector v = dynamics_.placed(i).motion, a = found.acceleration[i];
    for (std::size_t end = body.end; end > body.first;) {
      const std::size_t begin = body.is_of_rotation(end - 1) ? end - 3 : end - 1;
      const SpatialVector behind = v;
      SpatialVector rate, change;
      for (std::size_t k = begin; k < end; ++k) {
        rate = rate + dynamics_.direction(k) * rates_[k];
        change = change + dynamics_.direction(k) * acceleration[k];
      }
      v = v - rate;
      a = a - change - carried_motion(v, rate);
      for (std::size_t k = begin; k < end; ++k)
        write_column({k, i, v, a, behind}, found, &changes, &derivatives);
      end = begin;
    }
  }
  return derivatives;
}

}  // namespace constraint_sim::engine
