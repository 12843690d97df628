#pragma once

#include "engine/dynamics/implicit/form_in_step.h"
#include "engine/dynamics/implicit/implicit_model.h"
#include "engine/dynamics/implicit/implicit_motion.h"
#include "engine/dynamics/implicit/implicit_system.h"
#include "engine/dynamics/implicit/link_in_step.h"

namespace constraint_sim::engine {

/// Rows that couple coordinates of general joints in a step.
class CouplingsInStep {
 public:
  explicit CouplingsInStep(const ImplicitModel& model) : couplings_(model.couplings().size()) {}

  /// Marks rows without a force, by `mark(row, &is_left_out, &is_redundant)`; `row` as in
  /// EquationsOfMotion.
  template <class Mark>
  void mark_rows(const ImplicitModel& model, Mark mark) {
    for (std::size_t c = 0; c < couplings_.size(); ++c)
      mark(model.couplings()[c].row, &couplings_[c].is_left_out, &couplings_[c].is_redundant);
  }
  /// Gives all rows a force.
  void unmark_rows() {
    for (Coupling& coupling : couplings_) coupling.is_left_out = coupling.is_redundant = false;
  }
  /// Sets targets and scales of the rows; `links` have been placed.
  void begin(const ImplicitModel& model, const List<LinkInStep>& links,
             const EquationsOfMotion& equations, ImplicitSystem* system);
  /// Adds the rows to the equations of the step, and their torques to the swing of `links`.
  void evaluate(const ImplicitModel& model, const ImplicitMotion& motion,
                const List<double>& unknowns, List<LinkInStep>* links, ImplicitSystem* system);
  /// Adds the impulses of a step of length h [s] and the positions at its end to `equations`.
  void finish(const ImplicitModel& model, double h, const List<double>& unknowns,
              EquationsOfMotion* equations) const;

 private:
  struct Coupling {
    bool is_left_out = false, is_redundant = false;
    double scale = 1.0, target = 0.0;
    std::array<double, 2> start{}, end{};  // q per term at both ends of the step
  };

  List<Coupling> couplings_;
};

}  // namespace constraint_sim::engine
