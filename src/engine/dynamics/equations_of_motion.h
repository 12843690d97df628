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
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kernels/body_tree.h"
#include "engine/dynamics/kernels/chain_pair.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/math/sparse_ldlt.h"
#include "engine/math/tridiagonal_ldlt.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

struct KernelView;

/// A force and torque on a body, constant for a while; world axes.
struct AppliedWrench {
  int body = 0;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< [N]
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();  ///< about the centre of mass [N m]
};

/// The bodies of one island and the joints that hold them, as a System of integrate.h, in index-1
/// form: the forces λ of the rigid rows are those that keep C̈ where it has to be.
///   v̇ = F/m + G_linᵀλ/m,  L̇ = τ + G_angᵀλ,  q̇ = ½ (0, ω) ⊗ q,  ω = I_W⁻¹ L
///   A λ = C̈_target − γ − G a_free,  A = G M⁻¹ Gᵀ,  γ = C̈ − G V̇
/// A rod is C = ½(d·d − ℓ(t)²), a ball joint C = d, other joints have the rows of their kind, and
/// springs are forces. A coupling of coordinates is a row of up to four bodies. A body whose joints
/// all act on its centre alone does not turn here. The state: x and v of all bodies, then q (x, y,
/// z, w) and L of those that turn.
class EquationsOfMotion : public IslandModel {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  EquationsOfMotion(const EquationsOfMotion& other);
  EquationsOfMotion(EquationsOfMotion&& other) noexcept;
  EquationsOfMotion& operator=(const EquationsOfMotion& other);
  EquationsOfMotion& operator=(EquationsOfMotion&& other) noexcept;
  ~EquationsOfMotion();

  /// Of these joints, given by index. `couplings`: the terms of joints that couple, by index; empty
  /// where none does. `idle`: joints that do nothing here; their bodies move with the others.
  /// `open`: ball joints that are being closed, which are general ones until they are compiled
  /// anew, by index; empty where none is. Only this allocates.
  EquationsOfMotion(List<int> joints, const List<Joint>& all_joints,
                    const List<std::pair<std::size_t, std::size_t>>& ends,
                    const List<MassProperties>& masses, const List<CoupledTerms>& couplings = {},
                    const List<int>& idle = {}, const List<char>& open = {});

  /// Bodies that turn on joints with rows, without a loop, and no frame of a joint moves now.
  bool is_tree() const {
    return !tree_.nodes.empty() &&
           std::none_of(frames_.begin(), frames_.end(),
                        [](const MovingFrame& frame) { return frame.moves; });
  }
  static constexpr char kMomentary = 1, kRedundant = 2;

  // ---- for methods that step these bodies and joints in their own way

