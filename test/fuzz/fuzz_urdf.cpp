// Robots: any URDF, with any extra YAML, is added or rejected. The YAML follows the last line that
// begins with `---`. An added robot can be stepped.

#include "checks.h"
#include "urdf/robot.h"

using namespace constraint_sim;

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  fuzz::initialize(*argc, *argv);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::TimeLimit limit;
  static fuzz::Watchdog watchdog;
  std::string urdf(reinterpret_cast<const char*>(data), size);
  RobotOptions options;
  const std::size_t end = urdf.rfind("\n---");
  if (end != std::string::npos) {
    options.extra = urdf.substr(end + 4);
    urdf.resize(end);
  }
  engine::World world;
  const std::uint64_t before = world.state_hash();
  try {
    add_robot(urdf, options, &world);
  } catch (const std::invalid_argument&) {
    fuzz::require(world.state_hash() == before, "a rejected robot has changed the world");
    return 0;
  }
  if (!fuzz::is_small(world)) return 0;
  fuzz::KnownHash hash;
  const std::uint64_t digest = fuzz::digest(data, size);
  for (int k = 0; k < 2; ++k) fuzz::step(&watchdog, fuzz::step_interval(digest / 8), &world, &hash);
  if (fuzz::is_one_of(8, digest)) fuzz::check_saved(world);
  fuzz::check_snapshot(world, &hash);
  return 0;
}
