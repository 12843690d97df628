#include "ros/robots.h"

#include <ros/console.h>
#include <ros/names.h>

#include <cctype>
#include <iterator>
#include <stdexcept>
#include <string>
#include <utility>

#include "ros/conversions.h"
#include "ros/marker_lines.h"
#include "urdf/prefixed.h"

namespace constraint_sim {
namespace {

using visualization_msgs::Marker;

Eigen::Isometry3d pose_of(const engine::BodyState& state) {
  return Eigen::Translation3d(state.position) * state.orientation;
}

engine::BodyState state_at(const Eigen::Isometry3d& pose) {
  engine::BodyState state;
  state.position = pose.translation();
  state.orientation = Eigen::Quaterniond(pose.linear()).normalized();
  return state;
}

void set_shape(const urdf::Geometry& geometry, Marker* marker) {
  switch (geometry.type) {
    case urdf::Geometry::SPHERE:
      marker->type = Marker::SPHERE;
      marker->scale = to_vector(
          Eigen::Vector3d::Constant(2.0 * static_cast<const urdf::Sphere&>(geometry).radius));
      return;
    case urdf::Geometry::BOX:
      marker->type = Marker::CUBE;
      marker->scale = to_vector(to_eigen(static_cast<const urdf::Box&>(geometry).dim));
      return;
    case urdf::Geometry::CYLINDER: {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
      marker->type = Marker::CYLINDER;
      marker->scale = to_vector({2.0 * cylinder.radius, 2.0 * cylinder.radius, cylinder.length});
      return;
    }
    case urdf::Geometry::MESH: {
      const auto& mesh = static_cast<const urdf::Mesh&>(geometry);
      marker->type = Marker::MESH_RESOURCE;
      marker->mesh_resource = mesh.filename;
      marker->scale = to_vector(to_eigen(mesh.scale));
      return;
    }
  }
  throw std::invalid_argument("urdf: a visual has a geometry of the unknown type " +
                              std::to_string(static_cast<int>(geometry.type)));
}

void set_colour(const RobotVisual& visual, Marker* marker) {
  constexpr std::array<double, 4> kGrey{0.7, 0.7, 0.7, 1.0};
  const bool has_own = visual.geometry->type == urdf::Geometry::MESH && !visual.colour;
  marker->mesh_use_embedded_materials = static_cast<std::uint8_t>(has_own);
  if (has_own) return;
  const std::array<double, 4> colour = visual.colour.value_or(kGrey);
  marker->color.r = static_cast<float>(colour[0]);
  marker->color.g = static_cast<float>(colour[1]);
  marker->color.b = static_cast<float>(colour[2]);
  marker->color.a = static_cast<float>(colour[3]);
}

/// Returns a robot's name with characters that names of ROS allow.
std::string name_in_ros(const std::string& prefix, const std::string& robot) {
  std::string name = prefix.empty() ? robot : prefix;
  while (name.size() > 1 && name.back() == '/') name.pop_back();
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '/') c = '_';
  const bool is_name = !name.empty() && std::isalpha(static_cast<unsigned char>(name[0])) != 0;
  return ros::names::clean(is_name ? name : "robot_" + name);
}

RobotDescription describe(const Robot& robot, const UrdfText& urdf, const std::string& prefix,
                          const std::string& frame_prefix) {
  PrefixedUrdf prefixed = prefixed_urdf(urdf.text, frame_prefix + prefix, prefix, urdf.folder);
  std::map<std::string, double> fixed_joints;
  for (const auto& [joint, position] : robot.fixed_joints) fixed_joints[prefix + joint] = position;
  return {
      name_in_ros(prefix, robot.name),
      std::make_shared<const std::string>(std::move(prefixed.text)),
      std::make_shared<const std::set<std::string>>(prefixed.joints.begin(), prefixed.joints.end()),
      std::make_shared<const std::map<std::string, double>>(std::move(fixed_joints))};
}

}  // namespace

