#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "draw.h"
#include "engine/collision/narrowphase.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

BodyState at(const Vector3d& position, const Quaterniond& orientation = Quaterniond::Identity()) {
  BodyState state;
  state.position = position;
  state.orientation = orientation;
  return state;
}

/// Random directions and poses of shapes.
class NarrowphaseDraw : public Draw {
 public:
  NarrowphaseDraw() : Draw(11) {}
  Vector3d direction() {
    for (;;) {
      const Vector3d v = vector_between(-1.0, 1.0);
      if (v.norm() > 0.1 && v.norm() < 1.0) return v.normalized();
    }
  }
  Quaterniond orientation() { return Quaterniond(AngleAxisd(between(-M_PI, M_PI), direction())); }
};

double deepest(const Manifold& manifold) {
  double depth = 0.0;
  for (int i = 0; i < manifold.count; ++i) depth = std::max(depth, manifold.points[i].depth);
  return depth;
}

std::set<std::uint32_t> features(const Manifold& manifold) {
  std::set<std::uint32_t> all;
  for (int i = 0; i < manifold.count; ++i) all.insert(manifold.points[i].feature);
  return all;
}

/// Returns the distance of a point from a shape's surface, positive outside [m].
double height(const Shape& shape, const BodyState& state, const Vector3d& point) {
  const Vector3d p = state.orientation.conjugate() * (point - state.position);
  if (const auto* sphere = std::get_if<Sphere>(&shape)) return p.norm() - sphere->radius;
  if (const auto* box = std::get_if<Box>(&shape)) {
    const Vector3d beyond = p.cwiseAbs() - 0.5 * box->size;
    return beyond.maxCoeff() <= 0.0 ? beyond.maxCoeff() : beyond.cwiseMax(0.0).norm();
  }
  return p.z();
}

/// Pairs of shapes that can touch, in exact touch: A is above B.
struct Touch {
  std::string name;
  Shape shape_a;
  BodyState a;
  Shape shape_b;
  BodyState b;
  int points;
};

std::vector<Touch> touches() {
  const Quaterniond half_turn(0.0, 1.0, 0.0, 0.0);  // exact, unlike most rotations
  return {
      {"sphere on sphere", Sphere{0.25}, at({0.5, 0.5, 1.25}), Sphere{0.5}, at({0.5, 0.5, 0.5}), 1},
      {"sphere on plane", Sphere{0.5}, at({0.0, 1.0, 1.5}), Plane{}, at({3.0, 0.0, 1.0}), 1},
      {"box on plane", Box{{1.0, 2.0, 3.0}}, at({0.0, 0.0, 1.5}), Plane{}, at({0.0, 0.0, 0.0}), 4},
      {"box on sphere", Box{{1.0, 1.0, 1.0}}, at({0.0, 0.0, 1.25}), Sphere{0.5},
       at({0.25, 0.25, 0.25}), 1},
      {"turned box on sphere", Box{{1.0, 1.0, 1.0}}, at({0.0, 0.0, 1.25}, half_turn), Sphere{0.5},
       at({0.25, 0.25, 0.25}), 1},
      {"box on box", Box{{1.0, 1.0, 1.0}}, at({0.0, 0.0, 1.5}), Box{{2.0, 2.0, 2.0}},
       at({0.25, 0.125, 0.0}), 4},
  };
}

TEST(Interfaces, TouchOnlyWhereTheyPenetrate) {
  const double step = std::pow(2.0, -50);  // exact beside coordinates of 1 to 2
  for (const Touch& touch : touches()) {
    for (const double gap : {-step, 0.0, step}) {
      BodyState a = touch.a;
      a.position.z() += gap;
      const Manifold above = collide(touch.shape_a, a, touch.shape_b, touch.b);
      const Manifold below = collide(touch.shape_b, touch.b, touch.shape_a, a);

      EXPECT_EQ(above.count, gap < 0.0 ? touch.points : 0) << touch.name << ", gap " << gap;
      EXPECT_EQ(below.count, above.count) << touch.name << ", gap " << gap;
      for (int i = 0; i < above.count; ++i) {
        // a rounding where a square root or a product with a normal is involved
        EXPECT_NEAR(above.points[i].depth, step, 0.25 * step) << touch.name;
        EXPECT_EQ(above.normal, Vector3d::UnitZ()) << touch.name;
        EXPECT_EQ(below.normal, -Vector3d::UnitZ()) << touch.name;
      }
    }
  }
}

TEST(Interfaces, PutPositionsOnTheSecondSurfaceInEitherOrder) {
  for (const Touch& touch : touches()) {
    BodyState a = touch.a;
    a.position.z() -= 0.0625;
    const Manifold above = collide(touch.shape_a, a, touch.shape_b, touch.b);
    const Manifold below = collide(touch.shape_b, touch.b, touch.shape_a, a);
    ASSERT_EQ(above.count, touch.points) << touch.name;
    ASSERT_EQ(below.count, touch.points) << touch.name;
    for (int i = 0; i < touch.points; ++i) {
      // a few roundings at coordinates of about 1
      EXPECT_NEAR(above.points[i].depth, 0.0625, 1e-15) << touch.name;
      EXPECT_NEAR(below.points[i].depth, 0.0625, 1e-15) << touch.name;
      EXPECT_NEAR(height(touch.shape_b, touch.b, above.points[i].position), 0.0, 1e-15)
          << touch.name;
      EXPECT_NEAR(height(touch.shape_a, a, below.points[i].position), 0.0, 1e-15) << touch.name;
    }
  }
}

