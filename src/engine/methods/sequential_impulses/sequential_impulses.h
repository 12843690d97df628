#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/contact.h"
#include "engine/constraints/joint.h"
#include "engine/impulses/row_solver.h"
#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/step_error.h"
#include "engine/methods/time_stepping/converged_rows.h"
#include "engine/methods/time_stepping/joint_curvature.h"
#include "engine/model/model.h"
#include "engine/model/state.h"
#include "engine/support/stage_timer.h"

namespace constraint_sim::engine {

/// Wrench on a body for a part of a step; world axes.
struct ActingWrench {
  std::size_t body;
  double duration;         ///< [s]
  Eigen::Vector3d force;   ///< [N]
  Eigen::Vector3d torque;  ///< about the centre of mass [N m]
};

/// Settings of the contacts of a step of `h` [s].
ContactStep contact_step(const WorldOptions& options, double h);

/// Kinds of steps of impulses.
enum class ImpulseStepKind {
  kWhole,  ///< a time step
  /// A part whose error is estimated: bodies on joints move by the mean of their velocities, and
  /// loads of redundant contacts are unique.
  kPart,
  kLargePart,  ///< a part of many bodies: contacts in motion are solved as in a whole step
  kInstant,    ///< an impact, in which gaps of joints cannot close
};

/// Bodies and joints of the method in a step, and their loads; all by index.
struct ImpulseStep {
  JointStep interval;
  ContactStep contacts;
  ImpulseStepKind kind;
  const List<int>& bodies;                                      ///< dynamic bodies
  const List<int>& joints;                                      ///< acting joints of the bodies
  const List<std::pair<std::size_t, std::size_t>>& joint_ends;  ///< one pair per joint of the world
  const List<bool>& is_in_loop;  ///< per joint: its island has a loop of joints
  const List<ActingWrench>& wrenches;
  StopFlag stop;
  Clock clock;
};

/// Results and cost of a step.
struct ImpulseReport {
  std::uint32_t rows = 0, contacts = 0, iterations = 0;
  double max_penetration = 0.0;         ///< [m]
  double solver_residual = 0.0;         ///< [m/s]
  double driven_work = 0.0;             ///< work of wrenches, motors and kinematic bodies [J]
  double correction_work = 0.0;         ///< work of position corrections [J]
  std::optional<BodyId> unsolved_body;  ///< StepReport::Contacts::unsolved_body
  bool has_swept = false;               ///< whether rows were swept, for there were too many
  StageTimes stage_times{};             ///< [s]
};

/// Stages 3 to 6 of the step in the tutorial, for islands that no other method can advance. Owns
/// the rows of a step; between steps these are scratch memory. With time_stepping, stage 5 solves
/// the rows to a tolerance instead of sweeping over them.
class SequentialImpulses {
 public:
  /// Begins a time step of a world with so many bodies.
  void begin_step(std::size_t bodies) { error_.begin_step(bodies); }
  /// Advances the bodies of `step` to the end of the step.
  ImpulseReport advance(const Model& model, const ImpulseStep& step, State* state);
  /// Reads results of joints and contacts from the rows, at the positions after the step, and the
  /// correction velocities to remove at the start of the next step. Returns the work of the
  /// corrections [J].
  double finish(const Model& model, const ImpulseStep& step, State* state);
  /// Velocity of a body after the last step, and its change in it, without corrections.
  Twist velocity(std::size_t body) const {
    return solver_.final_velocity(body) - solver_.correction(body);
  }
  Twist velocity_change(std::size_t body) const { return solver_.velocity_change(body); }
  /// Velocity by which the centre of a body moved in the last step, less the mean of its velocities
  /// before and after [m/s].
  Eigen::Vector3d off_mean(std::size_t body) const;
  /// Error estimate of a body in this time step [m], summed over its parts of kind kWhole; NaN
  /// where impulses were not solved, or sweeps left a residual.
  double error_of(std::size_t body) const { return error_.of(body); }
  /// Writes the self-stress of the rows. Called only where the step is not taken back.
  void keep_self_stress(List<SelfStress>* self_stress) const;

 private:
  double prepare_rows(const Model& model, const ImpulseStep& step, State* state);
  void add_coupling(const Model& model, const ImpulseStep& step, const State& state,
                    std::size_t joint);
  RowSolver::Outcome solve_rows(const Model& model, const ImpulseStep& step, const State& state,
                                ImpulseReport* report);
  static std::array<Jacobian, 2> coupled_jacobians(const Model& model, const ImpulseStep& step,
                                                   const State& state, std::size_t joint,
                                                   bool at_end);
  void prepare_contact(const Model& model, const ContactStep& contacts, const State& state,
                       const TouchingPair& pair, std::size_t point);
  void bound_open_rows(std::size_t of_joints, const State& state);
  void update_velocities(const Model& model, const ImpulseStep& step, State* state);
  void lose_self_stress(const WorldOptions& options, const List<SelfStress>& known);
  double finish_corrections(const Model& model, const ImpulseStep& step, State* state);
  void read_contacts(List<TouchingPair>* touching) const;
  Eigen::Vector3d by_mean(std::size_t body) const;
  void add_errors(const Model& model, const ImpulseStep& step, const State& state,
                  const ImpulseReport& report);
  bool has_estimate(const Model& model, const ImpulseStep& step, const ImpulseReport& report) const;
  void add_work(const List<ActingWrench>& wrenches, bool is_solved, ImpulseReport* report) const;

  List<Row> rows_;
  List<std::size_t> joint_rows_;    // first row of each joint, and one past the last
  List<std::size_t> contact_rows_;  // row of the normal of each contact point
  List<LoopRow> loop_rows_;         // rows of joints in loops; empty without warm starting
  RowSolver solver_;
  ConvergedRows converged_;
  JointCurvature curvature_;
  StepError error_;
};

}  // namespace constraint_sim::engine
