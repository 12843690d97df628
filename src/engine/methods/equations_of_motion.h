#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/linear/block_pivot.h"
#include "engine/linear/sparse_ldlt.h"
#include "engine/linear/tridiagonal_ldlt.h"
#include "engine/mass_properties.h"
#include "engine/methods/integrate.h"
#include "engine/methods/tree_node.h"

namespace constraint_sim::engine {

/// A force and torque on a body, constant for a while; world axes.
struct Load {
  int body = 0;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< [N]
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();  ///< about the centre of mass [N m]
};

/// Of a chain of bodies on ball joints, the two as many joints from either end, side by side, and
/// the joints from them towards the middle. An end that is no body has zeros.
struct ChainPair {
  Lanes inverse_mass;                 ///< [1/kg]
  Lanes3 inverse_inertia;             ///< principal [1/(kg m²)]
  Lanes3 anchor_to_end;               ///< of the joint there, in the body [m]
  Lanes3 anchor_to_middle;            ///< the same
  std::array<std::size_t, 2> joints;  ///< those towards the middle, as joints()
  Lanes sense;                        ///< 1 where their A is on the side of the end, else -1
  Lanes3 arm_to_end, arm_to_middle;   ///< anchors in world axes, as of the last evaluation [m]
  BlockPivot pivot;                   ///< of the joints' rows
  Lanes3 solution;                    ///< of these, positive from the end towards the middle
};

/// The bodies of one island and the joints that hold them, as a System of integrate.h, in index-1
/// form: the forces λ of the rigid rows are those that keep C̈ where it has to be.
///   v̇ = F/m + G_linᵀλ/m,  L̇ = τ + G_angᵀλ,  q̇ = ½ (0, ω) ⊗ q,  ω = I_W⁻¹ L
///   A λ = C̈_target − γ − G a_free,  A = G M⁻¹ Gᵀ,  γ = C̈ − G V̇
/// A rod is C = ½(d·d − ℓ(t)²), a ball joint C = d, other joints have the rows of their kind, and
/// springs are forces. A coupling of coordinates is a row of up to four bodies. A body whose joints
/// all act on its centre alone does not turn here. The state: x and v of all bodies, then q (x, y,
/// z, w) and L of those that turn.
class EquationsOfMotion {
 public:
  /// Of these joints, given by index. `couplings`: the terms of joints that couple, by index; empty
  /// where none does. `idle`: joints that do nothing here; their bodies move with the others. Only
  /// this allocates.
  EquationsOfMotion(std::vector<int> joints, const std::vector<Joint>& all_joints,
                    const std::vector<std::pair<std::size_t, std::size_t>>& ends,
                    const std::vector<MassProperties>& masses,
                    const std::vector<CoupledTerms>& couplings = {},
                    const std::vector<int>& idle = {});

  /// Rods first, those between centres before all others, then ball joints, general ones, springs.
  const std::vector<int>& joints() const { return joints_; }
  /// Those whose rotation is part of the state first.
  const std::vector<int>& bodies() const { return bodies_; }
  std::size_t turning() const { return turning_; }
  std::size_t rows() const { return rows_.size(); }
  /// Rods between centres alone, one after the other; joints and bodies are then in this order.
  bool is_chain() const { return is_chain_; }
  /// The same of bodies that turn, on ball joints alone.
  bool is_chain_of_bodies() const { return is_chain_of_bodies_; }
  /// Bodies that turn on joints with rows, without a loop, and no frame of a joint moves now.
  bool is_tree() const;
  /// One of these with one body.
  bool is_point_on_rod() const { return is_chain_ && links_.size() == 1 && bodies_.size() == 1; }

  static constexpr char kMomentary = 1, kRedundant = 2;

  // ---- for methods that step these bodies and joints in their own way

