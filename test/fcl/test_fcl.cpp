// shards: 4
// Signed distance, normal and overlap of each pair of shapes against FCL (Pan, Chitta & Manocha
// 2012), on 10 000 random poses.
//
// The gap along our normal, from the extents of both shapes, must be our gap to rounding. No
// direction may have a greater gap: FCL's distance of nearest points is an upper bound, and its
// depth is 1e-6 m too small at most, the tolerance of libccd. Both prove gap and normal.
//
// FCL's search for nearest points ends where the square of the distance falls by less than 1e-6 m²,
// so its distance is too large by 2e-6 m² / distance, and by more in at most 3 % of the poses.
// Smaller tolerances abort on an assertion in FCL 0.7. Half-spaces have closed forms, which take
// the axis of a cylinder that is parallel or normal to the plane to 1e-7 as exactly so.

#include <fcl/fcl.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "draw.h"
#include "engine/collision/narrowphase.h"
#include "engine/math/numbers.h"
#include "sanitized.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kPoses = 10000 / kSanitizedShare;
constexpr double kRounding = 1e-12;  // coordinates are below 1 m
constexpr double kFclTolerance = 1e-6;

constexpr const char* kBounded[] = {"sphere", "box", "cylinder", "hull", "capsule"};

/// Returns a random shape of 0.2 to 0.8 m.
Shape random_shape(const std::string& name, Draw* draw) {
  const auto size = [&] { return draw->between(0.2, 0.8); };
  if (name == "sphere") return Sphere{0.5 * size()};
  if (name == "box") return Box{{size(), size(), size()}};
  if (name == "cylinder") return Cylinder{0.5 * size(), size()};
  if (name == "capsule") return Capsule{0.3 * size(), size()};
  if (name == "plane") return Plane{};
  std::vector<Vector3d> points;
  for (int i = 0; i < 12; ++i) points.push_back(0.4 * draw->vector());
  return Hull(points);
}

BodyState random_state(Draw* draw) {
  BodyState state;
  state.position = 0.5 * draw->vector();
  state.orientation = draw->turn();
  return state;
}

std::shared_ptr<fcl::CollisionGeometryd> to_fcl(const Hull& hull) {
  const ConvexHull& surface = *hull.surface;
  auto faces = std::make_shared<std::vector<int>>();
  for (const ConvexHull::Face& face : surface.faces()) {
    faces->push_back(face.count);
    for (int k = 0; k < face.count; ++k)
      faces->push_back(surface.corners()[static_cast<std::size_t>(face.first + k)].vertex);
  }
  return std::make_shared<fcl::Convexd>(
      std::make_shared<const std::vector<Vector3d>>(surface.vertices()),
      static_cast<int>(surface.faces().size()), faces);
}

/// Returns a shape of FCL; a plane is the half-space below `height` [m].
std::shared_ptr<fcl::CollisionGeometryd> to_fcl(const Shape& shape, double height) {
  if (const auto* sphere = std::get_if<Sphere>(&shape))
    return std::make_shared<fcl::Sphered>(sphere->radius);
  if (const auto* box = std::get_if<Box>(&shape)) return std::make_shared<fcl::Boxd>(box->size);
  if (const auto* cylinder = std::get_if<Cylinder>(&shape))
    return std::make_shared<fcl::Cylinderd>(cylinder->radius, cylinder->length);
  if (const auto* capsule = std::get_if<Capsule>(&shape))
    return std::make_shared<fcl::Capsuled>(capsule->radius, capsule->length);
  if (const auto* hull = std::get_if<Hull>(&shape)) return to_fcl(*hull);
  return std::make_shared<fcl::Halfspaced>(Vector3d::UnitZ(), height);
}

/// Returns the greatest coordinate of a bounded shape along n [m].
double extent(const Vector3d& n, const Shape& shape, const BodyState& state) {
  const Vector3d c = state.orientation.conjugate() * n;
  double from_centre = -kInfinity;
  if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    from_centre = sphere->radius;
  } else if (const auto* box = std::get_if<Box>(&shape)) {
    from_centre = 0.5 * box->size.dot(c.cwiseAbs());
  } else if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    from_centre = cylinder->radius * c.head<2>().norm() + 0.5 * cylinder->length * std::abs(c.z());
  } else if (const auto* capsule = std::get_if<Capsule>(&shape)) {
    from_centre = capsule->radius + 0.5 * capsule->length * std::abs(c.z());
  } else {
    for (const Vector3d& vertex : std::get<Hull>(shape).surface->vertices())
      from_centre = std::max(from_centre, c.dot(vertex));
  }
  return from_centre + n.dot(state.position);
}

/// Two shapes in the engine and in FCL.
struct ShapePair {
  Shape shape_a, shape_b;
  BodyState a, b;

