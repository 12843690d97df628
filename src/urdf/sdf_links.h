#pragma once

#ifdef CONSTRAINT_SIM_READS_SDF

#include <Eigen/Geometry>
#include <sdf/sdf.hh>
#include <string>

#include "urdf/parse.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {

// Parts of an SDF that libsdformat has parsed, for sdf_model.cpp.

/// Throws std::invalid_argument with the first error of libsdformat, if there is any.
void check_sdf_errors(const sdf::Errors& errors);

/// Converts a pose of libsdformat. Throws std::invalid_argument that names `owner` where a number
/// is not finite.
template <class Pose>
Eigen::Isometry3d sdf_pose(const Pose& pose, const std::string& owner) {
  const Eigen::Vector3d p(pose.Pos().X(), pose.Pos().Y(), pose.Pos().Z());
  const Eigen::Quaterniond q(pose.Rot().W(), pose.Rot().X(), pose.Rot().Y(), pose.Rot().Z());
  if (!p.allFinite() || !q.coeffs().allFinite() || !(q.norm() > 0.5))
    refuse(owner + " has a pose that is not finite");
  return Eigen::Translation3d(p) * q.normalized();
}

/// Returns a pose in the frame `resolve_to`; empty: in the default frame. Throws
/// std::invalid_argument that names `owner` where the pose does not resolve or is not finite.
Eigen::Isometry3d resolved_pose(const sdf::SemanticPose& pose, const std::string& owner,
                                const std::string& resolve_to = "");

/// Returns whether a child element has the value true; `otherwise` without the element.
bool sdf_flag(const sdf::ElementPtr& element, const std::string& child, bool otherwise);

/// Returns a link with its inertia, shapes and visuals, and adds its properties to `model`.
urdf::LinkSharedPtr read_sdf_link(const sdf::Link& link, const std::string& name, bool is_static,
                                  const std::string& folder, SdfModel* model);

}  // namespace constraint_sim

#endif
