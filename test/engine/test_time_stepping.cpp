// Stacks and sliding bodies by time_stepping: rest to rounding, and closed forms of friction.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/snapshot.h"
#include "constraint_sim/engine/world.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kEdge = 0.2;  // [m]

WorldOptions stepping(double time_step) {
  WorldOptions options;
  options.method = Method::kTimeStepping;
  options.time_step = time_step;
  options.sleep_after = kInfinity;  // else a tower at rest would not be stepped
  return options;
}

BodyId add_cube(World* world, const std::string& name, double mass, const Vector3d& position,
                const Vector3d& velocity = Vector3d::Zero()) {
  Body body = make_body(name, Box{{kEdge, kEdge, kEdge}}, mass, position);
  body.friction = 0.6;
  body.state.linear_velocity = velocity;
  return world->add_body(body);
}

World tower(int n, double top, double time_step) {
  World world(stepping(time_step));
  world.add_body(make_floor(0.6));
  for (int i = 0; i < n; ++i)
    add_cube(&world, "cube_" + std::to_string(i), i + 1 == n ? top : 1.0,
             {0.0, 0.0, kEdge * (i + 0.5)});
  return world;
}

/// Returns the largest distance of a body from where it is now, within a time [s]; infinite where a
/// step fails.
double largest_motion(World* world, double duration) {
  std::vector<Vector3d> start;
  for (const BodyId id : world->body_ids()) start.push_back(world->state(id).position);
  const int steps = static_cast<int>(std::round(duration / world->options().time_step));
  double largest = 0.0;
  for (int k = 0; k < steps; ++k) {
    if (world->step().outcome.failed) return kInfinity;
    std::size_t i = 0;
    for (const BodyId id : world->body_ids())
      largest = std::max(largest, (world->state(id).position - start[i++]).norm());
  }
  return largest;
}

constexpr std::array<double, 3> kTimeSteps{1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0};
constexpr std::array<double, 4> kTimeStepsOfTowers{1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 0.001};
const double kDuration = kIsLongRun ? 60.0 : 10.0;  // [s]

// The residual of 1e-9 g h moves a level by less than 1e-9 g h² per step, 6e-7 m in 60 s at 1/60 s
// if all steps moved alike.
TEST(TimeStepping, TowersStand) {
  for (const double h : kTimeStepsOfTowers)
    for (const int n : {10, 20}) {
      World world = tower(n, 1.0, h);
      const double motion = largest_motion(&world, kDuration);
      EXPECT_LT(motion, 1e-6) << n << " " << h;
      EXPECT_EQ(world.islands().front().method, Method::kTimeStepping);
    }
}

TEST(TimeStepping, TowersStandWithAHeavyTop) {
  for (const double h : kTimeStepsOfTowers)
    for (const double top : {1e4, 1e6})
      for (const int n : {10, 20}) {
        World world = tower(n, top, h);
        EXPECT_LT(largest_motion(&world, kDuration), 1e-5) << n << " " << top << " " << h;
      }
}

TEST(TimeStepping, APyramidStands) {
  for (const double h : kTimeSteps) {
    World world(stepping(h));
    world.add_body(make_floor(0.6));
    constexpr int kRows = 6;
    for (int row = 0; row < kRows; ++row)
      for (int i = 0; i < kRows - row; ++i)
        add_cube(&world, std::to_string(row) + "_" + std::to_string(i), 1.0,
                 {1.1 * kEdge * (i + 0.5 * row), 0.0, kEdge * (row + 0.5)});
    EXPECT_LT(largest_motion(&world, kDuration), 1e-6) << h;
  }
}

TEST(TimeStepping, AWallOfSixtyBlocksStands) {
  for (const double h : kTimeSteps) {
    World world(stepping(h));
    world.add_body(make_floor(0.6));
    for (int row = 0; row < 10; ++row)
      for (int i = 0; i < 6; ++i) {
        Body block =
            make_body(std::to_string(row) + "_" + std::to_string(i), Box{{2 * kEdge, kEdge, kEdge}},
                      10.0, {2 * kEdge * i + (row % 2) * kEdge, 0.0, kEdge * (row + 0.5)});
        block.friction = 0.6;
        world.add_body(block);
      }
    EXPECT_LT(largest_motion(&world, kDuration), 1e-6) << h;
  }
}

constexpr double kCardThickness = 0.004, kCardHeight = 0.2, kLean = 0.35;  // [m], [m], [rad]