TEST(Interfaces, AreThereWithinAMarginWithTheFeaturesOfTheContact) {
  const double margin = std::pow(2.0, -4);
  for (const Touch& touch : touches()) {
    const auto at_gap = [&](double gap) {
      BodyState a = touch.a;
      a.position.z() += gap;
      return std::pair{collide(touch.shape_a, a, touch.shape_b, touch.b, margin),
                       collide(touch.shape_b, touch.b, touch.shape_a, a, margin)};
    };
    EXPECT_EQ(at_gap(margin).first.count, 0) << touch.name;  // nearer than the margin, not at it
    EXPECT_EQ(at_gap(margin).second.count, 0) << touch.name;
    const Manifold contact = at_gap(-margin).first;
    for (const double gap : {0.5 * margin, 0.0, -0.5 * margin}) {
      const auto [above, below] = at_gap(gap);
      ASSERT_EQ(above.count, touch.points) << touch.name;
      ASSERT_EQ(below.count, touch.points) << touch.name;
      EXPECT_EQ(features(above), features(contact)) << touch.name;
      EXPECT_EQ(above.normal, Vector3d::UnitZ()) << touch.name;
      for (int i = 0; i < touch.points; ++i) {
        // a few roundings at coordinates of about 1
        EXPECT_NEAR(above.points[i].depth, -gap, 1e-15) << touch.name;
        EXPECT_NEAR(below.points[i].depth, -gap, 1e-15) << touch.name;
        EXPECT_NEAR(height(touch.shape_b, touch.b, above.points[i].position), 0.0, 1e-15);
      }
    }
  }
}

TEST(Interfaces, OfPointsAndOfTwoPlanesAreNone) {
  const BodyState here;
  const std::vector<Shape> shapes{Point{}, Sphere{1.0}, Box{{1.0, 1.0, 1.0}}, Plane{}};
  for (const Shape& shape : shapes) {
    EXPECT_EQ(collide(Point{}, here, shape, here).count, 0);
    EXPECT_EQ(collide(shape, here, Point{}, here).count, 0);
  }
  EXPECT_EQ(collide(Plane{}, here, Plane{}, at({0.0, 0.0, 1.0})).count, 0);
}

/// Two overlapping shapes without ties between features, so that rounding cannot change the choice.
std::vector<Touch> generic_contacts() {
  NarrowphaseDraw random;
  std::vector<Touch> contacts;
  const auto add = [&](const std::string& name, const Shape& shape_a, const Shape& shape_b,
                       const Vector3d& offset) {
    const Vector3d p_b = random.vector_between(-1.0, 1.0);
    contacts.push_back({name, shape_a, at(p_b + offset, random.orientation()), shape_b,
                        at(p_b, random.orientation()), 0});
  };
  for (int i = 0; i < 20; ++i) {
    const Vector3d near = random.between(0.1, 0.6) * random.direction();
    const Box box_a{random.vector_between(0.6, 1.5)};
    const Box box_b{random.vector_between(0.6, 1.5)};
    add("sphere, sphere", Sphere{0.3}, Sphere{0.7}, near);
    add("sphere, plane", Sphere{0.7}, Plane{}, near);
    add("box, plane", box_a, Plane{}, near);
    add("box, sphere", box_a, Sphere{0.5}, near);
    add("box, box", box_a, box_b, near);
  }
  return contacts;
}

TEST(Interfaces, DoNotDependOnPlaceDirectionOrScale) {
  NarrowphaseDraw random;
  for (const Touch& c : generic_contacts()) {
    const Manifold expected = collide(c.shape_a, c.a, c.shape_b, c.b);
    for (const double scale : {1.0, 1e-12, 1e-6, 1e6}) {
      const Quaterniond turn = random.orientation();
      const Vector3d shift = random.vector_between(-3.0, 3.0);
      const auto moved_point = [&](const Vector3d& p) -> Vector3d {
        return scale * (turn * p + shift);
      };
      const auto moved = [&](const BodyState& state) {
        return at(moved_point(state.position), turn * state.orientation);
      };
      const auto scaled = [&](Shape shape) {
        if (auto* sphere = std::get_if<Sphere>(&shape)) sphere->radius *= scale;
        if (auto* box = std::get_if<Box>(&shape)) box->size *= scale;
        return shape;
      };
      const Manifold actual = collide(scaled(c.shape_a), moved(c.a), scaled(c.shape_b), moved(c.b));

      // a few tens of roundings at coordinates up to 6, amplified where edges cross at small angles
      const double tolerance = 1e-12;
      ASSERT_EQ(actual.count, expected.count) << c.name << ", scale " << scale;
      EXPECT_TRUE(actual.normal.isApprox(turn * expected.normal, tolerance)) << c.name;
      for (int i = 0; i < expected.count; ++i) {
        EXPECT_NEAR(actual.points[i].depth, scale * expected.points[i].depth, scale * tolerance);
        EXPECT_LT((actual.points[i].position - moved_point(expected.points[i].position)).norm(),
                  scale * tolerance)
            << c.name;
        EXPECT_EQ(actual.points[i].feature, expected.points[i].feature) << c.name;
      }
    }
  }
}

