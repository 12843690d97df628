#include "ros/publishers.h"

#include <constraint_sim/BodyStates.h>
#include <constraint_sim/ConstraintStates.h>
#include <constraint_sim/ContactForces.h>
#include <constraint_sim/ContactStates.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/String.h>
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <utility>

#include "constraint_sim/engine/plan.h"
#include "ros/actuator_efforts.h"
#include "ros/constraint_state.h"
#include "ros/conversions.h"
#include "ros/time_conversions.h"
#include "urdf/contact_exceptions.h"

namespace constraint_sim {
namespace {

constexpr double kStatisticsPeriod = 0.1;  // [s]
constexpr double kLabelsPeriod = 0.1;      // between labels: nobody reads faster [s]
constexpr char kFollowedFrame[] = "followed";
constexpr double kRepeatPeriod = 1.0;   // between repetitions while nothing changes [s]
constexpr double kClockPeriod = 0.005;  // shortest time between messages on /clock [s]
// Time between /clock going back and the next transforms, for subscribers to notice [s].
constexpr double kSettlingTime = 0.1;

std::int64_t wall_now() { return static_cast<std::int64_t>(ros::WallTime::now().toNSec()); }

}  // namespace

Publishers::Publishers(const Parameters& parameters, Robots& robots, TrajectoryActions& actions,
                       ros::NodeHandle& handle, ros::NodeHandle& private_handle, Hands& hands)
    : parameters_(parameters),
      robots_(robots),
      actions_(actions),
      hands_(hands),
      wrench_topics_(parameters, private_handle,
                     [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; }),
      robot_topics_(private_handle,
                    [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; }),
      plot_topics_(private_handle,
                   [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; }),
      odometry_(parameters, robots, private_handle,
                [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; }),
      stamps_(
          parameters.stamps_simulated_time() ? Stamps::Source::kSimulated : Stamps::Source::kWall,
          parameters.real_time_factor),
      last_statistics_(steady_now()),
      markers_(parameters.world_frame, robots),
      labels_(parameters.world_frame) {
  const auto welcome = [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; };
  if (parameters.publish_tf) {
    transforms_topic_ = handle.advertise<tf2_msgs::TFMessage>("/tf", 100, welcome);
    static_transforms_topic_ = handle.advertise<tf2_msgs::TFMessage>("/tf_static", 100, true);
  }
  markers_topic_ =
      private_handle.advertise<visualization_msgs::MarkerArray>("markers", 10, welcome);
  labels_topic_ = private_handle.advertise<visualization_msgs::MarkerArray>("labels", 10, welcome);
  body_states_topic_ = private_handle.advertise<BodyStates>("body_states", 100, welcome);
  constraint_states_topic_ =
      private_handle.advertise<ConstraintStates>("constraint_states", 100, welcome);
  contact_states_topic_ = private_handle.advertise<ContactStates>("contact_states", 100, welcome);
  contact_forces_topic_ = private_handle.advertise<ContactForces>("contact_forces", 100, welcome);
  joint_states_topic_ =
      private_handle.advertise<sensor_msgs::JointState>("joint_states", 100, welcome);
  plan_topic_ = private_handle.advertise<std_msgs::String>("plan", 1, true);
  if (parameters.publish_clock)
    clock_topic_ = handle.advertise<rosgraph_msgs::Clock>("/clock", 100);
  statistics_topic_ = private_handle.advertise<Statistics>("statistics", 100, welcome);
  thread_ = std::thread(&Publishers::run, this);
}

Publishers::~Publishers() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  wake_up_.notify_one();
  thread_.join();
}

// ---- stepping thread

void Publishers::stepped(const World& world, double seconds) {
  ticks_.add(world, seconds);
  stepped_ = true;
  // The plan also changes without an edit: a joint breaks, a wrench ends, an island switches its
  // method, falls asleep or wakes.
  const engine::StepReport& report = world.report();
  if (report.joints.broken > 0 || report.costs.method_changes > 0 ||
      report.costs.asleep != asleep_ || world.wrenches().size() != wrenches_)
    plan_changed_ = true;
  wrenches_ = world.wrenches().size();
  asleep_ = report.costs.asleep;
}

void Publishers::edited(const World& world) {
  edited_ = plan_changed_ = true;
  wrenches_ = world.wrenches().size();  // a wrench of one tick is gone after the next step
}

