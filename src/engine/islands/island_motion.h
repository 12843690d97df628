#pragma once

#include <optional>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/integrator_options.h"
#include "engine/dynamics/interval.h"
#include "engine/dynamics/least_norm_forces.h"
#include "engine/islands/borrowers.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_driven.h"
#include "engine/methods/runge_kutta/runge_kutta.h"

namespace constraint_sim::engine {

/// A compiled island with joints: its equations of motion, and the memory of each method. Equations
/// have the one-sided rows that act now. A method is constructed when it is first used.
class IslandMotion {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  IslandMotion(const IslandMotion& other);
  IslandMotion(IslandMotion&& other) noexcept;
  IslandMotion& operator=(const IslandMotion& other);
  IslandMotion& operator=(IslandMotion&& other) noexcept;
  ~IslandMotion();

  explicit IslandMotion(EquationsOfMotion equations) : substeps_(std::move(equations)) {}
  /// Makes a motion of an island with one-sided rows.
  explicit IslandMotion(EventDriven events)
      : substeps_(events.bare()), events_(std::move(events)) {}

  /// Takes over the laws of the joints. Returns false where the island has to be compiled anew.
  bool follow_laws(const List<Joint>& all_joints);
  bool is_event_driven() const { return events_.has_value(); }

  const EquationsOfMotion& equations() const { return substeps_.equations(); }
  /// Points on a tree of rods.
  bool is_simple() const {
    return equations().rotating() == 0 && equations().rows() <= equations().bodies().size();
  }
  /// Forgets the impulses of the step before, or those of an attempt in vain, and takes coordinates
  /// from the states of all joints.
  void begin_step(const List<JointData>& joints) {
    if (events_)
      events_->begin_step(joints, &substeps_);
    else
      substeps_.begin_step(joints);
  }
  /// Advances the bodies by one of the methods, as IslandMethod describes.
  IntegrationResult advance(Integration integration, const Interval& interval,
                            const IntegratorOptions& options, List<BodyState>* states);
  /// Advances an island with one-sided rows from event to event, the only method of such islands.
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            const EventDriven::Surroundings& around, List<BodyState>* states) {
    return events_->advance(interval, options, around, &substeps_, states);
  }
  /// Returns the results of the event-driven step; nullptr for an island without one-sided rows.
  const EventDriven* finish_events(const List<BodyState>& states) {
    if (!events_) return nullptr;
    events_->collect(states, &substeps_);
    return &*events_;
  }
  /// Events since begin_step().
  std::uint32_t events() const { return events_ ? events_->events() : 0; }
  /// Clears the memory of all methods, since impulses or an edit moved the bodies.
  void forget();
  /// Clears what methods continue from, since another method of this island continues the motion.
  void change_method();
  /// Returns to the state after compilation.
  void restart();
  /// A method that borrows the equations; nullptr where it was not used since compilation and had
  /// no memory in the snapshot that was read.
  template <class Method>
  const Method* lent() const {
    return borrowers_.find<Method>();
  }
  /// Whether any method has borrowed the equations since compilation.
  bool has_lent() const { return borrowers_.any(); }
  /// Distributes the forces among redundant rows by least norm, at the bodies' final states.
  const LeastNormForces& share_forces(const List<BodyState>& states);

  /// Visits everything that the next advance() reads beside the bodies (engine/support/memory.h).
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit, const List<MassProperties>& masses) {
    if (self.events_) EventDriven::visit_rows(*self.events_, visit, masses, self.substeps_);
    RungeKutta::visit_memory(self.substeps_, visit);
    Borrowers::visit_memory(self.borrowers_, visit, self.equations());
    if (self.events_) EventDriven::visit_memory(*self.events_, visit);
    visit.beside(self.follows_gradients_);
  }
  /// Prepares the equations for an interval from `t` [s], after a snapshot was read.
  /// `prescribed`: prescribed motions of the last interval.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, const List<PrescribedMotion>& prescribed) {
    if (!substeps_.has_started() && !borrowers_.have_started()) return;
    if (events_)
      events_->continue_from(t, states, gravity, loads, &substeps_);
    else
      substeps_.equations().continue_from(t, states, gravity, loads, prescribed);
  }

 private:
  IntegrationResult advance_by(Integration integration, const Interval& interval,
                               const IntegratorOptions& options, List<BodyState>* states);

  RungeKutta substeps_;  // owns the equations
  std::optional<EventDriven> events_;
  Borrowers borrowers_;
  std::optional<LeastNormForces> least_forces_;
  bool follows_gradients_ = false;  // whether energy_momentum moved the bodies last
};

}  // namespace constraint_sim::engine
