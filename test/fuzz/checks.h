#pragma once

// Checks that all fuzz targets make on a world.

#include <signal.h>
#include <sys/time.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <optional>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "constraint_sim/engine/world.h"

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

/// A stop flag that a signal sets once the process has used an interval of processor time. A thread
/// as the node's watch would cost two changes of threads each step. All watchdogs share one flag.
class Watchdog {
 public:
  Watchdog() {
    struct sigaction action {};
    action.sa_handler = [](int) { flag_ = true; };
    action.sa_flags = SA_RESTART;
    sigaction(SIGPROF, &action, nullptr);
  }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  engine::StopFlag flag() const { return &flag_; }
  /// Clears the flag, which is set when the interval is over.
  void start(std::chrono::milliseconds interval) {
    itimerval timer{};
    timer.it_value.tv_usec = 1000 * interval.count();
    setitimer(ITIMER_PROF, &timer, nullptr);
    flag_ = false;
  }

 private:
  static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets the flag");
  static inline std::atomic<bool> flag_{false};
};

/// The hash of a world, computed again only after changes: it takes a third of an execution.
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
  if (report.failed || report.stopped) return;
  for (const engine::BodyId id : world.body_ids()) {
    const engine::BodyState& state = world.state(id);
    require(state.position.allFinite() && state.orientation.coeffs().allFinite() &&
                state.linear_velocity.allFinite() && state.angular_velocity.allFinite(),
            "a state is not finite and the step has not failed");
  }
  for (const engine::JointId id : world.joint_ids()) {
    const engine::JointState& state = world.joint_state(id);
    require(std::isfinite(state.error) && std::isfinite(state.force) &&
                std::isfinite(state.angle_error) && state.impulse.allFinite(),
            "the state of a joint is not finite and the step has not failed");
  }
  for (const engine::Contact& contact : world.contacts())
    require(contact.position.allFinite() && contact.force.allFinite(),
            "a contact is not finite and the step has not failed");
  require(std::isfinite(report.energy) && std::isfinite(report.energy_drift) &&
              std::isfinite(report.energy_rise) && std::isfinite(report.max_constraint_error) &&
              std::isfinite(report.max_penetration) && !std::isinf(report.local_error) &&
              std::isfinite(report.correction_work) && std::isfinite(report.driven_work) &&
              std::isfinite(report.projected_energy) && std::isfinite(report.solver_residual),
          "a number of the report is not finite and the step has not failed");
  require(std::isfinite(world.energy()), "the energy is not finite and the step has not failed");
}

/// Steps the world within an interval; a step that fails or is stopped keeps the state. The
/// interval is short for most states, since steps without end would take nearly all of the time.
inline void step(Watchdog* watchdog, engine::World* world, KnownHash* hash) {
  const std::uint64_t before = hash->of(*world);
  const double time = world->time();
  watchdog->start(std::chrono::milliseconds(before % 16 == 0 ? 50 : 5));
  world->set_stop_flag(watchdog->flag());
  const engine::StepReport report = world->step();
  world->set_stop_flag(nullptr);
  hash->forget();
  if (report.failed || report.stopped)
    require(world->time() == time, "the time has changed in a step that failed or was stopped");
  else
    require(hash->of(*world) != before, "a step has changed nothing");
  check_numbers(*world);
}

/// Checks that the world can be written and read, to the bit.
inline void check_snapshot(const engine::World& world, KnownHash* hash) {
  const std::string bytes = engine::write_snapshot(world);
  const engine::World again = engine::read_snapshot(bytes);
  require(again.state_hash() == hash->of(world), "a snapshot has another hash");
  require(engine::write_snapshot(again) == bytes,
          "a snapshot is written otherwise once it is read");
}

/// Checks that the world can be saved as a scene and loaded: one world of eight, chosen by its
/// hash, since writing and reading YAML takes half of the time of an execution.
inline void check_saved(const engine::World& world, KnownHash* hash) {
  if (hash->of(world) % 8 != 0) return;
  const std::string text = engine::save_scene(world);
  if (text.size() > engine::kMostSceneBytes) return;
  const engine::World again = engine::load_scene(text);
  require(engine::save_scene(again) == text, "a saved scene is saved otherwise once it is loaded");
}

}  // namespace constraint_sim::fuzz
