#pragma once

#include <cstdint>

#include "engine/collision/broadphase.h"
#include "engine/islands/group_parts.h"
#include "engine/islands/part_error.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// A step of a group of error control (ContactControl), divided into parts so that its error stays
/// within `contact_tolerance`. A part is taken whole and in two halves, which are the result;
/// PartError estimates its error. An impact that makes the error too large is located by parts
/// without the contacts that are still open, and happens in no time. A part in which hardly
/// anything moves is taken once. docs/methods/contact_error.md has the rules and measurements.
class ControlledStep {
 public:
  struct Outcome {
    ImpulseReport impulses;
    double error = 0.0;  ///< estimate [m]; NaN where impulses were not solved
    std::uint32_t substeps = 0, rejected = 0, hits = 0;
    bool has_left_any = false;  ///< a body that had taken its step was in the way
  };
  /// Advances a group from `start` [s], after the start of a step, to its end. `near`: pairs that
  /// may touch; `contacts`: contacts of the step before, in which the contacts of this step are
  /// returned.
  Outcome advance(const GroupSurroundings& around, const ImpulseGroup& group, double start,
                  const List<Broadphase::Pair>& near, List<TouchingPair>* contacts,
                  Broadphase* broadphase, SequentialImpulses* method, State* state);

 private:
  struct Attempt {
    double error = 0.0;  ///< [m]
    bool is_solved = true;
    bool is_whole = false;  ///< hardly anything moves, so the whole part is the result
    ImpulseReport impulses;
  };

  ImpulseStepKind part_kind() const;
  void begin_sums(const Model& model, double done, const List<TouchingPair>& contacts,
                  State* state);
  void list_met(const Model& model, const List<TouchingPair>& touching);
  Attempt attempt(const GroupSurroundings& around, double done, double h, bool is_free,
                  SequentialImpulses* method, State* state);
  double locate_impact(const GroupSurroundings& around, double done, double h,
                       SequentialImpulses* method, State* state);
  bool approaches_closed(const Model& model, double speed, const State& state) const;
  bool turn_to_impact(const GroupSurroundings& around, double done, double part, double allowed,
                      SequentialImpulses* method, double* until_hit, State* state);
  void accept(const GroupSurroundings& around, double h, const Attempt& attempt, State* state);
  void finish(const GroupSurroundings& around, List<TouchingPair>* contacts, State* state);
  void apply_impacts(const GroupSurroundings& around, double done, double gap,
                     SequentialImpulses* method, State* state);

  GroupParts parts_;
  PartError error_;
  Outcome outcome_;
  List<Broadphase::Pair> met_;     // pairs whose open contacts took impulses in the last whole part
  List<TouchingPair> sums_;        // contacts of the step, with the impulses of all parts
  List<TouchingPair> first_half_;  // contacts of the first half of a part
  List<JointData> joints_at_half_;  // joints after the first half
};

}  // namespace constraint_sim::engine
