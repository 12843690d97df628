#include "engine/dynamics/kernels/tree_reading.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Returns `value`, the coordinate of a motion at the present pose, unwrapped to the turn noted in
/// CoordinatePositions [m or rad]; unchanged for translations, and for angles that nothing notes.
double with_whole_turns(const EquationsOfMotion& equations, const TreeBody& body,
                        const TreeMotion& motion, double value) {
  const bool is_angle = motion.turns;
  const auto zeroed = [&](double zero, double noted) {
    return is_angle ? unwound(value + zero, noted) - zero : value;
  };
  if (motion.soft != kNoIndex)
    return zeroed(equations.soft_coordinates()[motion.soft].zero,
                  equations.coordinates().soft(motion.soft));
  const auto& coupled = equations.coupled_rows();
  for (std::size_t c = 0; c < coupled.size(); ++c)
    for (std::size_t k = 0; k < 2; ++k)
      if (coupled[c].terms[k].link == body.link &&
          coupled[c].terms[k].coordinate == motion.coordinate)
        return zeroed(coupled[c].terms[k].zero, equations.coordinates().term(c, k));
  return value;
}

/// Reads the coordinates of a joint with axes.
void read_coordinates(const EquationsOfMotion& equations, const JointTree& tree,
                      const TreeBody& body, double* y) {
  double* const rates = y + tree.rate_at;
  const Kinematics& now = equations.kinematics();
  for (std::size_t k = body.first; k < body.end; ++k) {
    if (body.is_of_rotation(k)) break;
    const TreeMotion& motion = tree.motions[k];
    const JointVectors& vectors = now.vectors(body.link);
    const JointMotion& rate = now.motion(body.link);
    if (!motion.turns) {
      const Vector3d axis = vectors.axes_A.col(motion.axis);
      y[motion.position] = motion.sense * axis.dot(vectors.d);
      rates[k] = motion.sense * axis.dot(rate.d_dot - rate.w_A.cross(vectors.d));
      continue;
    }
    const ScalarForm& form =
        forms(equations.links()[body.link].kind).coordinate[to_index(motion.coordinate)];
    const Vector3d axis = motion.axis == 2 ? vectors.axes_A.col(2) : vectors.axes_B.col(2);
    y[motion.position] =
        motion.sense * with_whole_turns(equations, body, motion, value(form, vectors));
    rates[k] = motion.sense * axis.dot(rate.w_B - rate.w_A);
  }
}

/// Reads the rotation of a body in all directions, and the position of a free root.
void read_rotation(const EquationsOfMotion& equations, const JointTree& tree, const TreeBody& body,
                   const TreeRoot& root, double* y) {
  double* const rates = y + tree.rate_at;
  const Kinematics& now = equations.kinematics();
  const auto node = [&](const TreeBody& of) -> Matrix3d {
    return now.orientation()[of.body] * of.axes_of_body.transpose();
  };
  Matrix3d before = body.axes_of_parent;
  Vector3d spin = now.angular_velocity()[body.body];
  if (body.parent != kNoIndex) {
    before = node(tree.bodies[body.parent]) * body.axes_of_parent;
    spin -= now.angular_velocity()[tree.bodies[body.parent].body];
  } else if (body.fixed != kNoIndex) {
    before = root.axes * body.axes_of_parent;
    spin -= root.angular_velocity;
  }
  const Matrix3d after = node(body);
  Eigen::Map<Eigen::Vector4d>(y + body.quaternion) =
      Quaterniond(Matrix3d(before.transpose() * after)).coeffs();
  Vector3d::Map(rates + body.end - 3) = after.transpose() * spin;
  if (body.link != kNoIndex) return;
  Vector3d::Map(y + tree.motions[body.first].position) = now.position()[body.body];
  Vector3d::Map(rates + body.first) = now.velocity()[body.body];
}

}  // namespace

void read_tree(const EquationsOfMotion& equations, const JointTree& tree,
               const List<TreeRoot>& roots, double* y) {
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const TreeBody& body = tree.bodies[i];
    const bool has_axes = body.link != kNoIndex && equations.is_general(body.link);
    if (has_axes) read_coordinates(equations, tree, body, y);
    if (body.turns_freely) read_rotation(equations, tree, body, roots[i], y);
  }
}

}  // namespace constraint_sim::engine
