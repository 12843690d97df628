#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/constraints/joint_vectors.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/kernel_view.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/math/list.h"
#include "engine/model/jacobian.h"

namespace constraint_sim::engine {

/// Trees with what their closing joints need of the interval.
struct TreeInInterval {
  const JointTree& tree;
  const EquationsOfMotion& equations;
  const KernelView& view;
  TreeDynamics& dynamics;
};

/// Joints that close loops of a JointTree. Their rows C = 0 become equations between the rates of
/// the motions, J ẋ = Ċ_target, and their forces λ act on the motions:
///   ẍ = ẍ_free + H⁻¹ Jᵀ λ,  J H⁻¹ Jᵀ λ = C̈_target − γ − J ẍ_free.
/// Redundant rows have no force. After a step, Newton steps along H⁻¹ Jᵀ meet the rows.
class TreeClosings {
 public:
  TreeClosings() = default;
  TreeClosings(const JointTree& tree, const IslandModel& island);

  bool empty() const { return joints_.empty(); }
  /// Selects the rows that have a force: all but the redundant ones, which are flagged per row of
  /// the island.
  void select(const List<char>& is_redundant);

  // ---- once TreeDynamics::place() has placed the bodies; `root`: position of a free root [m]

  void place(const TreeInInterval& at, const Eigen::Vector3d& root);
  /// Evaluates C. Returns the largest error of a row with a force [m].
  double find_errors(const TreeInInterval& at);
  /// Whether the errors of the last find_errors() are within the tolerances of redundant rows.
  bool redundant_rows_are_met(const TreeInInterval& at) const;
  /// Writes a change of all motions that corrects the errors, with H as of the last evaluation.
  void find_correction(const TreeInInterval& at, double* change);
  /// Writes a change of all rates that gives the rows their rates, likewise. Returns the kinetic
  /// energy that it takes [J].
  double find_rate_correction(const TreeInInterval& at, double* change);
  /// Notes positions of coordinates with springs or dampers, and turns of angles that nothing
  /// reads, at the end of a substep of h [s].
  void note_coordinates(const TreeInInterval& at, double h);
  /// Evaluates rates that the next note_coordinates() begins from. The coordinates are noted for
  /// the present time.
  void begin_coordinates();
  /// Begins a substep after begin_coordinates() or note_coordinates().
  void begin_substep() { fastest_ = fastest_at_start_; }
  /// Whether angles turn so little in a substep of h [s] that their rates at both ends tell the
  /// number of whole turns.
  bool can_count_turns(double h) const;

  // ---- in one evaluation

  /// Applies springs, dampers and forces of closing joints at time t [s], after
  /// TreeDynamics::evaluate(). Writes them to `forces` by unknown of the equations.
  void pull(const TreeInInterval& at, double t, double* forces);
  /// Finds the forces of the rows, and adds to the accelerations of TreeDynamics::solve().
  void accelerate(const TreeInInterval& at);
  /// Lets the forces of the rows act on what joints transmit, and writes them by unknown.
  void write_forces(const TreeInInterval& at, double* forces) const;
  /// Least share of a pivot of J H⁻¹ Jᵀ in the entry of the row between bodies without other
  /// joints. Falls to zero where the row depends on others, or moves nothing.
  double least_pivot() const { return least_pivot_; }

 private:
  struct ClosingRow {
    std::size_t row, joint;  ///< indices in the island and in joints_
    ScalarForm form;
  };
  /// Coordinate with springs, dampers or forces, or an angle that nothing reads.
  struct Coordinate {
    std::size_t joint;
    int index;         ///< in its joint
    std::size_t soft;  ///< index in soft_coordinates(), or kNoIndex
    ScalarForm form;
    double rate = 0.0;  ///< at the end of the last substep
  };
  struct PlacedJoint {
    JointVectors vectors;  ///< arms from the origins of the trees
    JointMotion motion;
  };
  struct Wrenches {
    SpatialVector on_a, on_b;
  };

  double error_of(const TreeInInterval& at, const ClosingRow& row) const;
  Wrenches wrenches_of(const Jacobian& J) const { return {{J.j1, J.j2}, {J.j3, J.j4}}; }
  void find_jacobian(const TreeInInterval& at);
  void add_to_jacobian(const TreeInInterval& at, const ClosingJoint::End& end,
                       const SpatialVector& wrench, double* row) const;
  double free_entry(const TreeInInterval& at, std::size_t row) const;
  double fastest_turn() const;
  void factor(const TreeInInterval& at);
  void solve(double* numbers) const;
  void add_changes(const double* numbers, double* change) const;

  List<ClosingJoint> joints_;
  List<ClosingRow> rows_;  // rows with a force, then redundant rows
  std::size_t kept_ = 0;   // number of rows with a force
  List<Coordinate> coordinates_;
  std::size_t motions_ = 0;

  // Results of the last evaluation.
  List<PlacedJoint> placed_;     // per joint
  List<double> error_;           // per row: C
  List<double> missing_;         // per row with a force: prescribed rate − Ċ
  List<Wrenches> wrenches_;      // per row with a force: for λ = 1
  List<double> J_, inverse_J_;   // by row, then by motion: J, and H⁻¹ of it
  List<double> matrix_;          // J H⁻¹ Jᵀ as L D Lᵀ; D on the diagonal
  List<double> force_, change_;  // λ per row; a change of all motions
  double least_pivot_ = 1.0;
  // Largest relative angular velocity at a joint with an angle, since begin_substep() and at the
  // start of the substep [rad/s].
  double fastest_ = 0.0, fastest_at_start_ = 0.0;
};

}  // namespace constraint_sim::engine
