// Runs problems in one engine, and prints error and cost of each run. scripts/report calls one such
// program per engine, so that a crash of one does not affect others.
//
//   PROGRAM list | problems | header      variants; problems; head of the lines of `run`
//   PROGRAM references FOLDER [--problem P]    computes references; prints their errors
//   PROGRAM run FOLDER --problem P --variant V [--grid] [--values X ...] [--budget S]
//           [--repeats N] [--perturb SHARE]    announces each setting as `begin VALUE`
//   PROGRAM scene FILE --variant V --values TICK --duration S --sample S [--budget S]
//   PROGRAM save --problem P --variant V       the problem as a scene file
//   PROGRAM refine FOLDER --problem P          a reference by our engine in finer steps
//   PROGRAM judge FOLDER --problem P --variant V    a line for random_grid.py, from the reference
//           in the folder as far as it goes
//   PROGRAM describe --problem P               its group and a line about it
//   PROGRAM ticks --problem P --variant V --values TICK --repeats N    ticks only, for valgrind

#include <malloc.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>

#include "contestant.h"
#include "judge.h"
#include "measures.h"
#include "scene_problem.h"

namespace constraint_sim::report {
namespace {

using SteadyClock = std::chrono::steady_clock;

double seconds_since(SteadyClock::time_point start) {
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}

/// Returns the processor time of this process [s].
double processor_time() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Returns the private memory in use by this process [bytes]; NaN where the system does not report
/// it.
double memory_in_use() {
  malloc_trim(0);  // freed memory would otherwise be reused without being measured
  std::ifstream file("/proc/self/smaps_rollup");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("Anonymous:", 0) == 0) return 1024.0 * std::stod(line.substr(10));
  return std::numeric_limits<double>::quiet_NaN();
}

// ---- references in files, shared by the programs of all engines

std::string path_of(const std::string& folder, const Problem& problem) {
  return (std::filesystem::path(folder) / (problem.name + ".reference")).string();
}

/// numbers of one state in a row
using Numbers = Eigen::Matrix<double, 13, 1>;

void write_reference(const std::string& path, const Trajectory& trajectory) {
  std::ofstream file(path, std::ios::binary);
  for (const States& states : trajectory)
    for (const State& state : states) {
      Numbers numbers;
      numbers << state.position, state.orientation.coeffs(), state.velocity, state.angular_velocity;
      file.write(reinterpret_cast<const char*>(numbers.data()), sizeof(double) * 13);
    }
  if (!file.flush()) throw std::runtime_error("cannot write '" + path + "'");
}

/// Returns the samples in a file, as far as it goes; none where there is no file.
Trajectory read_samples(const std::string& path, std::size_t bodies) {
  std::ifstream file(path, std::ios::binary);
  Trajectory trajectory;
  while (true) {
    States states(bodies);
    for (State& state : states) {
      Numbers numbers;
      file.read(reinterpret_cast<char*>(numbers.data()), sizeof(double) * 13);
      state.position = numbers.head<3>();
      state.orientation.coeffs() = numbers.segment<4>(3);
      state.velocity = numbers.segment<3>(7);
      state.angular_velocity = numbers.tail<3>();
    }
    if (!file) return trajectory;
    trajectory.push_back(std::move(states));
  }
}

Trajectory read_reference(const std::string& folder, const Problem& problem) {
  if (!problem.reference) return {};
  const std::string path = path_of(folder, problem);
  Trajectory trajectory = read_samples(path, problem.bodies.size());
  if (trajectory.size() != static_cast<std::size_t>(problem.samples()) + 1)
    throw std::runtime_error("cannot read '" + path + "'");
  return trajectory;
}

/// Writes references. Each error is the difference to steps half as long.
void make_references(const std::string& folder, const std::string& only) {
  std::filesystem::create_directories(folder);
  for (const Problem& problem : problems()) {
    if (!problem.reference || (!only.empty() && problem.name != only)) continue;
    const Trajectory trajectory = problem.reference(2);
    write_reference(path_of(folder, problem), trajectory);
    const double error = largest_difference(problem, problem.reference(1), trajectory);
    std::printf("%s\t%.3g\n", problem.name.c_str(), error);
    std::fflush(stdout);
  }
}

// ---- runs

struct Result {
  std::string outcome = "ok";
  double run_time = std::numeric_limits<double>::quiet_NaN();  // [s]
  double simulated = 0.0;                                      // [s]
  double memory = std::numeric_limits<double>::quiet_NaN();    // [bytes]
  long ticks = 0;
  Errors errors{};
  double largest_distance = 0.0;  // distance of a body from its start position [m]
  Motion motion;
  Said said;
  std::string why;  // words of an exception
};

/// Runs once: to the end, to a state that is not finite, or until `limit` seconds are spent.
Result run(const Problem& problem, const Problem& reality, const Trajectory& reference,
           const Variant& variant, Setting setting, double limit) {
  Result result;
  Motion motion;
  const auto keep = [&](int sample, const Simulation& simulation) {
    States states;
    simulation.read(&states);
    const bool is_good = is_finite(states);
    motion.sample.push_back(sample);
    motion.states.push_back(std::move(states));
    return is_good;
  };
  // Several ticks per sample, or several samples per tick.
  const double ratio = problem.sample / setting.tick;
  const int stride = ratio >= 1.0 ? 1 : static_cast<int>(std::lround(1.0 / ratio));
  const long ticks = ratio >= 1.0 ? std::lround(ratio) : 1;
  // A printed tick has too few digits to end exactly on the samples.
  const double tick = problem.sample * stride / static_cast<double>(ticks);
  if (std::abs(tick - setting.tick) > 1e-4 * tick)
    throw std::invalid_argument("ticks must divide the " + std::to_string(problem.sample) +
                                " s between samples, or be multiples of them");
  setting.tick = tick;
  try {
    const bool is_weighed = problem.warm_up > 0;
    const auto memory = [&] { return is_weighed ? memory_in_use() : 0.0; };
    double before = memory();
    const std::unique_ptr<Simulation> simulation = Contestant::make(reality, variant, setting);
    if (is_weighed) result.memory = memory() - before;
    keep(0, *simulation);
    result.run_time = 0.0;
    for (int k = stride; k <= problem.samples(); k += stride) {
      const bool counts = k > problem.warm_up;
      if (!counts) before = memory();
      const double processor_start = processor_time();
      const auto start = SteadyClock::now();
      simulation->advance(ticks, k * problem.sample);
      const double wall = seconds_since(start);
      // Wall time includes other processes, processor time the cost of its query; both are upper
      // bounds.
      const double taken = std::min(wall, processor_time() - processor_start);
      if (counts) {
        result.run_time += taken;
        result.ticks += ticks;
        result.simulated = (k - problem.warm_up) * problem.sample;
      } else {
        result.memory += memory() - before;
      }
      if (!keep(k, *simulation)) {
        result.outcome = "not_finite";
        break;
      }
      if (result.run_time > limit && k + stride <= problem.samples()) {
        result.outcome = "too_slow";
        break;
      }
    }
    result.said = simulation->said();
  } catch (const Unsupported& error) {
    result.outcome = "unsupported";
    result.why = error.what();
  } catch (const std::exception& error) {  // peers may throw any type
    result.outcome = "refused";
    result.why = error.what();
    std::fprintf(stderr, "%s %s %g: %s\n", problem.name.c_str(), variant.name.c_str(), setting.tick,
                 error.what());
  }
  if (result.outcome == "not_finite") {
    motion.sample.pop_back();
    motion.states.pop_back();
  }
  if (motion.states.size() < 2) {  // nothing was simulated
    const double none = std::numeric_limits<double>::quiet_NaN();
    result.errors = {none, none, none, none, none, none};
    result.motion = std::move(motion);
    return result;
  }
  result.errors = errors(problem, motion, reference);
  const States& first = motion.states.front();
  for (const States& states : motion.states)
    for (std::size_t i = 0; i < states.size(); ++i)
      result.largest_distance =
          std::max(result.largest_distance, (states[i].position - first[i].position).norm());
  result.motion = std::move(motion);
  return result;
}

// Samples in a tick where a tolerance sets the substeps, so that the tick is the longest of those
// that are swept, 0.2 s.
constexpr int kSamplesATick = 2;
constexpr double kWild = 0.01;  // error over length beyond all graded errors

constexpr char kHeader[] =
    "problem,contestant,knob,value,outcome,run_time,ticks,memory,position,orientation,energy,"
    "momentum,constraint,penetration,distance";

void print(const Problem& problem, const std::string& contestant, const Variant& variant,
           double value, const Result& result) {
  const Errors& e = result.errors;
  std::printf("%s,%s,%s,%.6g,%s,%.4g,%ld,%.4g,%.3g,%.3g,%.3g,%.3g,%.3g,%.3g,%.3g\n",
              problem.name.c_str(), contestant.c_str(),
              variant.knob == Knob::kTick ? "tick" : "tolerance", value, result.outcome.c_str(),
              1e6 * result.run_time / result.simulated, result.ticks, result.memory, e.position,
              e.orientation, e.energy, e.momentum, e.constraint, e.penetration,
              result.largest_distance);
  std::fflush(stdout);
}

struct Arguments {
  std::string command, folder, problem, variant;
  std::vector<double> values;
  bool is_grid = false;
  double duration = 0.0, sample = 0.0;  // run of a scene file [s]
  double budget = 1.0;
  int repeats = 5;
  double perturbation = 0.0;
};

/// Returns the best of the repeats. Long runs are not repeated: the report has several rounds.
Result best_run(const Problem& problem, const Problem& reality, const Trajectory& reference,
                const Variant& variant, const Setting& setting, const Arguments& arguments) {
  constexpr double kLongEnough = 0.02;  // noise of a timer tick or an interrupt is below 1 % [s]
  Result best = run(problem, reality, reference, variant, setting, arguments.budget);
  double spent = best.run_time;
  for (int i = 1; i < arguments.repeats && best.outcome == "ok" && spent < kLongEnough; ++i) {
    const Result again = run(problem, reality, reference, variant, setting, arguments.budget);
    spent += again.run_time;
    best.run_time = std::min(best.run_time, again.run_time);
  }
  return best;
}

Variant variant_named(const std::string& name) {
  for (const Variant& variant : Contestant::variants())
    if (variant.name == name) return variant;
  throw std::invalid_argument("there is no variant '" + name + "'");
}

/// Runs settings from the coarsest on, until one exceeds the budget or is exact to rounding.
void run(const Arguments& arguments) {
  const Problem& problem = problem_named(arguments.problem);
  const Trajectory reference = read_reference(arguments.folder, problem);
  Problem reality = problem;
  reality.gravity *= 1.0 + arguments.perturbation;
  const Variant variant = variant_named(arguments.variant);
  const bool is_tick = variant.knob == Knob::kTick || arguments.is_grid;
  const std::string contestant =
      Contestant::name() + " " + variant.name + (arguments.perturbation != 0.0 ? " perturbed" : "");
  for (const double value : arguments.values) {
    Setting setting;
    setting.is_swept = !arguments.is_grid;
    setting.tick = is_tick ? value : kSamplesATick * problem.sample;
    if (!is_tick) setting.tolerance = value;
    std::printf("begin %.10g\n", value);
    std::fflush(stdout);
    const Result result = best_run(problem, reality, reference, variant, setting, arguments);
    print(problem, contestant, variant, value, result);
    if (arguments.is_grid) continue;
    // An unstable coarse tick can cost more than finer, stable ones.
    const bool is_wild = is_tick && result.errors.position > kWild * problem.length;
    const bool is_slow = result.outcome == "too_slow" || result.run_time > arguments.budget;
    if (result.outcome == "unsupported" || (is_slow && !is_wild)) break;
    const double error = std::max(
        {std::isnan(result.errors.position) ? 1.0 : 0.0, result.errors.position,
         std::isnan(result.errors.orientation) ? 0.0 : problem.length * result.errors.orientation});
    if (error < 1e-11 * problem.length) break;
  }
}

/// Runs a scene file once: prints `outcome`, and `state TIME` with 13 numbers for each body.
void run_scene(const Arguments& arguments) {
  Problem problem;
  try {
    problem = problem_from_scene(arguments.folder, arguments.duration, arguments.sample);
  } catch (const Unsupported& error) {
    std::printf("outcome unsupported 0 nan nan nan %s\n", error.what());
    return;
  }
  Setting setting;
  setting.is_swept = false;
  setting.tick = arguments.values.at(0);
  const Result result =
      run(problem, problem, {}, variant_named(arguments.variant), setting, arguments.budget);
  const Errors& e = result.errors;
  std::printf("outcome %s %.17g %.17g %.17g %.17g\n", result.outcome.c_str(), result.run_time,
              e.constraint, e.energy, e.penetration);
  for (std::size_t k = 0; k < result.motion.states.size(); ++k) {
    std::printf("state %.17g", result.motion.sample[k] * problem.sample);
    for (const State& state : result.motion.states[k]) {
      Numbers numbers;
      numbers << state.position, state.orientation.coeffs(), state.velocity, state.angular_velocity;
      for (Eigen::Index i = 0; i < numbers.size(); ++i) std::printf(" %.17g", numbers[i]);
    }
    std::printf("\n");
  }
}

/// Writes a reference by this engine in finer steps, as far as two such motions agree; prints how
/// far.
void refine(const Arguments& arguments) {
  const Problem& problem = problem_named(arguments.problem);
  const auto motion = [&](const Problem& reality, double ticks_a_sample, double tolerance) {
    Setting setting;
    setting.is_swept = false;
    setting.is_heard = true;
    setting.tick = problem.sample / ticks_a_sample;
    setting.tolerance = tolerance * speed_of(problem);
    const Result result =
        run(problem, reality, {}, variant_named("auto"), setting, arguments.budget);
    return result.said.warning.empty() ? result.motion.states : Trajectory();
  };
  Trajectory exact = motion(problem, 32.0, 1e-12);
  exact.resize(agreement(problem, motion(problem, 16.0, 1e-10), exact));
  std::filesystem::create_directories(arguments.folder);
  write_reference(path_of(arguments.folder, problem), exact);
  const Trajectory near = exact.empty() ? exact : motion(disturbed(problem), 16.0, 1e-10);
  write_reference(path_of(arguments.folder, problem) + ".disturbed", near);
  std::printf("refined %zu of %d\n", exact.size(), problem.samples() + 1);
}

/// Prints `judged OUTCOME CRITERION AMOUNT TIME WORD WORDS`, separated by tabs.
void judge_run(const Arguments& arguments) {
  const Problem& problem = problem_named(arguments.problem);
  Setting setting;
  setting.is_swept = false;
  setting.is_heard = true;
  setting.tick = problem.sample;
  const Result result =
      run(problem, problem, {}, variant_named(arguments.variant), setting, arguments.budget);
  if (result.outcome != "ok" && result.outcome != "not_finite") {
    std::printf("judged\t%s\t\tnan\tnan\tsilent\t%s\n", result.outcome.c_str(), result.why.c_str());
    return;
  }
  const std::string path = path_of(arguments.folder, problem);
  const Reference reference{read_samples(path, problem.bodies.size()),
                            read_samples(path + ".disturbed", problem.bodies.size())};
  const Judgement made =
      judge(problem, result.motion, result.outcome == "ok", result.said, reference);
  std::printf("judged\t%s\t%s\t%.3g\t%.6g\t%s\t%s\n", name(made.grade), name(made.worst),
              made.amount, made.time, name(made.word), made.said.c_str());
}

/// Prints a problem as a scene. Names of bodies are those given by peers/engine.cpp.
void save_scene(const Arguments& arguments) {
  const Problem& problem = problem_named(arguments.problem);
  Setting setting;
  setting.is_swept = false;
  setting.tick = problem.sample;
  const std::string scene =
      Contestant::make(problem, variant_named(arguments.variant), setting)->scene();
  if (scene.empty()) throw std::invalid_argument(Contestant::name() + " writes no scenes");
  std::printf("# duration %.17g sample %.17g tick_scale %.17g measured", problem.duration,
              problem.sample, problem.tick_scale);
  for (const int body : problem.measured) std::printf(" body_%d", body);
  std::printf("\n%s", scene.c_str());
}

/// Takes ticks; valgrind counts the instructions of this function.
[[gnu::noinline]] void counted_ticks(Simulation* simulation, int ticks, double time) {
  simulation->advance(ticks, time);
}

void take_ticks(const Arguments& arguments) {
  const Problem& problem = problem_named(arguments.problem);
  Setting setting;
  setting.is_swept = false;
  setting.tick = arguments.values.at(0);
  const std::unique_ptr<Simulation> simulation =
      Contestant::make(problem, variant_named(arguments.variant), setting);
  constexpr int kWarmUp = 2;  // ticks of one-time setup and of growing memory
  simulation->advance(kWarmUp, kWarmUp * setting.tick);
  counted_ticks(simulation.get(), arguments.repeats, (kWarmUp + arguments.repeats) * setting.tick);
}

void list_problems() {
  for (const Problem& problem : problems())
    std::printf("%s\t%s\t%d\t%g\t%g\t%g\t%d\t%d\t%d\t%s\n", problem.name.c_str(),
                problem.group.c_str(), problem.is_graded, problem.duration, problem.length,
                problem.tick_scale, problem.is_invalid, problem.has_conflict,
                static_cast<int>(static_cast<bool>(problem.reference)), problem.source.c_str());
}

void list_variants() {
  for (const Variant& variant : Contestant::variants()) {
    std::printf("%s\t%s\t%s\t%s\t%s\t", variant.name.c_str(),
                variant.has_joint_coordinates ? "joint" : "cartesian",
                variant.knob == Knob::kTick ? "tick" : "tolerance", Contestant::name().c_str(),
                Contestant::version().c_str());
    for (const double value : variant.values) std::printf("%.3g ", value);
    std::printf("\n");
  }
}

Arguments parse(int argc, char** argv) {
  namespace po = boost::program_options;
  Arguments arguments;
  po::options_description options;
  auto add = options.add_options();
  add("command", po::value(&arguments.command)->required());
  add("folder", po::value(&arguments.folder), "or a scene file");
  add("problem", po::value(&arguments.problem));
  add("variant", po::value(&arguments.variant));
  add("values", po::value(&arguments.values)->multitoken(), "of the variant's knob");
  add("grid", po::bool_switch(&arguments.is_grid), "the values are ticks, whatever the knob");
  add("duration", po::value(&arguments.duration), "of a scene [s]");
  add("sample", po::value(&arguments.sample), "of a scene: states are printed so often [s]");
  add("budget", po::value(&arguments.budget), "longest run [s]");
  add("repeats", po::value(&arguments.repeats), "of short runs; or ticks");
  add("perturb", po::value(&arguments.perturbation), "gravity is wrong by this share");
  po::positional_options_description positions;
  positions.add("command", 1).add("folder", 1);
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv).options(options).positional(positions).run(),
            values);
  po::notify(values);
  return arguments;
}

}  // namespace
}  // namespace constraint_sim::report

int main(int argc, char** argv) {
  using namespace constraint_sim::report;
  try {
    const Arguments arguments = parse(argc, argv);
    if (arguments.command == "list") {
      list_variants();
    } else if (arguments.command == "problems") {
      list_problems();
    } else if (arguments.command == "references") {
      make_references(arguments.folder, arguments.problem);
    } else if (arguments.command == "header") {
      std::printf("%s\n", kHeader);
    } else if (arguments.command == "run") {
      run(arguments);
    } else if (arguments.command == "scene") {
      run_scene(arguments);
    } else if (arguments.command == "save") {
      save_scene(arguments);
    } else if (arguments.command == "refine") {
      refine(arguments);
    } else if (arguments.command == "judge") {
      judge_run(arguments);
    } else if (arguments.command == "describe") {
      const Problem& problem = problem_named(arguments.problem);
      std::printf("%s\t%s\n", problem.group.c_str(), description(problem).c_str());
    } else if (arguments.command == "ticks") {
      take_ticks(arguments);
    } else {
      throw std::invalid_argument("there is no command '" + arguments.command + "'");
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
