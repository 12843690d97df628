#pragma once

#include <cstdint>

#include "engine/collision/broadphase.h"
#include "engine/islands/divided_step.h"
#include "engine/islands/part_error.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Everything around a group that stays the same in a step.
struct GroupSurroundings {
  const StepContext& step;
  const AwakeSets& awake;
  const List<int>& moving_shapes;
  const List<ActingWrench>& wrenches;
  const List<BodyState>& at_start;  ///< all bodies at the start of the step
};

/// A step of a group of bodies in contact, divided so that its error stays within
/// `contact_tolerance`. A part is taken whole and in two halves, which are the result; PartError
/// estimates its error. An impact that makes the error too large is located by parts without the
/// contacts that are still open, and happens in no time. A part in which hardly anything moves is
/// taken once. docs/methods/contact_error.md has the rules and measurements.
class ControlledStep {
 public:
  struct Outcome {
    ImpulseReport impulses;
    double error = 0.0;  ///< estimate [m]; NaN where impulses were not solved
    std::uint32_t substeps = 0, rejected = 0, hits = 0;
    bool has_left_any = false;  ///< a body that had taken its step was in the way
  };
  /// Advances a group by a step. `near`: pairs that may touch; `contacts`: contacts of the step
  /// before, in which the contacts of this step are returned.
  Outcome advance(const GroupSurroundings& around, const ImpulseGroup& group,
                  const List<Broadphase::Pair>& near, List<TouchingPair>* contacts,
                  Broadphase* broadphase, SequentialImpulses* method, State* state);

 private:
  /// State of the group where a part begins.
  struct Start {
    List<BodyState> bodies;
    List<Twist> corrections;
    List<JointState> joints;
    List<TouchingPair> touching;
    bool any_corrections = false;
  };
  /// Impulse of a joint over the length of a part [N].
  struct JointGuess {
    RowVector rows;
    double coupled;
  };
  struct Attempt {
    double error = 0.0;  ///< [m]
    bool is_solved = true;
    bool is_whole = false;  ///< hardly anything moves, so the whole part is the result
    ImpulseReport impulses;
  };

  /// Whether the group has too many bodies for parts to be repeated.
  bool is_large() const;
  ImpulseStepKind part_kind() const {
    return is_large() ? ImpulseStepKind::kLargePart : ImpulseStepKind::kPart;
  }
  void begin(const GroupSurroundings& around, const ImpulseGroup& group,
             const List<TouchingPair>& contacts, const State& state);
  void save(const State& state);
  void restore(State* state) const;
  void collide(const GroupSurroundings& around, double done, double h, bool is_free, State* state);
  ImpulseReport take(const GroupSurroundings& around, double done, double h,
                     const ContactStep& contacts, ImpulseStepKind kind, SequentialImpulses* method,
                     State* state);
  double longest_part(const GroupSurroundings& around, const State& state, double left) const;
  void list_met(const Model& model, const List<TouchingPair>& touching);
  Attempt attempt(const GroupSurroundings& around, double done, double h, bool is_free,
                  SequentialImpulses* method, State* state);
  double locate_impact(const GroupSurroundings& around, double done, double h,
                       SequentialImpulses* method, State* state);
  void keep_guesses(double h, const State& state);
  void accept(const GroupSurroundings& around, double h, const Attempt& attempt, State* state);
  void meet(const GroupSurroundings& around, double done, double gap, SequentialImpulses* method,
            State* state);

  DividedStep divided_;
  PartError error_;
  Outcome outcome_;
  Start start_;
  List<Broadphase::Pair> near_;
  List<Broadphase::Pair> met_;  // pairs whose open contacts took impulses in the last whole part
  List<TouchingPair> guesses_;  // contacts with the forces of the last part [N]
  List<JointGuess> joint_guesses_;
  List<TouchingPair> sums_;          // contacts of the step, with the impulses of all parts
  List<TouchingPair> first_half_;    // contacts of the first half of a part
  List<JointState> joints_at_half_;  // joints after the first half
  std::size_t work_ = 0;             // bodies times solves
};

}  // namespace constraint_sim::engine
