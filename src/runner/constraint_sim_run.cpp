// Runs a scene without ROS. The manual is docs/runner.md.

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "constraint_sim/engine/verify.h"
#include "engine/model/validate.h"
#include "engine/support/file_replacement.h"
#include "runner/arguments.h"
#include "runner/constraints.h"
#include "runner/verification.h"

namespace constraint_sim::engine {
namespace {

constexpr int kBadInput = 2;
constexpr int kPhysicsFailed = 3;
constexpr int kFinishedWithWarnings = 4;
constexpr int kSignalled = 128;  // plus the signal's number, as in shells

std::uint64_t steps_in(double duration, double time_step) {
  check_not_negative("duration", duration);
  const double steps = std::round(duration / time_step);
  constexpr double kMost = 9007199254740992.0;  // 2^53: a double cannot count beyond
  if (!(steps <= kMost)) refuse("duration", "is too many steps, got " + shortest(duration));
  return static_cast<std::uint64_t>(steps);
}

// ---- files

/// An output file, opened before the run so that an unwritable path costs no run, and replaced as a
/// whole at the end. Devices and pipes are written directly. Not open for an empty path.
class OutputFile {
 public:
  explicit OutputFile(const std::string& path) : path_(path) {
    if (path_.empty()) return;
    if (is_replaced(path_))
      replacement_.emplace(path_);
    else
      device_.open(path_);
    check();
  }

  bool is_wanted() const { return !path_.empty(); }
  void write(const std::string& text) {
    constexpr std::size_t kPiece = std::size_t{1} << 16;
    waiting_ += text;
    if (waiting_.size() >= kPiece) flush();
  }
  void close() {
    if (path_.empty()) return;
    flush();
    if (replacement_) replacement_->commit();
    if (!replacement_) device_.close();
    check();
  }

  /// Returns whether the path is a regular file, or will be one.
  static bool is_replaced(const std::string& path) {
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    // Paths such as /dev/stdout are written to where they lead.
    return path.rfind("/dev/", 0) != 0 && path.rfind("/proc/", 0) != 0 &&
           (!std::filesystem::exists(status) || std::filesystem::is_regular_file(status) ||
            std::filesystem::is_directory(status));
  }

 private:
  void flush() {
    if (replacement_)
      replacement_->write(waiting_);
    else
      device_ << waiting_ << std::flush;
    waiting_.clear();
    check();
  }
  void check() const {
    if (!device_) throw std::runtime_error("cannot write '" + path_ + "'");
  }

  std::string path_, waiting_;
  std::optional<FileReplacement> replacement_;
  std::ofstream device_;
};

/// Throws std::invalid_argument where two outputs are one file, or an output is a file that is
/// read.
void check_outputs(const Arguments& arguments) {
  namespace fs = std::filesystem;
  std::vector<std::pair<std::string, std::string>> earlier = files_read(arguments);
  for (const auto& [name, path] :
       {std::pair("csv", arguments.csv), std::pair("constraint-csv", arguments.constraint_csv),
        std::pair("report", arguments.report), std::pair("save", arguments.save),
        std::pair("snapshot", arguments.snapshot)}) {
    if (path.empty() || !OutputFile::is_replaced(path)) continue;
    for (const auto& [owner, taken] : earlier) {
      if (taken.empty()) continue;
      std::error_code none, error;
      const fs::path first = fs::weakly_canonical(fs::absolute(taken), none);
      const fs::path second = fs::weakly_canonical(fs::absolute(path), none);
      if (first == second || fs::equivalent(first, second, error))
        refuse(name, "is the file of " + owner + ", " + engine::in_quotes(path));
    }
    earlier.emplace_back("--" + std::string(name), path);
  }
}

std::string csv_header() { return "time,body,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n"; }

std::string csv_rows(const World& world) {
  std::string rows;
  const std::string time = shortest(world.time());
  for (const BodyId id : world.body_ids()) {
    const BodyState& state = world.state(id);
    Eigen::Matrix<double, 13, 1> numbers;
    numbers << state.position, state.orientation.coeffs(), state.linear_velocity,
        state.angular_velocity;
    rows.append(time).append(1, ',').append(world.body(id).name);
    for (Eigen::Index i = 0; i < numbers.size(); ++i)
      rows.append(1, ',').append(shortest(numbers[i]));
    rows += '\n';
  }
  return rows;
}

// ---- the run

using SteadyClock = std::chrono::steady_clock;

double seconds_since(SteadyClock::time_point start) {
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}

/// A progress bar with the remaining time, updated ten times a second, if standard error is a
/// terminal.
class ProgressBar {
 public:
  explicit ProgressBar(std::uint64_t steps) : steps_(steps), shown_(isatty(STDERR_FILENO) == 1) {}
  ~ProgressBar() {
    if (last_update_ > 0.0) std::fprintf(stderr, "\r\033[K");
  }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void update(std::uint64_t step) {
    if (!shown_) return;
    const double elapsed = seconds_since(start_);
    if (elapsed < last_update_ + 0.1) return;
    last_update_ = elapsed;
    const double share = static_cast<double>(step) / static_cast<double>(steps_);
    const auto filled = static_cast<std::size_t>(kWidth * share);
    std::fprintf(stderr, "\r[%s%s] %3.0f %%  %.0f s left\033[K", std::string(filled, '#').c_str(),
                 std::string(kWidth - filled, ' ').c_str(), 100.0 * share,
                 elapsed * (1.0 - share) / share);
  }

