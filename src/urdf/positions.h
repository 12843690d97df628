#pragma once

#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <map>
#include <string>
#include <vector>

namespace constraint_sim {

/// Returns whether a joint has one coordinate, which is named after it.
bool has_position(const urdf::Joint& joint);

/// Returns the orientation of the joint's frame, with z along its axis. Throws
/// std::invalid_argument for an axis without direction.
Eigen::Quaterniond along_axis(const urdf::Joint& joint);

/// Returns the pose of the joint's frame on the child in its frame on the parent, at the position
/// in `positions`; identity for a joint without a position.
Eigen::Isometry3d motion_of(const urdf::Joint& joint,
                            const std::map<std::string, double>& positions);

/// Returns the joint that `joint` mimics. Throws std::invalid_argument where no such joint with a
/// position exists.
const urdf::Joint& leader_of(const urdf::ModelInterface& model, const urdf::Joint& joint);

/// Returns the initial positions of joints [m or rad]: given ones, those that follow from mimicked
/// joints, else 0, or the nearest limit with a warning. Throws std::invalid_argument for invalid
/// positions.
std::map<std::string, double> first_positions(const urdf::ModelInterface& model,
                                              const std::map<std::string, double>& given,
                                              std::vector<std::string>* warnings);

}  // namespace constraint_sim
