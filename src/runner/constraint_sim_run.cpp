// Runs a scene without ROS: docs/scenes.md is its manual.

#include <unistd.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "engine/method_names.h"
#include "engine/option_values.h"
#include "engine/validate.h"

namespace constraint_sim::engine {
namespace {

constexpr int kBadInput = 2;
constexpr int kPhysicsFailed = 3;
constexpr int kFinishedWithWarnings = 4;
constexpr int kSignalled = 128;  // plus the signal, as shells have it

// ---- scenes

/// The folder of the scenes that come with this program: in its installation, or in its sources.
std::string scene_folder() {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* prefix : {"..", "../.."}) {  // PREFIX/bin, and catkin's PREFIX/lib/PACKAGE
    const fs::path scenes = folder / prefix / "share/constraint_sim/config/scenes";
    if (!error && fs::is_directory(scenes, error)) return fs::weakly_canonical(scenes, error);
  }
  return CONSTRAINT_SIM_SOURCE_SCENES;
}

/// The scene in a file, of a name, or `-`: from standard input.
World load_scene_named(const std::string& scene) {
  if (scene != "-") return load_scene_file(file_of_scene(scene, scene_folder()));
  std::string text(kMostSceneBytes + 1, '\0');
  std::cin.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::cin.gcount()));
  return load_scene(text, "standard input");
}

// ---- arguments

struct Arguments {
  std::string scene;
  double duration = 0.0;                          ///< [s]
  boost::program_options::variables_map options;  ///< of the world, in place of the scene's
  std::string csv, report, save;                  ///< paths; empty: not wanted
  bool explain = false;
};

/// A number, or `.inf` as in scenes.
struct NumberOrInfinity {
  double value = 0.0;
};

std::istream& operator>>(std::istream& in, NumberOrInfinity& number) {
  std::string word;
  in >> word;
  std::istringstream text(word);
  if (word == ".inf")
    number.value = std::numeric_limits<double>::infinity();
  else if (!(text >> number.value) || text.peek() != std::istringstream::traits_type::eof())
    in.setstate(std::ios::failbit);
  return in;
}

/// The type by which an option of the world stands on the command line; void: it does not.
template <class Value, class Range>
struct Argument {
  using Type = Value;
};
template <class Range>
struct Argument<Eigen::Vector3d, Range> {
  using Type = void;
};
template <>
struct Argument<double, PositiveOrInfinity> {
  using Type = NumberOrInfinity;
};
template <>
struct Argument<Method, AnyValue> {
  using Type = std::string;
};

template <class Value>
Value value_of(const Value& argument) {
  return argument;
}
double value_of(const NumberOrInfinity& argument) { return argument.value; }
Method value_of(const std::string& argument) { return method_named(argument); }

/// Calls visit(its name here, OptionInfo, member of `options`, range, null pointer to its type
/// here) for each option of the world that stands on the command line.
template <class Visit>
void visit_arguments(WorldOptions* options, Visit visit) {
  visit_options(*options, [&](const OptionInfo& info, auto& value, auto range) {
    using Type = typename Argument<std::decay_t<decltype(value)>, decltype(range)>::Type;
    if constexpr (!std::is_void_v<Type>) {
      std::string argument = info.name;
      std::replace(argument.begin(), argument.end(), '_', '-');
      visit(argument, info, value, range, static_cast<const Type*>(nullptr));
    }
  });
}

/// Nothing when only help was asked for.
std::optional<Arguments> parse(int argc, char** argv) {
  namespace po = boost::program_options;
  Arguments arguments;
  po::options_description visible("Options");
  auto add = visible.add_options();
  add("help,h", "print this");
  add("duration", po::value(&arguments.duration)->required()->value_name("SECONDS"),
      "simulated time to run, to the nearest tick");
  add("csv", po::value(&arguments.csv)->value_name("FILE"),
      "write the state of each body, at the start and after every step");
  add("report", po::value(&arguments.report)->value_name("FILE"), "write the outcome as JSON");
  add("save", po::value(&arguments.save)->value_name("FILE"), "write the final state as a scene");
  add("explain", po::bool_switch(&arguments.explain),
      "print what the scene uses and what is left out, as YAML");
  po::options_description of_world("Options of the world, in place of the scene's");
  auto add_of_world = of_world.add_options();
  WorldOptions defaults;
  visit_arguments(&defaults, [&](const std::string& argument, const OptionInfo& info,
                                 const auto& value, auto range, const auto* as) {
    using Type = std::decay_t<decltype(*as)>;
    const std::string unit = *info.unit == '\0' ? "" : "[" + std::string(info.unit) + "] ";
    add_of_world(argument.c_str(), po::value<Type>()->value_name("VALUE"),
                 (unit + range_and_meaning(info, value, range)).c_str());
  });
  po::options_description all;
  all.add(visible).add(of_world).add_options()("scene", po::value(&arguments.scene)->required());
  po::positional_options_description positions;
  positions.add("scene", 1);

  po::variables_map values;
  const int style = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
  po::store(
      po::command_line_parser(argc, argv).options(all).positional(positions).style(style).run(),
      values);
  if (values.count("help") > 0) {
    std::cout << "Usage: constraint_sim_run SCENE --duration SECONDS [options]\n\n"
              << "SCENE is a file, `-` for standard input, or one of those that come with this:\n";
    for (const std::string& name : scene_names(scene_folder())) std::cout << "  " << name << '\n';
    std::cout
        << '\n'
        << visible << '\n'
        << of_world
        << "\nExit status: 0, 2 for bad input, 3 when the physics failed, 4 when it finished but\n"
           "an error was not closed or energy rose without a cause, 130 or 143 when\n"
           "interrupted or terminated: the files are written as far as it came.\n";
    return std::nullopt;
  }
  po::notify(values);
  arguments.options = values;
  return arguments;
}

