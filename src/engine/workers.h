#pragma once

#include <functional>
#include <memory>

namespace constraint_sim::engine {

/// Threads that share the work of a step, started when they are first wanted. A copy has its own.
class Workers {
 public:
  using Task = std::function<void(std::size_t)>;

  Workers();
  Workers(const Workers&);
  Workers& operator=(const Workers&);
  ~Workers();

  /// Calls task(i) for every i below `count`, in any order, on this thread and `threads` − 1
  /// others; returns when all calls have. They must not throw.
  void run(int threads, std::size_t count, const Task& task);

 private:
  class Team;
  std::unique_ptr<Team> team_;
};

}  // namespace constraint_sim::engine
