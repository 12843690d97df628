#include "urdf/servo_sag.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <map>
#include <set>

#include "urdf/contact_exceptions.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using engine::BodyId;
using engine::JointId;
using engine::World;

std::string rounded(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

bool is_slider(const engine::Joint& joint) { return joint.kind == engine::JointKind::kSlider; }

/// The joints of a robot as a tree, with the mass behind each on which gravity acts.
class Tree {
 public:
  Tree(const Robot& robot, const World& world) : world_(world) {
    std::set<std::uint32_t> bodies;
    for (const std::string& name : robot.bodies) bodies.insert(world.find_body(name).value);
    for (const std::string& name : robot.constraints) add(world.find_joint(name), bodies);
    for (auto joint = joints_.rbegin(); joint != joints_.rend(); ++joint) sum(*joint);
  }

  const std::vector<JointId>& joints() const { return joints_; }

  /// Returns whether the links behind the joint hang on it alone.
  bool carries_alone(JointId joint) const { return shared_.count(joint.value) == 0; }

  /// Returns the torque of gravity about the axis of a hinge [N m], or its force along that of a
  /// slider [N].
  double effort(JointId id) const {
    const engine::Joint& joint = world_.joint(id);
    const Load& load = loads_.at(joint.body_b.value);
    const Vector3d axis =
        world_.state(joint.body_b).orientation * (*joint.frame_b * Vector3d::UnitZ());
    if (is_slider(joint)) return load.mass * world_.options().gravity.dot(axis);
    const Vector3d arm = load.moment - load.mass * world_.anchors(id).p_b;
    return arm.cross(world_.options().gravity).dot(axis);
  }

 private:
  /// Mass of a body and all bodies behind it, and its first moment about the world's origin.
  struct Load {
    double mass = 0.0;
    Vector3d moment = Vector3d::Zero();
    bool is_shared = false;
  };

  // Joints of the URDF come first, parents before children: the first joint to a body is the one
  // in the tree.
  void add(JointId id, const std::set<std::uint32_t>& bodies) {
    const engine::Joint& joint = world_.joint(id);
    if (is_contact_exception(joint)) return;
    if (engine::info(joint.kind).couples_joints) {
      shared_.insert(joint.coupling.first.value);
      shared_.insert(joint.coupling.second.value);
      return;
    }
    const bool is_in_tree = bodies.count(joint.body_b.value) > 0 &&
                            bodies.count(joint.body_a.value) > 0 &&
                            children_.insert(joint.body_b.value).second;
    if (is_in_tree) return joints_.push_back(id);
    for (const BodyId body : {joint.body_a, joint.body_b}) loads_[body.value].is_shared = true;
  }

  // Adds a body, whose children are done, to its parent.
  void sum(JointId id) {
    const engine::Joint& joint = world_.joint(id);
    Load& load = loads_[joint.body_b.value];
    const engine::Body& body = world_.body(joint.body_b);
    const double mass = (1.0 - body.gravity_compensation) * body.mass;
    load.mass += mass;
    load.moment += mass * world_.state(joint.body_b).position;
    if (load.is_shared) shared_.insert(id.value);
    Load& parent = loads_[joint.body_a.value];
    parent.mass += load.mass;
    parent.moment += load.moment;
    parent.is_shared = parent.is_shared || load.is_shared;
  }

  const World& world_;
  std::vector<JointId> joints_;          // parents first
  std::set<std::uint32_t> children_;     // bodies that a joint of the tree carries
  std::map<std::uint32_t, Load> loads_;  // by body
  std::set<std::uint32_t> shared_;       // joints whose links others carry too
};

const engine::Motor* servo_of(const engine::Joint& joint) {
  const auto& motor = joint.coordinates[0].motor;
  const bool has_servo = joint.kind == engine::JointKind::kHinge || is_slider(joint);
  return has_servo && motor && motor->is_servo() ? &*motor : nullptr;
}

/// Returns the efforts of the joints where rigid motors hold all of them [N m]. A copy of the world
/// makes a short step for it. Empty where the physics fails.
std::map<std::uint32_t, double> holding_efforts(World world, const std::vector<JointId>& joints) {
  engine::WorldOptions options = world.options();
  options.time_step = 1e-4;
  world.set_options(options);
  for (const JointId id : joints) {
    engine::Motor rigid;
    rigid.position = world.joint_state(id).coordinates[0].position;
    world.set_motor(id, 0, rigid);
  }
  std::map<std::uint32_t, double> efforts;
  if (world.step().outcome.failed) return efforts;
  for (const JointId id : joints) efforts[id.value] = world.joint_state(id).coordinates[0].effort;
  return efforts;
}

}  // namespace

std::vector<std::string> sagging_servos(const Robot& robot, const World& world) {
  const Tree tree(robot, world);
  std::vector<JointId> servos;
  bool all_alone = true;
  for (const JointId id : tree.joints()) {
    if (servo_of(world.joint(id)) == nullptr) continue;
    servos.push_back(id);
    all_alone = all_alone && tree.carries_alone(id);
  }
  const auto efforts =
      all_alone ? std::map<std::uint32_t, double>() : holding_efforts(world, servos);
  std::vector<std::string> sentences;
  for (const JointId id : servos) {
    const engine::Joint& joint = world.joint(id);
    const auto effort = efforts.find(id.value);
    if (!tree.carries_alone(id) && effort == efforts.end()) continue;
    const double carried = std::abs(tree.carries_alone(id) ? tree.effort(id) : effort->second);
    const double sag = carried / servo_of(joint)->servo_stiffness;
    if (!(sag > kMostServoSag)) continue;
    const double needed = 1.01 * carried / kMostServoSag;  // more than the printed digits round off
    const std::string unit = is_slider(joint) ? " m" : " rad";
    sentences.push_back("joint '" + joint.name + "': gravity alone " +
                        (is_slider(joint) ? "moves" : "turns") + " its servo by " + rounded(sag) +
                        unit + "; servo_stiffness " + rounded(needed) +
                        (is_slider(joint) ? " N/m" : " N m/rad") + " keeps that below " +
                        rounded(kMostServoSag) + unit + ", and a position without servo holds it");
  }
  return sentences;
}

}  // namespace constraint_sim