double Publishers::passed(const World& world, const Stepper& stepper) {
  if (has_thrown_) {
    const std::lock_guard<std::mutex> lock(mutex_);
    has_thrown_ = false;
    std::rethrow_exception(std::exchange(thrown_, nullptr));
  }
  const double now = steady_now();
  // needed without subscribers as well
  if (stepper.is_paused() || stepper.dropped_ticks() != dropped_ticks_) stamps_.let_go();
  dropped_ticks_ = stepper.dropped_ticks();
  if (parameters_.publish_clock) publish_clock(world, now);
  const double due = next_due();
  if (now < due) return due - now;
  if (!anybody_listens() && !plan_changed_) return kRepeatPeriod;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (fresh_) return 0.001;  // the last round is not yet sent; rounds are not queued
    take_snapshot(world, stepper, now);
    fresh_ = true;
  }
  wake_up_.notify_one();
  return next_due() - now;
}

ros::Time Publishers::stamp(const World& world) const {
  return time_from_nanoseconds(stamps_.of(wall_now(), world.time()));
}

double Publishers::next_due() const {
  const bool news = stepped_ || edited_ || newcomer_;
  return news ? next_publication_ : last_publication_ + kRepeatPeriod;
}

void Publishers::publish_clock(const World& world, double now) {
  const double time = world.time();
  const bool went_back = time < clock_time_;
  const double period = time == clock_time_ ? kRepeatPeriod : kClockPeriod;
  if (!went_back && now < last_clock_ + period) return;
  rosgraph_msgs::Clock message;
  message.clock = time_from_nanoseconds(
      std::max<std::int64_t>(1, Stamps::nanoseconds(time)));  // 0 means no time in ROS
  clock_topic_.publish(message);
  if (went_back) next_publication_ = now + kSettlingTime;
  last_clock_ = now;
  clock_time_ = time;
}

bool Publishers::anybody_listens() const {
  for (const ros::Publisher* topic :
       {&transforms_topic_, &markers_topic_, &labels_topic_, &body_states_topic_,
        &constraint_states_topic_, &contact_states_topic_, &contact_forces_topic_,
        &joint_states_topic_, &statistics_topic_})
    if (topic->getNumSubscribers() > 0) return true;
  return wrench_topics_.anybody_listens() || robot_topics_.anybody_listens() ||
         plot_topics_.anybody_listens() || odometry_.anybody_listens() || hands_.anybody_looks();
}

void Publishers::take_snapshot(const World& world, const Stepper& stepper, double now) {
  const bool running = stepped_ && !stepper.is_paused();
  world.take_snapshot(&incoming_.world);
  incoming_.stamp = time_from_nanoseconds(stamps_.next(wall_now(), world.time(), running));
  incoming_.plan_changed = std::exchange(plan_changed_, false);
  incoming_.for_newcomer = newcomer_.exchange(false);
  incoming_.renew_markers = renew_markers_.exchange(false);
  incoming_.has_statistics = !stepped_ || now >= last_statistics_ + kStatisticsPeriod;
  if (incoming_.has_statistics) take_statistics(world, stepper, now, incoming_.statistics);

  const double period = 1.0 / parameters_.publish_rate;
  next_publication_ = std::max(next_publication_ + period, now);
  last_publication_ = now;
  stepped_ = edited_ = false;
}

void Publishers::take_statistics(const World& world, const Stepper& stepper, double now,
                                 Statistics& message) {
  const engine::StepReport& report = world.report();
  const double ticks = std::max(ticks_.ticks, 1u);
  message.sim_time = time_from_seconds(world.time());
  message.step = world.step_count();
  message.ticks = ticks_.ticks;
  message.max_constraint_error = finite(ticks_.max_constraint_error);
  message.worst_constraint = ticks_.worst_constraint;
  message.energy = finite(world.energy());
  message.energy_drift = finite(report.energy.drift);
  message.local_error = ticks_.local_error;  // NaN where there is no estimate
  message.accumulated_local_error = ticks_.accumulated_local_error;
  message.wall_mean = ticks_.wall_sum / ticks;
  message.wall_max = ticks_.wall_max;
  const double passed = std::max(now - last_statistics_, 1e-9);
  message.real_time_factor = finite(ticks_.simulated / passed);
  message.dropped_ticks = stepper.dropped_ticks();
  message.iterations = report.costs.iterations + report.costs.substeps;
  message.failed = stepper.has_failed();
  message.stages.clear();
  message.stage_times.clear();
  for (std::size_t i = 0; i < engine::kStageCount; ++i) {
    message.stages.emplace_back(engine::name(static_cast<engine::Stage>(i)));
    message.stage_times.push_back(ticks_.stage_sums[i] / ticks);
  }
  message.methods.clear();
  for (std::size_t i = 0; i < engine::kMethodCount; ++i)
    if (report.costs.islands[i] > 0)
      message.methods.emplace_back(engine::name(static_cast<engine::Method>(i)));
  ticks_.clear();
  last_statistics_ = now;
}

