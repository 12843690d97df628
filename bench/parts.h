#pragma once

#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Bodies and joints before they are a world.
struct Parts {
  std::vector<Body> bodies;
  std::vector<Joint> joints;              ///< whose bodies are those of `ends`
  std::vector<std::pair<int, int>> ends;  ///< into bodies; -1 of the world
};

/// Of the whole scene.
struct Placing {
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  bool is_reversed = false;  ///< bodies added from the last to the first
};

/// The world of these parts, all of it moved and turned, gravity too.
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
    world.add_joint(joint);
  }
  return world;
}

}  // namespace constraint_sim::engine
