#include "python/shared_world.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace constraint_sim::python {
namespace {

using SteadyClock = std::chrono::steady_clock;

double seconds(SteadyClock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

/// Returns the name of `id` if it is among `ids`.
template <class Ids, class Id, class NameOf>
std::optional<std::string> name_among(const Ids& ids, const Id& id, NameOf name_of) {
  if (std::find(ids.begin(), ids.end(), id) == ids.end()) return std::nullopt;
  return name_of(id);
}

void add(const engine::StepReport& step, const engine::World& world, RunReport* report) {
  ++report->steps;
  report->max_constraint_error = std::max(report->max_constraint_error, step.joints.max_error);
  report->max_closing_error = std::max(report->max_closing_error, step.joints.closing_error);
  report->max_penetration = std::max(report->max_penetration, step.contacts.max_penetration);
  report->accumulated_local_error += step.local_error;
  report->energy_drift = step.energy.drift;
  report->substeps += step.costs.substeps;
  report->rejected += step.costs.rejected;
  report->iterations += step.costs.iterations;
  report->rows += step.costs.rows;
  report->contacts += step.contacts.points;
  report->torn_joints += step.joints.broken;
  report->changes += step.costs.method_changes;
  report->dependent_rows = std::max(report->dependent_rows, step.joints.dependent_rows);
  report->correction_work += step.energy.correction_work;
  report->driven_work += step.energy.driven_work;
  report->solver_residual = std::max(report->solver_residual, step.contacts.solver_residual);
  for (std::size_t i = 0; i < engine::kMethodCount; ++i)
    if (step.costs.islands[i] > 0)
      report->methods.insert(engine::name(static_cast<engine::Method>(i)));
  report->energy_rise = std::max(report->energy_rise, step.energy.rise);
  report->overlap = std::max(report->overlap, step.contacts.overlap);
  report->creep = std::max(report->creep, step.contacts.creep);
  if (step.unresolved_bodies > 0)
    for (const engine::BodyId id : world.unresolved_bodies())
      report->unresolved_bodies.insert(world.body(id).name);
  if (step.joints.unclosed > 0)
    for (const engine::JointId id : world.unclosed_joints())
      report->unclosed_joints.insert(world.joint(id).name);
}

void add_failure(const NamedReport& step, RunReport* report) {
  report->failed = true;
  report->failure = engine::to_string(step.outcome.failure);
  report->failed_body = step.failed_body_name;
}

/// Returns an array that owns the numbers.
py::array owned(std::vector<double> numbers, std::vector<py::ssize_t> shape) {
  auto* kept = new std::vector<double>(std::move(numbers));
  const py::capsule owner(kept, [](void* data) { delete static_cast<std::vector<double>*>(data); });
  return py::array_t<double>(std::move(shape), kept->data(), owner);
}

}  // namespace

std::uint64_t steps_in(double duration, double time_step) {
  const double steps = std::round(duration / time_step);
  constexpr double kMost = 9007199254740992.0;  // 2^53: beyond it a double cannot count
  if (!(duration >= 0.0) || !(steps <= kMost))
    throw std::invalid_argument(
        "duration: must be a finite number >= 0 of at most 2^53 ticks, got " +
        std::string(py::str(py::float_(duration))));
  return static_cast<std::uint64_t>(steps);
}

NamedReport::NamedReport(const engine::World& world) : engine::StepReport(world.report()) {
  const auto name_of = [&](engine::JointId id) { return world.joint(id).name; };
  const auto name_of_body = [&](engine::BodyId id) { return world.body(id).name; };
  if (joints.worst) worst_joint_name = name_among(world.joint_ids(), *joints.worst, name_of);
  if (joints.worst_closing)
    closing_joint_name = name_among(world.joint_ids(), *joints.worst_closing, name_of);
  if (outcome.failed_body)
    failed_body_name = name_among(world.body_ids(), *outcome.failed_body, name_of_body);
  if (contacts.overlap_body)
    overlap_body_name = name_among(world.body_ids(), *contacts.overlap_body, name_of_body);
  if (contacts.creep_body)
    creep_body_name = name_among(world.body_ids(), *contacts.creep_body, name_of_body);
  if (contacts.unsolved_body)
    unsolved_body_name = name_among(world.body_ids(), *contacts.unsolved_body, name_of_body);
}

class SharedWorld::Stepping {
 public:
  explicit Stepping(SharedWorld* world) : world_(world) {
    world->is_stepping_ = true;
    thread_ = PyEval_SaveThread();
  }
  ~Stepping() {
    PyEval_RestoreThread(thread_);
    world_->is_stepping_ = false;
  }
  Stepping(const Stepping&) = delete;
  Stepping& operator=(const Stepping&) = delete;

