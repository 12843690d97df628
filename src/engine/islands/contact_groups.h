#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "engine/collision/broadphase.h"
#include "engine/dynamics/integrator_options.h"
#include "engine/dynamics/interval.h"
#include "engine/islands/contact_reach.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/island_memory.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/model/state.h"
#include "engine/support/storage.h"

namespace constraint_sim::engine {

class ContactEvents;
class ElasticSpheres;
class GroupBodies;

/// An event-driven group: islands that may touch each other, or immovable bodies, within a step.
struct ContactGroup {
  List<int> islands;
  List<Broadphase::Pair> pairs;
  Storage<ContactEvents> events;            ///< method that advances the group in this step
  std::shared_ptr<ElasticSpheres> spheres;  ///< method in place of `events`; null: none
  bool has_failed = false;                  ///< in this step: impulses advance its islands
  bool is_found = false;         ///< failed after a part of the step, which is kept (FoundPart)
  bool is_small_enough = false;  ///< small enough for `events`
  bool closes = false;           ///< has overlaps, which `events` close
  bool is_elastic = false;       ///< has only spheres that `spheres` can advance
};

/// Whether an island of this nature can be in an event-driven group, wherever its bodies are.
bool suits_group(const Model& model, std::uint64_t step_count, const IslandMembers& members,
                 MethodReason nature, const IslandMemory& memory);

/// The event-driven groups of a step: islands that may touch within the step, and few enough to be
/// advanced from event to event together. Only with `method: auto` and `event_driven`. A group has
/// no memory: each step finds its groups anew, from where the bodies are, and reuses storage.
class ContactGroups {
 public:
  bool is_empty() const { return groups_.empty(); }
  const List<ContactGroup>& groups() const { return groups_; }
  bool contains(std::size_t island) const { return !groups_.empty() && group_of_[island] >= 0; }
  /// Whether the step before had groups.
  bool had_groups() const { return had_groups_; }
  void end_choice() { had_groups_ = !groups_.empty(); }

  /// Finds the groups of a step, and compiles their equations. `touching_before` are the contacts
  /// of the step before.
  void find(const StepContext& step, const State& state, const Rollback& rollback,
            const IslandLists& lists, const AwakeSets& awake, const ContactReach& reach,
            const List<TouchingPair>& touching_before);
  /// Why an island in contact is in no group.
  MethodReason why_left(const ContactReach& reach, std::size_t island) const;
  /// Whether an island is in no group and touches something.
  bool is_left_in_contact(const StepContext& step, const State& state, const ContactReach& reach,
                          std::size_t island) const;
  /// Lists the bodies of all groups, which an edit after the step needs.
  void list_bodies(const Model& model, const IslandLists& lists, const AwakeSets& awake);
  const std::vector<BodyId>& bodies() const { return bodies_; }

  /// Advances a group.
  IntegrationResult advance(std::size_t group, const Interval& interval,
                            const IntegratorOptions& options, const WorldOptions& world_options,
                            State* state);
  void mark_failed(std::size_t group, bool is_found) {
    groups_[group].has_failed = true;
    groups_[group].is_found = is_found;
  }
  /// The group of an island that contains() is true of.
  const ContactGroup& of(std::size_t island) const { return groups_[group_of_[island]]; }
  /// Takes contacts of groups out of the contacts of impulses.
  void take_out_contacts(const Topology& topology, List<TouchingPair>* touching) const;
  /// Events of the group of an island; the first island reports the events of all.
  std::uint32_t events_of(std::size_t island) const;
  /// Work of kinematic bodies on the group of an island [J]; the first island reports all of it. 0
  /// for an island in no group.
  double driven_work_of(std::size_t island) const;

  /// Visits everything that the next step continues from, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.had_groups_);
  }

 private:
  void clear(std::size_t kept = 0);
  ContactGroup& add();
  bool compile(const StepContext& step, const State& state, const Rollback& rollback,
               const IslandLists& lists, const ContactReach& reach,
               const List<TouchingPair>& touching_before, ContactGroup* group);
  bool compile_events(const StepContext& step, const Rollback& rollback, const IslandLists& lists,
                      const List<TouchingPair>& touching_before, const ContactGroup& group);
  std::size_t add_body(const Model& model, int body, GroupBodies* bodies);
  bool add_pairs(const StepContext& step, const List<TouchingPair>& touching_before,
                 const ContactGroup& group);
  double most_work_of(const WorldOptions& options, const ContactGroup& of) const;

  List<ContactGroup> groups_;
  List<ContactGroup> unused_;    // groups kept for their storage
  List<int> group_of_;           // group of each island; -1: none
  List<int> group_at_;           // by leader of islands; -1: none
  List<MethodReason> left_for_;  // by leader: why its islands are in no group
  List<int> place_;              // place of each body in the group being compiled; -1: none
  std::vector<BodyId> bodies_;
  bool had_groups_ = false;
};

}  // namespace constraint_sim::engine
