// Contact geometry of convex hulls. Oracles: all face normals and crossed edges for overlaps, all
// pairs of vertices, edges and faces for distances, and boxes.

#include <ctime>

#include "constraint_sim/engine/convex_hull.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/collision/narrowphase.h"
#include "memory_peak.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

Points corners_of(const Vector3d& size) {
  Points corners;
  for (unsigned i = 0; i < 8; ++i)
    corners.push_back(
        0.5 * size.cwiseProduct(Vector3d((i & 1u) != 0 ? 1.0 : -1.0, (i & 2u) != 0 ? 1.0 : -1.0,
                                         (i & 4u) != 0 ? 1.0 : -1.0)));
  return corners;
}

Hull random_hull(Random* random) {
  Points points;
  const int count = 12 + static_cast<int>(8.0 * (*random)());
  for (int i = 0; i < count; ++i) points.push_back(0.5 * random->vector());
  try {
    return Hull(points);
  } catch (const std::invalid_argument&) {
    return random_hull(random);
  }
}

BodyState pose(const Vector3d& position, const Eigen::Quaterniond& orientation) {
  BodyState state;
  state.position = position;
  state.orientation = orientation;
  return state;
}

Points placed(const Points& vertices, const BodyState& state) {
  Points points;
  for (const Vector3d& v : vertices) points.push_back(state.position + state.orientation * v);
  return points;
}

/// Returns the gap of A and B along n, from B to A.
double gap_along(const Points& a, const Points& b, const Vector3d& n) {
  double least = kInfinity, most = -kInfinity;
  for (const Vector3d& p : a) least = std::min(least, n.dot(p));
  for (const Vector3d& p : b) most = std::max(most, n.dot(p));
  return least - most;
}

/// Returns the greatest gap along normals of faces and along crossed edges.
double greatest_gap(const ConvexHull& a, const BodyState& at_a, const ConvexHull& b,
                    const BodyState& at_b) {
  const Points of_a = placed(a.vertices(), at_a), of_b = placed(b.vertices(), at_b);
  double most = -kInfinity;
  const auto attempt = [&](const Vector3d& n) {
    most = std::max({most, gap_along(of_a, of_b, n), gap_along(of_a, of_b, -n)});
  };
  for (const auto& face : a.faces()) attempt(at_a.orientation * face.normal);
  for (const auto& face : b.faces()) attempt(at_b.orientation * face.normal);
  for (const auto& edge_a : a.edges())
    for (const auto& edge_b : b.edges()) {
      const Vector3d n =
          (at_a.orientation * edge_a.direction).cross(at_b.orientation * edge_b.direction);
      if (n.norm() > 1e-9) attempt(n.normalized());
    }
  return most;
}

double distance_of_segments(const Vector3d& p, const Vector3d& d, const Vector3d& q,
                            const Vector3d& e) {
  const auto to_segment = [](const Vector3d& x, const Vector3d& from, const Vector3d& direction) {
    const double s = std::clamp(direction.dot(x - from) / direction.squaredNorm(), 0.0, 1.0);
    return (x - from - s * direction).norm();
  };
  double least = std::min(
      {to_segment(p, q, e), to_segment(p + d, q, e), to_segment(q, p, d), to_segment(q + e, p, d)});
  const Vector3d n = d.cross(e);
  if (n.squaredNorm() > 1e-18) {
    const double s = n.dot((q - p).cross(e)) / n.squaredNorm();
    const double t = n.dot((q - p).cross(d)) / n.squaredNorm();
    if (s >= 0.0 && s <= 1.0 && t >= 0.0 && t <= 1.0)
      least = std::min(least, (p + s * d - q - t * e).norm());
  }
  return least;
}

/// Returns the distance of a point above a face from it; infinite elsewhere.
double distance_of_face(const ConvexHull& hull, const ConvexHull::Face& face, const Vector3d& x) {
  for (int k = 0; k < face.count; ++k) {
    const auto corner = [&](int i) -> const Vector3d& {
      const int at = hull.corners()[static_cast<std::size_t>(face.first + i % face.count)].vertex;
      return hull.vertices()[static_cast<std::size_t>(at)];
    };
    if ((corner(k + 1) - corner(k)).cross(face.normal).dot(x - corner(k)) > 0.0) return kInfinity;
  }
  const double height = face.normal.dot(x) - face.offset;
  return height >= 0.0 ? height : kInfinity;
}

