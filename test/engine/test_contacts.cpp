// Bodies that press on, bounce off, slide and roll on each other.

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

double total_normal_force(const World& world) {
  double sum = 0.0;
  for (const Contact& contact : world.contacts()) sum += contact.normal_force;
  return sum;
}

// ---- reported

// A point is reported once its gap is closed, though its row is there before.
TEST(Reported, ContactsAreThoseThatTouched) {
  for (const Method method : {Method::kTimeStepping, Method::kSequentialImpulses}) {
    WorldOptions chosen = options(0.01);
    chosen.method = method;
    chosen.gravity = Vector3d::Zero();
    World world(chosen);
    world.add_body(make_floor(0.5));
    const double gap = 4e-4;
    const BodyId ball = world.add_body(make_body("ball", Sphere{0.2}, 3.0, {0.0, 0.0, 0.2 + gap}));
    run(world, 3);
    EXPECT_TRUE(world.contacts().empty());
    BodyState state = world.state(ball);
    state.linear_velocity.z() = -0.01;  // closes the gap in 4 steps
    world.set_state(ball, state);
    int steps = 0;
    while (world.contacts().empty() && steps < 10) world.step(), ++steps;
    EXPECT_GE(steps, 4) << name(method);
    EXPECT_LE(steps, 6) << name(method);
    ASSERT_EQ(world.contacts().size(), 1u);
    EXPECT_GT(world.contacts()[0].normal_force, 0.0);
  }
}

// ---- at rest

TEST(Resting, BallOnAPlane) {
  World world(options(0.01));
  world.add_body(make_floor(0.5));
  Body body = make_body("ball", Sphere{0.2}, 3.0, {0.0, 0.0, 0.2});
  body.friction = 0.5;
  const BodyId ball = world.add_body(body);
  run(world, 10);
  for (int step = 0; step < 1000; ++step) {
    world.step();
    ASSERT_EQ(world.contacts().size(), 1u);
    // a single row is solved exactly: rounding of h·force over h
    ASSERT_NEAR(world.contacts()[0].normal_force, 3.0 * kGravity, 1e-10);
    ASSERT_GT(world.contacts()[0].depth, 0.0);
    ASSERT_LT(world.contacts()[0].depth, slop(world) * (1.0 + 1e-9));
  }
  EXPECT_EQ(world.contacts()[0].normal.z(), world.contacts()[0].body_a == ball ? 1.0 : -1.0);
  EXPECT_EQ(world.state(ball).position.x(), 0.0);
  EXPECT_EQ(world.report().contacts.max_penetration, world.contacts()[0].depth);
}

TEST(Resting, BoxOnBoxOnAPlane) {
  World world(options(0.01));
  world.add_body(make_floor(0.5));
  Body lower = make_body("lower", Box{{1.0, 1.0, 0.5}}, 4.0, {0.0, 0.0, 0.25});
  Body upper = make_body("upper", Box{{0.8, 0.8, 0.5}}, 2.0, {0.05, -0.05, 0.75});
  lower.friction = upper.friction = 0.5;
  const BodyId id_lower = world.add_body(lower);
  const BodyId id_upper = world.add_body(upper);
  run(world, 500);
  // Each interface sinks by at most the slop, and a tenth of it for the share that ten sweeps leave
  // unsolved.
  EXPECT_NEAR(world.state(id_lower).position.z(), 0.25, 1.1 * slop(world));
  EXPECT_NEAR(world.state(id_upper).position.z(), 0.75, 2.2 * slop(world));
  EXPECT_LT(world.state(id_upper).position.z(), 0.75);
  double on_floor = 0.0;
  for (const Contact& contact : world.contacts())
    if (contact.body_a != id_upper && contact.body_b != id_upper) on_floor += contact.normal_force;
  // warm-started sweeps converge to 1 % of the weights after 5 s
  EXPECT_NEAR(on_floor, 6.0 * kGravity, 0.06 * kGravity);
  EXPECT_NEAR(total_normal_force(world) - on_floor, 2.0 * kGravity, 0.06 * kGravity);
  EXPECT_LT(world.state(id_upper).linear_velocity.norm(), 1e-3);
  EXPECT_LT((world.state(id_upper).position - upper.state.position).head<2>().norm(), 1e-4);
}

// ---- bouncing

/// Returns the height to which a ball dropped by 1 m rebounds [m].
double bounce_height(double restitution, double h) {
  World world(options(h));
  world.add_body(make_floor(0.0));
  Body body = make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, 1.1});
  body.restitution = restitution;
  const BodyId ball = world.add_body(body);
  while (world.state(ball).linear_velocity.z() <= 0.0) world.step();
  while (world.state(ball).linear_velocity.z() > 0.0) world.step();
  return world.state(ball).position.z() - 0.1;
}

