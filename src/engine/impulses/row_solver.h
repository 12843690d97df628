#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/row.h"
#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"
#include "engine/model/twist.h"

namespace constraint_sim::engine {

/// Largest s in [0, 1] with quadratic s² + linear s ≤ most, for quadratic > 0 and most ≥ 0.
double largest_scale(double quadratic, double linear, double most);

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
/// positions; first order in h. An impulse p changes the lasting velocities v. An impulse b of
/// Baumgarte's correction changes velocities w that move bodies in this step only, so that closing
/// errors adds no kinetic energy. `moved`: indices of the bodies to advance.
/// Energy. With Δv = v₁ − v₀ and ζ the rates of motors, a step adds to kinetic energy and that of
/// gravity, beyond the work of wrenches, motors and kinematic bodies: Σ pᵢ (Jᵢ v₁ − ζᵢ) − ½ Δvᵀ M
/// Δv. Where unconverged sweeps or simultaneous bounces make the sum positive, impulses are scaled
/// down until it is zero.
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
  void begin(const List<int>& moved, const Bodies& bodies);

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
  /// Makes bounces of components that gained energy by them lower, in proportion to the gain and in
  /// the end to 0. Returns whether there are any, which are to be solved again.
  bool lower_bounces(const List<int>& moved, bool to_zero, List<Row>& rows);
  /// Allows the component that is stored at a body a gain by v₁ that positions give back [J].
  void allow_gain(int body, double gain) { components_[body].allowed = gain; }

  /// J M⁻¹ Jᵀ of row i.
  double inverse_mass(std::size_t i) const { return responses_[i].K; }
  /// Index of a body of the component of row i, the same for all rows of a component.
  int component(std::size_t i) const { return responses_[i].component; }
  /// Index of a body of the component of a body, the same for all of its bodies. Needs rows.
  int component_of(int body);
  /// Energy beyond the work from outside that a component gains where its bodies move by v₁ [J], at
  /// the last finish_solve() or lower_bounces(); and what it gains besides where a body moves by
  /// ½ (v₀ + v₁) [J]. Both need rows.
  double gain(int component) const {
    return components_[component].work - components_[component].absorbed;
  }
  double gain_by_mean(int body) const {
    return 0.5 * by_loads_[body].dot(velocity_change(to_index(body)).head<3>()) /
           inertias_[body].inverse_mass;
  }
  /// Rate J v of row i.
  double rate(const Row& row, std::size_t i) const;
  /// Rate J v of row i at the start of the step.
  double rate_before(const Row& row, std::size_t i) const;
  /// Change of the lasting velocity of a body in the step.
  Twist velocity_change(std::size_t body) const { return velocities_[body] - before_[body]; }
  /// Target of J w for a row with the rate J v [m/s]. A one-sided row demands no more than v leaves
  /// open.
  static double correction_target(const Row& row, double J_V);
  /// Gives row i its impulse, or the impulse of its correction; both parts of a coupled row.
  void set_impulse(std::size_t i, double impulse, List<Row>* rows);
  void set_correction(std::size_t i, double impulse, List<Row>* rows);

  /// Stage 6: x += h (v + w), and q by the rotation h (ω + w), with w the correction velocities.
  /// Conserves the angular momentum of every free body. Sets velocities of bodies to v + w. Returns
  /// the work of the motion by w [J].
  double update_positions(const List<int>& moved, const Masses& masses,
                          const Eigen::Vector3d& gravity, double h, Bodies& bodies);

  /// Whether finish_row() and take_out_corrections() have to be called.
  bool is_to_finish() const { return is_to_finish_; }
  /// Takes the Jacobian and the value after the step of row i, a row of a joint.
  void finish_row(std::size_t i, const Row& row, const Jacobian& J, double C);
  /// Writes to `corrections` the velocities to remove at the start of the next step: w by impulses
  /// along the Jacobians after the step, so that momenta are conserved. Returns the work of
  /// corrections against springs, and of bodies that are pulled together while they rotate about
  /// each other [J].
  double take_out_corrections(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                              List<Twist>* corrections);

  /// Velocity v + w of a body after the solve.
  Twist final_velocity(std::size_t body) const { return velocities_[body] + corrections_[body]; }
  /// Correction velocity w of a body after the solve.
  Twist correction(std::size_t body) const { return corrections_[body]; }

