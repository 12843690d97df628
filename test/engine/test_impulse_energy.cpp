// Energy under sequential impulses: less the work of wrenches, motors, kinematic bodies and
// position corrections it never rises, at any tick, mass ratio and number of sweeps.

#include "constraint_sim/engine/scene.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Random ticks of 1/1000 to 1/10 s, masses over six decades and 1 to 200 sweeps.
struct Setting {
  explicit Setting(Random* random) {
    time_step = 0.001 * std::pow(100.0, share(random));
    iterations = static_cast<int>(std::pow(200.0, share(random)));
    warm_starting = (*random)() > -0.8;
  }
  static double share(Random* random) { return 0.5 + 0.5 * (*random)(); }
  static double mass(Random* random, double decades = 6.0) {
    return std::pow(10.0, decades * (share(random) - 1.0 / 3.0));
  }

  WorldOptions options() const {
    WorldOptions chosen = engine::options(time_step);
    chosen.iterations = iterations;
    chosen.warm_starting = warm_starting;
    chosen.sleep_after = kInfinity;
    return chosen;
  }

  double time_step;
  int iterations;
  bool warm_starting;
};

Shape any_shape(Random* random) {
  if ((*random)() < -0.3) return Point{};
  if ((*random)() < 0.0) return Sphere{0.1};
  return Box{{0.1, 0.2, 0.3}};
}

Vector3d any_anchor(const Shape& shape, Random* random) {
  return std::holds_alternative<Point>(shape) ? Vector3d(Vector3d::Zero()) : 0.1 * random->vector();
}

/// Returns a joint of any type, with or without a motor; `soft` allows springs.
Joint any_joint(const std::string& name, BodyId a, const Vector3d& anchor_a, BodyId b,
                const Vector3d& anchor_b, double distance, bool soft, Random* random) {
  Joint joint = make_joint(name, a, anchor_a, b, anchor_b, rod(distance));
  const double kind = (*random)();
  if (kind < -0.6) joint.distance = rope(distance * (1.0 + 0.2 * (*random)()));
  if (kind > 0.8) joint.distance = between(distance * (1.0 + 0.2 * (*random)()), kInfinity);
  if (soft && kind > 0.3 && kind < 0.8)
    joint.distance = spring(distance * (1.0 + 0.3 * (*random)()), std::pow(10.0, 2.0 + (*random)()),
                            1.0 + (*random)());
  if ((*random)() > 0.8) {
    joint.motor.amplitude = 0.1;
    joint.motor.frequency = 1.0 + (*random)();
    // a force-limited spring holds less energy than ½ k C², which the test measures
    const auto* distance_joint = if_distance(joint);
    if ((*random)() > 0.0 && !distance_joint->is_soft()) joint.motor.max_force = 10.0;
  }
  return joint;
}

struct Scene {
  World world;
  Random* random;
  std::vector<BodyId> bodies;

  double decades = 6.0;

  Scene(const WorldOptions& options, Random* random) : world(options), random(random) {}

  BodyId add(const Shape& shape, const Vector3d& position, BodyType type = BodyType::kDynamic) {
    Body body = make_body("body_" + std::to_string(bodies.size()), shape,
                          Setting::mass(random, decades), position);
    body.type = type;
    body.friction = 0.5 + 0.5 * (*random)();
    body.restitution = (*random)() > 0.0 ? 0.5 + 0.5 * (*random)() : 0.0;
    if (!std::holds_alternative<Point>(shape)) body.state.orientation = random->orientation();
    body.state.linear_velocity = random->vector();
    if (!std::holds_alternative<Point>(shape)) body.state.angular_velocity = 3.0 * random->vector();
    if (type == BodyType::kStatic)
      body.state.linear_velocity = body.state.angular_velocity = Vector3d::Zero();
    bodies.push_back(world.add_body(body));
    return bodies.back();
  }

  void join(BodyId a, BodyId b, bool soft) {
    const auto anchor = [&](BodyId id) {
      return id == kWorldBody ? Vector3d(random->vector())
                              : any_anchor(world.body(id).shape, random);
    };
    const Vector3d anchor_a = anchor(a);
    const Vector3d anchor_b = anchor(b);
    const auto point = [&](BodyId id, const Vector3d& r) {
      const BodyState& state = world.state(id);
      return Vector3d(state.position + state.orientation * r);
    };
    const double d = (point(b, anchor_b) - point(a, anchor_a)).norm();
    world.add_joint(any_joint("joint_" + std::to_string(world.joint_ids().size()), a, anchor_a, b,
                              anchor_b, d, soft, random));
  }
};

