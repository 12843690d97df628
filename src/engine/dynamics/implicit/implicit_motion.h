#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/endpoint_estimate.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/implicit/implicit_model.h"
#include "engine/dynamics/implicit/implicit_system.h"
#include "engine/dynamics/implicit/implicit_time.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Motion of the bodies and fixed points of an island in one step: state at its start, prediction
/// without joints, and equations of the bodies without joints.
class ImplicitMotion {
 public:
  /// Rotation of a body in the step.
  struct Turning {
    Eigen::Matrix3d R0, J0;
    Eigen::Vector3d a, b;
    Eigen::Matrix3d B;  ///< B r₀ is the mean arm
    Eigen::Matrix3d C;  ///< 1 − ½ ŵ
  };

  ImplicitMotion(const ImplicitModel& model, std::size_t points);

  void gather_state(const List<BodyState>& states, const EquationsOfMotion& equations);
  void scatter_state(const EquationsOfMotion& equations, List<BodyState>* states) const;
  /// Writes the points of all bodies at the current state.
  void write_points(const ImplicitModel& model, Points* points) const;

  // ---- start of a step, in this order
  /// Predicts the displacement p and rotation a of a step without forces, and the momentum b.
  void predict(const ImplicitModel& model, const ImplicitTime& time);
  /// Takes over the fixed points where `equations` have them at the start of the step.
  void place_fixed_points(const EquationsOfMotion& equations);
  /// Takes over the fixed points at the end of the step, and the loads.
  void set_end(const ImplicitModel& model, const EquationsOfMotion& equations);

  const ImplicitTime& time() const { return time_; }
  const List<Eigen::Vector3d>& positions() const { return x_; }
  const List<Eigen::Quaterniond>& orientations() const { return q_; }
  /// Displacement of a fixed point in the step [m].
  const Eigen::Vector3d& shift(std::size_t point) const { return shift_[point]; }
  const Turning& turning(std::size_t body) const { return turnings_[body]; }
  /// Displacement and rotation of a body in the previous step of BDF2.
  const Eigen::Vector3d& dx_before(std::size_t body) const { return dx_before_[body]; }
  const Eigen::Vector3d& w_before(std::size_t body) const { return w_before_[body]; }
  double spin(std::size_t body) const { return angular_velocity_[body].norm(); }

  /// Adds the equations of the bodies at `unknowns`, and sets their rotations for links.
  void evaluate(const ImplicitModel& model, const List<double>& unknowns, ImplicitSystem* system);
  /// Makes the end of the step the current state.
  void finish(const ImplicitModel& model, const List<double>& unknowns);

  /// Visits what BDF2 needs of the previous step, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    for (auto* list : {&self.dx_before_, &self.v_before_, &self.w_before_, &self.L_before_})
      visit(*list);
  }

 private:
  ImplicitTime time_;
  List<Eigen::Vector3d> x_, v_;  // per point, fixed points last
  List<Eigen::Quaterniond> q_;
  List<Eigen::Vector3d> angular_velocity_;
  List<Eigen::Vector3d> dx_before_, v_before_, w_before_, L_before_;  // per body, for BDF2
  List<Eigen::Vector3d> p_;
  List<Eigen::Vector3d> force_, torque_;  // constant loads [N], [N m]
  List<Eigen::Vector3d> shift_;           // Δx per point; of fixed points that move
  List<Turning> turnings_;
};

}  // namespace constraint_sim::engine
