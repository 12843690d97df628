#include "runner/constraints.h"

#include <cmath>
#include <sstream>
#include <string>
#include <vector>

#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

/// Returns the coordinates of a constraint, counting whole turns [m or rad]; for a distance
/// constraint its length [m].
std::vector<double> coordinates_of(const World& world, JointId id) {
  const Joint& joint = world.joint(id);
  if (joint.kind == JointKind::kDistance) {
    const World::Anchors anchors = world.anchors(id);
    return {(anchors.p_b - anchors.p_a).norm()};
  }
  std::vector<double> list;
  for (int i = 0; i < info(joint.kind).coordinates; ++i)
    list.push_back(world.joint_state(id).coordinates[static_cast<std::size_t>(i)].position);
  return list;
}

}  // namespace

std::string constraint_csv_header() {
  return "time,constraint,q0,q1,q2,error,force,fx,fy,fz,tx,ty,tz\n";
}

std::string constraint_csv_rows(const World& world) {
  std::ostringstream out;
  const std::string time = shortest(world.time());
  for (const JointId id : world.joint_ids()) {
    const Joint& joint = world.joint(id);
    out << time << ',' << joint.name;
    const std::vector<double> coordinates = coordinates_of(world, id);
    for (std::size_t i = 0; i < kMaxCoordinates; ++i)
      out << ',' << (i < coordinates.size() ? shortest(coordinates[i]) : "");
    const JointState& state = world.joint_state(id);
    out << ',' << (std::isfinite(state.error) ? shortest(state.error) : "") << ','
        << shortest(state.force);
    if (info(joint.kind).couples_joints) {  // acts along coordinates of other joints
      out << ",,,,,,\n";
      continue;
    }
    const World::JointWrench wrench = world.joint_wrench(id);
    Eigen::Matrix<double, 6, 1> numbers;
    numbers << wrench.force, wrench.torque;
    for (Eigen::Index i = 0; i < numbers.size(); ++i) out << ',' << shortest(numbers[i]);
    out << '\n';
  }
  return out.str();
}

nlohmann::json constraints_of(const World& world) {
  nlohmann::json constraints = nlohmann::json::object();
  for (const JointId id : world.joint_ids()) {
    const Joint& joint = world.joint(id);
    const JointState& state = world.joint_state(id);
    nlohmann::json& constraint = constraints[joint.name];
    constraint = {
        {"type", name(joint.kind)}, {"coordinates", coordinates_of(world, id)},
        {"error", state.error},     {"angle_error", state.angle_error},
        {"effort", state.force},    {"broken", state.broken},
    };
    if (info(joint.kind).couples_joints) continue;
    const World::JointWrench wrench = world.joint_wrench(id);
    constraint["force"] = std::vector<double>(wrench.force.data(), wrench.force.data() + 3);
    constraint["torque"] = std::vector<double>(wrench.torque.data(), wrench.torque.data() + 3);
  }
  return constraints;
}

}  // namespace constraint_sim::engine