TEST(Interfaces, AreTheSameFromBothSides) {
  int contacts = 0;
  for (const Touch& c : generic_contacts()) {
    const Manifold ab = collide(c.shape_a, c.a, c.shape_b, c.b);
    const Manifold ba = collide(c.shape_b, c.b, c.shape_a, c.a);
    contacts += ab.count > 0 ? 1 : 0;
    ASSERT_EQ(ab.count, ba.count) << c.name;
    // a few tens of roundings at coordinates of about 1
    EXPECT_TRUE(ab.normal.isApprox(-ba.normal, 1e-13)) << c.name;
    for (int i = 0; i < ab.count; ++i) {
      const Manifold::Point& p = ab.points[i];
      const bool is_found = std::any_of(
          ba.points.begin(), ba.points.begin() + ba.count, [&](const Manifold::Point& q) {
            return std::abs(p.depth - q.depth) < 1e-13 &&
                   (p.position - p.depth * ab.normal - q.position).norm() < 1e-13;
          });
      EXPECT_TRUE(is_found) << c.name;
    }
  }
  EXPECT_GT(contacts, 80);  // 100 trials; some pairs of boxes and planes are too far apart
}

TEST(SphereSphere, IsTheTutorialsContact) {
  // 3-4-5: S1 = (3, 0, 4), S2 = 0, r1 = 4, r2 = 2: d = 5, p = 1, N = (3, 0, 4)/5, P = S1 − N (r1 −
  // p)
  const Manifold contact =
      collide(Sphere{4.0}, at({3.0, 0.0, 4.0}), Sphere{2.0}, at(Vector3d::Zero()));
  ASSERT_EQ(contact.count, 1);
  EXPECT_DOUBLE_EQ(contact.points[0].depth, 1.0);
  EXPECT_TRUE(contact.normal.isApprox(Vector3d(0.6, 0.0, 0.8), 1e-15));
  EXPECT_TRUE(contact.points[0].position.isApprox(Vector3d(1.2, 0.0, 1.6), 1e-15));
}

TEST(SphereSphere, CoincidentCentresPartAlongZ) {
  for (const double distance : {0.0, 1e-200}) {  // the square of 1e-200 is zero too
    const Manifold contact =
        collide(Sphere{0.5}, at({1.0, 1.0, 0.0}), Sphere{0.25}, at({1.0, 1.0, distance}));
    ASSERT_EQ(contact.count, 1);
    EXPECT_EQ(contact.normal, Vector3d::UnitZ());
    EXPECT_EQ(contact.points[0].depth, 0.75);
    EXPECT_EQ(contact.points[0].position, Vector3d(1.0, 1.0, 0.25));
  }
}

TEST(SphereSphere, NearlyCoincidentCentresPartAlongTheirLine) {
  const Manifold contact =
      collide(Sphere{0.5}, at({1e-100, 0.0, 0.0}), Sphere{0.25}, at(Vector3d::Zero()));
  EXPECT_EQ(contact.normal, Vector3d::UnitX());
}

TEST(SpherePlane, IsTheTutorialsContact) {
  // N·S − d = 0.6·5 − 2 = 1, p = 1.5 − 1, P = S − N (r − p)
  const Vector3d N(0.6, 0.0, 0.8);
  const BodyState plane = at(2.0 * N, Quaterniond::FromTwoVectors(Vector3d::UnitZ(), N));
  const Manifold contact = collide(Sphere{1.5}, at({5.0, 7.0, 0.0}), Plane{}, plane);
  ASSERT_EQ(contact.count, 1);
  EXPECT_TRUE(contact.normal.isApprox(N, 1e-15));
  EXPECT_DOUBLE_EQ(contact.points[0].depth, 0.5);
  EXPECT_TRUE(contact.points[0].position.isApprox(Vector3d(4.4, 7.0, -0.8), 1e-15));
}

TEST(SpherePlane, HoldsDeepInTheHalfSpace) {
  const Manifold contact = collide(Sphere{1.0}, at({0.0, 0.0, -100.0}), Plane{}, BodyState{});
  ASSERT_EQ(contact.count, 1);
  EXPECT_EQ(contact.points[0].depth, 101.0);
  EXPECT_EQ(contact.points[0].position, Vector3d::Zero());
}