World random_chain(const WorldOptions& options, bool soft, Random* random) {
  Scene scene(options, random);
  if (soft) scene.decades = 2.0;
  BodyId before = kWorldBody;
  if ((*random)() > 0.5) before = scene.add(Sphere{0.1}, {0.0, 0.0, 0.0}, BodyType::kKinematic);
  const int links = 3 + static_cast<int>(8.0 * Setting::share(random));
  for (int i = 1; i <= links; ++i) {
    const BodyId link = scene.add(any_shape(random), {0.5 * i, 0.0, 0.1 * (*random)()});
    scene.join(before, link, soft);
    before = link;
  }
  if ((*random)() > 0.0) scene.join(kWorldBody, before, soft);
  return scene.world;
}

World random_net(const WorldOptions& options, bool soft, Random* random) {
  Scene scene(options, random);
  constexpr int kSize = 4;
  for (int i = 0; i < kSize * kSize; ++i) {
    scene.add(Point{}, {0.5 * (i % kSize), 0.5 * (i / kSize), 0.02 * (*random)()});
    if (i % kSize > 0) scene.join(scene.bodies[i - 1], scene.bodies[i], soft);
    if (i >= kSize) scene.join(scene.bodies[i - kSize], scene.bodies[i], soft);
  }
  if ((*random)() > 0.0) scene.join(kWorldBody, scene.bodies[0], soft);
  return scene.world;
}

World random_stack(const WorldOptions& options, bool soft, Random* random) {
  Scene scene(options, random);
  scene.world.add_body(make_floor(0.5));
  for (int i = 0; i < 6; ++i)
    scene.add((*random)() > -0.3 ? Shape(Box{{0.4, 0.3, 0.3}}) : Shape(Sphere{0.15}),
              {0.05 * (*random)(), 0.05 * (*random)(), 0.2 + 0.35 * i});
  if ((*random)() > 0.0) scene.add(Box{{1.0, 1.0, 0.2}}, {2.0, 0.0, 0.2}, BodyType::kKinematic);
  if ((*random)() > 0.0) scene.join(scene.bodies[0], scene.bodies[3], soft);
  return scene.world;
}

/// Planks joined at both corners, so that every second joint is redundant; a ball falls on the
/// bridge.
World random_bridge(const WorldOptions& options, bool, Random* random) {
  Scene scene(options, random);
  BodyId before = kWorldBody;
  Vector3d at = Vector3d::Zero();
  for (int i = 0; i < 6; ++i) {
    Body plank = make_body("plank_" + std::to_string(i), Box{{0.4, 1.0, 0.06}},
                           Setting::mass(random), {0.2 + 0.4 * i, 0.0, 0.0});
    plank.friction = 0.5;
    const BodyId id = scene.world.add_body(plank);
    for (const double y : {-0.5, 0.5})
      scene.world.add_joint(make_joint("joint_" + std::to_string(2 * i + (y > 0.0)), before,
                                       at + Vector3d(0.0, y, 0.0), id, {-0.2, y, 0.0},
                                       JointKind::kBall));
    before = id;
    at = {0.2, 0.0, 0.0};
  }
  for (const double y : {-0.5, 0.5})
    scene.world.add_joint(make_joint(y > 0.0 ? "far" : "near", before, {0.2, y, 0.0}, kWorldBody,
                                     {2.4, y, 0.0}, JointKind::kBall));
  Body ball = make_body("ball", Sphere{0.2}, Setting::mass(random), {1.0, 0.1, 0.5});
  ball.restitution = 0.5;
  scene.world.add_body(ball);
  return scene.world;
}

using MakeWorld = World (*)(const WorldOptions&, bool, Random*);

// In longer steps the ends of a spring may turn about each other by a radian and leave its line.
constexpr double kMostForSprings = 0.005;  // [s]

