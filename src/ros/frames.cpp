#include "ros/frames.h"

#include <ros/time.h>
#include <tf2/exceptions.h>

#include "sim/words.h"

namespace constraint_sim {
namespace {

constexpr double kKept = 10.0;  // time for which transforms are kept [s]

}  // namespace

Frames::Frames() : buffer_(ros::Duration(kKept)) {}

void Frames::start(const ros::NodeHandle& handle) {
  std::call_once(started_, [&] {
    queue_ = std::make_unique<ServiceQueue>(1);
    transforms_ = listen(queue_->serving(handle), "/tf", false);
    static_transforms_ = listen(queue_->serving(handle), "/tf_static", true);
    queue_->start();
  });
}

ros::Subscriber Frames::listen(ros::NodeHandle handle, const std::string& topic, bool is_static) {
  const SharedGuard guard = make_guard(topic);
  return guarded_subscribe<tf2_msgs::TFMessage>(
      handle, guard, 100, [this, guard, is_static](const tf2_msgs::TFMessage& message) {
        take(message, is_static, guard.get());
      });
}

// Stamps near the end of ros::Time are skipped: the buffer adds its cache time to stamps, which
// overflows and would then throw for each further transform of that frame.
void Frames::take(const tf2_msgs::TFMessage& message, bool is_static, Guard* guard) {
  if (!is_static) {
    const ros::Time now = ros::Time::now();
    if (now < last_taken_) buffer_.clear();
    last_taken_ = now;
  }
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    if (is_static || transform.header.stamp.toSec() < ros::TIME_MAX.toSec() - 2.0 * kKept)
      buffer_.setTransform(transform, "tf", is_static);
    else
      guard->warn("the stamp of '" + shortened(transform.child_frame_id) +
                  "' is too late: " + std::to_string(transform.header.stamp.sec) + " s");
  }
}

std::optional<geometry_msgs::Transform> Frames::look_up(const std::string& target,
                                                        const std::string& source,
                                                        const ros::Time& stamp) const {
  if (!buffer_.canTransform(target, source, stamp)) return std::nullopt;
  try {
    return buffer_.lookupTransform(target, source, stamp).transform;
  } catch (const tf2::TransformException&) {
    return std::nullopt;
  }
}

}  // namespace constraint_sim
