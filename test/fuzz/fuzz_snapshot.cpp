// Snapshots: any bytes are read or rejected. Bytes depend on the build, so the corpus contains
// scenes: a scene becomes the snapshot of its world after some steps, and then is mutated. Sums and
// hashes are not checked, so that the data behind them is reached.

#include "checks.h"
#include "engine/snapshot/snapshot_checks.h"

using namespace constraint_sim;

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

namespace {

/// Returns the snapshot of a scene after up to 30 steps; empty for an invalid or large scene.
std::string snapshot_of(const std::string& scene, unsigned seed) {
  static fuzz::Watchdog watchdog;
  try {
    engine::World world = engine::load_scene(scene);
    if (!fuzz::is_small(world)) return "";
    watchdog.start(std::chrono::milliseconds(50));
    world.set_stop_flag(watchdog.flag());
    for (unsigned k = 0; k < seed % 31; ++k) world.step();
    world.set_stop_flag(nullptr);
    return engine::write_snapshot(world);
  } catch (const std::invalid_argument&) {
    return "";
  }
}

}  // namespace

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  const std::string given(reinterpret_cast<const char*>(data), size);
  if (!engine::is_snapshot(given)) {
    const std::string bytes = snapshot_of(given, seed);
    if (bytes.empty() || bytes.size() > most) return LLVMFuzzerMutate(data, size, most);
    std::copy(bytes.begin(), bytes.end(), data);
    return bytes.size();
  }
  const std::size_t start = given.find('\n') + 1;
  return start + LLVMFuzzerMutate(data + start, size - start, most - start);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::TimeLimit limit;
  static fuzz::Watchdog watchdog;
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  try {
    engine::read_snapshot(bytes);
  } catch (const engine::SnapshotError&) {
  }
  if (!engine::is_snapshot(bytes)) return 0;
  try {
    engine::World world = engine::read_world(bytes, false);
    if (!fuzz::is_small(world)) return 0;
    world.state_hash();
    watchdog.start(std::chrono::milliseconds(5));
    world.set_stop_flag(watchdog.flag());
    for (int k = 0; k < 2; ++k) world.step();
  } catch (const engine::SnapshotError&) {
  }
  return 0;
}
