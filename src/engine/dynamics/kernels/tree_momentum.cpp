#include "engine/dynamics/kernels/tree_momentum.h"

#include <Eigen/LU>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

TreeMomentum::TreeMomentum(const JointTree& tree, const TreeDynamics& dynamics) {
  SpatialVector momentum;
  CompositeInertia whole;
  dynamics.find_momentum(tree, &momentum, &whole);
  mass = whole.mass;
  centre = whole.moment / mass;
  linear = momentum.linear;
  angular = momentum.angular - centre.cross(linear);
  inertia = whole.inertia.matrix() + whole.moment * centre.transpose();
  inertia.diagonal().array() -= centre.dot(whole.moment);
}

void TreeMomentum::keep(const JointTree& tree, const List<TreeRoot>& roots, const TreeLoads& loads,
                        double h, const double* start, TreeDynamics* dynamics, double* y) {
  Vector3d force = Vector3d::Zero(), torque = Vector3d::Zero();
  bool falls = true;  // whether all bodies have the same acceleration by loads
  for (const TreeBody& body : tree.bodies) {
    const Vector3d& acceleration = loads.acceleration[body.body];
    force += body.mass * acceleration;
    torque += loads.torque[body.body];
    falls = falls && acceleration == loads.acceleration[tree.bodies.front().body];
  }
  double* const rates = y + tree.rate_at;
  dynamics->place(tree, roots, y);
  const TreeMomentum now(tree, *dynamics);
  Vector3d turned = Vector3d::Zero();
  if (falls) {
    turned = now.inertia.inverse() * (angular + h * torque - now.angular);
    Vector3d::Map(rates + 3) += dynamics->placed(0).axes.transpose() * turned;
  }
  const Vector3d before = linear;
  linear += h * force;
  Vector3d::Map(rates) += (linear - now.linear) / now.mass - turned.cross(now.centre);
  Vector3d::Map(y) =
      Vector3d::Map(start) + (centre - now.centre) + h / now.mass * (before + 0.5 * h * force);
  centre = now.centre;
  angular = falls ? Vector3d(angular + h * torque) : now.angular;
}

}  // namespace constraint_sim::engine
