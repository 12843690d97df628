#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/moving_frame.h"
#include "engine/constraints/prescribed.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/island_model.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Force and torque on a body in world axes, constant over an interval.
struct AppliedWrench {
  int body = 0;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< [N]
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();  ///< About the centre of mass [N m]

  bool operator==(const AppliedWrench& other) const {
    return body == other.body && force == other.force && torque == other.torque;
  }
};

/// Gravity, loads and prescribed motions of an island over an interval, and the values that they
/// prescribe at a time: lengths, frames on B, and targets of rows and of their first two time
/// derivatives.
class IntervalInputs {
 public:
  IntervalInputs(const IslandModel& island, const List<MassProperties>& masses);

  /// Sets loads and prescribed motions from time t [s] on; `motions` has one entry per joint of the
  /// world. `since_tick`: time since the start of the tick [s], at which `states` holds the
  /// kinematic bodies. Returns whether another set of joints moves with time than before. Calls of
  /// place_fixed_points() and of update() follow.
  bool begin(const IslandModel& island, double t, const List<BodyState>& states,
             const Eigen::Vector3d& gravity, const List<AppliedWrench>& loads,
             const List<PrescribedMotion>& motions, double since_tick);
  /// Sets gravity [m/s²] and loads, as begin() does.
  void set_loads(const IslandModel& island, const Eigen::Vector3d& gravity,
                 const List<AppliedWrench>& loads);
  /// Whether these loads act on the bodies since the last begin() or set_loads().
  bool has_loads(const IslandModel& island, const List<AppliedWrench>& loads) const;
  /// Forgets which joints move with time.
  void forget() { std::fill(is_changing_.begin(), is_changing_.end(), false); }
  /// Adds a force [N] and torque [N m] on a body, constant in the interval, to its loads.
  void add_load(const IslandModel& island, std::size_t body, const Eigen::Vector3d& force,
                const Eigen::Vector3d& torque);
  /// Moves lengths, frames and targets of links with a prescribed motion to time t [s].
  void update(const IslandModel& island, double t);
  /// Moves fixed points to time t [s]. Writes their positions and velocities to lists per point.
  void place_fixed_points(const IslandModel& island, double t, List<Eigen::Vector3d>* position,
                          List<Eigen::Vector3d>* velocity);

  /// Whether fixed points change during the interval.
  bool fixed_points_move() const { return fixed_points_move_; }
  /// Whether lengths, targets or fixed points change during the interval.
  bool is_time_dependent() const { return !motions_.empty() || fixed_points_move_; }
  /// Whether the last begin() found a prescribed motion that ended, started or changed its rate.
  bool has_jumped() const { return has_jumped_; }
  /// Whether the frame of any general joint moves.
  bool frames_move() const {
    return std::any_of(frames_.begin(), frames_.end(),
                       [](const MovingFrame& frame) { return frame.moves; });
  }
  /// Prescribed motions by link, of the links whose motion changes with time.
  const List<std::pair<std::size_t, PrescribedMotion>>& motions() const { return motions_; }
  /// Largest length or prescribed coordinate, and largest arm of a joint [m], at the last begin().
  double scale() const { return scale_; }

  /// Per point, the acceleration without joint forces [m/s²]: gravity and loads for a body,
  /// prescribed for a fixed point.
  const List<Eigen::Vector3d>& acceleration() const { return acceleration_; }
  /// Torque on a rotating body by loads [N m].
  const List<Eigen::Vector3d>& torque() const { return torque_; }
  /// By link: prescribed length of a rod or spring [m]; for a general joint that closes its error,
  /// the share that is left [1].
  const List<Prescribed>& length() const { return length_; }
  /// Frame on B of general joint l.
  const MovingFrame& frame_b(std::size_t l) const { return frames_[l - first_general_]; }
  /// Axes of a fixed point that a general joint is attached to.
  const Eigen::Matrix3d& fixed_axes(std::size_t point) const {
    return fixed_points_[point - bodies_].axes;
  }
  /// Angular velocity of the body of a fixed point [rad/s].
  const Eigen::Vector3d& fixed_angular_velocity(std::size_t point) const {
    return fixed_points_[point - bodies_].start.angular_velocity;
  }
  /// Velocity at time t [s] of the body of a fixed point, at `position` [m], without the terms that
  /// close position errors [m/s].
  Eigen::Vector3d body_velocity(std::size_t point, double t, const Eigen::Vector3d& position) const;
  /// Targets of C, Ċ and C̈ by row; targets of C are those of general joints.
  const List<double>& value_target() const { return value_target_; }
  const List<double>& rate_target() const { return rate_target_; }
  const List<double>& acceleration_target() const { return acceleration_target_; }
  /// Prescribed offset of coupled row c.
  const Prescribed& coupling_offset(std::size_t c) const { return coupling_offset_[c]; }
  /// Target values of the rows of a general joint, with the positions of driven coordinates; zero
  /// for other joints.
  RowVector offset(const IslandModel& island, std::size_t l) const;
  /// Rates that motors alone demand of rigid rows at time t [s], without the terms that close
  /// position errors.
  RowVector driven_rate(const IslandModel& island, std::size_t l, double t) const;
  /// Change of a row's C per metre of displacement.
  double row_length(const IslandModel& island, std::size_t row) const;

  /// Visits which joints move with time, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.is_changing_);
  }

 private:
  /// Motion of a fixed point's body, and of the point relative to the body.
  struct FixedPointMotion {
    BodyState start;         // state of the body at the start of the tick
    Eigen::Vector3d anchor;  // [m], in body axes like its rate and acceleration
    Eigen::Vector3d anchor_rate = Eigen::Vector3d::Zero();
    Eigen::Vector3d anchor_acceleration = Eigen::Vector3d::Zero();
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // where a general joint is attached
  };

  bool rates_jump(const IslandModel& island, const List<PrescribedMotion>& motions) const;
  void begin_general(const IslandModel& island, std::size_t l, const PrescribedMotion& motion,
                     double t);
  void set_frame(const IslandModel& island, std::size_t l, const MovingFrame& frame);
  void update_coupling(const IslandModel& island, std::size_t l, const PrescribedMotion& motion,
                       double t);

  std::size_t bodies_, first_general_;                // as in the island
  List<std::pair<std::size_t, double>> compensated_;  // bodies and their shares of gravity below 1
  double tick_start_ = 0.0;                           // [s]
  double updated_at_ = std::numeric_limits<double>::quiet_NaN();  // time of update() [s]
  bool fixed_points_move_ = false;
  bool has_jumped_ = false;
  double scale_ = 0.0;                                      // [m]
  List<Eigen::Vector3d> acceleration_;                      // per point
  List<Eigen::Vector3d> torque_;                            // per rotating body
  List<AppliedWrench> loads_;                               // on these bodies
  List<std::pair<std::size_t, PrescribedMotion>> motions_;  // by link, where time-dependent
  List<bool> is_changing_;                                  // per link
  List<Prescribed> length_;                                 // per link
  List<MovingFrame> frames_;                                // per general joint, on B
  List<FixedPointMotion> fixed_points_;                     // per fixed point
  List<double> value_target_;                               // per row; of general joints
  List<double> rate_target_, acceleration_target_;          // per row
  List<Prescribed> coupling_offset_;                        // per coupled row
};

}  // namespace constraint_sim::engine
