// Collision meshes of URDFs: hulls, convex parts, volumes and inertias against solids whose points
// are known, and files that are no solids.

#include <array>
#include <cmath>
#include <cstdio>
#include <functional>

#include "draw.h"
#include "robots.h"
#include "urdf/convex_parts.h"
#include "urdf/mesh_file.h"
#include "urdf/mesh_shapes.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using engine::BodyId;
using engine::World;

// ---- solids

int to_int(std::size_t n) { return static_cast<int>(n); }

/// Adds a polygon of corners, counter-clockwise and divided into triangles, times an interval of z.
void add_prism(const std::vector<Eigen::Vector2d>& corners,
               const std::vector<TriangleMesh::Triangle>& top, double low, double high,
               TriangleMesh* mesh) {
  const int first = to_int(mesh->points.size()), n = to_int(corners.size());
  for (const double z : {low, high})
    for (const Eigen::Vector2d& c : corners) mesh->points.emplace_back(c.x(), c.y(), z);
  for (const auto& [a, b, c] : top) {
    mesh->triangles.push_back({first + a, first + c, first + b});
    mesh->triangles.push_back({first + n + a, first + n + b, first + n + c});
  }
  for (int i = 0; i < n; ++i) {
    const int j = (i + 1) % n;
    mesh->triangles.push_back({first + i, first + j, first + n + j});
    mesh->triangles.push_back({first + i, first + n + j, first + n + i});
  }
}

void add_box(const Vector3d& low, const Vector3d& high, TriangleMesh* mesh) {
  add_prism({{low.x(), low.y()}, {high.x(), low.y()}, {high.x(), high.y()}, {low.x(), high.y()}},
            {{0, 1, 2}, {0, 2, 3}}, low.z(), high.z(), mesh);
}

/// A channel of 3 x 1 x 2 m along y, open above: walls and floor are 1 m thick.
TriangleMesh channel() {
  TriangleMesh mesh;
  add_prism({{0, 0}, {3, 0}, {3, 2}, {2, 2}, {2, 1}, {1, 1}, {1, 2}, {0, 2}},
            {{0, 1, 4}, {1, 2, 3}, {1, 3, 4}, {0, 4, 5}, {0, 5, 7}, {5, 6, 7}}, 0.0, 1.0, &mesh);
  for (Vector3d& p : mesh.points) p = Vector3d(p.x() - 1.5, p.z() - 0.5, p.y());
  for (TriangleMesh::Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

bool is_in_channel(const Vector3d& p) {
  const bool is_in_box =
      std::abs(p.x()) < 1.5 && std::abs(p.y()) < 0.5 && p.z() > 0.0 && p.z() < 2.0;
  return is_in_box && !(std::abs(p.x()) < 0.5 && p.z() > 1.0);
}

/// A torus of radii 1 m and 0.3 m about z, of quadrilaterals in two triangles.
TriangleMesh torus(int around, int across) {
  TriangleMesh mesh;
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const double u = 2.0 * M_PI * i / around, v = 2.0 * M_PI * j / across;
      const double r = 1.0 + 0.3 * std::cos(v);
      mesh.points.emplace_back(r * std::cos(u), r * std::sin(u), 0.3 * std::sin(v));
    }
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const int next_i = (i + 1) % around, next_j = (j + 1) % across;
      const int a = i * across + j, b = next_i * across + j, c = next_i * across + next_j,
                d = i * across + next_j;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  return mesh;
}

std::string write_stl(const std::string& name, const TriangleMesh& mesh) {
  const std::string path = testing::TempDir() + name;
  std::ofstream file(path);
  file << "solid s\n";
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    file << "facet normal 0 0 0\nouter loop\n";
    for (const int corner : t) {
      const Vector3d& p = mesh.points[static_cast<std::size_t>(corner)];
      file << "vertex " << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
    }
    file << "endloop\nendfacet\n";
  }
  file << "endsolid s\n";
  return path;
}

MeshShape shape_of_file(const std::string& path, std::size_t most_parts = kMostMeshParts,
                        const Vector3d& scale = Vector3d::Ones()) {
  urdf::Mesh mesh;
  mesh.filename = "file://" + path;
  mesh.scale = urdf::Vector3(scale.x(), scale.y(), scale.z());
  return MeshShapes({}, {{"link", most_parts}}).of("link", mesh);
}