// Speeds are accurate to g h, the place of the impact to v h, with v = 4.43 m/s.
TEST(Bouncing, HeightIsRestitutionSquared) {
  const double h = 1e-3;
  const double v = std::sqrt(2.0 * kGravity);
  for (const double e : {0.3, 0.5, 0.8, 1.0})
    EXPECT_NEAR(bounce_height(e, h), e * e, (1.0 + e) * v * h) << e;
}

TEST(Bouncing, HeightConvergesToRestitutionSquared) {
  const double v = std::sqrt(2.0 * kGravity);
  for (const double h : {1e-3, 1e-4, 1e-5})
    EXPECT_NEAR(bounce_height(0.7, h), 0.49, 1.7 * v * h) << h;
}

TEST(Bouncing, WithoutRestitutionItStays) {
  WorldOptions awake = options(0.01);
  awake.sleep_after = kInfinity;  // sinks in by ever less
  World world(awake);
  world.add_body(make_floor(0.0));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, 0.5}));
  double highest_after_impact = 0.0;
  bool touched = false;
  for (int step = 0; step < 500; ++step) {
    touched = world.step().contacts.points > 0 || touched;
    if (touched)
      highest_after_impact = std::max(highest_after_impact, world.state(ball).position.z());
  }
  // The overlap of a step at 2.8 m/s makes the ball rebound with β of the overlap per step: 0.28
  // m/s, hence at most v²/2g above the floor.
  EXPECT_LT(highest_after_impact, 0.1 + 0.28 * 0.28 / (2.0 * kGravity));
  EXPECT_NEAR(world.state(ball).position.z(), 0.1, slop(world) * (1.0 + 1e-9));
}

/// Two weightless spheres about to collide.
struct Meeting {
  World world{weightless(0.001)};
  BodyId a, b;

  Meeting(double offset, double friction, double restitution) {
    Body left = make_body("left", Sphere{0.5}, 1.0, {-1.0, 0.0, 0.0});
    Body right = make_body("right", Sphere{0.5}, 1.0, {1.0, offset, 0.0});
    left.state.linear_velocity.x() = 2.0;
    left.state.angular_velocity = {0.0, 3.0, 7.0};
    for (Body* body : {&left, &right}) {
      body->friction = friction;
      body->restitution = restitution;
    }
    a = world.add_body(left);
    b = world.add_body(right);
  }
};

TEST(Collision, OfEqualBallsExchangesVelocities) {
  Meeting meeting(0.0, 0.0, 1.0);
  run(meeting.world, 1500);
  EXPECT_LT((meeting.world.state(meeting.a).linear_velocity).norm(), 1e-12);
  EXPECT_LT((meeting.world.state(meeting.b).linear_velocity - Vector3d(2.0, 0.0, 0.0)).norm(),
            1e-12);
}

// Both forces of a contact act at one point, so momenta are kept to the rounding of each step.
TEST(Collision, WithFrictionKeepsMomenta) {
  Meeting meeting(0.6, 0.5, 0.4);
  const Vector3d p = momentum(meeting.world);
  const Vector3d L = angular_momentum(meeting.world);
  const double spin = meeting.world.state(meeting.b).angular_velocity.norm();
  run(meeting.world, 2000);
  EXPECT_GT(meeting.world.state(meeting.b).angular_velocity.norm(), spin + 0.1);  // friction acted
  EXPECT_LT((momentum(meeting.world) - p).norm(), 2000 * 4 * kEpsilon);
  EXPECT_LT((angular_momentum(meeting.world) - L).norm(), 2000 * 16 * kEpsilon);
}

TEST(Collision, PairHasMeanFrictionAndTheLargerRestitution) {
  World world(options(0.001));
  Body floor = make_floor(0.1);
  floor.restitution = 0.9;
  world.add_body(floor);
  Body body = make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, 0.11});
  body.friction = 0.4;
  body.restitution = 0.2;
  body.state.linear_velocity = {5.0, 0.0, -2.0};
  const BodyId ball = world.add_body(body);
  while (world.state(ball).linear_velocity.z() < 0.0) world.step();
  const BodyState& state = world.state(ball);
  // the impulse also stops gravity of the step
  EXPECT_NEAR(state.linear_velocity.z(), 0.9 * 2.0, 0.9 * 10 * kGravity * 1e-3);
  const double normal = state.linear_velocity.z() + 2.0;
  EXPECT_NEAR(state.linear_velocity.x(), 5.0 - 0.2 * normal, 0.2 * 10 * kGravity * 1e-3);
}

// ---- sliding and rolling

constexpr double kSlope = kPi / 6.0;  // tan = 0.577

