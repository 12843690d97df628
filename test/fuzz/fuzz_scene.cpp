// Scenes: any text is loaded or rejected. A scene that is loaded can be stepped, saved and loaded
// again.

#include "checks.h"

using namespace constraint_sim;

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  fuzz::initialize(*argc, *argv);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::TimeLimit limit;
  static fuzz::Watchdog watchdog;
  const std::string text(reinterpret_cast<const char*>(data), size);
  try {
    engine::World world = engine::load_scene(text);
    if (!fuzz::is_small(world)) return 0;
    fuzz::KnownHash hash;
    const std::uint64_t digest = fuzz::digest(data, size);
    for (int k = 0; k < 3; ++k)
      fuzz::step(&watchdog, fuzz::step_interval(digest / 8), &world, &hash);
    if (fuzz::is_one_of(8, digest)) fuzz::check_saved(world);
    fuzz::check_snapshot(world, &hash);
  } catch (const engine::SceneError& error) {
    fuzz::require(std::string(error.what()).find('\n') == std::string::npos,
                  "an answer has several lines");
  }
  return 0;
}
