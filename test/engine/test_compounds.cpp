// Bodies of several shapes, against bodies of one shape, welded bodies, closed forms and each of
// their parts alone.

#include "constraint_sim/engine/closest_points.h"
#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/ray.h"
#include "constraint_sim/engine/region.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr std::array<Method, 2> kImpulses{Method::kSequentialImpulses, Method::kTimeStepping};

Compound compound_of(Compound::Parts parts) { return Compound(std::move(parts)); }

std::vector<Vector3d> corners(const Vector3d& size) {
  std::vector<Vector3d> list;
  for (unsigned i = 0; i < 8; ++i)
    list.push_back(
        0.5 * size.cwiseProduct(Vector3d((i & 1u) != 0 ? 1.0 : -1.0, (i & 2u) != 0 ? 1.0 : -1.0,
                                         (i & 4u) != 0 ? 1.0 : -1.0)));
  return list;
}

/// A box, cut in two along an axis.
Compound cut_box(const Vector3d& size, int axis, bool of_hulls = false) {
  Vector3d half = size;
  half[axis] *= 0.5;
  const Vector3d arm = 0.5 * half[axis] * Vector3d::Unit(axis);
  const Shape part = of_hulls ? Shape(Hull(corners(half))) : Shape(Box{half});
  return compound_of(
      {{part, {-arm, Quaterniond::Identity()}}, {part, {arm, Quaterniond::Identity()}}});
}

Compound dumbbell(double radius, double distance) {
  const Vector3d arm(0.5 * distance, 0.0, 0.0);
  return compound_of({{Sphere{radius}, {-arm, Quaterniond::Identity()}},
                      {Sphere{radius}, {arm, Quaterniond::Identity()}}});
}

/// An L of two boxes that are flush, neither centred nor along its principal axes.
Compound ell() {
  return compound_of({{Box{{0.4, 0.1, 0.1}}, {{0.2, 0.0, 0.0}, Quaterniond::Identity()}},
                      {Box{{0.1, 0.1, 0.3}}, {{0.05, 0.0, 0.2}, Quaterniond::Identity()}}});
}

WorldOptions step_options(Method method, double time_step = 1e-3) {
  WorldOptions options;
  options.method = method;
  options.time_step = time_step;
  return options;
}

World world_on_floor(Method method, const Body& body, double friction = 0.5, double slope = 0.0) {
  World world(step_options(method));
  world.add_body(make_floor(friction, slope));
  world.add_body(body);
  return world;
}

Body rough_body(const Shape& shape, double mass, const Vector3d& position) {
  Body body = make_body("body", shape, mass, position);
  body.friction = 0.5;
  return body;
}

double energy(const World& world) { return world.energy(); }

/// Every part of a compound as a static body of its own, at the pose that it has in a body.
std::vector<Body> parts_alone(const Compound& compound, const BodyState& at) {
  std::vector<Body> bodies;
  for (const ShapePart& part : *compound.parts) {
    Body body = make_body("part" + std::to_string(bodies.size()), part.shape, 0.0,
                          at.position + at.orientation * part.pose.position);
    body.state.orientation = at.orientation * part.pose.orientation;
    body.type = BodyType::kStatic;
    bodies.push_back(body);
  }
  return bodies;
}

Compound mixed_parts(Random* random) {
  std::vector<Vector3d> points;
  for (int i = 0; i < 12; ++i) points.push_back(0.2 * random->vector());
  const auto pose = [&] { return ShapePose{0.4 * random->vector(), random->orientation()}; };
  return compound_of({{Box{{0.3, 0.2, 0.1}}, pose()},
                      {Sphere{0.12}, pose()},
                      {Capsule{0.08, 0.3}, pose()},
                      {Cylinder{0.1, 0.2}, pose()},
                      {Hull(points), pose()}});
}

// ---- mass

