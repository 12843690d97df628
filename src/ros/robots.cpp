#include "ros/robots.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "ros/conversions.h"
#include "ros/marker_lines.h"

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
    default: {
      const auto& mesh = static_cast<const urdf::Mesh&>(geometry);
      marker->type = Marker::MESH_RESOURCE;
      marker->mesh_resource = mesh.filename;
      marker->scale = to_vector(to_eigen(mesh.scale));
    }
  }
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

}  // namespace

void Robots::add(const Robot& robot) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const RobotLink& link : robot.links) {
    const bool is_root = &link == &robot.links.front();
    bodies_[link.body.value].links.push_back({link.name, link.in_body, is_root});
  }
  for (const RobotVisual& of : robot.visuals) {
    Visual& visual = bodies_[of.body.value].visuals.emplace_back();
    visual.id = ++last_marker_;
    visual.position = of.in_body.translation();
    visual.orientation = Eigen::Quaterniond(of.in_body.linear()).normalized();
    set_shape(*of.geometry, &visual.marker);
    set_colour(of, &visual.marker);
  }
  for (const auto& [joint, bounds] : robot.bounds) bounds_[joint] = bounds;
}

bool Robots::add_frames(const engine::World& world, engine::BodyId body, const ros::Time& stamp,
                        tf2_msgs::TFMessage* message) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = bodies_.find(body.value);
  if (found == bodies_.end()) return false;
  const Eigen::Isometry3d in_world = pose_of(world.state(body));
  const auto add = [&](const std::string& parent, const std::string& child,
                       const Eigen::Isometry3d& pose) {
    geometry_msgs::TransformStamped& transform = message->transforms.emplace_back();
    transform.header.stamp = stamp;
    transform.header.frame_id = parent;
    transform.child_frame_id = child;
    transform.transform = to_transform(state_at(pose));
  };
  for (const Link& link : found->second.links) {
    const std::string frame = parameters_.frame_prefix + link.frame;
    const bool is_shown =
        parameters_.publish_links == "all" || (parameters_.publish_links == "root" && link.is_root);
    if (is_shown && frame != parameters_.world_frame)
      add(parameters_.world_frame, frame, in_world * link.in_body);
  }
  if (parameters_.publish_com) {
    const Link& first = found->second.links.front();
    add(parameters_.frame_prefix + first.frame, parameters_.frame_prefix + world.body(body).name,
        first.in_body.inverse());
  }
  return true;
}

bool Robots::have(engine::BodyId body) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return bodies_.count(body.value) > 0;
}

void Robots::add_markers(const engine::World& world, const std::vector<engine::BodyId>& bodies,
                         bool is_edited, MarkerSet::Namespace* markers) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (auto next = bodies_.begin(); next != bodies_.end();) {
    const auto& [number, links] = *next;
    const engine::BodyId body{number};
    if (!std::binary_search(bodies.begin(), bodies.end(), body)) {
      const bool is_gone = !bodies.empty() && body < bodies.back();  // ids are never reused
      next = is_gone ? bodies_.erase(next) : std::next(next);
      continue;
    }
    ++next;
    const engine::BodyState& at = world.state(body);
    for (const Visual& visual : links.visuals) {
      const ShownMarker* shown = markers->shown(visual.id);
      const bool is_new = is_edited || shown == nullptr;
      const geometry_msgs::Point place = point_at(at.position + at.orientation * visual.position);
      const geometry_msgs::Quaternion turn = quaternion_of(at.orientation * visual.orientation);
      if (!is_new && shown->pose.position == place && shown->pose.orientation == turn) {
        markers->keep(visual.id);
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
    const auto found = bodies_.find(body.value);
    if (found == bodies_.end()) continue;
    for (const Link& link : found->second.links)
      if (link.frame == name) return RobotLink{name, body, link.in_body};
  }
  return std::nullopt;
}

JointBounds Robots::bounds(const std::string& joint) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = bounds_.find(joint);
  return found != bounds_.end() ? found->second : JointBounds{};
}

}  // namespace constraint_sim
