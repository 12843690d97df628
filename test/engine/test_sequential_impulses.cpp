// Sequential impulses: the order, conserved quantities, and states that must not change.

#include "engine/constraints/contact.h"
#include "engine/impulses/row_solver.h"
#include "engine/math/list.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// ---- the pendulum: 1 m, g = 9.81, released from the horizontal (-1, 0) at rest

constexpr double kPeriod = 2.36784194757623745;  // elliptic integral [s]
const Vector3d kPendulumAt10s(-0.27508746257611686, 0.0, -0.961419205099125064);

double error_at_10s(World world, BodyId bob, double length) {
  run(world, static_cast<int>(std::lround(10.0 / world.options().time_step)));
  return (world.state(bob).position - length * kPendulumAt10s).norm();
}

double rod_pendulum_error(double h, double beta) {
  WorldOptions chosen = options(h);
  chosen.baumgarte = beta;
  World world(chosen);
  const BodyId bob = world.add_body(make_body("bob", Point{}, 1.0, {-1.0, 0.0, 0.0}));
  world.add_joint(hang("rod", bob));
  return error_at_10s(world, bob, 1.0);
}

// A ball pendulum: m r² + I over m r is 1 m for r = ½ m, m = 1 kg, I = ¼ kg m²: the same motion at
// half the size.
double ball_pendulum_error(double h, double beta) {
  WorldOptions chosen = options(h);
  chosen.baumgarte = beta;
  World world(chosen);
  Body body = make_body("body", Point{}, 1.0, {-0.5, 0.0, 0.0});
  body.inertia = {0.25, 0.25, 0.25};
  const BodyId bob = world.add_body(body);
  world.add_joint(make_joint("ball", kWorldBody, Vector3d::Zero(), bob, {0.5, 0.0, 0.0}));
  return error_at_10s(world, bob, 0.5);
}

using ErrorOf = double (*)(double h, double beta);

// Expects order one; with β = 1 the next order is 2 % of the first.
void expect_order_one(ErrorOf error) {
  const List<double> steps{1.0 / 2000.0, 1.0 / 4000.0, 1.0 / 8000.0, 1.0 / 16000.0};
  List<double> errors;
  for (const double h : steps) errors.push_back(error(h, 1.0));
  EXPECT_NEAR(order(steps, errors), 1.0, 0.03);
  EXPECT_LT(errors.back(), 2e-4);
}

// Expects order one in the limit. With β = 0.1 the rod's error is ten times as large, of second
// order and opposite sign: both terms are equal at 1/1500 s, and the first dominates well below.
void expect_order_one_in_the_end(ErrorOf error) {
  const List<double> steps{1.0 / 16000.0, 1.0 / 32000.0, 1.0 / 64000.0};
  List<double> errors;
  for (const double h : steps) errors.push_back(error(h, 0.1));
  EXPECT_NEAR(order(steps, errors), 1.0, 0.05);
  EXPECT_LT(errors.back(), 5e-5);
}

TEST(Pendulum, OnARodHasOrderOne) {
  expect_order_one(rod_pendulum_error);
  expect_order_one_in_the_end(rod_pendulum_error);
}

TEST(Pendulum, OnABallJointHasOrderOne) { expect_order_one(ball_pendulum_error); }

// The bob returns to its start, at rest, after a period, at the time of its highest point.
TEST(Pendulum, Period) {
  const double h = 1e-4;
  World world(options(h));
  const BodyId bob = world.add_body(make_body("bob", Point{}, 1.0, {-1.0, 0.0, 0.0}));
  world.add_joint(hang("rod", bob));
  run(world, static_cast<int>(0.85 * kPeriod / h));
  while (world.state(bob).linear_velocity.z() > 0.0) world.step();
  EXPECT_NEAR(world.time(), kPeriod, 10.0 * h);  // order one
}

TEST(Pendulum, TensionAtRestIsTheWeight) {
  World world(options(0.01));
  const BodyId bob = world.add_body(make_body("bob", Point{}, 2.0, {0.0, 0.0, -1.0}));
  const JointId joint = world.add_joint(hang("rod", bob));
  run(world, 100);
  EXPECT_NEAR(world.joint_state(joint).force, -2.0 * kGravity, 1e-9);
  EXPECT_NEAR(world.report().joints.max_error, 0.0, 1e-12);
}

