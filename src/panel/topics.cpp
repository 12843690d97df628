#include "panel/topics.h"

#include <chrono>
#include <utility>

namespace constraint_sim::panel {
namespace {

// Period of reading; tree and plots need no higher rate.
constexpr auto kInterval = std::chrono::milliseconds(100);
// Largest number of unread statistics: ten seconds at ten a second.
constexpr std::size_t kMostStatistics = 100;

}  // namespace

Topics::Topics(const std::string& node) : node_(node) {
  handle_.setCallbackQueue(&queue_);
  thread_ = std::thread([this] { run(); });
}

Topics::~Topics() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  wake_up_.notify_all();
  thread_.join();
}

void Topics::want(const Wanted& wanted) {
  const std::lock_guard<std::mutex> lock(mutex_);
  wanted_ = wanted;
}

Topics::News Topics::take() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(news_, News());
}

void Topics::run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stopping_) {
    const Wanted wanted = wanted_;
    lock.unlock();
    subscribe(wanted);
    queue_.callAvailable();
    lock.lock();
    wake_up_.wait_for(lock, kInterval, [this] { return stopping_; });
  }
  lock.unlock();
  subscribe(Wanted());
}

void Topics::subscribe(const Wanted& wanted) {
  const auto follow = [this](bool is_wanted, ros::Subscriber* subscriber, const char* topic,
                             std::uint32_t most, auto callback) {
    if (is_wanted == static_cast<bool>(*subscriber)) return;
    if (is_wanted)
      *subscriber = handle_.subscribe(node_ + "/" + topic, most, callback, this,
                                      ros::TransportHints().tcpNoDelay());
    else
      *subscriber = ros::Subscriber();
  };
  follow(wanted.bodies, &bodies_, "body_states", 1, &Topics::on_bodies);
  follow(wanted.constraints, &constraints_, "constraint_states", 1, &Topics::on_constraints);
  follow(wanted.statistics, &statistics_, "statistics", kMostStatistics, &Topics::on_statistics);
  has_scene_ = has_scene_ && wanted.scenes;
  follow(wanted.scenes, &scenes_, "scene", 10, &Topics::on_scene);
}

void Topics::on_bodies(const BodyStatesConstPtr& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  news_.bodies = message;
}

void Topics::on_constraints(const ConstraintStatesConstPtr& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  news_.constraints = message;
}

void Topics::on_statistics(const StatisticsConstPtr& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (news_.statistics.size() < kMostStatistics) news_.statistics.push_back(message);
}

// Notes a new scene. The topic is latched: the first message is the present scene.
void Topics::on_scene(const std_msgs::StringConstPtr& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  news_.scene = message->data;
  news_.is_scene_new = news_.is_scene_new || has_scene_;
  has_scene_ = true;
}

}  // namespace constraint_sim::panel
