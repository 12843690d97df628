#pragma once

// Helpers shared by the tests of robots.

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>

#include "support.h"
#include "test_paths.h"
#include "urdf/robot.h"

namespace constraint_sim {

inline std::string read_text(const std::string& path) {
  std::ifstream file(path);
  EXPECT_TRUE(file) << path;
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

inline std::string shipped_urdf(const std::string& name) {
  return read_text(CONSTRAINT_SIM_ROBOT_DIR "/" + name + ".urdf");
}
inline std::string shipped_extra(const std::string& name) {
  return read_text(CONSTRAINT_SIM_ROBOT_DIR "/" + name + ".yaml");
}

/// Returns the pose of a link in the world's frame, by its body.
inline Eigen::Isometry3d frame_of(const engine::World& world, const RobotLink& link) {
  const engine::BodyState& state = world.state(link.body);
  return Eigen::Translation3d(state.position) * state.orientation * link.in_body;
}

inline double distance(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff();
}

inline double position_of(const engine::World& world, const std::string& joint) {
  return world.joint_state(world.find_joint(joint)).coordinates[0].position;
}

}  // namespace constraint_sim