  /// A joint between two points: bodies in the order of the state, then fixed points.
  struct Link {
    std::size_t a, b;
    Eigen::Vector3d anchor_a, anchor_b;
    bool has_arms;  ///< either end turns
    double stiffness = 0.0, damping = 0.0;
    JointKind kind{};
    std::size_t first_row = 0;  ///< of general ones
    /// Its rigid rows, among the rows and coordinates of its kind.
    int rows = 1;
    std::array<std::uint8_t, kMaxJointRows> function{0, 1, 2, 3, 4, 5};
    std::size_t first_soft = 0, softs = 0;  ///< of general ones, in soft_coordinates()
    Eigen::Matrix3d frame_a, frame_b;
    double radius = 0.0;  ///< [m] that turns the angles of its rows into lengths
  };
  /// A coordinate that springs, dampers or forces act along, and no motor holds.
  struct SoftCoordinate {
    std::size_t link;
    int function;  ///< among the rows and coordinates of its kind
    ScalarForm form;
    SoftLaw law;
    double zero = 0.0, position = 0.0;  ///< as CoordinateState has them; of angles near enough
    double rate = 0.0;                  ///< then [rad/s], so that angles go on from there
  };
  /// The row Σ ratio q − constant of a joint that couples coordinates of general ones. It acts in
  /// two parts, one a term, each between the two bodies of that joint.
  struct CoupledRow {
    struct Term {
      std::size_t link;
      int coordinate;  ///< of its joint
      ScalarForm form;
      double ratio;
      double zero = 0.0, position = 0.0, rate = 0.0;  ///< as SoftCoordinate has them
      std::size_t part = 0;                           ///< in direction_
    };
    std::size_t link;  ///< whose it is
    std::size_t row;
    double metres;  ///< of a unit of the row
    std::array<Term, 2> terms;
    double constant = 0.0;
    Course closing;  ///< what the row is to be off by
  };
  const std::vector<CoupledRow>& coupled_rows() const { return coupled_; }
  /// Where a term reads; angles are taken for those nearest to it from then on.
  void set_position(std::size_t coupled, std::size_t term, double position) {
    coupled_[coupled].terms[term].position = position;
    coupled_[coupled].terms[term].rate = 0.0;
  }
  /// As joints().
  const std::vector<Link>& links() const { return links_; }
  bool is_rod(std::size_t l) const { return l < first_ball_; }
  bool is_ball(std::size_t l) const { return l >= first_ball_ && l < first_general_; }
  /// Neither of these nor a spring.
  bool is_general(std::size_t l) const { return l >= first_general_ && l < first_spring_; }
  /// Of a rod, or the first of another joint.
  std::size_t row_of(std::size_t l) const { return is_rod(l) ? l : first_row(l); }
  /// Rows of a rigid joint.
  std::size_t rows_of(std::size_t l) const { return static_cast<std::size_t>(links_[l].rows); }
  /// Of one of these.
  const ScalarForm& form(std::size_t l, std::size_t k) const {
    return info(links_[l].kind).function[links_[l].function[k]];
  }
  const std::vector<SoftCoordinate>& soft_coordinates() const { return softs_; }
  /// The frame on B of a general joint, where it was at the last move_with_time() or evaluation.
  const MovingFrame& frame_b(std::size_t l) const { return frames_[l - first_general_]; }
  /// Where one reads; angles are taken for those nearest to it from then on.
  void set_position(std::size_t soft, double position) {
    softs_[soft].position = position;
    softs_[soft].rate = 0.0;
  }
  std::size_t points() const { return inverse_mass_.size(); }
  double inverse_mass(std::size_t point) const { return inverse_mass_[point]; }
  const Eigen::Vector3d& inertia(std::size_t turning) const { return inertia_[turning]; }
  double radius_of_gyration(std::size_t turning) const { return radius_of_gyration_[turning]; }
  /// What acts without the joints, since begin().
  const Eigen::Vector3d& load_acceleration(std::size_t body) const {
    return load_acceleration_[body];
  }
  const Eigen::Vector3d& load_torque(std::size_t turning) const { return load_torque_[turning]; }
  /// Moves fixed points, lengths and offsets to time t, for the next five.
  void move_with_time(double t);
  const Eigen::Vector3d& position(std::size_t fixed_point) const { return position_[fixed_point]; }
  const Eigen::Vector3d& velocity(std::size_t fixed_point) const { return velocity_[fixed_point]; }
  const Course& length(std::size_t l) const { return length_[l]; }
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
  bool find_dependent(double t, const std::vector<Eigen::Vector3d>& positions,
                      const std::vector<Eigen::Quaterniond>& orientations, double least,
                      std::vector<char>* rows);
  /// Whether the redundant rows are met there; makes those that are not ordinary rows again.
  bool redundant_rows_are_met(double t, const std::vector<Eigen::Vector3d>& positions,
                              const std::vector<Eigen::Quaterniond>& orientations);
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