/// A flat box on an incline, as deep in it as at rest.
struct Incline {
  World world{options(0.01)};
  BodyId box;
  Vector3d start;
  Vector3d downhill{std::cos(kSlope), 0.0, -std::sin(kSlope)};

  explicit Incline(double friction) {
    world.add_body(make_floor(friction, kSlope));
    Body body = make_body("box", Box{{1.0, 1.0, 0.2}}, 3.0, Vector3d::Zero());
    body.friction = friction;
    body.state.orientation = Eigen::AngleAxisd(kSlope, Vector3d::UnitY());
    body.state.position = body.state.orientation * Vector3d(0.0, 0.0, 0.1 - 0.5 * slop(world));
    start = body.state.position;
    box = world.add_body(body);
  }

  double displacement() const { return downhill.dot(world.state(box).position - start); }
};

TEST(Incline, SteeperThanFrictionAllowsSlidesByTheClosedForm) {
  const double friction = 0.3;
  Incline incline(friction);
  const double a = kGravity * (std::sin(kSlope) - friction * std::cos(kSlope));
  for (int step = 1; step <= 200; ++step) {
    incline.world.step();
    const double t = incline.world.time();
    // Velocities before positions give ½ a t (t + h); the first, cold-started sweeps may lose a
    // fifth of a step's speed.
    ASSERT_NEAR(incline.displacement(), 0.5 * a * t * (t + 0.01), 0.2 * a * 0.01 * t) << t;
  }
  EXPECT_NEAR(incline.downhill.dot(incline.world.state(incline.box).linear_velocity), 2.0 * a,
              0.2 * a * 0.01);
}

TEST(Incline, WithinFrictionStaysPut) {
  Incline incline(0.7);
  run(incline.world, 1000);
  // Without friction the box would slide 245 m; residuals of the sweeps must not accumulate.
  EXPECT_LT((incline.world.state(incline.box).position - incline.start).norm(),
            slop(incline.world));
  EXPECT_LT(incline.world.state(incline.box).linear_velocity.norm(), 1e-6);
  EXPECT_NEAR(total_normal_force(incline.world), 3.0 * kGravity * std::cos(kSlope), 0.01);
  // friction carries the rest of the weight, within the sweeps' residual
  const Vector3d force = contact_force_on(incline.world, incline.box);
  EXPECT_LT((force - Vector3d(0.0, 0.0, 3.0 * kGravity)).norm(), 0.01);
  for (const Contact& contact : incline.world.contacts())
    EXPECT_EQ(contact.state, ContactState::kSticking);
}

// Angular momentum about the line of contact is kept: m r v₀ = (m r² + ⅖ m r²) v/r. The contact is
// nearer to the centre than r by up to the slop, which changes v by 4/7 of their ratio.
TEST(Rolling, SlidingSphereEndsAtFiveSeventhsOfItsSpeed) {
  World world(options(0.01));
  world.add_body(make_floor(0.3));
  Body body = make_body("ball", Sphere{0.5}, 2.0, {0.0, 0.0, 0.5});
  body.friction = 0.3;
  body.state.linear_velocity.x() = 7.0;
  const BodyId ball = world.add_body(body);
  run(world, 100);  // slides for 2 v₀/(7 μ g) = 0.68 s
  const BodyState state = world.state(ball);
  EXPECT_NEAR(state.linear_velocity.x(), 5.0, 7.0 * 4.0 / 7.0 * slop(world) / 0.5);
  EXPECT_NEAR(state.angular_velocity.y() * 0.5, state.linear_velocity.x(), 7.0 * slop(world) / 0.5);
  run(world, 100);  // the ball rolls from now on
  EXPECT_NEAR(world.state(ball).linear_velocity.x(), state.linear_velocity.x(), 1e-9);
}

TEST(Sliding, FrictionSlowsByMuG) {
  World world(options(0.01));
  world.add_body(make_floor(0.3));
  Body body = make_body("box", Box{{1.0, 1.0, 0.2}}, 3.0, {0.0, 0.0, 0.1});
  body.friction = 0.3;
  body.state.position.z() -= 0.5 * slop(world);
  body.state.linear_velocity = {3.0, 4.0, 0.0};
  const BodyId box = world.add_body(body);
  run(world, 100);
  // friction is isotropic: along the velocity, not along the tangents
  const Vector3d expected = Vector3d(0.6, 0.8, 0.0) * (5.0 - 0.3 * kGravity);
  // warm-started sweeps leave less than a hundredth of a step's deceleration
  EXPECT_LT((world.state(box).linear_velocity - expected).norm(), 0.01 * 0.3 * kGravity * 0.01);
  EXPECT_LT(world.state(box).angular_velocity.norm(), 1e-3);
  ASSERT_FALSE(world.contacts().empty());
  for (const Contact& contact : world.contacts()) {
    EXPECT_EQ(contact.state, ContactState::kSlipping);
    const Vector3d friction = contact.force - contact.normal_force * contact.normal;
    // at Coulomb's limit to rounding, opposite to the slip within the sweeps' residual
    const Vector3d on_box = contact.body_a == box ? friction : Vector3d(-friction);
    EXPECT_NEAR(friction.norm(), 0.3 * contact.normal_force, 1e-9 * contact.normal_force);
    EXPECT_LT(on_box.normalized().dot(Vector3d(0.6, 0.8, 0.0)), -0.999);
  }
}

