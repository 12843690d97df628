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

/// Calls that are made one after the other, on a thread of their own.
class Lane {
 public:
  using Call = std::function<void(const Cancellation&)>;

  /// What a lane is busy with.
  struct Waiting {
    std::string what;
    double seconds;  ///< since the call began
  };

  Lane();
  /// Gives up the call that waits, and forgets the others.
  ~Lane();
  Lane(const Lane&) = delete;
  Lane& operator=(const Lane&) = delete;

  /// Puts a call at the end. With a `key`, in place of one that has not begun and has the same key.
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
  std::deque<Task> tasks_;  // the first one may have begun
  bool stopping_ = false;
  bool has_begun_ = false;
  std::chrono::steady_clock::time_point begin_;
  Cancellation cancellation_;
  std::thread thread_;
};

}  // namespace constraint_sim::panel
