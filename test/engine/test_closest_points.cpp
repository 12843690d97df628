// Closest points of each pair of shapes. Points and normal prove the distance: each point is on the
// surface of its shape, their difference is distance times normal, and no point of a shape is
// beyond the plane through its own point across the normal. So no two points of shapes that are
// apart are nearer, and shapes that overlap are apart after a translation by the depth, which FCL
// finds the least (test/fcl).

#include <sstream>

#include "constraint_sim/engine/closest_points.h"
#include "engine/collision/closest_points.h"
#include "oracle_shapes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

BodyState state_at(const Vector3d& position,
                   const Quaterniond& orientation = Quaterniond::Identity()) {
  BodyState state;
  state.position = position;
  state.orientation = orientation;
  return state;
}

struct ClosestCheck {
  double on_a, on_b, apart, beyond;  // errors [m]

  ClosestCheck(const OracleShape& a, const BodyState& at_a, const OracleShape& b,
               const BodyState& at_b, const ClosestPoints& found) {
    const auto local = [](const BodyState& state, const Vector3d& p) -> Vector3d {
      return state.orientation.conjugate() * (p - state.position);
    };
    const Vector3d p_a = local(at_a, found.p_a), p_b = local(at_b, found.p_b);
    on_a = std::abs(static_cast<double>(height_over(a, p_a.cast<Exact>())));
    on_b = std::abs(static_cast<double>(height_over(b, p_b.cast<Exact>())));
    apart = (found.p_a - found.p_b - found.distance * found.normal).norm();
    const Vector3d n_a = at_a.orientation.conjugate() * -found.normal;
    const Vector3d n_b = at_b.orientation.conjugate() * found.normal;
    beyond = std::max(support_of(a, n_a) - n_a.dot(p_a), support_of(b, n_b) - n_b.dot(p_b));
  }
};

TEST(ClosestPoints, AreProvedByTheirNormal) {
  Draw draw(5);
  int apart = 0, overlapping = 0, rough = 0;
  for (int i = 0; i < 20000 / kSanitizedShare; ++i) {
    const double scale = std::pow(10.0, draw.below(13) - 6);
    const int kind_a = i % kOracleShapes, kind_b = (i / kOracleShapes) % kOracleShapes;
    const OracleShape a = random_oracle_shape(kind_a, scale, &draw);
    const OracleShape b = random_oracle_shape(kind_b, scale, &draw);
    const bool is_plane_a = std::holds_alternative<Plane>(a.shape);
    if (is_plane_a && std::holds_alternative<Plane>(b.shape)) continue;
    BodyState at_b = state_at(scale * draw.vector(), draw.turn());
    BodyState at_a =
        state_at(at_b.position + scale * draw.between(0.1, 2.0) * draw.vector(), draw.turn());
    if (i % 3 == 0)  // axes that are parallel or at right angles
      at_a.orientation =
          at_b.orientation * AngleAxisd(0.5 * kPi * draw.below(4), Vector3d::Unit(draw.below(3)));
    const ClosestPoints found = closest_points_of(a.shape, at_a, b.shape, at_b);
    ASSERT_NEAR(found.normal.norm(), 1.0, 1e-14) << i;
    (found.distance > 0.0 ? apart : overlapping) += 1;
    const ClosestCheck check(a, at_a, b, at_b, found);
    const auto errors = [&] {
      std::ostringstream text;
      text << i << ": " << kind_a << ", " << kind_b << ": " << check.on_a << " " << check.on_b
           << " " << check.apart << " " << check.beyond << " at " << found.distance;
      return text.str();
    };
    // Farthest parts have corners within 1e-9 of their size.
    ASSERT_LT(std::max({check.on_a, check.on_b, check.beyond}), 1e-9 * scale) << errors();
    if (found.distance > 0.0) {
      ASSERT_LT(check.apart, 1e-9 * scale) << errors();
    } else {
      rough += check.apart > 1e-9 * scale;
    }
  }
  EXPECT_GT(apart, 5000 / kSanitizedShare);
  EXPECT_GT(overlapping, 2000 / kSanitizedShare);
  // The search for the axis of least depth of a cylinder ends beside it in 1 of 100 000 poses.
  EXPECT_LE(rough, 1);
}

Body closest_body(const std::string& name, const Shape& shape, const Vector3d& position) {
  Body body = make_body(name, shape, 1.0, position);
  if (std::holds_alternative<Plane>(shape)) body.type = BodyType::kStatic;
  return body;
}

