#include "urdf/urdf_text.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "engine/math/elementary.h"
#include "engine/math/numbers.h"
#include "urdf/parse.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {
namespace {

std::string xml_number(double value) {
  constexpr double kLargest = 1e16;  // URDF has no infinity
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", std::clamp(value, -kLargest, kLargest));
  return text;
}

std::string xml_vector(const Eigen::Vector3d& v) {
  return xml_number(v.x()) + " " + xml_number(v.y()) + " " + xml_number(v.z());
}

std::string escaped_xml(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '&')
      escaped += "&amp;";
    else if (c == '<')
      escaped += "&lt;";
    else if (c == '"')
      escaped += "&quot;";
    else
      escaped += c;
  }
  return escaped;
}

/// Returns roll, pitch and yaw [rad] that give a rotation to rounding, also at a pitch of 90°.
Eigen::Vector3d rpy_of(const Eigen::Matrix3d& R) {
  using engine::math::atan2;
  const double yaw = atan2(R(1, 0), R(0, 0));
  const auto [s, c] = engine::math::sin_cos(yaw);
  return {atan2(s * R(0, 2) - c * R(1, 2), c * R(1, 1) - s * R(0, 1)),
          atan2(-R(2, 0), c * R(0, 0) + s * R(1, 0)), yaw};
}

std::string origin_text(const urdf::Pose& pose) {
  const Eigen::Isometry3d at = constraint_sim::to_isometry(pose);
  return "<origin xyz=\"" + xml_vector(at.translation()) + "\" rpy=\"" +
         xml_vector(rpy_of(at.linear())) + "\"/>";
}

std::string geometry_text(const urdf::Geometry& geometry) {
  const auto in_element = [](const std::string& shape) {
    return "<geometry>" + shape + "</geometry>";
  };
  switch (geometry.type) {
    case urdf::Geometry::SPHERE:
      return in_element("<sphere radius=\"" +
                        xml_number(static_cast<const urdf::Sphere&>(geometry).radius) + "\"/>");
    case urdf::Geometry::BOX:
      return in_element("<box size=\"" +
                        xml_vector(to_eigen(static_cast<const urdf::Box&>(geometry).dim)) + "\"/>");
    case urdf::Geometry::CYLINDER: {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
      return in_element("<cylinder radius=\"" + xml_number(cylinder.radius) + "\" length=\"" +
                        xml_number(cylinder.length) + "\"/>");
    }
    case urdf::Geometry::MESH: {
      const auto& mesh = static_cast<const urdf::Mesh&>(geometry);
      return in_element("<mesh filename=\"" + escaped_xml(mesh.filename) + "\" scale=\"" +
                        xml_vector(to_eigen(mesh.scale)) + "\"/>");
    }
  }
  throw std::invalid_argument("urdf: a link has a geometry of the unknown type " +
                              std::to_string(static_cast<int>(geometry.type)));
}

bool is_of_urdf(const urdf::Geometry& geometry) {
  const bool is_nameless_mesh = geometry.type == urdf::Geometry::MESH &&
                                static_cast<const urdf::Mesh&>(geometry).filename.empty();
  return !is_nameless_mesh && dynamic_cast<const CapsuleGeometry*>(&geometry) == nullptr &&
         dynamic_cast<const PlaneGeometry*>(&geometry) == nullptr;
}

std::string link_text(const urdf::Link& link) {
  std::string text = "<link name=\"" + escaped_xml(link.name) + "\">\n";
  if (link.inertial) {
    const urdf::Inertial& inertial = *link.inertial;
    const auto moment = [](const char* name, double value) {
      return std::string(" ") + name + "=\"" + xml_number(value) + "\"";
    };
    text += "<inertial>" + origin_text(inertial.origin) + "<mass value=\"" +
            xml_number(inertial.mass) + "\"/><inertia" + moment("ixx", inertial.ixx) +
            moment("ixy", inertial.ixy) + moment("ixz", inertial.ixz) +
            moment("iyy", inertial.iyy) + moment("iyz", inertial.iyz) +
            moment("izz", inertial.izz) + "/></inertial>\n";
  }
  for (const auto& visual : link.visual_array) {
    if (!is_of_urdf(*visual->geometry)) continue;
    text += "<visual>" + origin_text(visual->origin) + geometry_text(*visual->geometry);
    if (visual->material) {
      const urdf::Color& colour = visual->material->color;
      text += "<material name=\"" + escaped_xml(visual->material->name) + "\"><color rgba=\"" +
              xml_vector({colour.r, colour.g, colour.b}) + " " + xml_number(colour.a) +
              "\"/></material>";
    }
    text += "</visual>\n";
  }
  for (const auto& collision : link.collision_array)
    if (is_of_urdf(*collision->geometry))
      text += "<collision>" + origin_text(collision->origin) + geometry_text(*collision->geometry) +
              "</collision>\n";
  return text + "</link>\n";
}

const char* type_text(const urdf::Joint& joint) {
  switch (joint.type) {
    case urdf::Joint::REVOLUTE:
      return "revolute";
    case urdf::Joint::CONTINUOUS:
      return "continuous";
    case urdf::Joint::PRISMATIC:
      return "prismatic";
    case urdf::Joint::FLOATING:
      return "floating";
    case urdf::Joint::PLANAR:
      return "planar";
    default:
      return "fixed";
  }
}

std::string joint_text(const urdf::Joint& joint) {
  const auto named = [](const char* element, const std::string& link) {
    return std::string("<") + element + " link=\"" + escaped_xml(link) + "\"/>";
  };
  std::string text = "<joint name=\"" + escaped_xml(joint.name) + "\" type=\"" + type_text(joint) +
                     "\">" + named("parent", joint.parent_link_name) +
                     named("child", joint.child_link_name) +
                     origin_text(joint.parent_to_joint_origin_transform);
  const bool is_fixed = joint.type == urdf::Joint::FIXED || joint.type == urdf::Joint::FLOATING;
  if (!is_fixed) text += "<axis xyz=\"" + xml_vector(to_eigen(joint.axis)) + "\"/>";
  const bool needs_limit =
      joint.type == urdf::Joint::REVOLUTE || joint.type == urdf::Joint::PRISMATIC;
  if (joint.limits || needs_limit) {
    const urdf::JointLimits limits = joint.limits ? *joint.limits : urdf::JointLimits();
    const double most = joint.limits ? limits.upper : engine::kInfinity;
    const double least = joint.limits ? limits.lower : -engine::kInfinity;
    text += "<limit lower=\"" + xml_number(least) + "\" upper=\"" + xml_number(most) +
            "\" effort=\"" + xml_number(limits.effort) + "\" velocity=\"" +
            xml_number(limits.velocity) + "\"/>";
  }
  if (joint.dynamics)
    text += "<dynamics damping=\"" + xml_number(joint.dynamics->damping) + "\" friction=\"" +
            xml_number(joint.dynamics->friction) + "\"/>";
  return text + "</joint>\n";
}

}  // namespace

std::string urdf_text(const urdf::ModelInterface& model) {
  std::string text = "<robot name=\"" + escaped_xml(model.getName()) + "\">\n";
  for (const auto& [name, link] : model.links_) text += link_text(*link);
  for (const auto& [name, joint] : model.joints_) text += joint_text(*joint);
  return text + "</robot>\n";
}

}  // namespace constraint_sim