// ---- conserved quantities

struct FreePair {
  World world;

  explicit FreePair(const JointType& type) : world(weightless(0.01)) {
    Random random;
    Body a = make_body("a", Box{{0.3, 0.5, 0.9}}, 2.0, {-0.6, 0.1, 0.0});
    Body b = make_body("b", Box{{0.8, 0.2, 0.4}}, 5.0, {0.5, -0.2, 0.3});
    for (Body* body : {&a, &b}) {
      body->state.orientation = random.orientation();
      body->state.linear_velocity = random.vector();
      body->state.angular_velocity = 3.0 * random.vector();
    }
    const BodyId id_a = world.add_body(a);
    const BodyId id_b = world.add_body(b);
    world.add_joint(make_joint("joint", id_a, {0.15, 0.25, -0.45}, id_b, {-0.4, 0.1, 0.2}, type));
  }
};

// Each of 10 000 steps rounds the momenta a few times in its ten sweeps, in sizes up to that of the
// angular momentum, which grows with the distance from the origin.
TEST(Momentum, OfAJoinedPairIsKeptToRoundOff) {
  for (const JointType& type :
       {JointType(rod(0.7)), JointType(spring(0.7, 200.0, 1.0)), JointType(rope(0.7))}) {
    FreePair pair(type);
    const Vector3d p = momentum(pair.world);
    const Vector3d L = angular_momentum(pair.world);
    double size = 0.0;
    for (int step = 0; step < 10000; ++step) {
      ASSERT_FALSE(pair.world.step().outcome.failed);
      for (const BodyId id : pair.world.body_ids())
        size = std::max(size, pair.world.body(id).mass * pair.world.state(id).position.norm() *
                                  pair.world.state(id).linear_velocity.norm());
    }
    EXPECT_LT((momentum(pair.world) - p).norm(), 10000 * kEpsilon * 20.0);
    EXPECT_LT((angular_momentum(pair.world) - L).norm(), 10000 * kEpsilon * size);
  }
}

// Stage 6 transfers the angular momentum, so at any spin and any tick the energy lies between those
// of rotation about the axes of the largest and of the least inertia.
TEST(FreeBox, KeepsAngularMomentumAndBoundsEnergy) {
  for (const double spin : {0.1, 3.0, 100.0, 1e4}) {
    for (const double h : {0.001, 0.01, 1.0 / 30.0}) {
      World world(weightless(h));
      Body box = make_body("box", Box{{0.1, 0.4, 0.7}}, 2.0, Vector3d::Zero());
      box.state.orientation = Quaterniond(0.5, 0.1, -0.7, 0.5).normalized();
      box.state.angular_velocity = spin * Vector3d(0.1, 1.0, 0.05);
      const BodyId id = world.add_body(box);
      const Vector3d L = angular_momentum(world);
      const Vector3d I = inertia_of(box);
      for (int step = 0; step < 3000; ++step) {
        ASSERT_FALSE(world.step().outcome.failed);
        // each of the nine products of a step is rounded
        ASSERT_LT((angular_momentum(world) - L).norm(), 9.0 * (step + 1) * kEpsilon * L.norm());
        ASSERT_LT(world.energy(), 0.5 * L.squaredNorm() / I.minCoeff() * (1.0 + 1e-9));
        ASSERT_GT(world.energy(), 0.5 * L.squaredNorm() / I.maxCoeff() * (1.0 - 1e-9));
      }
      EXPECT_NEAR(world.state(id).orientation.norm(), 1.0, 4.0 * kEpsilon);
    }
  }
}

TEST(FreeBox, TurnsEvenlyAboutAPrincipalAxis) {
  World world(weightless(0.01));
  Body box = make_body("box", Box{{0.1, 0.4, 0.7}}, 2.0, Vector3d::Zero());
  box.state.angular_velocity = {0.0, 0.0, 2.0};
  const BodyId id = world.add_body(box);
  run(world, 1000);
  const Quaterniond expected(Eigen::AngleAxisd(20.0, Vector3d::UnitZ()));
  EXPECT_LT(world.state(id).orientation.angularDistance(expected), 1e-7);  // acos near 1
  EXPECT_LT((world.state(id).orientation * Vector3d::UnitX() - expected * Vector3d::UnitX()).norm(),
            1000 * 4 * kEpsilon);
  EXPECT_NEAR(world.state(id).angular_velocity.z(), 2.0, 1000 * 4 * kEpsilon);
}