// Parallel faces, edges and lines have many closest pairs: the middle of all of them is returned.
TEST(ClosestPoints, AreInTheMiddleOfParallelFaces) {
  const Quaterniond along_x(AngleAxisd(0.5 * kPi, Vector3d::UnitY()));
  struct Case {
    const char* name;
    Shape a, b;
    Vector3d at_a;
    double distance;
    Vector3d p_a;
    Quaterniond turn_a = Quaterniond::Identity();
  };
  const Case cases[] = {
      {"box over box", Box{{2, 2, 2}}, Box{{4, 2, 2}}, {1.5, 0.5, 5}, 3.0, {1.25, 0.25, 4}},
      {"box in box", Box{{2, 2, 2}}, Box{{4, 4, 2}}, {0.5, 0, 1.5}, -0.5, {0.5, 0, 0.5}},
      {"cylinder over box", Cylinder{0.5, 2}, Box{{4, 4, 2}}, {0.5, 1, 3}, 1.0, {0.5, 1, 2}},
      {"cylinder along box",
       Cylinder{0.5, 2},
       Box{{4, 4, 2}},
       {1.5, 1, 3},
       1.5,
       {1.25, 1, 2.5},
       along_x},
      {"capsule along box",
       Capsule{0.5, 2},
       Box{{4, 4, 2}},
       {1.5, 1, 3},
       1.5,
       {1.25, 1, 2.5},
       along_x},
      {"capsule along capsule", Capsule{0.5, 2}, Capsule{0.5, 2}, {3, 0, 1}, 2.0, {2.5, 0, 0.5}},
      {"box over plane", Box{{2, 2, 2}}, Plane{}, {3, 4, 2}, 1.0, {3, 4, 1}},
      {"cylinder over plane", Cylinder{0.5, 2}, Plane{}, {3, 4, 0.5}, -0.5, {3, 4, -0.5}},
      {"sphere beside sphere", Sphere{1}, Sphere{2}, {0, 5, 0}, 2.0, {0, 4, 0}},
      {"point over box", Point{}, Box{{4, 4, 2}}, {0.5, 1, 3}, 2.0, {0.5, 1, 3}},
      {"points", Point{}, Point{}, {0, 3, 4}, 5.0, {0, 3, 4}},
  };
  for (const Case& c : cases) {
    World world(weightless(0.01));
    Body a = closest_body("a", c.a, c.at_a);
    a.state.orientation = c.turn_a;
    const BodyId id_a = world.add_body(a), id_b = world.add_body(closest_body("b", c.b, {0, 0, 0}));
    const ClosestPoints found = closest_points(world, id_a, id_b);
    // Coordinates are below 10; 64 corners of a cap have their middle to rounding.
    EXPECT_NEAR(found.distance, c.distance, 1e-14) << c.name;
    EXPECT_LT((found.p_a - c.p_a).norm(), 1e-13) << c.name << ": " << found.p_a.transpose();
    EXPECT_LT((found.p_a - found.p_b - found.distance * found.normal).norm(), 1e-13) << c.name;
    const ClosestPoints exchanged = closest_points(world, id_b, id_a);
    EXPECT_NEAR(exchanged.distance, c.distance, 1e-14) << c.name;
    EXPECT_LT((exchanged.p_b - c.p_a).norm(), 1e-13) << c.name;
    EXPECT_LT((exchanged.normal + found.normal).norm(), 1e-13) << c.name;
  }
}

TEST(ClosestPoints, AreOfTheShapeAndNotOfTheBody) {
  World world(weightless(0.01));
  Body a = closest_body("a", Sphere{0.5}, {0, 0, 0});
  a.inertia = Vector3d::Ones();
  a.shape_pose = ShapePose{{2, 0, 0}, Quaterniond::Identity()};
  a.state.orientation = AngleAxisd(0.5 * kPi, Vector3d::UnitZ());  // the sphere is at (0, 2, 0)
  a.no_collision = true;
  const BodyId id_a = world.add_body(a);
  const BodyId id_b = world.add_body(closest_body("b", Sphere{0.5}, {0, 5, 0}));
  const std::uint64_t hash = world.state_hash();
  const ClosestPoints found = closest_points(world, id_a, id_b);
  EXPECT_NEAR(found.distance, 2.0, 1e-14);
  EXPECT_LT((found.p_a - Vector3d(0, 2.5, 0)).norm(), 1e-14);
  EXPECT_LT((found.p_b - Vector3d(0, 4.5, 0)).norm(), 1e-14);
  EXPECT_EQ(world.state_hash(), hash);
}

TEST(ClosestPoints, AreCheckedByName) {
  World world(weightless(0.01));
  const BodyId a = world.add_body(closest_body("a", Plane{}, {0, 0, 0}));
  const BodyId b = world.add_body(closest_body("b", Plane{}, {0, 0, 0}));
  const BodyId gone = world.add_body(closest_body("gone", Sphere{1.0}, {0, 0, 0}));
  world.remove_body(gone);
  const auto why = [&](BodyId of_a, BodyId of_b) {
    return refusal([&] { closest_points(world, of_a, of_b); });
  };
  EXPECT_EQ(why(a, a), "body_b: must not be body_a, got 'a'");
  EXPECT_EQ(why(a, b), "body_b: two planes have no closest points, got 'a' and 'b'");
  EXPECT_EQ(why(kWorldBody, b), "body_a: the world itself has no shape");
  EXPECT_EQ(why(a, kWorldBody), "body_b: the world itself has no shape");
  EXPECT_EQ(why(a, gone), "body: there is none with id 3");
}

}  // namespace
}  // namespace constraint_sim::engine
