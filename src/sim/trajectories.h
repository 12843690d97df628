#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "sim/drive_changes.h"

namespace constraint_sim {

/// A point of a trajectory: position and its derivatives at a time.
struct TrajectoryPoint {
  double time = 0.0;      ///< after the start [s]
  double position = 0.0;  ///< [m or rad]
  double velocity = 0.0;  ///< [m/s or rad/s]
  double acceleration = 0.0;
};

/// A spline through points: of order 1 through positions, 3 also with velocities, 5 also with
/// accelerations. Constant before the first and after the last point.
class Spline {
 public:
  /// Requires increasing times and at least one point. `order` is 1, 3 or 5.
  Spline(std::vector<TrajectoryPoint> points, int order);
  double at(double time) const;                           ///< [m or rad]
  double rate(double time) const;                         ///< [m/s or rad/s]; 0 beyond the ends
  double end() const { return points_.back().position; }  ///< [m or rad]
  double duration() const { return points_.back().time; }

 private:
  std::vector<TrajectoryPoint> points_;
  int order_;
};

/// A spline that begins at a simulated time [s].
struct TimedSpline {
  Spline spline;
  double start;

  double at(double time) const { return spline.at(time - start); }
  double rate(double time) const { return spline.rate(time - start); }
  double end_time() const { return start + spline.duration(); }
};

/// A trajectory of several joints as in a message: one value per joint and point.
struct JointTrajectory {
  struct Point {
    double time = 0.0;  ///< after the start [s] ≥ 0
    std::vector<double> positions, velocities, accelerations;
  };
  std::vector<std::string> joints;
  std::vector<Point> points;  ///< empty: the joints stop at their positions
  double delay = 0.0;         ///< time until the start [s]; < 0: it is late
};

/// An invalid trajectory, and the field that is wrong.
class TrajectoryError : public std::invalid_argument {
 public:
  enum class Field {
    kJoints,  ///< a joint is missing, twice there, or has no motor that can follow
    kStamp    ///< the time of all points is over
  };
  TrajectoryError(Field field, const std::string& message)
      : std::invalid_argument(message), field_(field) {}
  Field field() const { return field_; }

 private:
  Field field_;
};

/// Follows splines with motors of joints. Motors without a spring reach the spline at the end of
/// each tick, to rounding, by a rate that is continuous where that of the spline is: so a limited
/// motor needs no more force than the motion. Servos get the spline as their target. At the end of
/// a trajectory a motor to a position holds the end point, and a motor by rate has the rate 0.
/// Stepping thread only.
class Trajectories {
 public:
  /// Starts a trajectory at the joints' present positions, in place of their last one. Points whose
  /// time is over are dropped, as is a point at time 0 that is not at the present position. Throws
  /// std::invalid_argument for invalid points, and TrajectoryError for unsuitable joints and a
  /// trajectory that is over; then all trajectories go on.
  void begin(const engine::World& world, const JointTrajectory& trajectory);
  /// Returns whether a trajectory drives the joint, in place of what its motor had.
  bool drives(engine::JointId joint) const { return on_their_way_.count(joint.value) > 0; }
  /// Returns the spline of a joint; none where no trajectory drives it.
  std::optional<TimedSpline> course(engine::JointId joint) const;
  /// Ends the trajectory of a joint. Returns whether the joint's motor, which the trajectory drives
  /// by a rate, is one to a position.
  bool drop(engine::JointId joint);
  /// Ends all trajectories; returns the names of their joints in the order of ids.
  std::vector<std::string> end();
  /// Sets the motors; call before each tick. A trajectory ends where its joint is gone, has no
  /// motor any more, or rejects the motor's setting; returns one sentence for each such end.
  std::vector<std::string> before_step(Driver* driver);
  std::vector<std::string> before_step(engine::World* world) {
    Driver driver(world);
    return before_step(&driver);
  }
  bool empty() const { return on_their_way_.empty(); }

 private:
  struct OnItsWay {
    std::string joint;
    TimedSpline course;
    bool to_position;  // the motor is one to a position and no servo
  };
  bool is_to_position(const engine::Joint& joint, engine::JointId id) const;
  static bool advance(engine::JointId id, const OnItsWay& way, Driver* driver);

  std::map<std::uint32_t, OnItsWay> on_their_way_;  // by joint id
};

}  // namespace constraint_sim
