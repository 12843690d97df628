#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kernels/body_tree.h"
#include "engine/dynamics/kernels/chain_pair.h"
#include "engine/dynamics/turned_angles.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/math/sparse_ldlt.h"
#include "engine/math/tridiagonal_ldlt.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

struct KernelView;

/// Equations of motion of the bodies and joints of one island, as a System of integrate.h, in
/// index-1 form: the forces λ of the rigid rows give C̈ its target.
///   v̇ = F/m + G_linᵀλ/m,  L̇ = τ + G_angᵀλ,  q̇ = ½ (0, ω) ⊗ q,  ω = I_W⁻¹ L
///   A λ = C̈_target − γ − G a_free,  A = G M⁻¹ Gᵀ,  γ = C̈ − G V̇
/// A rod has C = ½(d·d − ℓ(t)²), a ball joint C = d, other joints the rows of their kind, a
/// coupling one row on up to four bodies. Springs are forces. A body whose joints all act on its
/// centre does not rotate here. State: x and v of all bodies, then q (x, y, z, w) and L of rotating
/// bodies.
class EquationsOfMotion : public IslandModel {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  EquationsOfMotion(const EquationsOfMotion& other);
  EquationsOfMotion(EquationsOfMotion&& other) noexcept;
  EquationsOfMotion& operator=(const EquationsOfMotion& other);
  EquationsOfMotion& operator=(EquationsOfMotion&& other) noexcept;
  ~EquationsOfMotion();

  /// Compiles the joints with the given indices. `couplings`: terms of coupling joints by index,
  /// empty where no joint couples. `idle`: joints without effect, whose bodies move with the
  /// island. `open`: ball joints being closed, compiled as general joints, by index; empty where
  /// there are none. The only function that allocates.
  EquationsOfMotion(List<int> joints, const List<Joint>& all_joints,
                    const List<std::pair<std::size_t, std::size_t>>& ends,
                    const List<MassProperties>& masses, const List<CoupledTerms>& couplings = {},
                    const List<int>& idle = {}, const List<char>& open = {});

  /// Whether the joints form a tree of rotating bodies and no joint frame moves in this interval.
  bool is_tree() const {
    return !tree_.nodes.empty() && !inputs_.frames_move();
  }
  static constexpr char kMomentary = 1, kRedundant = 2;

  // ---- access for methods with their own time stepping

  /// Sets the position of a coupled coordinate [m or rad]. Later angles are unwrapped to the
  /// nearest turn.
  void set_position(std::size_t coupled, std::size_t term, double position) {
    coupled_[coupled].terms[term].position = position;
    coupled_[coupled].terms[term].rate = 0.0;
  }
  /// Sets the position of a soft coordinate [m or rad]. Later angles are unwrapped to the nearest
  /// turn.
  void set_position(std::size_t soft, double position) {
    softs_[soft].position = position;
    softs_[soft].rate = 0.0;
  }
  /// Adds the rotations of a step of length h [s], which ends at time t [s], to the angles that
  /// neither springs nor couplings read. `turn(body)`: rotation vector of a rotating body [rad];
  /// `axis(link, end)`: axis z of a general joint on A (0) or B (1) in the step.
  template <class Turn, class Axis>
  void add_turns(double t, double h, const Turn& turn, const Axis& axis) {
    const auto turn_of = [&](std::size_t point) -> Eigen::Vector3d {
      if (rotates(point)) return turn(point);
      if (point < bodies_.size()) return Eigen::Vector3d::Zero();
      return h * inputs_.fixed_angular_velocity(point);
    };
    angles_.add_turns(t, turn_of, [&](const TurnedAngles::Angle& angle) {
      return axis(angle.joint, angle.is_about_b ? 1 : 0);
    });
  }
  const IntervalInputs& inputs() const { return inputs_; }
  /// Moves fixed points, lengths and offsets to time t [s].
  void move_with_time(double t);
  const Eigen::Vector3d& position(std::size_t fixed_point) const { return position_[fixed_point]; }
  const Eigen::Vector3d& velocity(std::size_t fixed_point) const { return velocity_[fixed_point]; }
  /// Marks rows without a force at the given pose: kRedundant for redundant rows, kMomentary for
  /// rows whose pivot falls below the share `least` of its diagonal entry. Returns false where
  /// redundant rows are so far off that the last step has to be repeated with a shorter one.
  bool find_dependent(double t, const List<Eigen::Vector3d>& positions,
                      const List<Eigen::Quaterniond>& orientations, double least, List<char>* rows);
  /// Whether the redundant rows are met at the given pose. Unmet ones become ordinary rows again.
  bool redundant_rows_are_met(double t, const List<Eigen::Vector3d>& positions,
                              const List<Eigen::Quaterniond>& orientations);
  /// Adds an impulse of the rigid rows of joint l [N s or N m s].
  void add_impulse(std::size_t l, const RowVector& impulse);
  void add_coupled_impulse(std::size_t coupled, double impulse) {
    impulses_[rows_[coupled_[coupled].row].unknown] += impulse;
  }
  void add_soft_impulse(std::size_t soft, double impulse) {
    impulses_[soft_force(soft)] += impulse;
  }
  /// Saves impulses, and positions and rates of coordinates; restore_impulses() undoes later
  /// substeps, and calls of add_impulse() and set_position().
  void keep_impulses();
  void restore_impulses();
  /// Saves impulses, coordinate positions and the forces of the first stage, for a substep that is
  /// repeated.
  void keep_first_stage();
  void restore_first_stage();
  /// Largest frequency ω of the bodies under the joint forces of the last first stage [rad/s]: ω² =
  /// 2Σ|λ|/m for rods, Σ‖f‖‖r‖/I_min for a rotating body.
  double frequency();
  /// Kinetic energy of state y [J].
  double kinetic_energy(const double* y) const;

