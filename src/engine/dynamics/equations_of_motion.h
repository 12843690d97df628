#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/conserved_energy.h"
#include "engine/dynamics/coordinate_positions.h"
#include "engine/dynamics/delassus_matrix.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/joint_forces.h"
#include "engine/dynamics/kernels/body_tree.h"
#include "engine/dynamics/kernels/chain_pair.h"
#include "engine/dynamics/kinematics.h"
#include "engine/dynamics/redundant_rows.h"
#include "engine/dynamics/state_vector.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
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
/// centre does not rotate here.
///
/// One evaluation: IntervalInputs move to time t, Kinematics places the bodies and their Jacobian,
/// DelassusMatrix is evaluated and factored, force elements act, and λ follows, which JointForces
/// keeps. A substep ends with projections of positions and velocities, which RedundantRows watches.
class EquationsOfMotion : public IslandModel {
 public:
  // Defined in the .cpp file: copies of so many lists are compiled once.
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

  /// Takes over the springs, dampers and constant forces of the joints. Returns false where other
  /// rows or coordinates follow from the laws, or coordinates have another zero; then the island
  /// has to be compiled anew.
  bool follow_laws(const List<Joint>& all_joints) {
    energy_.forget();
    return IslandModel::follow_laws(all_joints);
  }
  const IntervalInputs& inputs() const { return inputs_; }
  const Kinematics& kinematics() const { return kinematics_; }
  const CoordinatePositions& coordinates() const { return coordinates_; }
  CoordinatePositions& coordinates() { return coordinates_; }
  const DelassusMatrix& delassus() const { return delassus_; }
  DelassusMatrix& delassus() { return delassus_; }
  const RedundantRows& redundant() const { return redundant_; }
  RedundantRows& redundant() { return redundant_; }
  const JointForces& forces() const { return forces_; }
  JointForces& forces() { return forces_; }
  /// Whether the joints form a tree of rotating bodies and no joint frame moves in this interval.
  bool is_tree() const { return tree_.has_fewer_motions && !inputs_.frames_move(); }

  // ---- an interval without jumps