// ---- publishing thread

void Publishers::run() {
  for (;;) {
    {
      std::unique_lock<std::mutex> lock(mutex_);
      wake_up_.wait(lock, [this] { return fresh_ || stopping_; });
      if (stopping_) return;
      std::swap(incoming_, current_);
      fresh_ = false;
    }
    try {
      publish(current_);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex_);
      thrown_ = std::current_exception();
      has_thrown_ = true;
    }
  }
}

void Publishers::publish(const Snapshot& snapshot) {
  if (transforms_topic_.getNumSubscribers() > 0) publish_transforms(snapshot);
  if (body_states_topic_.getNumSubscribers() > 0) publish_body_states(snapshot);
  if (constraint_states_topic_.getNumSubscribers() > 0) publish_constraint_states(snapshot);
  if (contact_states_topic_.getNumSubscribers() > 0) publish_contact_states(snapshot);
  if (contact_forces_topic_.getNumSubscribers() > 0) publish_contact_forces(snapshot);
  if (snapshot.plan_changed) {
    publish_plan(snapshot);
    publish_static_transforms(snapshot);
    wrench_topics_.update(snapshot.world);
    const std::vector<RobotDescription> robots = robots_.descriptions(snapshot.world);
    robot_topics_.update(robots);
    plot_topics_.update(robots, snapshot.world);
    actions_.update(robots);
  }
  if (joint_states_topic_.getNumSubscribers() > 0 || robot_topics_.anybody_listens())
    publish_joint_states(snapshot);
  if (plot_topics_.anybody_listens())
    plot_topics_.publish(snapshot.world, snapshot.stamp, parameters_.world_frame);
  if (wrench_topics_.anybody_listens()) publish_wrenches(snapshot);
  odometry_.publish(snapshot.world, snapshot.stamp);
  publish_markers(snapshot);
  hands_.show(snapshot.world);
  if (snapshot.has_statistics && statistics_topic_.getNumSubscribers() > 0) {
    Statistics message = snapshot.statistics;
    message.header.stamp = snapshot.stamp;
    message.header.frame_id = parameters_.world_frame;
    statistics_topic_.publish(message);
  }
}

void Publishers::publish_markers(const Snapshot& snapshot) {
  const bool markers = markers_topic_.getNumSubscribers() > 0;
  const bool labels = labels_topic_.getNumSubscribers() > 0;
  if (snapshot.renew_markers) {
    markers_.forget();
    labels_.forget();
    forces_ = ForceScale();
  }
  if (markers || labels) forces_.update(snapshot.world, snapshot.stamp);
  if (markers) {
    markers_topic_.publish(markers_.update(snapshot.world, forces_, snapshot.stamp,
                                           snapshot.for_newcomer, snapshot.plan_changed));
  } else {
    markers_.forget();
  }
  if (!labels) return labels_.forget();
  const double now = steady_now();
  if (now < last_labels_ + kLabelsPeriod && !snapshot.for_newcomer) return;
  last_labels_ = now;
  labels_topic_.publish(
      labels_.update(snapshot.world, forces_, snapshot.stamp, snapshot.for_newcomer));
}

geometry_msgs::TransformStamped Publishers::transform_of(const Snapshot& snapshot,
                                                         engine::BodyId id) const {
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = snapshot.stamp;
  transform.header.frame_id = parameters_.world_frame;
  transform.child_frame_id = parameters_.frame_prefix + snapshot.world.body(id).name;
  transform.transform = to_transform(snapshot.world.state(id));
  return transform;
}

