#include "ros/body_meshes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "ros/body_messages.h"
#include "ros/conversions.h"
#include "ros/edits.h"
#include "ros/marker_style.h"
#include "ros/mesh_files.h"
#include "sim/errors.h"
#include "sim/words.h"
#include "urdf/mesh_file.h"
#include "urdf/mesh_shapes.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

bool is_mesh(const Shape& shape) {
  return shape.type == Shape::MESH || (shape.type == Shape::HULL && !shape.mesh_resource.empty());
}

std::string shown(const Vector3d& v) {
  std::array<char, 100> text{};
  std::snprintf(text.data(), text.size(), "%g, %g, %g", v.x(), v.y(), v.z());
  return text.data();
}

/// Most convex parts of a shape.
std::size_t most_parts_of(const Shape& shape) {
  return shape.type == Shape::HULL ? 1 : kMostMeshParts;
}

/// Returns the triangles that a message has itself, with the vertices of these triangles.
TriangleMesh mesh_in(const Shape& shape) {
  const Vector3d scale = from_msg(shape.mesh_scale);
  if (scale != Vector3d::Zero())
    refuse("mesh_scale", "only a mesh_resource has one, got " + shown(scale));
  if (shape.vertices.size() > kMostVerticesInMessage)
    refuse("vertices", "must be at most " + std::to_string(kMostVerticesInMessage) + ", got " +
                           std::to_string(shape.vertices.size()));
  const std::size_t numbers = shape.triangles.size();
  if (numbers == 0 || numbers % 3 != 0 || numbers > 3 * kMostTrianglesInMessage)
    refuse("triangles", "a mesh without mesh_resource has 1 to " +
                            std::to_string(kMostTrianglesInMessage) +
                            ", each of three numbers, got " + std::to_string(numbers) + " numbers");
  for (std::size_t i = 0; i < shape.vertices.size(); ++i)
    if (const Vector3d point = from_msg(shape.vertices[i]); !point.allFinite())
      refuse("vertices[" + std::to_string(i) + "]", "must be finite numbers, got " + shown(point));
  TriangleMesh mesh;
  std::vector<int> number(shape.vertices.size(), -1);  // in the mesh
  for (std::size_t i = 0; i < numbers; i += 3) {
    TriangleMesh::Triangle& triangle = mesh.triangles.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t vertex = shape.triangles[i + k];
      if (vertex >= number.size())
        refuse("triangles[" + std::to_string(i + k) + "]",
               "must be the number of a vertex, below " + std::to_string(number.size()) + ", got " +
                   std::to_string(vertex));
      if (number[vertex] < 0) {
        number[vertex] = static_cast<int>(mesh.points.size());
        mesh.points.push_back(from_msg(shape.vertices[vertex]));
      }
      triangle[k] = number[vertex];
    }
  }
  unite_equal_points(&mesh);
  if (mesh.triangles.empty())
    refuse("triangles",
           "must have three different points, and none of " + std::to_string(numbers / 3) + " has");
  return mesh;
}

/// Returns the scale of a file; all zero is 1.
Vector3d scale_of(const Shape& shape) {
  const Vector3d scale = from_msg(shape.mesh_scale);
  if (scale == Vector3d::Zero()) return Vector3d::Ones();
  if (!scale.allFinite() || (scale.array() == 0.0).any())
    refuse("mesh_scale", "must be finite numbers other than 0, or all 0, got " + shown(scale));
  return scale;
}

/// Files of the meshes of a request, and how they collide.
struct FilesOfRequest {
  MeshFiles files;
  std::map<std::string, MeshShape> known;  ///< by URI, scale and number of parts
};

/// Returns how the mesh in a file collides. `uri`: name of the file for other programs.
const MeshShape& collision_of_file(const Shape& shape, const std::string& uri,
                                   FilesOfRequest* files) {
  if (!shape.vertices.empty())
    refuse("vertices",
           "a mesh_resource has its own, got " + std::to_string(shape.vertices.size()) + " points");
  if (!shape.triangles.empty())
    refuse("triangles", "a mesh_resource has its own, got " +
                            std::to_string(shape.triangles.size()) + " numbers");
  const Vector3d scale = scale_of(shape);
  std::array<char, 128> key{};
  std::snprintf(key.data(), key.size(), " %.17g %.17g %.17g %zu", scale.x(), scale.y(), scale.z(),
                most_parts_of(shape));
  const auto known = files->known.find(uri + key.data());
  if (known != files->known.end()) return known->second;
  const std::string path = files->files.path(uri),
                    quoted = "'" + shortened(shape.mesh_resource, 200) + "'";
  if (path.empty())
    refuse("mesh_resource", "there is no file " + quoted +
                                "; give package://PACKAGE/PATH, file:///PATH or an absolute path");
  try {
    return files->known[uri + key.data()] =
               collision_of(read_scaled_mesh(path, scale), most_parts_of(shape));
  } catch (const std::invalid_argument& error) {
    refuse("mesh_resource", quoted + ": " + error.what());
  }
}

Isometry3d isometry(const Vector3d& position, const Eigen::Quaterniond& orientation) {
  return Eigen::Translation3d(position) * orientation.normalized();
}

/// Returns a mesh as markers of robots have it.
urdf::GeometryConstSharedPtr mesh_geometry(const Shape& shape, const std::string& uri) {
  auto mesh = std::make_shared<urdf::Mesh>();
  const Vector3d scale = scale_of(shape);
  mesh->filename = uri;
  mesh->scale = urdf::Vector3(scale.x(), scale.y(), scale.z());
  return mesh;
}

