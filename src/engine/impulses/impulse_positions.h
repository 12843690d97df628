#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/row.h"
#include "engine/impulses/energy_account.h"
#include "engine/impulses/row_system.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Moves the bodies by the velocities v + w of a step, and finds the correction velocities w that
/// the next step removes, so that closing errors adds no kinetic energy and no momentum.
class ImpulsePositions {
 public:
  using Bodies = RowSystem::Bodies;
  using Masses = RowSystem::Masses;

  /// Moves a body by x += h (v + w), and q by the rotation h (ω + w), at constant angular momentum,
  /// and sets its velocity to v after the motion. Returns the kinetic energy gained by w [J].
  static double move(const MassProperties& mass, double h, const Twist& v, const Twist& w,
                     BodyState* body);

  /// Moves all bodies, and sets their velocities to v + w. Returns the work of the motion by w [J].
  double advance(const List<int>& moved, const Masses& masses, const Eigen::Vector3d& gravity,
                 RowSystem* system, Bodies* bodies);
  /// Takes the Jacobian and the value after the step of row i, a row of a joint.
  void finish_row(std::size_t i, const Row& row, const Jacobian& J, double C, RowSystem* system,
                  EnergyAccount* energy);
  /// Writes to `to_remove` the velocities to remove at the start of the next step: w by impulses
  /// along the Jacobians after the step, so that momenta are conserved. Returns the work of
  /// corrections against springs, and of bodies that are pulled together while they rotate about
  /// each other [J].
  double take_out_corrections(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                              const EnergyAccount& energy, RowSystem* system,
                              List<Twist>* to_remove);

 private:
  /// Angular momentum of a component that corrections leave.
  struct LostMomentum {
    Eigen::Vector3d L = Eigen::Vector3d::Zero();
    double most = 0.0;  // Σ m h ‖w‖ ‖v‖ [kg m²/s]
    bool is_given_back = false;
  };
  /// Changes of a component's velocities.
  struct Part {
    bool gains = false;
    double linear = 0.0, quadratic = 0.0, scale = 1.0, damping = 0.0;
    LostMomentum lost;
  };
  /// Component as one rigid body.
  struct Rigid {
    double mass = 0.0;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double energy = 0.0;  // kinetic
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    Eigen::Vector3d L = Eigen::Vector3d::Zero(), L_of_changes = Eigen::Vector3d::Zero();
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
    Eigen::Vector3d turning = Eigen::Vector3d::Zero();  // compensates the damping
    Eigen::Vector3d turning_of_changes = Eigen::Vector3d::Zero();
  };

  void gather_rigid(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                    const RowSystem& system);
  double limit_changes(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                       const EnergyAccount& energy, RowSystem* system);
  double keep_angular_momentum(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                               RowSystem* system);

  // Per body; used at the body of a component.
  List<Part> parts_;
  List<Rigid> rigid_;
};

}  // namespace constraint_sim::engine