/// Returns the distance of two hulls that do not overlap, over all pairs of features.
double least_distance(const ConvexHull& a, const BodyState& at_a, const ConvexHull& b,
                      const BodyState& at_b) {
  double least = kInfinity;
  const Points of_a = placed(a.vertices(), at_a), of_b = placed(b.vertices(), at_b);
  for (const auto& edge_a : a.edges())
    for (const auto& edge_b : b.edges())
      least = std::min(least, distance_of_segments(of_a[static_cast<std::size_t>(edge_a.from)],
                                                   at_a.orientation * edge_a.direction,
                                                   of_b[static_cast<std::size_t>(edge_b.from)],
                                                   at_b.orientation * edge_b.direction));
  const auto faces_to = [&](const ConvexHull& hull, const BodyState& at, const Points& points) {
    for (const Vector3d& p : points)
      for (const auto& face : hull.faces())
        least = std::min(
            least, distance_of_face(hull, face, at.orientation.conjugate() * (p - at.position)));
  };
  faces_to(a, at_a, of_b);
  faces_to(b, at_b, of_a);
  return least;
}

TEST(HullSurfaces, MomentsAreThoseOfTheSolid) {
  // Box: closed form, to rounding.
  const ConvexHull box(corners_of({0.4, 1.0, 2.5}));
  EXPECT_EQ(box.faces().size(), 6u);
  EXPECT_EQ(box.edges().size(), 12u);
  EXPECT_NEAR(box.volume(), 1.0, 1e-14);
  EXPECT_LT((box.unit_inertia() - unit_inertia(Box{{0.4, 1.0, 2.5}})).norm(), 1e-14);
  EXPECT_TRUE(box.is_centred());

  // Regular tetrahedron of edge s: volume s³/(6√2), moments s²/20 in all directions.
  const ConvexHull tetrahedron(Points{{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}});
  EXPECT_NEAR(tetrahedron.volume(), 8.0 / 3.0, 1e-14);
  EXPECT_LT((tetrahedron.unit_inertia() - Vector3d::Constant(8.0 / 20.0)).norm(), 1e-14);

  // Right tetrahedron at the origin with legs a, b, c: centre at a quarter of each.
  const ConvexHull corner(Points{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}});
  EXPECT_NEAR(corner.volume(), 1.0, 1e-14);
  EXPECT_LT((corner.centre() - Vector3d(0.25, 0.5, 0.75)).norm(), 1e-14);
  EXPECT_FALSE(corner.is_centred());
}

TEST(HullSurfaces, AreMovedToTheirCentreInABody) {
  Random random;
  for (int i = 0; i < 100; ++i) {
    const Hull hull = random_hull(&random);
    World world;
    Body body;
    body.name = "a";
    body.type = BodyType::kStatic;
    body.shape = hull;
    body.shape_pose = ShapePose{random.vector(), random.orientation()};
    const Body& added = world.body(world.add_body(body));
    const auto& centred = *std::get<Hull>(added.shape).surface;
    EXPECT_TRUE(centred.is_centred());
    const Points before = placed(hull.surface->vertices(),
                                 pose(body.shape_pose->position, body.shape_pose->orientation));
    const Points after =
        placed(centred.vertices(), pose(added.shape_pose->position, added.shape_pose->orientation));
    ASSERT_EQ(before.size(), after.size());
    for (std::size_t k = 0; k < before.size(); ++k)
      EXPECT_LT((before[k] - after[k]).norm(), 1e-14);  // rounding
    EXPECT_EQ(ConvexHull(centred.vertices()).vertices(), centred.vertices());

    body.name = "b";
    body.type = BodyType::kDynamic;
    body.shape_pose.reset();
    body.mass = 2.0;
    EXPECT_FALSE(world.body(world.add_body(body)).shape_pose);
  }
}

// A needle is centred to 1e-12 of its length by the second move. A saved scene moves no hull again.
TEST(HullSurfaces, OfNeedlesAreSavedAsTheyAre) {
  Random random;
  for (int i = 0; i < 100; ++i) {
    const double width = std::pow(10.0, -2.5 + 1.5 * random());
    const Eigen::Quaterniond turn = random.orientation();
    Points points;
    for (int k = 0; k < 12; ++k)
      points.emplace_back(turn * random.vector().cwiseProduct(Vector3d(1.0, width, width)));
    World world;
    Body body = make_body("needle", Hull(points), 1.0, Vector3d::Zero());
    body.type = BodyType::kStatic;
    world.add_body(body);
    const std::string text = save_scene(world);
    EXPECT_EQ(save_scene(load_scene(text)), text);
  }
}

