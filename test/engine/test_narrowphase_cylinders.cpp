// Contact geometry of cylinders. Oracles without separating axes: alternating projection between
// convex shapes, and the least depth over many directions.

#include "engine/collision/narrowphase.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

struct Placed {
  Shape shape;
  BodyState state;

  /// Returns the nearest point of the solid.
  Vector3d nearest(const Vector3d& point) const {
    Vector3d p = state.orientation.conjugate() * (point - state.position);
    if (const auto* box = std::get_if<Box>(&shape)) {
      p = p.cwiseMax(-0.5 * box->size).cwiseMin(0.5 * box->size);
    } else {
      const auto& cylinder = std::get<Cylinder>(shape);
      const double across = p.head<2>().norm();
      if (across > cylinder.radius) p.head<2>() *= cylinder.radius / across;
      p.z() = std::clamp(p.z(), -0.5 * cylinder.length, 0.5 * cylinder.length);
    }
    return state.position + state.orientation * p;
  }
  /// Returns the distance from the centre to the farthest point along n.
  double reach(const Vector3d& n) const {
    const Vector3d c = state.orientation.conjugate() * n;
    if (const auto* box = std::get_if<Box>(&shape)) return 0.5 * box->size.dot(c.cwiseAbs());
    const auto& cylinder = std::get<Cylinder>(shape);
    return cylinder.radius * c.head<2>().norm() + 0.5 * cylinder.length * std::abs(c.z());
  }
};

struct PlacedPair {
  Placed a, b;

  Manifold contact(double margin = 0.0) const {
    return collide(a.shape, a.state, b.shape, b.state, margin);
  }
  Separation apart() const { return separation(a.shape, a.state, b.shape, b.state); }
  /// Returns the distance that A has to move along n to be past B.
  double depth_along(const Vector3d& n) const {
    return a.reach(n) + b.reach(n) - n.dot(a.state.position - b.state.position);
  }
  PlacedPair with_a_moved(const Vector3d& shift) const {
    PlacedPair moved = *this;
    moved.a.state.position += shift;
    return moved;
  }
};

/// Returns the distance and the direction from B to A; 0 where they overlap, none where projections
/// do not converge.
std::optional<double> distance_by_projection(const PlacedPair& pair, Vector3d* direction) {
  Vector3d on_b = pair.b.state.position;
  for (int i = 0; i < 20000; ++i) {
    const Vector3d on_a = pair.a.nearest(on_b);
    on_b = pair.b.nearest(on_a);
    const double distance = (on_a - on_b).norm();
    if (distance < 1e-13) return 0.0;
    *direction = (on_a - on_b) / distance;
    if (distance + pair.depth_along(*direction) < 1e-9) return distance;
  }
  return std::nullopt;
}

/// Returns the least depth found by a search that uses depth_along() only.
double least_depth(const PlacedPair& pair, Random* random) {
  std::vector<std::pair<double, Vector3d>> found;
  for (int i = 0; i < 3000; ++i) {
    const Vector3d n = random->vector().normalized();
    found.emplace_back(pair.depth_along(n), n);
  }
  std::partial_sort(found.begin(), found.begin() + 5, found.end(),
                    [](const auto& l, const auto& r) { return l.first < r.first; });
  double least = found[0].first;
  for (int i = 0; i < 5; ++i) {
    auto [depth, n] = found[static_cast<std::size_t>(i)];
    for (double step = 0.05; step > 1e-9;) {
      bool is_better = false;
      for (int k = 0; k < 12 && !is_better; ++k) {
        const Vector3d other = (n + step * random->vector()).normalized();
        const double there = pair.depth_along(other);
        is_better = there < depth;
        if (is_better) depth = there, n = other;
      }
      if (!is_better) step *= 0.7;
    }
    least = std::min(least, depth);
  }
  return least;
}

Shape random_shape(bool is_box, Random* random) {
  const auto size = [&] { return 0.2 + 0.6 * std::abs((*random)()); };
  if (is_box) return Box{{size(), size(), size()}};
  const double radius = 0.5 * size();
  return Cylinder{radius, 0.2 + 1.2 * std::abs((*random)())};
}

BodyState random_state(const Vector3d& position, Random* random) {
  BodyState state;
  state.position = position;
  state.orientation = random->orientation();
  return state;
}

/// Boxes and cylinders with cylinders, every fourth with aligned or crossed axes.
PlacedPair random_pair(int i, Random* random) {
  PlacedPair pair;
  const Vector3d place = random->vector();
  pair.a = {random_shape(i % 2 == 0, random), random_state(place, random)};
  pair.b = {random_shape(false, random), random_state(place + 0.8 * random->vector(), random)};
  if (i % 4 >= 2) {
    const double turns = std::floor(2.0 * (*random)());
    pair.b.state.orientation =
        pair.a.state.orientation * Quaterniond(AngleAxisd(0.5 * kPi * turns, Vector3d::UnitX()));
  }
  return pair;
}

