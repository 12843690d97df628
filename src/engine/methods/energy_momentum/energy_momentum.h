#pragma once

#include <array>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/endpoint_estimate.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/implicit_step.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// An island with joints, carried through time by steps of ImplicitStep: one a span, or five
/// of Suzuki's composition of order 4 (Phys. Lett. A 146 (1990) 319). Where Newton's method does
/// not converge, first without the composition, then with shorter steps.
class EnergyMomentum {
 public:
  /// Up to this h ω a body's motion is what the steps show.
  static constexpr double kResolved = 2.0;

  explicit EnergyMomentum(const EquationsOfMotion& equations) : step_equations_(equations) {}

  /// As method.h says. The tolerance is for the turning of bodies, whose other motion the span is
  /// short enough for.
  IntegrationResult advance(const SmoothSpan& span, const IntegratorOptions& accuracy,
                            EquationsOfMotion* equations, List<BodyState>* states);
  /// Whether the last span was made of two halves, as a first one is.
  bool was_first() const { return was_first_; }
  /// Largest ω of the bodies by what held them in the last step [rad/s].
  double frequency() const { return step_equations_.frequency(); }
  double frequency_of(std::size_t body) const { return step_equations_.frequency_of(body); }
  /// Whether the next span continues the last one.
  bool has_started() const { return has_started_; }
  /// Somebody else has moved the bodies.
  void forget() { has_started_ = false; }
  /// Goes on as one just made.
  void restart() {
    has_started_ = false;
    step_equations_.forget();
  }
  /// Whether it has something to go on from.
  bool has_memory() const { return has_started_ || frequency() > 0.0; }
  /// Visits the same, beside the bodies, as engine/memory.h says.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit.beside(self.has_started_);  // these two decide what of the step follows
    visit.beside(self.mode_);
    ImplicitStep::visit_memory(self.step_equations_, visit,
                               self.has_started_ && self.mode_ == ImplicitMode::kDissipate);
    visit(self.has_started_);
    visit.beside(self.was_first_);
    EndpointEstimate::visit_memory(self.estimate_, visit);
    if (!self.has_started_) return;
    visit(self.mode_);
    visit(self.refinement_);
    visit(self.spans_since_);
    visit(self.step_before_);
    for (auto& unknowns : self.found_) visit(unknowns);
    if constexpr (Visit::kReads) {
      for (auto& unknowns : self.found_) unknowns.resize(self.step_equations_.size(), 0.0);
      self.change_.assign(self.step_equations_.size(), 0.0);
    }
  }

 private:
  static constexpr std::size_t kStages = 5;

  bool start(const SmoothSpan& span, EquationsOfMotion* equations, List<BodyState>* states,
             IntegrationResult* progress);
  bool step(double t, double h, std::size_t stage, EquationsOfMotion* equations,
            IntegrationResult* progress);
  bool find_end(IntegrationResult* progress);
  int parts_for_turning(double h, bool composes, double tolerance) const;
  bool composition(double t, double h, EquationsOfMotion* equations, IntegrationResult* progress);

  ImplicitStep step_equations_;
  ImplicitStep::Unknowns unknowns_;
  /// What was found last, by stage of the composition: where the next Newton steps begin.
  std::array<ImplicitStep::Unknowns, kStages> found_;
  List<double> change_;
  List<double> numbers_;  // a state and its derivative, as EquationsOfMotion has them
  EndpointEstimate estimate_;
  bool was_first_ = false;
  bool has_started_ = false;
  ImplicitMode mode_ = ImplicitMode::kOrder4;
  double step_before_ = 0.0;  // [s], where BDF2 can go on from it; else 0
  int refinement_ = 0;        // a span is made of this many halvings; -1: of a composition
  int spans_since_ = 0;
  StopFlag stop_ = nullptr;
};

}  // namespace constraint_sim::engine
