// Bounds: beyond them a number is rejected and a step fails, each in bounded time and memory and
// with a reason. No bound is silent.

#include <pthread.h>

#include <ctime>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "memory_peak.h"
#include "sanitized.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

template <class Action>
std::string refusal_of(Action action) {
  try {
    action();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// Returns processor time of this process: others share the processor.
double seconds_since(std::clock_t start) {
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

// ---- numbers

TEST(Bounds, OfNames) {
  World world;
  Body body = make_body(std::string(255, 'a'), Sphere{0.1}, 1.0, Vector3d::Zero());
  EXPECT_NO_THROW(world.add_body(body));
  body.name += "a";
  EXPECT_EQ(refusal_of([&] { world.add_body(body); }),
            "name: must be at most 255 characters, got 256");
  body.name = std::string(1000000, '!');
  EXPECT_LT(refusal_of([&] { world.add_body(body); }).size(), 120u);
}

TEST(Bounds, OfOptions) {
  const auto refused = [](void (*set)(WorldOptions&)) {
    WorldOptions options;
    set(options);
    return refusal_of([&] { validate(options); });
  };
  EXPECT_EQ(refused([](WorldOptions& o) { o.threads = 257; }),
            "threads: must be at most 256, got 257");
  EXPECT_EQ(refused([](WorldOptions& o) { o.iterations = 2147483647; }),
            "iterations: must be at most 10000, got 2147483647");
  EXPECT_EQ(refused([](WorldOptions& o) { o.time_step = 1e10; }),
            "time_step: must be from 1e-12 to 1000000, got 10000000000");
  EXPECT_EQ(refused([](WorldOptions& o) { o.time_step = 1e-13; }),
            "time_step: must be from 1e-12 to 1000000, got 1e-13");
  EXPECT_EQ(refused([](WorldOptions& o) { o.gravity.x() = -1e21; }),
            "gravity: must be at most 1e+20, got (-1e+21, 0, -9.81)");
  EXPECT_EQ(refused([](WorldOptions& o) { o.sleep_after = 1e300; }), "");
  EXPECT_EQ(refused([](WorldOptions& o) {
              o.threads = 256;
              o.iterations = 10000;
              o.time_step = 1e6;
            }),
            "");
}

TEST(Bounds, OfMagnitudes) {
  World world;
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  const auto body = [&](void (*set)(Body&)) {
    Body changed = make_body("new", Sphere{1.0}, 1.0, Vector3d::Zero());
    set(changed);
    return refusal_of([&] { world.add_body(changed); });
  };
  EXPECT_EQ(body([](Body& b) { b.shape = Sphere{1e300}; }),
            "shape.radius: must be from 1e-20 to 1e+20, got 1e+300");
  EXPECT_EQ(body([](Body& b) { b.shape = Sphere{1e-300}; }),
            "shape.radius: must be from 1e-20 to 1e+20, got 1e-300");
  EXPECT_EQ(body([](Body& b) { b.mass = 1e300; }), "mass: must be from 1e-20 to 1e+20, got 1e+300");
  EXPECT_EQ(body([](Body& b) { b.mass = 1e-310; }),
            "mass: must be from 1e-20 to 1e+20, got 9.99999999999997e-311");
  EXPECT_EQ(body([](Body& b) {
              b.inertia = {1.0, 1.0, 1e61};
            }),
            "inertia: must be from 1e-60 to 1e+60, got (1, 1, 1e+61)");
  EXPECT_EQ(body([](Body& b) { b.state.position.y() = -1e300; }),
            "position: must be at most 1e+20, got (0, -1e+300, 0)");
  EXPECT_EQ(body([](Body& b) { b.state.linear_velocity.z() = 1e300; }),
            "linear_velocity: must be at most 1e+20, got (0, 0, 1e+300)");
  EXPECT_EQ(body([](Body& b) { b.state.angular_velocity.z() = 1e300; }),
            "angular_velocity: must be at most 1e+20, got (0, 0, 1e+300)");
  EXPECT_EQ(refusal_of([&] {
              world.add_wrench({ball, {1e300, 0.0, 0.0}, Vector3d::Zero()});
            }),
            "force: must be at most 1e+20, got (1e+300, 0, 0)");
  Joint joint = make_joint("joint", kWorldBody, {0.0, 0.0, 1.0}, ball, Vector3d::Zero(),
                           spring(1.0, 1e300, 0.0));
  EXPECT_EQ(refusal_of([&] { world.add_joint(joint); }),
            "stiffness: must be at most 1e+20, got 1e+300");
  joint.distance = rod(1e-300);
  EXPECT_EQ(refusal_of([&] { world.add_joint(joint); }),
            "length: must be from 1e-20 to 1e+20, got 1e-300");
}

// Accepted input makes steps with finite numbers, or failed steps: all combinations of the ends of
// all ranges, or each fifth.
TEST(Bounds, AcceptNothingWhoseStepsAreNotFinite) {
  const std::vector<double> magnitudes{1e-20, 1.0, 1e20};
  int cases = 0;
  for (const double mass : magnitudes)
    for (const double size : magnitudes)
      for (const double speed : magnitudes)
        for (const double tick : {1e-12, 0.01, 1e6})
          for (const Method method :
               {Method::kAuto, Method::kEnergyMomentum, Method::kSequentialImpulses}) {
            if (cases++ % kSeedShare != 0) continue;
            WorldOptions options;
            options.time_step = tick;
            options.method = method;
            World world(options);
            world.add_body(make_floor(0.5));
            Body box = make_body("box", Box{{size, std::max(0.5 * size, 1e-20), size}}, mass,
                                 {0.0, 0.0, 0.2 * size});
            box.state.linear_velocity = {speed, 0.0, -speed};
            box.state.angular_velocity = {speed, 0.5 * speed, 0.0};
            const BodyId id = world.add_body(box);
            world.add_body(make_body("other", Sphere{size}, 1.0, {0.9 * size, 0.0, size}));
            world.add_joint(make_joint("rod", kWorldBody, {0.0, 0.0, size}, id,
                                       {0.1 * size, 0.0, 0.0}, rod(size)));
            for (int i = 0; i < 3; ++i) {
              const StepReport& report = world.step();
              ASSERT_FALSE(std::isinf(report.local_error));  // NaN where impulses have none
              ASSERT_TRUE(std::isfinite(report.energy.total + report.energy.drift +
                                        report.joints.max_error + report.contacts.max_penetration +
                                        report.energy.projected + world.energy()))
                  << mass << " " << size << " " << speed << " " << tick << " " << name(method);
              ASSERT_EQ(report.outcome.failed, report.outcome.failure != Failure::kNone);
              for (const BodyId body : world.body_ids())
                ASSERT_NO_THROW(validate(world.state(body)));
              const JointState& joint = world.joint_state(world.joint_ids().front());
              ASSERT_TRUE(std::isfinite(joint.error + joint.error_rate + joint.force + joint.bias +
                                        joint.reached_rate));
              for (const Contact& contact : world.contacts())
                ASSERT_TRUE(std::isfinite(contact.normal_force + contact.depth));
            }
          }
}

TEST(Bounds, NameTheBodyThatLeavesThem) {
  World world(options(0.01));
  world.add_body(make_body("slow", Sphere{0.1}, 1.0, {0.0, 0.0, 1.0}));
  const BodyId fast = world.add_body(make_body("fast", Sphere{0.1}, 1.0, {1e20, 0.0, 0.0}));
  BodyState state = world.state(fast);
  state.linear_velocity.x() = 1e20;
  world.set_state(fast, state);
  const StepReport& report = world.step();
  EXPECT_TRUE(report.outcome.failed);
  EXPECT_EQ(report.outcome.failure, Failure::kOutOfRange);
  EXPECT_EQ(report.outcome.failed_body, fast);
  EXPECT_EQ(world.state(fast).position.x(), 1e20);
  EXPECT_NO_THROW(load_scene(save_scene(world)));
}

// ---- time

/// A body that is welded to the world beside its place, with a rod from a point of the body at this
/// distance [m] to another body, or to the world.
World far_rod_on_a_weld(double distance, double inertia, bool is_on_the_world) {
  WorldOptions options;
  options.time_step = 0.01;
  options.method = Method::kEnergyMomentum;
  World world(options);
  Body arm = make_body("arm", Point{}, 0.1, Vector3d::Zero());
  arm.inertia = Vector3d::Constant(inertia);
  if (!is_on_the_world) arm.state.orientation = Eigen::Quaterniond(0.0, 0.6, 0.0, 0.8);
  const BodyId id = world.add_body(arm);
  BodyId other = kWorldBody;
  if (!is_on_the_world) other = world.add_body(make_body("bob", Point{}, 1.0, Vector3d::Zero()));
  DistanceJoint rod;
  rod.length = 1.0;
  const Vector3d end = is_on_the_world ? Vector3d(Vector3d::UnitZ()) : Vector3d(Vector3d::Zero());
  world.add_joint(make_joint("rod", id, {0.0, 0.0, distance}, other, end, rod));
  Joint weld = make_joint("weld", kWorldBody, Vector3d::UnitX(), id, Vector3d::Zero());
  weld.kind = JointKind::kWeld;
  world.add_joint(weld);
  return world;
}

// A saved scene is loaded whatever its world has done: a step fails where an impulse is larger than
// a number of a scene may be.
TEST(Bounds, OfImpulsesEndAStep) {
  World world = far_rod_on_a_weld(1e20, 1.0, false);
  int steps = 0;
  while (steps < 5 && !world.step().outcome.failed) ++steps;
  EXPECT_LT(steps, 5);
  const std::string text = save_scene(world);
  EXPECT_EQ(save_scene(load_scene(text)), text);
}

// A number that follows from bounded numbers may be beyond the bound, and is saved all the same:
// errors of joints far apart, the constant of a gear, and the depth of a contact.
TEST(Bounds, LeaveOutSavedNumbersThatFollowFromOthers) {
  const Vector3d far = Vector3d::Constant(1e20);
  std::vector<World> worlds;
  for (const JointKind kind : {JointKind::kBall, JointKind::kWeld, JointKind::kDistance}) {
    World& world = worlds.emplace_back(options(0.01));
    const BodyId a = world.add_body(make_body("a", Sphere{0.1}, 1.0, far));
    const BodyId b = world.add_body(make_body("b", Sphere{0.1}, 1.0, -far));
    Joint joint = make_joint("joint", a, Vector3d::Zero(), b, Vector3d::Zero(), DistanceJoint{});
    if (kind == JointKind::kDistance) joint.distance.length = 1.0;
    joint.kind = kind;
    world.add_joint(joint);
  }

  World& geared = worlds.emplace_back(options(0.01));
  std::vector<JointId> sliders;
  for (const char* name : {"first", "second"}) {
    const BodyId id = geared.add_body(make_body(name, Sphere{0.1}, 1.0, {0.0, 0.0, 1e10}));
    Joint slider = make_joint(name, kWorldBody, Vector3d::Zero(), id, Vector3d::Zero());
    slider.kind = JointKind::kSlider;
    sliders.push_back(geared.add_joint(slider));
  }
  Joint gear;
  gear.name = "gear";
  gear.kind = JointKind::kGear;
  gear.coupling.first = sliders[0];
  gear.coupling.second = sliders[1];
  gear.coupling.ratio = 1e20;
  geared.add_joint(gear);

  World& touching = worlds.emplace_back(options(1.0));
  Body ground = make_body("ground", Plane{}, 0.0, Vector3d::Zero());
  ground.type = BodyType::kStatic;
  touching.add_body(ground);
  touching.add_body(make_body("ball", Sphere{1e20}, 1.0, {0.0, 0.0, -1e19}));
  EXPECT_FALSE(touching.step().outcome.failed);
  ASSERT_EQ(touching.contacts().size(), 1u);
  EXPECT_GT(touching.contacts()[0].depth, 1e20);

  for (World& world : worlds) {
    for (int k = 0; k < 2; ++k) {
      const std::string text = save_scene(world);
      EXPECT_EQ(save_scene(load_scene(text)), text);
      world.step();
    }
  }
}

// The equations overflow, and a method may keep their factors.
TEST(Bounds, OfEquationsLeaveASnapshotThatIsRead) {
  World world = far_rod_on_a_weld(1e17, 1e-9, true);
  for (int k = 0; k < 3; ++k) {
    world.step();
    EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), world.state_hash());
  }
}

TEST(Bounds, OfTimesThatHaveNoNextTick) {
  World world(options(0.01));
  world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  // the double nearest to 2^53 · 0.01 is a multiple of 0.0156
  EXPECT_EQ(refusal_of([&] { world.set_time(1e14, 0); }),
            "time: a tick of 0.01 s is lost beside a time of 100000000000000 s");
  EXPECT_EQ(refusal_of([&] { world.set_time(-1e14, 0); }).substr(0, 6), "time: ");
  EXPECT_EQ(world.time(), 0.0);
  world.set_time(1e9, 0);
  WorldOptions fine = world.options();
  fine.time_step = 1e-8;
  EXPECT_EQ(refusal_of([&] { world.set_options(fine); }),
            "time_step: a tick of 1e-08 s is lost beside a time of 1000000000 s");
  EXPECT_EQ(world.options().time_step, 0.01);
  EXPECT_FALSE(world.step().outcome.failed);
}

// Doubles beyond 2^46 s are 2^-6 s apart, more than the tick of 0.01 s.
TEST(Bounds, StopTheTimeBeforeATickIsLost) {
  World world(options(0.01));
  world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  world.set_time(std::ldexp(1.0, 46) - 0.05, 0);
  double before = world.time();
  int steps = 0;
  while (!world.step().outcome.failed && ++steps < 100) {
    EXPECT_GT(world.time(), before);
    before = world.time();
  }
  EXPECT_EQ(world.report().outcome.failure, Failure::kNoNextTick);
  EXPECT_LT(steps, 10);
  EXPECT_EQ(world.time(), before);
}

// Times of a saved world are at most 1e20 s, as all numbers are.
TEST(Bounds, StopTheTimeBeforeNumbersThatCannotBeLoaded) {
  World world(options(1e6));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  world.set_time(1e20 - 3e6, 0);
  Wrench wrench;
  wrench.body = ball;
  wrench.start = world.time();
  world.add_wrench(wrench);
  int steps = 0;
  while (!world.step().outcome.failed && ++steps < 100)
    EXPECT_EQ(save_scene(load_scene(save_scene(world))), save_scene(world));
  EXPECT_EQ(world.report().outcome.failure, Failure::kNoNextTick);
  EXPECT_LE(steps, 3);
  EXPECT_LE(world.time(), 1e20);
  EXPECT_EQ(save_scene(load_scene(save_scene(world))), save_scene(world));
  EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), world.state_hash());
}

