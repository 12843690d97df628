// shards: 4
// Snapshots as bytes. Oracle: the written world itself, continued, to the bit.

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <sstream>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "random_mechanisms.h"
#include "random_scenes.h"
#include "redundant_cases.h"
#include "sanitized.h"
#include "shipped_scenes.h"
#include "support.h"
#include "temporary_folder.h"
#include "test_paths.h"

namespace constraint_sim::engine {
namespace {

const int kFuture = (kIsLongRun ? 500 : 100) / kSanitizedShare;  // [steps]
const std::uint64_t kRandom = 100 / kSeedShare;                  // scenes of each kind

std::vector<std::string> shipped_names() { return scene_names(CONSTRAINT_SIM_SCENE_DIR); }

/// Expects the same hash after every step.
void expect_same_future(World world, World again, int steps, const std::string& what) {
  for (int i = 0; i <= steps; ++i) {
    ASSERT_EQ(again.state_hash(), world.state_hash()) << what << ", " << i << " steps later";
    ASSERT_EQ(again.report().energy.total, world.report().energy.total) << what;
    const double estimate = world.report().local_error;  // NaN where impulses have none
    ASSERT_TRUE(std::isnan(estimate) ? std::isnan(again.report().local_error)
                                     : again.report().local_error == estimate)
        << what;
    ASSERT_EQ(again.contacts().size(), world.contacts().size()) << what;
    if (kIsLongRun || i % 10 == 0) {
      ASSERT_TRUE(write_snapshot(again) == write_snapshot(world)) << what << ", " << i << " later";
    }
    world.step();
    again.step();
  }
}

class Snapshots : public testing::TestWithParam<std::string> {};

TEST_P(Snapshots, OfAShippedSceneGoOnWithTheSameBits) {
  for (const Method method :
       {Method::kAuto, Method::kEnergyMomentum, Method::kRungeKutta, Method::kSequentialImpulses}) {
    World world = shipped(GetParam(), method);
    const int settled = method == Method::kAuto ? 150 : 150 / kSanitizedShare;
    for (const int steps : {0, 1, settled}) {
      run(world, steps);
      const std::uint64_t hash = world.state_hash();
      const std::string bytes = write_snapshot(world);
      ASSERT_EQ(world.state_hash(), hash);
      ASSERT_EQ(write_snapshot(world), bytes);
      World again = read_snapshot(bytes);
      ASSERT_EQ(again.time(), world.time());
      ASSERT_EQ(again.step_count(), world.step_count());
      ASSERT_EQ(write_snapshot(again), bytes);
      const int future = method == Method::kAuto && steps == 150 ? kFuture : kFuture / 10;
      expect_same_future(world, again, future,
                         GetParam() + " by " + name(method) + " at " + std::to_string(steps));
      if (HasFatalFailure()) return;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Snapshots, testing::ValuesIn(shipped_names()),
                         [](const auto& of) { return of.param; });

// Snapshots of worlds with dropped rows and with contradictory joints continue with the same bits,
// reports included.
TEST(SnapshotBytes, OfSingularAndContradictoryJointsGoOnWithTheSameReports) {
  const std::vector<World> scenes = {redundant::n_four_bar(2),
                                     redundant::peaucellier(),
                                     redundant::flat_at_rest(),
                                     redundant::flat_bars_with_spring(),
                                     redundant::flat_four_bar_with_motor(),
                                     redundant::tetra(),
                                     redundant::k5_too_long()};
  int singular = 0, contradictory = 0;
  for (std::size_t scene = 0; scene < scenes.size(); ++scene) {
    for (const Method method : {Method::kAuto, Method::kEnergyMomentum}) {
      for (const double rate : {100.0, 1000.0}) {
        World world = redundant::with(scenes[scene], method, rate);
        int taken = 0;
        for (int i = 0; i < 1000 && taken < 60 / kSanitizedShare; ++i) {
          const bool is_singular = world.step().joints.dependent_rows > 0;
          const bool is_contradictory = redundant::has_conflict(world);
          if (!is_singular && !is_contradictory) continue;
          ++taken;
          ++(is_contradictory ? contradictory : singular);
          World on = world, again = read_snapshot(write_snapshot(world));
          for (int k = 0; k < 3; ++k) {
            on.step();
            again.step();
            ASSERT_TRUE(write_snapshot(again) == write_snapshot(on))
                << "scene " << scene << " by " << name(method) << ", step " << i << " + " << k;
          }
        }
      }
    }
  }
  EXPECT_GT(singular, 200 / kSanitizedShare);
  EXPECT_GT(contradictory, 60 / kSanitizedShare);
}

TEST(SnapshotBytes, OfRandomScenesGoOnWithTheSameBits) {
  for (std::uint64_t seed = 0; seed < kRandom; ++seed) {
    for (const bool is_mechanism : {false, true}) {
      World world =
          random_scenes::make_world(is_mechanism ? random_scenes::MechanismGenerator(seed).make()
                                                 : random_scenes::Generator(seed).make());
      run(world, static_cast<int>(seed % 40));
      expect_same_future(world, read_snapshot(write_snapshot(world)), 40,
                         (is_mechanism ? "mechanism " : "scene ") + std::to_string(seed));
      if (HasFatalFailure()) return;
    }
  }
}

/// Returns the value of a key of the runner's report, which has a line for each.
std::string value_in(const std::string& report, const std::string& key) {
  const std::string start = "\n  \"" + key + "\": ";
  const std::size_t found = report.find(start);
  if (found == std::string::npos) return "";
  const std::size_t first = found + start.size();
  std::string value = report.substr(first, report.find_first_of(",\n", first) - first);
  value.erase(std::remove(value.begin(), value.end(), '"'), value.end());
  return value;
}

/// Returns the hash that the runner, a separate process, computes from these bytes; none where its
/// steps differ.
std::string hash_in_another_process(const World& world, int steps, const std::string& folder) {
  const std::string file = folder + "/one.snapshot", report = folder + "/report.json";
  std::ofstream(file, std::ios::binary) << write_snapshot(world);
  std::ostringstream duration;
  duration.precision(17);
  duration << steps * world.options().time_step;
  const std::string command = std::string(CONSTRAINT_SIM_RUN) + " " + file + " --duration " +
                              duration.str() + " --report " + report + " > " + folder +
                              "/said 2>&1";
  static_cast<void>(std::system(command.c_str()));  // a warning is a status too
  std::ifstream written(report);
  const std::string text(std::istreambuf_iterator<char>(written), {});
  std::filesystem::remove(report);
  const std::uint64_t expected = world.step_count() + static_cast<std::uint64_t>(steps);
  return value_in(text, "steps") == std::to_string(expected) ? value_in(text, "state_hash") : "";
}

std::string hexadecimal(std::uint64_t hash) {
  std::ostringstream text;
  text << "0x" << std::hex << std::setfill('0') << std::setw(16) << hash;
  return text.str();
}

// 500 ticks, return, 500 ticks: in this process, and in one that has only the file.
TEST(SnapshotBytes, GoOnWithTheSameBitsInThisProcessAndInAnother) {
  const TemporaryFolder folder;
  int compared = 0;
  const auto compare = [&](World world, const std::string& what) {
    World again = read_snapshot(write_snapshot(world));
    const World start = world;
    for (int i = 0; i < kFuture; ++i) {
      if (world.step().outcome.failed)
        return;  // a random one may reach a state that no method can advance
      again.step();
    }
    ++compared;
    EXPECT_EQ(again.state_hash(), world.state_hash()) << what;
    EXPECT_EQ(hash_in_another_process(start, kFuture, folder.path()),
              hexadecimal(world.state_hash()))
        << what;
  };
  const std::vector<std::string> scenes = shipped_names();
  for (const std::string& scene : scenes) {
    World world = shipped(scene);
    run(world, 50);
    compare(world, scene);
  }
  EXPECT_EQ(compared, static_cast<int>(scenes.size()));
  for (std::uint64_t seed = 0; seed < kRandom; ++seed) {
    compare(random_scenes::make_world(random_scenes::Generator(seed).make()),
            "scene " + std::to_string(seed));
    compare(random_scenes::make_world(random_scenes::MechanismGenerator(seed).make()),
            "mechanism " + std::to_string(seed));
  }
  EXPECT_GT(compared, static_cast<int>(19 * kRandom / 10));
}

// Edits before and after, with resets and ids.
TEST(SnapshotBytes, TakeTheSameEditsAfterwards) {
  for (const std::string& scene : shipped_names()) {
    World world = shipped(scene);
    run(world, 20);
    world.remove_body(world.body_ids().back());  // the edited world is not yet compiled
    World again = read_snapshot(write_snapshot(world));
    for (World* one : {&world, &again}) {
      run(*one, 5);
      Body body = make_body("newcomer", Sphere{0.1}, 1.0, {0.0, 0.0, 50.0});
      const BodyId id = one->add_body(body);
      if (one->joint_ids().empty()) continue;
      one->set_broken(one->joint_ids().front(), true);
      Wrench wrench;
      wrench.body = id;
      wrench.force = {1.0, 2.0, 3.0};
      wrench.end = one->time() + 0.123;
      one->add_wrench(wrench);
    }
    EXPECT_EQ(again.find_body("newcomer"), world.find_body("newcomer")) << scene;
    expect_same_future(world, again, 30, scene + " edited");
    for (World* one : {&world, &again}) one->reset();
    expect_same_future(world, again, 30, scene + " reset");
    if (HasFatalFailure()) return;
  }
}

// The wrench of the last step acted on the body with the last index.
TEST(SnapshotBytes, AreReadAfterABodyWithAWrenchIsRemoved) {
  World world{WorldOptions{}};
  world.add_body(make_body("kept", Sphere{0.1}, 1.0, {0.0, 0.0, 0.0}));
  const BodyId gone = world.add_body(make_body("gone", Sphere{0.1}, 1.0, {5.0, 0.0, 0.0}));
  Wrench wrench;
  wrench.body = gone;
  wrench.force = {1.0, 0.0, 0.0};
  world.add_wrench(wrench);
  world.step();
  world.remove_body(gone);
  World again = read_snapshot(write_snapshot(world));
  EXPECT_EQ(again.state_hash(), world.state_hash());
  world.step();
  again.step();
  EXPECT_EQ(again.state_hash(), world.state_hash());
}

// A screw couples its own coordinates, so ids of other joints in its coupling are unused.
TEST(SnapshotBytes, AreReadAfterAScrewIsAddedWithUnusedIds) {
  World world{WorldOptions{}};
  Joint joint;
  joint.name = "screw";
  joint.kind = JointKind::kScrew;
  joint.body_b = world.add_body(make_body("nut", Sphere{0.1}, 1.0, {0.0, 0.0, 0.0}));
  joint.pitch = 0.01;
  joint.coupling.first = JointId{7};
  joint.coupling.second = JointId{4000000000U};
  const JointId screw = world.add_joint(joint);
  EXPECT_EQ(world.joint(screw).coupling.first, JointId{});
  EXPECT_EQ(world.joint(screw).coupling.second, JointId{});
  const World again = read_snapshot(write_snapshot(world));
  EXPECT_EQ(again.state_hash(), world.state_hash());
}

// The hinge motor has a force limit, so each other method compiles the island with events.
// A third of a turn about (1, 1, 1) exchanges axes exactly, where angles of some kinds do not
// exist.
TEST(SnapshotBytes, AreReadAfterABrokenJointIsAddedWhereItsAngleDoesNotExist) {
  const Eigen::Quaterniond exchange(0.5, 0.5, 0.5, 0.5);
  int without_angle = 0;
  for (const JointKind kind : {JointKind::kHinge, JointKind::kCylindrical, JointKind::kPlanar,
                               JointKind::kUniversal, JointKind::kParallel, JointKind::kScrew}) {
    for (const int turns : {0, 1, 2}) {
      World world(weightless(0.01));
      Body box = make_body("box", Box{{0.1, 0.2, 0.3}}, 1.0, {0.0, 0.0, 0.0});
      for (int i = 0; i < turns; ++i) box.state.orientation = box.state.orientation * exchange;
      box.state.angular_velocity = {0.3, 0.5, 0.7};
      Joint joint;
      joint.name = "joint";
      joint.kind = kind;
      joint.frame_b = Eigen::Quaterniond::Identity();
      joint.pitch = kind == JointKind::kScrew ? 0.1 : 0.0;
      joint.body_b = world.add_body(box);
      // A broken joint does not close its error, so its frames keep their axes.
      const JointId id = world.add_joint(joint, true);
      for (const CoordinateState& coordinate : world.joint_state(id).coordinates) {
        EXPECT_TRUE(std::isfinite(coordinate.velocity)) << name(kind) << ", " << turns;
        if (kind == JointKind::kUniversal) without_angle += coordinate.velocity == 0.0;
      }
      const World again = read_snapshot(write_snapshot(world));
      EXPECT_EQ(again.state_hash(), world.state_hash()) << name(kind) << ", " << turns;
    }
  }
  EXPECT_EQ(without_angle,
            3 + 2);  // z axes parallel: two coordinates, and each third one is unused
}

TEST(SnapshotBytes, AreReadAfterImpulsesAreAskedFor) {
  World world = load_scene(R"(
bodies:
  - {name: arm, mass: 1, position: [0, 0, 0.25], shape: {box: {size: [0.1, 0.1, 0.5]}}}
constraints:
  - {name: elbow, type: hinge, body_b: arm, axis_a: [0, 1, 0], motor: {bias: 0.1, max_force: 50}}
)");
  run(world, 2);
  const auto set_method = [](Method method, World* changed) {
    WorldOptions options = changed->options();
    options.method = method;
    changed->set_options(options);
  };
  set_method(Method::kSequentialImpulses, &world);
  for (const int steps : {0, 1, 3}) {
    run(world, steps);
    const World again = read_snapshot(write_snapshot(world));
    expect_same_future(world, again, 3, "impulses at " + std::to_string(steps));
    if (HasFatalFailure()) return;
    World back = world, again_back = again;
    for (World* each : {&back, &again_back}) {
      set_method(Method::kAuto, each);
      each->step();  // restarts the motion, which is in the bytes until then
    }
    expect_same_future(back, again_back, 3, "auto again at " + std::to_string(steps));
    if (HasFatalFailure()) return;
  }
}

TEST(SnapshotBytes, RefuseWhatIsNoSnapshot) {
  World world = shipped("double_pendulum");
  run(world, 10);
  const std::string bytes = write_snapshot(world);
  const auto refused = [](const std::string& text) {
    return refusal([&] { read_snapshot(text); });
  };
  EXPECT_EQ(refused(""), "snapshot: is none");
  EXPECT_EQ(refused("world: {}"), "snapshot: is none");
  for (std::size_t size = 0; size < bytes.size(); size += 7)
    EXPECT_NE(refused(bytes.substr(0, size)), "") << size;
  for (std::size_t i = 0; i < bytes.size(); i += 13) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    EXPECT_NE(refused(damaged), "") << i;
  }
  EXPECT_NE(refused(bytes + "x"), "");
  std::string other = bytes;
  other.replace(other.find("snapshot ") + 9, 1, "0");  // the number of the format
  EXPECT_NE(refused(other).find("another build"), std::string::npos) << refused(other);
}

}  // namespace
}  // namespace constraint_sim::engine