// ---- states that must not change

// x = x₀ + v t and q = exp(ω t) q₀ to the rounding of each step, with a heavy load attached.
TEST(Kinematic, MovesAtItsTwistWhateverPulls) {
  World world(options(0.01));
  Random random;
  Body carrier = make_body("carrier", Box{{1.0, 1.0, 1.0}}, 0.0, {0.0, 0.0, 3.0});
  carrier.type = BodyType::kKinematic;
  carrier.state = random.state();
  const BodyId id = world.add_body(carrier);
  const BodyId load = world.add_body(make_body("load", Sphere{0.1}, 1e6, {0.0, 0.0, -3.0}));
  world.add_joint(make_joint("rod", id, {0.5, 0.5, 0.5}, load, Vector3d::Zero()));
  run(world, 1000);
  const BodyState& start = carrier.state;
  const BodyState& end = world.state(id);
  const Vector3d w = start.angular_velocity;
  const Quaterniond turned =
      Quaterniond(Eigen::AngleAxisd(10.0 * w.norm(), w.normalized())) * start.orientation;
  EXPECT_LT((end.position - start.position - 10.0 * start.linear_velocity).norm(),
            1000 * kEpsilon * 20.0);
  EXPECT_LT((end.orientation.toRotationMatrix() - turned.toRotationMatrix()).norm(),
            1000 * 16 * kEpsilon);
  EXPECT_EQ(end.linear_velocity, start.linear_velocity);
  EXPECT_EQ(end.angular_velocity, start.angular_velocity);
}

TEST(Kinematic, CarriesWhatHangsOnIt) {
  World world(weightless(0.01));
  Body carrier = make_body("carrier", Point{}, 0.0, Vector3d::Zero());
  carrier.type = BodyType::kKinematic;
  carrier.state.linear_velocity = {0.0, 0.0, 0.5};
  const BodyId id = world.add_body(carrier);
  const BodyId load = world.add_body(make_body("load", Point{}, 1.0, {0.0, 0.0, -1.0}));
  world.add_joint(make_joint("rod", id, Vector3d::Zero(), load, Vector3d::Zero()));
  run(world, 100);
  EXPECT_NEAR(world.state(load).position.z(), -0.5, 1e-12);
}

TEST(Static, NeverMoves) {
  World world(options(0.01));
  Body block = make_body("block", Box{{1.0, 1.0, 1.0}}, 0.0, {0.0, 0.0, -0.5});
  block.type = BodyType::kStatic;
  block.friction = 0.5;
  block.state.orientation = Quaterniond(0.9, 0.1, 0.2, 0.3).normalized();
  const BodyId id = world.add_body(block);
  const BodyState before = world.state(id);
  world.add_body(make_body("ball", Sphere{0.3}, 1e6, {0.1, 0.0, 1.0}));
  const BodyId load = world.add_body(make_body("load", Sphere{0.1}, 10.0, {3.0, 0.0, 0.0}));
  world.add_joint(make_joint("rod", id, {0.5, 0.5, 0.5}, load, Vector3d::Zero()));
  run(world, 200);
  const BodyState& after = world.state(id);
  EXPECT_EQ(after.position, before.position);
  EXPECT_EQ(after.orientation.coeffs(), before.orientation.coeffs());
  EXPECT_EQ(after.linear_velocity, Vector3d::Zero());
  EXPECT_EQ(after.angular_velocity, Vector3d::Zero());
}

// ---- sweeps

/// Returns the largest rod error in one second of a swinging chain of ten with a load ten times a
/// link.
double chain_error(bool warm_starting, int iterations) {
  WorldOptions chosen = options(0.01);
  chosen.warm_starting = warm_starting;
  chosen.iterations = iterations;
  World world(chosen);
  BodyId previous = kWorldBody;
  for (int i = 1; i <= 10; ++i) {
    const std::string number = std::to_string(i);
    const BodyId link = world.add_body(
        make_body("link" + number, Point{}, i < 10 ? 0.1 : 1.0, {0.2 * i, 0.0, 0.0}));
    world.add_joint(make_joint("rod" + number, previous, Vector3d::Zero(), link, Vector3d::Zero()));
    previous = link;
  }
  double worst = 0.0;
  for (int step = 0; step < 100; ++step) worst = std::max(worst, world.step().joints.max_error);
  return worst;
}