// Both halves of a box make the inertia of the box, by parallel axes: sums of a few numbers.
TEST(CompoundMasses, OfACutBoxAreThoseOfTheBox) {
  const Vector3d size(0.4, 0.2, 0.3);
  for (const bool of_hulls : {false, true}) {
    for (int axis = 0; axis < 3; ++axis) {
      World world;
      const BodyId id =
          world.add_body(make_body("body", cut_box(size, axis, of_hulls), 3.0, {1, 2, 3}));
      EXPECT_LT((unit_inertia(world.body(id).shape) - unit_inertia(Box{size})).norm(), 1e-15);
      EXPECT_NEAR(volume(world.body(id).shape), size.prod(), 1e-16);
    }
  }
}

// Two spheres at a distance d: 2/5 r² along the line, and (d/2)² more across it.
TEST(CompoundMasses, OfADumbbellAreItsClosedForm) {
  const Vector3d inertia = unit_inertia(Shape(dumbbell(0.1, 0.5)));
  const double own = 0.4 * 0.1 * 0.1;
  EXPECT_LT((inertia - Vector3d(own, own + 0.0625, own + 0.0625)).norm(), 1e-16);
}

// The L has its centre at Σ V r / Σ V; the parts move there and along the principal axes, whose
// products of inertia vanish to 1e-12 of the squared size, as those of hulls. The distance of both
// parts stays.
TEST(CompoundMasses, MovePartsToTheCentreAndThePrincipalAxes) {
  for (const double far : {0.0, 1e3}) {
    Compound::Parts parts = *ell().parts;
    for (ShapePart& part : parts) part.pose.position += Vector3d(far, -far, far);
    World world;
    const BodyId id = world.add_body(make_body("body", Compound(parts), 2.0, {0, 0, 1}));
    const auto& moved = std::get<Compound>(world.body(id).shape);
    const CompoundMass mass = mass_of(moved);
    Eigen::Matrix3d off = mass.unit_inertia;
    off.diagonal().setZero();
    EXPECT_LT(off.norm(), 1e-13);
    EXPECT_LT(mass.centre.norm(), 4e-13);
    EXPECT_EQ(world.state(id).position, Vector3d(0, 0, 1));
    const double apart = ((*moved.parts)[0].pose.position - (*moved.parts)[1].pose.position).norm();
    EXPECT_NEAR(apart, Vector3d(0.15, 0.0, -0.2).norm(), 1e-12 + 1e-15 * far);
    // By hand: halves of 4e-3 and 3e-3 m³, so the centre is (11, 0, 8) cm / 7 from the first end.
    EXPECT_LT((mass_of(ell()).centre - Vector3d(0.95 / 7.0, 0.0, 0.6 / 7.0)).norm(), 1e-15);
  }
}

// A body whose shapes lie where its inertia needs them cannot have the inertia of its shapes.
TEST(CompoundMasses, AreNotThoseOfShapesBesideTheCentre) {
  World world;
  Body body = make_body("body", ell(), 1.0, {0, 0, 1});
  body.inertia = {0.1, 0.2, 0.2};
  const BodyId id = world.add_body(body);
  body.inertia.setZero();
  EXPECT_NE(refusal([&] { world.set_body(id, body); }).find("inertia"), std::string::npos);
  body.inertia = {0.2, 0.2, 0.2};
  EXPECT_EQ(refusal([&] { world.set_body(id, body); }), "");
  EXPECT_EQ(std::get<Compound>(world.body(id).shape).parts->front().pose.position.x(), 0.2);
}

// ---- motion

// A box cut in halves one above the other touches the floor as the whole box does, with equal
// features in equal order, and its inertia differs by rounding alone. Sweeps of time_stepping end
// at a residual of 1e-3 of what a step changes, in the order of the corners.
TEST(Compounds, OfTwoHalvesTumbleAsABox) {
  const Vector3d size(0.2, 0.3, 0.1);
  for (const Method method : kImpulses) {
    for (const bool of_hulls : {false, true}) {
      Body whole = rough_body(Box{size}, 2.0, {0, 0, 0.5});
      whole.state.angular_velocity = {1.0, -0.7, 0.4};
      Body halves = whole;
      halves.shape = cut_box(size, 2, of_hulls);
      World box = world_on_floor(method, whole), compound = world_on_floor(method, halves);
      const BodyId id = box.find_body("body");
      const double tolerance = method == Method::kTimeStepping ? 1e-6 : 1e-9;
      for (int i = 0; i < 600; ++i) {
        ASSERT_FALSE(box.step().outcome.failed);
        ASSERT_FALSE(compound.step().outcome.failed);
        ASSERT_LT((box.state(id).position - compound.state(id).position).norm(), tolerance) << i;
        ASSERT_LT(box.state(id).orientation.angularDistance(compound.state(id).orientation),
                  100.0 * tolerance)
            << i;
      }
    }
  }
}

