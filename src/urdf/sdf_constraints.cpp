#include "urdf/sdf_constraints.h"

#include <cmath>
#include <cstdio>

namespace constraint_sim {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

std::string exact_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

std::string yaml_list(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + exact_number(value);
  return "[" + text + "]";
}

/// Returns the laws of a coordinate as the keys and values of a YAML map, without braces.
std::string laws_text(const SdfAxis& axis) {
  std::string text;
  const auto law = [&](const char* key, double value) {
    text += (text.empty() ? "" : ", ") + std::string(key) + ": " + exact_number(value);
  };
  if (std::isfinite(axis.lower)) law("lower", axis.lower);
  if (std::isfinite(axis.upper)) law("upper", axis.upper);
  if (axis.damping != 0.0) law("damping", axis.damping);
  if (axis.friction != 0.0) law("friction", axis.friction);
  if (axis.spring.stiffness != 0.0) {
    law("stiffness", axis.spring.stiffness);
    law("rest", axis.spring.rest);
  }
  return text;
}

}  // namespace

void SdfConstraints::begin(const std::string& name, const char* type) {
  text_ += "- name: \"" + name + "\"\n  type: " + type + "\n";
}

void SdfConstraints::add_end(const char* side, const End& end, bool has_frame) {
  const Vector3d& p = end.frame.translation();
  const Quaterniond q(end.frame.linear());
  text_ += std::string("  body_") + side + ": \"" + end.link + "\"\n  anchor_" + side + ": " +
           yaml_list({p.x(), p.y(), p.z()}) + "\n";
  if (has_frame)
    text_ += std::string("  frame_") + side + ": " + yaml_list({q.x(), q.y(), q.z(), q.w()}) + "\n";
}

void SdfConstraints::add(const char* key, double value) {
  text_ += std::string("  ") + key + ": " + exact_number(value) + "\n";
}

void SdfConstraints::add_coordinates(const std::vector<SdfAxis>& axes) {
  text_ += "  coordinates:\n";
  for (const SdfAxis& axis : axes) text_ += "  - {" + laws_text(axis) + "}\n";
}

void SdfConstraints::add_joints(const std::string& first, const std::string& second) {
  text_ += "  joints: [\"" + first + "\", \"" + second + "\"]\n";
}

std::vector<engine::YamlElement> SdfConstraints::take() const {
  std::vector<engine::YamlElement> elements;
  if (text_.empty()) return elements;
  for (const engine::YamlElement& item :
       engine::YamlElement::parse("constraints:\n" + text_, "sdf").at("constraints").items())
    elements.push_back(item);
  return elements;
}

}  // namespace constraint_sim
