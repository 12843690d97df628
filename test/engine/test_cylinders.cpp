// Cylinders that stand, lie, roll, rock, tip, fall in heaps and hit: closed forms, energy and bits.
// Their contact geometry is tested in test_narrowphase_cylinders.cpp.

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "draw.h"
#include "engine/collision/narrowphase.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

const Quaterniond kAlongY(AngleAxisd(-0.5 * kPi, Vector3d::UnitX()));

constexpr int kConverged = 200;  // sweeps until convergence, beyond ten

WorldOptions with_sweeps(int iterations, double time_step) {
  WorldOptions of = options(time_step);
  of.iterations = iterations;
  return of;
}

Body make_ground(bool is_box, double friction, double slope = 0.0) {
  Body ground = make_floor(friction, slope);
  if (!is_box) return ground;
  ground.shape = Box{{200.0, 4.0, 1.0}};
  ground.state.position = ground.state.orientation * Vector3d(0.0, 0.0, -0.5);
  return ground;
}

Vector3d axis_of(const World& world, BodyId id) {
  return world.state(id).orientation * Vector3d::UnitZ();
}

TEST(Cylinders, StandAndLieAtRest) {
  for (const bool is_box : {false, true}) {
    for (const bool lies : {false, true}) {
      World world(with_sweeps(kConverged, 0.01));
      world.add_body(make_ground(is_box, 0.5));
      Body body = make_body("can", Cylinder{0.3, 0.8}, 2.0, {0.1, 0.2, lies ? 0.3 : 0.4});
      body.friction = 0.5;
      if (lies) body.state.orientation = kAlongY;
      const BodyId can = world.add_body(body);
      run(world, 500);
      const BodyState& state = world.state(can);
      EXPECT_LT((state.position - body.state.position).norm(), slop(world) * 1.01);
      EXPECT_LT(state.linear_velocity.norm() + state.angular_velocity.norm(), 1e-6);
      EXPECT_LT((axis_of(world, can) - (lies ? Vector3d::UnitY() : Vector3d::UnitZ())).norm(),
                1e-9);
      // residual of the weight after ten sweeps a step
      EXPECT_LT((contact_force_on(world, can) - Vector3d(0.0, 0.0, 2.0 * kGravity)).norm(), 0.01);
    }
  }
}

// m a = m g sin θ − F, ½ m r² α = F r, a = α r: a = ⅔ g sin θ.
TEST(Cylinders, RollDownASlope) {
  const double slope = 0.3, r = 0.5;
  for (const bool is_box : {false, true}) {
    World world(with_sweeps(kConverged, 0.01));
    world.add_body(make_ground(is_box, 1.0, slope));
    const Quaterniond turn(AngleAxisd(slope, Vector3d::UnitY()));
    Body body = make_body("roller", Cylinder{r, 1.0}, 3.0, Vector3d::Zero());
    body.friction = 1.0;
    body.state.orientation = turn * kAlongY;
    body.state.position = turn * Vector3d(0.0, 0.0, r - 0.5 * slop(world));
    const BodyId roller = world.add_body(body);
    const Vector3d downhill = turn * Vector3d::UnitX();
    const double a = 2.0 / 3.0 * kGravity * std::sin(slope);
    for (int step = 1; step <= 200; ++step) {
      world.step();
      const double t = world.time();
      // Velocities before positions give ½ a t (t + h); the lever is shorter than r by up to the
      // slop, and the first sweeps may lose a fifth of a step's speed.
      ASSERT_NEAR(downhill.dot(world.state(roller).position - body.state.position),
                  0.5 * a * t * (t + 0.01), 0.2 * a * 0.01 * t + slop(world) / r * t * t)
          << is_box << " " << t;
    }
    EXPECT_NEAR(world.state(roller).angular_velocity.y() * r,
                downhill.dot(world.state(roller).linear_velocity), 2.0 * slop(world) / r);
    EXPECT_LT((axis_of(world, roller) - Vector3d::UnitY()).norm(), 1e-6);  // straight ahead
  }
}

