// Surfaces of hulls of 20 000 random point sets, many of them nearly flat: closed, convex, and
// around all points.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "constraint_sim/engine/convex_hull.h"
#include "draw.h"
#include "engine/math/numbers.h"
#include "sanitized.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using PointSet = std::vector<Vector3d>;

constexpr int kKinds = 8;

/// Returns 4 to 60 points of one of kKinds kinds, within 1 mm to 1 km.
PointSet random_points(int kind, Draw* draw) {
  const int count = 4 + draw->below(57);
  const double size = std::pow(10.0, draw->between(-3.0, 3.0));
  const double thin = std::pow(10.0, draw->between(-7.0, -1.0));
  PointSet points;
  for (int i = 0; i < count; ++i) {
    Vector3d p = draw->vector();
    const auto other = [&] { return points[static_cast<std::size_t>(draw->below(i))] / size; };
    if (kind == 1) p.z() *= thin;                              // near a plane
    if (kind == 2) p.normalize();                              // on a sphere
    if (kind == 3) p = (4.0 * p).array().round() / 4.0;        // on a lattice
    if (kind == 4) p = p.cwiseSign() + thin * draw->vector();  // around corners of a cube
    if (kind == 5) {                                           // on the rims of a cylinder
      const double angle = 2.0 * kPi * i / count;
      p = Vector3d(std::cos(angle), std::sin(angle), i % 2 == 0 ? -1.0 : 1.0) + thin * p;
    }
    if (kind == 6 && i > 3) p = 0.5 * (other() + other()) + thin * p;  // near edges and faces
    if (kind == 7) p = p.cwiseProduct(Vector3d(thin, std::sqrt(thin), 1.0));  // a needle
    points.push_back(size * p);
  }
  return points;
}

TEST(HullSurfacesOfRandomPoints, AreClosedAndHoldThePoints) {
  Draw draw(7);
  int made = 0;
  for (int i = 0; i < 20000 / kSanitizedShare; ++i) {
    const PointSet points = random_points(i % kKinds, &draw);
    double size = 0.0;
    for (const Vector3d& p : points) size = std::max(size, (p - points[0]).norm());
    try {
      const ConvexHull hull(points);
      ++made;
      ASSERT_TRUE(hull.volume() > 0.0) << i;
      ASSERT_TRUE(hull.centre().allFinite() && hull.axes().allFinite()) << i;
      ASSERT_GT(hull.unit_inertia().minCoeff(), 0.0) << i;
      std::vector<bool> is_corner(hull.vertices().size(), false);
      for (const ConvexHull::Face& face : hull.faces()) {
        ASSERT_GE(face.count, 3) << i;
        ASSERT_NEAR(face.normal.norm(), 1.0, 1e-15) << i;
        for (const Vector3d& p : points)  // rounding of a coordinate of up to 4e3 m
          ASSERT_LE(face.normal.dot(p), face.offset + 1e-15 * size) << i;
        for (int k = 0; k < face.count; ++k) {
          const int vertex = hull.corners()[static_cast<std::size_t>(face.first + k)].vertex;
          is_corner[static_cast<std::size_t>(vertex)] = true;
          // Triangles within 1e-6 of the size are one face, and its mean normal tilts from theirs.
          ASSERT_GE(face.normal.dot(hull.vertices()[static_cast<std::size_t>(vertex)]),
                    face.offset - 1e-5 * size)
              << i;
        }
      }
      for (const ConvexHull::Edge& edge : hull.edges()) {
        ASSERT_NE(edge.left, edge.right) << i;
        ASSERT_GE(edge.right, 0) << i;
      }
      // Euler's formula; vertices that lie in a merged face to 1e-6 are no corners.
      const auto corners = std::count(is_corner.begin(), is_corner.end(), true);
      ASSERT_EQ(
          corners - static_cast<long>(hull.edges().size()) + static_cast<long>(hull.faces().size()),
          2)
          << i;
    } catch (const std::invalid_argument&) {
      // Points in a plane to 1e-6 of their size are rejected.
      ASSERT_TRUE(i % kKinds == 1 || i % kKinds == 4 || i % kKinds == 7) << i;
    }
  }
  EXPECT_GT(made, 18000 / kSanitizedShare);
}

}  // namespace
}  // namespace constraint_sim::engine