World load(const Arguments& arguments) {
  World world = load_scene_named(arguments.scene);
  WorldOptions options = world.options();
  bool any = false;
  visit_arguments(&options, [&](const std::string& argument, const OptionInfo&, auto& value, auto,
                                const auto* as) {
    if (arguments.options.count(argument) == 0) return;
    value = value_of(arguments.options[argument].as<std::decay_t<decltype(*as)>>());
    any = true;
  });
  if (any) world.set_options(options);
  return world;
}

std::uint64_t steps_in(double duration, double time_step) {
  check_not_negative("duration", duration);
  const double steps = std::round(duration / time_step);
  constexpr double kMost = 9007199254740992.0;  // 2^53: beyond it a double cannot count
  if (!(steps <= kMost)) refuse("duration", "is too many steps, got " + shortest(duration));
  return static_cast<std::uint64_t>(steps);
}

// ---- files

/// Opened before the run, so that a path that cannot be written costs no run. Not open for an empty
/// path.
class OutputFile {
 public:
  explicit OutputFile(const std::string& path) : path_(path) {
    if (path_.empty()) return;
    stream_.open(path_);
    check();
  }

  bool is_wanted() const { return !path_.empty(); }
  std::ostream& stream() { return stream_; }

  void close() {
    if (path_.empty()) return;
    stream_.close();
    check();
  }

 private:
  void check() const {
    if (!stream_) throw std::runtime_error("cannot write '" + path_ + "'");
  }

  std::string path_;
  std::ofstream stream_;
};

void write_csv_header(std::ostream& out) {
  out << "time,body,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n";
}

void write_csv_rows(const World& world, std::ostream& out) {
  const std::string time = shortest(world.time());
  for (const BodyId id : world.body_ids()) {
    const BodyState& state = world.state(id);
    Eigen::Matrix<double, 13, 1> numbers;
    numbers << state.position, state.orientation.coeffs(), state.linear_velocity,
        state.angular_velocity;
    out << time << ',' << world.body(id).name;
    for (Eigen::Index i = 0; i < numbers.size(); ++i) out << ',' << shortest(numbers[i]);
    out << '\n';
  }
}

// ---- the run

using SteadyClock = std::chrono::steady_clock;

double seconds_since(SteadyClock::time_point start) {
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}

/// A bar with the time left, ten times a second, where somebody is looking.
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

/// The signal that asked for the end; 0: none has.
volatile std::sig_atomic_t stop_signal = 0;

/// From now on the first SIGINT or SIGTERM only asks for the end; the second one is it.
void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int signal) { stop_signal = signal; };
  action.sa_flags = SA_RESETHAND;
  for (const int signal : {SIGINT, SIGTERM}) ::sigaction(signal, &action, nullptr);
}

struct Outcome {
  double wall_time = 0.0;                           ///< in World::step alone [s]
  double max_constraint_error = 0.0;                ///< over all steps [m]
  double energy_initial = 0.0, energy_final = 0.0;  ///< [J]
  double energy_drift = 0.0;                        ///< after the last step [1]
  double accumulated_local_error = 0.0;             ///< sum of the steps' estimates [m]
  double correction_work = 0.0, driven_work = 0.0;  ///< sums over all steps [J]
  double solver_residual = 0.0;                     ///< largest of all steps [m/s]
  std::set<std::string> methods;
  std::set<std::string> unresolved_bodies;
  std::map<std::pair<StepWarning::Kind, std::string>, StepWarning>
      warnings;  ///< each once, at its largest
  bool failed = false;
};

void add(const StepWarning& warning, Outcome* outcome) {
  StepWarning& known =
      outcome->warnings.emplace(std::pair(warning.kind, warning.whose), warning).first->second;
  known.amount = std::max(known.amount, warning.amount);
}

