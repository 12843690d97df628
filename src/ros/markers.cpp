#include "ros/markers.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "ros/conversions.h"

namespace constraint_sim {
namespace {

using visualization_msgs::Marker;

constexpr double kFullPeriod = 1.0;      // [s]
constexpr double kPointDiameter = 0.06;  // [m] that a point mass is drawn with
constexpr double kPlaneWidth = 20.0;     // [m] that is drawn of a plane
constexpr double kLineWidth = 0.03;      // [m]
constexpr double kNormalLength = 0.2;    // [m]
constexpr double kAxisLength = 0.3;      // [m] of the axis of a joint, at most
constexpr double kGreenError = 1e-6;     // [m]
constexpr double kRedError = 1e-2;       // [m]

std_msgs::ColorRGBA colour(double r, double g, double b, double a = 1.0) {
  std_msgs::ColorRGBA msg;
  msg.r = static_cast<float>(r);
  msg.g = static_cast<float>(g);
  msg.b = static_cast<float>(b);
  msg.a = static_cast<float>(a);
  return msg;
}

std_msgs::ColorRGBA body_colour(engine::BodyType type) {
  switch (type) {
    case engine::BodyType::kStatic:
      return colour(0.5, 0.5, 0.5);
    case engine::BodyType::kKinematic:
      return colour(1.0, 0.55, 0.0);
    default:
      return colour(0.27, 0.51, 0.71);
  }
}

// from green to red over the logarithm of the error
std_msgs::ColorRGBA error_colour(double error) {
  const double magnitude = std::max(std::abs(error), kGreenError);
  const double red =
      std::min(std::log(magnitude / kGreenError) / std::log(kRedError / kGreenError), 1.0);
  return colour(0.2 + 0.6 * red, 0.8 - 0.6 * red, 0.2);
}

void set_scale(Marker& marker, const Eigen::Vector3d& size) { marker.scale = to_vector(size); }

void set_shape(Marker& marker, const engine::Point&) {
  marker.type = Marker::SPHERE;
  set_scale(marker, Eigen::Vector3d::Constant(kPointDiameter));
}

void set_shape(Marker& marker, const engine::Sphere& sphere) {
  marker.type = Marker::SPHERE;
  set_scale(marker, Eigen::Vector3d::Constant(2.0 * sphere.radius));
}

void set_shape(Marker& marker, const engine::Box& box) {
  marker.type = Marker::CUBE;
  set_scale(marker, box.size);
}

// a sheet of no thickness to speak of, so that what lies on it is not cut
void set_shape(Marker& marker, const engine::Plane&) {
  marker.type = Marker::CUBE;
  set_scale(marker, {kPlaneWidth, kPlaneWidth, 1e-3});
  marker.color.a = 0.5F;
}

// What is as long as a body, and comes out of a ball that it goes through [m]; 0 of a point or a
// plane.
double length_of_axis_through(const engine::Shape& shape) {
  if (const auto* box = std::get_if<engine::Box>(&shape)) return box->size.maxCoeff();
  if (const auto* sphere = std::get_if<engine::Sphere>(&shape)) return 3.0 * sphere->radius;
  return 0.0;
}

// The axis of a joint is drawn as long as the smaller of its bodies, arm included [m].
double axis_length(const engine::World& world, const engine::Joint& joint) {
  double length = kAxisLength;
  for (const auto& [body, anchor] :
       {std::pair{joint.body_a, joint.anchor_a}, std::pair{joint.body_b, joint.anchor_b}}) {
    if (body == engine::kWorldBody) continue;
    const double size =
        std::max(length_of_axis_through(world.body(body).shape), 2.0 * anchor.norm());
    if (size > 0.0) length = std::min(length, size);
  }
  return length;
}

}  // namespace

visualization_msgs::MarkerArray Markers::update(const engine::World& world, const ros::Time& stamp,
                                                bool for_newcomer) {
  stamp_ = stamp;
  visualization_msgs::MarkerArray array;
  const bool full = !started_ || for_newcomer || stamp.toSec() - last_full_.toSec() >= kFullPeriod;
  if (!started_) {
    Marker clear = make("", 0, Marker::CUBE);
    clear.action = Marker::DELETEALL;
    array.markers.push_back(clear);
    bodies_shown_.clear();
    constraints_shown_.clear();
    contacts_shown_.clear();
  }
  if (full) last_full_ = stamp;
  started_ = true;

  std::set<std::int32_t> present;
  for (const engine::BodyId id : world.body_ids()) {
    const auto number = static_cast<std::int32_t>(id.value);
    present.insert(number);
    const bool known = bodies_shown_.count(number) > 0;
    if (full || !known || world.body(id).type != engine::BodyType::kStatic)
      array.markers.push_back(body(world, id));
  }
  delete_missing("bodies", present, bodies_shown_, array);

  present.clear();
  for (const engine::JointId id : world.joint_ids()) {
    if (world.joint_state(id).broken || !world.joint(id).enabled) continue;
    present.insert(static_cast<std::int32_t>(id.value));
    array.markers.push_back(constraint(world, id));
  }
  delete_missing("constraints", present, constraints_shown_, array);

  present.clear();
  if (!world.contacts().empty()) {
    present.insert(0);
    array.markers.push_back(contacts(world));
  }
  delete_missing("contacts", present, contacts_shown_, array);
  return array;
}

void Markers::delete_missing(const char* ns, const std::set<std::int32_t>& present,
                             std::set<std::int32_t>& shown,
                             visualization_msgs::MarkerArray& array) const {
  for (const std::int32_t id : shown) {
    if (present.count(id) > 0) continue;
    Marker gone = make(ns, id, Marker::CUBE);
    gone.action = Marker::DELETE;
    array.markers.push_back(gone);
  }
  shown = present;
}

Marker Markers::make(const char* ns, std::int32_t id, std::int32_t type) const {
  Marker marker;
  marker.header.stamp = stamp_;
  marker.header.frame_id = frame_;
  marker.ns = ns;
  marker.id = id;
  marker.type = type;
  marker.action = Marker::ADD;
  marker.pose.orientation.w = 1.0;
  return marker;
}

Marker Markers::body(const engine::World& world, engine::BodyId id) const {
  const engine::Body& body = world.body(id);
  Marker marker = make("bodies", static_cast<std::int32_t>(id.value), Marker::CUBE);
  marker.pose = to_pose(world.state(id));
  marker.color = body_colour(body.type);
  std::visit([&](const auto& shape) { set_shape(marker, shape); }, body.shape);
  return marker;
}

Marker Markers::constraint(const engine::World& world, engine::JointId id) const {
  Marker marker = make("constraints", static_cast<std::int32_t>(id.value), Marker::LINE_LIST);
  marker.scale.x = kLineWidth;
  marker.color = error_colour(world.joint_state(id).error);
  const engine::Joint& joint = world.joint(id);
  if (engine::couples_joints(joint.kind)) {  // from one of the joints to the other
    marker.points = {to_point(world.anchors(joint.coupling.first).p_b),
                     to_point(world.anchors(joint.coupling.second).p_b)};
    return marker;
  }
  const engine::World::Anchors anchors = world.anchors(id);
  marker.points = {to_point(anchors.p_a), to_point(anchors.p_b)};
  if (engine::if_distance(joint) == nullptr && !engine::is_free_length(joint.kind)) {
    // no length to see: arms from the centres of the bodies instead
    for (const auto& [body, anchor] :
         {std::pair{joint.body_a, anchors.p_a}, std::pair{joint.body_b, anchors.p_b}}) {
      if (body == engine::kWorldBody) continue;
      marker.points.push_back(to_point(world.state(body).position));
      marker.points.push_back(to_point(anchor));
    }
  }
  if (engine::has_frames(joint.kind)) {  // the axis that it turns about or moves along
    const double length = axis_length(world, joint);
    marker.scale.x = kLineWidth * length / kAxisLength;
    const Eigen::Vector3d half =
        0.5 * length *
        (world.state(joint.body_a).orientation * joint.frame_a * Eigen::Vector3d::UnitZ());
    marker.points.push_back(to_point(anchors.p_a - half));
    marker.points.push_back(to_point(anchors.p_a + half));
  }
  return marker;
}

Marker Markers::contacts(const engine::World& world) const {
  Marker marker = make("contacts", 0, Marker::LINE_LIST);
  marker.scale.x = kLineWidth;
  marker.color = colour(0.9, 0.1, 0.9);
  for (const engine::Contact& contact : world.contacts()) {
    marker.points.push_back(to_point(contact.position));
    marker.points.push_back(to_point(contact.position + kNormalLength * contact.normal));
  }
  return marker;
}

}  // namespace constraint_sim
