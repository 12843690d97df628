#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "panel/lane.h"
#include "panel/service_call.h"
#include "panel/topics.h"

namespace constraint_sim::panel {

/// Queues of calls. Calls wait only for those of their own queue: a pause must overtake steps, and
/// a query a long load.
enum class Queue { kPauses, kSteps, kEdits, kQueries };
constexpr std::size_t kQueues = 4;

/// Result of a call.
struct Outcome {
  std::string what;  ///< service and argument of the call
  bool success = false;
  std::string message;  ///< the node's message, or the reason why there was no response
  bool is_poll = false;
  std::function<void()> then;  ///< on success: passes the response to the caller
};

/// Time after which polls, calls that the user did not request, are given up [s]. The outcome of a
/// poll is not listed as a message, and a newer poll replaces a waiting one.
constexpr double kPollTimeout = 5.0;

/// Connection of the panel to a simulator. Nothing here blocks: calls run on threads of their own,
/// and take_outcomes() returns their results. For one thread only.
class Client {
 public:
  /// Gives up all calls to the previous node, and connects to this one. The name is resolved by
  /// ROS: `/constraint_sim` can be remapped.
  void connect(const std::string& node);
  const std::string& node() const { return node_; }

  void want(const Topics::Wanted& wanted) { topics_->want(wanted); }
  Topics::News take_news() { return topics_->take(); }
  std::vector<Outcome> take_outcomes();
  /// Returns the call that has waited longest.
  std::optional<Lane::Waiting> waiting() const;

  template <class Service>
  using Then = std::function<void(const typename Service::Response&)>;

  /// Calls NODE/`service`; messages name the call `service argument`. A newer call replaces a
  /// waiting one with the same `key`.
  template <class Service>
  void call(Queue queue, const std::string& service, const std::string& argument,
            const typename Service::Request& request, Then<Service> then = nullptr,
            const std::string& key = "") {
    const std::string what = argument.empty() ? service : service + " " + argument;
    post<Service>(queue, service, {what, false, "", false, nullptr}, request, then, key);
  }

  /// Reads a private parameter of the node.
  void read_parameter(const std::string& name, std::function<void(double)> then);

  /// Calls a service as a poll.
  template <class Service>
  void poll(const std::string& service, const typename Service::Request& request,
            Then<Service> then) {
    post<Service>(Queue::kQueries, service, {service, false, "", true, nullptr}, request, then,
                  service);
  }

 private:
  /// Outcomes from the lanes, which write here also while they end.
  struct Outbox {
    std::mutex mutex;
    std::vector<Outcome> outcomes;
    void put(Outcome outcome);
  };

  template <class Response>
  static auto read_success(const Response& response, Outcome* outcome, int)
      -> decltype(response.success, void()) {
    outcome->success = response.success;
    outcome->message = response.status_message;
  }
  template <class Response>
  static void read_success(const Response&, Outcome* outcome, long) {
    outcome->success = true;
  }

  template <class Service>
  void post(Queue queue, const std::string& service, Outcome outcome,
            const typename Service::Request& request, const Then<Service>& then,
            const std::string& key) {
    const std::string what = outcome.what;
    Outbox* const outbox = outbox_.get();
    auto work = [name = node_ + "/" + service, outcome = std::move(outcome), request, then,
                 outbox](const Cancellation& cancellation) mutable {
      try {
        const auto response = call_service<Service>(name, request, cancellation,
                                                    outcome.is_poll ? kPollTimeout : 0.0);
        read_success(response, &outcome, 0);
        if (then && outcome.success) outcome.then = [then, response] { then(response); };
      } catch (const std::exception& error) {
        outcome.message = error.what();
      }
      outbox->put(std::move(outcome));
    };
    lanes_->at(static_cast<std::size_t>(queue)).post(what, std::move(work), key);
  }

  std::string node_;
  std::unique_ptr<Outbox> outbox_;
  std::unique_ptr<Topics> topics_;
  std::unique_ptr<std::array<Lane, kQueues>> lanes_;
};

}  // namespace constraint_sim::panel
