#pragma once

#include "engine/islands/contact_pipeline.h"
#include "engine/islands/controlled_step.h"
#include "engine/islands/island_lists.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Advances all bodies in contact so that their errors stay within `contact_tolerance`, each group
/// of bodies that may touch within the step, or that joints connect, by parts of its own.
class ContactControl {
 public:
  /// Result of all groups; the error of `outcome` is the largest of a group.
  using Outcome = ControlledStep::Outcome;

  void begin_step() { errors_.clear(); }
  Outcome advance(const StepContext& step, const AwakeSets& awake, const List<int>& bodies,
                  const List<int>& joints, const IslandLists& lists,
                  const List<ActingWrench>& wrenches, ContactPipeline* pipeline,
                  SequentialImpulses* method, State* state);
  /// Whether the bodies of this step were advanced here.
  bool is_used() const { return !errors_.empty(); }
  /// Error estimate of a body of this step [m].
  double error_of(int body) const { return errors_[body]; }

 private:
  struct Group {
    ImpulseGroup members;
    List<Broadphase::Pair> near;
    List<TouchingPair> contacts;
  };
  List<Group> find_groups(const StepContext& step, const List<int>& bodies, const List<int>& joints,
                          const IslandLists& lists, const List<Broadphase::Pair>& near,
                          State* state) const;

  ControlledStep controlled_;
  List<double> errors_;  // by body; empty where this step has none
};

}  // namespace constraint_sim::engine
