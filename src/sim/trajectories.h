#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "sim/drive_changes.h"

namespace constraint_sim {

/// Where a joint is to be, and how it is to move there.
struct TrajectoryPoint {
  double time = 0.0;      ///< after the start [s]
  double position = 0.0;  ///< [m or rad]
  double velocity = 0.0;  ///< [m/s or rad/s]
  double acceleration = 0.0;
};

/// A curve through points: of order 1 with their positions, 3 with their velocities too, 5 with
/// their accelerations. Constant before and after.
class Spline {
 public:
  /// Times must increase; at least one point. `order` is 1, 3 or 5.
  Spline(std::vector<TrajectoryPoint> points, int order);
  double at(double time) const;  ///< [m or rad]
  double duration() const { return points_.back().time; }

 private:
  std::vector<TrajectoryPoint> points_;
  int order_;
};

/// A trajectory of several joints, as a message has it: a value of each for each point.
struct JointTrajectory {
  struct Point {
    double time = 0.0;  ///< after the start [s] ≥ 0
    std::vector<double> positions, velocities, accelerations;
  };
  std::vector<std::string> joints;
  std::vector<Point> points;  ///< none: the joints stop where they are
  double delay = 0.0;         ///< [s] until it starts
};

/// Joints on their way along splines: motors that go by velocity reach the spline at the end of
/// each tick, to rounding; servos are set to it. On the stepping thread.
class Trajectories {
 public:
  /// Replaces what these joints were on, from where they are now. Throws std::invalid_argument for
  /// points that cannot be, and for joints that cannot follow; then all go on as they did.
  void begin(const engine::World& world, const JointTrajectory& trajectory);
  /// Ends what a joint is on.
  void drop(engine::JointId joint) { on_their_way_.erase(joint.value); }
  /// Ends all; the names of the joints that were on one, in the order of their ids.
  std::vector<std::string> end();
  /// Before each tick. A trajectory ends where its joint is gone or has no motor any more, and
  /// where its motor cannot be set as the trajectory asks for: that is returned, one sentence for
  /// each.
  std::vector<std::string> before_step(Driver* driver);
  std::vector<std::string> before_step(engine::World* world) {
    Driver driver(world);
    return before_step(&driver);
  }
  bool empty() const { return on_their_way_.empty(); }

 private:
  struct OnItsWay {
    std::string joint;
    Spline spline;
    double start;  // simulated [s]
  };
  static bool advance(engine::JointId id, const OnItsWay& way, Driver* driver);

  std::map<std::uint32_t, OnItsWay> on_their_way_;  // by ids of joints
};

}  // namespace constraint_sim
