#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "engine/constraints/joint.h"
#include "engine/islands/assumed_paths.h"
#include "engine/islands/compile.h"
#include "engine/islands/contact_control.h"
#include "engine/islands/contact_groups.h"
#include "engine/islands/contact_pipeline.h"
#include "engine/islands/contact_reach.h"
#include "engine/islands/continuous_collision.h"
#include "engine/islands/island_integration.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/island_traits.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/islands/step_output.h"
#include "engine/islands/topology.h"
#include "engine/islands/unseen_overlaps.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/model.h"
#include "engine/model/state.h"
#include "engine/support/stage_timer.h"
#include "engine/support/storage.h"
#include "engine/world/monitors.h"
#include "engine/world/pending_edits.h"

namespace constraint_sim::engine {

struct CustomFailure;

/// The wiring of a world: model and state, and the owners of everything that follows from them. The
/// signatures of the owners say what they read and write.
struct World::Impl : Model, State, IslandLists, StepOutput {
  // ---- follows from model and state; rebuilt by the first step after an edit
  PendingEdits edits;
  Storage<List<List<std::size_t>>> joints_of_bodies;  // made by joints_on()
  Topology topology;

  // ---- awake sets; rebuilt when an island wakes or falls asleep
  Sleep sleep;

  // ---- owners of the stages of a step, in the order of the stages
  Rollback rollback;
  AssumedPaths assumed;
  ContactPipeline pipeline;
  ContactReach reach;
  ContactGroups groups;
  IslandIntegration integration;
  ContinuousCollision continuous;
  ContactControl control;
  List<ActingWrench> acting_wrenches;  // wrenches and plugin forces on bodies that impulses advance
  SequentialImpulses sequential_impulses;
  UnseenOverlaps unseen;
  Monitors monitors;

  Clock clock = nullptr;
  StopFlag stop = nullptr;

  // ---- editing (edits/)
  const List<std::size_t>& joints_on(std::size_t body);
  /// Adds a joint. `is_saved`: it continues from a saved state, so it is not checked to fit others
  /// or, by its functions, the present poses.
  JointId add_joint(const Joint& joint, bool broken, bool is_saved);
  void wake_ends(const Joint& joint);
  void forget_contacts();
  bool is_known(const TouchingPair& pair) const;
  std::uint64_t hash() const;
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit);
  /// Takes bodies and joints that are not in the world out of the report of the last step.
  void forget_unknown_ids();

  // ---- resting
  bool wake_touched();
  void spread_waking();
  void list_resting(const RestingSets& resting_sets);

  // ---- stepping: step() in world.cpp calls these; stages 1 and 2, and failures, are in
  // world_impl.cpp
  void abandon_step();
  void fail_by(const CustomFailure& failed);
  StepContext begin_step();
  void save_state();
  void restore_state();
  void rebuild_topology();
  void run_broadphase(const StepContext& step);
  /// Whether there are bodies near each other, now or in the step before.
  bool has_near_bodies() const {
    return !(pipeline.pairs().empty() && touching.empty() && pipeline.touching_before().empty() &&
             groups.is_empty());
  }
  void run_narrowphase(const StepContext& step);
  void find_hits(const StepContext& step);
  void choose_methods(const StepContext& step);
  void note_pairs(const StepContext& step);
  void integrate(const StepContext& step);
  void advance_by_impulses(const StepContext& step);
  bool return_if_missed(const StepContext& step);
  void return_to_start();
  void finish_impulses(const StepContext& step);
  void set_estimates(const StepContext& step);
  ImpulseStep impulse_step(const StepContext& step) const;
  void find_acting_wrenches(const StepContext& step);
  void find_custom_forces(const StepContext& step);

  // ---- the end of a step: results of joints and contacts, events, failures
  void report_contact_groups(JointStep step);
  void advance_kinematic_bodies();
  void finish_step(const StepContext& step);
  void read_results(const StepContext& step);
  void commit(const StepContext& step);
  void read_integrated_joints(JointStep step);
  void read_integrated_joint(std::size_t j, const JointStep& step, const RowVector& impulse,
                             double coupled_impulse);
  void mark_broken(std::size_t j);
  void drop_spent_wrenches(double now);
  void end_failed_step(Failure why);
  void restore_start();

  // ---- queries
  double time() const;
};

/// Access for code that saves and loads worlds.
struct ImplAccess {
  using Impl = World::Impl;
  static World::Impl& of(World& world) { return *world.impl_; }
  static const World::Impl& of(const World& world) { return *world.impl_; }
};

using WorldImpl = ImplAccess::Impl;

/// Reads the parts of the step that events began and impulses end, for the impulses.
void read_found(const StepContext& step, WorldImpl* world);
/// Sets the rates of motors to their means over a step that was advanced in parts.
void read_motors_of_parts(const StepContext& step, WorldImpl* world);

}  // namespace constraint_sim::engine