/// Returns the pose of a shape in its body.
Isometry3d pose_in_body(const Shape& shape) {
  const engine::ShapePose pose{from_msg(shape.pose.position), from_msg(shape.pose.orientation)};
  try {
    engine::validate(pose);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string("pose.") + error.what());
  }
  return isometry(pose.position, pose.orientation);
}

/// Divides the meshes of one body.
class Division {
 public:
  Division(const Body& body, FilesOfRequest* files, DividedMeshes* found)
      : body_(body), files_(files), found_(found) {}

  std::vector<Shape> shapes() {
    for (std::size_t i = 0; i < body_.shapes.size(); ++i) {
      const std::string where = "shapes[" + std::to_string(i) + "]";
      try {
        add(body_.shapes[i], where);
      } catch (const std::invalid_argument& error) {
        throw std::invalid_argument(where + "." + error.what());
      }
      if (shapes_.size() > engine::kMostParts)
        refuse("shapes", "must be at most " + std::to_string(engine::kMostParts) +
                             " with the parts of meshes, and the first " + std::to_string(i + 1) +
                             " are " + std::to_string(shapes_.size()));
    }
    return std::move(shapes_);
  }

 private:
  void add(const Shape& shape, const std::string& where);
  void add_hull(const Shape& mesh, const MeshHull& hull, const Isometry3d& in_body);
  /// Returns whether the body has its own centre in the centre of its only shape.
  bool is_centred() const {
    return body_.shapes.size() == 1 && body_.type == Body::DYNAMIC &&
           from_msg(body_.inertia) == Vector3d::Zero();
  }

  const Body& body_;
  FilesOfRequest* files_;
  DividedMeshes* found_;
  std::vector<Shape> shapes_;
};

void Division::add(const Shape& shape, const std::string& where) {
  // A later error would count the hulls of meshes before the shape.
  check_surface(shape);
  const Isometry3d pose = pose_in_body(shape);
  if (!is_mesh(shape)) {
    engine::validate(from_msg(shape));
    shapes_.push_back(shape);
    return;
  }
  if (!shape.dimensions.empty())
    refuse("dimensions", "a hull or a mesh has none, got " +
                             std::to_string(shape.dimensions.size()) + " numbers");
  if (is_centred() && !pose.isApprox(Isometry3d::Identity(), 0.0))
    refuse("pose",
           "a dynamic body needs an inertia where its only shape is beside the centre of mass");
  const std::string uri = mesh_uri(shape.mesh_resource, "");
  const MeshShape mesh = shape.mesh_resource.empty()
                             ? collision_of(mesh_in(shape), most_parts_of(shape))
                             : collision_of_file(shape, uri, files_);
  if (!uri.empty())
    found_->shown.push_back({body_.name, shapes_.size(), mesh.hulls.front().in_mesh.inverse(),
                             mesh_geometry(shape, uri)});
  const bool lies_in_centre = is_centred() && mesh.hulls.size() == 1;
  for (const MeshHull& hull : mesh.hulls)
    add_hull(shape, hull, lies_in_centre ? Isometry3d::Identity() : pose * hull.in_mesh);
  if (!found_->sentences.empty()) found_->sentences += "; ";
  found_->sentences += body_.name + ": " + where + " " + mesh.sentence;
}

void Division::add_hull(const Shape& mesh, const MeshHull& hull, const Isometry3d& in_body) {
  Shape& shape = shapes_.emplace_back();
  shape.type = Shape::HULL;
  shape.pose.position = to_point(in_body.translation());
  shape.pose.orientation = to_msg(Eigen::Quaterniond(in_body.linear()));
  shape.has_surface = mesh.has_surface;
  shape.friction = mesh.friction;
  shape.restitution = mesh.restitution;
  for (const Vector3d& vertex : hull.hull.surface->vertices())
    shape.vertices.push_back(to_point(vertex));
}

void divide(Body* body, FilesOfRequest* files, DividedMeshes* found) {
  if (std::any_of(body->shapes.begin(), body->shapes.end(), is_mesh))
    body->shapes = Division(*body, files, found).shapes();
}

}  // namespace

DividedMeshes divide_meshes(AddBodyRequest* request) {
  FilesOfRequest files;
  DividedMeshes found;
  divide(&request->body, &files, &found);
  return found;
}

DividedMeshes divide_meshes(ApplyEditsRequest* request) {
  check_size(*request);
  FilesOfRequest files;
  DividedMeshes found;
  for (std::size_t i = 0; i < request->bodies.size(); ++i) {
    try {
      divide(&request->bodies[i], &files, &found);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument("bodies[" + std::to_string(i) + "]: " + error.what());
    }
  }
  return found;
}

std::vector<RobotVisual> visuals_of(const DividedMeshes& meshes, const engine::World& world) {
  std::vector<RobotVisual> visuals;
  for (const ShownMesh& mesh : meshes.shown) {
    const engine::BodyId id = world.find_body(mesh.body);
    const engine::Body& body = world.body(id);
    const engine::ShapePose part = pose_of_part(body, mesh.part);
    visuals.push_back(
        {id, isometry(part.position, part.orientation) * mesh.in_part, mesh.geometry, body.color});
  }
  return visuals;
}

}  // namespace constraint_sim