  // ---- an interval without jumps

  void gather_state(const List<BodyState>& states, double* y) const;
  void scatter_state(const double* y, List<BodyState>* states);
  /// Adds custom forces to the loads, evaluated at `states` and held constant. Called after begin()
  /// by methods that evaluate no custom forces.
  void add_custom_loads(double t, const List<BodyState>& states);
  /// Sets loads and prescribed motions from time t [s] on; `motions` has one entry per joint of the
  /// world. `since_tick`: time since the start of the tick [s], at which `states` holds the
  /// kinematic bodies.
  void begin(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
             const List<AppliedWrench>& loads, const List<PrescribedMotion>& motions,
             double since_tick = 0.0);
  /// Continues the previous interval with equations that were just compiled and whose memory
  /// visit_memory() has read.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, const List<PrescribedMotion>& motions) {
    const double scale = fixed_scale_;  // scale with coupled coordinates at the interval's start
    const bool knows_energy = knows_energy_;
    begin(t, states, gravity, loads, motions);
    fixed_scale_ = scale;
    knows_energy_ = knows_energy;
  }
  /// Whether redundant rows are chosen, and rods with prescribed lengths have their rates in y at
  /// t; start() is needed otherwise.
  bool satisfies_velocity_constraints(double t, const double* y) {
    return has_chosen_ && (inputs_.motions().empty() || rates_are_met(t, y));
  }
  /// Projects y onto the constraints and evaluates the first derivative. Returns false where the
  /// projection fails.
  bool start(double t, double* y, double* dydt);
  /// Whether the last start or step found joints that contradict each other.
  bool is_inconsistent() const { return is_inconsistent_; }
  /// Discards the choice of redundant rows, as in equations that were just compiled.
  void forget_redundant_rows();
  /// Visits all state that outlives an interval, except the inputs of begin(), as
  /// engine/support/memory.h describes. Includes the forces of the first stage where they are not
  /// recomputed.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit, bool with_first_stage) {
    if constexpr (Visit::kReads) {
      List<char> redundant;
      visit(redundant);
      self.set_redundant(redundant);
    } else {
      visit(self.is_redundant_);
    }
    for (auto* rows : {&self.is_needed_, &self.is_verified_}) visit(*rows);
    for (auto* rows : {&self.imbalance_, &self.redundant_off_}) visit(*rows);
    IntervalInputs::visit_memory(self.inputs_, visit);
    visit(self.scale_);
    visit(self.pivot_at_choice_);
    for (auto* number : {&self.too_far_, &self.left_out_for_, &self.choose_after_, &self.left_out_})
      visit(*number);
    for (auto* flag :
         {&self.is_inconsistent_, &self.factors_are_there_, &self.has_chosen_, &self.knows_energy_})
      visit(*flag);
    if (self.knows_energy_) visit(self.energy_);
    if (self.has_chosen_) SparseLdlt::visit_memory(self.ldlt_, visit);
    visit.beside(self.time_);
    visit.beside(self.fixed_scale_);
    if (!with_first_stage) return;
    for (std::size_t i = 0; i < self.impulses_.size(); ++i) visit(self.stage_forces_[i]);
  }

  // ---- response to impulses while the rigid rows hold (held_response.cpp), after start()

  /// Linear and angular vectors per entry of bodies(): velocity changes, accelerations or impulses.
  struct Motions {
    List<Eigen::Vector3d> linear, angular;  ///< angular: 0 for bodies that do not rotate
  };
  /// Impulse on two bodies, given by index. Bodies outside bodies() do not move.
  /// The list of bodies ends at the first 0.
  struct BodyImpulse {
    std::array<int, 4> body{};
    std::array<Eigen::Vector3d, 4> linear, angular;
  };
  /// Returns the velocity changes by an impulse. Writes to `impulses` the reactions of the rigid
  /// rows, which keep the rates of the rows.
  Motions held_response(const BodyImpulse& impulse, List<double>* impulses);
  /// Impulse times the velocity change it causes on bodies without joints [J].
  double free_response(const BodyImpulse& impulse) const;
  /// Adds `share` of a velocity change to y, and `share` of `impulses` to the impulses of the
  /// joints.
  void add_response(const Motions& change, const List<double>& impulses, double share, double* y);
  /// Extracts the accelerations from the derivative dydt at y.
  void find_accelerations(const double* y, const double* dydt, Motions* rates) const;
  /// Largest force or torque of the last first stage, loads and gravity included [N or N m].
  double largest_force() const;
  /// Force of joint l in the last first stage, laid out as stage_force() [N or N m].
  RowVector force(std::size_t l) const { return stage_force(l, 0); }
  /// Force of joint l in a stage of the last substep, laid out as impulse() [N or N m]; of a gear
  /// or pulley the force along its first coordinate comes first.
  RowVector stage_force(std::size_t l, std::size_t stage) const;

  // ---- joint impulses since begin_step()

  /// Clears the impulses and reads coordinate positions from `states`, one entry per joint of the
  /// world.
  void begin_step(const List<JointState>& states);
  /// Impulse of joints()[l], laid out as read_smooth_joint() expects.
  RowVector impulse(std::size_t l) const;
  /// Impulse of the rigid rows of joints()[l].
  RowVector row_impulse(std::size_t l) const;
  /// Impulse of the coupling of joints()[l]; 0 where joint l does not couple.
  double coupled_impulse(std::size_t l) const;
  /// Writes the positions of angles of a general joint, and of coordinates that have laws or
  /// couplings, laid out as JointStep::counted. Returns false where there is none.
  bool count_turns(std::size_t l, std::array<double, kMaxCoordinates>* positions) const;
  /// Impulse of joint l in the order of rows and coordinates of its kind; `of_rows`: impulses of
  /// its rigid rows.
  RowVector by_function(std::size_t l, const RowVector& of_rows) const {
    return by_function(l, of_rows, impulses_.data());
  }
  /// Returns and clears the kinetic energy lost to velocity projections outside start() [J]:
  /// rounding, or motion past a pose where a row has no direction.
  double take_projected_energy() { return std::exchange(projected_energy_, 0.0); }
  /// Error of momentary rows since begin_step(), Σ rate × substep [m].
  double momentary_error() const { return momentary_error_; }
  /// Largest number of dependent rows at one time, redundant rows included.
  int dependent_rows() const { return dependent_rows_ + static_cast<int>(redundant_rows()); }
  /// Number of redundant rows, which follow from other rows at all reachable poses and have no
  /// force.
  std::size_t redundant_rows() const { return rows_.size() - kept_; }

  // ---- System

  std::size_t size() const { return layout().size; }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    using Weights = runge_kutta::StageWeights<Pair, Pair::kStages>;
    substep_ = h;
    const std::size_t n = impulses_.size();
    for (std::size_t i = 0; i < n; ++i)
      impulses_[i] += h * runge_kutta::sum<Weights>(stage_forces_.data() + i, n);
  }
  bool restart(double* y, double* dydt);
  /// Lower bound of error estimates, by rounding [m].
  double rounding() const;
  double squared_size_of(const double* dy, double h) const;

  // ---- for kernels, which implement System for islands of one common shape

  KernelView kernel_view();
  /// Position of a soft or coupled coordinate that moves at `rate` [m or rad]. Angles are unwrapped
  /// to the turn nearest to the integral of the rate since the last noted position.
  template <class Coordinate>
  double reading_of(const Coordinate& of, double rate) const {
    const double there = value(of.form, vectors_[of.link - first_.general]);
    return reading(of.form, there, of.zero,
                   integrated(of.position, placed_at_ - angles_.time(), of.rate, rate));
  }
  /// C of a row minus its target; whole turns of an angle do not count.
  double value_of(const GeneralRow& row) const {
    const double off =
        value(row.form, vectors_[row.link - first_.general]) - inputs_.value_target()[row.row];
    return row.form.is_angle ? unwound(off, 0.0) : off;
  }
  /// Index of the force of a soft coordinate among the unknowns.
  std::size_t soft_force(std::size_t soft) const {
    return rows_.size() + links_.size() - first_.spring + soft;
  }
  /// A kernel leaves the factorization to the equations where a pivot falls below this share of its
  /// diagonal entry.
  static constexpr double kLeastPivot = 1e-8;

  /// Projects positions with the factors of a kernel: `find_values` returns the largest row error
  /// at y [m], `correct` makes a Newton step. Falls back to project() where the steps do not
  /// converge.
  template <class FindValues, class Correct>
  bool project_by(double t, double* y, FindValues find_values, Correct correct) {
    if (inputs_.is_time_dependent()) move_with_time(t);
    double error = find_values();
    const double rounding = kEpsilon * std::max(scale_, error);
    while (!(error <= rounding)) {
      correct();
      const double before = error;
      error = find_values();
      if (error <= 0.5 * before) continue;
      return error <= 16.0 * rounding || project(t, y);
    }
    return true;
  }

 private:
  // Rows are left out whose pivot falls below this share of its diagonal entry, for forces and for
  // both projections. The values lose the least energy near a singular pose that is passed at speed
  // v with error ε and transverse acceleration a: y³ = ε v²/a, p ~ y².
  static constexpr double kLeastPivotOfForces = 3e-11;
  static constexpr double kLeastPivotOfProjections = 1e-9;

  /// Row or part that acts on a body; the sign is −1 where the body is end A.
  struct Pull {
    std::size_t row, unknown;
    double sign;
  };
  /// Two rows on one body, or one row twice. The inverse mass is negative where the body is A of
  /// one row and B of the other.
  struct LinearCoupling {
    std::size_t i, j;
    double inverse_mass;
    SparseLdlt::Slot slot;
  };
  struct AngularCoupling {
    std::size_t p, q;  // angular blocks
    SparseLdlt::Slot slot;
  };
  RowVector of_rows(std::size_t l, const double* of_unknowns) const;
  RowVector by_function(std::size_t l, const RowVector& of_rows, const double* of_unknowns) const;
  RowVector by_joint(std::size_t l, const double* of_unknowns) const;

  // ---- entries of the matrix A, once the rows with a force are known
  void couple_rows();

  // ---- stages of one evaluation, in order
  void update_kinematics(double t, const double* y);
  void update_bodies(const double* y);
  void update_separations();
  void update_arms();
  void update_general();
  void update_general_rows();
  void update_coupled();
  void find_matrix();
  void factor(double least);
  void set_velocities(const double* y);
  void accelerate(std::size_t stage, const double* y, double* dydt);
  void pull_springs(double* forces);
  void pull_softs(double* forces);
  void pull_custom();
  void note_positions();
  double rate_of(std::size_t link, const ScalarForm& form) const {
    return rate(form, vectors_[link - first_.general], motions_[link - first_.general]);
  }
  double value_of(const CoupledRow& row) const;
  void add_coupled_right_hand_side(const Eigen::Vector3d* free, double* b) const;
  void find_right_hand_side(const Eigen::Vector3d* free, double* b) const;
  void multipliers_to_forces(double* lambda) const;

  double largest_coordinate(const double* y) const;
  Eigen::Vector3d d_dot(std::size_t l) const;
  Eigen::Vector3d gamma_d(std::size_t l) const;
  void find_rates();
  double find_values();
  bool rates_are_met(double t, const double* y);
  bool prescribed_rates_are_met();

  // ---- redundant rows (redundant_rows.cpp)
  void find_branches();
  bool meet(double t, double* y);
  bool fit_positions(double t, double* y);
  bool is_passing() const { return left_out_for_ > 0 || came_back_; }
  double potential_energy() const;
  double size_of_forces() const;
  void note_energy(double t, const double* y);
  bool keep_energy(double* y);
  bool is_conservative() const;
  int choose_rows(double t, const double* y);
  Eigen::MatrixXd dense_matrix();
  List<char> independent_rows(double least);
  double self_stress_imbalance(std::size_t row);
  double redundant_self_stress() const;
  void set_redundant(const List<char>& redundant);
  double offset_of(std::size_t l, const PrescribedMotion& motion, bool with_motors) const;
  double closing_arm(std::size_t l) const;
  double opening(bool with_motors) const;
  double closing_curvature() const;
  bool is_closing() const;
  bool limit_redundant_rows();
  bool is_choice_due() const;
  double redundant_limit(std::size_t row) const;
  bool redundant_rows_are_off() const;
  bool restore_redundant_if_off();
  void make_rows_again(const List<char>& redundant);
  bool redundant_rates_are_met();
  void read_pose(const List<Eigen::Vector3d>& positions,
                 const List<Eigen::Quaterniond>& orientations);
  bool choose_again(double t, const double* y);
  void verify_left_out(double least);
  void note_left_out();
  void move_general();
  JointMotion motion_of(std::size_t link) const;
  double largest_speed() const;

  // ---- the linear system
  void solve(double* b);
  void clear_redundant(double* lambda) const;
  void find_residual(const double* b, const double* lambda, double* residual);
  void apply_jacobian_transpose(const double* lambda);

  List<Pull> pulls_;  // grouped by body
  List<std::size_t> pulls_end_;
  List<LinearCoupling> linear_couplings_;
  List<AngularCoupling> angular_couplings_;
  SparseLdlt ldlt_;
  TridiagonalLdlt tridiagonal_;  // factors of A for a chain of rods without dependent rows
  List<Eigen::Vector3d> falls_;  // per rod of a chain: free acceleration of B minus A
  List<ChainPair> pairs_;        // pairs of a chain of bodies, from its ends to the middle
  BodyTree tree_;                // nodes of a tree of bodies

  IntervalInputs inputs_;
  double placed_at_ = 0.0;    // time of the last update_kinematics() [s]
  double fixed_scale_ = 0.0;  // largest coordinate of fixed points, or length [m]
  // Largest coordinate or length, bodies included; rounding is relative to scale_ [m].
  double scale_ = 0.0;

  // ---- positions, motions and rows as of the last evaluation
  List<Eigen::Vector3d> position_, velocity_, acceleration_, constraint_force_;  // per point
  List<Eigen::Matrix3d> orientation_, inverse_inertia_;  // per rotating body
  List<Eigen::Vector3d> angular_velocity_, angular_acceleration_, torque_,
      constraint_torque_;                           // per rotating body
  List<Eigen::Vector3d> d_;                         // per link; of ball joints and springs
  List<Eigen::Vector3d> arm_a_, arm_b_;             // per link
  List<JointVectors> vectors_;                      // per general joint
  List<JointMotion> motions_;                       // per general joint, as of set_velocities()
  List<Eigen::Vector3d> direction_;                 // per part: d of rods, an axis of ball joints
  List<double> value_, rate_;                       // per row
  List<Eigen::Vector3d> J_angular_, M_inv_Jt_;      // per angular block: J_ang, I⁻¹ J_angᵀ

  // Angles that neither springs nor couplings read. Their time is also that of positions in softs_
  // and coupled_.
  TurnedAngles angles_;

  // ---- redundant rows
  std::size_t kept_ = 0;          // number of rows with a force
  bool has_chosen_ = false;       // whether redundant rows were chosen
  List<char> is_redundant_;       // per row
  List<char> is_of_branch_;       // per row: no loop of joints passes through it
  List<char> is_needed_;          // per row: was redundant once, by mistake
  List<char> is_verified_;        // per row: left out, and its self-stress is balanced
  List<double> imbalance_;        // per row: imbalance of its self-stress when chosen as redundant
  List<double> redundant_off_;    // per row: tolerance of a redundant row [m]
  double worst_redundant_ = 0.0;  // largest error over tolerance, as of find_values()
  double pivot_at_choice_ = 1.0;  // smallest pivot of the kept rows when chosen
  int too_far_ = 0;               // consecutive steps rejected for kept rows near dependence
  int left_out_for_ = 0;          // consecutive restarts with momentary rows
  int choose_after_ = 0;          // restarts with momentary rows before the next choice
  double time_ = 0.0;             // time of the last project() [s]
  double substep_ = 0.0;          // length of the last substep [s]
  double momentary_error_ = 0.0;  // since begin_step() [m]
  bool came_back_ = false;        // whether rows left out have a force again since restart()
  bool knows_energy_ = false;     // whether energy_ is known
  // Energy when momentary rows were last left out, with potentials of loads and springs [J].
  double energy_ = 0.0;
  double projected_energy_ = 0.0;  // since take_projected_energy() [J]
  bool is_inconsistent_ = false;

  bool factors_are_there_ = false;
  int left_out_ = 0;  // rows without a force in the current factors, except redundant rows
  int dependent_rows_ = 0;
  List<double> solution_, residual_, stress_;  // by unknown
  // By stage; within a stage by unknown, then springs, then soft coordinates.
  List<double> stage_forces_;
  List<double> impulses_;  // stage_forces_ integrated over time
  List<double> kept_impulses_, kept_positions_, kept_forces_;
  List<double> pose_;     // state vector, for find_dependent()
  List<double> squares_;  // ω² per body, for frequency()
};

}  // namespace constraint_sim::engine
