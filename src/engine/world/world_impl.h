#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "engine/constraints/joint.h"
#include "engine/islands/assumed_paths.h"
#include "engine/islands/compile.h"
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
  List<ActingWrench> acting_wrenches;  // wrenches and plugin forces on bodies that impulses advance
  SequentialImpulses sequential_impulses;
  Monitors monitors;

  Clock clock = nullptr;
  StopFlag stop = nullptr;

  // ---- editing (edits/)
  const List<std::size_t>& joints_on(std::size_t body);
  JointId add_joint(const Joint& joint, bool broken);
  void start_joint(std::size_t j);
  void continue_joint(std::size_t j, const JointState& saved);
  void continue_correction(std::size_t i, const Twist& correction);
  void wake_ends(const Joint& joint);
  void restart_joint(std::size_t j);
  void hold_from_here(std::size_t j);
  void forget_contacts();
  void continue_asleep(const std::vector<BodyId>& ids);
  void continue_contact(TouchingPair pair);
  bool is_known(const TouchingPair& pair) const;
  bool is_as_added(JointId id) const;
  struct NextIsland {
    IslandMembers members;
    Island island;
    IslandMemory memory;  // memory with which the next step begins
    bool is_fresh;        // the island was edited since the last step
  };
  List<NextIsland> next_islands() const;
  NextIsland next_island(IslandMembers members) const;
  void choose_next_methods(const List<JointEnds>& ends, const List<int>& next_of,
                           List<NextIsland>* next) const;
  const Impl& compiled(std::optional<Impl>* copy) const;
  List<std::pair<BodyId, IslandMemory>> memories() const;
  List<std::pair<BodyId, IslandMemory>> next_memories() const;
  bool restarts_methods(std::size_t island) const;
  std::uint64_t hash() const;
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit);
  void shift_couplings(std::size_t j, int coordinate, double change);
  void set_law(JointId id, int coordinate, const CoordinateLaw& law, bool is_motor_set);
  struct LawChange {
    bool law = false, motor = false;  ///< the timeout of a changed motor begins now
  };
  void replace_joint(std::size_t j, const Joint& joint,
                     const std::array<LawChange, kMaxCoordinates>& changes);
  bool follow_law(std::size_t j, std::size_t i, const CoordinateLaw& before, bool is_motor_set);
  void erase(const List<bool>& is_joint_removed, const List<bool>& is_body_removed);
  void erase_joints(const List<bool>& is_removed);
  void erase_bodies(const List<bool>& is_removed);
  void erase_wrenches(BodyId id);

  // ---- resting
  bool wake_touched();
  void spread_waking();
  void list_resting(const RestingSets& resting_sets);

  // ---- stepping: step() in world.cpp calls these; stages 1 and 2 are in world_impl.cpp
  void abandon_step();
  void fail_by(const CustomFailure& failed);
  StepContext begin_step();
  void save_state();
  void restore_state();
  void rebuild_topology();
  void run_broadphase(const StepContext& step);
  void run_narrowphase(const StepContext& step);
  void find_hits(const StepContext& step);
  void choose_methods(const StepContext& step);
  void integrate(const StepContext& step);
  void advance_by_impulses(const StepContext& step);
  bool has_missed_any(const StepContext& step);
  void return_to_start();
  void finish_impulses(const StepContext& step);
  void leave_out_estimates();
  ImpulseStep impulse_step(const StepContext& step) const;
  void find_acting_wrenches(const StepContext& step);
  void find_custom_forces(const StepContext& step);

  // ---- the end of a step: results of joints and contacts, events, failures
  void report_contact_groups(JointStep step);
  void advance_kinematic_bodies();
  void finish_step(const StepContext& step);
  void read_smooth_joints(JointStep step);
  void read_smooth_joint(std::size_t j, const JointStep& step, const RowVector& impulse,
                         double coupled_impulse);
  void note_if_broken(std::size_t j);
  void report_broken(std::size_t j);
  void report_events(const EventDriven& from);
  void mark_broken(std::size_t j);
  void note_coupling(std::size_t j, double h, double impulse);
  void drop_spent_wrenches(double now);
  void restore_state_before(Failure why);

  // ---- queries
  void list_unresolved(std::size_t island, List<std::size_t>* found) const;
  double time() const;
};

/// Access for code that saves and loads worlds.
struct ImplAccess {
  static World::Impl& of(World& world) { return *world.impl_; }
  static const World::Impl& of(const World& world) { return *world.impl_; }
};

}  // namespace constraint_sim::engine