TEST(WarmStarting, ReducesTheErrorAtEqualIterations) {
  for (const int iterations : {5, 10, 20})
    EXPECT_LT(chain_error(true, iterations), 0.7 * chain_error(false, iterations)) << iterations;
}

TEST(Iterations, ReduceTheError) {
  EXPECT_LT(chain_error(true, 20), chain_error(true, 10));
  EXPECT_LT(chain_error(true, 10), chain_error(true, 5));
}

// ---- friction: the impulse of both tangents together is never longer than μ times the normal one

TEST(Friction, NeverLeavesTheDisk) {
  Random random;
  int sliding = 0;
  for (int trial = 0; trial < 500; ++trial) {
    List<BodyState> bodies{BodyState{}, random.state(), random.state()};
    List<MassProperties> masses(3);
    for (int i = 1; i < 3; ++i) {
      masses[i].inverse_mass = 1.0;
      masses[i].inertia = {1.0, 2.0, 2.5};
      masses[i].inverse_inertia = masses[i].inertia.cwiseInverse();
    }
    Body rough;
    rough.friction = 0.3 + 0.3 * random();
    List<Row> rows;
    for (int contact = 0; contact < 3; ++contact) {
      std::array<Row, kMaxContactRows> written;
      const Manifold::Point point{random.vector(), 0.01, 0};
      const int count = write_contact_rows(bodies[1], bodies[2], random.vector().normalized(),
                                           point, ContactSurface(rough, 0, rough, 0),
                                           {0.01, 0.1, kGravity}, random.vector(), written.data());
      const int first = static_cast<int>(rows.size());
      for (int k = 0; k < count; ++k) {
        written[k].body_a = 1;
        written[k].body_b = 2;
        if (k > 0) written[k].normal_row = first;
        rows.push_back(written[k]);
      }
    }
    RowSolver solver;
    solver.begin({1, 2}, bodies);
    solver.update_velocities({1, 2}, bodies, masses, Vector3d::Zero(), 0.01, rows);
    solver.solve({1, 2}, rows, 5);
    for (std::size_t i = 0; i < rows.size(); i += 3) {
      ASSERT_GE(rows[i].impulse, 0.0);
      const double tangential = std::hypot(rows[i + 1].impulse, rows[i + 2].impulse);
      ASSERT_LE(tangential, rough.friction * rows[i].impulse * (1.0 + 4.0 * kEpsilon));
      if (tangential > 0.999 * rough.friction * rows[i].impulse && tangential > 0.0) ++sliding;
    }
  }
  EXPECT_GT(sliding, 100);  // otherwise the limit was never reached
}

// ---- bodies without joints or extent beside others

// A point mass without contact falls as if alone: x = x₀ + v₀ t + ½ g t (t + h), to rounding.
// Errors of the hinge beside it close in the first steps.
TEST(FreePoint, FallsBesideAJoint) {
  Random random;
  for (int scene = 0; scene < 400; ++scene) {
    World world(options(0.01));
    Body box = make_body("box", Box{{0.4, 0.3, 0.5}}, std::pow(10.0, random()), random.vector());
    box.state = random.state();
    Joint hinge = make_joint("hinge", kWorldBody, random.vector(), world.add_body(box),
                             0.2 * random.vector(), JointKind::kHinge);
    world.add_joint(hinge);
    Body point = make_body("point", Point{}, std::pow(10.0, random()), 10.0 * random.vector());
    point.state.linear_velocity = random.vector();
    const BodyId free = world.add_body(point);
    for (int k = 1; k <= 50; ++k) {
      ASSERT_FALSE(world.step().outcome.failed) << scene << ", step " << k;
      const double t = world.time();
      const Eigen::Vector3d expected = point.state.position + t * point.state.linear_velocity +
                                       0.5 * t * (t + 0.01) * world.options().gravity;
      ASSERT_LE((world.state(free).position - expected).norm(), 1e-12) << scene << ", step " << k;
      ASSERT_TRUE(std::isfinite(world.report().energy.total)) << scene << ", step " << k;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
