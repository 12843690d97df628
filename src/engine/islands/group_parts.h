#pragma once

#include <array>
#include <cstddef>

#include "engine/collision/broadphase.h"
#include "engine/islands/divided_step.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Gap to which a hit is located, as a share of the thinner shape; a contact within it is closed.
inline constexpr double kLocatedGap = 1e-8;

/// Everything around a group of error control (ContactControl) that stays the same in a step.
struct GroupSurroundings {
  const StepContext& step;
  const AwakeSets& awake;
  const List<int>& moving_shapes;
  const List<ActingWrench>& wrenches;
  const List<BodyState>& at_start;  ///< all bodies at the start of the step
};

/// Parts of the time step of a group of error control. A part may be taken back. Finds the contacts
/// of a part, starts its impulses from the forces of the part before, and takes the part.
class GroupParts {
 public:
  /// State of the group where a part begins.
  struct Start {
    List<BodyState> bodies;
    List<Twist> corrections;
    List<JointData> joints;
    List<TouchingPair> touching;
    bool any_corrections = false;
  };

  /// Begins a step, of which `done` [s] are over. `near`: pairs that may touch in the whole step;
  /// `contacts`: of the step before, or of the part that is over.
  void begin(const GroupSurroundings& around, const ImpulseGroup& group, double done,
             const List<Broadphase::Pair>& near, const List<TouchingPair>& contacts,
             const State& state);
  const List<int>& bodies() const { return divided_.group().bodies; }
  const List<int>& joints() const { return divided_.group().joints; }

  /// Saves the state of the group, and returns to it.
  void save(const State& state);
  void restore(State* state) const;
  const Start& start() const { return start_; }

  /// Places kinematic bodies where they are `t` [s] after the start of the step.
  static void place_kinematic(const GroupSurroundings& around, double t, State* state);
  /// Finds the contacts of a part of `h` [s] that begins `done` [s] after the start of the step;
  /// `is_free`: without contacts that are open.
  void collide(const GroupSurroundings& around, double done, double h, bool is_free, State* state);
  /// Takes a part of `h` [s] with the present contacts.
  ImpulseReport take(const GroupSurroundings& around, double done, double h,
                     const ContactStep& contacts, ImpulseStepKind kind, SequentialImpulses* method,
                     State* state);
  /// Takes over the forces of `contacts` and of joints after a part of `h` [s].
  void keep_guesses(double h, const List<TouchingPair>& contacts, const State& state);
  void sum_joints(const Model& model, double h, State* state) {
    divided_.sum_joints(model, h, state);
  }
  void finish_joints(const StepContext& step, State* state) const {
    divided_.finish_joints(step, state);
  }

  double longest_part(const GroupSurroundings& around, const State& state, double left) const;
  void find_pairs_again(const GroupSurroundings& around, double left, Broadphase* broadphase,
                        const State& state);

  /// Bodies times solves since begin(), with iterations.
  std::size_t work() const { return work_; }
  /// Whether a body that had taken its step may be hit.
  bool has_left_any() const { return has_left_any_; }
  /// Time of all parts, also of those that were taken back [s].
  const StageTimes& stage_times() const { return stage_times_; }

 private:
  /// Impulse of a joint over the length of a part [N].
  struct JointGuess {
    RowVector rows;
    double coupled;
  };
  /// Sphere that a body stays in, with what its shape needs around it.
  struct Room {
    Eigen::Vector3d center;
    double radius;  ///< [m]
  };

  void note_rooms(const GroupSurroundings& around, double left, const State& state);

  DividedStep divided_;
  Start start_;
  List<Broadphase::Pair> near_;
  List<Room> rooms_;            // by body of the group: bounds that near_ was found by
  List<TouchingPair> guesses_;  // contacts with the forces of the last part [N]
  List<JointGuess> joint_guesses_;
  std::size_t work_ = 0;
  bool has_left_any_ = false;
  StageTimes stage_times_{};
};

}  // namespace constraint_sim::engine