  /// Clears the impulses and reads coordinate positions from `states`, one entry per joint of the
  /// world.
  void begin_step(const List<JointData>& states);
  /// Sets loads and prescribed motions from time t [s] on, as IntervalInputs::begin().
  void begin(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
             const List<AppliedWrench>& loads, const List<PrescribedMotion>& motions,
             double since_tick = 0.0);
  /// Whether these loads act on the bodies since the last begin() or set_loads().
  bool has_loads(const List<AppliedWrench>& loads) const { return inputs_.has_loads(*this, loads); }
  /// Sets gravity and loads alone, which change nothing but forces.
  void set_loads(const Eigen::Vector3d& gravity, const List<AppliedWrench>& loads) {
    inputs_.set_loads(*this, gravity, loads);
    energy_.forget();
  }
  /// Continues the previous interval with equations that were just compiled and whose memory
  /// visit_memory() has read.
  void continue_from(double t, const List<BodyState>& states, const Eigen::Vector3d& gravity,
                     const List<AppliedWrench>& loads, const List<PrescribedMotion>& motions) {
    const double scale = fixed_scale_;  // scale with coupled coordinates at the interval's start
    const bool knows_energy = energy_.is_known();
    begin(t, states, gravity, loads, motions);
    fixed_scale_ = scale;
    energy_.set_known(knows_energy);
  }
  /// Adds custom forces to the loads, evaluated at `states` and held constant. Called after begin()
  /// by methods that evaluate no custom forces.
  void add_custom_loads(double t, const List<BodyState>& states);
  /// Whether redundant rows are chosen, and rods with prescribed lengths have their rates in y at
  /// t; start() is needed otherwise.
  bool satisfies_velocity_constraints(double t, const double* y) {
    return redundant_.has_chosen() && (inputs_.motions().empty() || rates_are_met(t, y));
  }
  /// Projects y onto the constraints and evaluates the first derivative. Returns false where the
  /// projection fails.
  bool start(double t, double* y, double* dydt);
  /// Places bodies and joints at state y and time t [s].
  void place_bodies(double t, const double* y) {
    place(t, y);
    kinematics_.move(*this, inputs_, y);
  }
  /// Writes a state vector to the bodies.
  void scatter_state(const double* y, List<BodyState>* states);
  /// Saves impulses and coordinate positions; restore_impulses() undoes later substeps.
  void keep_impulses();
  void restore_impulses();
  /// Saves impulses, coordinate positions and the forces of the first stage, for a substep that is
  /// repeated.
  void keep_first_stage();
  void restore_first_stage();
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
      self.redundant_.set(self, redundant, &self.delassus_, &self.forces_);
    } else {
      visit(self.redundant_.is_redundant());
    }
    RedundantRows::visit_redundant(self.redundant_, visit);
    IntervalInputs::visit_memory(self.inputs_, visit);
    visit(self.scale_);
    RedundantRows::visit_choice(self.redundant_, visit);
    DelassusMatrix::visit_left_out(self.delassus_, visit);
    RedundantRows::visit_inconsistent(self.redundant_, visit);
    DelassusMatrix::visit_has_factors(self.delassus_, visit);
    RedundantRows::visit_has_chosen(self.redundant_, visit);
    ConservedEnergy::visit_memory(self.energy_, visit);
    if (self.redundant_.has_chosen()) DelassusMatrix::visit_factors(self.delassus_, visit);
    visit.beside(self.time_);
    visit.beside(self.fixed_scale_);
    if (with_first_stage) JointForces::visit_first_stage(self.forces_, visit);
  }

  // ---- for methods with their own time stepping

  /// Moves fixed points, lengths and offsets to time t [s].
  void move_with_time(double t);
  static constexpr char kMomentary = 1, kRedundant = 2;
  /// Marks rows without a force at the given pose: kRedundant for redundant rows, kMomentary for
  /// rows whose pivot falls below the share `least` of its diagonal entry. Returns false where
  /// redundant rows are so far off that the last step has to be repeated with a shorter one.
  bool find_dependent(double t, const List<Eigen::Vector3d>& positions,
                      const List<Eigen::Quaterniond>& orientations, double least, List<char>* rows);
  /// Whether the redundant rows are met at the given pose. Unmet ones become ordinary rows again.
  bool redundant_rows_are_met(double t, const List<Eigen::Vector3d>& positions,
                              const List<Eigen::Quaterniond>& orientations);
  /// Adds `share` of a velocity change to y, and `share` of `impulses`, by unknown, to the
  /// impulses of the joints.
  void add_response(const Motions& change, const List<double>& impulses, double share, double* y);

  // ---- results

  /// Largest force or torque of the last first stage, loads and gravity included [N or N m].
  double largest_force() const;
  /// Largest frequency of the bodies under the forces of the last first stage [rad/s].
  double frequency();
  /// Returns and clears the kinetic energy lost to velocity projections outside start() [J]:
  /// rounding, or motion past a pose where a row has no direction.
  double take_projected_energy() { return std::exchange(projected_energy_, 0.0); }

  // ---- System

  std::size_t size() const { return layout().size; }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    substep_ = h;
    forces_.accept<Pair>(h);
  }
  bool restart(double* y, double* dydt);
  /// Lower bound of error estimates, by rounding [m].
  double rounding() const;
  double squared_size_of(const double* dy, double h, bool is_of_rates = false) const;

  // ---- for kernels, which implement System for islands of one common shape

  KernelView kernel_view();
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
  PlacedRows placed_rows() const { return {*this, inputs_, kinematics_, scale_, time_}; }
  double largest_coordinate(const double* y) const;
  void read_pose(const List<Eigen::Vector3d>& positions,
                 const List<Eigen::Quaterniond>& orientations);

  // ---- stages of one evaluation, in order
  void place(double t, const double* y);
  void factor(double least);
  void accelerate(std::size_t stage, const double* y, double* dydt);
  void find_right_hand_side(const Eigen::Vector3d* free, double* b) const;

  // ---- projections
  double find_values();
  bool project_start(double t, double* y);
  bool fit_positions(double t, double* y);
  bool restore_redundant_if_off();
  void project_velocities(double* y);
  bool rates_are_met(double t, const double* y);
  bool prescribed_rates_are_met();
  bool redundant_rates_are_met();
  int choose_rows(double t, const double* y);
  bool choose_again(double t, const double* y);
  void note_left_out();
  void note_energy(double t, const double* y);

  IntervalInputs inputs_;
  Kinematics kinematics_;
  CoordinatePositions coordinates_;
  DelassusMatrix delassus_;
  RedundantRows redundant_;
  JointForces forces_;
  ConservedEnergy energy_;

  // Largest coordinate of fixed points, or length; scale_ also of bodies, for rounding [m].
  double fixed_scale_ = 0.0, scale_ = 0.0;
  double time_ = 0.0;              // time of the last project() [s]
  double substep_ = 0.0;           // length of the last substep [s]
  double projected_energy_ = 0.0;  // since take_projected_energy() [J]

  // Work space.
  List<Eigen::Vector3d> acceleration_;                   // per point, without rows
  List<Eigen::Vector3d> torque_, angular_acceleration_;  // per rotating body, without rows
  List<double> solution_;                                // by unknown
  List<double> pose_;                                    // state vector, for find_dependent()

  // Compiled data of kernels.
  TridiagonalLdlt tridiagonal_;  // factors of A for a chain of rods without dependent rows
  List<Eigen::Vector3d> falls_;  // per rod of a chain: free acceleration of B minus A
  List<ChainPair> pairs_;        // pairs of a chain of bodies, from its ends to the middle
  BodyTree tree_;                // nodes of a tree of bodies
};

}  // namespace constraint_sim::engine