TEST(CylinderContacts, AreThereWhereShapesOverlap) {
  Random random;
  int overlapping = 0, apart = 0, undecided = 0;
  for (int i = 0; i < 4000 / kSanitizedShare; ++i) {
    const PlacedPair pair = random_pair(i, &random);
    Vector3d direction = Vector3d::Zero();
    const auto distance = distance_by_projection(pair, &direction);
    if (!distance) {
      ++undecided;
      continue;
    }
    const Separation found = pair.apart();
    EXPECT_NEAR(found.gap, -pair.depth_along(found.normal), 1e-14) << i;
    if (*distance == 0.0) {
      ++overlapping;
      EXPECT_GT(pair.contact().count, 0) << i;
      EXPECT_LE(found.gap, 1e-13) << i;
    } else {
      ++apart;
      EXPECT_EQ(pair.contact().count, 0) << i << ", apart by " << *distance;
      EXPECT_GT(found.gap, 0.0) << i << ", apart by " << *distance;
      EXPECT_LE(found.gap, *distance + 1e-9) << i;
      EXPECT_GE(found.gap, *distance - 1e-7) << i;  // the search's angle is accurate to about 1e-8
    }
  }
  EXPECT_GT(overlapping, 1000 / kSanitizedShare);
  EXPECT_GT(apart, 1000 / kSanitizedShare);
  EXPECT_LT(undecided, 100 / kSanitizedShare);
}

TEST(CylinderContacts, HaveTheLeastDepth) {
  Random random;
  int tested = 0;
  for (int i = 0; i < 1200 / kSanitizedShare; ++i) {
    const PlacedPair pair = random_pair(i, &random);
    const double depth = -pair.apart().gap;
    if (depth <= 0.0) continue;
    ++tested;
    // the oracle's own search is accurate to 1e-6 of a depth
    EXPECT_LT(depth, least_depth(pair, &random) + 1e-6) << i;
  }
  EXPECT_GT(tested, 200 / kSanitizedShare);
}

TEST(CylinderContacts, PartShapesAndLieOnTheSecond) {
  Random random;
  int points = 0;
  for (int i = 0; i < 2000 / kSanitizedShare; ++i) {
    const PlacedPair pair = random_pair(i, &random);
    const Manifold contact = pair.contact();
    if (contact.count == 0) continue;
    ASSERT_NEAR(contact.normal.norm(), 1.0, 1e-14);
    const double depth = pair.depth_along(contact.normal);
    // a thousandth of the sine of 2.56° times the size, where a face's normal is used
    EXPECT_LT(depth, -pair.apart().gap + 0.05 * 2.0) << i;
    EXPECT_EQ(pair.with_a_moved((depth + 1e-9) * contact.normal).contact().count, 0) << i;
    const PlacedPair reversed{pair.b, pair.a};
    EXPECT_EQ(reversed.contact().count, contact.count) << i;
    for (int k = 0; k < contact.count; ++k) {
      ++points;
      const Manifold::Point& point = contact.points[static_cast<std::size_t>(k)];
      EXPECT_LE(point.depth, depth + 2e-6) << i;  // a clipping face is widened by 1e-6
      // on B, and that depth below A, except for lines that are parallel to 2.56° only
      EXPECT_LT((pair.b.nearest(point.position) - point.position).norm(), 1e-5) << i;
      const Vector3d on_a = point.position - point.depth * contact.normal;
      const bool is_both = (pair.a.nearest(on_a) - on_a).norm() < 1e-3;
      EXPECT_TRUE(is_both || contact.count == 1) << i << " " << k;
      for (int l = 0; l < k; ++l)
        EXPECT_NE(point.feature, contact.points[static_cast<std::size_t>(l)].feature) << i;
    }
  }
  EXPECT_GT(points, 500 / kSanitizedShare);
}

Placed placed(const Shape& shape, const Vector3d& position,
              const Quaterniond& orientation = Quaterniond::Identity()) {
  BodyState state;
  state.position = position;
  state.orientation = orientation;
  return {shape, state};
}

const Quaterniond kLying(AngleAxisd(0.5 * kPi, Vector3d::UnitX()));

