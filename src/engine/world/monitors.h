#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/report.h"
#include "constraint_sim/engine/world.h"
#include "engine/islands/contact_groups.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/island_parts.h"
#include "engine/islands/method_partition.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/topology.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"
#include "engine/world/energy.h"

namespace constraint_sim::engine {

/// Everything that the monitors read, at the end of a step.
struct MonitorInput {
  const Model& model;
  const State& state;
  const Topology& topology;
  const Rollback& rollback;
  const AwakeSets& awake;
  const ContactGroups& groups;
  const MethodPartition& partition;
};

/// Measures a step once it is over: errors of joints, and energy. Finds errors that nothing closes,
/// contacts that creep or overlap, and energy that rises without a cause. Changes no motion.
class Monitors {
 public:
  /// Steps between comparisons of energies.
  static constexpr int kWindow = 16;

  /// Restarts all measurements after an edit: reference energy, windows, and which bodies have
  /// moved. Writes the energies of islands to `lists`.
  void begin(const Model& model, const State& state, const Topology& topology, IslandLists* lists);
  /// Stores errors, penetration and energy of sleeping islands. measure() adds them to each report.
  void set_resting(const Model& model, const State& state, const RestingSets& resting,
                   const IslandLists& lists);
  void note_wrench_ended() { has_wrench_ended_ = true; }
  /// Measures a step.
  void measure(const MonitorInput& in, IslandLists* lists, StepReport* report);

  /// Joints whose errors nothing closes, in the order of adding.
  const std::vector<JointId>& unclosed() const { return unclosed_; }
  void set_unclosed(const std::vector<JointId>& joints) { unclosed_ = joints; }

  /// Visits everything that the next step continues from, as engine/support/memory.h describes:
  /// first the energies since the last edit.
  template <class Self, class Visit>
  static void visit_energies(Self& self, Visit& visit) {
    visit(self.reference_energy_);
    visit(self.largest_kinetic_energy_);
  }
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.open_);
    visit(self.open_before_);
    visit(self.held_);
    visit(self.held_before_);
    visit(self.has_moved_);
    visit(self.steps_);
    visit(self.impulse_work_);
    visit(self.has_wrench_ended_);
    visit(self.awake_changed_);
    visit(self.gain_);
    visit(self.energy_rise_);
    visit(self.energy_rise_body_);
    visit(self.unclosed_);
  }

  /// A joint that is off by more than kUnclosedError or kUnclosedAngle.
  struct UnclosedJoint {
    JointId id;
    double error = 0.0;  ///< error when the joint was first off, or had last fallen by a tenth [m]
    double age = 0.0;    ///< time since `error` was set [s]
    /// Time at which the joint began to close [s]; a later time restarts `age`.
    double closing_since = 0.0;
  };
  /// A pair of bodies whose contact impulses hold, in the order of their places.
  struct HeldPair {
    BodyId a, b;
    int part_a = 0, part_b = 0;                      ///< numbers of the shapes in their bodies
    double overlapping = 0.0;                        ///< duration of a too deep overlap [s]
    Eigen::Vector3d slid = Eigen::Vector3d::Zero();  ///< slip of A on B while friction holds [m]
  };

 private:
  void watch_joints(const MonitorInput& in, const IslandLists& lists, StepReport* report);
  void watch_contacts(const MonitorInput& in, StepReport* report);
  void watch_energy(const MonitorInput& in, IslandLists* lists, StepReport* report);
  void compare_energies(const MonitorInput& in, IslandLists* lists);
  double compare_island(const Model& model, const State& state, const Island& island,
                        double* allowed, IslandParts* parts) const;
  void note_rise(const Model& model, const IslandParts& parts, double gain, double allowed);

  List<UnclosedJoint> open_, open_before_;  // in the order of adding
  // Pairs whose overlap or creep is watched, in the order of places.
  List<HeldPair> held_, held_before_;
  // Bodies that moved faster than bodies at rest since the last edit; by index, or empty.
  List<char> has_moved_;
  // Since the last comparison of energies: steps, whether a wrench ended or the awake sets changed,
  // and the work on islands that impulses advance [J].
  int steps_ = 0;
  double impulse_work_ = 0.0;
  bool has_wrench_ended_ = false, awake_changed_ = false;
  double gain_ = 0.0;         // rise of all islands that impulses advance, above its minimum [J]
  double energy_rise_ = 0.0;  // largest rise without a cause [J]
  BodyId energy_rise_body_;
  std::vector<JointId> unclosed_;
  double reference_energy_ = 0.0;        // [J] at the last edit
  double largest_kinetic_energy_ = 0.0;  // [J] since the last edit
  StepReport resting_report_;
  Energy resting_energy_;
};

}  // namespace constraint_sim::engine
