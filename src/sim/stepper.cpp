#include "sim/stepper.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "sim/errors.h"

namespace constraint_sim {
namespace {

constexpr double kSlice = 0.005;     // run time of steps in one pass [s]
constexpr double kMayBeLong = 0.02;  // run time of a tick above which the next may be long [s]
constexpr double kIdlePeriod = 1.0;  // time between passes without work [s]

double run_time() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string why_failed(const World& world) {
  const engine::StepReport& report = world.report();
  std::string why = engine::to_string(report.outcome.failure);
  if (report.outcome.failure == engine::Failure::kCustom) why += ": " + world.failed_why();
  if (report.outcome.failed_body) why += ": '" + world.body(*report.outcome.failed_body).name + "'";
  return why;
}

}  // namespace

Stepper::Stepper(World world, const StepperOptions& options, Clock clock, StepperEvents events)
    : world_(std::move(world)),
      options_(options),
      clock_(std::move(clock)),
      events_(std::move(events)),
      last_clock_(options.follows_clock ? 0.0 : clock_()),
      paused_(options.paused) {}

Stepper::~Stepper() {
  stop();
  cancel_all();
}

void Stepper::run() {
  for (;;) {
    const double seconds = advance();
    std::unique_lock<std::mutex> lock(mutex_);
    wake_up_.wait_for(lock, std::chrono::duration<double>(seconds),
                      [this] { return stopping_ || woken_ || !tasks_.empty(); });
    woken_ = false;
    if (stopping_) break;
  }
  cancel_all();
}

double Stepper::advance() {
  double wanted = kIdlePeriod;
  try {
    run_tasks();
    if (!failed_) take_steps();
    if (events_.passed) wanted = events_.passed(world_);
  } catch (...) {
    fail(message_of_exception());
  }
  if (failed_ && !step_requests_.empty())
    cancel_steps("the physics failed after step " + std::to_string(world_.step_count()) +
                 ", where the world stands now: " + failure());
  return std::clamp(wanted, 0.0, wait());
}

void Stepper::take_steps() {
  if (!step_requests_.empty())
    take_requested_steps();
  else
    take_due_steps();
}

void Stepper::fail(const std::string& why) {
  const std::lock_guard<std::mutex> lock(mutex_);
  failure_ = why;
  failed_ = true;
}

// Sets the factor. Ticks owed at the previous pace are dropped.
void Stepper::set_real_time_factor(double factor) {
  options_.real_time_factor = factor;
  owed_ = 0.0;
  followed_since_ = last_clock_;
}

std::string Stepper::failure() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return failed_ ? failure_ : "";
}

void Stepper::run_tasks() {
  std::deque<Task> tasks;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    tasks.swap(tasks_);
    abandon_ =
        stopping_;  // the threads that wanted the abandoned tick to end are served in this pass
  }
  std::vector<std::exception_ptr> thrown(tasks.size());
  run_all(&tasks, &thrown);
  if (std::exchange(edited_, false)) tell_of_edits();
  // Callers return only now, when all edits have taken effect.
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    if (thrown[i])
      tasks[i].done.set_exception(thrown[i]);
    else
      tasks[i].done.set_value(now());
  }
}

void Stepper::run_all(std::deque<Task>* tasks, std::vector<std::exception_ptr>* thrown) {
  const bool may_be_long = std::any_of(tasks->begin(), tasks->end(), [](const Task& task) {
    return task.duration == Duration::kMayBeLong;
  });
  if (may_be_long) {
    keep_world_before();
    work_start_ = run_time();
  }
  for (std::size_t i = 0; i < tasks->size(); ++i) {
    world_.set_stop_flag(&abandon_);  // an edit may have replaced the world
    try {
      (*tasks)[i].run();
    } catch (...) {
      (*thrown)[i] = std::current_exception();
    }
  }
  if (may_be_long) end_work(false);
}

void Stepper::tell_of_edits() {
  may_be_long_ = true;
  try {
    if (events_.edited) events_.edited(world_);
  } catch (...) {
    fail(message_of_exception());
  }
}

void Stepper::take_requested_steps() {
  StepRequest& request = step_requests_.front();
  step_while([&] { return request.remaining > 0; }, [&] { --request.remaining; });
  if (failed_ || request.remaining > 0) return;
  show(request);
  if (request.thrown)
    request.done.set_exception(request.thrown);
  else
    request.done.set_value(now());
  step_requests_.pop_front();
}

void Stepper::show(StepRequest& request) const {
  try {
    if (request.look) request.look(world_);
  } catch (...) {
    request.thrown = std::current_exception();
  }
}

void Stepper::cancel_steps(const std::string& why) {
  for (StepRequest& request : step_requests_) show(request);
  end_requests(why);
}

void Stepper::end_requests(const std::string& why) {
  for (StepRequest& request : step_requests_)
    request.done.set_exception(std::make_exception_ptr(
        NotNow("step: " + std::to_string(request.steps - request.remaining) + " of " +
               std::to_string(request.steps) + " steps done: " + why)));
  step_requests_.clear();
}

