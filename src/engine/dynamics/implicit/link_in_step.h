#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/constraints/joint_vectors.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/implicit/implicit_model.h"
#include "engine/dynamics/implicit/implicit_motion.h"

namespace constraint_sim::engine {

/// Soft row in one step. Its law is given λ + taken q₁ = target.
struct SoftInStep {
  double given = 0.0, taken = 1.0, target = 0.0;
  double start = 0.0, end = 0.0;  ///< q at both ends of the step
};

/// Geometry of a link at the start of a step, its targets at the end, and its force at the last
/// evaluation.
struct LinkInStep {
  // ---- by place()
  Eigen::Vector3d d0;
  std::array<Eigen::Vector3d, 2> r0;  ///< arms of ends A and B
  double scale = 1.0;                 ///< scale of the joint's equations
  RowVector row_scale;                ///< scale per row of a general joint
  const CustomCode* custom = nullptr;
  /// Axes of a general joint at the start and at the end of the step.
  std::array<Eigen::Matrix3d, 2> axes0{Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Identity()};
  std::array<Eigen::Matrix3d, 2> axes1 = axes0;
  std::array<bool, kMaxJointRows> is_left_out{}, is_redundant{};  ///< rows without a force

  // ---- by set_target()
  double target = 0.0;      ///< ½ℓ² of a rod; known part of the law of a spring [m]
  double compliance = 0.0;  ///< ε of a spring [m/N]
  double before = 0.0;      ///< ‖d‖ of a spring one step ago [m]
  RowVector offset;         ///< target of a ball joint or a general joint
  /// Arm and axes of a general joint on B, with its frame at the end of the step and body B at the
  /// start.
  Eigen::Vector3d next_r_B = Eigen::Vector3d::Zero();
  Eigen::Matrix3d next_axes_B = Eigen::Matrix3d::Identity();
  /// Velocity and spin of ends of a custom force that are fixed points.
  std::array<Eigen::Vector3d, 2> fixed_velocity, fixed_spin;

  // ---- by the last evaluation
  Eigen::Vector3d d, force;       ///< d where forces are taken, and force on B
  std::array<double, 2> swing{};  ///< Σ‖torque‖ at each end of a general joint [N m]

  /// Sets the geometry at the start of the step; `equations` are at that time.
  void place(const ImplicitLink& link, const ImplicitModel& model, const ImplicitMotion& motion,
             const EquationsOfMotion& equations);
  /// Sets the targets at the end of the step; `equations` are at that time. Soft rows of the link
  /// are begun in `softs`, by index in EquationsOfMotion::soft_coordinates().
  void set_target(const ImplicitLink& link, const ImplicitMotion& motion,
                  const EquationsOfMotion& equations, List<SoftInStep>* softs);
  /// Vectors of a general joint at the start of the step.
  JointVectors start() const { return {r0, d0, axes0, custom}; }
  bool is_in(int row) const { return !is_left_out[to_index(row)]; }

 private:
  void place_axes(const ImplicitLink& link, const ImplicitMotion& motion,
                  const EquationsOfMotion& equations, std::array<Eigen::Matrix3d, 2>* axes) const;
  void set_spring(const ImplicitLink& link, const ImplicitTime& time, const Prescribed& length);
  void set_softs(const ImplicitLink& link, const ImplicitTime& time,
                 const EquationsOfMotion& equations, List<SoftInStep>* softs) const;
  void set_fixed_velocities(const ImplicitLink& link, const ImplicitMotion& motion,
                            const EquationsOfMotion& equations);
};

}  // namespace constraint_sim::engine
