#pragma once

#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Bodies and joints before they are added to a world.
struct Parts {
  std::vector<Body> bodies;
  /// Bodies of joints are given by `ends`, joints of couplings by their index here.
  std::vector<Joint> joints;
  std::vector<std::pair<int, int>> ends;  ///< indices into bodies; -1: the world
};

/// Pose of a whole scene, and the order of adding bodies.
struct Placing {
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  bool is_reversed = false;  ///< bodies added from the last to the first
};

/// Returns a pose for a body's frame relative to its present one, for a body with a shape pose.
/// Dynamic bodies get permuted axes, which keep the inertia diagonal; others get any rotation, and
/// static ones also another place. Planes keep their frame.
inline ShapePose other_frame(const Body& body) {
  if (std::holds_alternative<Plane>(body.shape)) return {};
  if (body.type == BodyType::kDynamic)
    return {Eigen::Vector3d::Zero(), Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5)};
  const bool moves =
      body.type == BodyType::kKinematic;  // the centre of a moving body stays on its straight line
  return {moves ? Eigen::Vector3d::Zero().eval() : Eigen::Vector3d(0.3, -0.2, 0.5),
          Eigen::Quaterniond(0.7, 0.1, -0.5, 0.5)};
}

/// Returns the body described in another frame, with a pose of its shape.
inline Body in_frame(Body body, const ShapePose& frame) {
  if (std::holds_alternative<Plane>(body.shape)) return body;
  if (body.type == BodyType::kDynamic) {
    const Eigen::Vector3d inertia = body.inertia.isZero(0.0)
                                        ? Eigen::Vector3d(body.mass * unit_inertia(body.shape))
                                        : body.inertia;
    body.inertia = (frame.orientation.conjugate() * inertia).cwiseAbs();
  }
  BodyState& state = body.state;
  const Eigen::Vector3d arm = state.orientation * frame.position;
  state.position += arm;
  state.linear_velocity += state.angular_velocity.cross(arm);
  state.orientation = state.orientation * frame.orientation;
  const Eigen::Quaterniond back = frame.orientation.conjugate();
  body.shape_pose = ShapePose{back * Eigen::Vector3d(-frame.position), back};
  return body;
}

/// Returns the body with its shape, which has a pose, as the first part of a compound. The second
/// part is a small sphere within it, which touches nothing.
inline Body in_parts(Body body) {
  if (!body.shape_pose) return body;
  constexpr double kSmall = 0.1;
  double radius = 0.0;
  if (const auto* sphere = std::get_if<Sphere>(&body.shape)) radius = sphere->radius;
  if (const auto* box = std::get_if<Box>(&body.shape)) radius = box->size.minCoeff();
  if (!(radius > 0.0)) return body;
  body.shape =
      Compound({{body.shape, *body.shape_pose}, {Sphere{kSmall * radius}, *body.shape_pose}});
  body.shape_pose.reset();
  return body;
}

/// Transforms a joint's end to another frame of its body.
inline void put_in_frame(const ShapePose& frame, bool is_a, Joint* joint) {
  const Eigen::Quaterniond back = frame.orientation.conjugate();
  Eigen::Vector3d& anchor = is_a ? joint->anchor_a : joint->anchor_b;
  anchor = back * Eigen::Vector3d(anchor - frame.position);
  if (is_a) joint->frame_a = back * joint->frame_a;
  if (!is_a && joint->frame_b) joint->frame_b = back * *joint->frame_b;
  if (!is_a && joint->axis_b) joint->axis_b = back * *joint->axis_b;
}

/// Builds the world of these parts, all of it moved and turned, gravity too.
inline World assemble(const Parts& parts, WorldOptions options, const Placing& placing) {
  options.gravity = placing.turn * options.gravity;
  World world(options);
  const int count = static_cast<int>(parts.bodies.size());
  std::vector<BodyId> ids(parts.bodies.size());
  for (int k = 0; k < count; ++k) {
    const auto i = static_cast<std::size_t>(placing.is_reversed ? count - 1 - k : k);
    Body body = parts.bodies[i];
    body.state.position = placing.shift + placing.turn * body.state.position;
    body.state.orientation = placing.turn * body.state.orientation;
    body.state.linear_velocity = placing.turn * body.state.linear_velocity;
    body.state.angular_velocity = placing.turn * body.state.angular_velocity;
    ids[i] = world.add_body(body);
  }
  std::vector<JointId> joints;
  for (std::size_t j = 0; j < parts.joints.size(); ++j) {
    Joint joint = parts.joints[j];
    const auto [a, b] = parts.ends[j];
    if (a < 0) {
      joint.anchor_a = placing.shift + placing.turn * joint.anchor_a;
      joint.frame_a = placing.turn * joint.frame_a;
    } else {
      joint.body_a = ids[static_cast<std::size_t>(a)];
    }
    joint.body_b = ids[static_cast<std::size_t>(b)];
    if (info(joint.kind).couples_joints)
      for (JointId* id : {&joint.coupling.first, &joint.coupling.second}) *id = joints[id->value];
    joints.push_back(world.add_joint(joint));
  }
  return world;
}

}  // namespace constraint_sim::engine