TEST(HullSurfaces, DegeneratePointsAreRejected) {
  const auto error_of = [](const Points& points) -> std::string {
    try {
      const ConvexHull hull(points);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(error_of({}), "vertices: must be at least 4, got 0");
  EXPECT_EQ(error_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}), "vertices: must be at least 4, got 3");
  EXPECT_EQ(error_of(Points(5, Vector3d(1, 2, 3))), "vertices: all points are equal");
  EXPECT_EQ(error_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}),
            "vertices: the points lie in a plane, and have no hull");
  EXPECT_EQ(error_of({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}),
            "vertices: the points lie in a plane, and have no hull");
  EXPECT_NE(error_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1e-8}}), "");
  EXPECT_NE(error_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, nan}}).find("finite"),
            std::string::npos);
  // Volumes and moments of smaller hulls would be 0, and their inverses not finite.
  EXPECT_EQ(error_of({{0, 0, 0}, {4e-20, 0, 0}, {0, 4e-20, 0}, {0, 0, 4e-20}}), "");
  EXPECT_NE(error_of({{0, 0, 0}, {1e-60, 0, 0}, {0, 1e-60, 0}, {0, 0, 1e-60}})
                .find("thickness of the hull: must be from 1e-20 to 1e+20, got"),
            std::string::npos);
  // Needle of 1000 km, 2 m thick: triangles up to a metre apart are one face.
  EXPECT_EQ(error_of({{1.0431340379477041, -0.16926108197760253, -250000.51785730786},
                      {0.0, 0.0, 749999.98214325856},
                      {-0.99357766330835628, 0.14980471321649319, -249999.0178564864},
                      {-0.62978013593412829, 1.6885219478375058, -249999.51785711737},
                      {0.36620917015679944, 1.7779863182390858, -250001.01785759357}}),
            "vertices: the points lie too close to a plane or line");
  EXPECT_NE(error_of(Points(kMostHullPoints + 1, Vector3d::Zero())).find("at most 100000"),
            std::string::npos);
  Random random;
  Points ball;
  for (int i = 0; i < 600; ++i) ball.push_back(random.vector().normalized());
  EXPECT_NE(error_of(ball).find("at most 512 vertices, got 600"), std::string::npos);
  // Duplicates and points inside are no vertices.
  Points cube = corners_of({1, 1, 1});
  const Points once = cube;
  cube.insert(cube.end(), once.begin(), once.end());
  cube.emplace_back(0.1, 0.2, 0.3);
  cube.emplace_back(0.0, 0.0, 0.5);
  EXPECT_EQ(ConvexHull(cube).faces().size(), 6u);
}

TEST(HullSurfaces, LeaveNoMemoryWhereTheyAreRejected) {
  const Points plane{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  const auto reject = [&](int times) {
    for (int i = 0; i < times; ++i) EXPECT_NE(refusal([&] { ConvexHull hull(plane); }), "");
  };
  reject(10);
  const MemoryPeak peak;
  reject(1000);
  // Qhull takes 131 kB for each; sanitizers keep some of what was freed.
  EXPECT_LT(peak.grown_by(), (kSanitizedShare > 1 ? 100.0 : 4.0) * 1e6);
}

// The place of a hull follows from its pose and the centre of its vertices.
TEST(HullSurfaces, AreRejectedWhereTheirCentreIsOutOfBounds) {
  World world;
  Body body = make_body("a", Hull({{0, 0, 0}, {1e6, 0, 0}, {0, 1e6, 0}, {0, 0, -1e6}}), 1.0,
                        Vector3d::Zero());
  body.inertia = {1e12, 1e12, 1e12};
  body.shape_pose = ShapePose{{0.0, 0.0, -kMostMagnitude}, Eigen::Quaterniond::Identity()};
  EXPECT_NE(refusal([&] { world.add_body(body); }).find("position: must be at most 1e+20, got"),
            std::string::npos);
  EXPECT_TRUE(world.body_ids().empty());
  body.shape_pose->position.z() = 0.5 * kMostMagnitude;
  world.add_body(body);
  EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), world.state_hash());
}

// Qhull sees many points twice: once to find those that can be vertices, once with these alone.
TEST(HullSurfaces, HoldAllOfManyPoints) {
  Random random;
  Points points;
  for (int i = 0; i < 20000; ++i) points.push_back(random.vector());
  const ConvexHull hull(points);
  for (const Vector3d& p : points)
    for (const ConvexHull::Face& face : hull.faces())
      ASSERT_LE(face.normal.dot(p) - face.offset, 1e-12);  // rounding of points of size 1
  for (const Vector3d& vertex : hull.vertices())
    EXPECT_NE(std::find(points.begin(), points.end(), vertex), points.end());
  EXPECT_EQ(ConvexHull(hull.vertices()).vertices(), hull.vertices());
}

