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

/// An edit or query that was given up because the stepper stops.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled: the simulator is shutting down") {}
};

/// What the stepper was asked for that it cannot do now.
class NotNow : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An edit that was refused, and changed nothing, because a tick or another edit takes long.
class LongTick : public NotNow {
 public:
  LongTick()
      : NotNow(
            "not now: a tick or an edit is running that takes long; pause_physics, load_scene and "
            "the resets end it") {}
};

struct StepperOptions {
  double real_time_factor = 1.0;  ///< simulated per clock seconds, ≥ 0; 0: as fast as it can
  bool paused = false;
  double max_catch_up = 0.1;  ///< [clock s] that it may lag; ticks beyond are dropped and counted
  /// The world before each tick is kept, and not only before those that are expected to take long:
  /// for worlds with code of others in them, which may take long in any tick.
  bool keeps_world_before_ticks = false;
  /// Simulated time is that of the clock: it begins with the clock, goes back with it, and is moved
  /// on to it where ticks were dropped, as after a jump, and after a pause. At another
  /// real_time_factor than 1 it passes faster or slower than the clock from then on.
  bool follows_clock = false;
};

/// When an edit took effect.
struct Boundary {
  double time = 0.0;       ///< simulated [s]
  std::uint64_t step = 0;  ///< steps since the start
};

/// What the stepper reports to its owner, on the stepping thread, between steps. What these throw
/// makes the stepper fail.
struct StepperEvents {
  std::function<void(const World&, double seconds)> stepped;  ///< run time of the step [s]
  std::function<void(const World&)> edited;                   ///< at least one edit took effect
  /// At the end of every pass; answers after how many seconds [run time] it wants the next one.
  std::function<double(const World&)> passed;
  /// Before a step: drives what moves.
  std::function<void(World&)> stepping = nullptr;
  /// Moves simulated time to this one, which is the clock's [s]; with `follows_clock`. Must not
  /// throw: a time that cannot be is not set.
  std::function<void(World&, double time)> time_moved = nullptr;
  /// An interrupt() took effect, as another scene: what drives bodies and joints has to end.
  std::function<void(const World&, const std::string& by)> interrupted = nullptr;
};

/// Owns a World and advances it, on a thread of its own: what is due by the clock, what
/// is asked for by step(), and the edits that come from other threads. Edits wait in a queue and
/// take effect together at a boundary, any moment when no step is running. Nothing else touches the
/// world.
///
/// No caller waits long for a tick or an edit that does not end. Once one has run for kPatience,
/// inspect() looks at the world before it, edit() and post() are refused, and interrupt() and
/// pause() abandon it: a tick as if it had never begun, an edit by World::is_asked_to_stop().
class Stepper {
 public:
  /// [s] from any origin; 0 until it begins. What it goes back by does not count as passed.
  using Clock = std::function<double()>;

  static constexpr double kPatience = 0.25;       ///< [s] of run time
  static constexpr std::size_t kMostWaiting = 7;  ///< calls of step() at the same time
  /// [s] of run time between moves of simulated time on to the clock
  static constexpr double kMovesTimeAgain = 0.25;

  /// How long an edit is expected to take. Before one that may be long the world is kept for those
  /// who ask meanwhile.
  enum class Duration { kShort, kMayBeLong };

  Stepper(World world, const StepperOptions& options, Clock clock, StepperEvents events);
  /// The stepping thread, and all who wait, must have ended: stop() sees to that.
  ~Stepper();
  Stepper(const Stepper&) = delete;
  Stepper& operator=(const Stepper&) = delete;

  // ---- the stepping thread
  /// Steps until stop().
  void run();
  /// One pass: the edits that wait, then the steps that are due; with much to do, a share of it.
  /// Returns the seconds after which the next pass has work, unless wake() comes before.
  double advance();

  // ---- any thread
  /// Runs `change` at a boundary and returns when it has taken effect. What it throws is thrown
  /// here, and then it must have changed nothing. Throws Cancelled, and NotNow during a long tick.
  Boundary edit(std::function<void(World&)> change, Duration duration = Duration::kShort);
  /// The same without waiting for it. `change` must not throw.
  void post(std::function<void(World&)> change);
  /// The same as edit() for what makes the steps that others wait for pointless, as another scene:
  /// cancels them, in the name of `by`, and abandons a long tick.
  Boundary interrupt(const std::string& by, std::function<void(World&)> change);
  /// The same as edit() for looking only; `look` may run on this thread.
  Boundary inspect(const std::function<void(const World&)>& look);
  /// Also cancels the steps that others wait for, and abandons a long tick.
  Boundary pause();
  /// Returns during a long tick before it has taken effect.
  void unpause();
  /// Carries a paused world on by `steps`; `look` sees it right after the last one that was taken,
  /// also where an exception follows, and once more where a change that would have cancelled it
  /// throws. Edits go on in between. Throws NotNow unless paused, when
  /// kMostWaiting wait already, when the physics fails on the way, or when it is cancelled.
  Boundary step(std::uint64_t steps, std::function<void(const World&)> look);
  /// The world stands, failed, until it is edited. Of the stepping thread.
  void fail(const std::string& why);
  /// Makes run() do a pass at once.
  void wake();
  /// Abandons the step that is running, ends run(), and throws Cancelled to all who wait. For good.
  void stop();

  bool is_paused() const { return paused_; }
  bool has_failed() const { return failed_; }
  /// MethodReason it has, in words; empty where it has not.
  std::string failure() const;
  /// Changes that took effect; of the stepping thread.
  std::uint64_t edits() const { return edits_; }
  std::uint64_t dropped_ticks() const { return dropped_ticks_; }
  double real_time_factor() const { return options_.real_time_factor; }
  /// From the next step on; as StepperOptions says. Of the stepping thread.
  void set_real_time_factor(double factor);
  /// Whether to time the stages of each step, from the next one on.
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
    std::exception_ptr thrown;  ///< by look
  };

  /// What becomes of a task that a long tick or edit keeps waiting.
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

  // of the stepping thread
  World world_;
  StepperOptions options_;
  Clock clock_;
  StepperEvents events_;
  std::deque<StepRequest> step_requests_;
  double last_clock_ = 0.0;
  // simulated seconds that the clock has passed and the world has not; below 0: the world is ahead
  double owed_ = 0.0;
  // with follows_clock: reading of the clock [s] at which simulated time was the same
  double followed_since_ = 0.0;
  double moved_time_ = -kMovesTimeAgain;  // when simulated time was moved last [s run time]
  bool edited_ = false;
  std::uint64_t edits_ = 0;
  bool may_be_long_ = true;  // the next tick, by the last one or because of an edit

  // the world before the tick or the edits that run, where these may be long
  mutable std::mutex before_mutex_;
  World before_;
  bool has_before_ = false;

  // shared
  mutable std::mutex mutex_;
  std::condition_variable wake_up_;
  std::deque<Task> tasks_;
  std::uint64_t last_ticket_ = 0;
  std::string failure_;
  bool woken_ = false;
  bool stopping_ = false;
  std::atomic<bool> paused_;
  std::atomic<bool> failed_{false};
  std::atomic<bool> abandon_{false};        // the tick or the edit that runs
  std::atomic<bool> was_abandoned_{false};  // the last tick; the same again will take as long
  std::atomic<double> work_start_{-1.0};    // of a tick or of edits [s run time]; below 0: none
  std::atomic<bool> time_stages_{false};
  std::atomic<std::uint64_t> dropped_ticks_{0};
};

}  // namespace constraint_sim
