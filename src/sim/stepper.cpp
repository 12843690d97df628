#include "sim/stepper.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

namespace constraint_sim {
namespace {

constexpr double kSlice = 0.005;     // [s] of run time that one pass may step for
constexpr double kIdlePeriod = 1.0;  // [s] that a pass with nothing to do may be away

double run_time() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

Stepper::Stepper(World world, const StepperOptions& options, Clock clock, StepperEvents events)
    : world_(std::move(world)),
      options_(options),
      clock_(std::move(clock)),
      events_(std::move(events)),
      last_clock_(clock_()),
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
  run_tasks();
  if (!failed_) {
    if (!step_requests_.empty())
      take_requested_steps();
    else
      take_due_steps();
  }
  const double wanted = events_.passed ? events_.passed(world_) : kIdlePeriod;
  return std::clamp(wanted, 0.0, wait());
}

void Stepper::run_tasks() {
  std::deque<Task> tasks;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    tasks.swap(tasks_);
  }
  std::vector<std::exception_ptr> thrown(tasks.size());
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    try {
      tasks[i].run();
    } catch (...) {
      thrown[i] = std::current_exception();
    }
  }
  if (std::exchange(edited_, false) && events_.edited) events_.edited(world_);
  // only now, when all have taken effect
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    if (thrown[i])
      tasks[i].done.set_exception(thrown[i]);
    else
      tasks[i].done.set_value(now());
  }
}

void Stepper::take_requested_steps() {
  StepRequest& request = step_requests_.front();
  step_while([&] { return request.remaining > 0; }, [&] { --request.remaining; });
  if (failed_) {
    const std::string text = "the physics failed after step " +
                             std::to_string(world_.step_count()) + ", where the world stands now";
    for (StepRequest& waiting : step_requests_)
      waiting.done.set_exception(std::make_exception_ptr(NotNow(text)));
    step_requests_.clear();
  } else if (request.remaining == 0) {
    if (request.look) request.look(world_);
    request.done.set_value(now());
    step_requests_.pop_front();
  }
}

void Stepper::take_due_steps() {
  const double clock = clock_();
  const double passed = last_clock_ == 0.0 ? 0.0 : std::max(clock - last_clock_, 0.0);
  last_clock_ = clock;
  if (paused_) return;

  if (options_.real_time_factor == 0.0) {
    step_while([] { return true; }, [] {});
    return;
  }
  const double tick = world_.options().time_step;
  owed_ += passed * options_.real_time_factor;
  drop_beyond(std::max(options_.max_catch_up * options_.real_time_factor, 2.0 * tick));
  step_while([&] { return owed_ >= tick; }, [&] { owed_ -= tick; });
}

// at least one step, or edits that never cease would stop time
template <class Due, class Done>
void Stepper::step_while(Due is_due, Done done) {
  const double end = run_time() + kSlice;
  while (is_due()) {
    step_once();
    done();
    if (failed_ || is_wanted() || run_time() > end) return;
  }
}

void Stepper::drop_beyond(double most_owed) {
  if (owed_ <= most_owed) return;
  const double tick = world_.options().time_step;
  const double ticks = std::ceil((owed_ - most_owed) / tick);
  owed_ -= ticks * tick;
  dropped_ticks_ += static_cast<std::uint64_t>(ticks);
}

void Stepper::step_once() {
  world_.set_clock(time_stages_ ? run_time : nullptr);
  const double start = run_time();
  failed_ = world_.step().failed;
  if (events_.stepped) events_.stepped(world_, run_time() - start);
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

Boundary Stepper::edit(std::function<void(World&)> change) {
  return enqueue([this, &change] { apply(change); }).get();
}

void Stepper::post(std::function<void(World&)> change) {
  enqueue([this, change = std::move(change)] { apply(change); });
}

void Stepper::apply(const std::function<void(World&)>& change) {
  change(world_);
  edited_ = true;
  failed_ = false;
}

Boundary Stepper::inspect(std::function<void(const World&)> look) {
  return enqueue([this, &look] { look(world_); }).get();
}

Boundary Stepper::pause() {
  return enqueue([this] { paused_ = true; }).get();
}

Boundary Stepper::unpause() {
  return enqueue([this] {
           if (!paused_) return;
           paused_ = false;
           owed_ = 0.0;
           last_clock_ = clock_();
         })
      .get();
}

Boundary Stepper::step(std::uint64_t steps, std::function<void(const World&)> look) {
  std::promise<Boundary> promise;
  std::future<Boundary> done = promise.get_future();
  enqueue([&] {
    if (!paused_) throw NotNow("step: only while paused; call pause_physics first");
    if (failed_) throw NotNow("step: the physics has failed; edit or reset the world first");
    step_requests_.push_back({steps, std::move(look), std::move(promise)});
  }).get();
  return done.get();
}

std::future<Boundary> Stepper::enqueue(std::function<void()> run) {
  std::future<Boundary> done;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_) throw Cancelled();
    tasks_.push_back({std::move(run), {}});
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
  }
  wake_up_.notify_one();
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
  for (StepRequest& request : step_requests_) request.done.set_exception(cancelled);
  step_requests_.clear();
}

}  // namespace constraint_sim
