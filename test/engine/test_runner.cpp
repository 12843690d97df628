#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "shipped_scenes.h"
#include "temporary_folder.h"
#include "test_paths.h"

namespace constraint_sim::engine {
namespace {

std::string read(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

/// Runs the real program in its own folder.
class Runner : public testing::Test {
 protected:
  void SetUp() override {
    std::ofstream(in_folder("scene.yaml")) << "world: {time_step: 0.01}\n"
                                              "bodies:\n"
                                              "  - {name: bob, mass: 1, position: [1, 0, 0]}\n"
                                              "  - {name: hook, type: static}\n"
                                              "constraints:\n"
                                              "  - {name: rod, body_a: hook, body_b: bob}\n";
  }
  std::string in_folder(const std::string& name) const { return folder_.path() + "/" + name; }

  /// Runs the program and returns its exit status; `with` is a prefix of the command.
  int run(const std::string& arguments, const std::string& with = "") const {
    const std::string command = "cd '" + folder_.path() + "' && " + with +
                                " '" CONSTRAINT_SIM_RUN "' " + arguments +
                                " >stdout.txt 2>stderr.txt";
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string out() const { return read(in_folder("stdout.txt")); }
  std::string err() const { return read(in_folder("stderr.txt")); }
  nlohmann::json report(const std::string& name = "report.json") const {
    return nlohmann::json::parse(read(in_folder(name)));
  }

 private:
  TemporaryFolder folder_;
};

// A program built elsewhere has its sources' folder no more: scenes are those beside it, with and
// without catkin.
TEST_F(Runner, FindsTheScenesOfItsInstallation) {
  namespace fs = std::filesystem;
  for (const std::string folder : {"bin", "lib/constraint_sim"}) {
    SCOPED_TRACE(folder);
    const std::string prefix = in_folder(folder == "bin" ? "without_ros" : "with_ros");
    fs::create_directories(prefix + "/" + folder);
    fs::create_directories(prefix + "/share/constraint_sim/config/scenes");
    fs::copy_file(in_folder("scene.yaml"),
                  prefix + "/share/constraint_sim/config/scenes/only_here.yaml");
    const std::string program = prefix + "/" + folder + "/constraint_sim_run";
    fs::copy_file(CONSTRAINT_SIM_RUN, program);
    EXPECT_EQ(std::system(("'" + program + "' only_here --duration 1 >/dev/null").c_str()), 0);
  }
}

TEST_F(Runner, PrintsASummary) {
  ASSERT_EQ(run("scene.yaml --duration 1"), 0) << err();
  EXPECT_EQ(err(), "");  // no progress bar without a terminal
  for (const char* line : {"steps                  100\n", "simulated time         1 s\n",
                           "method                 runge_kutta\n"})
    EXPECT_NE(out().find(line), std::string::npos) << line << "is not in\n" << out();
}

// Three processes: 5 s at once, and 2 s and 3 s, where the last one continues from the file alone.
TEST_F(Runner, GoesOnFromASnapshotInAnotherProcess) {
  for (const std::string scene : {"winch", "two_boxes", "heavy_load", "gripper"}) {
    ASSERT_EQ(run(scene + " --duration 5 --report whole.json") % 4, 0) << err();
    ASSERT_EQ(run(scene + " --duration 2 --snapshot half.snapshot") % 4, 0) << err();
    ASSERT_EQ(run("half.snapshot --duration 3 --report half.json") % 4, 0) << err();
    EXPECT_EQ(report("half.json")["steps"], report("whole.json")["steps"]);
    EXPECT_EQ(report("half.json")["state_hash"], report("whole.json")["state_hash"]) << scene;
  }
  std::string bytes = read(in_folder("half.snapshot"));
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  std::ofstream(in_folder("bad.snapshot"), std::ios::binary) << bytes;
  EXPECT_EQ(run("bad.snapshot --duration 1"), 2);
  EXPECT_NE(err().find("damaged"), std::string::npos) << err();
}

TEST_F(Runner, ExplainsItselfWithoutAScene) {
  ASSERT_EQ(run("--help"), 0);
  for (const char* option : {"--duration", "--csv", "--constraint-csv", "--report", "--save",
                             "--snapshot", "--explain", "--verify"})
    EXPECT_NE(out().find(option), std::string::npos) << option;
}

TEST_F(Runner, TakesEachOptionOfAWorldButGravity) {
  const std::map<std::string, std::string> values{{"time_step", "0.002"},
                                                  {"method", "energy_momentum"},
                                                  {"order", "5"},
                                                  {"tolerance", "1e-05"},
                                                  {"stiff_order", "2"},
                                                  {"dissipation", "true"},
                                                  {"stiffness_limit", "3"},
                                                  {"iterations", "7"},
                                                  {"baumgarte", "0.25"},
                                                  {"warm_starting", "false"},
                                                  {"closing_time", "0.75"},
                                                  {"sleep_after", ".inf"},
                                                  {"sleep_speed", "1e-06"},
                                                  {"threads", "2"},
                                                  {"contact_tolerance", "0.001"},
                                                  {"event_work", "500"}};
  ASSERT_EQ(run("--help"), 0);
  const std::string help = out();
  const WorldOptions defaults;
  visit_options(defaults, [&](const OptionInfo& info, const auto&, auto) {
    std::string argument = info.name;
    std::replace(argument.begin(), argument.end(), '_', '-');
    if (argument == "gravity") return;
    EXPECT_NE(help.find("--" + argument + " "), std::string::npos) << argument;
    const std::string& value = values.at(info.name);
    ASSERT_EQ(run("scene.yaml --duration 0 --save end.yaml --" + argument + " " + value), 0)
        << err();
    const std::string line = std::string("\n  ") + info.name + ": " + value + "\n";
    EXPECT_NE(read(in_folder("end.yaml")).find(line), std::string::npos) << line;
  });
}

TEST_F(Runner, WritesAStateABodyAndTick) {
  ASSERT_EQ(run("scene.yaml --duration 0.05 --csv states.csv"), 0) << err();
  const auto lines = lines_of(read(in_folder("states.csv")));
  ASSERT_EQ(lines.size(), 1u + 2u * 6u);  // header; two bodies at the start and after five ticks
  EXPECT_EQ(lines[0], "time,body,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz");
  EXPECT_EQ(lines[1], "0,bob,1,0,0,0,0,0,1,0,0,0,0,0,0");
  EXPECT_EQ(lines[2], "0,hook,0,0,0,0,0,0,1,0,0,0,0,0,0");
  EXPECT_EQ(lines[3].substr(0, 9), "0.01,bob,");
}

TEST_F(Runner, ReportsWhatTheEngineGivesInTheSameRun) {
  ASSERT_EQ(run("scene.yaml --duration 0.5 --report report.json --save end.yaml"), 0) << err();
  World world = load_scene_file(in_folder("scene.yaml"));
  const double energy_initial = world.energy();
  double largest_error = 0.0;
  for (int i = 0; i < 50; ++i)
    largest_error = std::max(largest_error, world.step().joints.max_error);

  const auto json = report();
  EXPECT_EQ(json.at("steps"), 50);
  EXPECT_EQ(json.at("sim_time"), world.time());
  EXPECT_GT(json.at("wall_time"), 0.0);
  EXPECT_EQ(std::stoull(json.at("state_hash").get<std::string>(), nullptr, 16), world.state_hash());
  EXPECT_EQ(json.at("energy_initial"), energy_initial);
  EXPECT_EQ(json.at("energy_final"), world.energy());
  EXPECT_EQ(json.at("max_constraint_error"), largest_error);
  EXPECT_EQ(json.at("methods"), nlohmann::json({"runge_kutta"}));
  EXPECT_EQ(json.at("bodies").size(), 2u);
  const auto& bob = json.at("bodies").at("bob");
  const BodyState& state = world.state(world.find_body("bob"));
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(bob.at("position").at(static_cast<std::size_t>(i)), state.position[i]);
    EXPECT_EQ(bob.at("linear_velocity").at(static_cast<std::size_t>(i)), state.linear_velocity[i]);
  }
  EXPECT_EQ(bob.at("orientation"), nlohmann::json({0.0, 0.0, 0.0, 1.0}));
  EXPECT_EQ(bob.at("angular_velocity"), nlohmann::json({0.0, 0.0, 0.0}));
  EXPECT_EQ(read(in_folder("end.yaml")), save_scene(world));
}

TEST_F(Runner, SaysWhatWasLeftOut) {
  ASSERT_EQ(run("scene.yaml --duration 0.1 --explain --report report.json"), 0) << err();
  EXPECT_NE(out().find("collision: false\n"), std::string::npos) << out();
  const auto left_out = report().at("left_out");
  ASSERT_EQ(left_out.size(), 11u);
  for (const auto& line : left_out)
    EXPECT_NE(out().find("  - \"" + line.get<std::string>() + "\"\n"), std::string::npos) << out();

  const std::string balls = CONSTRAINT_SIM_SCENE_DIR "/falling_balls.yaml";
  ASSERT_EQ(run("'" + balls + "' --duration 0 --explain --report report.json"), 0) << err();
  EXPECT_NE(out().find("collision: true\n"), std::string::npos) << out();
  EXPECT_EQ(report().at("left_out").at(0), "constraints: there are none");
}

// A tower of light cubes under one of 1e9 kg, which time_stepping does not solve within its
// iterations.
TEST_F(Runner, TellsImpulsesThatAreNotSolved) {
  std::ofstream scene(in_folder("tower.yaml"));
  scene << "world: {method: time_stepping, time_step: 0.0166}\n"
           "bodies:\n"
           "  - {name: floor, type: static, shape: {plane: {}}, friction: 0.6}\n";
  for (int i = 0; i < 20; ++i)
    scene << "  - {name: cube_" << i << ", mass: " << (i == 19 ? 1e9 : 1.0)
          << ", shape: {box: {size: [0.2, 0.2, 0.2]}}, position: [0, 0, " << 0.2 * i + 0.1
          << "], friction: 0.6}\n";
  scene.close();
  ASSERT_EQ(run("tower.yaml --duration 0.5 --report report.json"), 4) << err();
  EXPECT_NE(err().find("impulses on it and on what it touches were not solved"), std::string::npos)
      << err();
}

TEST_F(Runner, TellsErrorsThatAreNotClosed) {
  std::ofstream(in_folder("contradiction.yaml"))
      << "bodies:\n"
         "  - {name: bob, mass: 1, position: [0, 0, -1.1]}\n"
         "constraints:\n"
         "  - {name: short, body_b: bob, length: 1}\n"
         "  - {name: long, body_b: bob, length: 1.2}\n";
  ASSERT_EQ(run("contradiction.yaml --duration 2 --report report.json"), 4) << err();
  const auto warnings = report().at("warnings");
  ASSERT_EQ(warnings.size(), 2u);
  for (const auto& line : warnings) {
    EXPECT_NE(line.get<std::string>().find("is not being closed"), std::string::npos) << line;
    EXPECT_NE(err().find("warning: " + line.get<std::string>() + "\n"), std::string::npos) << err();
  }
  EXPECT_EQ(report().at("unclosed_joints"), nlohmann::json({"long", "short"}));
  ASSERT_EQ(run("heavy_load --duration 2 --method sequential_impulses --report report.json"), 4);
  ASSERT_EQ(run("scene.yaml --duration 5 --report report.json"), 0) << err();
  EXPECT_TRUE(report().at("warnings").empty());
  // a double pendulum's steps of 0.2 s without a tolerance are too long
  std::ofstream(in_folder("double.yaml"))
      << "bodies: [{name: upper, mass: 1, position: [1, 0, 0]},\n"
         "         {name: lower, mass: 1, position: [2, 0, 0]}]\n"
         "constraints: [{name: rod_1, body_b: upper},\n"
         "              {name: rod_2, body_a: upper, body_b: lower}]\n";
  ASSERT_EQ(run("double.yaml --duration 10 --tolerance 0 --time-step 0.2 --report report.json"), 4);
  EXPECT_GT(report().at("energy_rise"), 0.0);
  EXPECT_NE(err().find("energy of its island rose"), std::string::npos) << err();
}

TEST_F(Runner, GivesTheSameTwice) {
  const std::string scene = "'" CONSTRAINT_SIM_SCENE_DIR "/bridge.yaml' --duration 1 --report ";
  ASSERT_EQ(run(scene + "a.json"), 0) << err();
  ASSERT_EQ(run(scene + "b.json"), 0) << err();
  EXPECT_EQ(report("a.json").at("state_hash"), report("b.json").at("state_hash"));
}

TEST_F(Runner, TakesOptionsFromTheCommandLine) {
  ASSERT_EQ(run("scene.yaml --duration 1 --report a.json"), 0) << err();
  ASSERT_EQ(run("scene.yaml --duration 1 --report b.json --time-step 0.004"), 0) << err();
  EXPECT_EQ(report("b.json").at("steps"), 250);
  EXPECT_NE(report("a.json").at("state_hash"), report("b.json").at("state_hash"));

  ASSERT_EQ(run("scene.yaml --duration 0 --save end.yaml --method sequential_impulses"), 0);
  EXPECT_NE(read(in_folder("end.yaml")).find("method: sequential_impulses"), std::string::npos);

  ASSERT_EQ(run("scene.yaml --duration 0 --save end.yaml --order 5 --tolerance 1e-4"), 0);
  EXPECT_NE(read(in_folder("end.yaml")).find("order: 5\n  tolerance: 0.0001"), std::string::npos);
}

TEST_F(Runner, RunsToTheNearestTick) {
  ASSERT_EQ(run("scene.yaml --duration 0.026 --report report.json"), 0) << err();
  EXPECT_EQ(report().at("steps"), 3);
  ASSERT_EQ(run("scene.yaml --duration 0 --csv states.csv --report report.json"), 0) << err();
  EXPECT_EQ(report().at("steps"), 0);
  EXPECT_EQ(lines_of(read(in_folder("states.csv"))).size(), 3u);
}

TEST_F(Runner, RefusesBadInputInOneLine) {
  std::ofstream(in_folder("bad.yaml")) << "world: {}\nbodies:\n  - name: a\n    mass: -1\n";
  ASSERT_EQ(run("bad.yaml --duration 1"), 2);
  EXPECT_EQ(
      err(),
      "constraint_sim_run: bad.yaml:4: bodies[0].mass: must be a finite number > 0, got -1\n");
  for (const char* arguments :
       {"", "scene.yaml", "--duration 1", "none.yaml --duration 1", "scene.yaml --duration -1",
        "scene.yaml --duration nan", "scene.yaml --duration inf", "scene.yaml --duration 1e300",
        "scene.yaml --duration 1s", "scene.yaml --duration 1 --time-step 0",
        "scene.yaml --duration 1 --method leapfrog", "scene.yaml --duration 1 --order 7",
        "scene.yaml --duration 1 --tolerance -1", "scene.yaml --duration 1 --time 0.1",
        "scene.yaml --duration 1 --sleep-after .infinite", "scene.yaml --duration 1 --threads 1.5",
        "scene.yaml other.yaml --duration 1", "scene.yaml --duration 1 --csv no/such/folder.csv"}) {
    EXPECT_EQ(run(arguments), 2) << arguments;
    EXPECT_EQ(lines_of(err()).size(), 1u) << arguments << "\n" << err();
  }
}

// Existing files stay until an output is written completely: on a full disk (here: files above 4
// KiB cannot be made), and where the program is killed.
TEST_F(Runner, KeepsOldFilesUntilNewOnesAreWhole) {
  const std::string outputs = " --csv a.csv --save a.yaml --report a.json --snapshot a.snapshot";
  const std::vector<std::string> names{"a.csv", "a.yaml", "a.json", "a.snapshot"};
  for (const std::string& name : names) std::ofstream(in_folder(name)) << "old";
  ASSERT_EQ(run("scene.yaml --duration 10" + outputs, "trap '' XFSZ && ulimit -f 8 &&"), 2);
  EXPECT_EQ(lines_of(err()).size(), 1u) << err();
  EXPECT_NE(err().find("a.csv': File too large"), std::string::npos) << err();
  for (const std::string& name : names) EXPECT_EQ(read(in_folder(name)), "old") << name;
  ASSERT_EQ(run("scene.yaml --duration 1e9" + outputs, "timeout -s KILL 2"), 137);
  for (const std::string& name : names) EXPECT_EQ(read(in_folder(name)), "old") << name;
  ASSERT_EQ(run("scene.yaml --duration 1" + outputs), 0) << err();
  EXPECT_EQ(lines_of(read(in_folder("a.csv"))).size(), 1u + 2u * 101u);
}

TEST_F(Runner, RefusesToWriteOneFileTwiceOrTheScene) {
  const std::string scene = read(in_folder("scene.yaml"));
  ASSERT_EQ(
      std::system(
          ("cd '" + in_folder("") + "' && ln -s scene.yaml link && ln scene.yaml hard").c_str()),
      0);
  for (const char* arguments : {"--csv a --report a", "--save a --snapshot ./a", "--csv scene.yaml",
                                "--save ./scene.yaml", "--report link", "--snapshot hard",
                                "--constraint-csv scene.yaml", "--csv a --constraint-csv a"}) {
    EXPECT_EQ(run("scene.yaml --duration 0.1 " + std::string(arguments)), 2) << arguments;
    EXPECT_NE(err().find("is the file of "), std::string::npos) << err();
    EXPECT_EQ(read(in_folder("scene.yaml")), scene) << arguments;
  }
  EXPECT_EQ(run("scene.yaml --duration 0.1 --csv /dev/null --report /dev/null"), 0) << err();
}

TEST_F(Runner, TellsThatItsOutputIsLost) {
  for (const char* arguments :
       {"scene.yaml --duration 0.1", "scene.yaml --duration 0.1 --explain", "--help"}) {
    EXPECT_EQ(run(std::string(arguments) + " >/dev/full 2>stderr.txt #"), 2) << arguments;
    EXPECT_EQ(err(), "constraint_sim_run: cannot write to standard output\n");
  }
}

TEST_F(Runner, KnowsTheShippedScenesByName) {
  ASSERT_EQ(run("pendulum --duration 0.1 --report a.json"), 0) << err();
  ASSERT_EQ(run("'" CONSTRAINT_SIM_SCENE_DIR "/pendulum.yaml' --duration 0.1 --report b.json"), 0);
  EXPECT_EQ(report("a.json").at("state_hash"), report("b.json").at("state_hash"));
  ASSERT_EQ(run("--help"), 0);
  EXPECT_NE(out().find("\n  falling_balls\n"), std::string::npos) << out();
  ASSERT_EQ(run("pendlum --duration 1"), 2);
  EXPECT_EQ(
      err(),
      "constraint_sim_run: pendlum: there is no such file or scene; did you mean pendulum?\n");
}

TEST_F(Runner, ReadsStandardInput) {
  ASSERT_EQ(run("- --duration 0.1 --report a.json <scene.yaml"), 0) << err();
  ASSERT_EQ(run("scene.yaml --duration 0.1 --report b.json"), 0) << err();
  EXPECT_EQ(report("a.json").at("state_hash"), report("b.json").at("state_hash"));
  ASSERT_EQ(run("- --duration 1 </dev/null"), 2);
  EXPECT_EQ(err(), "constraint_sim_run: standard input:1: expected a scene, got nothing\n");
  ASSERT_EQ(run("- --duration 1 </dev/zero", "timeout 20"), 2);
  EXPECT_EQ(err(),
            "constraint_sim_run: standard input: must be at most 6291456 bytes, got 6291457\n");
}

TEST_F(Runner, RefusesWhatHasNoEndAtOnce) {
  ASSERT_EQ(std::system(("mkfifo '" + in_folder("pipe") + "'").c_str()), 0);
  for (const char* scene : {"pipe", "/dev/zero", "."}) {
    EXPECT_EQ(run(std::string(scene) + " --duration 1", "timeout 5"), 2) << scene;
    EXPECT_NE(err().find("it is no regular file"), std::string::npos) << err();
  }
}

TEST_F(Runner, EndsCleanlyWhenInterrupted) {
  const struct {
    const char* signal;
    int status;
  } kSignals[] = {{"INT", 130}, {"TERM", 143}};
  for (const auto& [signal, status] : kSignals) {
    const std::string timeout = std::string("timeout --preserve-status -k 60 -s ") + signal + " 3";
    ASSERT_EQ(run("scene.yaml --duration 1e9 --report report.json --save end.yaml", timeout),
              status)
        << err();
    EXPECT_EQ(err().rfind("constraint_sim_run: stopped after ", 0), 0u) << err();
    EXPECT_GT(report().at("steps"), 0);
    const World end = load_scene_file(in_folder("end.yaml"));
    EXPECT_EQ(end.state(end.find_body("bob")).position.x(),
              report().at("bodies").at("bob").at("position").at(0));
  }
}

// `timeout` signals the process and then its group. Five times, as signals that arrive together are
// delivered once.
TEST_F(Runner, TakesSignalsWithinAMomentAsOneRequest) {
  const std::string repeated =
      "sh -c '\"$@\" & sleep 0.3; i=0; while [ $i -lt 100 ]; do kill -INT $! 2>&-; i=$((i+1)); "
      "done; wait $!' sh";
  for (int i = 0; i < 5; ++i) {
    ASSERT_EQ(run("scene.yaml --duration 1e9 --report report.json", repeated), 130) << err();
    EXPECT_EQ(err().rfind("constraint_sim_run: stopped after ", 0), 0u) << err();
  }
}

TEST_F(Runner, TellsWarnings) {
  ASSERT_EQ(run("scene.yaml --duration 0.1 --report report.json"), 0) << err();
  EXPECT_EQ(report().at("warnings"), nlohmann::json::array());
  ASSERT_EQ(run("worked_example --duration 0.1 --report report.json"), 0) << err();
  ASSERT_EQ(report().at("warnings").size(), 2u);
  EXPECT_EQ(
      report().at("warnings").at(0).get<std::string>().rfind("body 'a': inertia (1, 2, 4)", 0), 0u);
  EXPECT_EQ(lines_of(err()).size(), 2u) << err();
}

// After one more tick the body would be beyond the largest coordinate.
TEST_F(Runner, ReportsFailedPhysics) {
  std::ofstream(in_folder("far.yaml")) << "world: {time_step: 1}\n"
                                          "bodies:\n  - {name: a, mass: 1, position: [1e20, 0, 0],"
                                          " linear_velocity: [1e20, 0, 0]}\n";
  ASSERT_EQ(run("far.yaml --duration 5 --report report.json"), 3) << out() << err();
  EXPECT_EQ(lines_of(err()).size(), 1u) << err();
  EXPECT_EQ(report().at("bodies").at("a").at("position").at(0), 1e20);
  EXPECT_EQ(report().at("failure"), to_string(Failure::kOutOfRange));
  EXPECT_EQ(report().at("failed_body"), "a");
}

// Sums and largest values over all steps, as the engine reports them.
TEST_F(Runner, ReportsWorkAndWhatTheSweepsLeft) {
  const std::string scene =
      "world: {method: sequential_impulses, time_step: 0.001}\n"
      "bodies: [{name: upper, mass: 1, position: [1, 0, 0]},\n"
      "         {name: lower, mass: 1, position: [2, 0, 0]}]\n"
      "constraints: [{name: rod_1, body_b: upper},\n"
      "              {name: rod_2, body_a: upper, body_b: lower}]\n"
      "wrenches: [{body: lower, force: [0, 1, 0]}]\n";
  std::ofstream(in_folder("driven.yaml")) << scene;
  World world = load_scene(scene);
  double correction_work = 0.0, driven_work = 0.0, residual = 0.0;
  for (int i = 0; i < 100; ++i) {
    const StepReport& step = world.step();
    correction_work += step.energy.correction_work;
    driven_work += step.energy.driven_work;
    residual = std::max(residual, step.contacts.solver_residual);
  }
  ASSERT_NE(correction_work, 0.0);
  ASSERT_NE(driven_work, 0.0);
  ASSERT_NE(residual, 0.0);
  ASSERT_EQ(run("driven.yaml --duration 0.1 --report report.json"), 0) << err();
  const auto json = report();
  EXPECT_EQ(json.at("correction_work"), correction_work);
  EXPECT_EQ(json.at("driven_work"), driven_work);
  EXPECT_EQ(json.at("solver_residual"), residual);
  EXPECT_TRUE(json.at("unclosed_joints").empty());
  EXPECT_EQ(json.at("energy_rise"), 0.0);
  EXPECT_EQ(json.at("failure"), "");
  EXPECT_TRUE(json.at("failed_body").is_null());
}

TEST_F(Runner, WritesConstraints) {
  ASSERT_EQ(run("gear_train --duration 1 --csv states.csv --constraint-csv constraints.csv "
                "--report report.json"),
            0)
      << err();
  World world = shipped("gear_train");
  const std::vector<std::string> lines = lines_of(read(in_folder("constraints.csv")));
  ASSERT_EQ(lines.at(0), "time,constraint,q0,q1,q2,error,force,fx,fy,fz,tx,ty,tz");
  const std::size_t ticks = static_cast<std::size_t>(std::lround(1.0 / world.options().time_step));
  EXPECT_EQ(lines.size(), 1 + world.joint_ids().size() * (ticks + 1));
  for (const std::string& line : lines)
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), 12) << line;
  for (std::size_t i = 0; i < ticks; ++i) world.step();
  const auto constraints = report().at("constraints");
  EXPECT_EQ(constraints.size(), world.joint_ids().size());
  for (const JointId id : world.joint_ids()) {
    const auto& json = constraints.at(world.joint(id).name);
    const JointState& state = world.joint_state(id);
    EXPECT_EQ(json.at("error"), state.error);
    EXPECT_EQ(json.at("effort"), state.force);
    for (int i = 0; i < info(world.joint(id).kind).coordinates; ++i)
      EXPECT_EQ(json.at("coordinates").at(static_cast<std::size_t>(i)),
                state.coordinates[static_cast<std::size_t>(i)].position);
    if (info(world.joint(id).kind).couples_joints) continue;
    EXPECT_EQ(json.at("force").at(2), world.joint_wrench(id).force.z());
    EXPECT_EQ(json.at("torque").at(0), world.joint_wrench(id).torque.x());
  }
}

TEST_F(Runner, VerifiesAScene) {
  ASSERT_EQ(run("scene.yaml --duration 1 --verify --report report.json"), 0) << err();
  EXPECT_NE(out().find("energy_momentum [m]"), std::string::npos) << out();
  const auto verified = report().at("verify");
  EXPECT_EQ(verified.at("ticks"), 100);
  EXPECT_EQ(verified.at("exceeds"), false);
  EXPECT_EQ(verified.at("bodies").at("bob").at("verdict"), "holds");
  EXPECT_LT(verified.at("bodies").at("bob").at("half_step"), 1e-10);

  EXPECT_EQ(run("scene.yaml --duration 1 --method sequential_impulses --time-step 0.1 --verify "
                "--report report.json"),
            4);
  EXPECT_NE(err().find("--verify found differences"), std::string::npos) << err();
  const auto bob = report().at("verify").at("bodies").at("bob");
  EXPECT_EQ(bob.at("verdict"), "exceeds");
  EXPECT_TRUE(bob.at("estimate").is_null());
  EXPECT_GT(bob.at("exceeded").at("half_step"), 1e-3);
}

}  // namespace
}  // namespace constraint_sim::engine
