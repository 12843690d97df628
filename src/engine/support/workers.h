#pragma once

#include <cstddef>
#include <functional>
#include <memory>

namespace constraint_sim::engine {

/// Threads that share the work of a step, started when they are first wanted and kept until another
/// number is. Where the system has no more threads there are fewer. A copy has its own.
class Workers {
 public:
  Workers();
  Workers(const Workers&);
  Workers& operator=(const Workers&);
  ~Workers();

  /// Calls task(i) for every i below `count`, in any order, on this thread and `threads` − 1
  /// others; returns when all calls have. Throws what one of them did.
  template <typename Task>
  void run(int threads, std::size_t count, const Task& task) {
    if (threads > 1) return share(threads, count, std::cref(task));
    for (std::size_t i = 0; i < count; ++i) task(i);
  }

 private:
  class Team;
  using AnyTask = std::function<void(std::size_t)>;

  void share(int threads, std::size_t count, const AnyTask& task);

  std::unique_ptr<Team> team_;
};

}  // namespace constraint_sim::engine
