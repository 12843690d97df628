#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <future>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

using engine::World;

/// Thrown for an edit or query that was given up because the stepper stops.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled: the simulator is shutting down") {}
};

/// Thrown for a request that cannot be served at present.
class NotNow : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Thrown for an edit that was rejected, and changed nothing, because a tick or another edit takes
/// long.
class LongTick : public NotNow {
 public:
  LongTick()
      : NotNow(
            "not now: a tick or an edit is running that takes long; pause_physics, load_scene and "
            "the resets end it") {}
};

struct StepperOptions {
  double real_time_factor = 1.0;  ///< simulated over clock seconds, ≥ 0; 0: as fast as possible
  bool paused = false;
  double max_catch_up =
      0.1;  ///< largest lag behind the clock [clock s]; further ticks are dropped and counted
  /// Keeps a copy of the world before each tick, not only before ticks expected to take long: for
  /// worlds with plugin code, which may take long in any tick.
  bool keeps_world_before_ticks = false;
  /// Simulated time is the time of the clock: it starts with the clock, goes back with it, and
  /// jumps to it after dropped ticks and after a pause. At a real_time_factor other than 1 it runs
  /// faster or slower than the clock from then on.
  bool follows_clock = false;
};

/// Time at which an edit took effect.
struct Boundary {
  double time = 0.0;       ///< simulated [s]
  std::uint64_t step = 0;  ///< steps since the start
};

/// Callbacks to the owner, on the stepping thread, between steps. An exception of a callback makes
/// the stepper fail.
struct StepperEvents {
  std::function<void(const World&, double seconds)> stepped;  ///< run time of the step [s]
  std::function<void(const World&)> edited;                   ///< at least one edit took effect
  /// Called at the end of every pass; returns the run time until the next wanted pass [s].
  std::function<double(const World&)> passed;
  /// Called before a step, to drive bodies and joints.
  std::function<void(World&)> stepping = nullptr;
  /// Moves simulated time to `time` [s], that of the clock; with `follows_clock`. Must not throw:
  /// an invalid time is ignored.
  std::function<void(World&, double time)> time_moved = nullptr;
  /// Called after an interrupt(), as by another scene: drives of bodies and joints have to end.
  std::function<void(const World&, const std::string& by)> interrupted = nullptr;
};

/// Owns a World and advances it on a thread of its own: ticks that are due by the clock, steps
/// requested by step(), and edits from other threads. Edits wait in a queue and take effect
/// together at a boundary, any moment when no step is running. Nothing else accesses the world.
///
/// No caller waits long for a tick or an edit that does not end. Once one has run for kPatience,
/// inspect() looks at the world before it, edit() and post() are rejected, and interrupt() and
/// pause() abandon it: a tick as if it had never begun, an edit by World::is_asked_to_stop().
class Stepper {
 public:
  /// Time [s] from any origin; 0 until the clock starts. A step back of the clock does not count as
  /// passed time.
  using Clock = std::function<double()>;

  /// Run time of a tick [s] after which queries are answered from the copy of the world.
  static constexpr double kPatience = 0.25;
  static constexpr std::size_t kMostWaiting = 7;  ///< number of simultaneous calls of step()
  /// Run time between two moves of simulated time to the clock [s].
  static constexpr double kMovesTimeAgain = 0.25;

  /// Expected duration of an edit. Before one that may be long the world is copied for queries.
  enum class Duration { kShort, kMayBeLong };

  Stepper(World world, const StepperOptions& options, Clock clock, StepperEvents events);
  /// Requires that the stepping thread and all callers have ended; stop() ensures that.
  ~Stepper();
  Stepper(const Stepper&) = delete;
  Stepper& operator=(const Stepper&) = delete;

  // ---- stepping thread
  /// Steps until stop().
  void run();
  /// Does one pass: waiting edits, then due steps, or a part of them. Returns the seconds until the
  /// next pass has work, unless wake() comes before.
  double advance();

  // ---- any thread
  /// Runs `change` at a boundary and returns when it has taken effect. Rethrows an exception of
  /// `change`, which must then have changed nothing. Throws Cancelled, and NotNow during a long
  /// tick.
  Boundary edit(std::function<void(World&)> change, Duration duration = Duration::kShort);
  /// Queues `change` without waiting. `change` must not throw.
  void post(std::function<void(World&)> change);
  /// Runs `change` like edit(), cancels waiting calls of step(), in the name of `by`, and abandons
  /// a long tick. For changes that make waiting steps pointless, such as another scene.
  Boundary interrupt(const std::string& by, std::function<void(World&)> change);
  /// Calls `look` at a boundary; it may run on this thread.
  Boundary inspect(const std::function<void(const World&)>& look);
  /// Pauses, cancels waiting calls of step(), and abandons a long tick.
  Boundary pause();
  /// Ends a pause. Returns during a long tick before it has taken effect.
  void unpause();
  /// Advances a paused world by `steps`. `look` sees the world right after the last step taken,
  /// also where an exception follows, and once more where an interrupting change throws. Edits go
  /// on in between. Throws NotNow unless paused, when kMostWaiting calls wait already, when the
  /// physics fails, or when cancelled.
  Boundary step(std::uint64_t steps, std::function<void(const World&)> look);
  /// Stops the world as failed until the next edit. Stepping thread only.
  void fail(const std::string& why);
  /// Makes run() do a pass at once.
  void wake();
  /// Abandons the present step, ends run(), and throws Cancelled to all waiting callers. Final.
  void stop();
  /// Whether stop() was called.
  bool is_stopping() const;

