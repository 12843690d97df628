#pragma once

#include <optional>

#include "engine/islands/contact_pipeline.h"
#include "engine/islands/controlled_step.h"
#include "engine/islands/island_lists.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Advances all bodies in contact so that their errors stay within `contact_tolerance`. Bodies that
/// may touch within the step, or that joints connect, are a group of error control. Its time step
/// is divided into parts of its own.
class ContactControl {
 public:
  /// Result of all groups of error control: the error is the largest of a group.
  struct Outcome : ControlledStep::Outcome {
    std::optional<int> left_body;  ///< first body of a group that left hits out
  };

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
  struct ErrorGroup {
    ImpulseGroup members;
    List<Broadphase::Pair> near;
    List<TouchingPair> contacts;
    double done = 0.0;          // part of the step that the group has taken [s]
    bool has_left_any = false;  // a body that had taken its step may be hit
  };
  List<ErrorGroup> find_groups(const StepContext& step, const List<int>& bodies,
                               const List<int>& joints, const IslandLists& lists,
                               const List<Broadphase::Pair>& near, State* state) const;

  ControlledStep controlled_;
  List<double> errors_;  // by body; empty where this step has none
};

}  // namespace constraint_sim::engine