// ---- work

// Measured: a few tenths of a second each and about 100 MB; 2.7 GB without a bound.
TEST(Bounds, OfContactsEndAStepOfAHeap) {
  const auto start = std::clock();
  const MemoryPeak memory;
  World spheres;
  for (int i = 0; i < 3000; ++i)
    spheres.add_body(make_body("s" + std::to_string(i), Sphere{1.0}, 1.0, Vector3d::Zero()));
  EXPECT_TRUE(spheres.step().outcome.failed);
  EXPECT_EQ(spheres.report().outcome.failure, Failure::kTooManyPairs);
  World boxes;
  for (int i = 0; i < 700; ++i)
    boxes.add_body(
        make_body("b" + std::to_string(i), Box{{1.0, 1.0, 1.0}}, 1.0, {1e-4 * i, 0.0, 1e-5 * i}));
  EXPECT_TRUE(boxes.step().outcome.failed);
  EXPECT_EQ(boxes.report().outcome.failure, Failure::kTooManyContacts);
  EXPECT_EQ(boxes.step_count(), 0u);
  EXPECT_LT(seconds_since(start), 30.0);
  EXPECT_LT(memory.grown_by(), 1e9);
}

// Ten seconds a tick without a bound; with it every body is reported as rejected.
TEST(Bounds, OfSubstepsEndAStepOfBodiesThatTurnTooFast) {
  World world;
  const auto start = std::clock();
  for (int i = 0; i < 100; ++i) {
    Body body = make_body("b" + std::to_string(i), Box{{1.0, 0.6, 0.3}}, 1.0, {3.0 * i, 0.0, 0.0});
    body.state.angular_velocity = Vector3d::Constant(1e6);
    world.add_body(body);
  }
  EXPECT_FALSE(world.step().outcome.failed);
  EXPECT_LT(seconds_since(start), 30.0 * kSanitizedShare);
  for (const Island& island : world.islands()) EXPECT_EQ(island.why, MethodReason::kRefused);
}