/// Returns how far a point is outside of all hulls of a shape [m]; below 0 inside of one.
double outside(const MeshShape& shape, const Vector3d& p) {
  double least = engine::kInfinity;
  for (const MeshHull& hull : shape.hulls) {
    const Vector3d in_hull = hull.in_mesh.inverse() * p;
    double most = -engine::kInfinity;
    for (const auto& face : hull.hull.surface->faces())
      most = std::max(most, face.normal.dot(in_hull) - face.offset);
    least = std::min(least, most);
  }
  return least;
}

std::string sentence_of(const std::string& path, const std::string& how) {
  return "the mesh 'file://" + path + "' " + how;
}

// ---- surfaces

TEST(MeshShapes, VolumesAreThoseOfClosedSurfaces) {
  TriangleMesh mesh = channel();
  EXPECT_NEAR(*enclosed_volume(mesh), 5.0, 1e-14);
  for (TriangleMesh::Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  EXPECT_NEAR(*enclosed_volume(mesh), -5.0, 1e-14);
  std::swap(mesh.triangles[3][1], mesh.triangles[3][2]);  // one triangle turned over
  EXPECT_FALSE(enclosed_volume(mesh));
  mesh.triangles.erase(mesh.triangles.begin() + 3);  // open
  EXPECT_FALSE(enclosed_volume(mesh));
  EXPECT_FALSE(enclosed_volume({}));
}

TEST(MeshShapes, EqualPointsAreUnited) {
  const TriangleMesh solid = channel();
  TriangleMesh soup;
  for (const TriangleMesh::Triangle& t : solid.triangles) {
    const int first = to_int(soup.points.size());
    for (const int corner : t)
      soup.points.push_back(solid.points[static_cast<std::size_t>(corner)]);
    soup.triangles.push_back({first, first + 1, first + 2});
  }
  soup.triangles.push_back({0, 0, 1});
  unite_equal_points(&soup);
  EXPECT_EQ(soup.points.size(), solid.points.size());
  EXPECT_EQ(soup.triangles.size(), solid.triangles.size());
  EXPECT_NEAR(*enclosed_volume(soup), 5.0, 1e-14);
}

// ---- hulls

// A right tetrahedron with legs 1, 2, 3 beside the origin: its centre is at a quarter of each leg.
TEST(MeshShapes, ConvexMeshesAreTheirHulls) {
  const Vector3d o(0, 0, 0), x(1, 0, 0), y(0, 2, 0), z(0, 0, 3);
  const std::string path =
      write_stl("tetrahedron.stl", {{o, x, y, z}, {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}});
  ASSERT_NO_THROW(read_mesh(path));  // built with assimp
  const std::string flat = write_stl("flat.stl", {{o, x, y}, {{0, 1, 2}, {0, 2, 1}}});
  const std::string inertial =
      "<inertial><mass value='1'/><inertia ixx='0.1' ixy='0' ixz='0' iyy='0.1' iyz='0' izz='0.1'/>"
      "</inertial>";
  const auto mesh = [](const std::string& file, const char* scale) {
    return "<collision><origin xyz='0 0 5'/><geometry><mesh filename='file://" + file +
           "' scale='" + scale + "'/></geometry></collision>";
  };
  World world;
  const Robot r =
      add_robot("<robot name='r'><link name='a'>" + inertial + mesh(path, "0.1 0.1 0.2") +
                    "</link><link name='b'>" + inertial + mesh(flat, "1 1 1") +
                    "</link><joint name='j' type='floating'><parent link='a'/><child link='b'/>"
                    "</joint></robot>",
                {}, &world);
  const engine::Body& body = world.body(world.find_body("a/com"));
  const auto& surface = *std::get<engine::Hull>(body.shape).surface;
  EXPECT_EQ(surface.vertices().size(), 4u);
  EXPECT_NEAR(surface.volume(), 0.1 * 0.1 * 0.2, 1e-9);  // single precision of meshes
  EXPECT_TRUE(surface.is_centred());
  ASSERT_TRUE(body.shape_pose);
  EXPECT_TRUE(std::holds_alternative<engine::Point>(world.body(world.find_body("b/com")).shape));
  const engine::BodyState& state = world.state(world.find_body("a/com"));
  const Vector3d centre = state.position + state.orientation * body.shape_pose->position;
  EXPECT_LT((centre - Vector3d(0.025, 0.05, 5.15)).norm(), 1e-7);
  ASSERT_EQ(r.warnings.size(), 2u);
  EXPECT_EQ(r.warnings[0],
            "link 'a': " + sentence_of(path, "collides as its convex hull with 4 vertices"));
  EXPECT_EQ(r.warnings[1].find("link 'b': " + sentence_of(flat, "does not collide: ")), 0u);
}

TEST(MeshShapes, ALinkMayAskForTheHull) {
  const std::string path = write_stl("channel.stl", channel());
  const MeshShape shape = shape_of_file(path, 1);
  ASSERT_EQ(shape.hulls.size(), 1u);
  EXPECT_NEAR(shape.hulls[0].hull.surface->volume(), 6.0, 1e-12);
  EXPECT_EQ(
      shape.sentence,
      sentence_of(path, "collides as its convex hull with 8 vertices (1.2 times its volume)"));
}

// ---- convex parts

TEST(MeshShapes, AChannelIsThreeBoxes) {
  ASSERT_TRUE(divides_meshes());
  const std::string path = write_stl("channel.stl", channel());
  for (const Vector3d& scale : {Vector3d(1.0, 1.0, 1.0), Vector3d(1e-3, 1e-3, 1e-3),
                                Vector3d(0.5, -2.0, 1.0), Vector3d(-1.0, -1.0, -1.0)}) {
    const MeshShape shape = shape_of_file(path, kMostMeshParts, scale);
    ASSERT_EQ(shape.hulls.size(), 3u) << shape.sentence;
    EXPECT_EQ(shape.sentence, sentence_of(path,
                                          "collides as 3 convex parts with 24 vertices "
                                          "(1 times its volume)"));
    engine::Draw draw(1);
    for (int i = 0; i < 2000; ++i) {
      const Vector3d p = draw.vector_between(-2.5, 2.5);
      // points within 1e-6 of the surface do not occur
      EXPECT_EQ(outside(shape, p.cwiseProduct(scale)) < 0.0, is_in_channel(p)) << p.transpose();
    }
  }
}

TEST(MeshShapes, PiecesThatAreApartAreParts) {
  TriangleMesh mesh;
  add_box({0, 0, 0}, {1, 2, 3}, &mesh);
  add_box({4, 0, 0}, {6, 1, 1}, &mesh);
  const MeshShape shape = shape_of_file(write_stl("pieces.stl", mesh));
  ASSERT_EQ(shape.hulls.size(), 2u);
  EXPECT_NE(shape.sentence.find("(1 times its volume)"), std::string::npos) << shape.sentence;
  double volume = 0.0;
  for (const MeshHull& hull : shape.hulls) volume += hull.hull.surface->volume();
  EXPECT_NEAR(volume, 6.0 + 2.0, 1e-12);
}

// Coarse and fine meshes: parts fill the hole by at most 2 % of the diagonal and a cell of the
// grid, where that suffices, which it does here, and leave none of the surface bare.
TEST(MeshShapes, ATorusKeepsItsHole) {
  for (const auto& [around, across] :
       {std::array{24, 12}, std::array{40, 20}, std::array{100, 50}, std::array{200, 100}}) {
    const TriangleMesh mesh = torus(around, across);
    const MeshShape shape = shape_of_file(write_stl("torus.stl", mesh));
    ASSERT_GT(shape.hulls.size(), 3u) << shape.sentence;
    ASSERT_LE(shape.hulls.size(), kMostMeshParts);
    for (const Vector3d& p : mesh.points)
      EXPECT_LT(outside(shape, p), 0.02);  // parts have 128 vertices
    engine::Draw draw(2);
    for (int i = 0; i < 2000; ++i) {
      const Vector3d p = 1.5 * draw.vector();
      const double from_surface = std::hypot(std::hypot(p.x(), p.y()) - 1.0, p.z()) - 0.3;
      if (from_surface < 0.25) continue;
      EXPECT_GT(outside(shape, p), 0.0) << p.transpose();
    }
  }
}

// A pin that is thinner than a cell of the grid stays whole.
TEST(MeshShapes, ThinPinsOfFineMeshesCollide) {
  TriangleMesh mesh = torus(60, 30);
  add_box({0.0, -0.001, -0.001}, {0.8, 0.001, 0.001}, &mesh);
  const MeshShape shape = shape_of_file(write_stl("pin.stl", mesh));
  ASSERT_GT(shape.hulls.size(), 1u) << shape.sentence;
  for (const Vector3d& p : mesh.points) EXPECT_LT(outside(shape, p), 0.02) << p.transpose();
}

TEST(MeshShapes, SoupsOfTrianglesCollideOrAreNamed) {
  engine::Draw draw(3);
  for (int i = 0; i < 20; ++i) {
    TriangleMesh soup;
    const int points = 4 + draw.below(60), triangles = 1 + draw.below(300);
    for (int k = 0; k < points; ++k)
      soup.points.push_back(i % 4 == 0 ? Vector3d(draw.below(3), draw.below(3), draw.below(3))
                                       : draw.vector());
    for (int k = 0; k < triangles; ++k)
      soup.triangles.push_back({draw.below(points), draw.below(points), draw.below(points)});
    const MeshShape shape = shape_of_file(write_stl("soup.stl", soup));
    EXPECT_LE(shape.hulls.size(), kMostMeshParts);
    EXPECT_EQ(shape.hulls.empty(), shape.sentence.find("does not collide") != std::string::npos);
    EXPECT_NE(shape.sentence.find("collide"), std::string::npos);
  }
}

// ---- robots

std::string robot_of_mesh(const std::string& path, const std::string& inertial) {
  return "<robot name='r'><link name='a'>" + inertial +
         "<collision><geometry><mesh filename='file://" + path +
         "'/></geometry></collision></link></robot>";
}

// A ball that falls into a channel comes to rest on its floor; by the hull it would rest on top.
TEST(MeshShapes, ABallFallsIntoAChannel) {
  const std::string path = write_stl("channel.stl", channel());
  for (const int most : {1, 16}) {
    World world;
    RobotOptions options;
    options.fixed = true;
    options.extra = "links: {a: {convex_parts: " + std::to_string(most) + "}}";
    add_robot(robot_of_mesh(path, ""), options, &world);
    ASSERT_EQ(world.body_ids().size(), 1u);
    EXPECT_EQ(engine::part_count(world.body(world.body_ids()[0]).shape), most == 1 ? 1u : 3u);
    const BodyId ball = world.add_body(
        engine::make_body("ball", engine::Sphere{0.3}, 1.0, Vector3d(0.05, 0.0, 2.5)));
    engine::run(world, 400);
    const double floor = most == 1 ? 2.0 : 1.0;
    EXPECT_NEAR(world.state(ball).position.z(), floor + 0.3, engine::slop(world));
  }
}

// Two boxes of one density have the inertia of the solid, however they are divided.
TEST(MeshShapes, InertiasOfPartsAreThoseOfTheSolid) {
  TriangleMesh mesh;
  add_box({-3, -1, -1}, {-1, 1, 1}, &mesh);
  add_box({1, -1, -1}, {3, 1, 1}, &mesh);
  const std::string path = write_stl("dumbbell.stl", mesh);
  World world;
  const Robot r = add_robot(
      robot_of_mesh(path,
                    "<inertial><mass value='6'/><inertia ixx='0' ixy='0' ixz='0' iyy='0' iyz='0' "
                    "izz='0'/></inertial>"),
      {}, &world);
  ASSERT_EQ(r.bodies, std::vector<std::string>{"a/com"});
  const engine::Body& body = world.body(world.find_body("a/com"));
  ASSERT_EQ(engine::part_count(body.shape), 2u);
  const Vector3d& inertia = body.inertia;
  // two cubes of edge 2 and mass 3 kg: 3 · 8 / 12 = 2 each, and 3 · 2² each across x
  EXPECT_LT((inertia - Vector3d(4.0, 28.0, 28.0)).norm(), 1e-12);
}

TEST(MeshShapes, NumbersOfPartsAreChecked) {
  for (const char* parts : {"0", "17", "-1", "1.5", "many"}) {
    World world;
    RobotOptions options;
    options.extra = std::string("links: {a: {convex_parts: ") + parts + "}}";
    const std::string sentence = engine::refusal(
        [&] { add_robot("<robot name='r'><link name='a'/></robot>", options, &world); });
    EXPECT_NE(sentence.find("convex_parts"), std::string::npos) << sentence;
  }
}

}  // namespace
}  // namespace constraint_sim
