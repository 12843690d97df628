#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/kernel_view.h"
#include "engine/dynamics/kernels/articulated_tree.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// The System of integrate.h in joint coordinates, valid for one interval.
class TreeSystem {
 public:
  /// Evaluates the forces of all stages.
  TreeSystem(EquationsOfMotion& equations, ArticulatedTree& tree);
  /// Evaluates the forces of the stages alone that the impulses of steps of this order need.
  static TreeSystem for_impulses(EquationsOfMotion& equations, ArticulatedTree& tree, int order);

  /// Reads the state from the bodies, as the last start() of the equations left them at time t [s],
  /// and evaluates the derivative. Returns false where a pivot is lost.
  bool read(double t);
  /// Begins an interval at time t [s], in the state that the interval before has left.
  void begin(double t);
  /// Evaluates derivative and forces at the start of the interval, where other forces begin to act.
  void start(double t);
  /// Notes the coordinates of the present state.
  void note_coordinates();
  /// Writes the bodies of the present state.
  void scatter(List<BodyState>* states);
  /// Writes the present state as one of the equations.
  void write_state(double* y);
  /// Writes the state at the start of a substep that failed, at time t [s], likewise.
  void write_start(double t, double* y);
  /// Kinetic energy lost by projecting velocities onto loops [J].
  double projected() const { return projected_; }
  /// Evaluates the dynamics at the present state and time t [s], but neither derivative nor forces.
  void place_start(double t);

  std::size_t size() const { return tree_.size; }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    equations_.accept<Pair>(h);
    substep_ = h;
    next_stage_ = Pair::kNeedsNext ? Pair::kStages : 0;
  }
  bool restart(double* y, double* dydt);
  double rounding() const;
  double squared_size_of(const double* dy, double h, bool is_of_rates = false) const;

 private:
  using Vector3d = Eigen::Vector3d;

  void place_roots();
  Vector3d root(const double* y) const { return Vector3d::Map(y); }
  bool is_prescribing() const;
  void move_with_time(double t, double* y);
  void prescribe(double* y) const;
  void drop_whole_turns(double* y) const;
  const double* prescribed(double t, const double* y);
  void find_accelerations(std::size_t stage, double t, const double* y);
  void place(const double* y);
  void write_derivative(const double* y, double* dydt);
  void pull(std::size_t stage, const double* y);
  void write_forces(std::size_t stage);
  bool normalize(double* y) const;
  bool close_loops(double* y);
  bool meet_rates(double* y);
  void move(const double* change, double* y) const;
  bool are_loops_regular(double least_pivot);
  TreeInInterval in_interval() { return {tree_, equations_, view_, dynamics_}; }
  double position_of(const TreeMotion& motion, double x) const;

  EquationsOfMotion& equations_;
  KernelView view_;
  ArticulatedTree& state_;
  const JointTree& tree_;
  TreeDynamics& dynamics_;
  TreeClosings& closings_;
  double time_ = 0.0, substep_ = 0.0;                 // [s]
  double projected_ = 0.0, substep_projected_ = 0.0;  // [J]
  const bool* needs_forces_ = nullptr;                // per stage; null: all
  std::size_t next_stage_ = 0;  // stage of the substep that is the first of the next; 0: none
};

}  // namespace constraint_sim::engine