// ---- rows, and pairs that collide

TEST(Rows, OfAFrictionlessContactIsOneAndOtherwiseThree) {
  for (const double friction : {0.0, 0.5}) {
    World world(options(0.01));
    world.add_body(make_floor(0.5));
    Body ball = make_body("ball", Sphere{0.2}, 3.0, {0.0, 0.0, 0.199});
    ball.friction = friction;
    world.add_body(ball);
    EXPECT_EQ(world.step().costs.rows, friction == 0.0 ? 1u : 3u);
    EXPECT_EQ(world.report().contacts.points, 1u);
    Body box = make_body("box", Box{{1.0, 1.0, 1.0}}, 3.0, {5.0, 0.0, 0.499});
    box.friction = friction;
    world.add_body(box);
    EXPECT_EQ(world.step().costs.rows, friction == 0.0 ? 5u : 15u);
    EXPECT_EQ(world.report().contacts.points, 5u);
  }
}

TEST(Rows, BodiesThatCannotTouchAreNotTested) {
  World world(options(0.01));
  world.add_body(make_body("point", Point{}, 1.0, Vector3d::Zero()));
  world.add_body(make_body("other", Point{}, 1.0, Vector3d::Zero()));
  Body ghost = make_body("ghost", Sphere{1.0}, 1.0, Vector3d::Zero());
  ghost.no_collision = true;
  world.add_body(ghost);
  world.add_body(make_body("lonely", Sphere{1.0}, 1.0, Vector3d::Zero()));
  EXPECT_EQ(world.step().costs.candidate_pairs, 0u);
  EXPECT_EQ(world.report().contacts.points, 0u);
}

TEST(NoCollision, FallsThroughTheFloor) {
  World world(options(0.01));
  world.add_body(make_floor(0.5));
  Body ball = make_body("ball", Sphere{0.2}, 3.0, {0.0, 0.0, 0.3});
  ball.no_collision = true;
  const BodyId id = world.add_body(ball);
  world.add_body(make_body("other", Sphere{0.2}, 3.0, {5.0, 0.0, 0.3}));
  run(world, 100);
  EXPECT_NEAR(world.state(id).position.z(), 0.3 - kGravity * 1e-4 * 5050.0, 1e-12);
}

TEST(Joined, BodiesCollideOnlyWhenAskedTo) {
  for (const bool collide : {false, true}) {
    World world(weightless(0.01));
    const BodyId a = world.add_body(make_body("a", Sphere{0.5}, 1.0, {0.0, 0.0, 0.0}));
    const BodyId b = world.add_body(make_body("b", Sphere{0.5}, 1.0, {0.9, 0.0, 0.0}));
    Joint joint = make_joint("rod", a, Vector3d::Zero(), b, Vector3d::Zero());
    joint.collide_connected = collide;
    const JointId id = world.add_joint(joint);
    EXPECT_EQ(world.step().contacts.points, collide ? 1u : 0u);
    world.remove_joint(id);
    EXPECT_EQ(world.step().contacts.points, 1u);
  }
}

TEST(Kinematic, ConveyorCarriesABox) {
  World world(options(0.01));
  Body belt = make_floor(0.5);
  belt.type = BodyType::kKinematic;
  belt.state.linear_velocity.x() = 1.0;
  world.add_body(belt);
  Body box = make_body("box", Box{{0.4, 0.4, 0.2}}, 1.0, {0.0, 0.0, 0.1});
  box.friction = 0.5;
  const BodyId id = world.add_body(box);
  run(world, 300);
  EXPECT_NEAR(world.state(id).linear_velocity.x(), 1.0, 1e-6);
}

TEST(Rows, AreThreeForAContactWithFrictionAndOneWithout) {
  for (const double friction : {0.0, 0.5}) {
    World world(options(0.01));
    world.add_body(make_floor(friction));
    Body ball = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.0999});
    ball.friction = friction;
    world.add_body(ball);
    const StepReport& report = world.step();
    EXPECT_EQ(report.contacts.points, 1u);
    EXPECT_EQ(report.costs.rows, friction == 0.0 ? 1u : 3u);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
