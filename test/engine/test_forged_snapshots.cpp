// Forged snapshots: a clean error, or a world that can be stepped. The address sanitizer finds
// access beyond a list (scripts/build --sanitize).

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/snapshot/snapshot_checks.h"
#include "sanitized.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

#ifdef CONSTRAINT_SIM_SANITIZED
constexpr int kChanges = 60;
#else
constexpr int kChanges = 200;
#endif

const char* const kScenes[] = {"double_pendulum", "gear_train",       "two_boxes",
                               "winch",           "heavy_load",       "crane",
                               "gripper",         "stewart_platform", "compounds"};

/// A hull and a capsule of one body on a box and a ball of another one.
World compounds(Method method) {
  WorldOptions options;
  options.method = method;
  return load_scene(R"(
bodies:
  - name: base
    type: static
    shapes:
      - {shape: {box: {size: [2, 2, 0.2]}}, shape_pose: {position: [0, 0, -0.1]}}
      - {shape: {sphere: {radius: 0.1}}}
  - name: hammer
    mass: 1
    position: [0.1, 0, 0.3]
    shapes:
      - {shape: {hull: {vertices: [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]]}}}
      - {shape: {capsule: {radius: 0.05, length: 0.3}}, shape_pose: {position: [0.2, 0, 0.2]}}
)",
                    "compounds", options);
}

World after_steps(const std::string& scene, Method method) {
  World world = scene == "compounds" ? compounds(method) : shipped(scene, method);
  for (int i = 0; i < 20; ++i) world.step();
  return world;
}

/// Changes one to eight bytes at random, behind the snapshot's header.
std::string changed(const std::string& bytes, std::mt19937* random) {
  std::string forged = bytes;
  const std::size_t start = bytes.find('\n') + 1;
  const std::size_t at = start + (*random)() % (bytes.size() - start - 8);
  static const std::uint64_t kNumbers[] = {0,
                                           1,
                                           0xff,
                                           0x7fffffff,
                                           0xffffffff,
                                           0x7fffffffffffffff,
                                           0x7ff0000000000000,
                                           0xfff8000000000001};
  switch ((*random)() % 4) {
    case 0:
      forged[at] = static_cast<char>((*random)());
      break;
    case 1:
      forged[at] = static_cast<char>(forged[at] ^ (1 << ((*random)() % 8)));
      break;
    case 2: {
      const std::uint64_t number = kNumbers[(*random)() % std::size(kNumbers)];
      const std::size_t size = (*random)() % 2 == 0 ? 4 : 8;
      forged.replace(at, size, reinterpret_cast<const char*>(&number), size);
      break;
    }
    default:  // bytes from elsewhere
      forged.replace(at, 8, bytes, start + (*random)() % (bytes.size() - start - 8), 8);
  }
  return forged;
}

TEST(ForgedSnapshots, AreRefusedOrGiveAWorldThatCanBeStepped) {
  std::mt19937 random(17);
  int refused = 0, stepped = 0;
  for (const char* scene : kScenes) {
    for (const Method method : {Method::kAuto, Method::kEnergyMomentum, Method::kEventDriven,
                                Method::kSequentialImpulses}) {
      SCOPED_TRACE(std::string(scene) + " by " + name(method));
      const std::string bytes = write_snapshot(after_steps(scene, method));
      ASSERT_EQ(write_snapshot(read_world(bytes, true)), bytes);
      for (int i = 0; i < kChanges / 4; ++i) {
        const std::string forged = changed(bytes, &random);
        try {
          World world = read_world(forged, false);
          world.state_hash();
          // only where a step is cheap
          if (world.options().time_step <= 0.1 && world.options().threads <= 4)
            for (int k = 0; k < 2; ++k) world.step();
          ++stepped;
        } catch (const SnapshotError& error) {
          EXPECT_EQ(std::string(error.what()).find("snapshot: "), 0u);
          ++refused;
        }
        if (forged != bytes) {
          EXPECT_THROW(read_snapshot(forged), SnapshotError);
        }
      }
    }
  }
  // both occur
  EXPECT_GT(refused, 50);
  EXPECT_GT(stepped, 50);
}

TEST(ForgedSnapshots, ThatAreCutOffAreRefused) {
  const std::string bytes = write_snapshot(after_steps("two_boxes", Method::kAuto));
  std::mt19937 random(3);
  for (int i = 0; i < 200; ++i)
    EXPECT_THROW(read_world(bytes.substr(0, random() % bytes.size()), false), SnapshotError);
  EXPECT_THROW(read_world(bytes + "more", false), SnapshotError);
}

}  // namespace
}  // namespace constraint_sim::engine