// Stages of a substep reach 1e154 here, and their squares overflow. The substep is repeated with a
// shorter one, also where any error is allowed.
TEST(Bounds, OfStagesKeepOrientationsOfUnitLength) {
  const auto expect_unit = [](double tolerance, double speed) {
    WorldOptions options = weightless(1e6);
    options.method = Method::kRungeKutta;
    options.tolerance = tolerance;
    World world(options);
    Body body = make_body("body", Box{{1.0, 0.6, 2.0}}, 0.3, Vector3d::Zero());
    body.inertia = {0.01, 1.84, 1.32};
    body.state.angular_velocity = speed * Vector3d(-0.1, -0.05, 1.0);
    const BodyId id = world.add_body(body);
    EXPECT_FALSE(world.step().outcome.failed) << speed;
    EXPECT_NEAR(world.state(id).orientation.norm(), 1.0, 8 * kEpsilon) << speed;
  };
  for (double speed = 6.0e6; speed < 7.0e6; speed *= 1.01) expect_unit(1e-8, speed);
  expect_unit(0.0, 2.4e6);
}

// The system cannot start so many threads; the work is done nevertheless, with the same bits.
TEST(Bounds, OfThreadsThatCannotBeAreDoneWithout) {
  WorldOptions options;
  options.threads = 256;
  World world(options), alone;
  for (World* each : {&world, &alone})
    for (int i = 0; i < 600; ++i)
      each->add_body(make_body("b" + std::to_string(i), Sphere{0.1}, 1.0, {1.0 * i, 0.0, 0.0}));
  pthread_attr_t attributes;
  ASSERT_EQ(pthread_getattr_default_np(&attributes), 0);
  std::size_t usual = 0;
  ASSERT_EQ(pthread_attr_getstacksize(&attributes, &usual), 0);
  ASSERT_EQ(pthread_attr_setstacksize(&attributes, std::size_t{1} << 46), 0);
  ASSERT_EQ(pthread_setattr_default_np(&attributes), 0);
  EXPECT_FALSE(world.step().outcome.failed);
  ASSERT_EQ(pthread_attr_setstacksize(&attributes, usual), 0);
  ASSERT_EQ(pthread_setattr_default_np(&attributes), 0);
  alone.step();
  for (const BodyId id : world.body_ids())
    EXPECT_EQ(world.state(id).position, alone.state(id).position);
}

// ---- warnings

TEST(Warnings, NameAnInertiaThatNoMassHas) {
  const auto inertia = [](const Vector3d& I) {
    World world;
    Body body = make_body("a", Sphere{1.0}, 1.0, Vector3d::Zero());
    body.inertia = I;
    world.add_body(body);
    return doubtful_settings(world);
  };
  EXPECT_TRUE(inertia({0.0, 0.0, 0.0}).empty());
  EXPECT_TRUE(inertia({1.0, 2.0, 3.0}).empty());  // a plate
  EXPECT_TRUE(inertia({0.1, 0.2, 0.1 + 0.2}).empty());
  ASSERT_EQ(inertia({1.0, 2.0, 4.0}).size(), 1u);
  EXPECT_EQ(inertia({1.0, 2.0, 4.0}).front().rfind("body 'a': inertia (1, 2, 4) is", 0), 0u);
  EXPECT_EQ(inertia({9.0, 2.0, 4.0}).size(), 1u);
  EXPECT_EQ(doubtful_settings(shipped("worked_example")).size(), 2u);
}

}  // namespace
}  // namespace constraint_sim::engine