Outcome run(std::uint64_t steps, World* world, OutputFile* csv) {
  Outcome outcome;
  outcome.energy_initial = world->energy();
  if (csv->is_wanted()) {
    write_csv_header(csv->stream());
    write_csv_rows(*world, csv->stream());
  }
  ProgressBar progress(steps);
  for (std::uint64_t step = 1; step <= steps && !outcome.failed && stop_signal == 0; ++step) {
    const auto start = SteadyClock::now();
    const StepReport& report = world->step();
    outcome.wall_time += seconds_since(start);
    outcome.max_constraint_error =
        std::max(outcome.max_constraint_error, report.max_constraint_error);
    outcome.energy_drift = report.energy_drift;
    outcome.accumulated_local_error += report.local_error;
    outcome.correction_work += report.correction_work;
    outcome.driven_work += report.driven_work;
    outcome.solver_residual = std::max(outcome.solver_residual, report.solver_residual);
    for (std::size_t i = 0; i < kMethodCount; ++i)
      if (report.islands[i] > 0) outcome.methods.insert(name(static_cast<Method>(i)));
    if (report.unresolved_bodies > 0)
      for (const BodyId id : world->unresolved_bodies())
        outcome.unresolved_bodies.insert(world->body(id).name);
    if (report.unclosed_joints > 0 || report.energy_rise > 0.0)
      for (const StepWarning& now : step_warnings(*world)) add(now, &outcome);
    outcome.failed = report.failed;
    if (csv->is_wanted()) write_csv_rows(*world, csv->stream());
    progress.update(step);
  }
  outcome.energy_final = world->energy();
  return outcome;
}

// ---- what came of it

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
  std::vector<std::string> lines = warnings(world);
  for (const auto& [key, warning] : outcome.warnings) lines.push_back(to_string(warning));
  return lines;
}

/// Name of the body whose motion failed, and null where it was not one body's.
nlohmann::json failed_body(const World& world) {
  const std::optional<BodyId>& body = world.report().failed_body;
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
    if (warning.kind == StepWarning::Kind::kUnclosed) unclosed_joints.push_back(warning.whose);
    if (warning.kind == StepWarning::Kind::kEnergyRise)
      energy_rise = std::max(energy_rise, warning.amount);
  }
  return {
      {"steps", world.step_count()},
      {"sim_time", world.time()},
      {"wall_time", outcome.wall_time},
      {"state_hash", hash_text(world)},
      {"bodies", bodies},
      {"energy_initial", outcome.energy_initial},
      {"energy_final", outcome.energy_final},
      {"max_constraint_error", outcome.max_constraint_error},
      {"accumulated_local_error", outcome.accumulated_local_error},
      {"correction_work", outcome.correction_work},
      {"driven_work", outcome.driven_work},
      {"solver_residual", outcome.solver_residual},
      {"unclosed_joints", unclosed_joints},
      {"energy_rise", energy_rise},
      {"failure", to_string(world.report().failure)},
      {"failed_body", failed_body(world)},
      {"methods", outcome.methods},
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
  std::printf("sum of local errors    %.3g m\n", outcome.accumulated_local_error);
  std::printf("energy drift           %.3g of the largest kinetic energy\n", outcome.energy_drift);
  std::printf("method                 %s\n", methods.empty() ? "none" : methods.c_str());
  if (!outcome.unresolved_bodies.empty())
    std::printf("not resolved           %zu light bodies; the report names them\n",
                outcome.unresolved_bodies.size());
  std::printf("state hash             %s\n", hash_text(world).c_str());
}

/// Returns the exit status. Throws what its input deserves.
int run(const Arguments& arguments) {
  World world = load(arguments);
  const std::uint64_t steps = steps_in(arguments.duration, world.options().time_step);
  if (arguments.explain) std::cout << explain(world) << std::flush;

  for (const std::string& warning : warnings(world))
    std::fprintf(stderr, "constraint_sim_run: warning: %s\n", warning.c_str());

  stop_on_signals();
  OutputFile csv(arguments.csv), report(arguments.report), save(arguments.save);
  const Outcome outcome = run(steps, &world, &csv);

  if (report.is_wanted()) report.stream() << report_of(world, outcome).dump(2) << '\n';
  if (save.is_wanted()) {
    const std::string scene = save_scene(world);
    if (scene.size() > kMostSceneBytes)
      std::fprintf(stderr,
                   "constraint_sim_run: warning: the saved scene has %zu bytes, and no more than "
                   "%zu are loaded again\n",
                   scene.size(), kMostSceneBytes);
    save.stream() << scene;
  }
  for (OutputFile* file : {&csv, &report, &save}) file->close();
  print_summary(world, outcome);
  if (outcome.failed) {
    std::fprintf(stderr, "constraint_sim_run: the physics failed after %g s: %s\n", world.time(),
                 to_string(world.report().failure));
    return kPhysicsFailed;
  }
  for (const auto& [key, warning] : outcome.warnings)
    std::fprintf(stderr, "constraint_sim_run: warning: %s\n", to_string(warning).c_str());
  if (stop_signal == 0) return outcome.warnings.empty() ? 0 : kFinishedWithWarnings;
  std::fprintf(stderr, "constraint_sim_run: stopped after %g s\n", world.time());
  return kSignalled + stop_signal;
}

}  // namespace
}  // namespace constraint_sim::engine

int main(int argc, char** argv) {
  try {
    const auto arguments = constraint_sim::engine::parse(argc, argv);
    return arguments ? constraint_sim::engine::run(*arguments) : 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "constraint_sim_run: %s\n", error.what());
    return constraint_sim::engine::kBadInput;
  }
}
