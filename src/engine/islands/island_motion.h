#pragma once

#include <optional>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/least_norm_forces.h"
#include "engine/dynamics/method.h"
#include "engine/math/list.h"
#include "engine/methods/energy_momentum/energy_momentum.h"
#include "engine/methods/event_driven/joints/event_driven.h"
#include "engine/methods/least_squares/inconsistent_motion.h"
#include "engine/methods/runge_kutta/runge_kutta.h"

namespace constraint_sim::engine {

/// A way to carry an island with joints through a span.
enum class Integration {
  kSubsteps,      ///< runge_kutta
  kGradients,     ///< energy_momentum
  kInconsistent,  ///< energy_momentum where the joints cannot all be met
};

/// An island with joints, compiled: its equations (where rows are one-sided, those that act now),
/// and what each way to carry it goes on from. What the island never needed is not there.
class IslandMotion {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  IslandMotion(const IslandMotion& other);
  IslandMotion(IslandMotion&& other) noexcept;
  IslandMotion& operator=(const IslandMotion& other);
  IslandMotion& operator=(IslandMotion&& other) noexcept;
  ~IslandMotion();

  explicit IslandMotion(EquationsOfMotion equations) : substeps_(std::move(equations)) {}
  /// One with one-sided rows.
  explicit IslandMotion(EventDriven events)
      : substeps_(events.bare()), events_(std::move(events)) {}

  const EquationsOfMotion& equations() const { return substeps_.equations(); }
  /// Points on a tree of rods.
  bool is_simple() const {
    return equations().rotating() == 0 && equations().rows() <= equations().bodies().size();
  }
  /// Forgets the impulses of the step before, or those of an attempt in vain, and takes coordinates
  /// from the states of all joints.
  void begin_step(const List<JointState>& joints) {
    if (events_)
      events_->begin_step(joints, &substeps_);
    else
      substeps_.begin_step(joints);
  }
  /// As method.h says.
  IntegrationResult advance(Integration way, const SmoothSpan& span,
                            const IntegratorOptions& accuracy, List<BodyState>* states);
  /// The same from event to event; only of an island with one-sided rows, which has no other way.
  IntegrationResult advance(const SmoothSpan& span, const IntegratorOptions& accuracy,
                            const EventDriven::Surroundings& around, List<BodyState>* states) {
    return events_->advance(span, accuracy, around, &substeps_, states);
  }
  /// What events last went by, with all that was done; nullptr of an island without one-sided rows.
  const EventDriven* finish_events(const List<BodyState>& states) {
    if (!events_) return nullptr;
    events_->collect(states, &substeps_);
    return &*events_;
  }
  /// Events since begin_step().
  std::uint32_t events() const { return events_ ? events_->events() : 0; }
  /// Somebody else has moved the bodies.
  void forget();
  /// Another of these ways goes on with the bodies as they are.
  void change_way();
  /// Goes on as one just made, but for what is compiled.
  void restart();
  /// What gradients last went by; only after they were used.
  const EnergyMomentum& gradients() const { return *gradients_; }
  /// Whether inconsistent joints could be met at the end of the last span.
  bool can_be_met() const { return inconsistent_->can_be_met(); }
  /// What the joints share where some rows are redundant, with the bodies where the step ends.
  const LeastNormForces& share_forces(const List<BodyState>& states);

  /// Visits all that the next advance() goes on from, beside the bodies, as engine/support/memory.h
  /// says.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit, const List<MassProperties>& masses) {
    if (self.events_) EventDriven::visit_rows(*self.events_, visit, masses, self.substeps_);
    RungeKutta::visit_memory(self.substeps_, visit);
    bool has_gradients = self.gradients_ && self.gradients_->has_memory();
    visit.beside(has_gradients);
    if constexpr (Visit::kReads)
      if (has_gradients) self.gradients_.emplace(self.equations());
    if (has_gradients) EnergyMomentum::visit_memory(*self.gradients_, visit);
    if (self.events_) EventDriven::visit_memory(*self.events_, visit);
    visit.beside(self.follows_gradients_);
  }
  /// After these were read: lets the equations go on from `t`, where a span begins; `courses` are
  /// those of the span before.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, const List<PrescribedMotion>& courses) {
    if (!substeps_.has_started() && !(gradients_ && gradients_->has_started())) return;
    if (events_)
      events_->continue_from(t, states, gravity, loads, &substeps_);
    else
      substeps_.equations().continue_from(t, states, gravity, loads, courses);
  }

 private:
  IntegrationResult advance_by(Integration way, const SmoothSpan& span,
                               const IntegratorOptions& accuracy, List<BodyState>* states);

  RungeKutta substeps_;  // owns the equations
  std::optional<EventDriven> events_;
  std::optional<EnergyMomentum> gradients_;
  std::optional<InconsistentMotion> inconsistent_;
  std::optional<LeastNormForces> least_forces_;
  bool follows_gradients_ = false;  // these moved the bodies last: as gradients_ has_started() says
};

}  // namespace constraint_sim::engine