/// Two cards that lean on each other, `kLean` off the vertical.
World house_of_cards(Method method, double time_step, double friction) {
  WorldOptions options = stepping(time_step);
  options.method = method;
  World world(options);
  world.add_body(make_floor(friction));
  for (const double side : {-1.0, 1.0}) {
    Body card = make_body(side < 0.0 ? "left" : "right", Box{{kCardThickness, 0.1, kCardHeight}},
                          0.01, Vector3d::Zero());
    card.friction = friction;
    card.state.orientation = Eigen::AngleAxisd(-side * kLean, Vector3d::UnitY());
    const double sine = std::sin(kLean), cosine = std::cos(kLean);
    card.state.position = {0.5 * side * (kCardThickness * cosine + kCardHeight * sine), 0.0,
                           0.5 * (kCardThickness * sine + kCardHeight * cosine)};
    world.add_body(card);
  }
  return world;
}

// Friction of ½ (tan(lean) − thickness/height) holds the cards where their edges push each other
// horizontally, from the moments about a lower edge. Events follow that. A manifold of two parallel
// edges has the normal of a face beside one of them, on which friction of tan(lean) holds.
TEST(TimeStepping, AHouseOfCardsStandsWhereFrictionHoldsIt) {
  const double least = 0.5 * (std::tan(kLean) - kCardThickness / kCardHeight);
  for (const double h : kTimeSteps) {
    World stands = house_of_cards(Method::kAuto, h, 1.01 * least);
    EXPECT_LT(largest_motion(&stands, kDuration), 1e-6) << h;
    World falls = house_of_cards(Method::kAuto, h, 0.99 * least);
    EXPECT_GT(largest_motion(&falls, kDuration), 0.09) << h;
    World stepped = house_of_cards(Method::kTimeStepping, h, 1.01 * std::tan(kLean));
    EXPECT_LT(largest_motion(&stepped, kDuration), 1e-6) << h;
  }
}

// The plate and the pins weigh (5 + 36 · 0.05) g on 36 springs of 2000 N/m.
TEST(TimeStepping, APlateOnSprungPinsIsLevelAndAtRest) {
  for (const double h : kTimeSteps) {
    World world(stepping(h));
    for (int i = 0; i < 36; ++i) {
      const std::string name = "pin_" + std::to_string(i);
      const Vector3d place(0.1 * (i % 6) - 0.25, 0.1 * (i / 6) - 0.25, 0.5);
      const BodyId pin = world.add_body(make_body(name, Box{{0.02, 0.02, 0.1}}, 0.05, place));
      Joint slider = make_joint(name, kWorldBody, place, pin, Vector3d::Zero());
      slider.kind = JointKind::kSlider;
      slider.axis_b = Vector3d::UnitZ();
      slider.coordinates[0].stiffness = 2000.0;
      slider.coordinates[0].damping = 20.0;
      world.add_joint(slider);
    }
    const BodyId plate =
        world.add_body(make_body("plate", Box{{0.7, 0.7, 0.02}}, 5.0, {0.0, 0.0, 0.56}));
    largest_motion(&world, 5.0);  // the oscillation of 160 rad/s is damped to nothing
    EXPECT_LT(largest_motion(&world, 5.0), 1e-8) << h;
    const BodyState& there = world.state(plate);
    // contacts may be 1e-5 g h² deep
    EXPECT_NEAR(there.position.z(), 0.56 - 6.8 * kGravity / (36 * 2000.0), 2e-5 * kGravity * h * h)
        << h;
    EXPECT_LT(there.orientation.angularDistance(Eigen::Quaterniond::Identity()), 1e-9) << h;
  }
}

TEST(TimeStepping, ALightBoxCarriesAHeavyOne) {
  for (const double h : kTimeSteps) {
    World world = tower(2, 3e6, h);
    EXPECT_LT(largest_motion(&world, 10.0), 1e-6) << h;
  }
}

