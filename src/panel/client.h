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

/// Which calls wait for each other. A pause must overtake steps, and a query a long load.
enum class Queue { kPauses, kSteps, kEdits, kQueries };
constexpr std::size_t kQueues = 4;

/// What became of a call.
struct Outcome {
  std::string what;  ///< the service, and what it was asked for
  bool success = false;
  std::string message;  ///< of the node, or why there was no answer
  bool is_poll = false;
  std::function<void()> then;  ///< on success: what the caller does with the answer
};

/// Of calls that the user did not ask for: their outcome goes to no list of messages, a newer one
/// replaces one that waits, and they are given up after this time [s].
constexpr double kPollTimeout = 5.0;

/// A simulator as the panel sees it. Nothing here waits: calls are made on threads of their own,
/// and what comes of them is fetched by take_outcomes(). Not for several threads.
class Client {
 public:
  /// Gives up all calls of the node before, and talks to this one. A name is resolved as ROS does:
  /// `/constraint_sim` can be remapped.
  void connect(const std::string& node);
  const std::string& node() const { return node_; }

  void want(const Topics::Wanted& wanted) { topics_->want(wanted); }
  Topics::News take_news() { return topics_->take(); }
  std::vector<Outcome> take_outcomes();
  /// The call that waits the longest.
  std::optional<Lane::Waiting> waiting() const;

  template <class Service>
  using Then = std::function<void(const typename Service::Response&)>;

  /// Calls NODE/`service`; messages name the call `service argument`. Calls with the same `key`
  /// replace each other while they wait.
  template <class Service>
  void call(Queue queue, const std::string& service, const std::string& argument,
            const typename Service::Request& request, Then<Service> then = nullptr,
            const std::string& key = "") {
    const std::string what = argument.empty() ? service : service + " " + argument;
    post<Service>(queue, service, {what, false, "", false, nullptr}, request, then, key);
  }

  /// Reads the node's private parameter.
  void read_parameter(const std::string& name, std::function<void(double)> then);

  /// The same as a poll.
  template <class Service>
  void poll(const std::string& service, const typename Service::Request& request,
            Then<Service> then) {
    post<Service>(Queue::kQueries, service, {service, false, "", true, nullptr}, request, then,
                  service);
  }

 private:
  /// The lanes write here, also while they end.
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