// Halves side by side have four more corners on the floor, which carry a share of the weight.
// Whichever corners carry it, a sliding box stops after v²/(2 μ g), to the length of a few steps.
TEST(Compounds, OfTwoHalvesSlideAsABox) {
  const double speed = 1.0, friction = 0.5;
  for (const Method method : kImpulses) {
    for (int axis = 0; axis < 2; ++axis) {
      Body body = rough_body(cut_box({0.3, 0.3, 0.1}, axis), 2.0, {0, 0, 0.05});
      body.state.linear_velocity.x() = speed;
      World world = world_on_floor(method, body, friction);
      run(world, 400);
      const BodyState& end = world.state(world.find_body("body"));
      EXPECT_NEAR(end.position.x(), speed * speed / (2.0 * friction * kGravity), 3e-3);
      EXPECT_NEAR(end.position.z(), 0.05, slop(world));
      EXPECT_LT(end.linear_velocity.norm(), 1e-3);
      EXPECT_LT(end.orientation.angularDistance(Quaterniond::Identity()), 1e-3);
    }
  }
}

// On a slope a box tips over its lower edge where the slope is steeper than its width by its
// height, and stands where the slope is flatter.
TEST(Compounds, OfTwoHalvesTipAsABox) {
  const double width = 0.1, height = 0.3;
  for (const Method method : kImpulses) {
    for (const double share : {0.9, 1.1}) {
      const double slope = share * std::atan(width / height);
      Body body = rough_body(cut_box({width, 0.2, height}, 0), 1.0, Vector3d::Zero());
      body.friction = 1.0;
      body.state.orientation = AngleAxisd(slope, Vector3d::UnitY());
      body.state.position = body.state.orientation * Vector3d(0, 0, 0.5 * height);
      World world = world_on_floor(method, body, 1.0, slope);
      run(world, 1000);
      const Quaterniond& q = world.state(world.find_body("body")).orientation;
      const double turned = q.angularDistance(body.state.orientation);
      EXPECT_EQ(turned > 0.5, share > 1.0) << turned;
      if (share < 1.0) {
        EXPECT_LT(turned, 1e-3);
      }
    }
  }
}

// Two equal spheres roll down a slope without slip at a = g sin(s) / (1 + I / (m r²)), with I =
// 2/5 m r² about their line, as a single sphere does; the two roll with a spin about the line.
TEST(Compounds, ADumbbellRollsDownASlope) {
  const double radius = 0.1, slope = 0.2, time = 0.5;
  for (const Method method : kImpulses) {
    Body body = rough_body(dumbbell(radius, 0.6), 2.0, Vector3d::Zero());
    body.friction = 1.0;
    // the line of the spheres lies across the slope
    body.state.orientation =
        AngleAxisd(slope, Vector3d::UnitY()) * AngleAxisd(0.5 * kPi, Vector3d::UnitZ());
    const Quaterniond tilted(AngleAxisd(slope, Vector3d::UnitY()));
    body.state.position = tilted * Vector3d(0, 0, radius);
    World world = world_on_floor(method, body, 1.0, slope);
    run(world, 500);
    const BodyState& end = world.state(world.find_body("body"));
    const double along = (tilted.conjugate() * end.position).x();
    const double a = kGravity * std::sin(slope) / 1.4;
    // a method of first order is off by v h / 2 at the end
    EXPECT_NEAR(along, 0.5 * a * time * time, a * time * 1e-3);
    EXPECT_EQ(world.contacts().size(), 2u);
  }
}

