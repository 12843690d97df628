#include "urdf/parse.h"

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

#include "engine/math/elementary.h"
#include "sim/words.h"
#include "urdf/xml_tags.h"

namespace constraint_sim {
namespace {

// Limits for urdfdom: TinyXML parses nested elements recursively, and urdfdom frees links
// recursively from parent to child.
constexpr int kMostElementDepth = 64;
constexpr std::size_t kMostLinks = 10000;

/// Joints of a URDF as a graph; links are numbered here.
struct LinkGraph {
  std::vector<std::string> links;  ///< all link names in joints
  std::vector<std::pair<std::size_t, std::size_t>> joints;
};

/// Reads the joints. Throws where elements are nested too deep or are too many. A text that is no
/// URDF may give wrong joints here; urdfdom rejects it later.
LinkGraph read_joints(const std::string& text) {
  LinkGraph graph;
  std::map<std::string, std::size_t> numbers;
  const auto number_of = [&](const std::string& name) {
    if (name.find('&') != std::string::npos)
      refuse("a joint refers to link '" + shortened(name) + "': names have no entities");
    const auto [found, is_new] = numbers.emplace(name, graph.links.size());
    if (is_new) graph.links.push_back(name);
    return found->second;
  };
  int depth = 0;
  std::size_t links = 0;
  std::string parent, child;
  XmlTags tags(text);
  while (tags.next()) {
    const std::string name = tags.name();
    if (tags.kind() == XmlTags::Kind::kDeclaration) {
      // TinyXML ends a declaration elsewhere where a value has a `>`; depths would be wrong.
      if (depth > 0) refuse("has a declaration `<?` within an element");
      continue;
    }
    if (tags.kind() == XmlTags::Kind::kEnd) {
      depth = std::max(depth - 1, 0);
      if (depth != 1 || name != "joint" || parent.empty() || child.empty()) continue;
      graph.joints.emplace_back(number_of(parent), number_of(child));
      continue;
    }
    if (depth == 1 && name == "joint") parent = child = "";
    if (depth == 1 && name == "link" && ++links > kMostLinks)
      refuse("has more than " + std::to_string(kMostLinks) + " links");
    if (depth == 2 && name == "parent" && parent.empty()) parent = tags.attribute("link");
    if (depth == 2 && name == "child" && child.empty()) child = tags.attribute("link");
    if (tags.kind() == XmlTags::Kind::kStart && ++depth > kMostElementDepth)
      refuse("elements are nested more than " + std::to_string(kMostElementDepth) + " deep");
  }
  return graph;
}

/// Rejects cycles of links, whose memory urdfdom never frees. Removes links without parents one
/// after the other; remaining links are in a cycle, or behind one.
void check_cycles(const LinkGraph& graph) {
  std::vector<std::size_t> parents(graph.links.size(), 0), open;
  std::vector<std::vector<std::size_t>> children(graph.links.size());
  for (const auto& [parent, child] : graph.joints) {
    ++parents[child];
    children[parent].push_back(child);
  }
  for (std::size_t i = 0; i < parents.size(); ++i)
    if (parents[i] == 0) open.push_back(i);
  while (!open.empty()) {
    const std::size_t link = open.back();
    open.pop_back();
    for (const std::size_t child : children[link])
      if (--parents[child] == 0) open.push_back(child);
  }
  for (std::size_t i = 0; i < parents.size(); ++i)
    if (parents[i] > 0)
      refuse("link '" + shortened(graph.links[i]) + "' is in a cycle of joints, or behind one");
}

/// Collects the errors that urdfdom logs, since its result has no reason. One instance at a time.
class ParserErrors : public console_bridge::OutputHandler {
 public:
  ParserErrors() { console_bridge::useOutputHandler(this); }
  ~ParserErrors() override { console_bridge::restorePreviousOutputHandler(); }
  ParserErrors(const ParserErrors&) = delete;
  ParserErrors& operator=(const ParserErrors&) = delete;