 private:
  /// Response of one row: J and M⁻¹ Jᵀ of each body, K = J M⁻¹ Jᵀ, and 1/(K + softness).
  struct Response {
    Twist J_A, J_B, response_a, response_b;
    double K, effective_mass;
    int component;
    bool corrects;                 // whether any row of the component has a correction
    double rate, correction_rate;  // rates of springs, relative to the motor
  };
  struct Inertia {
    Eigen::Matrix3d R, inverse_W;  // values of bodies that can rotate
    Eigen::Vector3d principal;
    double inverse_mass;
    bool is_moved, can_turn;
  };
  /// Angular momentum of a component that corrections leave.
  struct LostMomentum {
    Eigen::Vector3d L = Eigen::Vector3d::Zero();
    double most = 0.0;  // Σ m h ‖w‖ ‖v‖ [kg m²/s]
    bool is_given_back = false;
  };
  /// Component of bodies that rows connect, stored at the index of one of its bodies.
  struct Component {
    bool corrects = false;
    bool gains = false;
    bool is_attached = false;  // whether connected to a body that impulses do not move
    double work = 0.0;         // Σ pᵢ (Jᵢ v − ζᵢ)
    double absorbed = 0.0;     // ½ Δvᵀ M Δv
    double allowed = 0.0;      // gain beyond `absorbed` that positions give back
    bool has_springs = false;
    bool has_limited_springs = false;  // servos with a force limit
    double linear = 0.0, quadratic = 0.0, free = 0.0, scale = 1.0, damping = 0.0;
    LostMomentum lost;
  };

  /// Component as one rigid body.
  struct Rigid {
    double mass = 0.0;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double energy = 0.0;  // kinetic
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    Eigen::Vector3d L = Eigen::Vector3d::Zero(), L_of_changes = Eigen::Vector3d::Zero();
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
    Eigen::Vector3d turning = Eigen::Vector3d::Zero();  // compensates the damping
    Eigen::Vector3d turning_of_changes = Eigen::Vector3d::Zero();
  };

  void prepare_bodies(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                      const List<Row>& rows);
  void connect(const List<Row>& rows);
  void respond(const List<Row>& rows);
  void warm_start(const List<int>& moved, List<Row>& rows);
  /// Solves a row; true where the next row has been solved with it.
  bool solve_next(Row* row, const Response* response, List<Row>& rows);
  void solve_row(Row& row, const Response& response);
  void correct(Row& row, const Response& response, double J_V);
  double wanted_correction(const Row& row, const Response& response, double J_V, double J_W) const;
  static void join_parts(const Row& first, const Row& second, Response* of_second);
  void solve_coupled(Row* row, const Response* response);
  void solve_friction(double normal_impulse, Row* row, const Response* response);
  static double velocity_along(const Row& row, const Response& response,
                               const List<Twist>& velocities);
  static void push(const Row& row, const Response& response, double impulse,
                   List<Twist>* velocities);
  double kinetic_energy(int body, const Twist& velocity) const;
  Outcome account(const List<int>& moved, const List<Row>& rows);
  bool limit_energy(const List<int>& moved, List<Row>& rows);
  void gather_rigid(const List<int>& moved, const Masses& masses, const Bodies& bodies);
  double limit_changes(const List<int>& moved, const Masses& masses, const Bodies& bodies);
  double keep_angular_momentum(const List<int>& moved, const Masses& masses, const Bodies& bodies);

  // Per body: v₀, v, w, and the effect of impulses alone.
  List<Twist> before_, velocities_, corrections_, effects_;
  List<Eigen::Vector3d> by_loads_;  // change of the linear velocity by gravity and wrenches
  List<Inertia> inertias_;
  List<int> parents_;  // union-find: parent of each body; a root, its own parent, is a component
  List<Component> components_;
  List<Rigid> rigid_;
  List<int> loop_rows_of_;
  List<Response> responses_;
  double h_ = 0.0;
  double spring_work_ = 0.0;
  bool any_corrections_ = false, is_to_finish_ = false;
};

/// Rotates a body for h [s] without torque; ω of a body with three different moments changes at
/// constant L.
void advance_orientation(const MassProperties& mass, double h, BodyState* body);

/// Advances kinematic bodies: x += h v, and q by the rotation h ω.
void advance_kinematic(const List<int>& moved, double h, List<BodyState>& bodies);

}  // namespace constraint_sim::engine