  bool is_with_plane() const { return std::holds_alternative<Plane>(shape_b); }
  bool is_of_boxes() const {
    return std::holds_alternative<Box>(shape_a) && std::holds_alternative<Box>(shape_b);
  }
  Separation ours() const { return separation(shape_a, a, shape_b, b); }
  bool touches() const { return collide(shape_a, a, shape_b, b).count > 0; }

  /// Returns distance and normal from FCL, also of shapes that overlap.
  Separation theirs() const {
    const fcl::CollisionObjectd object_a = object(shape_a, a, 0.0);
    if (is_with_plane()) {  // which has no distance in FCL, but the depth in a higher half-space
      constexpr double kRaised = 4.0;
      const fcl::CollisionObjectd space = object(shape_b, b, kRaised);
      fcl::CollisionResultd result;
      fcl::collide(&object_a, &space, fcl::CollisionRequestd(1, true), result);
      const fcl::Contactd& contact = result.getContact(0);
      return {-contact.normal, kRaised - contact.penetration_depth};
    }
    const fcl::CollisionObjectd object_b = object(shape_b, b, 0.0);
    fcl::DistanceResultd result;
    fcl::distance(&object_a, &object_b, fcl::DistanceRequestd(true, true), result);
    const Vector3d apart = result.nearest_points[0] - result.nearest_points[1];
    return {apart / result.min_distance, result.min_distance};
  }
  /// Returns the gap along a direction from B to A.
  double gap_along(const Vector3d& n) const {
    const double of_b = is_with_plane() ? n.dot(b.position) : extent(n, shape_b, b);
    return -extent(-n, shape_a, a) - of_b;
  }

 private:
  static fcl::CollisionObjectd object(const Shape& shape, const BodyState& state, double height) {
    return {to_fcl(shape, height), state.orientation.toRotationMatrix(), state.position};
  }
};

/// Shapes of a pair, by name.
struct Names {
  const char* a;
  const char* b;
};
void PrintTo(const Names& names, std::ostream* out) { *out << names.a << '_' << names.b; }

/// Returns all pairs, with a plane as the second shape.
std::vector<Names> all_pairs() {
  std::vector<Names> pairs;
  for (std::size_t a = 0; a < std::size(kBounded); ++a) {
    for (std::size_t b = a; b < std::size(kBounded); ++b)
      pairs.push_back({kBounded[a], kBounded[b]});
    pairs.push_back({kBounded[a], "plane"});
  }
  return pairs;
}

class Fcl : public ::testing::TestWithParam<Names> {};

TEST_P(Fcl, Agrees) {
  const auto [name_a, name_b] = GetParam();
  Draw draw(2024);
  int apart = 0, overlapping = 0, rough = 0, turned = 0;
  for (int i = 0; i < kPoses; ++i) {
    const ShapePair pair{random_shape(name_a, &draw), random_shape(name_b, &draw),
                         random_state(&draw), random_state(&draw)};
    const Separation ours = pair.ours();
    ++(ours.gap > 0.0 ? apart : overlapping);
    ASSERT_EQ(pair.touches(), ours.gap < 0.0) << i;
    ASSERT_NEAR(ours.normal.norm(), 1.0, kRounding) << i;
    // Rounding turns the direction between near points. At the rim of a cylinder the direction is a
    // root of a polynomial, off by up to 3e-6 where two roots nearly meet; the gap is off by its
    // square.
    const bool has_rim = std::string(name_a) == "cylinder" || std::string(name_b) == "cylinder";
    const double rounding = kRounding + (ours.gap > 0.0 ? 1e-15 / ours.gap : has_rim ? 1e-11 : 0.0);
    ASSERT_NEAR(pair.gap_along(ours.normal), ours.gap, rounding) << i;
    const Separation theirs = pair.theirs();
    const double excess = theirs.gap - ours.gap;
    if (pair.is_with_plane()) {
      ASSERT_LT((ours.normal - theirs.normal).norm(), kRounding) << i;
      rough += std::abs(excess) > kRounding;
      continue;
    }
    ASSERT_GE(excess, -kRounding) << i;
    // Boxes that are apart have the widest gap along normals of faces and across edges.
    if (pair.is_of_boxes() && ours.gap > 0.0) continue;
    const double distance = std::max(ours.gap, 0.0);
    if (excess * (distance > 0.0 ? distance : 1.0) > 2.0 * kFclTolerance) {
      ++rough;
      continue;
    }
    // The gap falls with the square of the angle from the best direction.
    const double most = std::sqrt(20.0 * kFclTolerance / (distance > 0.0 ? distance : 1.0));
    turned += (theirs.normal - ours.normal).norm() > most;
  }
  EXPECT_GT(apart, kPoses / 10);
  EXPECT_GT(overlapping, kPoses / 10);
  EXPECT_LE(rough, 3 * kPoses / 100);
  EXPECT_LE(turned, kPoses / 1000);
}

INSTANTIATE_TEST_SUITE_P(Pairs, Fcl, ::testing::ValuesIn(all_pairs()),
                         ::testing::PrintToStringParamName());

}  // namespace
}  // namespace constraint_sim::engine
