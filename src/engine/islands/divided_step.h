#pragma once

#include <algorithm>
#include <cstdint>

#include "engine/collision/broadphase.h"
#include "engine/constraints/joint_sum.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Duration of a hit, as a share of the time step.
inline constexpr double kInstantDuration = 1e-9;

/// Bodies that impulses advance together, and the joints on them, by index.
struct ImpulseGroup {
  List<int> bodies;  ///< dynamic bodies
  List<int> joints;

  bool is_empty() const { return bodies.empty(); }
};

/// Adds the results of impulses to the sums of other impulses.
inline void add_impulses(const ImpulseReport& impulses, ImpulseReport* sums) {
  sums->rows += impulses.rows;
  sums->contacts += impulses.contacts;
  sums->max_penetration = std::max(sums->max_penetration, impulses.max_penetration);
  sums->iterations += impulses.iterations;
  sums->solver_residual = std::max(sums->solver_residual, impulses.solver_residual);
  if (impulses.unsolved_body) sums->unsolved_body = impulses.unsolved_body;
  sums->driven_work += impulses.driven_work;
  sums->correction_work += impulses.correction_work;
  for (std::size_t i = 0; i < kStageCount; ++i) sums->stage_times[i] += impulses.stage_times[i];
}

/// Adds the results of impulses to the report of a step.
inline void add_impulses(const ImpulseReport& impulses, StepReport* report) {
  report->costs.rows += impulses.rows;
  report->contacts.points += impulses.contacts;
  report->contacts.max_penetration =
      std::max(report->contacts.max_penetration, impulses.max_penetration);
  report->costs.iterations += impulses.iterations;
  report->contacts.solver_residual =
      std::max(report->contacts.solver_residual, impulses.solver_residual);
  if (impulses.unsolved_body) report->contacts.unsolved_body = impulses.unsolved_body;
  report->energy.driven_work += impulses.driven_work;
  report->energy.correction_work += impulses.correction_work;
  for (std::size_t i = 0; i < kStageCount; ++i)
    report->costs.stage_times[i] += impulses.stage_times[i];
}

/// Finds the contact of two shapes in a list sorted by TouchingPair::in_order; null where there is
/// none.
const TouchingPair* find_contact(const List<TouchingPair>& pairs, const ShapePair& shapes);
/// Makes a contact of two shapes, without points.
TouchingPair new_contact(const Model& model, const ShapePair& shapes);
/// Adds the contacts of a part of a step to `sums`, the contacts of the earlier parts with their
/// summed impulses.
void add_contacts(const List<TouchingPair>& of_part, List<TouchingPair>* sums);

/// A time step of bodies that impulses advance in parts: of the group of fast bodies
/// (ContinuousCollision), or of a group of error control (ContactControl).
class DividedStep {
 public:
  void begin(const StepContext& step, const ImpulseGroup& group);
  /// Sums the impulses of joints over the parts of this step.
  void begin_joint_sums() { joint_sums_.assign(group_.joints.size(), {}); }
  const ImpulseGroup& group() const { return group_; }
  /// Whether a body belongs to the group.
  bool contains(int body) const { return is_member_[body]; }
  /// Forgets the group.
  void clear() { group_.bodies.clear(); }

  /// Pairs that may touch within a duration, of the group with itself and with immovable bodies.
  /// Sets `is_any_left` where a body of the group may hit another body that has taken its step.
  List<Broadphase::Pair> find_pairs(const StepContext& step, const State& state,
                                    const List<int>& moving_shapes, double duration,
                                    Broadphase* broadphase, bool* is_any_left);
  /// Advances the group by a part of the step, which begins `done` [s] after the start of the step.
  /// With sums of joints, errors of joints close in all parts as they do in a step.
  ImpulseReport advance(const StepContext& step, const List<ActingWrench>& wrenches, double done,
                        double duration, const ContactStep& contacts, ImpulseStepKind kind,
                        SequentialImpulses* method, State* state);
  /// Adds the impulses of joints in a part of the step to their sums.
  void sum_joints(const Model& model, double duration, State* state);
  /// Sets the mean forces of joints in the step, if their impulses are summed.
  void finish_joints(const StepContext& step, State* state) const;

 private:
  ImpulseGroup group_;
  List<bool> is_member_;       // by body
  List<JointSum> joint_sums_;  // by joint of the group; empty where they are not summed
  List<Proxy> proxies_;
};

}  // namespace constraint_sim::engine