  void load(const std::vector<BodyState>& states, double* y) const;
  void store(const double* y, std::vector<BodyState>* states);
  /// Sets what acts from time t on; `courses` are those of all joints of the world. `since_tick`:
  /// from the tick's start, where bodies that move by themselves still are in `states` [s].
  void begin(double t, const std::vector<BodyState>& states, const Eigen::Vector3d& gravity,
             const std::vector<Load>& loads, const std::vector<JointCourse>& courses,
             double since_tick = 0.0);
  /// Whether what begin() sets goes on changing.
  bool varies() const { return !courses_.empty() || fixed_points_move_; }
  /// Whether the last begin() found a course that had ended, one that was new, or another rate.
  bool has_jumped() const { return has_jumped_; }
  /// Whether y already moves as the joints ask at t, or has to be started.
  bool keeps_pace(double t, const double* y) {
    return has_chosen_ && (courses_.empty() || rates_keep_pace(t, y));
  }
  /// Projects y onto the constraints and finds the first derivative; false where it cannot.
  bool start(double t, double* y, double* dydt);
  /// Whether the last start or step found joints that cannot all be met.
  bool is_inconsistent() const { return is_inconsistent_; }
  /// Which rows are redundant is asked again, as of equations just made.
  void forget_redundant_rows();
  /// All that outlives a span, beside what begin() sets; with the forces of the first stage where
  /// that is not found again.
  template <class Add>
  void add_memory(Add&& add, bool with_first_stage) const {
    for (const auto* rows : {&is_redundant_, &is_needed_, &is_verified_}) add(*rows);
    for (const auto* rows : {&imbalance_, &redundant_off_}) add(*rows);
    add(is_changing_);
    add(scale_);
    add(pivot_at_choice_);
    for (const int number : {too_far_, left_out_for_, choose_after_, left_out_}) add(number);
    for (const bool flag : {is_inconsistent_, factors_are_there_, has_chosen_}) add(flag);
    if (has_chosen_) ldlt_.add_memory(add);
    if (!with_first_stage) return;
    for (std::size_t i = 0; i < impulses_.size(); ++i) add(stage_forces_[i]);
  }

  // ---- what impulses do while the rigid rows hold (held_response.cpp), after start()

  /// What moves, one of these a body as bodies().
  struct Motions {
    std::vector<Eigen::Vector3d> linear, angular;  ///< of bodies that do not turn here 0
  };
  /// An impulse on two bodies, by index; others than bodies() do not move.
  struct BodyImpulse {
    std::array<int, 2> body;
    std::array<Eigen::Vector3d, 2> linear, angular;
  };
  /// The change of velocities, and in `impulses` what rigid rows do to keep their rates.
  Motions held_response(const BodyImpulse& impulse, std::vector<double>* impulses);
  /// The same without any rows: impulse times change of velocity [J].
  double free_response(const BodyImpulse& impulse) const;
  /// Adds `share` of such a change to the velocities, and to the impulses of the joints.
  void add_response(const Motions& change, const std::vector<double>& impulses, double share,
                    double* y);
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
  void begin_step(const std::vector<JointState>& states);
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

  /// One scalar equation; `turn_a`, `turn_b` into turns_, -1 where the end does not turn.
  struct Row {
    std::size_t a, b;
    std::size_t unknown = 0;    // where its λ stands in a solution
    double inverse_mass = 0.0;  // of both ends
    SparseLdlt::Slot diagonal = 0;
    int turn_a = -1, turn_b = -1;
  };

  // ---- for kernels, which are the same System for one common shape of islands

