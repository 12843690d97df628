#include "ros/body_messages.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ros/conversions.h"
#include "sim/errors.h"

namespace constraint_sim {
namespace {

void check_dimensions(const Shape& shape, const char* meaning, std::size_t count) {
  if (shape.dimensions.size() != count)
    refuse("dimensions", std::string("a ") + meaning + ", got " +
                             std::to_string(shape.dimensions.size()) + " numbers");
}

engine::Shape hull_from(const Shape& shape) {
  if (!shape.triangles.empty())
    refuse("triangles",
           "a hull has none, got " + std::to_string(shape.triangles.size()) + " numbers");
  if (!shape.mesh_resource.empty())
    refuse("mesh_resource",
           "add_body and apply_edits alone read files, got '" + shape.mesh_resource + "'");
  if (from_msg(shape.mesh_scale) != Eigen::Vector3d::Zero())
    refuse("mesh_scale", "only a mesh_resource has one");
  std::vector<Eigen::Vector3d> vertices;
  for (const geometry_msgs::Point& vertex : shape.vertices) vertices.push_back(from_msg(vertex));
  return engine::Hull(vertices);
}

/// Rejects a surface of a shape that has none.
void check_no_surface(const Shape& shape) {
  const char* const why = "only a hull or a mesh has this field, got ";
  if (!shape.vertices.empty())
    refuse("vertices", why + std::to_string(shape.vertices.size()) + " points");
  if (!shape.triangles.empty())
    refuse("triangles", why + std::to_string(shape.triangles.size()) + " numbers");
  if (!shape.mesh_resource.empty())
    refuse("mesh_resource", why + ("'" + shape.mesh_resource + "'"));
  if (from_msg(shape.mesh_scale) != Eigen::Vector3d::Zero())
    refuse("mesh_scale", why + std::to_string(shape.mesh_scale.x) + ", " +
                             std::to_string(shape.mesh_scale.y) + ", " +
                             std::to_string(shape.mesh_scale.z));
}

/// Returns the pose of the shape in its body; none at the identity.
std::optional<engine::ShapePose> shape_pose_of(const Shape& shape) {
  engine::ShapePose pose{from_msg(shape.pose.position), from_msg(shape.pose.orientation)};
  const bool is_turned = pose.orientation.coeffs() != Eigen::Quaterniond::Identity().coeffs();
  if (!is_turned && pose.position == Eigen::Vector3d::Zero()) return std::nullopt;
  if (shape.type == Shape::POINT || shape.type == Shape::PLANE)
    refuse("pose", "a point and a plane have none; place the body instead");
  return pose;
}

void read_surface(const Shape& shape, engine::ShapePart* part) {
  check_surface(shape);
  if (!shape.has_surface) return;
  part->friction = shape.friction;
  part->restitution = shape.restitution;
}

void read_shapes(const Body& msg, engine::Body* body) {
  if (msg.shapes.empty()) return;
  engine::Compound::Parts parts;
  for (std::size_t i = 0; i < msg.shapes.size(); ++i) {
    try {
      const std::optional<engine::ShapePose> pose = shape_pose_of(msg.shapes[i]);
      parts.push_back({from_msg(msg.shapes[i]), pose.value_or(engine::ShapePose{})});
      read_surface(msg.shapes[i], &parts.back());
      if (i == 0) body->shape_pose = pose;
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument("shapes[" + std::to_string(i) + "]." + error.what());
    }
  }
  if (parts.size() == 1) {
    body->shape = std::move(parts[0].shape);
    if (parts[0].friction) body->friction = *parts[0].friction;
    if (parts[0].restitution) body->restitution = *parts[0].restitution;
    return;
  }
  body->shape_pose.reset();
  body->shape = engine::Compound(std::move(parts));
}

/// Returns the colour; none, which means by the type, where all components are 0.
std::optional<std::array<double, 4>> colour_of(const std_msgs::ColorRGBA& color) {
  if (color.r == 0.0F && color.g == 0.0F && color.b == 0.0F && color.a == 0.0F) return std::nullopt;
  return std::array<double, 4>{color.r, color.g, color.b, color.a != 0.0F ? color.a : 1.0};
}

engine::BodyType body_type(std::uint8_t type) {
  switch (type) {
    case Body::DYNAMIC:
      return engine::BodyType::kDynamic;
    case Body::STATIC:
      return engine::BodyType::kStatic;
    case Body::KINEMATIC:
      return engine::BodyType::kKinematic;
    default:
      refuse("type", "must be DYNAMIC=0, STATIC=1 or KINEMATIC=2, got " + std::to_string(type));
  }
}

}  // namespace

engine::Shape from_msg(const Shape& shape) {
  const auto& size = shape.dimensions;
  switch (shape.type) {
    case Shape::HULL:
      check_dimensions(shape, "hull has no dimensions", 0);
      return hull_from(shape);
    case Shape::MESH:
      refuse("type", "add_body and apply_edits alone divide meshes, got MESH=7");
    default:
      check_no_surface(shape);
  }
  switch (shape.type) {
    case Shape::POINT:
      check_dimensions(shape, "point has no dimensions", 0);
      return engine::Point{};
    case Shape::SPHERE:
      check_dimensions(shape, "sphere has one: its radius", 1);
      return engine::Sphere{size[0]};
    case Shape::BOX:
      check_dimensions(shape, "box has three: x, y, z", 3);
      return engine::Box{{size[0], size[1], size[2]}};
    case Shape::PLANE:
      check_dimensions(shape, "plane has no dimensions", 0);
      return engine::Plane{};
    case Shape::CYLINDER:
      check_dimensions(shape, "cylinder has two: radius, length", 2);
      return engine::Cylinder{size[0], size[1]};
    case Shape::CAPSULE:
      check_dimensions(shape, "capsule has two: radius, length of the straight part", 2);
      return engine::Capsule{size[0], size[1]};
    default:
      refuse("type",
             "must be POINT=0, SPHERE=1, BOX=2, CAPSULE=3, PLANE=4, CYLINDER=5, HULL=6 or MESH=7, "
             "got " +
                 std::to_string(shape.type));
  }
}

void check_surface(const Shape& shape) {
  if (!shape.has_surface && (shape.friction != 0.0 || shape.restitution != 0.0))
    refuse("has_surface", "must be true for a friction or restitution of the shape's own");
}

engine::Body from_msg(const Body& msg) {
  engine::Body body;
  body.name = msg.name;
  body.type = body_type(msg.type);
  body.mass = msg.mass;
  body.inertia = from_msg(msg.inertia);
  body.state = from_msg(msg.pose, msg.twist);
  body.friction = msg.friction;
  body.restitution = msg.restitution;
  read_shapes(msg, &body);
  body.no_collision = msg.no_collision;
  body.gravity_compensation = msg.gravity_compensation;
  if (msg.collision_groups != 0) body.collision_groups = msg.collision_groups;
  if (msg.collision_mask != 0) body.collision_mask = msg.collision_mask;
  body.color = colour_of(msg.color);
  return body;
}

}  // namespace constraint_sim