TEST(BoxPlane, FindsTheVerticesBelowAndNamesThem) {
  // rotated about y by 45°: two vertices are below
  const Quaterniond turn(AngleAxisd(M_PI / 4.0, Vector3d::UnitY()));
  const Manifold contact = collide(
      Box{Vector3d::Ones()}, at({0.0, 0.0, std::sqrt(0.5) - 0.1}, turn), Plane{}, BodyState{});
  ASSERT_EQ(contact.count, 2);
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(contact.points[i].depth, 0.1, 1e-15);  // a few roundings at 1
    EXPECT_NEAR(contact.points[i].position.z(), 0.0, 1e-15);
    EXPECT_NEAR(std::abs(contact.points[i].position.y()), 0.5, 1e-15);
  }
  EXPECT_NE(contact.points[0].feature, contact.points[1].feature);
}

TEST(BoxPlane, HoldsAllEightVertices) {
  const Manifold contact =
      collide(Box{Vector3d::Ones()}, at({0.0, 0.0, -5.0}), Plane{}, BodyState{});
  ASSERT_EQ(contact.count, 8);
  EXPECT_EQ(deepest(contact), 5.5);
  EXPECT_EQ(features(contact), (std::set<std::uint32_t>{0, 1, 2, 3, 4, 5, 6, 7}));
}

TEST(BoxSphere, TouchesFaceEdgeAndCornerAtAnyScale) {
  // the sphere's centre is off the face, edge or corner by 0.3 along 1, 2 or 3 axes
  for (const double scale : {1.0, 1e-12}) {
    for (int axes = 1; axes <= 3; ++axes) {
      Vector3d off = Vector3d::Zero();
      off.head(axes).setConstant(0.3 * scale);
      const Vector3d nearest = scale * Vector3d(0.5, axes >= 2 ? 0.5 : 0.25, axes >= 3 ? 0.5 : 0.1);
      const Vector3d centre = nearest + off;
      const double radius = 0.6 * scale;
      const Manifold contact =
          collide(Box{Vector3d::Constant(scale)}, BodyState{}, Sphere{radius}, at(centre));
      ASSERT_EQ(contact.count, 1);
      // a few roundings at 1
      EXPECT_TRUE(contact.normal.isApprox(-off.normalized(), 1e-15));
      EXPECT_NEAR(contact.points[0].depth, radius - off.norm(), 1e-15 * scale);
      const Vector3d deepest_point = centre - radius * off.normalized();
      EXPECT_LT((contact.points[0].position - deepest_point).norm(), 1e-15 * scale);
    }
  }
}

TEST(BoxSphere, SendsAnInnerCentreThroughTheNearestFace) {
  const Vector3d size(2.0, 4.0, 6.0);
  struct Case {
    Vector3d centre;
    Vector3d out;
    double below_face;
  };
  const std::vector<Case> cases{
      {{0.9, 0.0, 0.0}, Vector3d::UnitX(), 0.1},     {{-0.9, 0.0, 0.0}, -Vector3d::UnitX(), 0.1},
      {{0.5, -1.75, 0.0}, -Vector3d::UnitY(), 0.25}, {{0.5, 1.0, 2.75}, Vector3d::UnitZ(), 0.25},
      {{0.0, 0.0, 0.0}, Vector3d::UnitX(), 1.0},     // undetermined: upwards
      {{0.5, 1.5, 2.5}, Vector3d::UnitX(), 0.5},     // a tie: the first
      {{0.0, 2.0, 0.0}, Vector3d::UnitY(), 0.0},     // on a face
      {{1.0, -2.0, 0.0}, Vector3d::UnitX(), 0.0},    // on an edge
      {{-1.0, -2.0, 3.0}, -Vector3d::UnitX(), 0.0},  // on a corner
  };
  for (const Case& c : cases) {
    const Manifold contact = collide(Box{size}, at({7.0, 8.0, 9.0}), Sphere{0.25},
                                     at(c.centre + Vector3d(7.0, 8.0, 9.0)));
    ASSERT_EQ(contact.count, 1);
    // the subtraction of positions up to 12 rounds
    EXPECT_NEAR(contact.points[0].depth, 0.25 + c.below_face, 1e-14) << c.centre.transpose();
    EXPECT_EQ(contact.normal, -c.out) << c.centre.transpose();
  }
}

TEST(BoxSphere, DepthIsContinuousThroughTheSurface) {
  const auto depth = [](double x) {
    return deepest(collide(Box{Vector3d::Ones()}, BodyState{}, Sphere{0.25}, at({x, 0.125, 0.25})));
  };
  for (const double x : {0.5 - 1e-9, 0.5 - 1e-16, 0.5, 0.5 + 2e-16, 0.5 + 1e-9}) {
    EXPECT_NEAR(depth(x), 0.25 + 0.5 - x, 1e-15);  // a few roundings at 1
  }
}

// ---- box against box

struct Boxes {
  Vector3d size_a;
  BodyState a;
  Vector3d size_b;
  BodyState b;

  Manifold contact() const { return collide(Box{size_a}, a, Box{size_b}, b); }
  Boxes with_a_moved(const Vector3d& shift) const {
    Boxes moved = *this;
    moved.a.position += shift;
    return moved;
  }
};

Vector3d nearest_in_box(const Vector3d& size, const BodyState& state, const Vector3d& point) {
  const Vector3d p = state.orientation.conjugate() * (point - state.position);
  return state.position + state.orientation * p.cwiseMax(-0.5 * size).cwiseMin(0.5 * size);
}