// Friction of 0.2 on the floor and 0.6 between the cubes: all stop after v²/(2 μ g). The end of the
// step in which they stop is off by at most μ g h²/8. Residuals of up to 1e-3 g h, in the few steps
// in which impulses change, add some 1e-3 g h² each, also aside.
TEST(TimeStepping, ASlidingStackStopsWhereFrictionStopsIt) {
  constexpr double kFriction = 0.2, kSpeed = 1.0;
  for (const double h : kTimeSteps) {
    World world(stepping(h));
    world.add_body(make_floor(kFriction * kFriction / 0.6));
    std::vector<BodyId> cubes;
    for (int i = 0; i < 3; ++i)
      cubes.push_back(add_cube(&world, std::to_string(i), 1.0, {0.0, 0.0, kEdge * (i + 0.5)},
                               {kSpeed, 0.0, 0.0}));
    for (int k = 0; k < std::round(1.0 / h); ++k) {
      world.step();
      const double t = std::min(world.report().time, kSpeed / (kFriction * kGravity));
      const double x = kSpeed * t - 0.5 * kFriction * kGravity * t * t;
      for (const BodyId id : cubes) {
        const Vector3d position = world.state(id).position;
        ASSERT_NEAR(position.x(), x, (0.13 * kFriction + 0.004) * kGravity * h * h)
            << h << " " << k;
        ASSERT_LT(std::abs(position.y()), 0.01 * kGravity * h * h) << h << " " << k;
      }
    }
  }
}

// A weld holds the upper cubes beside a tower of two, from which one overhangs: the weld carries
// its weight of 9.81 N, and the lower corners the rest.
TEST(TimeStepping, AJointHoldsBesideContacts) {
  for (const double h : kTimeSteps) {
    World world(stepping(h));
    world.add_body(make_floor(0.6));
    add_cube(&world, "lower", 3.0, {0.0, 0.0, 0.5 * kEdge});
    const BodyId upper = add_cube(&world, "upper", 3.0, {0.0, 0.0, 1.5 * kEdge});
    const BodyId beside = add_cube(&world, "beside", 1.0, {kEdge, 0.0, 1.5 * kEdge});
    const Vector3d arm(0.5 * kEdge, 0.0, 0.0);
    const JointId weld =
        world.add_joint(make_joint("weld", upper, arm, beside, -arm, JointKind::kWeld));
    EXPECT_LT(largest_motion(&world, 2.0), 1e-6) << h;
    EXPECT_EQ(world.islands().back().method, Method::kTimeStepping) << h;
    EXPECT_LT(world.joint_state(weld).error, 1e-6) << h;
    double carried = 0.0;
    for (const Contact& contact : world.contacts())
      if (std::abs(contact.position.z()) < 1e-3) carried += contact.normal_force;
    EXPECT_NEAR(carried, 7.0 * kGravity, 1e-6 * 7.0 * kGravity) << h;  // residual over g h: 1e-9
  }
}

// A box that a constant force F draws over the floor: x = ½ (F/m − μ g) t², and the work of F is F
// x.
TEST(TimeStepping, AConstantForceDoesItsWorkAlongTheMotion) {
  World world(stepping(0.01));
  world.add_body(make_floor(0.6));
  const BodyId box = add_cube(&world, "box", 2.0, {0.0, 0.0, 0.5 * kEdge});
  Wrench wrench;
  wrench.body = box;
  wrench.force = {20.0, 0.0, 0.0};
  world.add_wrench(wrench);
  double work = 0.0;
  for (int i = 0; i < 100; ++i) work += world.step().energy.driven_work;
  const double displacement = 0.5 * (10.0 - 0.6 * kGravity);
  // rates are solved to 1e-5 g h, or 1e-6 m/s
  EXPECT_NEAR(world.state(box).position.x(), displacement, 1e-6);
  EXPECT_NEAR(work, 20.0 * world.state(box).position.x(), 1e-11);
}

// A block of 0.4 m by 1.2 m leans on its right lower edge, which is at x = 0, and rocks from edge
// to edge. Edges that friction holds do not slide, so it ends upright with its centre at x = −0.2
// m. Edges slide by some 1e-5 m in a change of edges at 1/100 s.
TEST(TimeStepping, ARockingBlockEndsOnTheEdgesOnWhichItBegan) {
  World world(stepping(0.01));
  world.add_body(make_floor(2.0));
  Body block =
      make_body("block", Box{{0.4, 1.0, 1.2}}, 10.0, {-0.101308145723319, 0.0, 0.6242889231838915});
  block.state.orientation = {0.9967666370915252, 0.0, 0.0803509252047020, 0.0};
  block.friction = 2.0;
  const BodyId id = world.add_body(block);
  for (int k = 0; k < 400; ++k) {
    ASSERT_FALSE(world.step().outcome.failed) << k;
    ASSERT_FALSE(world.report().contacts.creep_body) << k;
  }
  EXPECT_LT((world.state(id).position - Vector3d(-0.2, 0.0, 0.6)).norm(), 1e-3);
  EXPECT_LT(world.state(id).orientation.vec().norm(), 1e-6);
}

