#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/regularized_rows.h"
#include "engine/dynamics/rigid_motion.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Masses of the bodies of an island, rotating bodies first, and their energies and momenta.
class IslandBodies {
 public:
  explicit IslandBodies(const EquationsOfMotion& equations);

  std::size_t size() const { return mass_.size(); }
  std::size_t rotating() const { return inertia_.size(); }
  /// Whether no point is fixed.
  bool are_free() const { return points_ == mass_.size(); }
  double mass(std::size_t body) const { return mass_[body]; }
  /// Principal moments of inertia of a rotating body.
  const Eigen::Vector3d& inertia(std::size_t body) const { return inertia_[body]; }
  double radius_of_gyration(std::size_t body) const { return radius_[body]; }

  /// Vectors of zeros, with entries for fixed points.
  BodyVectors zeros() const;
  /// Poses of all bodies and points, not set.
  Configuration configuration() const;
  void gather_state(const List<BodyState>& states, Configuration* configuration,
                    BodyVectors* velocity) const;
  void scatter_state(const Configuration& configuration, const BodyVectors& velocity,
                     List<BodyState>* states) const;

  /// Displaces the bodies. Returns the largest displacement of a point [m].
  double displace(const BodyVectors& change, Configuration* configuration) const;
  /// Kinetic energy [J].
  double kinetic_energy(const Configuration& configuration, const BodyVectors& velocity) const;
  RigidMotion as_one_body(const Configuration& configuration, const BodyVectors& velocity) const {
    return engine::as_one_body(mass_, inertia_, configuration.position, configuration.orientation,
                               velocity);
  }
  /// Rigid motion of a free island with the momenta of `velocity`: the motion of its centre, and
  /// its rotation.
  void find_rigid_motion(const Configuration& configuration, const BodyVectors& velocity,
                         BodyVectors* centre, BodyVectors* turning) const;
  /// Largest speed of a body, or spin times radius of gyration [m/s].
  double largest_speed(const BodyVectors& velocity) const;
  /// Work of gravity and wrenches between two configurations [J].
  double work_of_loads(const EquationsOfMotion& equations, const Configuration& start,
                       const Configuration& end) const;
  /// Adds `factor` times other velocities.
  void add(double factor, const BodyVectors& other, BodyVectors* velocity) const;

 private:
  List<int> indices_;
  std::size_t points_;  // with fixed points
  List<double> mass_;
  List<Eigen::Vector3d> inertia_;
  List<double> radius_;
};

}  // namespace constraint_sim::engine
