// Verifies random scenes of the other judges, with random wrenches and edits, against themselves
// with half the time step, another method and a perturbed start (constraint_sim/engine/verify.h),
// and compares verify() with the reports of the run. A scene depends on its number alone. Exit
// status 1 where more than 0.1 % of scenes have an unreported difference, or more than 1 % a
// warning without a difference or chaos.
//
//   PROGRAM [--scenes 5000] [--seed 1] [--duration 0.5] [--threads 2] [--least 1e-6] [--margin 100]

#include <atomic>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <thread>

#include "constraint_sim/engine/verify.h"
#include "random_events.h"
#include "random_mechanisms.h"

namespace {

namespace po = boost::program_options;
using namespace constraint_sim::engine;

constexpr std::uint64_t kKinds = 2 + random_events::kKindNames.size();

struct Options {
  std::uint64_t scenes = 0, seed = 0;
  unsigned threads = 0;
  double duration = 0.0, least = 0.0, margin = 0.0;
};

std::string kind_of(std::uint64_t number) {
  const std::uint64_t kind = number % kKinds;
  if (kind < 2) return kind == 0 ? "rods and springs" : "joints of all kinds";
  return random_events::kKindNames[kind - 2];
}

World world_of(std::uint64_t number) {
  const std::uint64_t kind = number % kKinds, seed = number / kKinds;
  if (kind == 0) return random_scenes::make_world(random_scenes::Generator(seed).make());
  if (kind == 1) return random_scenes::make_world(random_scenes::MechanismGenerator(seed).make());
  return random_events::world_of(random_events::scene_of(static_cast<random_events::Kind>(kind - 2),
                                                         static_cast<unsigned>(seed)));
}

std::vector<BodyId> dynamic_bodies(const World& world) {
  std::vector<BodyId> ids;
  for (const BodyId id : world.body_ids())
    if (world.body(id).type == BodyType::kDynamic) ids.push_back(id);
  return ids;
}

/// Adds a wrench on one body in half of the scenes.
void add_random_wrench(random_scenes::Random& draw, double duration, World* world) {
  const std::vector<BodyId> bodies = dynamic_bodies(*world);
  if (bodies.empty() || !draw.chance(0.5)) return;
  Wrench wrench;
  wrench.body = bodies[draw.below(bodies.size())];
  wrench.force = world->body(wrench.body).mass * draw.vector(20.0);
  wrench.start = world->time() + draw.uniform(0.0, 0.7) * duration;
  wrench.end = wrench.start + draw.uniform(0.05, 0.5) * duration;
  world->add_wrench(wrench);
}

/// An edit at the beginning of a tick.
struct RandomEdit {
  enum class Kind { kNone, kDisable, kMotor, kMass, kVelocity } kind = Kind::kNone;
  double time = 0.0;  // simulated time [s]
  std::uint64_t which = 0;
  double amount = 0.0;

  RandomEdit(random_scenes::Random& draw, std::uint64_t ticks, double time_step) {
    if (draw.chance(0.5)) return;
    kind = static_cast<Kind>(1 + draw.below(4));
    time = static_cast<double>(draw.below(ticks)) * time_step;
    which = draw.below(1000);
    amount = draw.uniform(-1.0, 1.0);
  }

  void apply(World& world) const {
    if (kind == Kind::kNone || std::abs(world.time() - time) > 1e-9) return;
    try {
      change(world);
    } catch (const std::invalid_argument&) {
      // joints that reject the edit stay as they are, in all runs
    }
  }

