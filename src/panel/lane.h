#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "panel/service_call.h"

namespace constraint_sim::panel {

/// A queue of calls made one after the other on a thread of its own.
class Lane {
 public:
  using Call = std::function<void(const Cancellation&)>;

  /// The present call of a lane.
  struct Waiting {
    std::string what;
    double seconds;  ///< since the call began
  };

  Lane();
  /// Gives up the present call, and drops the others.
  ~Lane();
  Lane(const Lane&) = delete;
  Lane& operator=(const Lane&) = delete;

  /// Appends a call. A call with a `key` replaces a waiting one with the same key.
  void post(const std::string& what, Call call, const std::string& key = "");
  std::optional<Waiting> waiting() const;

 private:
  struct Task {
    std::string what;
    std::string key;
    Call call;
  };
  void run();

  mutable std::mutex mutex_;
  std::condition_variable wake_up_;
  std::deque<Task> tasks_;  // the first one may be running
  bool stopping_ = false;
  bool has_begun_ = false;
  std::chrono::steady_clock::time_point begin_;
  Cancellation cancellation_;
  std::thread thread_;
};

}  // namespace constraint_sim::panel