// A beam on two unequal feet: the feet carry m g as the lever says, each foot by its own contact.
TEST(Compounds, ForcesOfPartsAreThoseOfTheLever) {
  for (const Method method : kImpulses) {
    Body body = rough_body(
        Compound({{Sphere{0.1}, {{-0.3, 0.0, 0.0}, Quaterniond::Identity()}},
                  {Capsule{0.1, 0.2},
                   {{0.1, 0.0, 0.0}, Quaterniond(AngleAxisd(0.5 * kPi, Vector3d::UnitX()))}}}),
        2.0, {0, 0, 0.1});
    body.inertia = {0.01, 0.05, 0.05};
    World world = world_on_floor(method, body);
    run(world, 200);
    double loads[2] = {0.0, 0.0};
    for (const Contact& contact : world.contacts())
      loads[world.body(contact.body_a).name == "body" ? contact.part_a : contact.part_b] +=
          contact.normal_force;
    const double weight = 2.0 * kGravity;
    EXPECT_NEAR(loads[0], 0.25 * weight, 2e-3 * weight);
    EXPECT_NEAR(loads[1], 0.75 * weight, 2e-3 * weight);
  }
}

// Bodies that are welded move as one compound, as far as impulses hold the weld: the error of a
// weld is of the order of the fall of a step.
TEST(Compounds, MoveAsWeldedBodies) {
  WorldOptions options = step_options(Method::kTimeStepping);
  World welded(options), whole(options);
  welded.add_body(make_floor(0.5));
  whole.add_body(make_floor(0.5));
  Body body = rough_body(ell(), 2.0, {0, 0, 0.4});
  const BodyId id = whole.add_body(body);
  const auto& parts = *std::get<Compound>(whole.body(id).shape).parts;
  std::vector<BodyId> ids;
  for (const ShapePart& part : parts) {
    Body alone = rough_body(part.shape, 2.0 * volume(part.shape) / volume(whole.body(id).shape),
                            body.state.position + part.pose.position);
    alone.name = "part" + std::to_string(ids.size());
    alone.state.orientation = part.pose.orientation;
    ids.push_back(welded.add_body(alone));
  }
  Joint weld = make_joint(
      "weld", ids[0], Vector3d::Zero(), ids[1],
      parts[1].pose.orientation.conjugate() * (parts[0].pose.position - parts[1].pose.position));
  weld.kind = JointKind::kWeld;
  weld.frame_b = parts[1].pose.orientation.conjugate() * parts[0].pose.orientation;
  welded.add_joint(weld);
  const auto& first = parts[0].pose;
  for (int i = 0; i < 600; ++i) {
    ASSERT_FALSE(welded.step().outcome.failed);
    ASSERT_FALSE(whole.step().outcome.failed);
    const BodyState& state = whole.state(id);
    ASSERT_LT((welded.state(ids[0]).position - state.position - state.orientation * first.position)
                  .norm(),
              2e-3)
        << i;
  }
}

// A mirror image of the order of parts changes the order of rows alone, which converge to one
// solution; a scene that is moved by 1 km and turned about z moves alike, to the rounding of
// positions there that an impact magnifies.
TEST(Compounds, DoNotDependOnOrderOrPlace) {
  const auto end_of = [](bool is_reversed, const Vector3d& offset, double turn) {
    Compound::Parts parts = *ell().parts;
    if (is_reversed) std::reverse(parts.begin(), parts.end());
    WorldOptions options = step_options(Method::kTimeStepping);
    World world(options);
    Body floor = make_floor(0.5);
    floor.state.position = offset;
    world.add_body(floor);
    const Quaterniond q(AngleAxisd(turn, Vector3d::UnitZ()));
    Body body = rough_body(Compound(parts), 2.0, offset + Vector3d(0, 0, 0.4));
    body.state.orientation = q;
    body.state.linear_velocity = q * Vector3d(0.5, 0.2, 0.0);
    const BodyId id = world.add_body(body);
    run(world, 400);
    return Vector3d(q.conjugate() * (world.state(id).position - offset));
  };
  const Vector3d plain = end_of(false, Vector3d::Zero(), 0.0);
  EXPECT_LT((end_of(true, Vector3d::Zero(), 0.0) - plain).norm(), 1e-4);
  EXPECT_LT((end_of(false, {1e3, -1e3, 0.0}, 0.0) - plain).norm(), 1e-4);
  EXPECT_LT((end_of(false, Vector3d::Zero(), 0.7) - plain).norm(), 1e-4);
}

