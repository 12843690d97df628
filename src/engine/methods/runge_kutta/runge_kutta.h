#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// An island with joints, carried through time by an embedded Runge-Kutta pair: Hairer, Nørsett &
/// Wanner I, section II.5; projection: Hairer, Lubich & Wanner, Geometric Numerical Integration,
/// section IV.4.
class RungeKutta {
 public:
  explicit RungeKutta(EquationsOfMotion equations);

  const EquationsOfMotion& equations() const { return equations_; }
  EquationsOfMotion& equations() { return equations_; }
  void begin_step(const List<JointState>& joints) { equations_.begin_step(joints); }
  /// As method.h says, with its own equations.
  IntegrationResult advance(const SmoothSpan& span, const IntegratorOptions& accuracy,
                            List<BodyState>* states);
  /// advance() in parts, for a method that looks at every substep: first this.
  IntegrationResult begin(const SmoothSpan& span, const IntegratorOptions& accuracy,
                          const List<BodyState>& states);
  /// Takes one substep of what is left of the span. Adds to `progress`; false where it gives up.
  bool advance_substep(const SmoothSpan& span, const IntegratorOptions& accuracy, SubstepSpan* left,
                       IntegrationResult* progress);
  /// Keeps where a substep starts.
  void keep_start();
  /// Goes back there.
  void return_to_start();
  /// Takes a substep of h from there, which was at t. False where that has no result.
  bool repeat_substep(const SmoothSpan& span, const IntegratorOptions& accuracy, double t,
                      double h);
  /// The state and its derivative, as the equations have them.
  const double* state() const { return numbers_.data(); }
  const double* derivative() const {
    return numbers_.data() + StageMemory::kDerivatives * equations_.size();
  }
  /// What the next substep is tried with [s].
  double step() const { return step_; }
  void set_step(double step) { step_ = step; }
  /// Whether the next span continues the last one.
  bool has_started() const { return has_started_; }
  /// Somebody else has moved the bodies.
  void forget() { has_started_ = false; }
  /// Goes on as one just made.
  void restart();
  /// Visits all that the next advance() goes on from, beside the bodies, as engine/memory.h says.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit.beside(self.has_started_);  // decides what of the equations follows
    EquationsOfMotion::visit_memory(self.equations_, visit, self.has_started_);
    visit(self.step_);
    visit(self.has_started_);
    if (!self.has_started_) return;
    const std::size_t n = self.equations_.size();
    for (std::size_t i = 0; i < n; ++i) visit(self.numbers_[i]);
    for (std::size_t i = 0; i < n; ++i) visit(self.numbers_[StageMemory::kDerivatives * n + i]);
  }

 private:
  IntegrationResult start(const SmoothSpan& span, const IntegratorOptions& accuracy,
                          const StageMemory& memory);

  bool is_far_too_stiff(const IntegratorOptions& accuracy);
  template <class Act>
  auto with_system(Act act);
  IntegrationResult integrate_equations(const StageMemory& memory, const SmoothSpan& span,
                                        const IntegratorOptions& accuracy);

  EquationsOfMotion equations_;
  List<double> numbers_;      // of StageMemory
  double step_ = 0.0;         // what the next substep is tried with [s]
  bool has_started_ = false;  // the derivative of the first stage is there
  List<double> kept_;         // state and derivative, of keep_start()
};

/// A body's rotation that no joint acts on: L is constant, or grows with a constant torque, and
/// only q̇ = ½ (0, I_W⁻¹ L) ⊗ q is integrated; of isotropic bodies not even that.
class FreeRotation {
 public:
  /// Whether there is anything to advance.
  static bool turns(const Eigen::Vector3d& torque, const BodyState& state) {
    return !(state.angular_velocity.isZero(0.0) && torque.isZero(0.0));
  }
  IntegrationResult advance(double h, const Eigen::Vector3d& torque, const MassProperties& mass,
                            const IntegratorOptions& accuracy, StopFlag stop, BodyState* state);
  /// Whether it has something to go on from.
  bool has_memory() const { return step_ != 0.0; }
  /// Visits the same, beside the body, as engine/memory.h says.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.step_);
    visit(self.after_.angular_velocity);
    visit(self.after_.orientation.coeffs());
    visit(self.momentum_);
    visit(self.torque_);
    visit(self.first_derivative_);
  }

 private:
  double step_ = 0.0;                                   // the next substep is tried with [s]
  BodyState after_;                                     // the last span
  Eigen::Vector3d momentum_ = Eigen::Vector3d::Zero();  // L then
  Eigen::Vector3d torque_ = Eigen::Vector3d::Zero();    // in it
  Eigen::Vector4d first_derivative_ = Eigen::Vector4d::Zero();  // of the next span, if that goes on
};

/// x and v of a body that nothing holds, by the parabola.
void integrate_ballistic(double h, const Eigen::Vector3d& acceleration, BodyState* state);

}  // namespace constraint_sim::engine
