#pragma once

// Checks that all fuzz targets make on a world.

#include <pthread.h>
#include <signal.h>
#include <time.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "constraint_sim/engine/world.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::fuzz {

/// Aborts with this sentence unless the condition holds; the fuzzer keeps the input.
inline void require(bool holds, const std::string& sentence) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: %s\n", sentence.c_str());
  std::abort();
}

/// Checks that an execution takes less than 5 s of processor time, which under sanitizers stands
/// for a response within a second. Wall time would depend on other processes.
class TimeLimit {
 public:
  TimeLimit() = default;
  ~TimeLimit() {
    require(static_cast<double>(std::clock() - start_) < 5.0 * CLOCKS_PER_SEC,
            "an execution has taken 5 s of the processor");
  }
  TimeLimit(const TimeLimit&) = delete;
  TimeLimit& operator=(const TimeLimit&) = delete;

 private:
  std::clock_t start_ = std::clock();
};

/// A stop flag that a signal sets once this thread has used an interval of processor time. A thread
/// as the node's watch would cost two changes of threads each step. Timers of processor time are
/// checked every few milliseconds only, so a timer of wall time looks at the clock of the thread.
/// All watchdogs share one flag.
class Watchdog {
 public:
  Watchdog() {
    struct sigaction action {};
    action.sa_handler = [](int) { look(); };
    action.sa_flags = SA_RESTART;
    sigaction(SIGPROF, &action, nullptr);
    sigevent event{};
    event.sigev_notify = SIGEV_SIGNAL;
    event.sigev_signo = SIGPROF;
    timer_create(CLOCK_MONOTONIC, &event, &timer_);
  }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  engine::StopFlag flag() const { return &flag_; }
  /// Clears the flag, which is set when the interval is over.
  void start(std::chrono::microseconds interval) {
    flag_ = false;
    pthread_getcpuclockid(pthread_self(), &clock_);
    end_ = used() + 1000 * interval.count();
    look();
  }

 private:
  /// Returns the processor time of the thread that started the interval [ns]. Another thread may
  /// receive the signal.
  static std::int64_t used() {
    timespec time{};
    clock_gettime(clock_, &time);
    return 1'000'000'000 * std::int64_t{time.tv_sec} + time.tv_nsec;
  }
  /// Sets the flag at the end of the interval, or the timer for the rest of it.
  static void look() {
    const std::int64_t rest = end_ - used();
    if (rest <= 0) {
      flag_ = true;
      return;
    }
    itimerspec timer{};
    timer.it_value.tv_nsec = rest;
    timer_settime(timer_, 0, &timer, nullptr);
  }

  static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets the flag");
  static_assert(std::atomic<std::int64_t>::is_always_lock_free, "a signal handler reads the end");
  static inline std::atomic<bool> flag_{false};
  static inline std::atomic<std::int64_t> end_{0};
  static inline clockid_t clock_{};
  static inline timer_t timer_{};
};

/// Whether all inputs are checked in every way. Otherwise expensive checks are made of a share of
/// the inputs only, so that more inputs are run.
inline bool checks_all = false;

/// Makes every check where inputs are files of the command line, as findings are.
inline void initialize(int argc, char** argv) {
  for (int i = 1; i < argc; ++i)
    if (argv[i][0] != '-' && !std::filesystem::is_directory(argv[i])) checks_all = true;
}

/// Returns a number of the bytes of an input, which chooses the expensive checks made of it
/// (64-bit FNV-1a).
inline std::uint64_t digest(const std::uint8_t* data, std::size_t size) {
  std::uint64_t digest = 0xcbf29ce484222325ULL;
  for (std::size_t i = 0; i < size; ++i) digest = (digest ^ data[i]) * 0x100000001b3ULL;
  return digest ^ (digest >> 32);
}

/// Returns whether an input of this digest belongs to the share: one of `count`.
inline bool is_one_of(std::uint64_t count, std::uint64_t digest) {
  return checks_all || digest % count == 0;
}

/// The hash of a world, computed again only after changes: it copies and compiles an edited world.
class KnownHash {
 public:
  std::uint64_t of(const engine::World& world) {
    if (!value_) value_ = world.state_hash();
    return *value_;
  }
  void forget() { value_.reset(); }

