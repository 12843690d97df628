#include "engine/dynamics/kernels/tree_writing.h"

#include <Eigen/Geometry>

#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Calls `visit(body, position, axes, velocity, angular_velocity)` for each body of the island.
template <class Visit>
void for_each_body(const TreeInInterval& in, const Vector3d& root, const Visit& visit) {
  for (std::size_t i = 0; i < in.tree.bodies.size(); ++i) {
    const TreeBody& body = in.tree.bodies[i];
    const TreeDynamics::Placed& at = in.dynamics.placed(i);
    const Vector3d& origin = body.fixed == kNoIndex ? root : in.view.position[body.fixed];
    visit(body.body, Vector3d(origin + at.centre), Matrix3d(at.axes * body.axes_of_body),
          in.dynamics.velocity(i), at.motion.angular);
  }
}

}  // namespace

void scatter_tree(const TreeInInterval& in, const Vector3d& root, List<BodyState>* states) {
  for_each_body(in, root,
                [&](std::size_t body, const Vector3d& position, const Matrix3d& axes,
                    const Vector3d& velocity, const Vector3d& angular_velocity) {
                  BodyState& state = (*states)[in.equations.bodies()[body]];
                  state.position = position;
                  state.linear_velocity = velocity;
                  state.angular_velocity = angular_velocity;
                  Quaterniond q(axes);
                  if (q.coeffs().dot(state.orientation.coeffs()) < 0.0) q.coeffs() = -q.coeffs();
                  normalize_quaternions(q.coeffs().data(), 1);
                  state.orientation = q;
                });
}

void write_tree_state(const TreeInInterval& in, const Vector3d& root, double* y) {
  const StateLayout& layout = in.equations.layout();
  for_each_body(in, root,
                [&](std::size_t body, const Vector3d& position, const Matrix3d& axes,
                    const Vector3d& velocity, const Vector3d& angular_velocity) {
                  Vector3d::Map(y + 3 * body) = position;
                  Vector3d::Map(y + layout.v_at + 3 * body) = velocity;
                  Eigen::Map<Eigen::Vector4d>(y + layout.q_at + 4 * body) =
                      Quaterniond(axes).coeffs();
                  const Vector3d along = axes.transpose() * angular_velocity;
                  Vector3d::Map(y + layout.L_at + 3 * body) =
                      axes * in.equations.inertia(body).cwiseProduct(along);
                });
}

}  // namespace constraint_sim::engine
