#pragma once

#include <cstddef>
#include <utility>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/row.h"
#include "engine/impulses/row_solver.h"
#include "engine/math/list.h"
#include "engine/methods/time_stepping/converged_rows.h"
#include "engine/model/joint_data.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Joints of a step of impulses, all by index.
struct SteppedJoints {
  const List<int>& acting;
  const List<Joint>& joints;
  const List<std::pair<std::size_t, std::size_t>>& ends;  ///< per joint
  const List<std::size_t>& first_rows;  ///< per acting joint, and one past the last row
  const List<BodyState>& states;        ///< at the start of the step
  const List<MassProperties>& masses;
  const List<JointData>& joint_states;
  JointStep interval;
  bool move_by_end_velocity;  ///< whether bodies on joints move by h v₁
};

/// Finds the corrections of a step of impulses, and closes joints at its end. The rates of rows are
/// those of the start, while bodies turn: a motion by h J v = 0 opens a joint by d = C(x + h v) −
/// C(x) − h J v, of second order in h. Corrections have the rate −d/h beside the share of the error
/// at the start. d belongs to the motion with the corrections, so corrections are repeated; each
/// time its error is some h ω times the one before.
class JointCurvature {
 public:
  /// Solves for the corrections of rows that ConvergedRows::solve() has not swept. Joints whose
  /// bodies do not move by the last velocity are closed by their errors at the start alone.
  ConvergedRows::Outcome correct(const SteppedJoints& step, double rest_speed, StopFlag stop,
                                 ConvergedRows* converged, RowSolver* solver, List<Row>* rows);

 private:
  void begin(const SteppedJoints& step, const ConvergedRows& converged, const RowSolver& solver,
             List<Row>* rows);
  bool repeat(const SteppedJoints& step, double least, const RowSolver& solver, List<Row>* rows);
  void find_ends(const SteppedJoints& step, const RowSolver& solver);
  void find_corrections(const SteppedJoints& step, const RowSolver& solver, const List<Row>& rows);
  void leave_out_fast(const SteppedJoints& step);
  void find_changes(double least, const RowSolver& solver, const List<Row>& rows);
  void set_corrections(const RowSolver& solver, List<Row>* rows) const;

  // Per row of a joint: the value at the start, and corrections by errors at the start and by these
  // and the curvature.
  List<double> at_start_, by_errors_, by_both_;
  List<std::size_t> curved_;  // acting joints that are closed, as places in the list
  List<BodyState> ends_;      // per body; set where joints are
  // At the body of a component: how its corrections are solved for next, and their largest change;
  // 0 where curvature is left out.
  List<ConvergedRows::Start> starts_;
  List<double> changes_, last_changes_;
};

}  // namespace constraint_sim::engine
