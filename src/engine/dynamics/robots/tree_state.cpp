#include "engine/dynamics/robots/tree_state.h"

#include "engine/math/elementary.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Matrix3d turn_about(int axis, double angle) {
  const auto [sine, cosine] = math::sin_cos(angle);
  const int first = (axis + 1) % 3, second = (axis + 2) % 3;
  Matrix3d turn = Matrix3d::Identity();
  turn(first, first) = turn(second, second) = cosine;
  turn(second, first) = sine;
  turn(first, second) = -sine;
  return turn;
}

/// Returns the angle of a turn about `axis` that is nearest to the rotation R [rad].
double angle_about(int axis, const Matrix3d& R) {
  const int first = (axis + 1) % 3, second = (axis + 2) % 3;
  return math::atan2(R(second, first) - R(first, second), R(first, first) + R(second, second));
}

/// Returns the angle of a turn about `axis` that a turn about `next` follows, which R has in all
/// [rad]: the first turn takes axis `next` to its column of R.
double angle_before(int axis, int next, const Matrix3d& R) {
  const int first = (axis + 1) % 3, second = (axis + 2) % 3;
  return next == first ? math::atan2(R(second, next), R(first, next))
                       : math::atan2(-R(first, next), R(second, next));
}

double angle_of(const Matrix3d& R) { return rotation_vector(Quaterniond(R)).norm(); }

}  // namespace

TreeState::TreeState(const RobotTree& robot, const List<BodyState>& states) {
  const JointTree& tree = robot.tree();
  y_.assign(tree.size, 0.0);
  roots_.resize(tree.bodies.size());
  origins_.resize(tree.bodies.size());
  List<Frame> nodes;
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const TreeBody& body = tree.bodies[i];
    if (body.parent == kNoIndex) {
      place_root(robot, states, i);
    } else {
      roots_[i] = roots_[body.parent];
      origins_[i] = origins_[body.parent];
    }
    nodes.push_back(frame_of(body, states[robot.bodies()[body.body]], origins_[i]));
    read_joint(tree, i, frame_before(tree, i, nodes), nodes.back());
  }
}

void TreeState::place_root(const RobotTree& robot, const List<BodyState>& states, std::size_t i) {
  const TreeBody& body = robot.tree().bodies[i];
  if (body.fixed == kNoIndex) {
    origins_[i] = states[robot.bodies()[body.body]].position;
    return;
  }
  const IslandModel::FixedPoint& fixed = robot.fixed_points()[body.fixed - robot.bodies().size()];
  const BodyState& base = states[fixed.body];
  const Vector3d &w = base.angular_velocity, arm = base.orientation * fixed.anchor;
  TreeRoot& root = roots_[i];
  origins_[i] = base.position + arm;
  root.velocity = base.linear_velocity + w.cross(arm);
  root.acceleration = w.cross(w.cross(arm));
  if (!fixed.has_axes) return;  // a ball joint turns against axes of the world
  root.axes = base.orientation.toRotationMatrix();
  root.angular_velocity = w;
}

TreeState::Frame TreeState::frame_of(const TreeBody& body, const BodyState& state,
                                     const Vector3d& origin) const {
  Frame frame;
  frame.axes = state.orientation.toRotationMatrix() * body.axes_of_body.transpose();
  const Vector3d arm = -(frame.axes * body.centre);
  frame.point = (state.position - origin) + arm;
  frame.velocity = state.linear_velocity + state.angular_velocity.cross(arm);
  frame.spin = state.angular_velocity;
  return frame;
}

// Returns the frame of the joint on the parent. A free root moves against the axes of the world.
TreeState::Frame TreeState::frame_before(const JointTree& tree, std::size_t i,
                                         const List<Frame>& nodes) const {
  const TreeBody& body = tree.bodies[i];
  if (body.parent == kNoIndex)
    return {roots_[i].axes * body.axes_of_parent, Vector3d::Zero(), roots_[i].velocity,
            roots_[i].angular_velocity};
  const Frame& parent = nodes[body.parent];
  const Vector3d arm = parent.axes * body.place_in_parent;
  return {parent.axes * body.axes_of_parent, parent.point + arm,
          parent.velocity + parent.spin.cross(arm), parent.spin};
}

// Turns go through the anchor on B. There they add nothing to the relative velocity.
void TreeState::read_joint(const JointTree& tree, std::size_t i, const Frame& before,
                           const Frame& node) {
  const TreeBody& body = tree.bodies[i];
  double* const rates = y_.data() + tree.rate_at;
  const Vector3d shift = node.point - before.point, spin = node.spin - before.spin;
  const Vector3d velocity =
      body.is_a ? Vector3d(node.velocity - before.velocity - node.spin.cross(shift))
                : Vector3d(node.velocity - before.velocity - before.spin.cross(shift));
  Matrix3d axes = before.axes;
  Vector3d unmet = shift;
  const std::size_t end = body.turns_freely ? body.end - 3 : body.end;
  for (std::size_t k = body.first; k < end; ++k) {
    const TreeMotion& motion = tree.motions[k];
    const Vector3d axis = axes.col(motion.axis);
    double& x = y_[motion.position];
    if (!motion.turns) {
      x = axis.dot(shift);
      unmet -= x * axis;
      rates[k] = axis.dot(velocity);
      continue;
    }
    const Matrix3d rest = axes.transpose() * node.axes;
    const bool is_followed = k + 1 < end && tree.motions[k + 1].turns;
    x = is_followed ? angle_before(motion.axis, tree.motions[k + 1].axis, rest)
                    : angle_about(motion.axis, rest);
    rates[k] = axis.dot(spin);
    axes *= turn_about(motion.axis, x);
  }
  if (body.link == kNoIndex) {  // a free root: the origin is at its centre
    Vector3d::Map(y_.data() + tree.motions[body.first].position) = origins_[i];
    unmet.setZero();
  }
  if (body.turns_freely) {
    Eigen::Map<Eigen::Vector4d>(y_.data() + body.quaternion) =
        Quaterniond(Matrix3d(axes.transpose() * node.axes)).coeffs();
    Vector3d::Map(rates + end) = node.axes.transpose() * spin;
    axes = node.axes;
  }
  openings_.push_back(unmet.norm() + angle_of(axes.transpose() * node.axes));
}

}  // namespace constraint_sim::engine
