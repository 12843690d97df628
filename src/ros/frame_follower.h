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

/// Kinematic bodies that follow frames of tf, as the parameter `follow` says: each tick ends where
/// the frame was `follow_delay` ago, and goes there at one velocity, so that joints on the body are
/// held as on any body that moves. Between transforms tf interpolates. A frame that is not there,
/// no longer comes or is no longer connected is reported, and the body stands.
class FrameFollower {
 public:
  FrameFollower(const Parameters& parameters, const ros::NodeHandle& handle);

  /// Before each tick, on the stepping thread; the factor is the one that is asked for.
  void before_step(Driver* driver, double real_time_factor);
  /// The bodies that stand since their frames are not heard of. On any thread.
  std::vector<std::string> stale() const;
  bool follows_any() const { return !followed_.empty(); }

 private:
  struct Followed {
    std::string body, frame;
    bool is_following = false;  ///< the body is where the frame is, or was last
    bool is_refused = false;    ///< it has been said that this body cannot follow
    bool is_stale = false;
    double last_heard = -1.0;  ///< [s] of the stamps, of the last tick with a transform; < 0: none
    Condition without_frame;
  };

  double stamp_after_tick(const engine::World& world, double real_time_factor);
  void begin_anew();
  void follow(Driver* driver, double stamp, Followed* followed);
  void notice(bool is_known, double stamp, Followed* followed);

  Parameters parameters_;
  std::vector<Followed> followed_;
  Frames frames_;
  double anchor_ = 0.0;    // wall time less that of the world over the real-time factor [s]
  double last_end_ = 0.0;  // simulated, of the last tick [s]
  mutable std::mutex mutex_;
  std::vector<std::string> stale_;
};

}  // namespace constraint_sim