// Pairs that overlap by 0.01 along z.
TEST(CylinderContacts, HaveThePointsThatHoldAShape) {
  const Cylinder cylinder{0.25, 1.0};
  const Quaterniond skew(AngleAxisd(0.7, Vector3d::UnitZ()));
  struct Case {
    const char* name;
    PlacedPair pair;
    int count;
    double width_x, width_y;  // extent of the points
  };
  const double r = 0.25, w = 2.0 * r;
  const std::vector<Case> cases{
      {"standing on a plane",
       {placed(cylinder, {0, 0, 0.49}), placed(Plane{}, {0, 0, 0})},
       4,
       w,
       w},
      {"lying on a plane",
       {placed(cylinder, {0, 0, 0.24}, kLying), placed(Plane{}, {0, 0, 0})},
       2,
       0.0,
       1.0},
      {"standing on a box",
       {placed(cylinder, {0, 0, 0.99}), placed(Box{{2, 2, 1}}, {0, 0, 0})},
       4,
       w,
       w},
      {"standing over an edge",
       {placed(cylinder, {1.0, 0, 0.99}), placed(Box{{2, 2, 1}}, {0, 0, 0})},
       5,
       r,
       w},
      {"lying on a box",
       {placed(cylinder, {0, 0, 0.74}, kLying), placed(Box{{2, 2, 1}}, {0, 0, 0})},
       2,
       0.0,
       1.0},
      {"lying over edges",
       {placed(cylinder, {0, 0, 0.74}, kLying), placed(Box{{0.5, 0.5, 1}}, {0, 0, 0})},
       2,
       0.0,
       0.5},
      {"a box on a cap",
       {placed(Box{{0.2, 0.2, 1}}, {0, 0, 0.99}), placed(cylinder, {0, 0, 0})},
       4,
       0.2,
       0.2},
      {"cap on cap", {placed(cylinder, {0, 0, 0.99}, skew), placed(cylinder, {0, 0, 0})}, 8, w, w},
      {"cap over cap",
       {placed(cylinder, {0, 0.25, 0.99}), placed(cylinder, {0, 0, 0})},
       4,
       r * std::sqrt(3.0),
       r},
      {"lying on a cap",
       {placed(cylinder, {0, 0, 0.74}, kLying), placed(cylinder, {0, 0, 0})},
       2,
       0.0,
       w},
      {"side by side",
       {placed(cylinder, {0, 0.3, 0.49}, kLying), placed(cylinder, {0, 0, 0}, kLying)},
       2,
       0.0,
       0.7},
      {"crossed",
       {placed(cylinder, {0, 0, 0.49}, Quaterniond(skew * kLying)),
        placed(cylinder, {0, 0, 0}, kLying)},
       1,
       0.0,
       0.0}};
  for (const Case& c : cases) {
    const Manifold contact = c.pair.contact();
    EXPECT_EQ(contact.count, c.count) << c.name;
    // the reference is 1e-6 wider
    EXPECT_NEAR((contact.normal - Vector3d::UnitZ()).norm(), 0.0, 1e-12) << c.name;
    Vector3d low = Vector3d::Constant(kInfinity), high = -low;
    for (int k = 0; k < contact.count; ++k) {
      const Manifold::Point& point = contact.points[static_cast<std::size_t>(k)];
      EXPECT_NEAR(point.depth, 0.01, 1e-12) << c.name;
      low = low.cwiseMin(point.position);
      high = high.cwiseMax(point.position);
    }
    EXPECT_NEAR((high - low).x(), c.width_x, 2e-6) << c.name;
    EXPECT_NEAR((high - low).y(), c.width_y, 2e-6) << c.name;
  }
}

// The lowest point of a tilted rim is always one of the points, to 3e-5 of the radius where the cap
// is nearly level.
TEST(CylinderContacts, OnAPlaneKnowTheLowestPoint) {
  Random random;
  const Cylinder cylinder{0.3, 0.5};
  for (int i = 0; i < 1000; ++i) {
    Placed a = placed(cylinder, Vector3d::Zero());
    const double tilt = kPi * std::pow(10.0, -6.0 * std::abs(random()));
    Vector3d axis = random.vector();
    axis.z() = 0.0;
    a.state.orientation = Quaterniond(AngleAxisd(tilt, axis.normalized())) *
                          Quaterniond(AngleAxisd(kPi * random(), Vector3d::UnitZ()));
    const double reach = a.reach(Vector3d::UnitZ());
    a.state.position.z() = reach - 0.1;
    const PlacedPair pair{a, placed(Plane{}, Vector3d::Zero())};
    const Manifold contact = pair.contact();
    double deepest = 0.0;
    for (int k = 0; k < contact.count; ++k)
      deepest = std::max(deepest, contact.points[static_cast<std::size_t>(k)].depth);
    EXPECT_NEAR(deepest, 0.1, tilt < 1e-4 || tilt > kPi - 1e-4 ? 1e-5 : 1e-14) << tilt;
    EXPECT_NEAR(pair.apart().gap, -0.1, 1e-14);
  }
}

// Sphere against cylinder, by the nearest point of the solid.
TEST(CylinderContacts, OfSpheresAreThoseOfTheNearestPoint) {
  Random random;
  const Cylinder cylinder{0.3, 0.5};
  for (int i = 0; i < 1000; ++i) {
    Placed b = placed(cylinder, random.vector());
    b.state.orientation = random.orientation();
    const Placed a = placed(Sphere{0.4}, b.state.position + 0.8 * random.vector());
    const Vector3d d = a.state.position - b.nearest(a.state.position);
    const Manifold contact = collide(a.shape, a.state, b.shape, b.state);
    if (d.norm() >= 0.4) {
      EXPECT_EQ(contact.count, 0);
    } else if (d.norm() > 1e-9) {
      ASSERT_EQ(contact.count, 1);
      EXPECT_NEAR(contact.points[0].depth, 0.4 - d.norm(), 1e-14);
      EXPECT_NEAR((contact.normal - d.normalized()).norm(), 0.0, 1e-12);
    } else {
      ASSERT_EQ(contact.count, 1);  // the centre is inside: moved out by the depth
      const Vector3d out = a.state.position + contact.points[0].depth * contact.normal;
      EXPECT_NEAR((out - b.nearest(out)).norm(), 0.4, 1e-14);
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