// ---- contacts

// A ball that touches the floor of a trough and flies at its thin wall: the wall is another part of
// the body that the ball touches already.
TEST(CompoundContacts, AFastBallInContactDoesNotPassAWall) {
  for (const Method method : {Method::kSequentialImpulses, Method::kTimeStepping, Method::kAuto}) {
    World world(step_options(method, 0.01));
    Body trough =
        make_body("trough",
                  Compound({{Box{{4.0, 1.0, 0.2}}, {{0, 0, -0.1}, Quaterniond::Identity()}},
                            {Box{{0.01, 1.0, 1.0}}, {{1.0, 0, 0.5}, Quaterniond::Identity()}}}),
                  0.0, {0, 0, 0});
    trough.type = BodyType::kStatic;
    world.add_body(trough);
    Body ball = make_body("ball", Sphere{0.05}, 1.0, {0, 0, 0.05});
    ball.state.linear_velocity = {40.0, 0.0, 0.0};  // 0.4 m a step
    const BodyId id = world.add_body(ball);
    run(world, 50);
    EXPECT_LT(world.state(id).position.x(), 0.95) << name(method);
  }
}

TEST(CompoundContacts, AFastCompoundDoesNotPassAWall) {
  for (const Method method : kImpulses) {
    World world(step_options(method, 0.01));
    Body wall = make_body("wall", Box{{0.01, 4.0, 4.0}}, 0.0, {1.0, 0, 0});
    wall.type = BodyType::kStatic;
    world.add_body(wall);
    Body body = make_body("body", dumbbell(0.05, 0.4), 1.0, {0, 0, 0});
    body.state.linear_velocity = {60.0, 0.0, 0.0};
    body.state.angular_velocity = {0.0, 0.0, 20.0};
    const BodyId id = world.add_body(body);
    run(world, 30);
    EXPECT_LT(world.state(id).position.x(), 1.0);
  }
}

TEST(CompoundContacts, RestOnEachOtherAndFallAsleep) {
  for (const Method method : kImpulses) {
    WorldOptions options = step_options(method, 0.005);
    options.sleep_after = 0.5;
    World world(options);
    world.add_body(make_floor(0.6));
    for (int i = 0; i < 3; ++i) {
      Body body = rough_body(cut_box({0.4, 0.4, 0.2}, i % 2, i == 1), 1.0, {0, 0, 0.1 + 0.2 * i});
      body.name = "body" + std::to_string(i);
      world.add_body(body);
    }
    run(world, 600);
    EXPECT_EQ(world.report().costs.asleep, 3u);
    const BodyId top = world.find_body("body2");
    EXPECT_NEAR(world.state(top).position.z(), 0.5, 3.0 * slop(world));
    Body ball = make_body("ball", Sphere{0.1}, 1.0, {0, 0, 0.9});
    world.add_body(ball);
    run(world, 100);
    EXPECT_EQ(world.report().costs.asleep, 0u);  // the ball has landed on the pile
    EXPECT_GT(world.state(world.find_body("ball")).position.z(), 0.65);
  }
}

TEST(CompoundContacts, FollowGroupsAndJoints) {
  Body body = rough_body(dumbbell(0.1, 0.4), 1.0, {0, 0, 0.1});
  body.collision_mask = 2;
  World world = world_on_floor(Method::kTimeStepping, body);
  run(world, 100);
  EXPECT_TRUE(world.contacts().empty());
  EXPECT_NEAR(world.state(world.find_body("body")).position.z(), 0.1 - 0.5 * kGravity * 0.01,
              kGravity * 1e-4);
}