// Rounding: a few hundred operations a step on sums of the size of the energies.
void expect_no_gain(MakeWorld make, int scenes, bool soft, double tolerance) {
  Random random;
  for (int scene = 0; scene < scenes; ++scene) {
    const Setting setting(&random);
    WorldOptions options = setting.options();
    if (soft) options.time_step = std::min(options.time_step, kMostForSprings);
    World world = make(options, soft, &random);
    double mass = 0.0;
    for (const BodyId id : world.body_ids())
      if (world.body(id).type == BodyType::kDynamic) mass += world.body(id).mass;
    double energy = world.energy();
    double scale = mass * kGravity;
    for (int step = 0; step < 400; ++step) {
      const StepReport& report = world.step();
      ASSERT_FALSE(report.outcome.failed);
      const double booked = report.energy.correction_work + report.energy.driven_work;
      scale = std::max({scale, std::abs(report.energy.total), std::abs(report.energy.driven_work)});
      ASSERT_LE(report.energy.total - energy - booked, tolerance * scale)
          << "scene " << scene << ", step " << step << ", tick " << options.time_step << " s, "
          << setting.iterations << " sweeps";
      energy = report.energy.total;
    }
  }
}

constexpr double kEnergyRounding = 1e-11;

TEST(ImpulseEnergy, NeverRisesInChains) {
  expect_no_gain(random_chain, 60 / kSeedShare, false, kEnergyRounding);
}
TEST(ImpulseEnergy, NeverRisesInNets) {
  expect_no_gain(random_net, 30 / kSeedShare, false, kEnergyRounding);
}
TEST(ImpulseEnergy, NeverRisesInStacks) {
  expect_no_gain(random_stack, 30 / kSeedShare, false, kEnergyRounding);
}
TEST(ImpulseEnergy, NeverRisesInBridges) {
  expect_no_gain(random_bridge, 30 / kSeedShare, false, kEnergyRounding);
}
TEST(ImpulseEnergy, NeverRisesWithSprings) {
  expect_no_gain(random_chain, 60 / kSeedShare, true, kEnergyRounding);
}

// ---- reported work, against closed forms

// A mass of 2 kg hanging 0.1 m too low is lifted by a share of 0.1 of the remaining error in each
// step.
TEST(ImpulseEnergy, CorrectionWorkIsWeightTimesDistance) {
  World world(options(0.01));
  const BodyId bob = world.add_body(make_body("bob", Point{}, 2.0, {0.0, 0.0, -1.1}));
  world.add_joint(hang("rod", bob, rod(1.0)));
  double work = 0.0;
  for (int step = 1; step <= 50; ++step) {
    work += world.step().energy.correction_work;
    EXPECT_NEAR(work, 2.0 * kGravity * 0.1 * (1.0 - std::pow(0.9, step)), 1e-13);
    EXPECT_NEAR(world.report().energy.total, 2.0 * kGravity * world.state(bob).position.z(), 1e-13);
  }
}

TEST(ImpulseEnergy, DrivenWorkIsForceTimesDistance) {
  World pushed(options(0.01));
  const BodyId body = pushed.add_body(make_body("body", Sphere{0.1}, 2.0, Vector3d::Zero()));
  pushed.add_wrench({body, {3.0, 0.0, 4.0}, {0.0, 0.1, 0.0}, 0.0, 1.0});
  double work = 0.0;
  for (int step = 0; step < 100; ++step) work += pushed.step().energy.driven_work;
  const double turned =
      0.5 * 0.1 / (0.4 * 2.0 * 0.01) * 1.01;  // ½ α t (t + h) of explicit velocities
  EXPECT_NEAR(work, Vector3d(3.0, 0.0, 4.0).dot(pushed.state(body).position) + 0.1 * turned, 1e-9);

  World lifted(options(0.01));
  const BodyId bob = lifted.add_body(make_body("bob", Point{}, 2.0, {0.0, 0.0, -1.0}));
  Joint winch = hang("winch", bob);
  winch.motor.bias = -0.2;
  lifted.add_joint(winch);
  Body carrier = make_body("carrier", Point{}, 0.0, {5.0, 0.0, 0.0});
  carrier.type = BodyType::kKinematic;
  carrier.state.linear_velocity = {0.0, 0.0, 0.3};
  const BodyId lift = lifted.add_body(carrier);
  const BodyId load = lifted.add_body(make_body("load", Point{}, 3.0, {5.0, 0.0, -1.0}));
  lifted.add_joint(make_joint("rod", lift, Vector3d::Zero(), load, Vector3d::Zero()));
  work = 0.0;
  for (int step = 0; step < 100; ++step) work += lifted.step().energy.driven_work;
  // the impulse that starts a mass in one step does m v², of which the mass keeps half
  const double starting = 2.0 * 0.2 * 0.2 + 3.0 * 0.3 * 0.3;
  EXPECT_NEAR(work, 2.0 * kGravity * 0.2 + 3.0 * kGravity * 0.3 + starting, 1e-9);
}