  void log(const std::string& text, console_bridge::LogLevel level, const char*, int) override {
    if (level < console_bridge::CONSOLE_BRIDGE_LOG_ERROR) return;
    text_ += (text_.empty() ? "" : "; ") + text;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

urdf::ModelInterfaceSharedPtr parse(const std::string& text) {
  urdf::ModelInterfaceSharedPtr model;
  const std::string errors = errors_logged_by([&] { model = urdf::parseURDF(text); });
  if (!model || !errors.empty())
    refuse(errors.empty() ? "this is no robot description" : shortened(errors, 400));
  return model;
}

/// Rejects a link with several parents: urdfdom keeps only one.
void check_tree(const urdf::ModelInterface& model) {
  std::map<std::string, std::string> joint_of_child;
  for (const auto& [name, joint] : model.joints_) {
    const auto [other, is_first] = joint_of_child.emplace(joint->child_link_name, name);
    if (!is_first)
      refuse("link '" + joint->child_link_name + "' is the child of two joints, '" + other->second +
             "' and '" + name + "'; close loops by constraints beside the URDF");
  }
}

void check_geometries(const urdf::ModelInterface& model) {
  const auto check = [](const std::string& link, const urdf::GeometryConstSharedPtr& geometry) {
    if (!geometry) refuse("link '" + link + "' has a visual or collision without a geometry");
  };
  for (const auto& [name, link] : model.links_) {
    for (const auto& visual : link->visual_array) check(name, visual->geometry);
    for (const auto& collision : link->collision_array) check(name, collision->geometry);
  }
}

using engine::math::SineCosine;

/// Returns the quaternion of roll, pitch and yaw [rad] about fixed axes.
urdf::Rotation rotation_of(const urdf::Vector3& rpy) {
  const SineCosine roll = engine::math::sin_cos(0.5 * rpy.x),
                   pitch = engine::math::sin_cos(0.5 * rpy.y),
                   yaw = engine::math::sin_cos(0.5 * rpy.z);
  urdf::Rotation rotation;
  rotation.x = roll.sine * pitch.cosine * yaw.cosine - roll.cosine * pitch.sine * yaw.sine;
  rotation.y = roll.cosine * pitch.sine * yaw.cosine + roll.sine * pitch.cosine * yaw.sine;
  rotation.z = roll.cosine * pitch.cosine * yaw.sine - roll.sine * pitch.sine * yaw.cosine;
  rotation.w = roll.cosine * pitch.cosine * yaw.cosine + roll.sine * pitch.sine * yaw.sine;
  rotation.normalize();
  return rotation;
}

/// Makes the rotations of a description bit-identical on all machines. urdfdom converts `rpy` by
/// the sine of the C library and drops the angles; each rotation is replaced by the own conversion
/// of those angles in the text that agree to rounding.
class Rotations {
 public:
  explicit Rotations(const std::string& text) {
    constexpr const char* kSpace = " \t\r\n";
    for (std::size_t at = text.find("rpy"); at != std::string::npos; at = text.find("rpy", at)) {
      at = text.find_first_not_of(kSpace, at + 3);
      if (at == std::string::npos || text[at] != '=') continue;
      at = text.find_first_not_of(kSpace, at + 1);
      if (at == std::string::npos || (text[at] != '"' && text[at] != '\'')) continue;
      const std::size_t end = text.find(text[at], at + 1);
      if (end == std::string::npos) return;
      add(text.substr(at + 1, end - at - 1));
      at = end;
    }
  }

  void replace(urdf::Rotation* rotation) const {
    const urdf::Rotation& q = *rotation;
    const double key = key_of(q);
    for (auto at = by_key_.lower_bound(key - 4.0 * kRounding);
         at != by_key_.end() && at->first <= key + 4.0 * kRounding; ++at) {
      const urdf::Rotation& own = at->second;
      if (std::abs(own.x - q.x) > kRounding || std::abs(own.y - q.y) > kRounding ||
          std::abs(own.z - q.z) > kRounding || std::abs(own.w - q.w) > kRounding)
        continue;
      *rotation = own;
      return;
    }
  }

 private:
  static constexpr double kRounding = 1e-14;

  /// A number that differs for different rotations, except by coincidence.
  static double key_of(const urdf::Rotation& q) {
    return 0.37 * q.x + 0.61 * q.y + 0.83 * q.z + 0.29 * q.w;
  }

  void add(const std::string& angles) {
    urdf::Vector3 rpy;
    try {
      rpy.init(angles);
    } catch (const std::exception&) {
      return;  // text in a comment: urdfdom has parsed all other angles
    }
    const urdf::Rotation rotation = rotation_of(rpy);
    by_key_.emplace(key_of(rotation), rotation);
  }

  std::map<double, urdf::Rotation> by_key_;
};

void replace_rotations(const std::string& text, const urdf::ModelInterface& model) {
  const Rotations rotations(text);
  for (const auto& [name, link] : model.links_) {
    if (link->inertial) rotations.replace(&link->inertial->origin.rotation);
    for (const auto& visual : link->visual_array) rotations.replace(&visual->origin.rotation);
    for (const auto& collision : link->collision_array)
      rotations.replace(&collision->origin.rotation);
  }
  for (const auto& [name, joint] : model.joints_)
    rotations.replace(&joint->parent_to_joint_origin_transform.rotation);
}

}  // namespace

std::string errors_logged_by(const std::function<void()>& parser) {
  static std::mutex one_at_a_time;  // the handler is global
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  const ParserErrors errors;
  parser();
  return errors.text();
}

void refuse(const std::string& why) { throw std::invalid_argument("urdf: " + why); }

urdf::ModelInterfaceSharedPtr parse_urdf(const std::string& text) {
  if (text.empty()) refuse("the text is empty");
  check_cycles(read_joints(text));
  urdf::ModelInterfaceSharedPtr model = parse(text);
  check_tree(*model);
  check_geometries(*model);
  replace_rotations(text, *model);
  return model;
}

Eigen::Isometry3d to_isometry(const urdf::Pose& pose) {
  Eigen::Quaterniond rotation;
  pose.rotation.getQuaternion(rotation.x(), rotation.y(), rotation.z(), rotation.w());
  return Eigen::Translation3d(to_eigen(pose.position)) * rotation.normalized();
}

Eigen::Vector3d to_eigen(const urdf::Vector3& vector) { return {vector.x, vector.y, vector.z}; }

}  // namespace constraint_sim
