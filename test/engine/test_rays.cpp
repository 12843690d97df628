// Rays against each shape and against the bodies of a world.
//
// The oracle of a shape is a convex function of the point, negative inside (oracle_shapes.h): along
// a line it is convex too, so that a search by thirds finds its minimum, and bisection its zeros. A
// normal is right where no point of the shape is beyond the plane through the hit.

#include "constraint_sim/engine/ray.h"
#include "constraint_sim/engine/scene.h"
#include "engine/collision/ray.h"
#include "oracle_shapes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
/// A line in the frame of a shape, with the oracle's search along it.
struct ExactLine {
  const OracleShape& target;
  Exact3 p, d;

  ExactLine(const OracleShape& of, const BodyState& pose, const Vector3d& origin,
            const Vector3d& direction)
      : target(of) {
    const Eigen::Quaternion<Exact> to_shape =
        pose.orientation.cast<Exact>().normalized().conjugate();
    p = to_shape * (origin.cast<Exact>() - pose.position.cast<Exact>());
    d = to_shape * direction.cast<Exact>().normalized();
  }
  Exact height(Exact t) const { return height_over(target, p + t * d); }
  /// Returns the place of the least height between two places.
  Exact lowest(Exact low, Exact high) const {
    for (int i = 0; i < 160; ++i) {
      const Exact third = (high - low) / 3;
      if (height(low + third) < height(high - third))
        high -= third;
      else
        low += third;
    }
    return (low + high) / 2;
  }
  /// Returns the zero between a place outside and a place inside.
  Exact entry(Exact outside, Exact inside) const {
    for (int i = 0; i < 120; ++i) {
      const Exact middle = (outside + inside) / 2;
      (height(middle) < 0 ? inside : outside) = middle;
    }
    return inside;
  }
};

// Far bodies are 10^6 of their size from the origin of the world. Rays start within three sizes,
// and some a thousand sizes away; every seventh one runs along an axis of the shape.
TEST(RaysAgainstShapes, EnterWhereTheOracleSays) {
  Draw draw(7);
  int hits = 0, misses = 0, inside = 0;
  for (int i = 0; i < 12000 / kSanitizedShare; ++i) {
    const double scale = std::pow(10.0, draw.below(13) - 6);
    const OracleShape target = random_oracle_shape(i % kOracleShapes, scale, &draw);
    BodyState pose;
    pose.position = scale * (draw.below(2) == 0 ? 1.0 : 1e6) * draw.vector();
    pose.orientation = draw.turn();
    const double away = scale * (draw.below(4) == 0 ? 1000.0 : 1.0);
    const Vector3d origin = pose.position + away * draw.vector();
    const Vector3d aim = pose.position + 0.4 * scale * draw.vector();
    const Vector3d direction = i % 7 == 0 ? Vector3d(pose.orientation * Vector3d::Unit(i % 3))
                                          : (aim - origin).normalized();
    if (direction.norm() < 0.5) continue;

    const ExactLine line(target, pose, origin, direction);
    const std::optional<LinePart> part =
        line_part_in(target.shape, pose, origin, direction.normalized());
    // Coordinates of body and origin are rounded, as are the unit direction over the distance and
    // the results of some operations: the largest error seen is 4e-16 of their sum.
    const double end = 4.0 * (away + scale);
    const bool is_plane = std::holds_alternative<Plane>(target.shape);
    double distance = end, middle = 0.0;
    if (part && !is_plane) middle = 0.5 * (part->enter + part->exit);
    if (part && is_plane) {  // one end, or none
      if (std::isfinite(part->enter)) middle = part->enter + end;
      if (std::isfinite(part->exit)) middle = part->exit - end;
      distance += std::abs(middle);
    }
    const double rounding = 1e-15 * (pose.position.norm() + origin.norm() + distance);
    if (part) {
      ASSERT_LT(static_cast<double>(line.height(middle)), rounding) << i;
      if (std::isfinite(part->enter)) {
        ASSERT_LT(std::abs(static_cast<double>(line.height(part->enter))), rounding) << i;
        const Vector3d n = pose.orientation.conjugate() * part->normal;
        const Vector3d x = (line.p + Exact(part->enter) * line.d).cast<double>();
        ASSERT_NEAR(part->normal.norm(), 1.0, 1e-14) << i;
        ASSERT_LT(part->normal.dot(direction), 1e-15) << i;
        // Normals of hulls are those of Qhull's planes, exact to 1e-13.
        ASSERT_LT(support_of(target, n) - n.dot(x), rounding + 1e-12 * scale) << i;
      }
      if (std::isfinite(part->exit)) {
        ASSERT_LT(std::abs(static_cast<double>(line.height(part->exit))), rounding) << i;
      }
      (part->enter < 0.0 && part->exit > 0.0 ? inside : hits) += 1;
      // The slope at the entry is at least the mean slope to the middle, by convexity.
      const double depth = -static_cast<double>(line.height(middle));
      if (std::isfinite(part->enter) && depth > 10.0 * rounding) {
        ASSERT_NEAR(static_cast<double>(line.entry(part->enter - end, middle)), part->enter,
                    2.0 * rounding * (middle - part->enter) / depth)
            << i;
      }
    } else {
      ASSERT_GT(static_cast<double>(line.height(line.lowest(-end, end))), -rounding) << i;
      ++misses;
    }
  }
  EXPECT_GT(hits, 3000 / kSanitizedShare);
  EXPECT_GT(misses, 1000 / kSanitizedShare);
  EXPECT_GT(inside, 500 / kSanitizedShare);
}