double reach(const Vector3d& size, const BodyState& state, const Vector3d& n) {
  return (state.orientation.conjugate() * n).cwiseAbs().dot(0.5 * size);
}

/// Returns the distance that A has to move along n to be past B; never less than the penetration
/// depth.
double depth_along(const Boxes& boxes, const Vector3d& n) {
  return reach(boxes.size_a, boxes.a, n) + reach(boxes.size_b, boxes.b, n) -
         n.dot(boxes.a.position - boxes.b.position);
}

enum class Overlap { kYes, kNo, kUndecided };

/// Returns the overlap by an oracle without axes: alternating projection between the boxes
/// converges to a common point or to the shortest distance, and either proves itself.
Overlap overlap_by_projection(const Boxes& boxes) {
  Vector3d on_b = boxes.b.position;
  for (int i = 0; i < 20000; ++i) {
    const Vector3d on_a = nearest_in_box(boxes.size_a, boxes.a, on_b);
    on_b = nearest_in_box(boxes.size_b, boxes.b, on_a);
    const double distance = (on_a - on_b).norm();
    if (distance < 1e-14) return Overlap::kYes;
    if (depth_along(boxes, (on_a - on_b) / distance) < -1e-14) return Overlap::kNo;
  }
  return Overlap::kUndecided;
}

Boxes random_boxes(NarrowphaseDraw& random) {
  Boxes boxes;
  boxes.size_a = random.vector_between(0.1, 2.0);
  boxes.size_b = random.vector_between(0.1, 2.0);
  boxes.b = at(random.vector_between(-1.0, 1.0), random.orientation());
  boxes.a = at(boxes.b.position + random.vector_between(-1.5, 1.5), random.orientation());
  return boxes;
}

/// A box resting on another with slight tilt and depth, possibly overhanging.
Boxes resting_boxes(NarrowphaseDraw& random) {
  Boxes boxes;
  boxes.size_a = random.vector_between(0.5, 1.5);
  boxes.size_b = random.vector_between(0.5, 1.5);
  const double tilt = std::pow(10.0, random.between(-9.0, -1.0));
  const double depth = std::pow(10.0, random.between(-6.0, -2.0));
  const Quaterniond yaw(AngleAxisd(random.between(-M_PI, M_PI), Vector3d::UnitZ()));
  boxes.a.orientation = AngleAxisd(tilt, random.direction()) * yaw;
  boxes.a.position = {random.between(-0.7, 0.7), random.between(-0.7, 0.7), 0.0};
  boxes.a.position.z() =
      0.5 * boxes.size_b.z() + reach(boxes.size_a, boxes.a, Vector3d::UnitZ()) - depth;
  return boxes;
}

/// Expects the properties of every contact of two boxes.
void expect_sound(const Boxes& boxes, const Manifold& contact) {
  EXPECT_NEAR(contact.normal.norm(), 1.0, 1e-14);
  EXPECT_EQ(features(contact).size(), static_cast<std::size_t>(contact.count));
  for (int i = 0; i < contact.count; ++i) {
    const Manifold::Point& point = contact.points[i];
    EXPECT_GT(point.depth, 0.0);
    // clipping widens a face by up to 1e-6 of a half edge of up to 1
    const Vector3d on_a = point.position - point.depth * contact.normal;
    EXPECT_NEAR(height(Box{boxes.size_b}, boxes.b, point.position), 0.0, 2e-6);
    EXPECT_NEAR(height(Box{boxes.size_a}, boxes.a, on_a), 0.0, 2e-6);
  }
}

/// Expects that moving A by the depth separates the boxes, and moving it by less does not.
void expect_exact_depth(const Boxes& boxes, const Manifold& contact) {
  const double depth = deepest(contact);
  // 1e-9 of the depth, and roundings of coordinates of about 1
  const double parting = depth * (1.0 + 1e-9) + 1e-14;
  EXPECT_EQ(boxes.with_a_moved(parting * contact.normal).contact().count, 0) << depth;
  // a widened face reaches deeper by 1e-6 of its size times its slope
  const double holding = depth * (1.0 - 1e-9) - 2e-6;
  EXPECT_TRUE(holding < 0.0 || boxes.with_a_moved(holding * contact.normal).contact().count > 0)
      << depth;
}

TEST(BoxBox, CrossedBeamsTouchInASquare) {
  // 4 × 1 × 1 along x on 1 × 4 × 1 along y
  const Boxes boxes{{4.0, 1.0, 1.0}, at({0.0, 0.0, 0.75}), {1.0, 4.0, 1.0}, at(Vector3d::Zero())};
  const Manifold contact = boxes.contact();
  ASSERT_EQ(contact.count, 4);
  EXPECT_EQ(contact.normal, Vector3d::UnitZ());
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(contact.points[i].depth, 0.25, 1e-15);  // a few roundings at 1
    // clipping widens a face by 1e-6 of its half edge
    EXPECT_LT((contact.points[i].position.cwiseAbs() - Vector3d::Constant(0.5)).norm(), 2e-6);
  }
  expect_sound(boxes, contact);
}

