#include "panel/client.h"

#include <ros/names.h>
#include <ros/param.h>

namespace constraint_sim::panel {

void Client::connect(const std::string& node) {
  lanes_.reset();
  topics_.reset();
  node_ = ros::names::resolve(node);
  outbox_ = std::make_unique<Outbox>();
  topics_ = std::make_unique<Topics>(node_);
  lanes_ = std::make_unique<std::array<Lane, kQueues>>();
}

void Client::Outbox::put(Outcome outcome) {
  const std::lock_guard<std::mutex> lock(mutex);
  outcomes.push_back(std::move(outcome));
}

void Client::read_parameter(const std::string& name, std::function<void(double)> then) {
  Outbox* const outbox = outbox_.get();
  const auto work = [name = node_ + "/" + name, then = std::move(then),
                     outbox](const Cancellation&) {
    double value = 0.0;
    Outcome outcome = {name, ros::param::get(name, value), "", true, nullptr};
    if (outcome.success) outcome.then = [then, value] { then(value); };
    outbox->put(std::move(outcome));
  };
  lanes_->at(static_cast<std::size_t>(Queue::kQueries)).post(name, work, name);
}

std::vector<Outcome> Client::take_outcomes() {
  const std::lock_guard<std::mutex> lock(outbox_->mutex);
  return std::exchange(outbox_->outcomes, {});
}

std::optional<Lane::Waiting> Client::waiting() const {
  std::optional<Lane::Waiting> longest;
  for (const Lane& lane : *lanes_) {
    const std::optional<Lane::Waiting> waiting = lane.waiting();
    if (waiting && (!longest || waiting->seconds > longest->seconds)) longest = waiting;
  }
  return longest;
}

}  // namespace constraint_sim::panel