/// A world with one body in the origin.
World world_with(const Shape& shape) {
  World world(weightless(0.01));
  Body body = make_body("target", shape, 1.0, Vector3d::Zero());
  body.type = BodyType::kStatic;
  world.add_body(body);
  return world;
}

std::optional<RayHit> shot(const World& world, const Vector3d& origin, const Vector3d& direction,
                           double max_distance = kInfinity) {
  return cast_ray(world, {origin, direction, max_distance});
}

// Each shape reaches from −1 to 1 along x, or has its surface at z = 0; numbers are exact.
TEST(Rays, OfSurfacesHitInwardsOnly) {
  const std::vector<Vector3d> corners{{-1, -1, -1}, {1, -1, -1}, {-1, 1, -1}, {1, 1, -1},
                                      {-1, -1, 1},  {1, -1, 1},  {-1, 1, 1},  {1, 1, 1}};
  for (const Shape& shape : {Shape(Sphere{1.0}), Shape(Box{{2, 2, 2}}), Shape(Cylinder{1.0, 2.0}),
                             Shape(Capsule{1.0, 2.0}), Shape(Hull(corners))}) {
    const World world = world_with(shape);
    const std::size_t kind = shape.index();
    const auto front = shot(world, {-3, 0, 0}, {5, 0, 0});
    ASSERT_TRUE(front) << kind;
    EXPECT_EQ(front->distance, 2.0) << kind;
    EXPECT_EQ(front->point, Vector3d(-1, 0, 0)) << kind;
    EXPECT_EQ(front->normal, Vector3d(-1, 0, 0)) << kind;
    EXPECT_FALSE(front->inside) << kind;
    // The greatest distance belongs to the ray.
    EXPECT_TRUE(shot(world, {-3, 0, 0}, {5, 0, 0}, 2.0)) << kind;
    EXPECT_FALSE(shot(world, {-3, 0, 0}, {5, 0, 0}, 1.999)) << kind;
    // away from the shape
    EXPECT_FALSE(shot(world, {-3, 0, 0}, {-1, 0, 0})) << kind;
    // on the surface: inwards, outwards, along it
    const auto inwards = shot(world, {-1, 0, 0}, {1, 0, 0});
    ASSERT_TRUE(inwards) << kind;
    EXPECT_EQ(inwards->distance, 0.0) << kind;
    EXPECT_EQ(inwards->normal, Vector3d(-1, 0, 0)) << kind;
    EXPECT_FALSE(inwards->inside) << kind;
    EXPECT_FALSE(shot(world, {-1, 0, 0}, {-1, 0, 0})) << kind;
    EXPECT_FALSE(shot(world, {-1, 0, 0}, {0, 1, 0})) << kind;
    // tangential from afar, and the next number inwards
    EXPECT_FALSE(shot(world, {-1, -3, 0}, {0, 1, 0})) << kind;
    EXPECT_TRUE(shot(world, {std::nextafter(-1.0, 0.0), -3, 0}, {0, 1, 0})) << kind;
    // inside
    const auto within = shot(world, {0.25, 0.125, 0}, {0, 0, -2});
    ASSERT_TRUE(within) << kind;
    EXPECT_TRUE(within->inside) << kind;
    EXPECT_EQ(within->distance, 0.0) << kind;
    EXPECT_EQ(within->point, Vector3d(0.25, 0.125, 0)) << kind;
    EXPECT_EQ(within->normal, Vector3d(0, 0, 1)) << kind;
  }
}