void Publishers::publish_transforms(const Snapshot& snapshot) {
  tf2_msgs::TFMessage message;
  for (const engine::BodyId id : snapshot.world.body_ids()) {
    if (robots_.add_frames(snapshot.world, id, snapshot.stamp, &message)) continue;
    if (snapshot.world.body(id).type != engine::BodyType::kStatic)
      message.transforms.push_back(transform_of(snapshot, id));
  }
  if (const std::string body = hands_.followed();
      !body.empty() && snapshot.world.has_body(body)) {  // without rotation, for cameras
    message.transforms.push_back(transform_of(snapshot, snapshot.world.find_body(body)));
    geometry_msgs::TransformStamped& followed = message.transforms.back();
    followed.child_frame_id = parameters_.frame_prefix + kFollowedFrame;
    followed.transform.rotation = to_msg(Eigen::Quaterniond::Identity());
  }
  if (!message.transforms.empty()) transforms_topic_.publish(message);
}

// Publishes all static bodies, latched; again when one is added, removed or moved.
void Publishers::publish_static_transforms(const Snapshot& snapshot) {
  if (!parameters_.publish_tf) return;
  tf2_msgs::TFMessage message;
  for (const engine::BodyId id : snapshot.world.body_ids())
    if (snapshot.world.body(id).type == engine::BodyType::kStatic &&
        !robots_.have(snapshot.world, id))
      message.transforms.push_back(transform_of(snapshot, id));
  const auto is_same = [](const auto& a, const auto& b) {
    return a.child_frame_id == b.child_frame_id && a.transform == b.transform;
  };
  if (std::equal(message.transforms.begin(), message.transforms.end(),
                 static_transforms_.transforms.begin(), static_transforms_.transforms.end(),
                 is_same))
    return;
  static_transforms_topic_.publish(message);
  static_transforms_ = std::move(message);
}

void Publishers::publish_body_states(const Snapshot& snapshot) {
  BodyStates message;
  message.header.stamp = snapshot.stamp;
  message.header.frame_id = parameters_.world_frame;
  for (const engine::BodyId id : snapshot.world.body_ids())
    message.bodies.push_back(to_msg(snapshot.world.body(id).name, snapshot.world.state(id)));
  body_states_topic_.publish(message);
}

void Publishers::publish_constraint_states(const Snapshot& snapshot) {
  ConstraintStates message;
  message.header.stamp = snapshot.stamp;
  message.header.frame_id = parameters_.world_frame;
  for (const engine::JointId id : snapshot.world.joint_ids())
    message.constraints.push_back(to_msg(snapshot.world, id));
  constraint_states_topic_.publish(message);
}

void Publishers::publish_contact_states(const Snapshot& snapshot) {
  ContactStates message;
  message.header.stamp = snapshot.stamp;
  message.header.frame_id = parameters_.world_frame;
  for (const engine::Contact& contact : snapshot.world.contacts())
    message.contacts.push_back(to_msg(snapshot.world, contact));
  contact_states_topic_.publish(message);
}

void Publishers::publish_contact_forces(const Snapshot& snapshot) {
  ContactForces message;
  message.header.stamp = snapshot.stamp;
  message.header.frame_id = parameters_.world_frame;
  for (const engine::Contact& contact : snapshot.world.contacts())
    message.contacts.push_back(to_force_msg(snapshot.world, contact));
  contact_forces_topic_.publish(message);
}

void Publishers::publish_joint_states(const Snapshot& snapshot) {
  sensor_msgs::JointState message;
  message.header.stamp = snapshot.stamp;
  message.header.frame_id = parameters_.world_frame;
  const ActuatorEfforts efforts(snapshot.world);
  for (const engine::JointId id : snapshot.world.joint_ids())
    if (!is_contact_exception(snapshot.world.joint(id)))
      add_coordinates(snapshot.world.joint(id), snapshot.world.joint_state(id), efforts.of(id),
                      &message);
  robot_topics_.add_fixed_joints(&message);
  if (joint_states_topic_.getNumSubscribers() > 0) joint_states_topic_.publish(message);
  robot_topics_.publish(message);
}

// Publishes wrenches, and their frames where frames are published.
void Publishers::publish_wrenches(const Snapshot& snapshot) {
  tf2_msgs::TFMessage frames;
  frames.transforms = wrench_topics_.publish(snapshot.world, snapshot.stamp);
  if (parameters_.publish_tf && transforms_topic_.getNumSubscribers() > 0)
    transforms_topic_.publish(frames);
}

void Publishers::publish_plan(const Snapshot& snapshot) {
  std::string plan = engine::explain(snapshot.world);
  if (plan == plan_) return;
  plan_ = std::move(plan);
  std_msgs::String message;
  message.data = plan_;
  plan_topic_.publish(message);
}

}  // namespace constraint_sim