void Robots::add(const Robot& robot, const UrdfText& urdf, const std::string& prefix,
                 const engine::World& world) {
  const RobotDescription description = describe(robot, urdf, prefix, parameters_.frame_prefix);
  const std::lock_guard<std::mutex> lock(mutex_);
  has_any_ = true;
  for (const std::string& body : robot.bodies)  // some carry shapes and no link
    bodies_[world.find_body(body).value].body = body;
  for (const RobotLink& link : robot.links) {
    const bool is_root = &link == &robot.links.front();
    BodyLinks& links = bodies_[link.body.value];
    links.links.push_back({link.name, link.in_body, is_root});
    if (is_root) links.robot = description;
  }
  for (const RobotVisual& visual : robot.visuals)
    bodies_[visual.body.value].visuals.push_back(make_visual(visual));
  for (const auto& [joint, bounds] : robot.bounds)
    if (world.has_joint(joint)) bounds_[world.find_joint(joint).value] = {joint, bounds};
  forget_oldest(world);
}

void Robots::add(const std::vector<RobotVisual>& visuals, const engine::World& world) {
  if (visuals.empty()) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  has_any_ = true;
  for (const RobotVisual& visual : visuals) {
    BodyLinks& links = bodies_[visual.body.value];
    links.body = world.body(visual.body).name;
    links.is_of_robot = false;
    links.visuals.push_back(make_visual(visual));
  }
  forget_oldest(world);
}

Robots::Visual Robots::make_visual(const RobotVisual& of) {
  Visual visual;
  visual.id = ++last_marker_;
  visual.position = of.in_body.translation();
  visual.orientation = Eigen::Quaterniond(of.in_body.linear()).normalized();
  set_shape(*of.geometry, &visual.marker);
  set_colour(of, &visual.marker);
  return visual;
}

std::size_t Robots::size_of(const BodyLinks& links) {
  std::size_t bytes = sizeof links + links.body.size();
  for (const Link& link : links.links) bytes += sizeof link + link.frame.size();
  for (const Visual& visual : links.visuals)
    bytes += sizeof visual + visual.marker.mesh_resource.size();
  if (links.robot) bytes += links.robot->text->size();
  return bytes;
}

std::vector<RobotDescription> Robots::descriptions(const engine::World& world) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<RobotDescription> robots;
  std::set<std::string> taken;
  for (const auto& [number, links] : bodies_) {
    if (!links.robot || find(world, engine::BodyId{number}) == nullptr) continue;
    RobotDescription robot = *links.robot;
    const std::string name = robot.name;
    for (int i = 2; !taken.insert(robot.name).second; ++i)
      robot.name = name + "_" + std::to_string(i);
    robots.push_back(std::move(robot));
  }
  return robots;
}

std::size_t Robots::size_of(const BoundedJoint& joint) { return sizeof joint + joint.name.size(); }

// Forgets the oldest removed robots beyond kMostBytes. Ids grow, so the lowest are the oldest.
void Robots::forget_oldest(const engine::World& world) {
  std::size_t bytes = 0;
  for (const auto& [number, links] : bodies_) bytes += size_of(links);
  for (const auto& [number, joint] : bounds_) bytes += size_of(joint);
  const auto forget = [&](auto* known, auto is_gone) {
    for (auto next = known->begin(); bytes > kMostBytes && next != known->end();) {
      const bool goes = is_gone(*next);
      if (goes) bytes -= size_of(next->second);
      next = goes ? known->erase(next) : std::next(next);
    }
  };
  forget(&bodies_,
         [&](const auto& entry) { return find(world, engine::BodyId{entry.first}) == nullptr; });
  forget(&bounds_, [&](const auto& entry) {
    const std::string& name = entry.second.name;
    return !world.has_joint(name) || world.find_joint(name).value != entry.first;
  });
}

const Robots::BodyLinks* Robots::find(const engine::World& world, engine::BodyId body) const {
  const auto found = bodies_.find(body.value);
  if (found == bodies_.end() || !world.has_body(found->second.body)) return nullptr;
  return world.find_body(found->second.body) == body ? &found->second : nullptr;
}

