#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/joint.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/row_solver.h"
#include "engine/model/model.h"
#include "engine/model/state.h"
#include "engine/support/stage_timer.h"

namespace constraint_sim::engine {

/// A wrench that acts on a body for a part of a step; world axes.
struct ActingWrench {
  std::size_t body;
  double duration;         ///< [s]
  Eigen::Vector3d force;   ///< [N]
  Eigen::Vector3d torque;  ///< about the centre of mass [N m]
};

/// Which bodies and joints impulses carry in a step, and what acts on them; all by index.
struct ImpulseStep {
  JointStep span;
  const List<int>& bodies;                                      ///< dynamic ones
  const List<int>& joints;                                      ///< on them, all of which act
  const List<std::pair<std::size_t, std::size_t>>& joint_ends;  ///< of all joints
  const List<bool>& is_in_loop;  ///< joints of an island that has a loop of joints
  const List<ActingWrench>& wrenches;
  StopFlag stop;
  Clock clock;
};

/// What the method did, and what it cost.
struct ImpulseReport {
  std::uint32_t rows = 0, contacts = 0, iterations = 0;
  double max_penetration = 0.0;  ///< [m]
  double solver_residual = 0.0;  ///< [m/s]
  double driven_work = 0.0;      ///< of wrenches, motors and kinematic bodies [J]
  double correction_work = 0.0;  ///< of what closes errors [J]
  StageTimes stage_times{};      ///< [s]
};

/// Stages 3 to 6 of the tutorial's step, for the islands that no other method can carry. Owns the
/// rows of a step; between steps these are only scratch memory.
class SequentialImpulses {
 public:
  /// Carries the bodies of `step` to its end.
  ImpulseReport advance(const Model& model, const ImpulseStep& step, State* state);
  /// Reads back from the rows what they did to the joints and contacts, at the positions after the
  /// step, and what of the velocities closed errors and is to be taken out as the next step begins.
  /// Returns the work of that [J].
  double finish(const Model& model, const ImpulseStep& step, State* state);
  /// Writes what of the rows' impulses balances itself; only where the step is not taken back.
  void keep_self_stress(List<SelfStress>* self_stress) const;

 private:
  double prepare_rows(const Model& model, const ImpulseStep& step, State* state);
  void add_coupling(const Model& model, const ImpulseStep& step, const State& state,
                    std::size_t joint);
  static std::array<Jacobian, 2> coupled_jacobians(const Model& model, const ImpulseStep& step,
                                                   const State& state, std::size_t joint,
                                                   bool at_end);
  void prepare_contact(const Model& model, const State& state, const TouchingPair& pair,
                       std::size_t point);
  void update_velocities(const Model& model, const ImpulseStep& step, State* state);
  void lose_self_stress(const WorldOptions& options, const List<SelfStress>& known);
  double finish_corrections(const Model& model, const ImpulseStep& step, State* state);
  void read_contacts(List<TouchingPair>* touching) const;

  List<Row> rows_;
  List<std::size_t> joint_rows_;    // first row of each joint, and one past the last
  List<std::size_t> contact_rows_;  // row of the normal of each contact point
  List<LoopRow> loop_rows_;         // only with warm starting
  RowSolver solver_;
};

}  // namespace constraint_sim::engine