TEST(Rays, HitPlanesFromAboveAndAreInsideBelow) {
  const World world = world_with(Plane{});
  const auto hit = shot(world, {5, 6, 2}, {0, 0, -1});
  ASSERT_TRUE(hit);
  EXPECT_EQ(hit->distance, 2.0);
  EXPECT_EQ(hit->normal, Vector3d(0, 0, 1));
  EXPECT_FALSE(shot(world, {0, 0, 2}, {1, 0, 1}));
  EXPECT_FALSE(shot(world, {0, 0, 2}, {1, 0, 0}));
  EXPECT_FALSE(shot(world, {0, 0, 0}, {1, 0, 0}));
  EXPECT_FALSE(shot(world, {0, 0, 0}, {0, 0, 1}));
  for (const Vector3d& direction : {Vector3d(0, 0, 1), Vector3d(1, 0, 0), Vector3d(0, 0, -1)}) {
    const auto below = shot(world, {0, 0, -1e-3}, direction);
    ASSERT_TRUE(below);
    EXPECT_TRUE(below->inside);
    EXPECT_EQ(below->distance, 0.0);
    EXPECT_EQ(below->normal, -direction);
  }
  // A slope of 1e-300 meets the plane beyond all numbers that a world has.
  const auto far = shot(world, {0, 0, 1}, {1, 0, -1e-300});
  EXPECT_TRUE(!far || std::isfinite(far->distance));
}

/// Bodies of all shapes, some beside their centre of mass.
World random_targets(int count, Random* random) {
  World world(weightless(0.01));
  Draw draw(11);
  for (int i = 0; i < count; ++i) {
    const int kind = i == 0 ? 4 : i % kOracleShapes == 4 ? 0 : i % kOracleShapes;
    Body body = make_body("body_" + std::to_string(i), random_oracle_shape(kind, 1.0, &draw).shape,
                          1.0, 2.0 * random->vector());
    body.state.orientation = random->orientation();
    if (kind == 4) {
      body.type = BodyType::kStatic;
      body.state.position = {0, 0, -3};
      body.state.orientation = Quaterniond::Identity();
    } else if (i % 5 == 0 && kind != 5) {
      body.inertia = Vector3d::Ones();
      body.shape_pose = ShapePose{random->vector(), random->orientation()};
    }
    body.no_collision = i % 7 == 0;
    world.add_body(body);
  }
  world.add_body(make_body("point", Point{}, 1.0, Vector3d::Zero()));
  return world;
}

TEST(Rays, HitTheFirstOfAllBodies) {
  Random random;
  const World world = random_targets(120, &random);
  const std::uint64_t hash = world.state_hash();
  const std::vector<BodyId> ids = world.body_ids();
  std::vector<Ray> rays;
  for (int i = 0; i < 3000 / kSanitizedShare; ++i)
    rays.push_back({3.0 * random.vector(), random.vector(), 0.1 + 6.0 * std::abs(random())});
  const std::vector<BodyId> ignored{ids[3], ids[17], ids[0], kWorldBody};
  for (const auto& passed : {std::vector<BodyId>{}, ignored}) {
    const auto hits = cast_rays(world, rays, passed);
    ASSERT_EQ(hits.size(), rays.size());
    int found = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      // Brute force over all shapes, without bounding spheres.
      std::optional<RayHit> first;
      const Vector3d direction = rays[i].direction.normalized();
      for (const BodyId id : ids) {
        if (std::find(passed.begin(), passed.end(), id) != passed.end()) continue;
        const Body& body = world.body(id);
        BodyState pose = world.state(id);
        if (body.shape_pose) {
          pose.position += pose.orientation * body.shape_pose->position;
          pose.orientation = pose.orientation * body.shape_pose->orientation;
        }
        const auto part = line_part_in(body.shape, pose, rays[i].origin, direction);
        if (!part || part->exit <= 0.0 || part->enter > rays[i].max_distance) continue;
        const double distance = std::max(0.0, part->enter);
        if (first && distance >= first->distance) continue;
        first = RayHit{id, distance, rays[i].origin + distance * direction, part->normal, false};
      }
      ASSERT_EQ(hits[i].has_value(), first.has_value()) << i;
      const auto alone = cast_ray(world, rays[i], passed);
      ASSERT_EQ(alone.has_value(), first.has_value()) << i;
      if (!first) continue;
      ++found;
      ASSERT_EQ(hits[i]->body, first->body) << i;
      // The direction is unit to rounding, by two orders of operations, and distances are below 20.
      ASSERT_NEAR(hits[i]->distance, first->distance, 1e-13) << i;
      ASSERT_LT((hits[i]->point - first->point).norm(), 1e-13) << i;
      ASSERT_EQ(alone->distance, hits[i]->distance) << i;
      ASSERT_EQ(alone->normal, hits[i]->normal) << i;
    }
    EXPECT_GT(found, 500 / kSanitizedShare);
  }
  EXPECT_EQ(world.state_hash(), hash);
  World snapshot;
  world.take_snapshot(&snapshot);
  for (const Ray& ray : {rays[0], rays[1], rays[2]}) {
    const auto here = cast_ray(world, ray), there = cast_ray(snapshot, ray);
    ASSERT_EQ(here.has_value(), there.has_value());
    if (here) {
      EXPECT_EQ(here->distance, there->distance);
    }
  }
}

