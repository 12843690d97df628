#pragma once

#include <array>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/endpoint_estimate.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/implicit/implicit_step.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Advances an island with joints by steps of ImplicitStep: one step per interval, or five steps of
/// Suzuki's composition of order 4 (Phys. Lett. A 146 (1990) 319). Where Newton's method does not
/// converge, the composition is dropped first, then steps are halved.
class EnergyMomentum {
 public:
  /// Bound on h ω below which steps resolve the motion of a body.
  static constexpr double kResolved = 2.0;
  /// Error of the rotation of a body in a tick up to which steps resolve it [rad].
  static constexpr double kResolvedTurn = 0.01;

  explicit EnergyMomentum(const EquationsOfMotion& equations) : step_equations_(equations) {}

  /// Advances the island as IslandMethod describes. The tolerance is for the rotation of bodies;
  /// intervals have to be short enough for other motion.
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            EquationsOfMotion* equations, List<BodyState>* states);
  /// Whether the last interval began without history, as after an edit or a jump. Such an interval
  /// is made of two halves.
  bool was_first() const { return was_first_; }
  /// Largest frequency ω of the bodies under the forces of the last step [rad/s].
  double frequency() const { return step_equations_.frequency(); }
  double frequency_of(std::size_t body) const { return step_equations_.frequency_of(body); }
  /// Error of a rotation by `turn` [rad] in an interval like the last one, in as many substeps as
  /// the tolerance may ask for [rad].
  double turn_error(double turn, double tolerance) const;
  /// Whether the next interval continues the last one.
  bool has_started() const { return has_started_; }
  /// Notes that bodies were moved from outside.
  void forget() { has_started_ = false; }
  /// Resets to the state after construction.
  void restart() {
    has_started_ = false;
    step_equations_.forget();
  }
  /// Whether there is memory of earlier intervals.
  bool has_memory() const { return has_started_ || frequency() > 0.0; }
  /// Visits the memory of earlier intervals, except the bodies, as engine/support/memory.h
  /// describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit.beside(self.has_started_);  // has_started_ and mode_ decide which data of the step follow
    visit.beside(self.mode_);
    ImplicitStep::visit_memory(self.step_equations_, visit,
                               self.has_started_ && self.mode_ == ImplicitMode::kDissipate);
    visit(self.has_started_);
    visit.beside(self.was_first_);
    EndpointEstimate::visit_memory(self.estimate_, visit);
    if (!self.has_started_) return;
    visit(self.mode_);
    visit(self.refinement_);
    visit(self.intervals_since_);
    visit(self.step_before_);
    for (auto& unknowns : self.found_) visit(unknowns);
    if constexpr (Visit::kReads) {
      for (auto& unknowns : self.found_) unknowns.resize(self.step_equations_.size(), 0.0);
      self.change_.assign(self.step_equations_.size(), 0.0);
    }
  }

 private:
  static constexpr std::size_t kCompositionStages = 5;

  bool start(const Interval& interval, EquationsOfMotion* equations, List<BodyState>* states,
             IntegrationResult* progress);
  bool project(const Interval& interval, double most, EquationsOfMotion* equations,
               List<BodyState>* states, IntegrationResult* progress);
  bool try_steps(const Interval& interval, const IntegratorOptions& options,
                 const List<BodyState>& states, EquationsOfMotion* equations,
                 IntegrationResult* progress);
  bool step(double t, double h, std::size_t stage, EquationsOfMotion* equations,
            IntegrationResult* progress);
  bool find_end(IntegrationResult* progress);
  int parts_for_turning(double h, bool composes, double tolerance) const;
  bool composition(double t, double h, EquationsOfMotion* equations, IntegrationResult* progress);

  ImplicitStep step_equations_;
  ImplicitStep::Unknowns unknowns_;
  /// Last solution per stage of the composition: first guess of Newton's method.
  std::array<ImplicitStep::Unknowns, kCompositionStages> found_;
  List<double> change_;
  List<double> numbers_;  // state and derivative, laid out as in EquationsOfMotion
  EndpointEstimate estimate_;
  bool was_first_ = false;
  bool has_started_ = false;
  ImplicitMode mode_ = ImplicitMode::kOrder4;
  double step_before_ = 0.0;  // length of the step that BDF2 can continue; else 0 [s]
  int refinement_ = 0;        // number of halvings of an interval; -1: composition
  int intervals_since_ = 0;   // intervals since steps were last shortened or lengthened
  StopFlag stop_ = nullptr;
};

}  // namespace constraint_sim::engine
