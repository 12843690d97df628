#include "ros/poll_pause.h"

#include <ros/init.h>
#include <ros/poll_manager.h>
#include <ros/poll_set.h>

#include <chrono>

namespace constraint_sim {
namespace {

using std::chrono::milliseconds;

// Time after which a response is written without the pause: the poll thread may be ending.
constexpr milliseconds kMostWait{100}, kSlice{10};

thread_local PollPause::Answer* answer_of_thread = nullptr;

/// Whether the connection stays open for further calls.
bool is_persistent(const ros::M_string& connection) {
  const auto found = connection.find("persistent");
  return found != connection.end() && (found->second == "1" || found->second == "true");
}

}  // namespace

std::shared_ptr<PollPause> PollPause::shared() {
  static std::mutex mutex;
  static std::weak_ptr<PollPause> kept;
  const std::lock_guard<std::mutex> lock(mutex);
  std::shared_ptr<PollPause> pause = kept.lock();
  if (!pause) kept = pause = std::shared_ptr<PollPause>(new PollPause);
  return pause;
}

PollPause::PollPause()
    : listener_(ros::PollManager::instance()->addPollThreadListener([this] { between_rounds(); })) {
}

PollPause::~PollPause() { ros::PollManager::instance()->removePollThreadListener(listener_); }

void PollPause::begin() {
  std::unique_lock<std::mutex> lock(mutex_);
  ++holders_;
  ros::PollManager::instance()->getPollSet().signal();
  for (milliseconds waited{0}; !is_held_ && waited < kMostWait && ros::ok(); waited += kSlice)
    changed_.wait_for(lock, kSlice, [this] { return is_held_; });
}

void PollPause::end() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (--holders_ == 0) changed_.notify_all();
}

void PollPause::between_rounds() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (holders_ == 0) return;
  is_held_ = true;
  changed_.notify_all();
  changed_.wait(lock, [this] { return holders_ == 0; });
  is_held_ = false;
}

PollPause::Answer::Answer(PollPause* pause) : pause_(pause) { answer_of_thread = this; }

PollPause::Answer::~Answer() {
  answer_of_thread = nullptr;
  if (holds_) pause_->end();
}

void PollPause::Answer::hold(const ros::M_string& connection) {
  Answer* const answer = answer_of_thread;
  if (answer == nullptr || answer->holds_ || is_persistent(connection)) return;
  answer->pause_->begin();
  answer->holds_ = true;
}

}  // namespace constraint_sim
