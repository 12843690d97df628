#pragma once

#include <cstdint>
#include <optional>

#include "engine/collision/broadphase.h"
#include "engine/islands/divided_step.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Results of a step that was divided at hits.
struct HitReport {
  ImpulseReport impulses;
  std::uint32_t hits = 0;
};

/// Bodies that move so far in a step that they could pass through another body, or through
/// themselves into it: conservative advancement (Mirtich 1996) finds each hit. Bodies that may hit
/// each other within the step, with everything that joints and contacts connect with them, are the
/// group of fast bodies. The step of the group is divided into parts at its hits, which happen in
/// no time. Everything else takes one step as always. Where nothing is fast, a step costs one
/// comparison a body.
///
/// Joints lead fast bodies along curves. An integrated island takes its step; where it would have
/// passed through something, impulses take the step again. The step of a group with joints is
/// divided so that nothing moves by more than its gap, or by a quarter of the thinner shape; joints
/// and contacts are solved together there, as in any step.
class ContinuousCollision {
 public:
  /// Takes over which bodies have shapes that may touch.
  void set_shapes(const Model& model);
  /// Lists the fast bodies among `moving_shapes`, which are bodies, and clears jointed_pairs().
  void find_fast_bodies(const StepContext& step, const State& state,
                        const List<int>& moving_shapes);
  const List<int>& fast_bodies() const { return fast_bodies_; }
  /// Least thickness of the shapes that can touch [m].
  double thinnest() const { return thinnest_; }

  /// Adds to `touching`, with empty manifolds, each pair with a fast body that meets a shape within
  /// the step, and each pair that either body may meet afterwards. Fills jointed_pairs().
  void find_hits(const StepContext& step, const List<Broadphase::Pair>& near,
                 const IslandLists& lists, State* state);
  /// Fast pairs that are apart, and of which one body has joints.
  const List<Broadphase::Pair>& jointed_pairs() const { return jointed_pairs_; }
  /// Integrated islands that passed through something in this step, ascending. Where errors of
  /// contacts are controlled, also those that may meet a body that impulses advance.
  List<int> find_passing(const StepContext& step, const State& state, const Rollback& rollback,
                         const IslandLists& lists) const;
  /// Adds the fast pairs with joints that impulses advance to the contacts, as pairs about to hit.
  void add_jointed_pairs(const StepContext& step, const IslandLists& lists, State* state) const;

  /// Separates the bodies about to hit, and those of islands whose step events began (FoundPart),
  /// from all bodies that impulses advance. False where there are none.
  bool divide(const StepContext& step, const IslandLists& lists, const List<int>& bodies,
              const List<int>& joints, State* state);
  /// Begins an attempt of a step, in which no step of a group has been divided yet.
  void begin_step() {
    groups_.clear();
    first_body_with_missed_hits_.reset();
  }
  bool is_divided() const { return !groups_.empty(); }
  /// Whether the step of a body was divided.
  bool divides(int body) const { return is_divided() && group_of_[body] >= 0; }
  /// Whether bodies of a group met as this pair.
  bool has_met(const Broadphase::Pair& pair) const;
  /// Everything that impulses advance beside the groups.
  const ImpulseGroup& others() const { return others_; }
  /// Advances each group to the end of the step, from hit to hit. `broadphase` knows resting
  /// shapes.
  HitReport advance(const StepContext& step, const IslandLists& lists, const AwakeSets& awake,
                    const List<int>& moving_shapes, const List<ActingWrench>& wrenches,
                    Broadphase* broadphase, SequentialImpulses* method, State* state);
  /// First body of a group whose hits may have been missed in this step: there were too many hits,
  /// a body moved by more than twice its gap, or a body that had taken its step was in the way.
  const std::optional<int>& first_body_with_missed_hits() const {
    return first_body_with_missed_hits_;
  }
  /// Notes that hits of the group of this first body may have been missed.
  void note_missed_hits(int first_body) { first_body_with_missed_hits_ = first_body; }
  /// Returns the contacts of the groups to the contacts of all, and the number of their points.
  std::uint32_t return_contacts(State* state) const;

 private:
  /// Bodies whose step is divided.
  struct Group {
    ImpulseGroup members;
    double done = 0.0;  ///< time from the start of the step that they have advanced [s]
  };

  HitReport advance_group(const StepContext& step, const IslandLists& lists, const AwakeSets& awake,
                          const List<int>& moving_shapes, const List<ActingWrench>& wrenches,
                          const Group& group, Broadphase* broadphase, SequentialImpulses* method,
                          State* state);
  bool is_fast_body(const StepContext& step, const State& state, int body) const;
  void list_jointed_pairs(const StepContext& step, const List<Broadphase::Pair>& near,
                          const State& state, const IslandLists& lists);

  double thinnest_ = 0.0;     // least thickness of all shapes [m]
  double fast_square_ = 0.0;  // square of the speed above which bodies are fast [m²/s²]
  List<int> fast_bodies_;
  List<Broadphase::Pair> jointed_pairs_;
  List<Group> groups_;
  List<int> group_of_;   // by body: index in groups_; -1: none
  DividedStep divided_;  // step of the group that is advanced
  ImpulseGroup others_;
  List<TouchingPair> hits_;  // contacts of all groups, with the impulses of all their hits
  std::optional<int> first_body_with_missed_hits_;
};

}  // namespace constraint_sim::engine
