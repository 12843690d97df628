#include "ros/event_log.h"

#include <ros/console.h>
#include <ros/time.h>

#include <cmath>
#include <iterator>
#include <utility>

#include "constraint_sim/engine/warning.h"
#include "ros/time_conversions.h"

namespace constraint_sim {
namespace {

constexpr double kClockIsMissing = 2.0;  // wall time [s]
// Wall time between log lines while ticks are dropped, or while the clock jumps [s].
constexpr double kDroppedAgain = 10.0;
constexpr double kJumpShows = 1.0;           // wall time until a jump shows in dropped ticks [s]
constexpr std::size_t kMostNamesInLine = 5;  // names per line
// Simulated time that a body may move too fast for the tick without a log line [s]: a motor that is
// switched on does so for a few ticks.
constexpr double kUnresolvedFor = 0.1;

/// Returns the first kMostNamesInLine names, and the number of the others.
std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < names.size() && i < kMostNamesInLine; ++i)
    text += (i == 0 ? "'" : ", '") + names[i] + "'";
  if (names.size() > kMostNamesInLine)
    text += " and " + std::to_string(names.size() - kMostNamesInLine) + " more";
  return text;
}

using Kind = engine::StepWarning::Kind;

std::string unresolved(const World& world) {
  std::vector<std::string> names;
  for (const engine::BodyId id : world.unresolved_bodies()) names.push_back(world.body(id).name);
  return "the tick is too long to show the motion of " + listed(names) +
         ": it is damped away or off";
}

std::string unclosed(const World& world) {
  std::vector<std::string> names;
  for (const engine::JointId id : world.unclosed_joints()) names.push_back(world.joint(id).name);
  return "errors that are not being closed, of " + listed(names) +
         ": these constraints contradict others, or the method cannot hold them";
}

std::string handing_over(const World& world) {
  const std::optional<engine::BodyId>& body = world.report().contacts.handed_over_body;
  std::string why;
  for (const engine::Island& island : world.islands())
    if (body == island.first_body) why = engine::to_string(island.why);
  return "contacts of '" + world.body(*body).name +
         "' and what it touches go from event_driven to time_stepping: " + why;
}

/// Returns the first body of the first island whose contacts became event-driven again.
std::optional<engine::BodyId> taken_back(const World& world) {
  for (const engine::Event& event : world.events())
    if (event.kind == engine::EventKind::kTakenBack) return event.body_a;
  return std::nullopt;
}

bool is_beyond_range(const engine::StepReport& report) {
  return !std::isfinite(report.energy.total + report.energy.drift + report.joints.max_error +
                        report.contacts.max_penetration) ||
         std::isinf(report.local_error);  // NaN means no estimate
}

/// A kind of warning that is logged when it begins and when it ends.
struct Reported {
  Kind kind;
  const char* ends;
  /// Text of the warning without its advice; null: its text in World::warnings().
  std::string (*begins)(const World&) = nullptr;
  double patience = 0.0;  ///< simulated time for which it has to hold before it is logged [s]
};

// Each reported kind is one row.
const Reported kReported[] = {
    {Kind::kUnresolved, "the tick shows the motion of all bodies again", unresolved,
     kUnresolvedFor},
    {Kind::kUnclosed, "errors are closed, or are being closed, again", unclosed},
    {Kind::kEnergyRise, "energy no longer rises without a cause"},
    {Kind::kHitsLeft, "fast bodies no longer hit more often than a tick looks for"},
    {Kind::kOverlap, "contacts by impulses no longer overlap"},
    {Kind::kCreep, "contacts by impulses no longer creep"},
    {Kind::kUnsolved, "impulses are solved again"},
    {Kind::kHandedOver, "no more contacts go from event_driven to time_stepping", handing_over},
};
static_assert(std::size(kReported) == engine::kWarningKindCount);

/// Returns the line that a warning begins with.
std::string line_of(const Reported& reported, const World& world) {
  if (reported.begins != nullptr)
    return reported.begins(world) + "; " + engine::info(reported.kind).advice;
  for (const engine::StepWarning& warning : world.warnings())
    if (warning.kind == reported.kind) return engine::with_advice(warning);
  return {};
}

}  // namespace

EventLog::EventLog(const Parameters& parameters)
    : parameters_(parameters),
      reported_(std::size(kReported)),
      held_for_(std::size(kReported)),
      last_clock_(steady_now()) {}

void EventLog::stepped(const World& world) {
  const engine::StepReport& report = world.report();
  if (report.outcome.failed) return;  // a failed step fills in no other field
  for (std::size_t i = 0; i < reported_.size(); ++i) {
    const bool is_now = engine::info(kReported[i].kind).is_in(report);
    held_for_[i] = is_now ? held_for_[i] + world.options().time_step : 0.0;
    const bool holds = is_now && held_for_[i] > kReported[i].patience;
    if (!holds && !reported_[i].has_begun()) continue;
    switch (reported_[i].update(holds, steady_now())) {
      case Condition::Change::kBegan:
        ROS_WARN("step %lu: %s", world.step_count(), line_of(kReported[i], world).c_str());
        break;
      case Condition::Change::kEnded:
        ROS_INFO("step %lu: %s", world.step_count(), kReported[i].ends);
        break;
      case Condition::Change::kNone:
        break;
    }
  }
  tell_of_range(world);
  if (report.joints.broken > 0) report_broken(world);
  tell_of_return(world);
}