  /// What a kernel shares with these equations in a span: where the numbers stand.
  struct KernelView {
    const Row* rows;
    std::size_t row_count;
    std::size_t v_at, q_at, L_at;                // in a state, where x is at 0
    const Course* lengths;                       // of links
    const Eigen::Vector3d *position, *velocity;  // of points
    const Eigen::Vector3d *load_acceleration, *load_torque;
    const double* inverse_mass;                                       // of points
    Eigen::Vector3d* direction;                                       // d of rods
    double* value;                                                    // of rows
    const double *rate_target, *acceleration_target;                  // of rows
    const std::vector<std::pair<std::size_t, JointCourse>>& courses;  // of links that change
    double* solution;                                                 // by unknown
    double *impulses, *stage_forces;  // by unknown; these stage by stage
    std::size_t unknowns;
    double scale;  // what rounding goes by [m]
    TridiagonalLdlt* tridiagonal;
    ChainPair* pairs;
  };
  KernelView kernel_view() {
    return {rows_.data(),
            rows_.size(),
            v_at_,
            q_at_,
            L_at_,
            length_.data(),
            position_.data(),
            velocity_.data(),
            load_acceleration_.data(),
            load_torque_.data(),
            inverse_mass_.data(),
            direction_.data(),
            value_.data(),
            rate_target_.data(),
            acceleration_target_.data(),
            courses_,
            solution_.data(),
            impulses_.data(),
            stage_forces_.data(),
            impulses_.size(),
            scale_,
            &tridiagonal_,
            pairs_.data()};
  }
  /// A kernel leaves its factors to the equations where a pivot falls below this share of its
  /// entry.
  static constexpr double kLeastPivot = 1e-8;