// Each point is a vertex. Without a bound on vertices Qhull takes 0.7 s of the processor for the
// sphere, 32 s for the curve and minutes for the circles; measured with it: 0.1 to 0.3 s.
TEST(HullSurfaces, OfTooManyVerticesAreRejectedWithinASecond) {
  Random random;
  const std::function<Vector3d(double)> kinds[] = {
      [&](double) -> Vector3d { return random.vector().normalized(); },
      [](double t) { return Vector3d(t, t * t, t * t * t); },
      [&](double t) {
        const double angle = kPi * random();
        return Vector3d(std::cos(angle), std::sin(angle), t < 0.5 ? 0.0 : 1.0);
      }};
  for (const auto& point : kinds) {
    Points points;
    for (std::size_t i = 0; i < kMostHullPoints; ++i)
      points.push_back(point(static_cast<double>(i) / static_cast<double>(kMostHullPoints)));
    const std::clock_t start = std::clock();
    EXPECT_THROW(ConvexHull{points}, std::invalid_argument);
    EXPECT_LT(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC,
              kSanitizedShare > 1 ? 10.0 : 1.0);
  }
}

/// Hull and box of one size have the same gaps, normals and points.
TEST(HullContacts, BoxesAsHullsAreBoxes) {
  Random random;
  int compared = 0;
  for (int i = 0; i < 10000; ++i) {
    const Vector3d size_a = Vector3d(0.6, 0.6, 0.6) + 0.4 * random.vector();
    const Vector3d size_b = Vector3d(0.6, 0.6, 0.6) + 0.4 * random.vector();
    const BodyState a = pose(0.7 * random.vector(), random.orientation());
    const BodyState b = pose(Vector3d::Zero(), random.orientation());
    const Hull hull_a(corners_of(size_a)), hull_b(corners_of(size_b));
    const Separation boxes = separation(Box{size_a}, a, Box{size_b}, b);
    for (const Separation& other :
         {separation(hull_a, a, hull_b, b), separation(Box{size_a}, a, hull_b, b),
          separation(hull_a, a, Box{size_b}, b)}) {
      if (boxes.gap < 0.0) {
        ASSERT_NEAR(other.gap, boxes.gap, 1e-12) << i;  // rounding, and the order of equal axes
      } else {
        ASSERT_GE(other.gap, boxes.gap - 1e-12) << i;  // distance, not the widest plane
      }
    }
    const Manifold of_boxes = collide(Box{size_a}, a, Box{size_b}, b);
    const Manifold of_hulls = collide(hull_a, a, hull_b, b);
    if (of_boxes.count != of_hulls.count || of_boxes.normal.dot(of_hulls.normal) < 1.0 - 1e-9)
      continue;  // ties of axes
    if (of_boxes.count > 0) ++compared;
    for (int k = 0; k < of_boxes.count; ++k) {
      double nearest = kInfinity;
      for (int j = 0; j < of_hulls.count; ++j)
        nearest =
            std::min(nearest, (of_boxes.points[static_cast<std::size_t>(k)].position -
                               of_hulls.points[static_cast<std::size_t>(j)].position)
                                      .norm() +
                                  std::abs(of_boxes.points[static_cast<std::size_t>(k)].depth -
                                           of_hulls.points[static_cast<std::size_t>(j)].depth));
      // Faces are wider by 1e-6 of other lengths, which oblique edges enlarge.
      ASSERT_LT(nearest, 1e-4) << i;
    }
  }
  EXPECT_GT(compared, 4000);
}