TEST(BoxBox, TurnedByAnEighthTouchInAnOctagon) {
  const Quaterniond turn(AngleAxisd(M_PI / 4.0, Vector3d::UnitZ()));
  const Boxes boxes{Vector3d::Ones(), at({0.0, 0.0, 0.9}, turn), Vector3d::Ones(), BodyState{}};
  const Manifold contact = boxes.contact();
  ASSERT_EQ(contact.count, 8);
  for (int i = 0; i < 8; ++i) {
    // half an edge and the tangent of 22.5°; widened by 1e-6 of a half edge
    const double radius = 0.5 / std::cos(M_PI / 8.0);
    EXPECT_NEAR(contact.points[i].position.head<2>().norm(), radius, 2e-6);
  }
  expect_sound(boxes, contact);
}

TEST(BoxBox, BeamsOnTheirEdgesTouchInAPoint) {
  // each rotated about its length by 45°, with edges at top and bottom
  const Quaterniond turn_x(AngleAxisd(M_PI / 4.0, Vector3d::UnitX()));
  const Quaterniond turn_y(AngleAxisd(M_PI / 4.0, Vector3d::UnitY()));
  const double height = 2.0 * std::sqrt(0.5);
  const Boxes boxes{{4.0, 1.0, 1.0},
                    at({0.5, 0.0, height - 0.01}, turn_x),
                    {1.0, 4.0, 1.0},
                    at({0.25, 0.5, 0.0}, turn_y)};
  const Manifold contact = boxes.contact();
  ASSERT_EQ(contact.count, 1);
  // some roundings at coordinates of about 1
  EXPECT_TRUE(contact.normal.isApprox(Vector3d::UnitZ(), 1e-14));
  EXPECT_NEAR(contact.points[0].depth, 0.01, 1e-14);
  EXPECT_TRUE(contact.points[0].position.isApprox(Vector3d(0.25, 0.0, 0.5 * height), 1e-14));
}

TEST(BoxBox, RidgesThatCrossFlatlyTouchInAPoint) {
  // only the axis of the two edges, of sine 0.05, separates long beams on their edges
  const Quaterniond roll(AngleAxisd(M_PI / 4.0, Vector3d::UnitX()));
  const Quaterniond yaw(AngleAxisd(0.05, Vector3d::UnitZ()));
  const double height = 2.0 * std::sqrt(0.5);
  Boxes boxes{{40.0, 1.0, 1.0}, BodyState{}, {40.0, 1.0, 1.0}, at(Vector3d::Zero(), yaw * roll)};
  boxes.a = at({0.0, 0.0, height - 0.01}, roll);
  const Manifold contact = boxes.contact();
  ASSERT_EQ(contact.count, 1);
  // roundings at coordinates up to 20, over the sine
  EXPECT_TRUE(contact.normal.isApprox(Vector3d::UnitZ(), 1e-12));
  EXPECT_NEAR(contact.points[0].depth, 0.01, 1e-12);
  EXPECT_TRUE(contact.points[0].position.isApprox(Vector3d(0.0, 0.0, 0.5 * height), 1e-12));
  boxes.a = at({0.0, 0.0, height + 0.01}, roll);
  EXPECT_EQ(boxes.contact().count, 0);
}

TEST(BoxBox, ParallelEdgesTouchInTwoPoints) {
  // an edge along y on a face: parallel edges have no common normal axis
  const Quaterniond turn(AngleAxisd(M_PI / 4.0, Vector3d::UnitY()));
  const Boxes boxes{Vector3d::Ones(),
                    at({0.0, 0.0, 0.5 + std::sqrt(0.5) - 0.01}, turn),
                    {3.0, 3.0, 1.0},
                    BodyState{}};
  const Manifold contact = boxes.contact();
  ASSERT_EQ(contact.count, 2);
  // some roundings at coordinates of about 1
  EXPECT_TRUE(contact.normal.isApprox(Vector3d::UnitZ(), 1e-14));
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(contact.points[i].depth, 0.01, 1e-14);
    EXPECT_NEAR(contact.points[i].position.x(), 0.0, 1e-14);
    EXPECT_NEAR(std::abs(contact.points[i].position.y()), 0.5, 1e-14);
  }
}

TEST(BoxBox, IdenticalBoxesPartAlongTheShortestSide) {
  const Boxes boxes{{2.0, 1.0, 3.0}, BodyState{}, {2.0, 1.0, 3.0}, BodyState{}};
  const Manifold contact = boxes.contact();
  EXPECT_EQ(contact.count, 4);
  EXPECT_EQ(contact.normal.cwiseAbs(), Vector3d::UnitY());
  EXPECT_EQ(deepest(contact), 1.0);
  expect_sound(boxes, contact);
}

