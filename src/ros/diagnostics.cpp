#include "ros/diagnostics.h"

#include <diagnostic_msgs/DiagnosticArray.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "constraint_sim/engine/warning.h"
#include "ros/time_conversions.h"

namespace constraint_sim {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kPeriod = 1.0;  // [s]
constexpr std::size_t kMostNames = 20;

std::string shown(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

void add(DiagnosticStatus* status, const char* key, const std::string& value) {
  diagnostic_msgs::KeyValue pair;
  pair.key = key;
  pair.value = value;
  status->values.push_back(std::move(pair));
}

void warn(DiagnosticStatus* status, const std::string& why) {
  if (status->level == DiagnosticStatus::OK) status->message.clear();
  status->level = std::max<std::int8_t>(status->level, DiagnosticStatus::WARN);
  status->message += (status->message.empty() ? "" : "; ") + why;
}

/// Adds a text that does not change the level.
void note(DiagnosticStatus* status, const std::string& text) { status->message += "; " + text; }

}  // namespace

Diagnostics::Diagnostics(const Parameters& parameters, ros::NodeHandle& handle,
                         const std::string& node)
    : parameters_(parameters),
      node_(node),
      topic_(handle.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 10)) {}

void Diagnostics::stepped(const World& world, double seconds) {
  if (listening_) ticks_.add(world, seconds);
}

double Diagnostics::passed(const World& world, const Stepper& stepper,
                           const FrameFollower& follower) {
  const double now = steady_now();
  const bool listens = topic_.getNumSubscribers() > 0;
  if (listens != listening_) {
    listening_ = listens;
    start_interval(stepper, now);
  }
  // A pause restarts the interval: within one it would look like a slow clock.
  if (stepper.is_paused() != was_paused_) start_interval(stepper, now);
  if (!listening_) return kPeriod;
  const double passed = now - started_;
  if (passed < kPeriod) return kPeriod - passed;
  diagnostic_msgs::DiagnosticArray message;
  message.header.stamp = ros::Time::now();
  message.status = {clock(stepper, passed), constraints(world), physics(world, stepper)};
  if (follower.follows_any()) message.status.push_back(frames(follower));
  topic_.publish(message);
  start_interval(stepper, now);
  return kPeriod;
}

void Diagnostics::start_interval(const Stepper& stepper, double now) {
  ticks_.clear();
  started_ = now;
  dropped_before_ = stepper.dropped_ticks();
  was_paused_ = stepper.is_paused();
}

Diagnostics::Status Diagnostics::begin(const char* what) const {
  Status status;
  status.name = node_ + ": " + what;
  status.hardware_id = node_;
  status.level = Status::OK;
  return status;
}

Diagnostics::Status Diagnostics::clock(const Stepper& stepper, double passed) const {
  Status status = begin("clock");
  const double asked = stepper.real_time_factor();
  const double factor = ticks_.simulated / passed;
  const std::uint64_t dropped = stepper.dropped_ticks() - dropped_before_;
  const bool stands = stepper.is_paused() || stepper.has_failed();
  status.message = stands ? "stands" : asked > 0.0 ? "keeps up" : "as fast as it can";
  // The followed clock may itself be slow or stand still, so it sets no pace.
  const bool has_pace = asked > 0.0 && !parameters_.follows_clock();
  if (!stands && has_pace && factor < parameters_.diagnostics_real_time_factor * asked)
    warn(&status, "real-time factor " + shown(factor) + ", " + shown(asked) + " is asked for");
  if (dropped > 0) warn(&status, std::to_string(dropped) + " ticks dropped");
  add(&status, "real_time_factor", shown(factor));
  add(&status, "real_time_factor asked for", shown(asked));
  add(&status, "dropped ticks", std::to_string(dropped));
  add(&status, "dropped ticks since the start", std::to_string(stepper.dropped_ticks()));
  add(&status, "ticks", std::to_string(ticks_.ticks));
  add(&status, "run time of a tick, mean [s]", shown(ticks_.wall_sum / std::max(ticks_.ticks, 1u)));
  add(&status, "run time of a tick, largest [s]", shown(ticks_.wall_max));
  add(&status, "paused", stepper.is_paused() ? "true" : "false");
  return status;
}

Diagnostics::Status Diagnostics::constraints(const World& world) const {
  Status status = begin("constraints");
  status.message = "hold";
  std::size_t broken = 0;
  for (const engine::JointId id : world.joint_ids()) broken += world.joint_state(id).broken;
  std::string inconsistent;
  const std::vector<engine::JointId> unclosed = world.unclosed_joints();
  for (std::size_t i = 0; i < std::min(unclosed.size(), kMostNames); ++i)
    inconsistent += (i == 0 ? "" : ", ") + world.joint(unclosed[i]).name;
  if (ticks_.max_constraint_error > parameters_.diagnostics_constraint_error)
    warn(&status, ticks_.worst_constraint + " is off by " + shown(ticks_.max_constraint_error));
  if (!unclosed.empty())
    warn(&status, std::to_string(unclosed.size()) + " inconsistent or not being closed: " +
                      engine::info(engine::StepWarning::Kind::kUnclosed).advice);
  add(&status, "largest error [m]", shown(ticks_.max_constraint_error));
  add(&status, "worst constraint", ticks_.worst_constraint);
  add(&status, "inconsistent", inconsistent);
  add(&status, "broken", std::to_string(broken));
  add(&status, "constraints", std::to_string(world.joint_ids().size()));
  return status;
}

Diagnostics::Status Diagnostics::physics(const World& world, const Stepper& stepper) const {
  Status status = begin("physics");
  status.message = "goes on";
  if (!stepper.has_failed())
    for (const engine::StepWarning& warning : world.warnings()) {
      if (warning.kind == engine::StepWarning::Kind::kUnclosed) continue;  // see constraints()
      const bool is_notice = engine::info(warning.kind).is_notice;
      (is_notice ? note : warn)(&status, engine::with_advice(warning));
    }
  if (stepper.has_failed()) {
    status.level = Status::ERROR;
    status.message = "failed: " + stepper.failure();
  }
  add(&status, "failed", stepper.has_failed() ? "true" : "false");
  add(&status, "step", std::to_string(world.step_count()));
  add(&status, "simulated time [s]", shown(world.time()));
  add(&status, "local error in this second [m]",
      std::isnan(ticks_.local_error) ? "no estimate" : shown(ticks_.local_error));
  add(&status, "events in this second", std::to_string(ticks_.events));
  add(&status, "substeps in this second", std::to_string(ticks_.substeps));
  return status;
}

Diagnostics::Status Diagnostics::frames(const FrameFollower& follower) const {
  Status status = begin("frames");
  status.message = "followed";
  std::string stale;
  for (const std::string& body : follower.stale()) stale += (stale.empty() ? "" : ", ") + body;
  if (!stale.empty()) warn(&status, "no transform to follow: " + stale);
  add(&status, "bodies that stand", stale);
  return status;
}

}  // namespace constraint_sim
