#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/row.h"
#include "engine/impulses/energy_account.h"
#include "engine/impulses/impulse_positions.h"
#include "engine/impulses/row_system.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"
#include "engine/model/twist.h"

namespace constraint_sim::engine {

/// Row of a joint in a loop of joints, with the known share n of its impulse that balances itself
/// [N s]: Jᵀ n = 0 over all rows.
struct LoopRow {
  std::size_t row;
  std::size_t joint;
  int component;  ///< index among the rows of the joint
  double share;
  double impulse;  ///< impulse of the row when the share was found [N s]
};

/// Solves the rows of sequential_impulses: gravity, sweeps over the rows at velocity level, then
/// positions; first order in h. An impulse p changes the lasting velocities v, from v₀ at the start
/// of the step to v₁ after the solve. An impulse b of Baumgarte's correction changes velocities w
/// that move bodies in this step only, so that closing errors adds no kinetic energy. `moved`:
/// indices of the bodies to advance. RowSystem has the bodies and the responses of the rows,
/// EnergyAccount limits the energy, ImpulsePositions moves the bodies.
class RowSolver {
 public:
  using Bodies = List<BodyState>;
  using Masses = List<MassProperties>;

  /// Remaining error of the sweeps, and work from outside.
  struct Outcome {
    double residual = 0.0;     ///< largest remaining |J v − target| except of friction [m/s]
    double driven_work = 0.0;  ///< work of motors and kinematic bodies [J]
  };

  /// Notes the velocities at the start of the step, before wrenches act.
  void begin(const List<int>& moved, const Bodies& bodies) { system_.begin(moved, bodies); }

  /// Removes the share `part` of the self-stress from the first guesses, and refines the
  /// self-stress by `sweeps` sweeps, so that impulses of redundant joints tend to least norm.
  /// Changes velocities by no more than the error of the self-stress. Called after
  /// update_velocities().
  void lose_self_stress(List<Row>& rows, List<LoopRow>* loop_rows, double part, int sweeps);

  /// Stage 4: adds h g and the first guesses of the rows to the velocities.
  void update_velocities(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                         const Eigen::Vector3d& gravity, double h, List<Row>& rows);

  /// Stage 5: sweeps over the rows and leaves the impulses in them. Ends early once `stop` is set.
  Outcome solve(const List<int>& moved, List<Row>& rows, int iterations, StopFlag stop = nullptr);
  /// Sweeps over some rows, which include both tangents of a contact and both parts of a row.
  void sweep(const List<std::size_t>& which, int iterations, StopFlag stop, List<Row>& rows);
  /// Second half of solve(): limits the energy, and measures the impulses. The first half is the
  /// sweeps, or impulses by the functions below.
  Outcome finish_solve(const List<int>& moved, List<Row>& rows);
  /// EnergyAccount::lower_bounces(), at the present velocities.
  bool lower_bounces(const List<int>& moved, bool to_zero, List<Row>& rows);
  /// Allows the component that is stored at a body a gain by v₁ that positions give back [J].
  void allow_gain(int body, double gain) { energy_.allow(body, gain); }

  /// J M⁻¹ Jᵀ of row i.
  double inverse_mass(std::size_t i) const { return system_.response(i).K; }
  /// Index of a body of the component of row i, the same for all rows of a component.
  int component(std::size_t i) const { return system_.response(i).component; }
  /// Index of a body of the component of a body, the same for all of its bodies. Needs rows.
  int component_of(int body) const { return system_.component_of(body); }
  /// Energy beyond the work from outside that a component gains where its bodies move by v₁ [J], at
  /// the last finish_solve() or lower_bounces(); and what it gains besides where a body moves by
  /// ½ (v₀ + v₁) [J]. Both need rows.
  double gain(int component) const { return energy_.gain(component); }
  double gain_by_mean(int body) const { return system_.gain_by_mean(body); }
  /// Rate J v of row i.
  double rate(const Row& row, std::size_t i) const {
    return rate_of(row, system_.response(i), system_.velocities());
  }
  /// Rate J v of row i at the start of the step.
  double rate_before(const Row& row, std::size_t i) const {
    return rate_of(row, system_.response(i), system_.before());
  }
  /// Rate J (v + w) of row i, by which bodies move.
  double moving_rate(const Row& row, std::size_t i) const {
    return rate(row, i) + rate_of(row, system_.response(i), system_.corrections());
  }
  /// Returns where v + w take a body of a row from its state at the start of the step.
  BodyState moved(std::size_t body, const MassProperties& mass, BodyState state) const {
    ImpulsePositions::move(mass, system_.h(), system_.velocities()[body],
                           system_.corrections()[body], &state);
    return state;
  }
  /// Takes over corrections of the rows that were changed.
  void find_corrections(const List<Row>& rows) { system_.find_corrections(rows); }
  /// Change of the lasting velocity of a body in the step.
  Twist velocity_change(std::size_t body) const { return system_.change(body); }
  /// Target of J w for a row with the rate J v [m/s]. A one-sided row demands no more than v leaves
  /// open.
  static double correction_target(const Row& row, double J_V);
  /// Gives row i its impulse, or the impulse of its correction; both parts of a coupled row.
  void set_impulse(std::size_t i, double impulse, List<Row>* rows);
  void set_correction(std::size_t i, double impulse, List<Row>* rows);

  /// Stage 6, as ImpulsePositions::advance().
  double update_positions(const List<int>& moved, const Masses& masses,
                          const Eigen::Vector3d& gravity, Bodies& bodies) {
    return positions_.advance(moved, masses, gravity, &system_, &bodies);
  }
  /// Whether finish_row() and take_out_corrections() have to be called.
  bool is_to_finish() const { return system_.any_corrections() || energy_.has_springs(); }
  /// As ImpulsePositions::finish_row().
  void finish_row(std::size_t i, const Row& row, const Jacobian& J, double C) {
    positions_.finish_row(i, row, J, C, &system_, &energy_);
  }
  /// As ImpulsePositions::take_out_corrections().
  double take_out_corrections(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                              List<Twist>* to_remove) {
    return positions_.take_out_corrections(moved, masses, bodies, energy_, &system_, to_remove);
  }

  /// Velocity v + w of a body after the solve.
  Twist final_velocity(std::size_t body) const {
    return system_.velocities()[body] + system_.corrections()[body];
  }
  /// Correction velocity w of a body after the solve.
  Twist correction(std::size_t body) const { return system_.corrections()[body]; }

 private:
  /// First guesses of a component: p (J v − target), p A p, and a bound on the effect of its
  /// self-stress.
  struct Guess {
    double linear = 0.0, quadratic = 0.0, free = 0.0, scale = 1.0;
  };

  void warm_start(const List<int>& moved, List<Row>& rows);
  /// Solves a row; true where the next row has been solved with it.
  bool solve_next(Row* row, const RowResponse* response, List<Row>& rows);
  void solve_row(Row& row, const RowResponse& response);
  void correct(Row& row, const RowResponse& response, double J_V);
  void solve_coupled(Row* row, const RowResponse* response);
  void solve_friction(double normal_impulse, Row* row, const RowResponse* response);
  double change_by_sweep(const List<Row>& rows, std::size_t i, double J_V) const;
  Outcome measure(const List<int>& moved, const List<Row>& rows);

  RowSystem system_;
  EnergyAccount energy_;
  ImpulsePositions positions_;
  List<Guess> guesses_;     // per body; used at the body of a component
  List<int> loop_rows_of_;  // number of rows in loops, per body
};

}  // namespace constraint_sim::engine