 private:
  SharedWorld* world_;
  PyThreadState* thread_ = nullptr;
};

void SharedWorld::check_idle() const {
  if (is_stepping_) throw std::runtime_error("world: another thread is stepping it");
}

const engine::World& SharedWorld::read() const {
  check_idle();
  return world_;
}

void SharedWorld::write_states(const engine::World& world, const std::vector<engine::BodyId>& ids,
                               double* target) {
  for (const engine::BodyId id : ids) {
    const engine::BodyState& state = world.state(id);
    Eigen::Map<Eigen::Matrix<double, kStateSize, 1>> row(target);
    row << state.position, state.orientation.coeffs(), state.linear_velocity,
        state.angular_velocity;
    target += kStateSize;
  }
}

/// Updates the arrays, unless none is held, or another thread is stepping and will update them.
/// Starts a new buffer where bodies were added or removed.
void SharedWorld::update_arrays() {
  if (buffer_ == nullptr || is_stepping_) return;
  if (buffer_.use_count() == 1) {
    buffer_ = nullptr;
    return;
  }
  std::vector<engine::BodyId> ids = world_.body_ids();
  if (ids != ids_) {
    buffer_ = nullptr;
    return;
  }
  write_states(world_, ids_, buffer_->data());
}

py::array SharedWorld::columns(py::ssize_t first, py::ssize_t count) {
  check_idle();
  if (buffer_ == nullptr) {
    ids_ = world_.body_ids();
    buffer_ = std::make_shared<Buffer>(ids_.size() * static_cast<std::size_t>(kStateSize));
    write_states(world_, ids_, buffer_->data());
  }
  const py::capsule owner(new std::shared_ptr<Buffer>(buffer_),
                          [](void* data) { delete static_cast<std::shared_ptr<Buffer>*>(data); });
  constexpr auto kNumber = static_cast<py::ssize_t>(sizeof(double));
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(ids_.size()), count};
  const std::vector<py::ssize_t> strides{kStateSize * kNumber, kNumber};
  py::array view = py::array_t<double>(shape, strides, buffer_->data() + first, owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

NamedReport SharedWorld::step() {
  check_idle();
  {
    const Stepping stepping(this);
    world_.step();
  }
  update_arrays();
  return NamedReport(world_);
}

void SharedWorld::run_released(std::uint64_t steps, std::uint64_t every, double time_limit,
                               RunReport* report, Samples* samples) {
  const auto sample = [&] {
    samples->times.push_back(world_.time());
    const std::size_t size = samples->states.size();
    samples->states.resize(size + ids_.size() * static_cast<std::size_t>(kStateSize));
    write_states(world_, ids_, samples->states.data() + size);
  };
  if (every > 0) sample();
  constexpr auto kSignalInterval = std::chrono::milliseconds(100);
  auto signals_checked = SteadyClock::now();
  while (report->steps < steps && !report->timed_out) {
    const auto start = SteadyClock::now();
    const engine::StepReport& step = world_.step();
    const auto end = SteadyClock::now();
    report->wall_time += seconds(end - start);
    if (step.outcome.failed) {  // the report describes motion that was undone
      add_failure(NamedReport(world_), report);
      return;
    }
    add(step, world_, report);
    if (every > 0 && report->steps % every == 0) sample();
    report->timed_out = report->wall_time > time_limit && report->steps < steps;
    if (end - signals_checked < kSignalInterval) continue;
    signals_checked = end;
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
}

RunReport SharedWorld::run(double duration, std::uint64_t every, double time_limit) {
  check_idle();
  const std::uint64_t steps = steps_in(duration, world_.options().time_step);
  if (!(time_limit > 0.0))
    throw std::invalid_argument("time_limit: must be a number > 0, got " +
                                std::string(py::str(py::float_(time_limit))));
  RunReport report;
  Samples samples;
  if (buffer_ == nullptr) ids_ = world_.body_ids();
  report.energy_initial = world_.energy();
  struct Update {  // runs after Ctrl-C too
    SharedWorld* world;
    ~Update() { world->update_arrays(); }
  } update{this};
  {
    const Stepping stepping(this);
    run_released(steps, every, time_limit, &report, &samples);
  }
  report.energy_final = world_.energy();
  if (every > 0) {
    const auto count = static_cast<py::ssize_t>(samples.times.size());
    report.times = owned(std::move(samples.times), {count});
    report.states = owned(std::move(samples.states),
                          {count, static_cast<py::ssize_t>(ids_.size()), kStateSize});
  }
  return report;
}

}  // namespace constraint_sim::python
