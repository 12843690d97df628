#pragma once

#include <cstddef>
#include <cstdint>

#include "engine/constraints/prescribed.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/interval.h"
#include "engine/islands/contact_groups.h"
#include "engine/islands/contact_reach.h"
#include "engine/islands/continuous_collision.h"
#include "engine/islands/island_attempts.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/island_parts.h"
#include "engine/islands/method_partition.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/islands/step_output.h"
#include "engine/math/list.h"
#include "engine/methods/runge_kutta/free_rotation.h"
#include "engine/model/state.h"
#include "engine/support/workers.h"

namespace constraint_sim::engine {

/// Measures a joint whose bodies were moved, or that was edited. The joint closes its error from
/// the time `t` [s] on.
void begin_closing(const Model& model, std::size_t j, double t, State* state);

/// Chooses the method of each awake island, and advances the islands that are integrated.
class IslandIntegration {
 public:
  const MethodPartition& partition() const { return partition_; }
  /// Prescribed motions of all joints of integrated islands, by joint.
  const List<PrescribedMotion>& prescribed() const { return prescribed_; }
  /// Joints whose prescribed motion is not constant.
  const List<int>& time_varying_joints() const { return time_varying_joints_; }
  /// Free rotations, by body, of the bodies up to the last one that was in an integrated island.
  const List<FreeRotation>& rotations() const { return rotations_; }
  /// Wrenches in the last interval.
  const List<AppliedWrench>& loads() const { return loads_; }
  /// Ends of the intervals of a step in which nothing jumps [s].
  const List<double>& interval_ends() const { return interval_ends_; }

  /// Begins anew after an edit.
  void begin();
  /// Lets free rotations begin anew.
  void forget_rotations() { rotations_.clear(); }
  void forget_loads() { loads_.clear(); }
  /// Goes on from a snapshot that was read.
  void continue_from(const Model& model, const Topology& topology, const AwakeSets& awake,
                     const State& state, IslandLists* lists);

  /// Chooses the method of each awake island. `may_change`: contacts or awake sets changed.
  void choose_methods(const IntegrationStep& in, bool may_change, const ContactReach& reach,
                      Sleep* sleep, ContactGroups* groups);
  /// Advances the integrated islands by a step. Islands that cannot be advanced are left to
  /// impulses at the start of the step, or where events got to (FoundPart).
  void integrate(const IntegrationStep& in, const ContinuousCollision& continuous,
                 ContactGroups* groups);
  /// Compiles islands anew whose joints without axes have closed their errors.
  void compile_where_closed(const Model& model, const Topology& topology, const JointStep& interval,
                            State* state, IslandLists* lists);

  /// Visits everything that the next step continues from, as engine/support/memory.h describes, in
  /// three parts.
  template <class Self, class Visit>
  static void visit_motion(Self& self, Visit& visit) {
    visit(self.rotations_);
    visit(self.prescribed_);
    visit(self.loads_);
  }
  template <class Self, class Visit>
  static void visit_choice(Self& self, Visit& visit) {
    visit(self.any_rejected_);
    visit(self.any_needs_choice_);
  }
  template <class Self, class Visit>
  static void visit_prescribed(Self& self, Visit& visit) {
    visit(self.is_partition_new_);
    visit(self.time_varying_joints_);
  }

 private:
  void sort_islands(const IntegrationStep& in, const ContactReach& reach, Sleep* sleep,
                    ContactGroups* groups);
  void list_by_method(const Model& model, const Topology& topology, const AwakeSets& awake,
                      const State& state, const IslandLists& lists);
  void restart(const IslandParts& parts, List<IslandMotion>* motions);
  void make_room_for_rotations(const IslandParts& parts);
  void begin_entering(const IntegrationStep& in);
  void compile_if_opened(const Model& model, const Topology& topology,
                         const List<JointData>& joint_states, IslandParts* parts,
                         List<IslandMotion>* motions);
  void list_time_varying_joints(const Model& model, const State& state, const IslandLists& lists);
  void split_step(const IntegrationStep& in);
  void find_loads(const Model& model, const State& state, double from, double to);
  bool integrate_island(const IntegrationStep& in, std::size_t i, const Interval& interval);
  void advance_groups(const IntegrationStep& in, const Interval& part, bool keeps_found,
                      ContactGroups* groups);
  void give_up(const IntegrationStep& in, std::size_t i, MethodReason why, const Interval& part,
               bool keeps_found);
  void begin_anew(const IntegrationStep& in, std::size_t i, MethodReason why);
  void reject(const IntegrationStep& in, std::size_t i, MethodReason why);
  bool report_islands(const IntegrationStep& in, const ContactGroups& groups);

  MethodPartition partition_;
  bool any_rejected_ = false;      // an island is left to impulses for a while
  bool any_needs_choice_ = false;  // the method of an island has to be chosen again
  List<bool> in_contact_;          // by island
  List<int> entering_;             // islands that begin to be integrated, or were edited
  List<PrescribedMotion> prescribed_;
  bool is_partition_new_ = true;  // whether the partition changed since time_varying_joints_
  List<int> time_varying_joints_;
  List<FreeRotation> rotations_;
  List<double> interval_ends_;
  List<AppliedWrench> loads_;
  Workers workers_;
};

}  // namespace constraint_sim::engine
