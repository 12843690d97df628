#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/frames.h"
#include "ros/parameters.h"
#include "sim/condition.h"
#include "sim/drive_changes.h"

namespace constraint_sim {

/// Makes kinematic bodies follow frames of tf, as the parameter `follow` says. Each tick ends at
/// the pose that the frame had `follow_delay` ago, and gets there at constant velocity, so joints
/// on the body see a consistent motion. tf interpolates between transforms. A body stands still,
/// and a warning is logged, while its frame is missing, late or not connected to the world's frame.
class FrameFollower {
 public:
  explicit FrameFollower(const Parameters& parameters);
  /// Subscribes to tf where any body follows a frame.
  void start(const ros::NodeHandle& handle);

  /// Sets velocities; call before each tick on the stepping thread. `real_time_factor` is the
  /// requested one.
  void before_step(Driver* driver, double real_time_factor);
  /// Returns the bodies that stand still because transforms are missing. Any thread.
  std::vector<std::string> stale() const;
  bool follows_any() const { return !followed_.empty(); }
  /// Returns the transforms, which start() receives.
  Frames& frames() { return frames_; }

 private:
  struct Followed {
    std::string body, frame;
    bool is_following = false;  ///< the body is, or was last, at the pose of the frame
    bool is_refused = false;    ///< the error that this body cannot follow has been logged
    bool is_stale = false;
    double last_heard = -1.0;  ///< stamp of the last tick with a transform [s]; < 0: none
    Condition without_frame;
  };

  double stamp_after_tick(const engine::World& world, double real_time_factor);
  void begin_anew();
  void follow(Driver* driver, double stamp, Followed* followed);
  void notice(bool is_known, double stamp, Followed* followed);

  Parameters parameters_;
  std::vector<Followed> followed_;
  Frames frames_;
  double anchor_ = 0.0;    // wall time minus simulated time over real-time factor [s]
  double last_end_ = 0.0;  // simulated time at the end of the last tick [s]
  mutable std::mutex mutex_;
  std::vector<std::string> stale_;
};

}  // namespace constraint_sim