  /// Where a term reads; angles are taken for those nearest to it from then on.
  void set_position(std::size_t coupled, std::size_t term, double position) {
    coupled_[coupled].terms[term].position = position;
    coupled_[coupled].terms[term].rate = 0.0;
  }
  /// The frame on B of a general joint, where it was at the last move_with_time() or evaluation.
  const MovingFrame& frame_b(std::size_t l) const { return frames_[l - first_general_]; }
  /// Where one reads; angles are taken for those nearest to it from then on.
  void set_position(std::size_t soft, double position) {
    softs_[soft].position = position;
    softs_[soft].rate = 0.0;
  }
  /// What acts without the joints, since begin().
  const Eigen::Vector3d& applied_acceleration(std::size_t body) const {
    return applied_acceleration_[body];
  }
  const Eigen::Vector3d& applied_torque(std::size_t turning) const {
    return applied_torque_[turning];
  }
  /// Moves fixed points, lengths and offsets to time t, for the next five.
  void move_with_time(double t);
  const Eigen::Vector3d& position(std::size_t fixed_point) const { return position_[fixed_point]; }
  const Eigen::Vector3d& velocity(std::size_t fixed_point) const { return velocity_[fixed_point]; }
  const Prescribed& length(std::size_t l) const { return length_[l]; }
  /// What the rows of a joint that is no rod and no spring are to be off by, or where a coordinate
  /// is to be.
  RowVector offset(std::size_t l) const;
  /// What motors alone ask of the rates of rigid rows at t, and how fast the body of a fixed point
  /// moves there: without what closes errors.
  RowVector driven_rate(std::size_t l, double t) const;
  Eigen::Vector3d body_velocity(std::size_t fixed_point, double t) const;
  /// Axes of a fixed point that a general joint holds on to, and how it turns [rad/s].
  const Eigen::Matrix3d& fixed_axes(std::size_t fixed_point) const {
    return fixed_axes_[fixed_point - bodies_.size()];
  }
  /// Marks rows without a force, with the bodies there and those that turn so: redundant rows by
  /// kRedundant, and rows whose pivot falls below this share of its entry by kMomentary. False
  /// where the step before has left redundant rows so far off that it has to be shorter.
  bool find_dependent(double t, const List<Eigen::Vector3d>& positions,
                      const List<Eigen::Quaterniond>& orientations, double least, List<char>* rows);
  /// Whether the redundant rows are met there; makes those that are not ordinary rows again.
  bool redundant_rows_are_met(double t, const List<Eigen::Vector3d>& positions,
                              const List<Eigen::Quaterniond>& orientations);
  /// Of its rigid rows.
  void add_impulse(std::size_t l, const RowVector& impulse);
  void add_coupled_impulse(std::size_t coupled, double impulse) {
    impulses_[rows_[coupled_[coupled].row].unknown] += impulse;
  }
  void add_soft_impulse(std::size_t soft, double impulse) {
    impulses_[soft_force(soft)] += impulse;
  }
  /// What add_impulse() adds and set_position() sets after the first can be taken back by the
  /// second.
  void keep_impulses();
  void restore_impulses();
  /// The same, with the forces of the first stage, for a substep that is taken again.
  void keep_first_stage();
  void restore_first_stage();
  /// Largest ω with which the joints' forces swing their bodies, as of the last first stage
  /// [rad/s]: ω² = 2Σ|λ|/m of rods, Σ‖f‖‖r‖/I_min of a body that turns.
  double frequency();
  /// [J]
  double kinetic_energy(const double* y) const;

  // ---- a span of time in which nothing jumps

