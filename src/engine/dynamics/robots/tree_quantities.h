#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/spatial_inertia.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/dynamics/robots/tree_state.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Terms of the equations H ẍ + b = τ in the coordinates x of a JointTree at a state, and their
/// derivatives. Constant after construction. Springs, dampers and couplings are left out.
class TreeQuantities {
 public:
  /// Evaluates the tree. `gravity`: acceleration of free fall per body of the island [m/s²]. The
  /// tree must outlive the object.
  TreeQuantities(const JointTree& tree, const TreeState& state,
                 const List<Eigen::Vector3d>& gravity);

  /// H, symmetric.
  const Eigen::MatrixXd& mass() const { return mass_; }
  /// b: forces that keep all rates constant.
  const Eigen::VectorXd& bias() const { return bias_; }
  /// Forces that carry the weights at rest: part of b.
  const Eigen::VectorXd& weight() const { return weight_; }
  const Eigen::VectorXd& rates() const { return rates_; }

  /// Motion of a point of a body in world axes: derivatives by the rates, velocity, and
  /// acceleration with zero ẍ. Linear motion stands above angular motion.
  struct PointMotion {
    Eigen::Matrix<double, 6, Eigen::Dynamic> J;
    Eigen::Matrix<double, 6, 1> velocity, bias;
  };
  /// Returns the motion of the point at `arm` from the centre of mass, in axes of the body [m].
  PointMotion motion_of(std::size_t body, const Eigen::Vector3d& arm) const;
  /// Axes of a body in the world, and its centre relative to the origin of its tree [m].
  Eigen::Matrix3d axes(std::size_t body) const {
    return dynamics_.placed(body).axes * tree_.bodies[body].axes_of_body;
  }
  const Eigen::Vector3d& centre(std::size_t body) const { return dynamics_.placed(body).centre; }

  /// Derivatives of the forces H ẍ + b by position and rate. Positions change along directions of
  /// motions. A rotation by three angles changes by a small rotation vector in axes of the child.
  struct Derivatives {
    Eigen::MatrixXd by_position, by_rate;
  };
  Derivatives derivatives(const Eigen::VectorXd& acceleration) const;

 private:
  /// Motions, momentum and force of each body for given ẍ, and force of each subtree.
  struct Forces {
    List<SpatialVector> acceleration, momentum, of_subtree;
  };
  /// Motion that is being displaced: velocity and acceleration before it, and velocity behind it.
  struct Displaced {
    std::size_t motion, body;
    SpatialVector velocity_before, acceleration_before, velocity_behind;
  };
  /// Changes of the force of each subtree by a displacement and by a rate.
  struct Changes {
    List<SpatialVector> by_position, by_rate;
    List<char> is_moved;
  };

  SpatialVector momentum(std::size_t body, const SpatialVector& motion) const;
  SpatialVector weight_on(std::size_t body) const;
  Forces forces(const Eigen::VectorXd& acceleration) const;
  void add_change(const Displaced& displaced, const Forces& forces, std::size_t body,
                  Changes* changes) const;
  void write_column(const Displaced& displaced, const Forces& forces, Changes* changes,
                    Derivatives* derivatives) const;

  const JointTree& tree_;
  TreeDynamics dynamics_;
  List<Eigen::Vector3d> gravity_;
  Eigen::MatrixXd mass_;
  Eigen::VectorXd bias_, weight_, rates_;
};

}  // namespace constraint_sim::engine