void EventLog::tell_of_range(const World& world) {
  const bool holds = is_beyond_range(world.report());
  if (!holds && !beyond_range_.has_begun()) return;
  switch (beyond_range_.update(holds, steady_now())) {
    case Condition::Change::kBegan:
      ROS_WARN(
          "step %lu: energy or errors are beyond the range of numbers: messages have the largest "
          "instead",
          world.step_count());
      break;
    case Condition::Change::kEnded:
      ROS_INFO("step %lu: energy and errors are numbers again", world.step_count());
      break;
    case Condition::Change::kNone:
      break;
  }
}

void EventLog::tell_of_return(const World& world) {
  const std::optional<engine::BodyId> body = taken_back(world);
  if (!body && !returning_.has_begun()) return;
  if (returning_.update(body.has_value(), steady_now()) == Condition::Change::kBegan)
    ROS_INFO("step %lu: contacts of '%s' and what it touches are by event_driven again",
             world.step_count(), world.body(*body).name.c_str());
}

void EventLog::edited(const World& world) {
  broken_.clear();
  for (const engine::JointId id : world.joint_ids())
    if (world.joint_state(id).broken) broken_.insert(id.value);
}

void EventLog::report_broken(const World& world) {
  std::vector<std::string> names;
  for (const engine::JointId id : world.joint_ids())
    if (world.joint_state(id).broken && broken_.insert(id.value).second)
      names.push_back(world.joint(id).name);
  if (!names.empty()) ROS_WARN("step %lu: broken: %s", world.step_count(), listed(names).c_str());
}

void EventLog::passed(const World& world, const Stepper& stepper) {
  const double now = steady_now();
  tell_of_failure(world, stepper);
  if (parameters_.follows_clock()) {
    tell_of_clock(now);
    tell_of_jumps(now);
  }
  tell_of_dropped_ticks(world, stepper, now);
}

void EventLog::tell_of_failure(const World& world, const Stepper& stepper) {
  if (stepper.has_failed() == has_failed_) return;
  has_failed_ = stepper.has_failed();
  if (has_failed_)
    ROS_ERROR(
        "the physics failed after step %lu, at %g s: %s. The state of that step is kept, and the "
        "world stands until it is edited or reset",
        world.step_count(), world.time(), stepper.failure().c_str());
  else
    ROS_INFO("the world is edited or reset, and goes on after the failure");
}

void EventLog::tell_of_dropped_ticks(const World& world, const Stepper& stepper, double now) {
  const std::uint64_t all = stepper.dropped_ticks();
  const bool any = all != dropped_ticks_;
  const bool more = any && now > excused_until_;
  if (any) excused_until_ = 0.0;
  dropped_ticks_ = all;
  if (!more && !dropping_.has_begun()) return;
  const Condition::Change change = dropping_.update(more, now);
  if (change == Condition::Change::kEnded) ROS_INFO("no more ticks are dropped; %lu were", all);
  if (!more || (change == Condition::Change::kNone && now < told_of_dropped_ + kDroppedAgain))
    return;
  told_of_dropped_ = now;
  ROS_WARN(
      "ticks are dropped, %lu so far: this machine does not keep up with real_time_factor %g at a "
      "tick of %g s",
      all, stepper.real_time_factor(), world.options().time_step);
}

void EventLog::heard_clock(double before, double now) {
  last_clock_ = steady_now();
  if (before == 0.0 || (now >= before && now <= before + kClockJump)) return;
  const std::lock_guard<std::mutex> lock(jumps_mutex_);
  Jumps& jumps = now < before ? back_ : forward_;
  ++jumps.count;
  jumps.before = before;
  jumps.after = now;
}

// Logs at most once in kDroppedAgain: a clock that advances in large steps jumps all the time.
void EventLog::tell_of_jumps(double now) {
  const std::lock_guard<std::mutex> lock(jumps_mutex_);
  if (std::exchange(forward_.noticed, forward_.count) != forward_.count)
    excused_until_ = now + kJumpShows;
  for (Jumps* jumps : {&forward_, &back_}) {
    if (jumps->count == jumps->told || now < jumps->told_at + kDroppedAgain) continue;
    const std::uint64_t more = jumps->count - jumps->told - 1;
    const std::string others =
        more == 0 ? "" : "; " + std::to_string(more) + " others since the last line";
    jumps->told = jumps->count;
    jumps->told_at = now;
    if (jumps == &forward_)
      ROS_WARN(
          "/clock jumped forward by %g s, from %.3f to %.3f: simulated time goes there, and ticks "
          "are taken for the last %g s alone%s",
          jumps->after - jumps->before, jumps->before, jumps->after, kClockJump, others.c_str());
    else
      ROS_INFO("/clock went back by %g s, from %.3f to %.3f: simulated time goes there%s",
               jumps->before - jumps->after, jumps->before, jumps->after, others.c_str());
  }
}

void EventLog::tell_of_clock(double now) {
  switch (without_clock_.update(now > last_clock_ + kClockIsMissing, now)) {
    case Condition::Change::kBegan:
      ROS_WARN(
          "nothing on /clock for %g s: the world stands, since /use_sim_time is true and "
          "publish_clock is false. If a replay left that behind: rosparam set /use_sim_time false, "
          "and start again",
          kClockIsMissing);
      break;
    case Condition::Change::kEnded:
      ROS_INFO("/clock has come: the world follows it");
      break;
    case Condition::Change::kNone:
      break;
  }
}

}  // namespace constraint_sim
