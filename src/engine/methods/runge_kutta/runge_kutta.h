#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/kernels/articulated_tree.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Advances an island with joints by an embedded Runge-Kutta pair: Hairer, Nørsett & Wanner I,
/// section II.5; projection: Hairer, Lubich & Wanner, Geometric Numerical Integration, section
/// IV.4.
class RungeKutta {
 public:
  explicit RungeKutta(EquationsOfMotion equations);

  /// Takes over the laws of the joints, as EquationsOfMotion::follow_laws(). The next interval
  /// continues with the forces of these laws.
  bool follow_laws(const List<Joint>& all_joints) {
    has_other_forces_ = true;
    return equations_.follow_laws(all_joints);
  }
  const EquationsOfMotion& equations() const { return equations_; }
  EquationsOfMotion& equations() { return equations_; }
  void begin_step(const List<JointData>& joints) {
    equations_.begin_step(joints);
    tree_.begin_step();
  }
  /// Advances the island as IslandMethod describes, with its own equations. Impulses and angles of
  /// a failed attempt do not count.
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            List<BodyState>* states);
  /// First part of advance(), for methods that look at every substep.
  IntegrationResult begin(const Interval& interval, const IntegratorOptions& options,
                          const List<BodyState>& states);
  /// Makes one substep of the rest of the interval and adds to `progress`. Evaluates the forces of
  /// all stages, which impulses do not need. Returns false where it gives up.
  bool advance_substep(const Interval& interval, const IntegratorOptions& options,
                       RemainingInterval* left, IntegrationResult* progress);
  /// Tries one substep by order 1 or 3 from the start that keep_start() has saved. Returns false,
  /// and returns to the start, where its error exceeds the tolerance.
  bool try_substep(const Interval& interval, const IntegratorOptions& options,
                   RemainingInterval* left, IntegrationResult* progress);
  /// Saves the start of a substep.
  void keep_start();
  /// Repeats a substep with length h from the saved start at time t, and counts it; 0: returns to
  /// the start. Returns false where it fails.
  bool repeat_substep(const Interval& interval, const IntegratorOptions& options, double t,
                      double h, IntegrationResult* progress);
  /// Longest time by which the state may be moved along its derivative, with no error but rounding
  /// [s]. `rates`: its accelerations.
  double longest_shift(const Motions& rates, const List<BodyState>& states) const;
  /// Moves the state from its time t by `shift` [s], which may be negative, along its derivative.
  /// Returns false where that fails.
  bool shift_end(const Interval& interval, IntegratorOptions options, double t, double shift,
                 IntegrationResult* progress);
  /// Writes the bodies at the present state.
  void scatter(List<BodyState>* states);
  /// Accelerations of the bodies at the present state, at time t [s].
  void find_accelerations(double t, Motions* rates);
  /// First guess of the next substep [s].
  double step() const { return step_; }
  double* next_step() { return &step_; }
  /// Whether laws have other forces than in the last interval.
  bool has_other_forces() const { return has_other_forces_; }
  /// Whether the next interval continues the last one.
  bool has_started() const { return has_started_; }
  /// Notes that bodies were moved from outside.
  void forget() {
    has_started_ = false;
    tree_.forget();
  }
  /// Resets to the state after construction.
  void restart();
  /// Visits all state that the next advance() continues from, except the bodies, as
  /// engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit.beside(self.has_started_);  // has_started_ decides which data of the equations follow
    EquationsOfMotion::visit_memory(self.equations_, visit, self.has_started_);
    visit(self.step_);
    visit(self.has_started_);
    visit(self.has_other_forces_);
    ArticulatedTree::visit_memory(self.tree_, visit, self.has_started_);
    if (!self.has_started_) return;
    if (self.tree_.is_current()) return;
    const std::size_t n = self.equations_.size();
    for (std::size_t i = 0; i < n; ++i) visit(self.numbers_[i]);
    for (std::size_t i = 0; i < n; ++i) visit(self.numbers_[StageMemory::kDerivatives * n + i]);
  }

 private:
  void return_to_start();
  IntegrationResult start(const Interval& interval, const IntegratorOptions& options,
                          const StageMemory& memory);

  IntegrationResult begin_equations(const Interval& interval, const IntegratorOptions& options,
                                    const List<BodyState>& states);
  bool advance_in_coordinates(const Interval& interval, const IntegratorOptions& options,
                              RemainingInterval* left, IntegrationResult* progress);
  IntegrationResult integrate_tree(const Interval& interval, const IntegratorOptions& options,
                                   List<BodyState>* states);
  bool may_be_stiff(const Interval& interval, const IntegratorOptions& options, int substeps) const;
  void note_stiffness(const IntegratorOptions& options, IntegrationResult* progress);
  IntegrationResult integrate_interval(const Interval& interval, const IntegratorOptions& options,
                                       List<BodyState>* states);
  bool is_far_too_stiff(const IntegratorOptions& options);
  template <class Act>
  auto with_system(Act act);
  IntegrationResult integrate_equations(const StageMemory& memory, const Interval& interval,
                                        const IntegratorOptions& options);

  EquationsOfMotion equations_;
  ArticulatedTree tree_;           // state in joint coordinates, where it is used
  List<double> numbers_;           // storage of StageMemory
  double step_ = 0.0;              // first guess of the next substep [s]
  bool has_started_ = false;       // whether the derivative of the first stage is known
  bool has_other_forces_ = false;  // whether laws have changed since that derivative
  List<double> kept_;              // state and derivative, saved by keep_start()
  TreeMomentum kept_momentum_;     // momenta and size of a tree, saved by keep_start()
  double kept_size_ = 0.0;
};
static_assert(IslandMethod<RungeKutta>::kIsHeld);

}  // namespace constraint_sim::engine