TEST(BoxBox, StackedFlushKeepsItsFeaturesThroughRoundOff) {
  NarrowphaseDraw random;
  Boxes boxes{Vector3d::Ones(), at({0.0, 0.0, 1.0 - 1e-4}), Vector3d::Ones(), BodyState{}};
  const std::set<std::uint32_t> expected = features(boxes.contact());
  EXPECT_EQ(expected.size(), 4u);
  for (int trial = 0; trial < 1000; ++trial) {
    const double noise = std::pow(10.0, random.between(-16.0, -8.0));
    boxes.a = at(Vector3d(0.0, 0.0, 1.0 - 1e-4) + noise * random.direction(),
                 Quaterniond(AngleAxisd(noise, random.direction())));
    boxes.b.orientation = AngleAxisd(noise, random.direction());
    EXPECT_EQ(features(boxes.contact()), expected) << "noise " << noise;
  }
}

TEST(BoxBox, OverhangingKeepsItsFeaturesAndItsFace) {
  // where edges cross at the border, the edges' axis has the least depth as soon as the box tilts
  NarrowphaseDraw random;
  Boxes boxes{Vector3d::Ones(), BodyState{}, Vector3d::Ones(), BodyState{}};
  const Vector3d place(0.6, 0.3, 1.0 - 1e-3);
  const Quaterniond yaw(AngleAxisd(0.4, Vector3d::UnitZ()));
  boxes.a = at(place, yaw);
  const Manifold level = boxes.contact();
  EXPECT_GE(level.count, 3);
  for (int trial = 0; trial < 1000; ++trial) {
    const double tilt = std::pow(10.0, random.between(-8.0, -4.0));
    boxes.a.orientation = AngleAxisd(tilt, random.direction()) * yaw;
    const Manifold tilted = boxes.contact();
    EXPECT_EQ(features(tilted), features(level)) << "tilt " << tilt;
    EXPECT_LE((tilted.normal - level.normal).norm(), 1.1 * tilt);
  }
}

TEST(BoxBox, FeaturesDoNotDependOnWhichFaceWasClipped) {
  // tilted by a degree, either A's or B's face has the lesser depth; upside down, a face's vertices
  // are in the opposite order
  NarrowphaseDraw random;
  const Quaterniond yaw(AngleAxisd(0.4, Vector3d::UnitZ()));
  const Quaterniond upside_down(0.0, 1.0, 0.0, 0.0);
  for (const Quaterniond& pose_a : {yaw, yaw * upside_down}) {
    const auto contact = [&](const Quaterniond& tilt_a, const Quaterniond& tilt_b) {
      return collide(Box{{1.0, 0.8, 1.0}}, at({0.4, 0.3, 0.95}, tilt_a * pose_a),
                     Box{Vector3d::Ones()}, at(Vector3d::Zero(), tilt_b));
    };
    const Manifold level = contact(Quaterniond::Identity(), Quaterniond::Identity());
    int normals_of_a = 0;
    int normals_of_b = 0;
    for (int trial = 0; trial < 1000; ++trial) {
      const Quaterniond tilt_a(AngleAxisd(0.02 * random(), random.direction()));
      const Quaterniond tilt_b(AngleAxisd(0.02 * random(), random.direction()));
      const Manifold tilted = contact(tilt_a, tilt_b);
      EXPECT_EQ(features(tilted), features(level)) << "trial " << trial;
      normals_of_a += tilted.normal.isApprox(tilt_a * Vector3d::UnitZ(), 1e-9) ? 1 : 0;
      normals_of_b += tilted.normal.isApprox(tilt_b * Vector3d::UnitZ(), 1e-9) ? 1 : 0;
    }
    EXPECT_GT(normals_of_a, 200);
    EXPECT_GT(normals_of_b, 200);
    EXPECT_EQ(normals_of_a + normals_of_b, 1000);
  }
}

TEST(BoxBox, DepthsAreExactFarFromTheOrigin) {
  NarrowphaseDraw random;
  const Vector3d far = Vector3d::Constant(std::pow(2.0, 30));
  for (int trial = 0; trial < 100; ++trial) {
    Boxes boxes = random_boxes(random);
    boxes.b.position = Vector3d::Zero();
    // a grid that the shift preserves, so that the relative pose is exact
    boxes.a.position = (boxes.a.position * 1024.0).array().round() / 1024.0;
    const Manifold near_contact = boxes.contact();
    boxes.a.position += far;
    boxes.b.position += far;
    const Manifold far_contact = boxes.contact();
    ASSERT_EQ(far_contact.count, near_contact.count);
    for (int i = 0; i < near_contact.count; ++i) {
      EXPECT_EQ(far_contact.points[i].depth, near_contact.points[i].depth);
    }
  }
}

TEST(BoxBox, OnTheBorderOfAHugeBoxStaysWithinIt) {
  // a box of 1 m that overhangs the border of one of 1000 km by half
  const Boxes boxes{Vector3d::Constant(1e6), at({0.0, 0.0, -0.5e6}), Vector3d::Ones(),
                    at({0.5e6, 0.0, 0.5 - 0.125})};
  const Manifold contact = boxes.contact();
  ASSERT_EQ(contact.count, 4);
  double farthest = 0.0;
  for (int i = 0; i < 4; ++i) farthest = std::max(farthest, contact.points[i].position.x());
  EXPECT_NEAR(farthest, 0.5e6, 1e-6);  // the face is widened by 1e-6 of the small box's half edge
}