  bool is_paused() const { return paused_; }
  bool has_failed() const { return failed_; }
  /// Reason of the failure; empty without one.
  std::string failure() const;
  /// Number of edits that took effect. Stepping thread only.
  std::uint64_t edits() const { return edits_; }
  std::uint64_t dropped_ticks() const { return dropped_ticks_; }
  double real_time_factor() const { return options_.real_time_factor; }
  /// Sets StepperOptions::real_time_factor from the next step on. Stepping thread only.
  void set_real_time_factor(double factor);
  /// Switches the timing of stages from the next step on.
  void time_stages(bool on) { time_stages_ = on; }

 private:
  struct Task {
    std::uint64_t ticket;
    std::function<void()> run;
    Duration duration;
    std::promise<Boundary> done;
  };
  struct StepRequest {
    std::uint64_t steps;
    std::uint64_t remaining;
    std::function<void(const World&)> look;
    std::promise<Boundary> done;
    std::exception_ptr thrown;  ///< exception of `look`
  };

  /// Treatment of a task that waits for a long tick or edit.
  enum class Delay { kRefuse, kAbandonTick, kReturn };

  std::future<Boundary> enqueue(std::function<void()> run, Duration duration,
                                std::uint64_t* ticket = nullptr);
  Boundary enqueue_and_wait(std::function<void()> run, Delay delay,
                            Duration duration = Duration::kShort);
  bool waits_for_long_tick(const std::future<Boundary>& done) const;
  bool withdraw(std::uint64_t ticket);
  void abandon_tick(std::uint64_t ticket);
  double patience() const { return was_abandoned_ ? 0.1 * kPatience : kPatience; }
  double time_at_work() const;
  void apply(const std::function<void(World&)>& change);
  bool is_wanted() const;
  void cancel_all();
  void cancel_steps(const std::string& why);
  void end_requests(const std::string& why);
  void show(StepRequest& request) const;
  void run_tasks();
  void tell_of_edits();
  void take_steps();
  void take_requested_steps();
  void take_due_steps();
  void follow_clock(bool begins);
  template <class Due, class Done>
  void step_while(Due is_due, Done done);
  void drop_beyond(double most_owed);
  bool step_once();
  void keep_world_before();
  void run_all(std::deque<Task>* tasks, std::vector<std::exception_ptr>* thrown);
  void end_work(bool was_abandoned);
  double wait() const;
  Boundary now() const { return {world_.time(), world_.step_count()}; }

  // stepping thread only
  World world_;
  StepperOptions options_;
  Clock clock_;
  StepperEvents events_;
  std::deque<StepRequest> step_requests_;
  double last_clock_ = 0.0;
  // Simulated seconds that the world lags behind the clock; negative: the world is ahead.
  double owed_ = 0.0;
  // Clock reading [s] at which clock and simulated time last agreed. Used with follows_clock.
  double followed_since_ = 0.0;
  double moved_time_ = -kMovesTimeAgain;  // run time of the last move of simulated time [s]
  bool edited_ = false;
  std::uint64_t edits_ = 0;
  bool may_be_long_ = true;  // the next tick, judged by the last one or because of an edit

  // World before the present tick or edits, where those may be long.
  mutable std::mutex before_mutex_;
  World before_;
  bool has_before_ = false;

  // shared by all threads
  mutable std::mutex mutex_;
  std::condition_variable wake_up_;
  std::deque<Task> tasks_;
  std::uint64_t last_ticket_ = 0;
  std::string failure_;
  bool woken_ = false;
  bool stopping_ = false;
  std::atomic<bool> paused_;
  std::atomic<bool> failed_{false};
  std::atomic<bool> abandon_{false};        // ends the present tick or edit
  std::atomic<bool> was_abandoned_{false};  // the last tick; repeating it would take as long
  std::atomic<double> work_start_{-1.0};    // start of a tick or of edits [s run time]; < 0: none
  std::atomic<bool> time_stages_{false};
  std::atomic<std::uint64_t> dropped_ticks_{0};
};

}  // namespace constraint_sim
