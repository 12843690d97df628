#pragma once

// Checks that all fuzz targets make on a world.

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <mutex>
#include <string>
#include <thread>

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

/// A stop flag that a second thread sets when an interval is over, as the node's watch does.
class Watchdog {
 public:
  Watchdog() : thread_([this] { watch(); }) {}
  ~Watchdog() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ends_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  engine::StopFlag flag() const { return &flag_; }
  /// Clears the flag, and sets it when the interval is over.
  void start(std::chrono::milliseconds interval) {
    const std::lock_guard<std::mutex> lock(mutex_);
    flag_ = false;
    deadline_ = Clock::now() + interval;
    changed_.notify_all();
  }

 private:
  using Clock = std::chrono::steady_clock;

  void watch() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (!ends_) {
      if (flag_)
        changed_.wait(lock, [this] { return ends_ || !flag_; });
      else if (changed_.wait_until(lock, deadline_) == std::cv_status::timeout &&
               Clock::now() >= deadline_)
        flag_ = true;
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::atomic<bool> flag_{true};
  bool ends_ = false;
  Clock::time_point deadline_ = Clock::now();
  std::thread thread_;
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

/// Steps the world within an interval; a step that fails or is stopped keeps the state.
inline void step(Watchdog* watchdog, engine::World* world) {
  const std::uint64_t before = world->state_hash();
  const double time = world->time();
  watchdog->start(std::chrono::milliseconds(50));
  world->set_stop_flag(watchdog->flag());
  const engine::StepReport report = world->step();
  world->set_stop_flag(nullptr);
  if (report.failed || report.stopped)
    require(world->time() == time, "the time has changed in a step that failed or was stopped");
  else
    require(world->state_hash() != before, "a step has changed nothing");
  check_numbers(*world);
}

/// Checks that the world can be written and read, to the bit.
inline void check_snapshot(const engine::World& world) {
  const std::string bytes = engine::write_snapshot(world);
  const engine::World again = engine::read_snapshot(bytes);
  require(again.state_hash() == world.state_hash(), "a snapshot has another hash");
  require(engine::write_snapshot(again) == bytes,
          "a snapshot is written otherwise once it is read");
}

/// Checks that the world can be saved as a scene and loaded.
inline void check_saved(const engine::World& world) {
  const std::string text = engine::save_scene(world);
  if (text.size() > engine::kMostSceneBytes) return;
  const engine::World again = engine::load_scene(text);
  require(engine::save_scene(again) == text, "a saved scene is saved otherwise once it is loaded");
}

}  // namespace constraint_sim::fuzz