// 400 iterations do not solve a tower of 20 cubes of 1 kg with a top of 1e9 kg.
TEST(TimeStepping, NamesABodyWhoseImpulsesAreNotSolved) {
  World solved = tower(5, 1.0, 1.0 / 60.0), unsolved = tower(20, 1e9, 1.0 / 60.0);
  int named = 0;
  for (int k = 0; k < 30; ++k) {
    EXPECT_FALSE(solved.step().contacts.unsolved_body);
    const StepReport& report = unsolved.step();
    if (!report.contacts.unsolved_body) continue;
    ASSERT_GT(report.contacts.solver_residual, 1e-5 * 9.81 / 60.0) << k;
    ++named;
    bool is_named = false;
    for (const StepWarning& warning : faults_of(unsolved))
      is_named = is_named || (warning.kind == StepWarning::Kind::kUnsolved &&
                              warning.name == unsolved.body(*report.contacts.unsolved_body).name &&
                              warning.value == report.contacts.solver_residual);
    EXPECT_TRUE(is_named) << k;
  }
  EXPECT_GT(named, 0);
}

// v₁ = −e v₀ in each bounce, and a ball with e = 1 keeps its energy.
TEST(TimeStepping, ABallBouncesByItsRestitution) {
  for (const double restitution : {1.0, 0.9, 0.5})
    for (const double h : kTimeSteps) {
      World world(stepping(h));
      world.add_body(make_floor(0.0));
      Body body = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 1.1});
      body.restitution = restitution;
      const BodyId ball = world.add_body(body);
      const double energy = world.energy();
      double before = 0.0;
      int bounces = 0;
      while (world.time() < 1.5) {
        world.step();
        const double now = world.state(ball).linear_velocity.z();
        if (before < -4.0 * kGravity * h && now > 0.0) {
          // gravity acts before and after the bounce, which is within the step
          EXPECT_NEAR(now, -restitution * before, (1.0 + restitution) * kGravity * h)
              << restitution << " " << h;
          ++bounces;
        }
        before = now;
      }
      EXPECT_GE(bounces, 1) << restitution << " " << h;
      if (restitution == 1.0) {
        EXPECT_NEAR(world.energy(), energy, 1e-9 * energy) << h;
      }
    }
}

// A body in rest on another one moves as that one where a floor or a motor changes its velocity in
// one step: by the mean of both velocities it would go ½ h Δv deep, at 0.01 s 0.01 m.
TEST(TimeStepping, ABodyInRestMovesAsWhatItRestsOn) {
  const auto deepest = [](World* world, int steps) {
    double most = 0.0;
    for (int k = 0; k < steps; ++k) {
      const StepReport report = world->step();
      EXPECT_FALSE(report.outcome.failed);
      most = std::max(most, report.contacts.max_penetration);
    }
    return most;
  };
  constexpr double kSpeed = 2.0;  // [m/s]
  for (const double h : {1.0 / 60.0, 0.01, 1.0 / 240.0, 0.001}) {
    const double allowed = 2e-2 * kGravity * h * h;  // approaches up to 1e-2 g h count as rest
    World falling(stepping(h));
    falling.add_body(make_floor(0.6));
    for (int i = 0; i < 4; ++i)
      add_cube(&falling, std::to_string(i), 1.0 + i, {0.0, 0.0, kEdge * (i + 0.5) + 1e-3},
               {0.0, 0.0, -kSpeed});
    EXPECT_LT(deepest(&falling, 20), allowed) << h;

    World lifted(stepping(h));
    const BodyId deck = add_cube(&lifted, "deck", 5.0, {0.0, 0.0, 0.5 * kEdge});
    for (int i = 1; i < 4; ++i)
      add_cube(&lifted, std::to_string(i), 1.0, {0.0, 0.0, kEdge * (i + 0.5)});
    Joint lift = make_joint("lift", kWorldBody, {0.0, 0.0, 0.5 * kEdge}, deck, Vector3d::Zero(),
                            JointKind::kSlider);
    lift.coordinates[0].motor.emplace().bias = kSpeed;
    lifted.add_joint(lift);
    EXPECT_LT(deepest(&lifted, 20), allowed) << h;
  }
}

// Rounding of the energy that each of many balls gives back is no reason to weaken impulses.
TEST(TimeStepping, ManyBallsBounceWithoutAWarning) {
  World world(stepping(0.01));
  world.add_body(make_floor(0.0));
  for (int i = 0; i < 40; ++i) {
    Body ball =
        make_body(std::to_string(i), Sphere{0.1}, 1.0 + 0.1 * i, {1.0 * i, 0.0, 0.5 + 0.01 * i});
    ball.restitution = 1.0;
    world.add_body(ball);
  }
  const double energy = world.energy();
  for (int k = 0; k < 200; ++k) EXPECT_FALSE(world.step().contacts.unsolved_body) << k;
  EXPECT_NEAR(world.energy(), energy, 1e-9 * energy);
}