// Contacts take energy away: friction and inelastic impacts. A step of first order changes it by
// (m g h v) at most; the bound is that of the tests of impulses.
TEST(CompoundContacts, NeverRaiseEnergy) {
  Random random;
  for (int scene = 0; scene < 20 / std::min(kSanitizedShare, 5); ++scene) {
    WorldOptions options = step_options(Method::kSequentialImpulses, 0.002);
    options.sleep_after = kInfinity;
    World world(options);
    world.add_body(make_floor(0.3));
    for (int i = 0; i < 4; ++i) {
      Body body =
          rough_body(mixed_parts(&random), 1.0 + i, {0.3 * i, 0.1 * random(), 0.8 + 0.8 * i});
      body.name = "body" + std::to_string(i);
      body.state.orientation = random.orientation();
      body.state.angular_velocity = random.vector();
      world.add_body(body);
    }
    double before = energy(world);
    for (int i = 0; i < 1000; ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      const double now = energy(world) - world.report().energy.correction_work;
      ASSERT_LT(now, before + 1e-9 * std::abs(before)) << "scene " << scene << ", step " << i;
      before = energy(world);
      ASSERT_EQ(world.report().energy.rise, 0.0);
    }
  }
}

// ---- queries

TEST(CompoundQueries, RaysAndClosestPointsAreThoseOfTheNearestPart) {
  Random random;
  for (int i = 0; i < 100; ++i) {
    Body body = make_body("body", mixed_parts(&random), 0.0, 0.5 * random.vector());
    body.type = BodyType::kKinematic;
    body.state.orientation = random.orientation();
    Body other = make_body("other", mixed_parts(&random), 0.0, 2.0 * random.vector());
    other.type = BodyType::kKinematic;
    World world, alone;
    const BodyId id = world.add_body(body);
    const BodyId other_id = world.add_body(other);
    std::vector<BodyId> parts, other_parts;
    for (Body part : parts_alone(std::get<Compound>(world.body(id).shape), body.state))
      parts.push_back(alone.add_body(part));
    for (Body part : parts_alone(std::get<Compound>(world.body(other_id).shape), other.state)) {
      part.name = "other" + part.name;
      other_parts.push_back(alone.add_body(part));
    }
    Ray ray;
    ray.origin = 2.0 * random.vector();
    ray.direction = 0.4 * random.vector() - ray.origin;
    const auto hit = cast_ray(world, ray), part_hit = cast_ray(alone, ray);
    ASSERT_EQ(hit.has_value(), part_hit.has_value());
    if (hit) {
      EXPECT_NEAR(hit->distance, part_hit->distance, 1e-14);
      EXPECT_LT((hit->normal - part_hit->normal).norm(), 1e-12);
    }
    double least = kInfinity;
    for (const BodyId a : parts)
      for (const BodyId b : other_parts)
        least = std::min(least, closest_points(alone, a, b).distance);
    const ClosestPoints nearest = closest_points(world, id, other_id);
    EXPECT_NEAR(nearest.distance, least, 1e-12);
    if (least > 0.0) {
      EXPECT_LT((nearest.p_a - nearest.p_b - nearest.distance * nearest.normal).norm(), 1e-8);
    }
    const Vector3d min = random.vector(), max = min + Vector3d::Constant(0.2);
    const std::vector<BodyId> in = bodies_in(alone, min, max);
    const bool is_in = std::any_of(in.begin(), in.end(), [&](BodyId found) {
      return std::find(parts.begin(), parts.end(), found) != parts.end();
    });
    const std::vector<BodyId> found = bodies_in(world, min, max);
    EXPECT_EQ(std::find(found.begin(), found.end(), id) != found.end(), is_in);
  }
}

// ---- memory

World heap(int threads, Method method = Method::kAuto) {
  Random random;
  WorldOptions options = step_options(method, 0.005);
  options.threads = threads;
  World world(options);
  world.add_body(make_floor(0.5));
  for (int i = 0; i < 6; ++i) {
    Body body = rough_body(i % 2 == 0 ? mixed_parts(&random) : ell(), 1.0 + i,
                           {0.4 * (i % 3), 0.1 * random(), 0.6 + 0.5 * i});
    body.name = "body" + std::to_string(i);
    body.state.orientation = random.orientation();
    world.add_body(body);
  }
  return world;
}

