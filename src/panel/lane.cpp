#include "panel/lane.h"

#include <algorithm>
#include <utility>

namespace constraint_sim::panel {

Lane::Lane() : thread_([this] { run(); }) {}

Lane::~Lane() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  cancellation_.cancel();
  wake_up_.notify_all();
  thread_.join();
}

void Lane::post(const std::string& what, Call call, const std::string& key) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto first = tasks_.begin() + (has_begun_ ? 1 : 0);
  const auto same = key.empty() ? tasks_.end()
                                : std::find_if(first, tasks_.end(),
                                               [&](const Task& task) { return task.key == key; });
  if (same != tasks_.end())
    *same = {what, key, std::move(call)};
  else
    tasks_.push_back({what, key, std::move(call)});
  wake_up_.notify_all();
}

std::optional<Lane::Waiting> Lane::waiting() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!has_begun_) return std::nullopt;
  const std::chrono::duration<double> since = std::chrono::steady_clock::now() - begin_;
  return Waiting{tasks_.front().what, since.count()};
}

void Lane::run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    wake_up_.wait(lock, [this] { return stopping_ || !tasks_.empty(); });
    if (stopping_) return;
    has_begun_ = true;
    begin_ = std::chrono::steady_clock::now();
    const Call call = tasks_.front().call;
    lock.unlock();
    call(cancellation_);
    lock.lock();
    has_begun_ = false;
    tasks_.pop_front();
  }
}

}  // namespace constraint_sim::panel