TEST(ImpulseEnergy, OfAFreeBodyThatTurnsIsKept) {
  for (const double spin : {0.1, 3.0, 100.0, 1e4}) {
    World world(weightless(0.01));
    Body box = make_body("box", Box{{0.1, 0.4, 0.7}}, 2.0, Vector3d::Zero());
    box.state.orientation = Quaterniond(0.5, 0.1, -0.7, 0.5).normalized();
    box.state.angular_velocity = spin * Vector3d(0.1, 1.0, 0.05);
    world.add_body(box);
    const double energy = world.energy();
    for (int step = 0; step < 3000; ++step) world.step();
    EXPECT_NEAR(world.energy(), energy, 3000 * 9 * kEpsilon * energy)
        << spin;  // roundings of a step
  }
}

// ---- eleven links of 0.1 kg and a load in a vertical line at rest, beside a slack rope

TEST(ImpulseEnergy, HeavyLoadOnLightLinksAtRestIsNotThrown) {
  for (const double h : {0.1, 1.0 / 240.0, 0.001}) {
    for (const double load : {1.0, 100.0, 1e4, 1e6}) {
      for (const Method method : {Method::kAuto, Method::kSequentialImpulses}) {
        WorldOptions chosen = options(h);
        chosen.method = method;
        World world(chosen);
        BodyId before = kWorldBody;
        for (int i = 1; i <= 12; ++i) {
          const std::string number = std::to_string(i);
          const double mass = i < 12 ? 0.1 : load;
          const BodyId link =
              world.add_body(make_body("link_" + number, Point{}, mass, {0.0, 0.0, -0.1 * i}));
          world.add_joint(
              make_joint("rod_" + number, before, Vector3d::Zero(), link, Vector3d::Zero()));
          before = link;
        }
        world.add_joint(
            make_joint("rope", kWorldBody, {1.0, 0.0, 0.0}, before, Vector3d::Zero(), rope(3.0)));
        const double start = world.energy();
        for (int step = 0; step < static_cast<int>(3.0 / h); ++step) {
          ASSERT_FALSE(world.step().outcome.failed);
          ASSERT_LE(world.report().energy.total - start, 1e-9 * load * kGravity * 1.2)
              << h << " " << load;
        }
        // the error that sweeps leave is reported
        const StepReport& report = world.report();
        if (report.joints.max_error > 1e-3) {
          EXPECT_GT(report.contacts.solver_residual, 1e-4) << h << " " << load;
        }
      }
    }
  }
}

// ---- redundant joints

// A plank of 1 kg hangs at rest from two ball joints, which can pull against each other. It is
// stopped from 5 m/s towards one of them; finally each carries half the weight.
TEST(SelfStress, OfAnImpactIsLost) {
  WorldOptions chosen = options(0.002);
  chosen.sleep_after = kInfinity;
  World world(chosen);
  Body plank = make_body("plank", Box{{0.4, 1.0, 0.06}}, 1.0, {0.0, 0.0, -0.2});
  plank.state.linear_velocity = {0.0, 5.0, 0.0};
  const BodyId id = world.add_body(plank);
  for (const double y : {-0.5, 0.5})
    world.add_joint(make_joint(y > 0.0 ? "far" : "near", kWorldBody, {0.0, y, 0.0}, id,
                               {0.0, y, 0.2}, JointKind::kBall));
  world.step();
  double largest = 0.0;
  for (const JointId joint : world.joint_ids())
    largest = std::max(largest, world.joint_state(joint).force);
  EXPECT_GT(largest, 1000.0);  // 5 N s in 2 ms
  run(world, 2500);
  // five seconds are fifty times the time constant of the decay
  for (const JointId joint : world.joint_ids())
    EXPECT_NEAR(world.joint_state(joint).force, 0.5 * kGravity, 1e-9);
}

// Nine planks of 1 kg and two balls of 3 kg together, fallen onto them: about 70 N at each joint,
// also after impacts of 60 kN.
TEST(SelfStress, OfTheShippedBridgeIsLost) {
  World world = shipped("bridge", Method::kSequentialImpulses);
  run(world, 5000);
  const double weight = 12.0 * kGravity;
  for (const JointId joint : world.joint_ids())
    EXPECT_LT(world.joint_state(joint).force, weight) << world.joint(joint).name;
}

}  // namespace
}  // namespace constraint_sim::engine