TEST(BoxBox, AgreesWithAlternatingProjection) {
  NarrowphaseDraw random;
  int yes = 0;
  int no = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    const Boxes boxes = random_boxes(random);
    const Overlap expected = overlap_by_projection(boxes);
    if (expected == Overlap::kUndecided) continue;
    (expected == Overlap::kYes ? yes : no)++;
    EXPECT_EQ(boxes.contact().count > 0, expected == Overlap::kYes) << "trial " << trial;
  }
  EXPECT_GT(yes, 1500);
  EXPECT_GT(no, 1500);
  EXPECT_GT(yes + no, 4990);
}

// Alternating projection gives an upper bound of the distance, and the plane between the points a
// lower bound.
TEST(BoxBox, WithinAMarginHaveTheirDistance) {
  NarrowphaseDraw random;
  const double margin = 0.05;
  int near = 0;
  int exact = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    Boxes boxes = random_boxes(random);
    boxes.size_a = boxes.size_a.cwiseMax(10.0 * margin);  // the margin requires large boxes
    boxes.size_b = boxes.size_b.cwiseMax(10.0 * margin);
    Vector3d on_b = boxes.b.position;
    double longest = 0.0;
    double shortest = 0.0;
    for (int i = 0; i < 2000; ++i) {
      const Vector3d on_a = nearest_in_box(boxes.size_a, boxes.a, on_b);
      on_b = nearest_in_box(boxes.size_b, boxes.b, on_a);
      longest = (on_a - on_b).norm();
      if (longest < 1e-9) break;
      shortest = -depth_along(boxes, (on_a - on_b) / longest);
      if (longest - shortest < 1e-14) break;
    }
    if (longest < 1e-9 || longest - shortest > 1e-12) continue;  // touching, or not accurate
    const Manifold contact =
        collide(Box{boxes.size_a}, boxes.a, Box{boxes.size_b}, boxes.b, margin);
    if (shortest >= margin) {
      EXPECT_EQ(contact.count, 0) << "trial " << trial;
      continue;
    }
    if (longest > 0.98 * margin) continue;  // points may be off by a hundredth of the margin
    ++near;
    ASSERT_GT(contact.count, 0) << "trial " << trial << " " << longest;
    double gap = margin;
    for (int i = 0; i < contact.count; ++i) gap = std::min(gap, -contact.points[i].depth);
    EXPECT_GE(gap, shortest - 2e-6);  // a face is widened by 1e-6 of a half edge of up to 1
    EXPECT_LE(gap, longest + 0.01 * margin + 1e-12);
    exact += std::abs(gap - longest) < 1e-12 ? 1 : 0;
  }
  EXPECT_GT(near, 400);
  EXPECT_GT(exact, 0.9 * near);
}

// A box about to land has the contact points on which it will rest.
TEST(BoxBox, LandingKeepsItsFeatures) {
  NarrowphaseDraw random;
  int landed = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    Boxes boxes = resting_boxes(random);
    const double tilt = std::pow(10.0, random.between(-12.0, -6.0));
    boxes.a.orientation =
        AngleAxisd(tilt, random.direction()) * Quaterniond(AngleAxisd(0.4, Vector3d::UnitZ()));
    boxes.a.position.z() = 0.5 * (boxes.size_a.z() + boxes.size_b.z());
    const auto at_gap = [&](double gap) {
      const Boxes moved = boxes.with_a_moved({0.0, 0.0, gap});
      return features(collide(Box{moved.size_a}, moved.a, Box{moved.size_b}, moved.b, 0.01));
    };
    const std::set<std::uint32_t> contact = at_gap(-1e-3);
    if (contact.size() < 3) continue;  // overlapping sideways by less
    ++landed;
    for (const double gap : {5e-3, 1e-4, 1e-5}) EXPECT_EQ(at_gap(gap), contact) << trial;
  }
  EXPECT_GT(landed, 900);
}

TEST(BoxBox, DepthIsTheLeastThatParts) {
  NarrowphaseDraw random;
  for (int trial = 0; trial < 5000; ++trial) {
    const Boxes boxes = random_boxes(random);
    const Manifold contact = boxes.contact();
    if (contact.count == 0) continue;
    expect_sound(boxes, contact);
    expect_exact_depth(boxes, contact);
    // a face whose normal is within a cosine of 0.999 may replace an edge's axis
    for (int i = 0; i < 100; ++i) {
      EXPECT_LE(0.999 * deepest(contact), depth_along(boxes, random.direction()) + 1e-14);
    }
    if (HasFailure()) FAIL() << "trial " << trial;
  }
}

TEST(BoxBox, RestingBoxesHaveTheWholeFaceAndTheRightDepth) {
  NarrowphaseDraw random;
  int contacts = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    const Boxes boxes = resting_boxes(random);
    const Manifold contact = boxes.contact();
    if (contact.count == 0) continue;
    ++contacts;
    expect_sound(boxes, contact);
    expect_exact_depth(boxes, contact);
    if (HasFailure()) FAIL() << "trial " << trial;
  }
  EXPECT_GT(contacts, 2500);
}

}  // namespace
}  // namespace constraint_sim::engine