 private:
  void change(World& world) const {
    const std::vector<BodyId> bodies = dynamic_bodies(world);
    const std::vector<JointId>& joints = world.joint_ids();
    if (kind == Kind::kDisable && !joints.empty())
      world.set_enabled(joints[which % joints.size()], false);
    if (kind == Kind::kMotor && !joints.empty()) {
      const JointId id = joints[which % joints.size()];
      if (info(world.joint(id).kind).coordinates == 0) return;
      Motor motor;
      motor.bias = amount;
      motor.max_force = which % 2 == 0 ? 5.0 : 0.0;
      world.set_motor(id, 0, motor);
    }
    if (bodies.empty()) return;
    const BodyId id = bodies[which % bodies.size()];
    if (kind == Kind::kMass) {
      Body body = world.body(id);
      body.mass *= 1.5 + amount;
      world.set_body(id, body);
    }
    if (kind == Kind::kVelocity) {
      BodyState state = world.state(id);
      state.linear_velocity.x() += amount;
      world.set_state(id, state);
    }
  }
};

struct Verdict {
  bool exceeds = false, is_silent = false, is_warned = false, is_false_alarm = false;
  bool is_chaotic = false, has_other = false, has_broken = false;
  std::string line;
};

const VerifiedBody* worst_of(const VerifyReport& report, bool with_estimate) {
  const VerifiedBody* worst = nullptr;
  const auto ratio = [](const VerifiedBody& body) {
    const VerifiedFigures& figures = *body.exceeded;
    const double most = std::max(std::isnan(figures.half_step) ? 0.0 : figures.half_step,
                                 std::isnan(figures.other_method) ? 0.0 : figures.other_method);
    return most;
  };
  for (const VerifiedBody& body : report.bodies) {
    if (!body.exceeded || (with_estimate && std::isnan(body.exceeded->estimate))) continue;
    if (worst == nullptr || ratio(body) > ratio(*worst)) worst = &body;
  }
  return worst;
}

Verdict judge(std::uint64_t number, const Options& options) {
  World world = world_of(number);
  random_scenes::Random draw(number + 7000000);
  add_random_wrench(draw, options.duration, &world);
  VerifyOptions verified;
  const double h = world.options().time_step;
  verified.ticks = static_cast<std::uint64_t>(std::max(1.0, std::round(options.duration / h)));
  verified.least = options.least;
  verified.margin = options.margin;
  const RandomEdit edit(draw, verified.ticks, h);
  Verdict verdict;
  verified.before_tick = [&](World& now) {
    for (const JointId id : now.joint_ids()) verdict.has_broken |= now.joint_state(id).broken;
    edit.apply(now);
  };
  const VerifyReport report = verify(world, verified);

  verdict.exceeds = report.exceeds();
  const bool failed = !report.failure.empty();
  verdict.is_warned = failed || !report.warnings.empty();
  for (const VerifiedBody& body : report.bodies) {
    verdict.is_chaotic |= body.chaotic_from.has_value();
    verdict.has_other |= body.no_other_method.empty();
    verdict.is_warned |= body.is_unresolved;
  }
  const VerifiedBody* const unexplained = worst_of(report, true);
  verdict.is_silent = unexplained != nullptr && !verdict.is_warned;
  verdict.is_false_alarm =
      !report.warnings.empty() && !failed && !verdict.exceeds && !verdict.is_chaotic;
  if (!verdict.is_silent && !verdict.is_false_alarm) return verdict;
  char text[400];
  if (verdict.is_silent) {
    const VerifiedFigures& f = *unexplained->exceeded;
    std::snprintf(text, sizeof text,
                  "%llu (%s): not reported%s: %s at %.4g s, h/2 %.2g m, %s %.2g m (off by %.2g "
                  "m), estimate %.2g m, growth %.2g",
                  static_cast<unsigned long long>(number), kind_of(number).c_str(),
                  verdict.has_broken ? ", a joint broke" : "", unexplained->name.c_str(), f.time,
                  f.half_step, name(report.other_method), f.other_method, f.other_error, f.estimate,
                  f.growth);
  } else {
    std::snprintf(text, sizeof text, "%llu (%s): false alarm: %s",
                  static_cast<unsigned long long>(number), kind_of(number).c_str(),
                  to_string(report.warnings.front()).c_str());
  }
  verdict.line = text;
  return verdict;
}

int run(const Options& options) {
  std::atomic<std::uint64_t> next{0};
  std::mutex output;
  std::uint64_t done = 0, exceeding = 0, silent = 0, warned = 0, false_alarms = 0, chaotic = 0,
                others = 0, broken = 0;
  const auto work = [&] {
    for (std::uint64_t i = next++; i < options.scenes; i = next++) {
      const Verdict verdict = judge(options.seed + i, options);
      const std::lock_guard<std::mutex> lock(output);
      ++done;
      exceeding += verdict.exceeds;
      silent += verdict.is_silent;
      broken += verdict.is_silent && verdict.has_broken;
      warned += verdict.is_warned;
      false_alarms += verdict.is_false_alarm;
      chaotic += verdict.is_chaotic;
      others += verdict.has_other;
      if (verdict.line.empty()) continue;
      std::printf("%s\n", verdict.line.c_str());
      std::fflush(stdout);
    }
  };
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < options.threads; ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();

  const auto share = [&](std::uint64_t count) {
    return 100.0 * static_cast<double>(count) /
           static_cast<double>(std::max<std::uint64_t>(1, done));
  };
  std::printf("\nscenes %llu to %llu of %.3g s\n", static_cast<unsigned long long>(options.seed),
              static_cast<unsigned long long>(options.seed + options.scenes - 1), options.duration);
  const auto print = [&](const char* what, std::uint64_t count) {
    std::printf("%-58s %6llu  %.2f %%\n", what, static_cast<unsigned long long>(count),
                share(count));
  };
  print("with a body compared with another method", others);
  print("with a body whose motion is chaotic", chaotic);
  print("with a difference beyond estimate and growth", exceeding);
  print("the same, that the run had not reported", silent);
  print("  of these, where a joint broke in one of the runs", broken);
  print("with a warning or failure of the run", warned);
  print("the same, where no difference was found", false_alarms);
  return share(silent) <= 0.1 && share(false_alarms) <= 1.0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  po::options_description described;
  described.add_options()("scenes", po::value(&options.scenes)->default_value(5000))(
      "seed", po::value(&options.seed)->default_value(1), "number of the first scene")(
      "duration", po::value(&options.duration)->default_value(0.5), "[s]")(
      "least", po::value(&options.least)->default_value(1e-6), "[m]")(
      "margin", po::value(&options.margin)->default_value(100.0))(
      "threads", po::value(&options.threads)->default_value(2));
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, described), values);
    po::notify(values);
    if (options.threads < 1 || options.threads > 64 || !(options.duration > 0.0))
      throw po::error("out of range");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return run(options);
}
