#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "engine/collision/broadphase.h"
#include "engine/constraints/joint_sum.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Bodies that impulses advance together, and the joints on them, by index.
struct ImpulseGroup {
  List<int> bodies;  ///< dynamic bodies
  List<int> joints;

  bool is_empty() const { return bodies.empty(); }
};

/// Adds the results of impulses to a report of a step, or of impulses.
template <class Report>
void add_impulses(const ImpulseReport& impulses, Report* report) {
  report->rows += impulses.rows;
  report->contacts += impulses.contacts;
  report->max_penetration = std::max(report->max_penetration, impulses.max_penetration);
  report->iterations += impulses.iterations;
  report->solver_residual = std::max(report->solver_residual, impulses.solver_residual);
  if (impulses.unsolved_body) report->unsolved_body = impulses.unsolved_body;
  report->driven_work += impulses.driven_work;
  report->correction_work += impulses.correction_work;
  for (std::size_t i = 0; i < kStageCount; ++i) report->stage_times[i] += impulses.stage_times[i];
}

/// Results of a step that was divided at hits.
struct HitReport {
  ImpulseReport impulses;
  std::uint32_t hits = 0;
  /// Hits may have been missed: there were too many, a body of the group moved by twice its gap, or
  /// a body that had taken its step was in the way.
  bool has_left_any = false;
};

/// Bodies that move so far in a step that they could pass through another body, or through
/// themselves into it: conservative advancement (Mirtich 1996) finds each hit. Bodies that may hit
/// each other within the step, with everything that joints and contacts connect with them, are one
/// group; the step of the group is divided at its hits, which happen in no time. Everything else
/// takes one step as always. Where nothing is fast, a step costs one comparison a body.
///
/// Joints lead fast bodies along curves. An integrated island takes its step; where it would have
/// passed through something, impulses take the step again. The step of a group with joints is
/// divided so that nothing moves by more than its gap, or by a quarter of the thinner shape; joints
/// and contacts are solved together there, as in any step.
class ContinuousCollision {
 public:
  /// Takes over which bodies have shapes that may touch.
  void set_shapes(const Model& model);
  /// Lists the fast bodies among `moving_shapes`, and forgets the pairs of the step before.
  void find_fast_bodies(const StepContext& step, const State& state,
                        const List<int>& moving_shapes);
  const List<int>& fast_bodies() const { return fast_bodies_; }
  /// Least thickness of the shapes that can touch [m].
  double thinnest() const { return thinnest_; }

  /// Adds pairs without points to the contacts: pairs of fast bodies that hit something, and of
  /// everything that these may hit then. Lists the fast pairs with joints.
  void find_hits(const StepContext& step, const List<Broadphase::Pair>& near,
                 const IslandLists& lists, State* state);
  /// Fast pairs that are apart, and of which one body has joints.
  const List<Broadphase::Pair>& jointed_pairs() const { return jointed_pairs_; }
  /// Integrated islands that passed through something in this step, ascending.
  List<int> find_passing(const StepContext& step, const State& state, const Rollback& rollback,
                         const IslandLists& lists) const;
  /// Adds the fast pairs with joints that impulses advance to the contacts, as pairs about to hit.
  void add_jointed_pairs(const StepContext& step, const IslandLists& lists, State* state) const;

  /// Separates the bodies about to hit from all bodies that impulses advance. False where there are
  /// none.
  bool divide(const StepContext& step, const IslandLists& lists, const List<int>& bodies,
              const List<int>& joints, State* state);
  void begin_impulses() { group_.bodies.clear(); }
  bool is_divided() const { return !group_.is_empty(); }
  /// Whether the step of a body was divided.
  bool divides(int body) const { return is_divided() && is_member_[body]; }
  /// Whether bodies of the group met as this pair.
  bool has_met(const Broadphase::Pair& pair) const;
  /// Everything that impulses advance beside the group.
  const ImpulseGroup& others() const { return others_; }
  /// Advances the group by a step, from hit to hit. `broadphase` knows the shapes that rest.
  HitReport advance(const StepContext& step, const IslandLists& lists, const AwakeSets& awake,
                    const List<int>& moving_shapes, const List<ActingWrench>& wrenches,
                    Broadphase* broadphase, SequentialImpulses* method, State* state);
  /// First body of the group.
  int first_body() const { return group_.bodies.front(); }
  /// Returns the contacts of the group to the contacts of all, and the number of their points.
  std::uint32_t return_contacts(State* state) const;

 private:
  bool is_fast_body(const StepContext& step, const State& state, int body) const;
  void list_jointed_pairs(const StepContext& step, const List<Broadphase::Pair>& near,
                          const State& state, const IslandLists& lists);
  List<Broadphase::Pair> pairs_of_group(const StepContext& step, const State& state,
                                        const List<int>& moving_shapes, double duration,
                                        Broadphase* broadphase, bool* is_any_left);
  void advance_group(const StepContext& step, const AwakeSets& awake,
                     const List<ActingWrench>& wrenches, double done, double duration,
                     SequentialImpulses* method, ImpulseReport* report, State* state);
  void gather_hits(const State& state);

  double thinnest_ = 0.0;     // least thickness of all shapes [m]
  double fast_square_ = 0.0;  // square of the speed above which bodies are fast [m²/s²]
  List<int> fast_bodies_;
  List<Broadphase::Pair> jointed_pairs_;
  ImpulseGroup group_, others_;
  List<bool> is_member_;       // by body: whether it belongs to the group
  List<JointSum> joint_sums_;  // results of the group's joints, summed over the parts of the step
  List<TouchingPair> hits_;    // contacts of the group, with the impulses of all its hits
  List<Proxy> proxies_;
};

}  // namespace constraint_sim::engine