// Scenes hold all that impulses go on from; methods that choose their substeps go on from more,
// which snapshots hold.
TEST(CompoundMemory, IsSavedToTheBitAtEachTick) {
  for (const Method method : {Method::kSequentialImpulses, Method::kTimeStepping, Method::kAuto}) {
    World world = heap(1, method);
    for (int i = 0; i < 200; ++i) {
      run(world, 1);
      std::vector<World> copies;
      copies.push_back(read_snapshot(write_snapshot(world)));
      if (method == Method::kSequentialImpulses) copies.push_back(load_scene(save_scene(world)));
      for (World& copy : copies) {
        ASSERT_EQ(copy.state_hash(), world.state_hash()) << i;
        if (i % 20 != 0) continue;
        World next = world;
        run(next, 10);
        run(copy, 10);
        ASSERT_EQ(copy.state_hash(), next.state_hash()) << i;
      }
    }
    EXPECT_FALSE(world.contacts().empty());
  }
}

TEST(CompoundMemory, DoesNotDependOnThreads) {
  World one = heap(1);
  run(one, 300);
  for (const int threads : {2, 4}) {
    World several = heap(threads);
    run(several, 300);
    EXPECT_EQ(several.state_hash(), one.state_hash()) << threads;
  }
}

TEST(CompoundMemory, HashesOfOtherPartsDiffer) {
  const auto hash_of = [](const Compound& compound) {
    World world;
    Body body = make_body("body", compound, 1.0, {0, 0, 1});
    body.inertia = {1, 1, 1};
    world.add_body(body);
    return world.state_hash();
  };
  EXPECT_NE(hash_of(dumbbell(0.1, 0.4)), hash_of(dumbbell(0.1, 0.5)));
  EXPECT_NE(hash_of(dumbbell(0.1, 0.4)), hash_of(dumbbell(0.2, 0.4)));
  EXPECT_EQ(hash_of(dumbbell(0.1, 0.4)), hash_of(dumbbell(0.1, 0.4)));
}

// ---- scenes and rejections

TEST(CompoundScenes, ReadListsOfShapes) {
  const World world = load_scene(R"(
bodies:
  - name: table
    mass: 1
    shapes:
      - {shape: {box: {size: [1, 1, 0.1]}}}
      - {shape: {capsule: {radius: 0.05, length: 0.4}}, shape_pose: {position: [0, 0, -0.3]}}
)");
  const Body& body = world.body(world.find_body("table"));
  const auto& parts = *std::get<Compound>(body.shape).parts;
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_NEAR(parts[0].pose.position.z() - parts[1].pose.position.z(), 0.3, 1e-15);
}

std::string scene_refusal(const std::string& body) {
  return refusal([&] { load_scene("bodies: [{name: b, type: static, " + body + "}]"); });
}

TEST(CompoundScenes, RejectWhatTheyCannotBe) {
  const std::string sphere = "{shape: {sphere: {radius: 1}}}";
  for (const auto& [body, part] : {
           std::pair<std::string, std::string>{
               "shape: {sphere: {radius: 1}}, shapes: [" + sphere + "]", "already"},
           {"shapes: []", "at least one part"},
           {"shapes: [{shape: {plane: {}}}]", "shapes[0].shape: a part must be"},
           {"shapes: [" + sphere + ", {shape: {point: {}}}]", "shapes[1].shape: a part must be"},
           {"shapes: [{shape: {sphere: {radius: -1}}}]", "radius"},
           {"shapes: [{shape: {compound: {}}}]", "list 'shapes'"},
           {"shape: {compound: {shapes: []}}", "list 'shapes'"},
           {"shapes: [" + sphere + "], shape_pose: {position: [1, 0, 0]}", "each of several"},
           {"shapes: [{shape: {sphere: {radius: 1}}, shape_pose: {orientation: [1, 1, 0, 0]}}]",
            "unit quaternion"},
           {"shapes: [{sphere: {radius: 1}}]", "sphere"},
       })
    EXPECT_NE(scene_refusal(body).find(part), std::string::npos)
        << body << ": " << scene_refusal(body);
  EXPECT_NE(refusal([] { Compound(Compound::Parts{}); }).find("shapes"), std::string::npos);
  EXPECT_NE(refusal([] {
              Compound({{Compound(dumbbell(0.1, 0.4)), {}}});
            }).find("shapes[0].shape"),
            std::string::npos);
  EXPECT_NE(refusal([] {
              World().add_body(make_body("body", Compound{}, 1.0, Vector3d::Zero()));
            }).find("at least one"),
            std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::engine