// A wrench acts once on a ball whose step is divided at a hit, also where another body takes its
// step whole.
TEST(TimeStepping, AWrenchActsOnceInADividedStep) {
  World world(stepping(0.01));
  world.add_body(make_floor(0.5));
  Body wall = make_body("wall", Box{{0.1, 4.0, 4.0}}, 0.0, {5.0, 0.0, 10.0});
  wall.type = BodyType::kStatic;
  world.add_body(wall);
  Body fast = make_body("ball", Sphere{0.02}, 1.0, {4.6, 0.0, 10.0});
  fast.state.linear_velocity.x() = 50.0;
  const BodyId ball = world.add_body(fast);
  add_cube(&world, "sliding", 1.0, {0.0, 0.0, 0.5 * kEdge}, {1.0, 0.0, 0.0});
  Wrench wrench;
  wrench.body = ball;
  wrench.force = {0.0, 100.0, 0.0};
  world.add_wrench(wrench);
  EXPECT_EQ(world.step().contacts.hits, 1u);
  EXPECT_NEAR(world.state(ball).linear_velocity.y(), 1.0, 1e-12);
}

// Tilted boxes that keep 0.9 of their speed at each corner would gain energy with friction of 0.8
// where two corners bounce at once: such bounces are lowered, and everything is solved.
TEST(TimeStepping, BouncesOfSeveralCornersGainNoEnergy) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int scene = 0; scene < 20; ++scene) {
    World world(stepping(1.0 / 100.0));
    world.add_body(make_floor(0.8));
    Body box = make_body("box", Box{{0.3, 0.2, 0.1}}, 1.0, {0.0, 0.0, 0.5});
    box.friction = 0.8;
    box.restitution = 0.9;
    box.state.orientation =
        Eigen::Quaterniond(1.0, 0.3 * uniform(random), 0.3 * uniform(random), 0.0).normalized();
    box.state.linear_velocity = {uniform(random), uniform(random), -1.0};
    world.add_body(box);
    for (int k = 0; k < 150; ++k) {
      const StepReport& report = world.step();
      ASSERT_FALSE(report.contacts.unsolved_body)
          << scene << " " << k << " " << report.contacts.solver_residual << " "
          << report.costs.iterations;
      ASSERT_EQ(report.energy.rise, 0.0) << scene << " " << k;
    }
  }
}

// Rows of more than 500 bodies in contact are swept, and not named.
TEST(TimeStepping, SweepsOverGroupsThatAreTooLarge) {
  const auto row_of = [](int n) {
    WorldOptions options = stepping(1.0 / 60.0);
    options.iterations = 7;
    World world(options);
    world.add_body(make_floor(0.6));
    for (int i = 0; i < n; ++i)
      world.add_body(make_body(std::to_string(i), Sphere{0.1}, 1.0, {0.2 * i, 0.0, 0.1}));
    return world;
  };
  World solved = row_of(500), swept = row_of(501);
  EXPECT_NE(solved.step().costs.iterations, 7u);
  EXPECT_EQ(swept.step().costs.iterations, 7u);
  EXPECT_FALSE(swept.report().contacts.unsolved_body);
}

// The memory of the solvers, of a step before or of a tower that was there, changes no bit.
TEST(TimeStepping, GoesOnWithTheSameBitsFromASnapshot) {
  World world = tower(6, 1.0, 1.0 / 100.0);
  for (int i = 0; i < 4; ++i)
    add_cube(&world, "leaning_" + std::to_string(i), 1.0,
             {1.0 + 0.02 * i, 0.01 * i, kEdge * (i + 0.6)});
  const auto expect_same_future = [](World world, World again) {
    for (int k = 0; k < 50; ++k) {
      ASSERT_EQ(world.state_hash(), again.state_hash()) << k;
      world.step();
      again.step();
    }
  };
  for (int k = 0; k < 40; ++k) world.step();
  expect_same_future(world, read_snapshot(write_snapshot(world)));
  expect_same_future(world, World(world));
  world.remove_body(world.find_body("cube_2"));
  for (int k = 0; k < 5; ++k) world.step();
  expect_same_future(world, read_snapshot(write_snapshot(world)));
}

}  // namespace
}  // namespace constraint_sim::engine
