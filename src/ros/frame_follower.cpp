#include "ros/frame_follower.h"

#include <ros/console.h>
#include <ros/time.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "ros/conversions.h"
#include "ros/time_conversions.h"
#include "sim/errors.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kStale = 0.5;    // time without a transform that is new enough [s]
constexpr double kJitter = 0.02;  // deviation of the start of a tick that is not compensated [s]
constexpr double kSlew = 0.5;  // largest share of a tick by which stamps are corrected in each tick
constexpr double kLost = 0.5;  // deviation beyond which stamps restart, as after a pause [s]

// Returns the rotation vector [rad] that turns `from` into `to`.
Vector3d rotation_to(const Quaterniond& from, const Quaterniond& to) {
  Quaterniond turn = to * from.conjugate();
  if (turn.w() < 0.0) turn.coeffs() = -turn.coeffs();
  const double sine = turn.vec().norm();
  if (sine < 1e-12) return 2.0 * turn.vec();
  return 2.0 * std::atan2(sine, turn.w()) / sine * turn.vec();
}

}  // namespace

FrameFollower::FrameFollower(const Parameters& parameters) : parameters_(parameters) {
  for (const auto& [body, frame] : followed_in(parameters.follow)) {
    Followed& followed = followed_.emplace_back();
    followed.body = body;
    followed.frame = frame;
  }
}

void FrameFollower::start(const ros::NodeHandle& handle) {
  if (!followed_.empty()) frames_.start(handle);
}

std::vector<std::string> FrameFollower::stale() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stale_;
}

void FrameFollower::before_step(Driver* driver, double real_time_factor) {
  if (followed_.empty()) return;
  const double stamp =
      stamp_after_tick(driver->world(), real_time_factor) - parameters_.follow_delay;
  for (Followed& followed : followed_) {
    try {
      follow(driver, stamp, &followed);
      followed.is_refused = false;
    } catch (...) {
      followed.is_following = false;
      if (!std::exchange(followed.is_refused, true))
        ROS_WARN("follow: '%s' cannot follow '%s': %s", followed.body.c_str(),
                 followed.frame.c_str(), message_of_exception().c_str());
    }
  }
}

// Returns the stamp of the transforms for the end of the tick [s]. In wall time stamps advance
// evenly, although the machine starts ticks unevenly.
double FrameFollower::stamp_after_tick(const engine::World& world, double real_time_factor) {
  const double end = world.time() + world.options().time_step;
  if (parameters_.stamps_simulated_time()) {
    const double jump = world.time() - std::exchange(last_end_, end);
    if (std::abs(jump) <= kLost) return end;
    begin_anew();
    for (Followed& followed : followed_)
      followed.last_heard = -1.0;  // the stamps now have another origin
    return end;
  }
  const double now = ros::WallTime::now().toSec();
  if (!(real_time_factor > 0.0)) return now;
  const double late = now - (anchor_ + end / real_time_factor);
  if (std::abs(late) > kLost) {
    anchor_ += late;
    begin_anew();
  } else if (std::abs(late) > kJitter) {
    const double most = kSlew * world.options().time_step / real_time_factor;
    anchor_ += std::clamp(late, -most, most);
  }
  return anchor_ + end / real_time_factor;
}

// Makes the next transform place each body, which would otherwise rush there within one tick.
void FrameFollower::begin_anew() {
  for (Followed& followed : followed_) followed.is_following = false;
}

void FrameFollower::follow(Driver* driver, double stamp, Followed* followed) {
  const engine::World& world = driver->world();
  const engine::BodyId id = find_own_body(world, "body", followed->body);
  if (world.body(id).type != engine::BodyType::kKinematic)
    throw std::invalid_argument("the body is not kinematic");
  std::optional<geometry_msgs::Transform> found;
  if (stamp > 0.0)
    found = frames_.look_up(parameters_.world_frame, followed->frame, ros::Time(stamp));
  const bool known = found.has_value();
  notice(known, stamp, followed);
  // Without a newer transform the body goes to the last known one and stops there.
  if (!known && followed->is_following)
    found = frames_.look_up(parameters_.world_frame, followed->frame, ros::Time(0));
  engine::BodyState state = world.state(id);
  const engine::BodyState before = state;
  Vector3d position = state.position;
  Quaterniond orientation = state.orientation;
  if (found) {
    position = from_msg(found->translation);
    orientation = from_msg(found->rotation).normalized();
  }
  const bool is_placed = known && !followed->is_following;
  if (is_placed) {  // placed without a velocity, as by set_body_state
    state.position = position;
    state.orientation = orientation;
  }
  const double h = world.options().time_step;
  state.linear_velocity = (position - state.position) / h;
  state.angular_velocity = rotation_to(state.orientation, orientation) / h;
  if (is_placed || state.linear_velocity != before.linear_velocity ||
      state.angular_velocity != before.angular_velocity)
    driver->set_state(id, state);
  followed->is_following = found.has_value();
}

void FrameFollower::notice(bool is_known, double stamp, Followed* followed) {
  if (is_known || followed->last_heard < 0.0) followed->last_heard = stamp;
  const bool is_stale = stamp > followed->last_heard + kStale;
  if (is_stale) followed->is_following = false;  // the next transform places the body
  switch (followed->without_frame.update(is_stale, steady_now())) {
    case Condition::Change::kBegan:
      ROS_WARN("follow: no transform of '%s' to '%s' for %g s: '%s' stands until one comes",
               followed->frame.c_str(), parameters_.world_frame.c_str(), kStale,
               followed->body.c_str());
      break;
    case Condition::Change::kEnded:
      ROS_INFO("follow: '%s' follows '%s' again", followed->body.c_str(), followed->frame.c_str());
      break;
    case Condition::Change::kNone:
      break;
  }
  if (std::exchange(followed->is_stale, is_stale) == is_stale) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  stale_.clear();
  for (const Followed& each : followed_)
    if (each.is_stale) stale_.push_back(each.body);
}

}  // namespace constraint_sim