  /// project() of a kernel, with factors of its own: `find_values` returns how far the worst row is
  /// off at y, `correct` makes one of Newton's steps. Where these do not do, the equations do.
  template <class FindValues, class Correct>
  bool project_by(double t, double* y, FindValues find_values, Correct correct) {
    if (varies()) move_with_time(t);
    double error = find_values();
    const double rounding = std::numeric_limits<double>::epsilon() * std::max(scale_, error);
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
  friend class TreeOfBodies;

  /// Where a row or part turns a body.
  struct Turn {
    std::size_t body, row, unknown;
  };
  /// A row or part that acts on a body; the sign is -1 where the body is its A.
  struct Pull {
    std::size_t row, unknown;
    double sign;
  };
  /// Two rows on one body. The mass counts negative where it is A of one and B of the other.
  struct LinearCoupling {
    std::size_t i, j;
    double inverse_mass;
    SparseLdlt::Slot slot;
  };
  struct AngularCoupling {
    std::size_t p, q;  // turns
    SparseLdlt::Slot slot;
  };
  /// A row of a general joint.
  struct GeneralRow {
    std::size_t row, link;
    ScalarForm form;
    double metres;  // of a unit of the row
  };
  /// A place of an immovable body that a joint holds on to.
  struct FixedPoint {
    int body;
    Eigen::Vector3d anchor;
    bool has_axes;
    BodyState start;  // of the body at `tick_start_`
    // against the body, while the frame of a joint moves
    Eigen::Vector3d anchor_rate = Eigen::Vector3d::Zero();
    Eigen::Vector3d anchor_acceleration = Eigen::Vector3d::Zero();
  };
  using Ends = std::vector<std::pair<std::size_t, std::size_t>>;

  RowVector of_rows(std::size_t l, const double* of_unknowns) const;
  RowVector by_function(std::size_t l, const RowVector& of_rows, const double* of_unknowns) const;
  RowVector by_joint(std::size_t l, const double* of_unknowns) const;

  // ---- what is compiled
  void find_bodies(const std::vector<Joint>& all_joints, const Ends& ends,
                   const std::vector<MassProperties>& masses, const std::vector<int>& idle);
  bool order_as_chain(const std::vector<Joint>& all_joints, const Ends& ends,
                      const std::vector<MassProperties>& masses);
  void turn_along_chain();
  void mirror_chain();
  void find_tree();
  void add_links(const std::vector<Joint>& all_joints, const Ends& ends,
                 const std::vector<MassProperties>& masses,
                 const std::vector<CoupledTerms>& couplings);
  void add_coordinates(const Joint& joint, Link* link);
  void add_rows(const Link& link, int count);
  Row new_row(const Link& link, std::size_t part);
  void add_coupled_rows(const std::vector<Joint>& all_joints,
                        const std::vector<CoupledTerms>& couplings);
  void couple_rows();
  std::size_t first_coupled_row() const { return rows_.size() - coupled_.size(); }
  std::size_t first_general_row() const { return first_coupled_row() - general_rows_.size(); }
  /// Rows, and then the second parts of coupled ones, are parts.
  std::size_t parts() const { return rows_.size() + parts_.size(); }
  const Row& part(std::size_t i) const {
    return i < rows_.size() ? rows_[i] : parts_[i - rows_.size()];
  }
  std::size_t row_of_part(std::size_t i) const {
    return i < rows_.size() ? i : first_coupled_row() + i - rows_.size();
  }
  std::size_t first_row(std::size_t l) const {
    return is_ball(l) ? first_ball_ + 3 * (l - first_ball_) : links_[l].first_row;
  }
  bool is_by_offset(std::size_t l) const { return l >= first_ball_ && l < first_spring_; }
  bool turns(std::size_t point) const { return point < turning_; }

  // ---- what happens in one evaluation, in this order
  void ask(double t);
  void place(double t, const double* y);
  void place_bodies(const double* y);
  void place_fixed_points(double t);
  void place_links();
  void place_arms();
  void place_general();
  void place_general_rows();
  void place_coupled();
  void find_matrix();
  void factor(double least);
  void set_velocities(const double* y);
  void accelerate(std::size_t stage, const double* y, double* dydt);
  void pull_springs(double* forces);
  void pull_softs(double* forces);
  void note_positions();
  double reading_of(const SoftCoordinate& soft) const;
  double reading_of(const CoupledRow::Term& term) const;
  double rate_of(std::size_t link, const ScalarForm& form) const {
    return rate(form, vectors_[link - first_general_], motions_[link - first_general_]);
  }
  double value_of(const GeneralRow& row) const;
  double value_of(const CoupledRow& row) const;
  void ask_coupled(std::size_t l, const JointCourse& course, double t);
  void add_coupled_right_hand_side(const Eigen::Vector3d* free, double* b) const;
  std::size_t soft_force(std::size_t soft) const {
    return rows_.size() + links_.size() - first_spring_ + soft;
  }
  void find_right_hand_side(const Eigen::Vector3d* free, double* b) const;
  void weigh_by_length(double* lambda) const;

  bool rates_jump(const std::vector<JointCourse>& courses) const;
  double largest_coordinate(const double* y) const;
  Eigen::Vector3d d_dot(std::size_t l) const;
  Eigen::Vector3d gamma_d(std::size_t l) const;
  void find_rates();
  double find_values();
  bool rates_keep_pace(double t, const double* y);
  bool moves_as_asked();

  // ---- rows that follow from others (redundant_rows.cpp)
  void find_branches();
  bool meet(double t, double* y);
  int choose_rows(double t, const double* y);
  Eigen::MatrixXd dense_matrix();
  std::vector<char> independent_rows(double least);
  double self_stress_imbalance(std::size_t row);
  double redundant_self_stress() const;
  void set_redundant(const std::vector<char>& redundant);
  double offset_of(std::size_t l, const JointCourse& course, bool with_motors) const;
  double closing_arm(std::size_t l) const;
  double opening(bool with_motors) const;
  double closing_curvature() const;
  bool is_closing() const;
  bool limit_redundant_rows();
  bool is_choice_due() const;
  double redundant_limit(std::size_t row) const;
  bool redundant_rows_are_off() const;
  bool restore_redundant_if_off();
  bool redundant_rates_are_met();
  void read_pose(const std::vector<Eigen::Vector3d>& positions,
                 const std::vector<Eigen::Quaterniond>& orientations);
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
  void respond(const double* lambda);

  std::vector<int> joints_;
  std::vector<int> bodies_;
  std::size_t turning_ = 0;
  // in a state, where x is at 0; even, so that no pair of numbers is of two kinds
  std::size_t v_at_ = 0, q_at_ = 0, L_at_ = 0, size_ = 0;
  std::vector<Link> links_;
  std::size_t first_armed_ = 0, first_ball_ = 0, first_general_ = 0, first_spring_ = 0;  // links_
  std::vector<Row> rows_;   // of rods one each, of ball joints three, then of general ones, coupled
  std::vector<Row> parts_;  // second ones of coupled rows
  std::vector<GeneralRow> general_rows_;
  std::vector<CoupledRow> coupled_;
  std::vector<SoftCoordinate> softs_;
  std::vector<Turn> turns_;
  std::vector<Pull> pulls_;  // on one body after the other
  std::vector<std::size_t> pulls_end_;
  std::vector<LinearCoupling> linear_couplings_;
  std::vector<AngularCoupling> angular_couplings_;
  std::vector<FixedPoint> fixed_points_;
  std::vector<double> inverse_mass_;        // of points
  std::vector<Eigen::Vector3d> inertia_;    // of those that turn
  std::vector<double> radius_of_gyration_;  // of those that turn
  SparseLdlt ldlt_;
  bool is_chain_ = false, is_chain_of_bodies_ = false;
  TridiagonalLdlt tridiagonal_;   // of a chain, where no rows depend on each other
  std::vector<ChainPair> pairs_;  // of a chain of bodies, from its ends to the middle
  std::vector<TreeNode> tree_;    // of a tree of bodies, from its leaves to the root
  std::vector<SpatialInertia> tree_inertias_;
  std::vector<SpatialVector> tree_forces_, tree_motions_;  // of these bodies

  // ---- what acts in this span
  double tick_start_ = 0.0;
  bool fixed_points_move_ = false;
  bool has_jumped_ = false;
  double placed_at_ = 0.0, noted_at_ = 0.0;  // times of place(), and of positions of coordinates
  double fixed_scale_ = 0.0;                 // largest coordinate of fixed points, or length [m]
  double scale_ = 0.0;                       // also of bodies: what rounding goes by
  std::vector<Eigen::Vector3d> load_acceleration_;            // of points
  std::vector<Eigen::Vector3d> load_torque_;                  // of those that turn
  std::vector<std::pair<std::size_t, JointCourse>> courses_;  // of links that change with time
  std::vector<bool> is_changing_;                             // links that do

  // ---- where things are and what they do, as of the last evaluation
  std::vector<Eigen::Vector3d> position_, velocity_, acceleration_, push_;  // of points
  std::vector<Eigen::Matrix3d> orientation_, inverse_inertia_;              // of those that turn
  std::vector<Eigen::Vector3d> spin_, spin_acceleration_, torque_, twist_;  // of those that turn
  std::vector<Eigen::Vector3d> d_;                         // of ball joints and springs, as links
  std::vector<Eigen::Vector3d> arm_a_, arm_b_;             // of links
  std::vector<Course> length_;                             // of links
  std::vector<JointVectors> vectors_;                      // of general joints
  std::vector<MovingFrame> frames_;                        // the same, on B
  std::vector<JointMotion> motions_;                       // of these, since set_velocities()
  std::vector<Eigen::Matrix3d> fixed_axes_;                // of fixed points, where they have axes
  std::vector<Eigen::Vector3d> direction_;                 // of parts: d of rods, an axis of balls
  std::vector<double> value_, rate_;                       // of rows
  std::vector<double> value_target_;                       // of rows of general joints
  std::vector<double> rate_target_, acceleration_target_;  // of rows
  std::vector<Eigen::Vector3d> turn_, turn_response_;      // of turns: J_ang, I⁻¹ J_angᵀ

  // ---- rows that follow from others
  std::size_t kept_ = 0;               // rows that have a force
  bool has_chosen_ = false;            // which rows are redundant
  std::vector<char> is_redundant_;     // rows
  std::vector<char> is_of_branch_;     // rows that no loop of joints goes through
  std::vector<char> is_needed_;        // rows that were redundant once, and should not have been
  std::vector<char> is_verified_;      // rows left out, whose forces balance those of others
  std::vector<double> imbalance_;      // of the forces of redundant rows, when they were chosen
  std::vector<double> redundant_off_;  // what redundant rows may be off by [m]
  double worst_redundant_ = 0.0;       // share of that, as of find_values()
  double pivot_at_choice_ = 1.0;       // the smallest of the rows kept
  int too_far_ = 0;                    // steps in a row that took the rows kept near dependence
  int left_out_for_ = 0;               // restarts in a row
  int choose_after_ = 0;               // such restarts
  double time_ = 0.0;                  // of the last project() [s]
  double substep_ = 0.0;               // the last one [s]
  double momentary_error_ = 0.0;       // since begin_step() [m]
  double projected_energy_ = 0.0;      // since take_projected_energy() [J]
  bool is_inconsistent_ = false;

  bool factors_are_there_ = false;
  int left_out_ = 0;  // rows without a force in the factors that are there, redundant ones apart
  int dependent_rows_ = 0;
  std::vector<double> solution_, residual_, stress_;  // by unknown
  // by unknown, then of springs and soft coordinates; stage by stage
  std::vector<double> stage_forces_;
  std::vector<double> impulses_;  // the same, summed up
  std::vector<double> kept_impulses_, kept_positions_, kept_forces_;
  std::vector<double> pose_;     // a state, for find_dependent()
  std::vector<double> squares_;  // ω² of bodies, for frequency()
};

}  // namespace constraint_sim::engine