void Robots::tell_of_gone(const engine::World& world, const std::string& by) {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::string names;
  for (auto& [number, links] : bodies_) {
    const bool is_gone = find(world, engine::BodyId{number}) == nullptr;
    if (std::exchange(links.is_gone, is_gone) || !is_gone) continue;
    for (const Link& link : links.links) names += (names.empty() ? "" : ", ") + link.frame;
  }
  if (!names.empty())
    ROS_INFO("%s: no frames and visuals of these links any more: %s", by.c_str(), names.c_str());
}

bool Robots::add_frames(const engine::World& world, engine::BodyId body, const ros::Time& stamp,
                        tf2_msgs::TFMessage* message) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const BodyLinks* known = find(world, body);
  if (known == nullptr || !known->is_of_robot) return false;
  const Eigen::Isometry3d in_world = pose_of(world.state(body));
  const auto add = [&](const std::string& parent, const std::string& child,
                       const Eigen::Isometry3d& pose) {
    geometry_msgs::TransformStamped& transform = message->transforms.emplace_back();
    transform.header.stamp = stamp;
    transform.header.frame_id = parent;
    transform.child_frame_id = child;
    transform.transform = to_transform(state_at(pose));
  };
  for (const Link& link : known->links) {
    const std::string frame = parameters_.frame_prefix + link.frame;
    const bool is_shown =
        parameters_.publish_links == "all" || (parameters_.publish_links == "root" && link.is_root);
    if (is_shown && frame != parameters_.world_frame)
      add(parameters_.world_frame, frame, in_world * link.in_body);
  }
  if (parameters_.publish_com && !known->links.empty()) {
    const Link& first = known->links.front();
    add(parameters_.frame_prefix + first.frame, parameters_.frame_prefix + world.body(body).name,
        first.in_body.inverse());
  }
  return true;
}

bool Robots::have(const engine::World& world, engine::BodyId body) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const BodyLinks* known = find(world, body);
  return known != nullptr && known->is_of_robot;
}

void Robots::add_markers(const engine::World& world, bool is_edited,
                         MarkerSet::Namespace* markers) const {
  if (!has_any_) return;  // cheaper than the lock
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [number, links] : bodies_) {
    const engine::BodyId body{number};
    if (find(world, body) == nullptr) continue;
    const engine::BodyState& at = world.state(body);
    for (const Visual& visual : links.visuals) {
      ShownMarker* shown = markers->shown(visual.id);
      const bool is_new = is_edited || shown == nullptr;
      const geometry_msgs::Point place = point_at(at.position + at.orientation * visual.position);
      const geometry_msgs::Quaternion turn = quaternion_of(at.orientation * visual.orientation);
      if (!is_new && shown->pose.position == place && shown->pose.orientation == turn) {
        markers->keep(shown);
        continue;
      }
      Marker& marker = markers->add(visual.id, visual.marker.type);
      marker.pose.position = place;
      marker.pose.orientation = turn;
      if (!is_new) continue;
      marker.scale = visual.marker.scale;
      marker.color = visual.marker.color;
      marker.mesh_resource = visual.marker.mesh_resource;
      marker.mesh_use_embedded_materials = visual.marker.mesh_use_embedded_materials;
    }
  }
}

std::optional<RobotLink> Robots::find_link(const engine::World& world,
                                           const std::string& name) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const engine::BodyId body : world.body_ids()) {
    const BodyLinks* known = find(world, body);
    if (known == nullptr) continue;
    for (const Link& link : known->links)
      if (link.frame == name) return RobotLink{name, body, link.in_body};
  }
  return std::nullopt;
}

JointBounds Robots::bounds(const engine::World& world, engine::JointId joint) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = bounds_.find(joint.value);
  const bool is_it = found != bounds_.end() && world.joint(joint).name == found->second.name;
  return is_it ? found->second.bounds : JointBounds{};
}

}  // namespace constraint_sim