 private:
  static constexpr std::size_t kWidth = 40;

  std::uint64_t steps_;
  bool shown_;
  SteadyClock::time_point start_ = SteadyClock::now();
  double last_update_ = 0.0;
};

/// Signal that requested the end; 0: none.
volatile std::sig_atomic_t stop_signal = 0;
/// Request to end, for a long step.
std::atomic<bool> stop_flag{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets the flag");

/// Time after the first signal in which a further one is the same request [ns]: `timeout` signals
/// the process, and then its group.
constexpr std::int64_t kSameRequest = 200'000'000;

std::int64_t signal_time() {  // [ns]; a signal handler may call clock_gettime
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{1'000'000'000} * now.tv_sec + now.tv_nsec;
}

/// Makes the first SIGINT or SIGTERM a request to end; a later one kills the process.
void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int signal) {
    static std::int64_t requested = 0;
    if (stop_signal == 0) {
      requested = signal_time();
      stop_signal = signal;
      stop_flag = true;
    } else if (signal_time() - requested > kSameRequest) {
      ::signal(signal, SIG_DFL);
      ::raise(signal);
    }
  };
  // Neither signal interrupts the handler of the other one.
  for (const int signal : {SIGINT, SIGTERM}) sigaddset(&action.sa_mask, signal);
  for (const int signal : {SIGINT, SIGTERM}) ::sigaction(signal, &action, nullptr);
}

struct Outcome {
  double wall_time = 0.0;             ///< spent in World::step [s]
  double max_constraint_error = 0.0;  ///< over all steps [m]
  double max_closing_error = 0.0;     ///< largest StepReport::Joints::closing_error [m]
  double energy_initial = 0.0, energy_final = 0.0;  ///< [J]
  double energy_drift = 0.0;                        ///< after the last step, dimensionless
  double accumulated_local_error =
      0.0;  ///< sum of the steps' estimates [m]; NaN where a step had none
  double correction_work = 0.0, driven_work = 0.0;  ///< sums over all steps [J]
  double solver_residual = 0.0;                     ///< largest of all steps [m/s]
  std::uint64_t events = 0, substeps = 0;           ///< sums over all steps
  std::uint64_t handed_over = 0,
                taken_back = 0;  ///< number of islands switched from events to impulses, and back
  std::set<std::string> methods;
  std::set<std::string> unresolved_bodies;
  std::map<std::pair<StepWarning::Kind, std::string>, StepWarning>
      warnings;  ///< each kind and name once, with its largest value
  std::map<StepWarning::Kind, StepWarning> notices;  ///< each kind once, at its largest value
  bool failed = false;
};

void add(const StepWarning& warning, Outcome* outcome) {
  StepWarning& known =
      info(warning.kind).is_notice
          ? outcome->notices.emplace(warning.kind, warning).first->second
          : outcome->warnings.emplace(std::pair(warning.kind, warning.name), warning).first->second;
  if (warning.value > known.value) known = warning;
}

Outcome run(std::uint64_t steps, World* world, OutputFile* csv, OutputFile* constraint_csv) {
  Outcome outcome;
  outcome.energy_initial = world->energy();
  if (csv->is_wanted()) {
    csv->write(csv_header());
    csv->write(csv_rows(*world));
  }
  if (constraint_csv->is_wanted()) {
    constraint_csv->write(constraint_csv_header());
    constraint_csv->write(constraint_csv_rows(*world));
  }
  ProgressBar progress(steps);
  for (std::uint64_t step = 1; step <= steps && !outcome.failed && stop_signal == 0; ++step) {
    const auto start = SteadyClock::now();
    const StepReport& report = world->step();
    outcome.wall_time += seconds_since(start);
    outcome.max_constraint_error = std::max(outcome.max_constraint_error, report.joints.max_error);
    outcome.max_closing_error = std::max(outcome.max_closing_error, report.joints.closing_error);
    outcome.energy_drift = report.energy.drift;
    outcome.accumulated_local_error += report.local_error;
    outcome.correction_work += report.energy.correction_work;
    outcome.driven_work += report.energy.driven_work;
    outcome.solver_residual = std::max(outcome.solver_residual, report.contacts.solver_residual);
    outcome.events += report.costs.events;
    outcome.substeps += report.costs.substeps;
    outcome.handed_over += report.contacts.handed_over;
    for (const engine::Event& event : world->events())
      outcome.taken_back += event.kind == engine::EventKind::kTakenBack;
    for (std::size_t i = 0; i < kMethodCount; ++i)
      if (report.costs.islands[i] > 0) outcome.methods.insert(name(static_cast<Method>(i)));
    if (report.unresolved_bodies > 0)
      for (const BodyId id : world->unresolved_bodies())
        outcome.unresolved_bodies.insert(world->body(id).name);
    for (const StepWarning& now : world->warnings()) add(now, &outcome);
    outcome.failed = report.outcome.failed;
    if (csv->is_wanted()) csv->write(csv_rows(*world));
    if (constraint_csv->is_wanted()) constraint_csv->write(constraint_csv_rows(*world));
    progress.update(step);
  }
  outcome.energy_final = world->energy();
  return outcome;
}

VerifyReport verify(std::uint64_t steps, const World& start) {
  ProgressBar progress(steps);
  VerifyOptions options;
  options.ticks = steps;
  options.stop = &stop_flag;
  options.progress = [&](std::uint64_t done) { progress.update(done); };
  return engine::verify(start, options);
}

// ---- results

std::string hash_text(const World& world) {
  char text[19];
  std::snprintf(text, sizeof text, "0x%016llx",
                static_cast<unsigned long long>(world.state_hash()));
  return text;
}

template <class Vector>
std::vector<double> list(const Vector& vector) {
  return std::vector<double>(vector.data(), vector.data() + vector.size());
}

std::vector<std::string> warnings_of(const World& world, const Outcome& outcome) {
  std::vector<std::string> lines = doubtful_settings(world);
  for (const auto& [key, warning] : outcome.warnings) lines.push_back(with_advice(warning));
  return lines;
}

/// Returns the body whose motion failed; null where the failure is not of a single body.
nlohmann::json failed_body(const World& world) {
  const std::optional<BodyId>& body = world.report().outcome.failed_body;
  return body ? nlohmann::json(world.body(*body).name) : nlohmann::json();
}

nlohmann::json report_of(const World& world, const Outcome& outcome) {
  nlohmann::json bodies = nlohmann::json::object();
  for (const BodyId id : world.body_ids()) {
    const BodyState& state = world.state(id);
    bodies[world.body(id).name] = {
        {"position", list(state.position)},
        {"orientation", list(state.orientation.coeffs())},
        {"linear_velocity", list(state.linear_velocity)},
        {"angular_velocity", list(state.angular_velocity)},
    };
  }
  std::vector<std::string> unclosed_joints;
  double energy_rise = 0.0;
  for (const auto& [key, warning] : outcome.warnings) {
    if (warning.kind == StepWarning::Kind::kUnclosed) unclosed_joints.push_back(warning.name);
    if (warning.kind == StepWarning::Kind::kEnergyRise)
      energy_rise = std::max(energy_rise, warning.value);
  }
  return {
      {"steps", world.step_count()},
      {"sim_time", world.time()},
      {"wall_time", outcome.wall_time},
      {"state_hash", hash_text(world)},
      {"bodies", bodies},
      {"constraints", constraints_of(world)},
      {"energy_initial", outcome.energy_initial},
      {"energy_final", outcome.energy_final},
      {"max_constraint_error", outcome.max_constraint_error},
      {"max_closing_error", outcome.max_closing_error},
      {"accumulated_local_error", outcome.accumulated_local_error},
      {"correction_work", outcome.correction_work},
      {"driven_work", outcome.driven_work},
      {"solver_residual", outcome.solver_residual},
      {"unclosed_joints", unclosed_joints},
      {"energy_rise", energy_rise},
      {"failure", to_string(world.report().outcome.failure)},
      {"failed_body", failed_body(world)},
      {"methods", outcome.methods},
      {"events", outcome.events},
      {"substeps", outcome.substeps},
      {"handed_over", outcome.handed_over},
      {"taken_back", outcome.taken_back},
      {"unresolved_bodies", outcome.unresolved_bodies},
      {"left_out", engine::left_out(world)},
      {"warnings", warnings_of(world, outcome)},
  };
}

void print_summary(const World& world, const Outcome& outcome) {
  std::string methods;
  for (const std::string& method : outcome.methods)
    methods += (methods.empty() ? "" : ", ") + method;
  const auto steps = static_cast<unsigned long long>(world.step_count());
  std::printf("steps                  %llu\n", steps);
  std::printf("simulated time         %g s\n", world.time());
  std::printf("wall time              %.3g s\n", outcome.wall_time);
  std::printf("worst constraint error %.3g m\n", outcome.max_constraint_error);
  if (outcome.max_closing_error > 0.0)
    std::printf("largest error closing  %.3g m\n", outcome.max_closing_error);
  if (std::isnan(outcome.accumulated_local_error))
    std::printf("sum of local errors    none: a step has no estimate\n");
  else
    std::printf("sum of local errors    %.3g m\n", outcome.accumulated_local_error);
  std::printf("energy drift           %.3g of the largest kinetic energy\n", outcome.energy_drift);
  std::printf("method                 %s\n", methods.empty() ? "none" : methods.c_str());
  if (outcome.handed_over > 0)
    std::printf("handed over            %llu times from events to impulses, %llu times back\n",
                static_cast<unsigned long long>(outcome.handed_over),
                static_cast<unsigned long long>(outcome.taken_back));
  if (!outcome.unresolved_bodies.empty())
    std::printf("not resolved           %zu bodies; the report names them\n",
                outcome.unresolved_bodies.size());
  for (const auto& [kind, notice] : outcome.notices)
    std::printf("note                   %s\n", with_advice(notice).c_str());
  std::printf("state hash             %s\n", hash_text(world).c_str());
}

/// Returns the exit status. Throws for invalid input.
int run(const Arguments& arguments) {
  check_outputs(arguments);
  World world = load(arguments);
  const std::uint64_t steps = steps_in(arguments.duration, world.options().time_step);
  if (arguments.explain) std::cout << explain(world) << std::flush;

  for (const std::string& warning : doubtful_settings(world))
    std::fprintf(stderr, "constraint_sim_run: warning: %s\n", warning.c_str());

  stop_on_signals();
  OutputFile csv(arguments.csv), report(arguments.report), save(arguments.save);
  OutputFile constraint_csv(arguments.constraint_csv), snapshot(arguments.snapshot);
  std::optional<World> start;  // verified after the run
  if (arguments.verify) start = world;
  const Outcome outcome = run(steps, &world, &csv, &constraint_csv);
  std::optional<VerifyReport> verified;
  if (arguments.verify && stop_signal == 0) verified = verify(steps, *start);

  if (report.is_wanted()) {
    nlohmann::json json = report_of(world, outcome);
    if (verified) json["verify"] = json_of(*verified);
    report.write(json.dump(2) + '\n');
  }
  if (save.is_wanted()) {
    const std::string scene = save_scene(world);
    if (scene.size() > kMostSceneBytes)
      std::fprintf(stderr,
                   "constraint_sim_run: warning: the saved scene has %zu bytes, and no more than "
                   "%zu are loaded again\n",
                   scene.size(), kMostSceneBytes);
    save.write(scene);
  }
  if (snapshot.is_wanted()) snapshot.write(write_snapshot(world));
  for (OutputFile* file : {&csv, &constraint_csv, &report, &save, &snapshot}) file->close();
  print_summary(world, outcome);
  if (verified) std::printf("\n%s", to_table(*verified).c_str());
  if (outcome.failed) {
    std::fprintf(stderr, "constraint_sim_run: the physics failed after %g s: %s\n", world.time(),
                 to_string(world.report().outcome.failure));
    return kPhysicsFailed;
  }
  for (const auto& [key, warning] : outcome.warnings)
    std::fprintf(stderr, "constraint_sim_run: warning: %s\n", with_advice(warning).c_str());
  const bool exceeds = verified && verified->exceeds();
  if (exceeds)
    std::fprintf(stderr,
                 "constraint_sim_run: warning: --verify found differences that the error estimates "
                 "do not explain\n");
  if (stop_signal == 0) return outcome.warnings.empty() && !exceeds ? 0 : kFinishedWithWarnings;
  std::fprintf(stderr, "constraint_sim_run: stopped after %g s\n", world.time());
  return kSignalled + stop_signal;
}

// Throws where printed text may be lost, as on a full disk.
void check_standard_output() {
  std::cout.flush();
  if (!std::cout || std::fflush(stdout) != 0 || std::ferror(stdout) != 0)
    throw std::runtime_error("cannot write to standard output");
}

}  // namespace
}  // namespace constraint_sim::engine

int main(int argc, char** argv) {
  try {
    const auto arguments = constraint_sim::engine::parse(argc, argv);
    const int status = arguments ? constraint_sim::engine::run(*arguments) : 0;
    constraint_sim::engine::check_standard_output();
    return status;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "constraint_sim_run: %s\n", error.what());
    return constraint_sim::engine::kBadInput;
  }
}
