// Meshes of bodies in requests: hulls against solids whose points are known, their places, the
// places of their visuals, and what is rejected.

#include <constraint_sim/AddBody.h>
#include <constraint_sim/ApplyEdits.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "ros/body_meshes.h"
#include "ros/edits.h"
#include "ros/mesh_files.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;

/// A mesh of two boxes of 2 m, whose centres are at x = 1 m and x = 7 m.
Shape two_boxes() {
  Shape shape;
  shape.type = Shape::MESH;
  for (const double centre : {1.0, 7.0}) {
    const auto first = static_cast<std::uint32_t>(shape.vertices.size());
    for (int corner = 0; corner < 8; ++corner) {
      geometry_msgs::Point& vertex = shape.vertices.emplace_back();
      vertex.x = centre + ((corner & 1) != 0 ? 1.0 : -1.0);
      vertex.y = (corner & 2) != 0 ? 1.0 : -1.0;
      vertex.z = (corner & 4) != 0 ? 1.0 : -1.0;
    }
    for (const std::uint32_t vertex : {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                       2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5})
      shape.triangles.push_back(first + vertex);
  }
  return shape;
}

/// Returns a mesh with the first box of two_boxes().
Shape one_box() {
  Shape shape = two_boxes();
  shape.vertices.resize(8);
  shape.triangles.resize(36);
  return shape;
}

std::string write_obj(const std::string& name, const Shape& shape) {
  std::string path = testing::TempDir() + name;
  std::ofstream file(path);
  for (const geometry_msgs::Point& v : shape.vertices)
    file << "v " << v.x << ' ' << v.y << ' ' << v.z << '\n';
  for (std::size_t i = 0; i < shape.triangles.size(); i += 3)
    file << "f " << shape.triangles[i] + 1 << ' ' << shape.triangles[i + 1] + 1 << ' '
         << shape.triangles[i + 2] + 1 << '\n';
  return path;
}

Shape of_file(std::uint8_t type, const std::string& resource) {
  Shape shape;
  shape.type = type;
  shape.mesh_resource = resource;
  return shape;
}

AddBodyRequest request_of(const Shape& shape, std::uint8_t type = Body::STATIC) {
  AddBodyRequest request;
  request.body.name = "b";
  request.body.type = type;
  request.body.mass = 6.0;
  request.body.shapes = {shape};
  return request;
}

/// Adds the body of a request as the service does, and returns the visuals of its meshes.
std::vector<RobotVisual> add(AddBodyRequest request, World* world) {
  const DividedMeshes meshes = divide_meshes(&request);
  AddBodyResponse response;
  change(*world, request, &response);
  return visuals_of(meshes, *world);
}

engine::Body added(const AddBodyRequest& request) {
  World world;
  add(request, &world);
  return world.body(world.find_body("b"));
}

