// Builds a pendulum in a running simulator and lets it swing for a second; rosrun constraint_sim
// client_example, with a node running. Another package needs find_package(catkin REQUIRED
// COMPONENTS constraint_sim roscpp) and nothing else for it.

#include <constraint_sim/ApplyEdits.h>
#include <constraint_sim/GetBodyState.h>
#include <constraint_sim/Step.h>
#include <ros/ros.h>
#include <std_srvs/Empty.h>

#include <cstdio>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace {

/// Calls a service of the simulator; throws what it is refused with.
template <class Service>
typename Service::Response call(const std::string& name, typename Service::Request request = {}) {
  typename Service::Response response;
  const std::string service = "/constraint_sim/" + name;
  if (!ros::service::waitForService(service, ros::Duration(10.0)) ||
      !ros::service::call(service, request, response))
    throw std::runtime_error("no answer from " + service);
  if constexpr (!std::is_same_v<Service, std_srvs::Empty>)
    if (!response.success) throw std::runtime_error(name + ": " + response.status_message);
  return response;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "client_example", ros::init_options::AnonymousName);
  const ros::NodeHandle handle;
  try {
    call<std_srvs::Empty>("pause_physics");
    constraint_sim::ApplyEditsRequest edits;  // both in one tick, or neither
    edits.bodies.resize(1);
    constraint_sim::Body& bob = edits.bodies[0];
    bob.name = "example_bob";
    bob.shapes.resize(1);
    bob.shapes[0].type = constraint_sim::Shape::SPHERE;
    bob.shapes[0].dimensions = {0.1};
    bob.mass = 1.0;
    bob.pose.position.x = 1.0;
    edits.constraints.resize(1);
    constraint_sim::Constraint& rod = edits.constraints[0];
    rod.name = "example_rod";
    rod.type = "distance";
    rod.body_b = bob.name;
    call<constraint_sim::ApplyEdits>("apply_edits", edits);

    constraint_sim::StepRequest steps;
    steps.steps = 100;
    call<constraint_sim::Step>("step", steps);
    constraint_sim::GetBodyStateRequest body;
    body.name = bob.name;
    const auto position =
        call<constraint_sim::GetBodyState>("get_body_state", body).state.pose.position;
    std::printf("after 100 steps: x = %.6f m, z = %.6f m\n", position.x, position.z);
    call<std_srvs::Empty>("unpause_physics");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "client_example: %s\n", error.what());
    return 1;
  }
  return 0;
}