 private:
  std::optional<std::uint64_t> value_;
};

/// Returns whether a world is small enough for thousands of steps a second.
inline bool is_small(const engine::World& world) {
  return world.body_ids().size() <= 40 && world.joint_ids().size() <= 40 &&
         world.options().threads <= 2;
}

/// Checks that the numbers of the last step are finite, unless the step failed.
inline void check_numbers(const engine::World& world) {
  const engine::StepReport& report = world.report();
  if (report.outcome.failed || report.outcome.stopped) return;
  for (const engine::BodyId id : world.body_ids()) {
    const engine::BodyState& state = world.state(id);
    require(state.position.allFinite() && state.orientation.coeffs().allFinite() &&
                state.linear_velocity.allFinite() && state.angular_velocity.allFinite(),
            "a state is not finite and the step has not failed");
  }
  for (const engine::JointId id : world.joint_ids()) {
    const engine::JointState& state = world.joint_state(id);
    // the function of a custom joint that does not act may fail
    const bool may_lack_error = world.joint(id).kind == engine::JointKind::kCustom;
    const bool lacks_error = state.error == std::numeric_limits<double>::infinity();
    require((std::isfinite(state.error) || (may_lack_error && lacks_error)) &&
                std::isfinite(state.force) && std::isfinite(state.angle_error) &&
                engine::joint_data(world, id).impulse.allFinite(),
            "the state of a joint is not finite and the step has not failed");
  }
  for (const engine::Contact& contact : world.contacts())
    require(contact.position.allFinite() && contact.force.allFinite(),
            "a contact is not finite and the step has not failed");
  require(std::isfinite(report.energy.total) && std::isfinite(report.energy.drift) &&
              std::isfinite(report.energy.rise) && std::isfinite(report.joints.max_error) &&
              std::isfinite(report.contacts.max_penetration) && !std::isinf(report.local_error) &&
              std::isfinite(report.energy.correction_work) &&
              std::isfinite(report.energy.driven_work) && std::isfinite(report.energy.projected) &&
              std::isfinite(report.contacts.solver_residual),
          "a number of the report is not finite and the step has not failed");
  require(std::isfinite(world.energy()), "the energy is not finite and the step has not failed");
}

/// Steps the world within an interval; a step that fails or is stopped keeps the state.
inline void step(Watchdog* watchdog, std::chrono::microseconds interval, engine::World* world,
                 KnownHash* hash) {
  const double time = world->time();
  const std::uint64_t count = world->step_count();
  watchdog->start(interval);
  world->set_stop_flag(watchdog->flag());
  const engine::StepReport report = world->step();
  world->set_stop_flag(nullptr);
  hash->forget();
  if (report.outcome.failed || report.outcome.stopped)
    require(world->time() == time && world->step_count() == count,
            "the time has changed in a step that failed or was stopped");
  else
    require(world->step_count() == count + 1, "a step is not counted");
  check_numbers(*world);
}

/// Returns the time for a step of an input: short for most inputs, since steps without end would
/// take nearly all of the time, and a quarter of it after a step that was stopped.
inline std::chrono::microseconds step_interval(std::uint64_t digest, int stopped_steps = 0) {
  const std::chrono::microseconds interval(digest % 64 == 0 ? 20'000 : 1000);
  return stopped_steps == 0 ? interval : interval / 4;
}

/// Checks that the world can be written and read, to the bit.
inline void check_snapshot(const engine::World& world, KnownHash* hash) {
  const std::string bytes = engine::write_snapshot(world);
  const engine::World again = engine::read_snapshot(bytes);
  require(again.state_hash() == hash->of(world), "a snapshot has another hash");
  require(engine::write_snapshot(again) == bytes,
          "a snapshot is written otherwise once it is read");
}

/// Checks that the world can be saved as a scene and loaded. Writing and reading YAML takes longer
/// than most executions, so it is done for a share of the inputs.
inline void check_saved(const engine::World& world) {
  const std::string text = engine::save_scene(world);
  if (text.size() > engine::kMostSceneBytes) return;
  const engine::World again = engine::load_scene(text);
  require(engine::save_scene(again) == text, "a saved scene is saved otherwise once it is loaded");
}

}  // namespace constraint_sim::fuzz
