// Prints how fast robots are, how well they hold their poses, and how well they follow
// trajectories: the five robots of test/urdf/robots on fixed bases, the shipped arm and crane, and
// the shipped quadruped on its feet. Argument: folder of the repository.

#include <sys/resource.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <stdexcept>

#include "constraint_sim/engine/scene.h"
#include "engine/math/numbers.h"
#include "make_scene.h"
#include "sim/trajectories.h"
#include "urdf/robot.h"

namespace constraint_sim {
namespace {

using engine::JointId;
using engine::World;

constexpr double kHeld = 5.0;     // [s]
constexpr double kThere = 1.0;    // [s] duration of each of the two parts of a trajectory
constexpr double kLanding = 1.0;  // [s] in which a robot falls on its feet
constexpr double kTurn = 0.2;     // [rad] way of a trajectory
constexpr double kSlide = 0.03;   // [m]
constexpr double kRates[] = {30.0, 60.0, 100.0, 240.0, 1000.0};  // [1/s]

/// Processor time of this thread [s], which other programs on the machine do not change much.
double processor_time() {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::string read_file(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  if (!file) throw std::runtime_error("cannot read " + path);
  return text.str();
}

/// Returns the keys of a robot's YAML without its motors, which are servos, or rates.
std::string without_motors(const std::string& yaml) {
  const std::size_t motors = yaml.find("motors:"), positions = yaml.find("positions:");
  return yaml.substr(0, motors) + (positions == std::string::npos ? "" : yaml.substr(positions));
}

struct Case {
  const char* name;
  std::function<World(double time_step)> world;
  bool on_feet = false;
};

World with_robot(double time_step, const std::string& path, const RobotOptions& options,
                 bool on_feet) {
  engine::WorldOptions world_options;
  world_options.time_step = time_step;
  if (on_feet) world_options.iterations = 100;
  World world(world_options);
  if (on_feet) world.add_body(engine::make_floor(1.0));
  add_robot(read_file(path), options, &world);
  return world;
}

World crane(double time_step, const std::string& folder) {
  World world = engine::load_scene_file(folder + "/config/scenes/crane.yaml");
  engine::WorldOptions options = world.options();
  options.time_step = time_step;
  world.set_options(options);
  engine::Motor motor;
  const JointId foot = world.find_joint("foot");
  motor.position = world.joint_state(foot).coordinates[0].position;
  world.set_motor(foot, 0, motor);
  world.set_motor(world.find_joint("cable"), engine::Motor());
  return world;
}

std::vector<Case> cases(const std::string& folder) {
  std::vector<Case> list;
  const std::string users = folder + "/test/urdf/robots/", shipped = folder + "/config/robots/";
  for (const char* name : {"arm6", "delta", "fivebar", "gantry", "quad12"}) {
    RobotOptions options;
    options.fixed = true;
    options.folder = users;
    options.extra = "hold: true\n";
    const std::string beside = users + name + ".yaml";
    if (std::ifstream(beside)) options.extra += without_motors(read_file(beside));
    const std::string path = users + name + ".urdf";
    list.push_back(
        {name, [=](double time_step) { return with_robot(time_step, path, options, false); }});
  }
  for (const char* name : {"arm", "quadruped"}) {
    RobotOptions options;
    const bool on_feet = name == std::string("quadruped");
    options.fixed = !on_feet;
    options.extra = read_file(shipped + name + ".yaml");
    if (on_feet) options.pose.position.z() = 0.31;
    const std::string path = shipped + name + ".urdf";
    list.push_back({name,
                    [=](double time_step) { return with_robot(time_step, path, options, on_feet); },
                    on_feet});
  }
  list.push_back({"crane", [=](double time_step) { return crane(time_step, folder); }});
  return list;
}

std::vector<JointId> driven(const World& world) {
  std::vector<JointId> joints;
  for (const JointId id : world.joint_ids())
    if (engine::info(world.joint(id).kind).coordinates > 0 && world.joint(id).coordinates[0].motor)
      joints.push_back(id);
  return joints;
}

double position(const World& world, JointId id) {
  return world.joint_state(id).coordinates[0].position;
}

struct Figures {
  double factor = 0.0;  ///< simulated time over processor time
  double most = 0.0;    ///< largest deviation [rad or m]
};

/// Runs for a time [s]. Deviations count from the simulated time `since` on.
Figures run(World* world, double duration, double since,
            const std::function<void(World*)>& before_step,
            const std::function<double(JointId)>& expected) {
  Figures figures;
  const double h = world->options().time_step;
  const std::vector<JointId> joints = driven(*world);
  double taken = 0.0;
  const int steps = static_cast<int>(std::lround(duration / h));
  for (int i = 0; i < steps; ++i) {
    const double before = processor_time();
    before_step(world);
    if (world->step().outcome.failed) throw std::runtime_error("a step failed");
    taken += processor_time() - before;
    if (world->time() < since) continue;
    for (const JointId id : joints)
      figures.most = std::max(figures.most, std::abs(position(*world, id) - expected(id)));
  }
  figures.factor = duration / taken;
  return figures;
}

/// Returns the world of a robot, which does not fall asleep: a robot at rest would cost nothing.
World awake(const Case& robot, double rate) {
  World world = robot.world(1.0 / rate);
  engine::WorldOptions options = world.options();
  options.sleep_after = engine::kInfinity;
  world.set_options(options);
  return world;
}

Figures hold(const Case& robot, double rate) {
  World world = awake(robot, rate);
  std::map<std::uint32_t, double> first;
  for (const JointId id : driven(world)) first[id.value] = position(world, id);
  return run(
      &world, kHeld, robot.on_feet ? kLanding : 0.0, [](World*) {},
      [&](JointId id) { return first.at(id.value); });
}

/// Follows quintics there and back, of all motors at once.
Figures follow(const Case& robot, double rate) {
  World world = awake(robot, rate);
  while (robot.on_feet && world.time() < kLanding) world.step();
  JointTrajectory trajectory;
  trajectory.points.resize(2);
  std::map<std::uint32_t, TimedSpline> splines;
  const double start = world.time();
  for (const JointId id : driven(world)) {
    const engine::Joint& joint = world.joint(id);
    const double by = joint.kind == engine::JointKind::kSlider ? kSlide : kTurn;
    const double from = position(world, id);
    const double to = from + by > joint.coordinates[0].upper ? from - by : from + by;
    trajectory.joints.push_back(joint.name);
    for (const auto& [i, end] : {std::pair{0, to}, std::pair{1, from}}) {
      JointTrajectory::Point& point = trajectory.points[static_cast<std::size_t>(i)];
      point.time = kThere * (1 + i);
      point.positions.push_back(end);
      point.velocities.push_back(0.0);
      point.accelerations.push_back(0.0);
    }
    splines.emplace(
        id.value,
        TimedSpline{
            Spline({{0.0, from, 0.0, 0.0}, {kThere, to, 0.0, 0.0}, {2.0 * kThere, from, 0.0, 0.0}},
                   5),
            start});
  }
  Trajectories trajectories;
  trajectories.begin(world, trajectory);
  return run(
      &world, 2.0 * kThere, 0.0, [&](World* moved) { trajectories.before_step(moved); },
      [&](JointId id) { return splines.at(id.value).at(world.time()); });
}

int main_of(const std::string& folder) {
  std::printf("%-10s %-7s %9s %10s %9s %10s\n", "robot", "step/s", "holding", "drift/rad",
              "following", "error/rad");
  for (const Case& robot : cases(folder))
    for (const double rate : kRates) {
      const Figures held = hold(robot, rate), followed = follow(robot, rate);
      std::printf("%-10s 1/%-5.0f %9.1f %10.1e %9.1f %10.1e\n", robot.name, rate, held.factor,
                  held.most, followed.factor, followed.most);
      std::fflush(stdout);
    }
  return 0;
}

}  // namespace
}  // namespace constraint_sim

int main(int argc, char** argv) try {
  return constraint_sim::main_of(argc > 1 ? argv[1] : ".");
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