void Stepper::take_due_steps() {
  const double clock = clock_();
  const double passed = last_clock_ == 0.0 ? 0.0 : std::max(clock - last_clock_, 0.0);
  const bool begins =
      options_.follows_clock && clock > 0.0 && (last_clock_ == 0.0 || clock < last_clock_);
  last_clock_ = clock;
  if (begins) {
    owed_ = 0.0;
    followed_since_ = clock;
    follow_clock(true);
  }
  if (paused_) return;

  if (options_.real_time_factor == 0.0) {
    step_while([] { return true; }, [] {});
    return;
  }
  const double tick = world_.options().time_step;
  owed_ += passed * options_.real_time_factor;
  drop_beyond(std::max(options_.max_catch_up * options_.real_time_factor, 2.0 * tick));
  if (options_.follows_clock && last_clock_ > 0.0) follow_clock(false);
  step_while([&] { return owed_ >= tick; }, [&] { owed_ -= tick; });
}

// Moves simulated time to the clock, seldom: every move is an edit, and a machine that always drops
// ticks would move it in each pass. A world slightly ahead, as after step(), waits for the clock.
void Stepper::follow_clock(bool begins) {
  const double factor = options_.real_time_factor, before = world_.time();
  const double due = followed_since_ + (last_clock_ - followed_since_) * factor;
  const double time = due - owed_, now = run_time();
  if (std::abs(time - before) < 0.5 * world_.options().time_step) return;  // rounding
  if (!begins && time < before && before - time < options_.max_catch_up * factor) {
    owed_ = due - before;
    return;
  }
  if (!begins && now < moved_time_ + kMovesTimeAgain) return;
  moved_time_ = now;
  if (events_.time_moved) events_.time_moved(world_, time);
  if (world_.time() == before) return;
  ++edits_;
  tell_of_edits();
}

// Takes at least one step, so that continual edits do not stop the simulation.
template <class Due, class Done>
void Stepper::step_while(Due is_due, Done done) {
  const double end = run_time() + kSlice;
  while (is_due()) {
    if (!step_once()) return;
    done();
    if (failed_ || is_wanted() || run_time() > end) return;
  }
}

void Stepper::drop_beyond(double most_owed) {
  if (owed_ <= most_owed) return;
  const double tick = world_.options().time_step;
  constexpr double kMost = 1e18;  // fits the counter
  const double ticks = std::min(std::ceil((owed_ - most_owed) / tick), kMost);
  owed_ = std::min(owed_ - ticks * tick, most_owed);
  dropped_ticks_ += static_cast<std::uint64_t>(ticks);
}

// Returns whether the step was taken.
bool Stepper::step_once() {
  if (events_.stepping) events_.stepping(world_);
  if (may_be_long_ || options_.keeps_world_before_ticks) keep_world_before();
  world_.set_clock(time_stages_ ? run_time : nullptr);
  world_.set_stop_flag(&abandon_);
  const double start = run_time();
  work_start_ = start;
  try {
    world_.step();
    was_abandoned_ = world_.report().outcome.stopped;
    const double seconds = run_time() - start;
    if (!was_abandoned_) {
      if (world_.report().outcome.failed) fail(why_failed(world_));
      if (events_.stepped) events_.stepped(world_, seconds);  // calls plugins too
    }
  } catch (...) {
    end_work(false);
    throw;
  }
  may_be_long_ = was_abandoned_ || run_time() - start > kMayBeLong;
  end_work(was_abandoned_);
  return !was_abandoned_ && !failed_;
}

void Stepper::end_work(bool was_abandoned) {
  work_start_ = -1.0;
  if (!has_before_) return;
  const std::lock_guard<std::mutex> lock(before_mutex_);
  has_before_ = false;
  if (was_abandoned) world_ = before_;  // undoes the abandoned tick
}

// Copies the world; cheaper than the work after an edit, or than a long tick.
void Stepper::keep_world_before() {
  const std::lock_guard<std::mutex> lock(before_mutex_);
  before_ = world_;
  has_before_ = true;
}

double Stepper::wait() const {
  if (failed_) return kIdlePeriod;
  if (!step_requests_.empty()) return 0.0;
  if (paused_) return kIdlePeriod;
  if (options_.real_time_factor == 0.0) return 0.0;
  const double due = (world_.options().time_step - owed_) / options_.real_time_factor;
  return std::clamp(due, 0.0, kIdlePeriod);
}

// ---- any thread

Boundary Stepper::edit(std::function<void(World&)> change, Duration duration) {
  return enqueue_and_wait([this, &change] { apply(change); }, Delay::kRefuse, duration);
}

void Stepper::post(std::function<void(World&)> change) {
  if (time_at_work() > patience()) throw LongTick();
  enqueue([this, change = std::move(change)] { apply(change); }, Duration::kShort);
}