// Angular momentum about the line of contact is kept: m r v₀ = (m r² + ½ m r²) v/r.
TEST(Cylinders, SlidingOnesEndAtTwoThirdsOfTheirSpeed) {
  World world(options(0.01));
  world.add_body(make_floor(0.3));
  Body body = make_body("roller", Cylinder{0.5, 1.0}, 2.0, {0.0, 0.0, 0.5});
  body.friction = 0.3;
  body.state.orientation = kAlongY;
  body.state.linear_velocity.x() = 6.0;
  const BodyId roller = world.add_body(body);
  run(world, 100);  // slides for v₀/(3 μ g) = 0.68 s
  // the contact is nearer to the axis than r by up to the slop, which changes v by ⅔ of their ratio
  EXPECT_NEAR(world.state(roller).linear_velocity.x(), 4.0, 6.0 * slop(world) / 0.5);
  EXPECT_NEAR(world.state(roller).angular_velocity.y() * 0.5,
              world.state(roller).linear_velocity.x(), 6.0 * slop(world) / 0.5);
}

// A standing cylinder on a slope tips where the line of its weight leaves its base: tan θ = d/l.
TEST(Cylinders, TipOverBeyondTheirFoot) {
  for (const bool is_box : {false, true}) {
    for (const double share : {0.9, 1.1}) {
      const double slope = share * std::atan(0.4 / 1.6);
      World world(options(0.002));
      world.add_body(make_ground(is_box, 2.0, slope));
      const Quaterniond turn(AngleAxisd(slope, Vector3d::UnitY()));
      Body body = make_body("post", Cylinder{0.2, 1.6}, 1.0, turn * Vector3d(0.0, 0.0, 0.8));
      body.friction = 2.0;
      body.state.orientation = turn * Quaterniond(AngleAxisd(0.4, Vector3d::UnitZ()));
      const BodyId post = world.add_body(body);
      run(world, 1500);
      const double upright = axis_of(world, post).dot(turn * Vector3d::UnitZ());
      if (share < 1.0) {
        EXPECT_GT(upright, 1.0 - 1e-5) << is_box;
      } else {
        EXPECT_LT(upright, 0.5) << is_box;
      }
    }
  }
}

// A lying cylinder with its centre of mass d below its axis, without friction: the centre of mass
// moves vertically only, and the cylinder rocks with ω² = m g d / I.
TEST(Cylinders, RockAboutTheirLowestLine) {
  const double m = 2.0, d = 0.05, inertia = 0.03, r = 0.2;
  const double period = 2.0 * kPi / std::sqrt(m * kGravity * d / inertia);
  for (const double h : {2e-3, 1e-3}) {
    World world(options(h));
    world.add_body(make_floor(0.0));
    Body body = make_body("cradle", Cylinder{r, 0.5}, m, {0.0, 0.0, r - d * std::cos(0.05)});
    body.inertia = Vector3d::Constant(inertia);
    body.shape_pose = ShapePose{{0.0, 0.0, d}, kAlongY};
    body.state.orientation = AngleAxisd(0.05, Vector3d::UnitY());
    const BodyId id = world.add_body(body);
    double before = 0.0, time = 0.0;
    int turns = 0;
    while (turns < 2 && time < 3.0 * period) {
      world.step();
      time = world.time();
      const double w = world.state(id).angular_velocity.y();
      if (before * w < 0.0) ++turns;
      before = w;
    }
    // a tick of resolution, and for an amplitude θ the share θ²/16 = 1.6e-4
    EXPECT_NEAR(time, period, 1.5 * h + 2e-3 * period) << h;
  }
}

// At 500 m/s, 2 m a tick, a cylinder hits a wall of one millimetre end on and broadside at the
// right place.
TEST(Cylinders, FastOnesDoNotPassThroughThinWalls) {
  for (const bool is_broadside : {false, true}) {
    WorldOptions options = weightless(1.0 / 240.0);
    options.iterations = kConverged;  // ten leave 6e-4 of the speed on the four points of an end
    World world(options);
    Body wall = make_body("wall", Box{{1e-3, 4.0, 4.0}}, 0.0, Vector3d::Zero());
    wall.type = BodyType::kStatic;
    world.add_body(wall);
    Body body = make_body("rod", Cylinder{0.05, 0.3}, 1.0, {-1.0, 0.1, 0.2});
    if (!is_broadside) body.state.orientation = AngleAxisd(0.5 * kPi, Vector3d::UnitY());
    body.state.linear_velocity.x() = 500.0;
    const BodyId rod = world.add_body(body);
    run(world, 2);
    const double place = -(is_broadside ? 0.05 : 0.15) - 0.5e-3;
    EXPECT_NEAR(world.state(rod).position.x(), place, 1e-8);  // 1e-9 of the wall, and of a tick
    EXPECT_NEAR(world.state(rod).linear_velocity.x(), 0.0, 1e-9);
  }
}

