// What markers cost in a scene: rounds of messages as the node has them, with what is named done in
// each. marker_costs.py counts the instructions of each.
//
//   constraint_sim_marker_costs SCENE nothing|update|publish|copy|serialise ROUNDS
//
// nothing: only steps and the copies of the world that messages are made from; update: the markers
// as well; publish: these are serialised as the node does it, for a listener; copy: after `update`,
// a visualization_msgs/MarkerArray of the same content; serialise: that is serialised as roscpp
// does it. Prints how many markers that was, and how many bytes.

#include <ros/serialization.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "ros/markers.h"
#include "ros/parameters.h"
#include "ros/robots.h"

namespace constraint_sim {
namespace {

constexpr double kRate = 50.0;  // rounds a simulated second, as publish_rate

visualization_msgs::MarkerArray array_of(const MarkerMessage& message) {
  visualization_msgs::MarkerArray array;
  for (const visualization_msgs::Marker* marker : message.markers) array.markers.push_back(*marker);
  return array;
}

int run(const std::string& path, const std::string& what, int rounds) {
  engine::World world = engine::load_scene_file(path);
  Robots robots{Parameters()};
  Markers markers("world", robots);
  ForceScale forces;
  // what happens first of all, so that what is counted later does not change what the steps take
  std::vector<engine::World> snapshots(static_cast<std::size_t>(rounds));
  double next = 0.0;
  for (engine::World& snapshot : snapshots) {
    for (next += 1.0 / kRate; world.time() < next;) world.step();
    world.take_snapshot(&snapshot);
  }
  std::size_t bytes = 0, sent = 0;
  for (const engine::World& snapshot : snapshots) {
    const ros::Time stamp(1.0 + snapshot.time());
    if (what == "nothing") continue;
    forces.update(snapshot, stamp);
    const MarkerMessage& message = markers.update(snapshot, forces, stamp, false, false);
    sent += message.markers.size();
    if (what == "update") continue;
    if (what == "publish") {
      bytes += ros::serialization::serializeMessage(message).num_bytes;
      continue;
    }
    const visualization_msgs::MarkerArray array = array_of(message);
    if (what == "copy") continue;
    bytes += ros::serialization::serializeMessage(array).num_bytes;
  }
  std::printf("%zu %zu\n", sent, bytes);
  return 0;
}

}  // namespace
}  // namespace constraint_sim

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fputs("constraint_sim_marker_costs SCENE nothing|update|publish|copy|serialise ROUNDS\n",
               stderr);
    return 2;
  }
  try {
    return constraint_sim::run(argv[1], argv[2], std::stoi(argv[3]));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "constraint_sim_marker_costs: %s\n", error.what());
    return 2;
  }
}