std::string error_with(const Shape& shape) {
  AddBodyRequest request = request_of(shape);
  try {
    divide_meshes(&request);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(BodyMeshes, OfAMessageCollideAsTheirParts) {
  AddBodyRequest request = request_of(two_boxes());
  const DividedMeshes meshes = divide_meshes(&request);
  EXPECT_EQ(meshes.sentences,
            "b: shapes[0] collides as 2 convex parts with 16 vertices (1 times its volume)");
  EXPECT_TRUE(meshes.shown.empty());  // no file that a viewer could read
  ASSERT_EQ(request.body.shapes.size(), 2u);
  double sum = 0.0;
  for (const Shape& hull : request.body.shapes) {
    EXPECT_EQ(hull.type, Shape::HULL);
    EXPECT_EQ(hull.vertices.size(), 8u);
    EXPECT_TRUE(hull.triangles.empty());
    sum += hull.pose.position.x;
  }
  EXPECT_NEAR(sum, 8.0, 1e-12);
}

// Vertices without a triangle are not of the surface.
TEST(BodyMeshes, AreTheirTriangles) {
  Shape shape = one_box();
  shape.vertices.emplace_back().z = 100.0;
  EXPECT_NEAR(engine::volume(added(request_of(shape)).shape), 8.0, 1e-12);
}

// The boxes stay where the vertices and the pose say, with the surface of the shape.
TEST(BodyMeshes, LieWhereTheirPoseSays) {
  Shape shape = two_boxes();
  shape.pose.position.y = 5.0;
  shape.pose.orientation.z = shape.pose.orientation.w = std::sqrt(0.5);  // x to y
  shape.has_surface = true;
  shape.friction = 0.7;
  const engine::Body body = added(request_of(shape));
  const auto& parts = *std::get<engine::Compound>(body.shape).parts;
  ASSERT_EQ(parts.size(), 2u);
  for (const engine::ShapePart& part : parts) {
    const double y = part.pose.position.y();
    EXPECT_LT(std::min(std::abs(y - 6.0), std::abs(y - 12.0)), 1e-12) << y;
    EXPECT_NEAR(part.pose.position.x(), 0.0, 1e-12);
    EXPECT_EQ(part.friction, 0.7);
  }
}

// Two cubes of edge 2 m and 3 kg: 3 · 8 / 12 = 2 kg m² each, and 3 · 3² each across x.
TEST(BodyMeshes, OfHomogeneousBodiesHaveTheirInertia) {
  const engine::Body body = added(request_of(two_boxes(), Body::DYNAMIC));
  Vector3d inertia = 6.0 * engine::unit_inertia(body.shape);
  std::sort(inertia.data(), inertia.data() + 3);
  EXPECT_LT((inertia - Vector3d(4.0, 58.0, 58.0)).norm(), 1e-10) << inertia.transpose();
}

// The origin of the mesh is 4 m from the centre of both boxes, and 1 m from that of the first.
TEST(BodyMeshes, OfFilesAreShownWhereTheyCollide) {
  const std::string both = "file://" + write_obj("both.obj", two_boxes());
  const std::string one = "file://" + write_obj("one.obj", one_box());
  for (const auto& [uri, type, distance] :
       {std::tuple{both, Shape::MESH, 4.0}, {both, Shape::HULL, 4.0}, {one, Shape::MESH, 1.0}}) {
    for (const std::uint8_t kind : {Body::DYNAMIC, Body::STATIC}) {
      World world;
      const std::vector<RobotVisual> visuals = add(request_of(of_file(type, uri), kind), &world);
      ASSERT_EQ(visuals.size(), 1u);
      EXPECT_EQ(visuals[0].body, world.find_body("b"));
      EXPECT_EQ(static_cast<const urdf::Mesh&>(*visuals[0].geometry).filename, uri);
      const double moved = visuals[0].in_body.translation().norm();
      EXPECT_NEAR(moved, kind == Body::DYNAMIC ? distance : 0.0, 1e-9) << uri << int{type};
      EXPECT_FALSE(visuals[0].colour);
      const std::size_t parts = engine::part_count(world.body(visuals[0].body).shape);
      EXPECT_EQ(parts, uri == both && type == Shape::MESH ? 2u : 1u);
    }
  }
}

TEST(BodyMeshes, HaveTheScaleOfTheRequest) {
  Shape shape = of_file(Shape::HULL, write_obj("scaled.obj", one_box()));
  shape.mesh_scale.x = 0.5;
  shape.mesh_scale.y = -2.0;
  shape.mesh_scale.z = 1.0;
  const engine::Body body = added(request_of(shape));
  EXPECT_NEAR(engine::volume(body.shape), 8.0, 1e-12);
  EXPECT_LT((body.shape_pose.value().position - Vector3d(0.5, 0.0, 0.0)).norm(), 1e-12);
}

TEST(BodyMeshes, AreRejectedByFieldAndValue) {
  const auto expect = [](const std::function<void(Shape*)>& change, const std::string& begin) {
    Shape shape = two_boxes();
    change(&shape);
    EXPECT_EQ(error_with(shape).rfind("shapes[0]." + begin, 0), 0u) << error_with(shape);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  expect([](Shape* s) { s->triangles.clear(); }, "triangles: a mesh without mesh_resource has 1");
  expect([](Shape* s) { s->triangles.pop_back(); }, "triangles: a mesh without mesh_resource");
  expect([](Shape* s) { std::fill(s->triangles.begin(), s->triangles.end(), 0); },
         "triangles: must have three different points, and none of 24 has");
  expect([](Shape* s) { s->friction = 0.5; }, "has_surface: must be true");
  expect([](Shape* s) { s->triangles[4] = 16; },
         "triangles[4]: must be the number of a vertex, below 16, got 16");
  expect([=](Shape* s) { s->vertices[2].y = nan; },
         "vertices[2]: must be finite numbers, got 0, nan, -1");
  expect([](Shape* s) { s->vertices.resize(kMostVerticesInMessage + 1); }, "vertices: must be at");
  expect([](Shape* s) { s->dimensions = {1.0}; }, "dimensions: a hull or a mesh has none, got 1");
  expect([](Shape* s) { s->mesh_scale.x = 2.0; }, "mesh_scale: only a mesh_resource has one");
  expect([](Shape* s) { s->pose.orientation.w = 2.0; }, "pose.orientation: ");
  expect(
      [](Shape* s) {
        for (geometry_msgs::Point& vertex : s->vertices) vertex.z = 0.0;
      },
      "vertices: ");
  expect([](Shape* s) { s->mesh_resource = "x.stl"; }, "vertices: a mesh_resource has its own");
  const auto expect_of_file = [](const std::string& uri, const std::string& begin) {
    const std::string error = error_with(of_file(Shape::MESH, uri));
    EXPECT_EQ(error.rfind("shapes[0].mesh_resource: " + begin, 0), 0u) << error;
  };
  for (const char* missing : {"x.stl", "file:///none.stl", "package://nobody_has/x.stl",
                              "/dev/zero", "http://127.0.0.1/x.stl", "package://", "file:///etc"})
    expect_of_file(missing, "there is no file '" + std::string(missing) + "'");
  expect_of_file("file:///etc/hostname", "'file:///etc/hostname': it cannot be read");
  Shape shape = of_file(Shape::MESH, write_obj("rejected.obj", one_box()));
  shape.mesh_scale.x = 1.0;
  EXPECT_EQ(error_with(shape),
            "shapes[0].mesh_scale: must be finite numbers other than 0, or all 0, got 1, 0, 0");
}

// A homogeneous body has its centre in that of its only shape, which no pose can move.
TEST(BodyMeshes, OfHomogeneousBodiesHaveNoPose) {
  for (const Shape& mesh : {one_box(), two_boxes()}) {
    AddBodyRequest request = request_of(mesh, Body::DYNAMIC);
    request.body.shapes[0].pose.position.x = 1.0;
    World world;
    EXPECT_THROW(add(request, &world), std::invalid_argument);
    request.body.inertia.x = request.body.inertia.y = request.body.inertia.z = 1.0;
    add(request, &world);
    EXPECT_TRUE(world.has_body("b"));
  }
}

TEST(BodyMeshes, OfManyEditsAreNamedByTheirBody) {
  ApplyEditsRequest request;
  request.bodies = {request_of(one_box()).body, request_of(two_boxes()).body};
  request.bodies[1].name = "c";
  EXPECT_EQ(divide_meshes(&request).sentences,
            "b: shapes[0] collides as its convex hull with 8 vertices; "
            "c: shapes[0] collides as 2 convex parts with 16 vertices (1 times its volume)");
  const auto expect = [&](const Shape& second, const std::string& begin) {
    request.bodies[0].shapes = {two_boxes(), second};
    try {
      divide_meshes(&request);
      ADD_FAILURE() << begin;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind("bodies[0]: shapes[1]." + begin, 0), 0u)
          << error.what();
    }
  };
  Shape second;
  second.type = 9;
  expect(second, "type: ");
  second.type = Shape::SPHERE;
  second.dimensions = {-1.0};
  expect(second, "shape.radius: ");
  second.dimensions = {1.0};
  second.friction = 0.5;
  expect(second, "has_surface: ");
}

}  // namespace
}  // namespace constraint_sim
