#include "urdf/parse.h"

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>

#include <map>
#include <mutex>
#include <set>
#include <stdexcept>

#include "sim/words.h"

namespace constraint_sim {
namespace {

[[noreturn]] void refuse(const std::string& why) { throw std::invalid_argument("urdf: " + why); }

/// Keeps the errors that urdfdom logs, since its answer does not say why. One at a time.
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
  static std::mutex one_at_a_time;  // the handler is global
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  const ParserErrors errors;
  urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(text);
  if (!model || !errors.text().empty())
    refuse(errors.text().empty() ? "this is no robot description" : shortened(errors.text(), 400));
  return model;
}

/// Takes apart links that refer to each other, so that their memory is freed.
[[noreturn]] void refuse_links(const urdf::ModelInterface& model, const std::string& why) {
  for (const auto& [name, link] : model.links_) link->clear();
  refuse(why);
}

/// urdfdom forgets all but one of a link's parents, and does not look for cycles beside the root.
void check_tree(const urdf::ModelInterface& model) {
  std::map<std::string, std::string> joint_of_child;
  for (const auto& [name, joint] : model.joints_) {
    const auto [other, is_first] = joint_of_child.emplace(joint->child_link_name, name);
    if (!is_first)
      refuse_links(model, "link '" + joint->child_link_name + "' is the child of two joints, '" +
                              other->second + "' and '" + name +
                              "'; close loops by constraints beside the URDF");
  }
  std::set<std::string> reached;
  std::vector<urdf::LinkConstSharedPtr> open{model.getRoot()};
  while (!open.empty()) {
    const urdf::LinkConstSharedPtr link = open.back();
    open.pop_back();
    reached.insert(link->name);
    open.insert(open.end(), link->child_links.begin(), link->child_links.end());
  }
  for (const auto& [name, link] : model.links_)
    if (reached.count(name) == 0)
      refuse_links(model,
                   "link '" + name + "' is in a cycle of joints that the root does not reach");
}

void check_meshes(const urdf::ModelInterface& model, const MeshExists& mesh_exists) {
  const auto check = [&](const std::string& link, const urdf::GeometryConstSharedPtr& geometry) {
    if (!geometry) refuse("link '" + link + "' has a visual or collision without a geometry");
    if (geometry->type != urdf::Geometry::MESH || !mesh_exists) return;
    const std::string& file = static_cast<const urdf::Mesh&>(*geometry).filename;
    if (!mesh_exists(file))
      refuse("link '" + link + "': there is no mesh '" + shortened(file, 200) + "'");
  };
  for (const auto& [name, link] : model.links_) {
    for (const auto& visual : link->visual_array) check(name, visual->geometry);
    for (const auto& collision : link->collision_array) check(name, collision->geometry);
  }
}

}  // namespace

urdf::ModelInterfaceSharedPtr parse_urdf(const std::string& text, const MeshExists& mesh_exists) {
  if (text.empty()) refuse("the text is empty");
  urdf::ModelInterfaceSharedPtr model = parse(text);
  check_tree(*model);
  check_meshes(*model, mesh_exists);
  return model;
}

Eigen::Isometry3d to_isometry(const urdf::Pose& pose) {
  Eigen::Quaterniond rotation;
  pose.rotation.getQuaternion(rotation.x(), rotation.y(), rotation.z(), rotation.w());
  return Eigen::Translation3d(to_eigen(pose.position)) * rotation.normalized();
}

Eigen::Vector3d to_eigen(const urdf::Vector3& vector) { return {vector.x, vector.y, vector.z}; }

}  // namespace constraint_sim