  void gather_state(const List<BodyState>& states, double* y) const;
  void scatter_state(const double* y, List<BodyState>* states);
  /// Adds custom forces as they are in these states to what acts, as if they were constant; after
  /// begin(), for methods that evaluate no others.
  void add_custom_loads(double t, const List<BodyState>& states);
  /// Sets what acts from time t on; `courses` are those of all joints of the world. `since_tick`:
  /// from the tick's start, where bodies that move by themselves still are in `states` [s].
  void begin(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
             const List<AppliedWrench>& loads, const List<PrescribedMotion>& courses,
             double since_tick = 0.0);
  /// Lets equations that were just compiled, with what visit_memory() reads, go on from the span
  /// before.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, const List<PrescribedMotion>& courses) {
    const double scale = fixed_scale_;  // of where coupled coordinates were when that began
    const bool knows_energy = knows_energy_;
    begin(t, states, gravity, loads, courses);
    fixed_scale_ = scale;
    knows_energy_ = knows_energy;
  }
  /// Whether what begin() sets goes on changing.
  bool is_time_dependent() const { return is_time_dependent_; }
  /// Whether the last begin() found a course that had ended, one that was new, or another rate.
  bool has_jumped() const { return has_jumped_; }
  /// Whether y already moves as the joints ask at t, or has to be started.
  bool satisfies_velocity_constraints(double t, const double* y) {
    return has_chosen_ && (courses_.empty() || rates_are_met(t, y));
  }
  /// Projects y onto the constraints and finds the first derivative; false where it cannot.
  bool start(double t, double* y, double* dydt);
  /// Whether the last start or step found joints that cannot all be met.
  bool is_inconsistent() const { return is_inconsistent_; }
  /// Which rows are redundant is asked again, as of equations just made.
  void forget_redundant_rows();
  /// Visits all that outlives a span, beside what begin() sets, as engine/memory.h says; with the
  /// forces of the first stage where that is not found again.
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
    visit(self.is_changing_);
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

  // ---- what impulses do while the rigid rows hold (held_response.cpp), after start()

  /// What moves, one of these a body as bodies().
  struct Motions {
    List<Eigen::Vector3d> linear, angular;  ///< of bodies that do not turn here 0
  };
  /// An impulse on two bodies, by index; others than bodies() do not move.
  struct BodyImpulse {
    std::array<int, 2> body;
    std::array<Eigen::Vector3d, 2> linear, angular;
  };
  /// The change of velocities, and in `impulses` what rigid rows do to keep their rates.
  Motions held_response(const BodyImpulse& impulse, List<double>* impulses);
  /// The same without any rows: impulse times change of velocity [J].
  double free_response(const BodyImpulse& impulse) const;
  /// Adds `share` of such a change to the velocities, and to the impulses of the joints.
  void add_response(const Motions& change, const List<double>& impulses, double share, double* y);
  /// Accelerations that a derivative at y says.
  void find_accelerations(const double* y, const double* dydt, Motions* rates) const;
  /// Largest force that the last first stage knows of, loads and gravity included [N or N m].
  double largest_force() const;
  /// As impulse(), of the last first stage [N or N m].
  RowVector force(std::size_t l) const { return by_joint(l, stage_forces_.data()); }
  /// Of what any stage of the last substep had.
  RowVector stage_force(std::size_t l, std::size_t stage) const {
    return by_joint(l, stage_forces_.data() + stage * impulses_.size());
  }

  // ---- what the joints did since begin_step()

  /// Clears it, and takes coordinates from the states of all joints.
  void begin_step(const List<JointState>& states);
  /// As read_smooth_joint() wants it, of joints()[l].
  RowVector impulse(std::size_t l) const;
  /// Of its rigid rows alone.
  RowVector row_impulse(std::size_t l) const;
  /// Of its coupling, 0 where it has none.
  double coupled_impulse(std::size_t l) const;
  /// Where coordinates of a general joint read that laws or couplings have, as JointStep::counted;
  /// false where there are none.
  bool count_turns(std::size_t l, std::array<double, kMaxCoordinates>* positions) const;
  /// The same in the order of its rows and coordinates.
  RowVector by_function(std::size_t l, const RowVector& of_rows) const {
    return by_function(l, of_rows, impulses_.data());
  }
  /// Kinetic energy that velocities have lost to the rows since this was called last, beside what
  /// start() took: rounding, or what passes a pose where a row has no direction [J].
  double take_projected_energy() { return std::exchange(projected_energy_, 0.0); }
  /// What momentary rows were off by since begin_step(): rate times substep, summed up [m].
  double momentary_error() const { return momentary_error_; }
  /// Most rows at once that depended on others, redundant rows included.
  int dependent_rows() const { return dependent_rows_ + static_cast<int>(redundant_rows()); }
  /// Rows that follow from the others wherever the joints let the bodies go; they have no force.
  std::size_t redundant_rows() const { return rows_.size() - kept_; }

  // ---- System

  std::size_t size() const { return size_; }
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
  /// What no estimate can be below [m].
  double rounding() const;
  double squared_size_of(const double* dy, double h) const;

  // ---- for kernels, which are the same System for one common shape of islands

  KernelView kernel_view();
  /// Whether lengths, coordinates or frames follow courses.
  bool has_courses() const { return !courses_.empty(); }
  /// How the body of a fixed point turns [rad/s].
  const Eigen::Vector3d& fixed_angular_velocity(std::size_t fixed_point) const {
    return fixed_points_[fixed_point - bodies_.size()].start.angular_velocity;
  }
  /// Where a coordinate reads: angles near to where they go at the rate that was noted.
  double reading_of(const SoftCoordinate& soft) const {
    const double there = value(soft.form, vectors_[soft.link - first_general_]);
    return reading(soft.form, there, soft.zero,
                   soft.position + (placed_at_ - noted_at_) * soft.rate);
  }
  /// C of a row; of an angle the whole turns do not count.
  double value_of(const GeneralRow& row) const {
    const double off =
        value(row.form, vectors_[row.link - first_general_]) - value_target_[row.row];
    return row.form.is_angle ? unwound(off, 0.0) : off;
  }
  /// Where the force of a soft coordinate stands, by unknown.
  std::size_t soft_force(std::size_t soft) const {
    return rows_.size() + links_.size() - first_spring_ + soft;
  }
  /// A kernel leaves its factors to the equations where a pivot falls below this share of its
  /// entry.
  static constexpr double kLeastPivot = 1e-8;

  /// project() of a kernel, with factors of its own: `find_values` returns how far the worst row is
  /// off at y, `correct` makes one of Newton's steps. Where these do not do, the equations do.
  template <class FindValues, class Correct>
  bool project_by(double t, double* y, FindValues find_values, Correct correct) {
    if (is_time_dependent()) move_with_time(t);
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
  // Rows are left out whose pivot falls below these shares of their diagonal entry: of forces, and
  // of both projections. Near a singular pose, passed at speed v with an error ε and an
  // acceleration a across, these lose the least energy: y³ = ε v²/a, p ~ y².
  static constexpr double kLeastPivotOfForces = 3e-11;
  static constexpr double kLeastPivotOfProjections = 1e-9;

  /// A row or part that acts on a body; the sign is -1 where the body is its A.
  struct Pull {
    std::size_t row, unknown;
    double sign;
  };
  /// Two rows on one body, or one with itself on both. The mass counts negative where it is A of
  /// one and B of the other.
  struct LinearCoupling {
    std::size_t i, j;
    double inverse_mass;
    SparseLdlt::Slot slot;
  };
  struct AngularCoupling {
    std::size_t p, q;  // turns
    SparseLdlt::Slot slot;
  };
  RowVector of_rows(std::size_t l, const double* of_unknowns) const;
  RowVector by_function(std::size_t l, const RowVector& of_rows, const double* of_unknowns) const;
  RowVector by_joint(std::size_t l, const double* of_unknowns) const;

  // ---- the entries of the matrix, when the rows that have a force are known
  void couple_rows();

  // ---- what happens in one evaluation, in this order
  void update_prescribed(double t);
  void update_kinematics(double t, const double* y);
  void update_bodies(const double* y);
  void update_fixed_points(double t);
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
  double reading_of(const CoupledRow::Term& term) const;
  double rate_of(std::size_t link, const ScalarForm& form) const {
    return rate(form, vectors_[link - first_general_], motions_[link - first_general_]);
  }
  double value_of(const CoupledRow& row) const;
  void update_prescribed_coupling(std::size_t l, const PrescribedMotion& course, double t);
  void add_coupled_right_hand_side(const Eigen::Vector3d* free, double* b) const;
  void find_right_hand_side(const Eigen::Vector3d* free, double* b) const;
  void multipliers_to_forces(double* lambda) const;

  bool rates_jump(const List<PrescribedMotion>& courses) const;
  double largest_coordinate(const double* y) const;
  Eigen::Vector3d d_dot(std::size_t l) const;
  Eigen::Vector3d gamma_d(std::size_t l) const;
  void find_rates();
  double find_values();
  bool rates_are_met(double t, const double* y);
  bool prescribed_rates_are_met();

  // ---- rows that follow from others (redundant_rows.cpp)
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
  double offset_of(std::size_t l, const PrescribedMotion& course, bool with_motors) const;
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
  void set_frame(std::size_t link, const MovingFrame& frame);
  double row_length(std::size_t row) const {
    if (row < first_ball_) return length_[row].value;
    if (row >= first_coupled_row()) return 1.0 / coupled_[row - first_coupled_row()].metres;
    const std::size_t first = first_general_row();
    return row < first ? 1.0 : 1.0 / general_rows_[row - first].metres;
  }
  double largest_speed() const;

  // ---- the linear system
  void solve(double* b);
  void clear_redundant(double* lambda) const;
  void find_residual(const double* b, const double* lambda, double* residual);
  void apply_jacobian_transpose(const double* lambda);

  // in a state, where x is at 0; even, so that no pair of numbers is of two kinds
  std::size_t v_at_ = 0, q_at_ = 0, L_at_ = 0, size_ = 0;
  List<Pull> pulls_;  // on one body after the other
  List<std::size_t> pulls_end_;
  List<LinearCoupling> linear_couplings_;
  List<AngularCoupling> angular_couplings_;
  SparseLdlt ldlt_;
  TridiagonalLdlt tridiagonal_;  // of a chain, where no rows depend on each other
  List<Eigen::Vector3d> falls_;  // of its rods
  List<ChainPair> pairs_;        // of a chain of bodies, from its ends to the middle
  BodyTree tree_;                // of a tree of bodies

  // ---- what acts in this span
  double tick_start_ = 0.0;
  double asked_at_ = std::numeric_limits<double>::quiet_NaN();  // [s]
  bool fixed_points_move_ = false;
  bool is_time_dependent_ = false;  // these, or courses
  bool has_jumped_ = false;
  double placed_at_ = 0.0, noted_at_ = 0.0;     // times of place(), and of positions of coordinates
  double fixed_scale_ = 0.0;                    // largest coordinate of fixed points, or length [m]
  double scale_ = 0.0;                          // also of bodies: what rounding goes by
  List<Eigen::Vector3d> applied_acceleration_;  // of points
  List<Eigen::Vector3d> applied_torque_;        // of those that turn
  List<std::pair<std::size_t, PrescribedMotion>> courses_;  // of links that change with time
  List<bool> is_changing_;                                  // links that do

  // ---- where things are and what they do, as of the last evaluation
  List<Eigen::Vector3d> position_, velocity_, acceleration_, constraint_force_;  // of points
  List<Eigen::Matrix3d> orientation_, inverse_inertia_;  // of those that turn
  List<Eigen::Vector3d> angular_velocity_, angular_acceleration_, torque_,
      constraint_torque_;                           // of those that turn
  List<Eigen::Vector3d> d_;                         // of ball joints and springs, as links
  List<Eigen::Vector3d> arm_a_, arm_b_;             // of links
  List<Prescribed> length_;                         // of links
  List<JointVectors> vectors_;                      // of general joints
  List<MovingFrame> frames_;                        // the same, on B
  List<JointMotion> motions_;                       // of these, since set_velocities()
  List<Eigen::Matrix3d> fixed_axes_;                // of fixed points, where they have axes
  List<Eigen::Vector3d> direction_;                 // of parts: d of rods, an axis of balls
  List<double> value_, rate_;                       // of rows
  List<double> value_target_;                       // of rows of general joints
  List<double> rate_target_, acceleration_target_;  // of rows
  List<Eigen::Vector3d> J_angular_, M_inv_Jt_;      // of turns: J_ang, I⁻¹ J_angᵀ

  // ---- rows that follow from others
  std::size_t kept_ = 0;           // rows that have a force
  bool has_chosen_ = false;        // which rows are redundant
  List<char> is_redundant_;        // rows
  List<char> is_of_branch_;        // rows that no loop of joints goes through
  List<char> is_needed_;           // rows that were redundant once, and should not have been
  List<char> is_verified_;         // rows left out, whose forces balance those of others
  List<double> imbalance_;         // of the forces of redundant rows, when they were chosen
  List<double> redundant_off_;     // what redundant rows may be off by [m]
  double worst_redundant_ = 0.0;   // share of that, as of find_values()
  double pivot_at_choice_ = 1.0;   // the smallest of the rows kept
  int too_far_ = 0;                // steps in a row that took the rows kept near dependence
  int left_out_for_ = 0;           // restarts in a row
  int choose_after_ = 0;           // such restarts
  double time_ = 0.0;              // of the last project() [s]
  double substep_ = 0.0;           // the last one [s]
  double momentary_error_ = 0.0;   // since begin_step() [m]
  bool came_back_ = false;         // rows that were left out, since the last restart()
  bool knows_energy_ = false;      // where momentary rows were left out last
  double energy_ = 0.0;            // that, of loads and springs as well [J]
  double projected_energy_ = 0.0;  // since take_projected_energy() [J]
  bool is_inconsistent_ = false;

  bool factors_are_there_ = false;
  int left_out_ = 0;  // rows without a force in the factors that are there, redundant ones apart
  int dependent_rows_ = 0;
  List<double> solution_, residual_, stress_;  // by unknown
  // by unknown, then of springs and soft coordinates; stage by stage
  List<double> stage_forces_;
  List<double> impulses_;  // the same, summed up
  List<double> kept_impulses_, kept_positions_, kept_forces_;
  List<double> pose_;     // a state, for find_dependent()
  List<double> squares_;  // ω² of bodies, for frequency()
};

}  // namespace constraint_sim::engine