Boundary Stepper::interrupt(const std::string& by, std::function<void(World&)> change) {
  return enqueue_and_wait(
      [this, &by, &change] {
        for (StepRequest& request : step_requests_)
          show(request);  // the state that they have reached
        apply(change);
        if (events_.interrupted) events_.interrupted(world_, by);
        end_requests("cancelled by " + by);
      },
      Delay::kAbandonTick);
}

void Stepper::apply(const std::function<void(World&)>& change) {
  change(world_);
  ++edits_;
  edited_ = true;
  failed_ = false;
}

Boundary Stepper::inspect(const std::function<void(const World&)>& look) {
  for (;;) {
    try {
      return enqueue_and_wait([this, &look] { look(world_); }, Delay::kRefuse);
    } catch (const LongTick&) {
      const std::lock_guard<std::mutex> lock(before_mutex_);
      if (!has_before_ && time_at_work() > patience()) throw;
      if (!has_before_) continue;  // the tick has just ended
      look(before_);
      return {before_.time(), before_.step_count()};
    }
  }
}

Boundary Stepper::pause() {
  return enqueue_and_wait(
      [this] {
        paused_ = true;
        cancel_steps("cancelled by pause_physics");
      },
      Delay::kAbandonTick);
}

void Stepper::unpause() {
  enqueue_and_wait(
      [this] {
        if (!paused_) return;
        paused_ = false;
        owed_ = 0.0;
        last_clock_ = clock_();
      },
      Delay::kReturn);
}

Boundary Stepper::step(std::uint64_t steps, std::function<void(const World&)> look) {
  std::promise<Boundary> promise;
  std::future<Boundary> done = promise.get_future();
  enqueue_and_wait(
      [&] {
        if (!paused_) throw NotNow("step: only while paused; call pause_physics first");
        if (failed_)
          throw NotNow("step: the physics has failed; edit or reset the world first: " + failure());
        if (step_requests_.size() >= kMostWaiting)
          throw NotNow("step: " + std::to_string(kMostWaiting) +
                       " calls wait already; pause_physics cancels them");
        step_requests_.push_back({steps, steps, std::move(look), std::move(promise), nullptr});
      },
      Delay::kRefuse);
  return done.get();
}

Boundary Stepper::enqueue_and_wait(std::function<void()> run, Delay delay, Duration duration) {
  std::uint64_t ticket = 0;
  std::future<Boundary> done = enqueue(std::move(run), duration, &ticket);
  if (waits_for_long_tick(done)) {
    if (delay == Delay::kReturn) return {};
    if (delay == Delay::kAbandonTick) abandon_tick(ticket);
    if (delay == Delay::kRefuse && withdraw(ticket)) throw LongTick();
  }
  return done.get();
}

// Returns whether the task still waits when a tick or an edit has run for patience().
bool Stepper::waits_for_long_tick(const std::future<Boundary>& done) const {
  for (;;) {
    const double left = patience() - std::max(time_at_work(), 0.0);
    if (done.wait_for(std::chrono::duration<double>(std::max(left, 0.0))) ==
        std::future_status::ready)
      return false;
    if (time_at_work() >= patience()) return true;
  }
}

double Stepper::time_at_work() const {
  const double start = work_start_;
  return start < 0.0 ? 0.0 : run_time() - start;
}

// Withdraws a task; returns false where it is running already.
bool Stepper::withdraw(std::uint64_t ticket) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = std::find_if(tasks_.begin(), tasks_.end(),
                                  [&](const Task& task) { return task.ticket == ticket; });
  if (found == tasks_.end()) return false;
  tasks_.erase(found);
  return true;
}

void Stepper::abandon_tick(std::uint64_t ticket) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (std::any_of(tasks_.begin(), tasks_.end(),
                  [&](const Task& task) { return task.ticket == ticket; }))
    abandon_ = true;
}

std::future<Boundary> Stepper::enqueue(std::function<void()> run, Duration duration,
                                       std::uint64_t* ticket) {
  std::future<Boundary> done;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_) throw Cancelled();
    tasks_.push_back({++last_ticket_, std::move(run), duration, {}});
    if (ticket != nullptr) *ticket = last_ticket_;
    done = tasks_.back().done.get_future();
  }
  wake_up_.notify_one();
  return done;
}

void Stepper::wake() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    woken_ = true;
  }
  wake_up_.notify_one();
}

void Stepper::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    abandon_ = true;
  }
  wake_up_.notify_one();
}

bool Stepper::is_stopping() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stopping_;
}

bool Stepper::is_wanted() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stopping_ || !tasks_.empty();
}

void Stepper::cancel_all() {
  const auto cancelled = std::make_exception_ptr(Cancelled());
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (Task& task : tasks_) task.done.set_exception(cancelled);
    tasks_.clear();
  }
  for (StepRequest& request : step_requests_) {
    show(request);
    request.done.set_exception(cancelled);
  }
  step_requests_.clear();
}

}  // namespace constraint_sim