World heap(unsigned seed) {
  Draw draw(seed);
  WorldOptions of_heap = options(0.005);
  of_heap.iterations = 20;
  World world(of_heap);
  world.add_body(make_floor(0.5));
  for (int i = 0; i < 12; ++i) {
    const double size = 0.2 + 0.3 * draw.share();
    Shape shape = Cylinder{0.5 * size, 0.2 + 0.6 * draw.share()};
    if (i % 4 == 1) shape = Box{{size, 0.3, 0.4}};
    if (i % 4 == 2) shape = Sphere{0.5 * size};
    Body body = make_body("b" + std::to_string(i), shape, 1.0 + 0.5 * draw(),
                          {0.4 * draw(), 0.4 * draw(), 0.6 + 0.7 * i});
    body.state.orientation = draw.turn();
    body.state.angular_velocity = 2.0 * draw.vector();
    body.friction = 0.5;
    world.add_body(body);
  }
  return world;
}

// Only pushing out overlaps raises the energy, and bodies do not pass through each other.
TEST(Cylinders, InHeapsGainNoEnergyAndStayApart) {
  for (unsigned seed = 1; seed <= 10u / kSeedShare + 1; ++seed) {
    World world = heap(seed);
    const std::vector<BodyId> ids = world.body_ids();
    double energy = world.energy();
    const double start = energy;
    for (int step = 0; step < 1200; ++step) {
      world.step();
      ASSERT_FALSE(world.report().outcome.failed) << seed;
      // weights of 12 kg sunk in by a few slops
      ASSERT_LT(world.energy(), energy + 12.0 * kGravity * 20.0 * slop(world)) << seed << step;
      energy = std::min(energy, world.energy());
    }
    EXPECT_LT(energy, 0.5 * start) << seed;  // the heap has fallen
    for (std::size_t i = 0; i < ids.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) {
        const double gap = separation(world.body(ids[i]).shape, world.state(ids[i]),
                                      world.body(ids[j]).shape, world.state(ids[j]))
                               .gap;
        EXPECT_GT(gap, -0.02) << seed << ": " << i << " in " << j;  // a tenth of the thinnest
      }
  }
}

TEST(Cylinders, AreSavedHashedAndKeptInSnapshots) {
  World world = heap(3);
  run(world, 300);
  World loaded = load_scene(save_scene(world));
  EXPECT_EQ(save_scene(loaded), save_scene(world));
  World restored = read_snapshot(write_snapshot(world));
  EXPECT_EQ(restored.state_hash(), world.state_hash());
  run(world, 200);
  run(restored, 200);
  EXPECT_EQ(restored.state_hash(), world.state_hash());
  std::vector<std::uint64_t> hashes;
  for (const Cylinder& shape : {Cylinder{0.1, 0.2}, Cylinder{0.2, 0.1}, Cylinder{0.1, 0.3}}) {
    World other;
    Body body = make_body("can", shape, 1.0, Vector3d::Zero());
    body.inertia = Vector3d::Ones();
    other.add_body(body);
    hashes.push_back(other.state_hash());
  }
  EXPECT_NE(hashes[0], hashes[1]);
  EXPECT_NE(hashes[0], hashes[2]);
}

// Cylinders cannot be event-driven: impulses advance their islands, as plan and islands report.
TEST(Cylinders, AreLeftToImpulsesByEvents) {
  WorldOptions by_events = options(0.01);
  by_events.method = Method::kEventDriven;
  World world(by_events);
  world.add_body(make_floor(0.5));
  Body body = make_body("can", Cylinder{0.3, 0.8}, 2.0, {0.0, 0.0, 0.4});
  const BodyId can = world.add_body(body);
  run(world, 100);
  EXPECT_LT(std::abs(world.state(can).position.z() - 0.4), slop(world) * 1.01);
  ASSERT_EQ(world.islands().size(), 1u);
  EXPECT_EQ(world.islands()[0].method, Method::kTimeStepping);
  EXPECT_NE(explain(world).find("events of cylinders: time_stepping advances"), std::string::npos);
  EXPECT_NE(explain(world).find("cylinder: 1,"), std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::engine
