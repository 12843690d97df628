// Costs of markers in a scene: rounds of messages as in the node, in functions whose instructions
// marker_costs.py counts. Markers are updated and serialized as by the node for a subscriber; a
// visualization_msgs/MarkerArray with this content is serialized by roscpp. Prints the number of
// markers, and of bytes either way.
//
//   constraint_sim_marker_costs SCENE ROUNDS

#include <ros/serialization.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdio>
#include <exception>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "ros/markers.h"
#include "ros/parameters.h"
#include "ros/robots.h"

namespace constraint_sim {
namespace {

constexpr double kRate = 50.0;  // rounds per simulated second, as publish_rate

visualization_msgs::MarkerArray array_of(const MarkerMessage& message) {
  visualization_msgs::MarkerArray array;
  for (const visualization_msgs::Marker* marker : message.markers) array.markers.push_back(*marker);
  return array;
}

// Separate functions, so that their instructions are counted separately.
[[gnu::noinline]] const MarkerMessage& find_markers(const engine::World& world,
                                                    const ros::Time& stamp, ForceScale* forces,
                                                    Markers* markers) {
  forces->update(world, stamp);
  return markers->update(world, *forces, stamp, false, false);
}

[[gnu::noinline]] std::size_t serialise_markers(const MarkerMessage& message) {
  return ros::serialization::serializeMessage(message).num_bytes;
}

[[gnu::noinline]] std::size_t serialise_array(const visualization_msgs::MarkerArray& array) {
  return ros::serialization::serializeMessage(array).num_bytes;
}

int run(const std::string& path, int rounds) {
  engine::World world = engine::load_scene_file(path);
  Robots robots{Parameters()};
  Markers markers("world", robots);
  ForceScale forces;
  std::size_t count = 0, bytes = 0, bytes_of_arrays = 0;
  double next = 0.0;
  engine::World snapshot = world;
  for (int round = 0; round < rounds; ++round) {
    for (next += 1.0 / kRate; world.time() < next;) world.step();
    world.take_snapshot(&snapshot);
    const ros::Time stamp(1.0 + snapshot.time());
    const MarkerMessage& message = find_markers(snapshot, stamp, &forces, &markers);
    count += message.markers.size();
    bytes += serialise_markers(message);
    bytes_of_arrays += serialise_array(array_of(message));
  }
  std::printf("%zu %zu %zu\n", count, bytes, bytes_of_arrays);
  return 0;
}

}  // namespace
}  // namespace constraint_sim

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("constraint_sim_marker_costs SCENE ROUNDS\n", stderr);
    return 2;
  }
  try {
    return constraint_sim::run(argv[1], std::stoi(argv[2]));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "constraint_sim_marker_costs: %s\n", error.what());
    return 2;
  }
}