TEST(HullContacts, GapsAreDistancesAndDepthsAreLeast) {
  Random random;
  int apart = 0, overlapping = 0;
  for (int i = 0; i < 3000; ++i) {
    const Hull hull_a = random_hull(&random), hull_b = random_hull(&random);
    const ConvexHull &of_a = *hull_a.surface, &of_b = *hull_b.surface;
    const BodyState a = pose(0.6 * random.vector(), random.orientation());
    const BodyState b = pose(0.1 * random.vector(), random.orientation());
    const Separation found = separation(hull_a, a, hull_b, b);
    const double gap = greatest_gap(of_a, a, of_b, b);
    const Points in_a = placed(of_a.vertices(), a), in_b = placed(of_b.vertices(), b);
    ASSERT_NEAR(gap_along(in_a, in_b, found.normal), found.gap, 1e-12) << i;
    if (gap > 0.0) {
      ++apart;
      ASSERT_NEAR(found.gap, least_distance(of_a, a, of_b, b), 1e-12) << i;
    } else {
      ++overlapping;
      ASSERT_NEAR(found.gap, gap, 1e-12) << i;
    }
    // Points of the contact lie on B, at most as deep as the shapes.
    const Manifold contact = collide(hull_a, a, hull_b, b);
    ASSERT_EQ(contact.count > 0, found.gap < 0.0) << i;
    for (int k = 0; k < contact.count; ++k) {
      const auto& point = contact.points[static_cast<std::size_t>(k)];
      ASSERT_GT(point.depth, 0.0);
      ASSERT_LT(point.depth, -gap_along(in_a, in_b, contact.normal) + 1e-6);
    }
    // A motion by the depth along the normal separates both.
    BodyState moved = a;
    moved.position -= (found.gap - 1e-9) * found.normal;
    if (found.gap < 0.0) {
      ASSERT_EQ(collide(hull_a, moved, hull_b, b).count, 0) << i;
    }
  }
  EXPECT_GT(apart, 500);
  EXPECT_GT(overlapping, 500);
}

TEST(HullContacts, SpheresTouchAtTheNearestPoint) {
  Random random;
  for (int i = 0; i < 5000; ++i) {
    const Hull hull = random_hull(&random);
    const ConvexHull& surface = *hull.surface;
    const BodyState a = pose(random.vector(), random.orientation());
    const Vector3d p = a.position + 0.7 * random.vector();
    const Vector3d local = a.orientation.conjugate() * (p - a.position);
    double above = -kInfinity, distance = kInfinity;
    for (const auto& face : surface.faces()) {
      above = std::max(above, face.normal.dot(local) - face.offset);
      distance = std::min(distance, distance_of_face(surface, face, local));
    }
    for (const auto& edge : surface.edges())
      distance = std::min(
          distance, distance_of_segments(surface.vertices()[static_cast<std::size_t>(edge.from)],
                                         edge.direction, local, 1e-9 * Vector3d::UnitX()));
    const double expected = above <= 0.0 ? above : distance;
    const Separation found = separation(hull, a, Sphere{0.1}, pose(p, {1, 0, 0, 0}));
    ASSERT_NEAR(found.gap, expected - 0.1, 2e-9) << i;  // short segments stand for points
  }
}

TEST(HullContacts, CylindersMeetHullsAsBoxes) {
  Random random;
  for (int i = 0; i < 5000; ++i) {
    const Vector3d size = Vector3d(0.6, 0.6, 0.6) + 0.4 * random.vector();
    const Cylinder cylinder{0.3 + 0.2 * random(), 0.7 + 0.5 * random()};
    const BodyState a = pose(0.8 * random.vector(), random.orientation());
    const BodyState b = pose(Vector3d::Zero(), random.orientation());
    const Separation of_box = separation(Box{size}, a, cylinder, b);
    const Separation of_hull = separation(Hull(corners_of(size)), a, cylinder, b);
    ASSERT_NEAR(of_hull.gap, of_box.gap, 1e-9) << i;  // ties of axes to 1e-10 of the size
    const Manifold with_box = collide(Box{size}, a, cylinder, b);
    const Manifold with_hull = collide(Hull(corners_of(size)), a, cylinder, b);
    ASSERT_EQ(with_box.count > 0, with_hull.count > 0) << i;
  }
}

TEST(HullContacts, LieOnPlanesWithTheirVertices) {
  // A prism with 40 corners lies on eight of them, among them the outermost.
  Points points;
  for (int i = 0; i < 40; ++i)
    for (const double z : {-0.1, 0.1})
      points.emplace_back(std::cos(0.05 * kPi * i), std::sin(0.05 * kPi * i), z);
  const Hull hull(points);
  EXPECT_EQ(hull.surface->faces().size(), 42u);
  const Manifold contact =
      collide(hull, pose({0, 0, 0.0999}, {1, 0, 0, 0}), Plane{}, pose({0, 0, 0}, {1, 0, 0, 0}));
  ASSERT_EQ(contact.count, 8);
  Vector3d low = Vector3d::Zero(), high = Vector3d::Zero();
  for (const auto& point : contact.points) {
    EXPECT_NEAR(point.depth, 1e-4, 1e-15);
    low = low.cwiseMin(point.position);
    high = high.cwiseMax(point.position);
  }
  EXPECT_LT(low.x() + low.y(), -1.9);
  EXPECT_GT(high.x() + high.y(), 1.9);
}

}  // namespace
}  // namespace constraint_sim::engine
