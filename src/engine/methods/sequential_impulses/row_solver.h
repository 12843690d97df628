#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/row.h"
#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Linear and angular velocity, one above the other, world axes [m/s, rad/s].
using Twist = Eigen::Matrix<double, 6, 1>;

inline Twist twist(const Eigen::Vector3d& linear, const Eigen::Vector3d& angular) {
  Twist both;
  both << linear, angular;
  return both;
}

/// The s in [0, 1] up to which quadratic s² + linear s ≤ most, where it is not at 1; quadratic > 0,
/// most ≥ 0.
double largest_scale(double quadratic, double linear, double most);

/// A row of a joint in a loop of joints, and the share n of its impulse that balances itself, as
/// far as known [N s]: Jᵀ n = 0 over all rows.
struct LoopRow {
  std::size_t row;
  std::size_t joint;
  int component;  ///< of the joint's rows
  double share;
  double impulse;  ///< of the row, when the share was found [N s]
};

/// Solves the rows of sequential_impulses: gravity, then one row after the other at velocity level
/// until the sweeps are used up, then positions. First order in h. Each row has two impulses: p of
/// the motion that lasts, with velocities v, and b of Baumgarte's correction, with velocities w
/// that move the bodies in this step alone. w starts from zero in every step, so no error that is
/// closed leaves kinetic energy behind. `moved` are the bodies to advance, by index. Between steps
/// the class holds only scratch memory.
///
/// Energy. With Δv = v₁ − v₀ and ζ the rates that motors ask for, a step changes kinetic energy and
/// that of gravity, less the work of wrenches, motors and kinematic bodies, by exactly
///   Σ pᵢ (Jᵢ v₁ − ζᵢ) − ½ Δvᵀ M Δv.
/// Where sweeps that did not converge, or bounces at several places at once, make that positive,
/// the impulses of those bodies are scaled down until it is zero.
class RowSolver {
 public:
  using Bodies = List<BodyState>;
  using Masses = List<MassProperties>;

  /// What the sweeps left, and what was done from outside.
  struct Outcome {
    double residual = 0.0;     ///< largest |J v − target|, of corrections too, that is left [m/s]
    double driven_work = 0.0;  ///< of motors and kinematic bodies [J]
  };

  /// Notes the velocities at the start of the step; before wrenches act.
  void begin(const List<int>& moved, const Bodies& bodies);

  /// Takes a part of what balances itself out of the first guesses, and finds it better by so many
  /// sweeps: impulses of redundant joints tend to those of least norm. Changes no velocity by more
  /// than the share is off. After update_velocities().
  void lose_self_stress(List<Row>& rows, List<LoopRow>* loop_rows, double part, int sweeps);

  /// 4. v += h g, and what the rows' first guesses do.
  void update_velocities(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                         const Eigen::Vector3d& gravity, double h, List<Row>& rows);

  /// 5. Sweeps over the rows; leaves the impulses in them. Ends early once `stop` is set.
  Outcome solve(const List<int>& moved, List<Row>& rows, int iterations, StopFlag stop = nullptr);

  /// 6. x += h (v + w), q by the rotation h (ω + w); keeps the angular momentum of every free body.
  /// The bodies' velocities become v + w. Returns the work of moving by w [J].
  double update_positions(const List<int>& moved, const Masses& masses,
                          const Eigen::Vector3d& gravity, double h, Bodies& bodies);

  /// Whether the two functions below have something to do.
  bool is_to_finish() const { return is_to_finish_; }
  /// Of row i, a joint's: its Jacobian and value after the step.
  void finish_row(std::size_t i, const Row& row, const Jacobian& J, double C);
  /// Sets in `corrections` what is to be taken out of the velocities as the next step begins: w by
  /// impulses along the Jacobians after the step, so that momenta are kept. Returns the work of
  /// corrections against springs, and of bodies pulled together that turn about each other [J].
  double take_out_corrections(const List<int>& moved, const Masses& masses, const Bodies& bodies,
                              List<Twist>* corrections);

  /// v + w of a body after the solve.
  Twist final_velocity(std::size_t body) const { return velocities_[body] + corrections_[body]; }
  /// w of a body after the solve.
  Twist correction(std::size_t body) const { return corrections_[body]; }

 private:
  /// Of one row: J and M⁻¹ Jᵀ of each body, K = J M⁻¹ Jᵀ, and 1/(K + softness).
  struct Response {
    Twist J_A, J_B, response_a, response_b;
    double K, effective_mass;
    int component;
    bool corrects;                 // whether any row of the component does
    double rate, correction_rate;  // of springs, less the motor's
  };
  struct Inertia {
    Eigen::Matrix3d R, inverse_W;  // of bodies that can turn
    Eigen::Vector3d principal;
    double inverse_mass;
    bool is_moved, can_turn;
  };
  /// Bodies that rows connect; kept at the index of one of them.
  struct Component {
    bool corrects = false;
    bool gains = false;
    bool is_attached = false;  // to what impulses do not move
    double work = 0.0;         // Σ pᵢ (Jᵢ v − ζᵢ)
    double absorbed = 0.0;     // ½ Δvᵀ M Δv
    bool has_springs = false;
    double linear = 0.0, quadratic = 0.0, free = 0.0, scale = 1.0, damping = 0.0;
  };

  /// A component as one rigid body.
  struct Rigid {
    double mass = 0.0;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double energy = 0.0;  // kinetic
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    Eigen::Vector3d L = Eigen::Vector3d::Zero(), L_of_changes = Eigen::Vector3d::Zero();
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
    Eigen::Vector3d turning = Eigen::Vector3d::Zero();  // that makes up for the damping
    Eigen::Vector3d turning_of_changes = Eigen::Vector3d::Zero();
  };

  void prepare_bodies(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                      const List<Row>& rows);
  void connect(const List<Row>& rows);
  int component_of(int body);
  void respond(const List<Row>& rows);
  void warm_start(const List<int>& moved, List<Row>& rows);
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

  // of bodies: v₀, v, w, and what impulses do on their own
  List<Twist> before_, velocities_, corrections_, effects_;
  List<Inertia> inertias_;
  List<int> parents_;  // towards the body that stands for the component
  List<Component> components_;
  List<Rigid> rigid_;
  List<int> loop_rows_of_;
  List<Response> responses_;
  double h_ = 0.0;
  double spring_work_ = 0.0;
  bool any_corrections_ = false, is_to_finish_ = false;
};

/// Turns a body for h without torque; of bodies with three moments ω changes as L asks.
void advance_orientation(const MassProperties& mass, double h, BodyState* body);

/// x += h v and q by the rotation h ω, of bodies that move by themselves.
void advance_kinematic(const List<int>& moved, double h, List<BodyState>& bodies);

}  // namespace constraint_sim::engine