TEST(Rays, AreTheSameForDirectionsOfAnyLength) {
  Random random;
  const World world = random_targets(60, &random);
  for (int i = 0; i < 200; ++i) {
    const Vector3d origin = 6.0 * random.vector(), direction = random.vector();
    const auto unit = shot(world, origin, direction);
    for (const double length : {0x1p-1000, 0x1p-300, 0x1p60}) {  // exact factors
      const auto other = shot(world, origin, length * direction);
      ASSERT_EQ(unit.has_value(), other.has_value());
      if (unit) {
        ASSERT_EQ(unit->point, other->point);
      }
    }
  }
}

TEST(Rays, HitTheFirstAddedOfBodiesAtOneDistance) {
  World world(weightless(0.01));
  const BodyId first = world.add_body(make_body("first", Box{{1, 1, 1}}, 1.0, Vector3d::Zero()));
  const BodyId second = world.add_body(make_body("second", Box{{1, 1, 1}}, 1.0, Vector3d::Zero()));
  EXPECT_EQ(shot(world, {3, 0, 0}, {-1, 0, 0})->body, first);
  EXPECT_EQ(shot(world, {0, 0, 0}, {-1, 0, 0})->body, first);
  EXPECT_EQ(cast_ray(world, {{3, 0, 0}, {-1, 0, 0}}, {first})->body, second);
  EXPECT_FALSE(cast_ray(world, {{3, 0, 0}, {-1, 0, 0}}, {first, second}));
}

TEST(Rays, AreCheckedByName) {
  World world(weightless(0.01));
  const BodyId gone = world.add_body(make_body("gone", Sphere{1.0}, 1.0, Vector3d::Zero()));
  world.remove_body(gone);
  const auto why = [&](const Vector3d& origin, const Vector3d& direction, double distance) {
    return refusal([&] { shot(world, origin, direction, distance); });
  };
  EXPECT_EQ(why({0, kNaN, 0}, {1, 0, 0}, 1), "origin: must be finite numbers, got (0, nan, 0)");
  EXPECT_EQ(why({0, 1e21, 0}, {1, 0, 0}, 1), "origin: must be at most 1e+20, got (0, 1e+21, 0)");
  EXPECT_EQ(why({0, 0, 0}, {0, 0, 0}, 1), "direction: must not be (0, 0, 0)");
  EXPECT_EQ(why({0, 0, 0}, {kInfinity, 0, 0}, 1),
            "direction: must be finite numbers, got (inf, 0, 0)");
  EXPECT_EQ(why({0, 0, 0}, {1, 0, 0}, 0), "max_distance: must be a number > 0, got 0");
  EXPECT_EQ(why({0, 0, 0}, {1, 0, 0}, kNaN), "max_distance: must be a number > 0, got nan");
  EXPECT_EQ(why({0, 0, 0}, {1, 0, 0}, kInfinity), "");
  EXPECT_EQ(refusal([&] { cast_ray(world, {}, {gone}); }), "body: there is none with id 1");
  EXPECT_EQ(refusal([&] {
              cast_rays(world, {{}, {{0, 0, 0}, {0, 0, 0}}});
            }),
            "rays[1].direction: must not be (0, 0, 0)");
  EXPECT_TRUE(cast_rays(world, {}).empty());
}

}  // namespace
}  // namespace constraint_sim::engine
