#include "engine/support/workers.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

class Workers::Team {
 public:
  // as many as the system grants: the work is the same with fewer
  explicit Team(int threads) : wanted_(threads) {
    try {
      for (int i = 1; i < threads; ++i) others_.emplace_back([this] { work(); });
    } catch (const std::system_error&) {
    } catch (...) {
      end();
      throw;
    }
  }
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;
  ~Team() { end(); }

  int wanted() const { return wanted_; }

  void run(std::size_t count, const AnyTask& task) {
    // pieces small enough that nobody waits long for the last one
    constexpr std::size_t kPiecesEach = 8;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      task_ = &task;
      count_ = count;
      piece_ = std::max<std::size_t>(1, count / (kPiecesEach * (others_.size() + 1)));
      next_ = 0;
      busy_ = others_.size();
      ++round_;
    }
    begun_.notify_all();
    take_pieces();
    std::unique_lock<std::mutex> lock(mutex_);
    done_.wait(lock, [this] { return busy_ == 0; });
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
  }

 private:
  void end() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      is_over_ = true;
    }
    begun_.notify_all();
    for (std::thread& other : others_) other.join();
  }

  void work() {
    std::uint64_t seen = 0;
    std::unique_lock<std::mutex> lock(mutex_);
    for (;;) {
      begun_.wait(lock, [&] { return is_over_ || round_ != seen; });
      if (is_over_) return;
      seen = round_;
      lock.unlock();
      take_pieces();
      lock.lock();
      if (--busy_ == 0) done_.notify_one();
    }
  }

  void take_pieces() {
    for (;;) {
      const std::size_t begin = next_.fetch_add(piece_);
      const std::size_t end = std::min(begin + piece_, count_);
      if (begin >= end) return;
      try {
        for (std::size_t i = begin; i < end; ++i) (*task_)(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex_);
        thrown_ = std::current_exception();
      }
    }
  }

  std::mutex mutex_;
  std::condition_variable begun_, done_;
  std::uint64_t round_ = 0;
  bool is_over_ = false;
  std::exception_ptr thrown_;  // by a task of this round; null: none
  std::size_t busy_ = 0;       // others that have not finished this round

  // Task and counts of a round; set before the round begins.
  const AnyTask* task_ = nullptr;
  std::size_t count_ = 0, piece_ = 1;
  std::atomic<std::size_t> next_{0};

  int wanted_;
  List<std::thread> others_;
};

Workers::Workers() = default;
Workers::Workers(const Workers&) {}
Workers& Workers::operator=(const Workers&) { return *this; }
Workers::~Workers() = default;

void Workers::share(int threads, std::size_t count, const AnyTask& task) {
  if (!team_ || team_->wanted() != threads) team_ = std::make_unique<Team>(threads);
  team_->run(count, task);
}

}  // namespace constraint_sim::engine
