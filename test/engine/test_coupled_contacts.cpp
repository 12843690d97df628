// Gears, screws, pulleys, constraints and forces of other packages, and joints that close errors,
// beside contacts in one event-driven group. Oracles: closed forms, and the same motion without
// contacts. Errors are rounding, and the tolerance where bodies rotate.

#include "by_events.h"
#include "custom_types.h"
#include "engine/constraints/prescribed.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Joint joint_to(BodyId body, JointKind kind, const char* name, const Vector3d& place) {
  Joint joint;
  joint.name = name;
  joint.kind = kind;
  joint.anchor_a = place;
  joint.body_b = body;
  return joint;
}

Joint coupling(JointKind kind, JointId first, JointId second, double ratio) {
  Joint joint;
  joint.name = "coupling";
  joint.kind = kind;
  joint.coupling.first = first;
  joint.coupling.second = second;
  joint.coupling.ratio = ratio;
  return joint;
}

Joint plugin_joint(const char* type, CustomParameters parameters, BodyId body) {
  Joint joint;
  joint.name = "custom";
  joint.kind = std::string(type) == "test/rod" ? JointKind::kCustom : JointKind::kCustomForce;
  joint.body_b = body;
  joint.custom.type = type;
  joint.custom.parameters = std::move(parameters);
  return joint;
}

/// Steps to a time and returns the events; expects one island by events, and joints that hold.
std::vector<Event> advance_to(World* world, double time) {
  std::vector<Event> all;
  while (world->time() < time - 1e-9) {
    world->step();
    EXPECT_FALSE(is_by_impulses(*world)) << world->time();
    EXPECT_LT(world->report().contacts.max_penetration, 1e-9) << world->time();
    all.insert(all.end(), world->events().begin(), world->events().end());
  }
  return all;
}

/// A load on a slider along x, as a rack, that drives a wheel by a gear.
struct RackAndWheel {
  struct Settings {
    double mass, inertia, ratio, speed;
    double stiffness = 0.0;    ///< spring of the slider [N/m]
    double break_force = 0.0;  ///< break force of the gear [N]
  };
  RackAndWheel(World* world, const Settings& of) {
    Body body = make_body("load", Sphere{0.1}, of.mass, Vector3d::Zero());
    body.state.linear_velocity.x() = of.speed;
    load = world->add_body(body);
    body = make_body("wheel", Sphere{0.1}, 1.0, {0, 2, 5});
    body.inertia = of.inertia * Vector3d::Ones();
    body.state.angular_velocity.z() = -of.speed / of.ratio;
    wheel = world->add_body(body);
    Joint slider = joint_to(load, JointKind::kSlider, "slider", Vector3d::Zero());
    slider.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
    slider.coordinates[0].stiffness = of.stiffness;
    const JointId rack = world->add_joint(slider);
    hinge = world->add_joint(joint_to(wheel, JointKind::kHinge, "hinge", {0, 2, 5}));
    Joint joint = coupling(JointKind::kGear, rack, hinge, of.ratio);
    joint.break_force = of.break_force;
    gear = world->add_joint(joint);
  }
  BodyId load, wheel;
  JointId hinge, gear;
};

class CoupledContactsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, CoupledContactsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

// A ball on a rack drives a wheel and hits a wall: with the wheel it has the mass m + I/ratio².
TEST_P(CoupledContactsAt, ARackHitsAWall) {
  const double mass = 2.0, inertia = 0.05, ratio = 0.2, speed = 3.0, e = 0.5, gap = 0.5;
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {gap + 0.1, 0, 0}, -Vector3d::UnitX(), 0.0, e));
  const RackAndWheel on(&world, {mass, inertia, ratio, speed});
  const std::vector<Event> hits = of_kind(advance_to(&world, 0.5), EventKind::kContactBegan);
  ASSERT_EQ(hits.size(), 1u);
  EXPECT_NEAR(hits[0].time, gap / speed, 10.0 * kTime);
  EXPECT_NEAR(hits[0].impulse, (1.0 + e) * speed * (mass + inertia / (ratio * ratio)), 1e-10);
  const double x = gap - e * speed * (world.time() - gap / speed);
  EXPECT_NEAR(world.state(on.load).position.x(), x, 10.0 * kPlace);
  // 12 rad: whole turns are counted
  EXPECT_NEAR(world.joint_state(on.hinge).coordinates[0].position, -x / ratio, 1e-10);
  EXPECT_LT(std::abs(world.joint_state(on.gear).error), 1e-12);
}

// A nut that falls along its screw, and turns, bounces on the floor: it falls by g m/(m + I/lead²).
TEST_P(CoupledContactsAt, ANutFallsAlongItsScrew) {
  const double mass = 1.0, inertia = 2e-3, pitch = 0.3, e = 0.5, height = 0.4;
  const double lead = pitch / (2.0 * kPi), whole = mass + inertia / (lead * lead);
  World world(by_events(GetParam()));
  world.add_body(make_floor(0.0));
  Body nut = with_surface(make_body("nut", Sphere{0.1}, mass, {0, 0, 0.1 + height}), 0.0, e);
  nut.inertia = inertia * Vector3d::Ones();
  const BodyId id = world.add_body(nut);
  Joint screw = joint_to(id, JointKind::kScrew, "screw", nut.state.position);
  screw.pitch = pitch;
  const JointId joint = world.add_joint(screw);
  const double a = kGravity * mass / whole, lands = std::sqrt(2.0 * height / a), speed = a * lands;
  const double until = lands + e * speed / a;  // at the top
  const std::vector<Event> hits = of_kind(advance_to(&world, until), EventKind::kContactBegan);
  ASSERT_EQ(hits.size(), 1u);
  EXPECT_NEAR(hits[0].time, lands, 1e-9);
  EXPECT_NEAR(hits[0].impulse, (1.0 + e) * speed * whole, 1e-8);
  const double since = world.time() - lands, z = e * speed * since - 0.5 * a * since * since;
  EXPECT_NEAR(world.state(id).position.z(), 0.1 + z, 1e-9);
  EXPECT_NEAR(world.joint_state(joint).coordinates[1].position, (z - height) / lead, 1e-7);
  EXPECT_LT(std::abs(world.joint_state(joint).error), 1e-12);
}

// Two balls on a rope over pulleys. The heavy one lands; where the rope only pulls, the light one
// flies on, falls back and lifts the heavy one off the floor.
TEST_P(CoupledContactsAt, ALoadOfAPulleyLands) {
  const double heavy = 2.0, light = 1.0, drop = 0.3;
  const double a = kGravity * (heavy - light) / (heavy + light);
  const double lands = std::sqrt(2.0 * drop / a), speed = a * lands;
  const double taut = lands + 2.0 * speed / kGravity, lifts = light * speed / (heavy + light);
  for (const bool one_sided : {false, true}) {
    World world(by_events(GetParam()));
    world.add_body(make_floor(0.0));
    const double radius = 0.1, top = 3.0;
    JointId lengths[2];
    BodyId balls[2];
    const double at[2] = {radius + drop, 1.0};
    for (int i = 0; i < 2; ++i) {
      const std::string name = i == 0 ? "heavy" : "light";
      balls[i] = world.add_body(make_body(name, Sphere{radius}, i == 0 ? heavy : light,
                                          Vector3d(2.0 * i - 1.0, 0, at[i])));
      lengths[i] = world.add_joint(joint_to(balls[i], JointKind::kFreeDistance,
                                            (name + "_length").c_str(), {2.0 * i - 1.0, 0, top}));
    }
    Joint rope = coupling(JointKind::kPulley, lengths[0], lengths[1], 1.0);
    rope.coupling.one_sided = one_sided;
    const JointId pulley = world.add_joint(rope);
    const double until = one_sided ? taut + 0.5 * lifts / a : lands + 0.3;
    const std::vector<Event> events = advance_to(&world, until);
    const std::vector<Event> hits = of_kind(events, EventKind::kContactBegan);
    ASSERT_EQ(hits.size(), 1u);
    EXPECT_NEAR(hits[0].time, lands, 1e-10);
    EXPECT_NEAR(hits[0].impulse, speed * (one_sided ? heavy : heavy + light), 1e-9);
    if (!one_sided) {
      EXPECT_NEAR(world.state(balls[0]).position.z(), radius, kPlace);
      EXPECT_NEAR(contact_force_on(world, balls[0]).z(), (heavy - light) * kGravity, 1e-9);
      EXPECT_NEAR(std::abs(world.joint_state(pulley).force), light * kGravity, 1e-9);
      continue;
    }
    const std::vector<Event> pulls = of_kind(events, EventKind::kRopeTaut);
    ASSERT_EQ(pulls.size(), 1u);
    EXPECT_EQ(pulls[0].joint, pulley);
    EXPECT_EQ(pulls[0].coordinate, -1);
    EXPECT_NEAR(pulls[0].time, taut, 1e-9);
    EXPECT_NEAR(pulls[0].impulse, heavy * lifts, 1e-8);
    const double since = world.time() - taut;
    EXPECT_NEAR(world.state(balls[0]).position.z(),
                radius + lifts * since - 0.5 * a * since * since, 1e-9);
  }
}

// A gear breaks with a hinge that an impact of its body overloads; the rack goes on alone.
TEST_P(CoupledContactsAt, AGearBreaksWithItsJoint) {
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {0, 0.6, 0}, -Vector3d::UnitY(), 0.0, 0.0));
  const BodyId ids[2] = {world.add_body(make_body("arm", Sphere{0.1}, 1.0, {1, 0.2, 0})),
                         world.add_body(make_body("wheel", Sphere{0.1}, 1.0, {5, 0, 0}))};
  BodyState state = world.state(ids[0]);
  state.linear_velocity = {0, 2, 0};
  state.angular_velocity = {0, 0, 2};
  Joint arm = joint_to(ids[0], JointKind::kHinge, "arm_hinge", {0, 0.2, 0});
  arm.anchor_b = {-1, 0, 0};
  arm.break_force = 20.0;  // holds the arm on its circle with 4 N
  const JointId hinges[2] = {
      world.add_joint(arm),
      world.add_joint(joint_to(ids[1], JointKind::kHinge, "wheel_hinge", {5, 0, 0}))};
  const JointId gear = world.add_joint(coupling(JointKind::kGear, hinges[0], hinges[1], 1.0));
  world.set_state(ids[0], state);
  state = world.state(ids[1]);
  state.angular_velocity = {0, 0, -2};
  world.set_state(ids[1], state);
  const std::vector<Event> events = advance_to(&world, 0.5);
  const std::vector<Event> breaks = of_kind(events, EventKind::kBroken);
  ASSERT_EQ(breaks.size(), 2u);
  EXPECT_NEAR(breaks[0].time, breaks[1].time, kTime);
  EXPECT_TRUE(world.joint_state(gear).broken);
  EXPECT_TRUE(world.joint_state(hinges[0]).broken);
  EXPECT_FALSE(world.joint_state(hinges[1]).broken);
}

// A gear between a load on a spring and a wheel breaks when its force I/ratio² A ω² sin ω t passes
// its break force, with a floor under the load and without, at every time step alike.
TEST_P(CoupledContactsAt, AGearBreaksByItsForce) {
  const double mass = 2.0, inertia = 0.05, ratio = 0.2, stiffness = 50.0, speed = 0.4;
  const double wheel_mass = inertia / (ratio * ratio);
  const double omega = std::sqrt(stiffness / (mass + wheel_mass)),
               most = wheel_mass * speed * omega;
  for (const bool has_floor : {false, true}) {
    World world(by_events(GetParam(), 0.0));
    if (has_floor) world.add_body(plane("floor", {0, 0, -0.1}, Vector3d::UnitZ(), 0.0, 0.0));
    const RackAndWheel on(&world, {mass, inertia, ratio, speed, stiffness, 0.6 * most});
    const std::vector<Event> breaks = of_kind(advance_to(&world, 0.6), EventKind::kBroken);
    ASSERT_EQ(breaks.size(), 1u) << has_floor;
    EXPECT_NEAR(breaks[0].time, std::asin(0.6) / omega, 1e-8) << has_floor;
    EXPECT_NEAR(world.state(on.wheel).angular_velocity.z(), -0.8 * speed / ratio, 1e-7)
        << has_floor;
  }
}

// ---- other packages

// A bob on a rod of another package hits a wall as on the engine's own.
TEST_P(CoupledContactsAt, ARodOfAnotherPackageActsAsTheOwn) {
  example_types::register_all();
  const auto bob_at_wall = [&](int form) {
    World world(by_events(GetParam()));
    world.add_body(plane("wall", {-0.1, 0, 0}, Vector3d::UnitX(), 0.0, 0.8));
    const BodyId bob =
        world.add_body(make_body("bob", Sphere{0.1}, 1.0, {std::sin(1.0), 0.0, -std::cos(1.0)}));
    world.add_joint(
        form < 2
            ? plugin_joint("test/rod", {{"length", 1.0}, {"squared", double(form)}}, bob)
            : make_joint("rod", kWorldBody, Vector3d::Zero(), bob, Vector3d::Zero(), rod(1.0)));
    EXPECT_FALSE(of_kind(advance_to(&world, 1.5), EventKind::kContactBegan).empty());
    return Vector3d(world.state(bob).position);
  };
  const Vector3d own = bob_at_wall(2);
  for (const int form : {0, 1}) EXPECT_LT((bob_at_wall(form) - own).norm(), 1e-8) << form;
}

// Wind blows a ball against a wall, which then bears it: x = w t − w (m/c) (1 − e^(−c t/m)).
TEST_P(CoupledContactsAt, AForceOfAnotherPackagePushesAgainstAWall) {
  example_types::register_all();
  const double c = 2.0, wind = 3.0, mass = 2.0, gap = 0.5;
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {gap + 0.1, 0, 0}, -Vector3d::UnitX(), 0.0, 0.0));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, mass, Vector3d::Zero()));
  world.add_joint(plugin_joint("test/drag", {{"c", c}, {"wind", wind}}, ball));
  const std::vector<Event> hits = of_kind(advance_to(&world, 2.0), EventKind::kContactBegan);
  double t = 0.5;
  for (int i = 0; i < 50; ++i) {
    const double left = std::exp(-c * t / mass);
    t -= (wind * t - wind * mass / c * (1.0 - left) - gap) / (wind * (1.0 - left));
  }
  ASSERT_EQ(hits.size(), 1u);
  EXPECT_NEAR(hits[0].time, t, 1e-8);
  EXPECT_NEAR(hits[0].impulse, mass * wind * (1.0 - std::exp(-c * t / mass)), 1e-7);
  EXPECT_NEAR(world.state(ball).position.x(), gap, kPlace);
  EXPECT_NEAR(contact_force_on(world, ball).x(), -c * wind, 1e-9);
}

// A function of another package that throws beside a contact ends its step, and nothing has moved.
TEST(CoupledContacts, AFaultOfAnotherPackageIsReported) {
  example_types::register_all();
  World world(by_events(0.01));
  world.add_body(make_floor(0.0));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0, 0, 0.1}));
  const JointId joint =
      world.add_joint(plugin_joint("test/faulty", {{"from", 0.045}, {"throws", 1.0}}, ball));
  run(world, 4);
  EXPECT_FALSE(is_by_impulses(world));
  const BodyState before = world.state(ball);
  EXPECT_EQ(world.step().outcome.failure, Failure::kCustom);
  EXPECT_EQ(world.failed_joint(), joint);
  EXPECT_EQ(world.state(ball).position, before.position);
  world.remove_joint(joint);
  EXPECT_FALSE(world.step().outcome.failed);
}

// ---- joints that close

// A box on a floor whose rod is 1 cm too long closes it by a prescribed motion.
TEST_P(CoupledContactsAt, ARodClosesWhileItsBoxSlides) {
  World world(by_events(GetParam()));
  world.add_body(make_floor(0.0));
  const double off = 0.01;
  const BodyId box =
      world.add_body(make_body("box", Box{{0.2, 0.2, 0.1}}, 1.0, {1.0 + off, 0, 0.05}));
  const JointId closing =
      world.add_joint(make_joint("rod", kWorldBody, {0, 0, 0.05}, box, Vector3d::Zero(), rod(1.0)));
  ASSERT_TRUE(world.joint_state(closing).closing);
  while (world.time() < 2.0 * world.options().closing_time) {
    advance_to(&world, world.time() + world.options().time_step);
    const double left = off * closing_motion(world.time(), world.options().closing_time).value;
    EXPECT_NEAR(world.state(box).position.x(), 1.0 + left, 1e-11) << world.time();
    EXPECT_NEAR(world.state(box).position.z(), 0.05, kPlace);
  }
  EXPECT_FALSE(world.joint_state(closing).closing);
}

// A weld that is added open turns and shifts its box over a rough floor into place.
TEST_P(CoupledContactsAt, AWeldClosesWhileItsBoxRubs) {
  World world(by_events(GetParam()));
  world.add_body(make_floor(0.5));
  Body body = with_surface(make_body("box", Box{{0.2, 0.2, 0.1}}, 1.0, {0.01, 0.02, 0.05}), 0.5, 0);
  body.state.orientation = Eigen::AngleAxisd(0.1, Vector3d::UnitZ());
  const BodyId box = world.add_body(body);
  Joint in_place = joint_to(box, JointKind::kWeld, "weld", {0, 0, 0.05});
  in_place.frame_b = Eigen::Quaterniond::Identity();
  const JointId weld = world.add_joint(in_place);
  ASSERT_TRUE(world.joint_state(weld).closing);
  advance_to(&world, 2.0 * world.options().closing_time);
  EXPECT_FALSE(world.joint_state(weld).closing);
  EXPECT_LT((world.state(box).position - Vector3d(0, 0, 0.05)).norm(), 1e-11);
  EXPECT_LT(world.state(box).orientation.angularDistance(Eigen::Quaterniond::Identity()), 1e-11);
  EXPECT_LT(world.state(box).linear_velocity.norm(), 1e-10);
}

// ---- motors with a position

/// A box in a guide along x and z, with a motor to a position along x.
struct Pushed {
  World world;
  BodyId box;
  JointId guide;
};

Pushed pushed(const Carried& by, double friction, bool has_floor, double force, double to) {
  Pushed made{World(by_events(by)), {}, {}};
  if (has_floor) made.world.add_body(make_floor(friction));
  made.box = made.world.add_body(
      with_surface(make_body("box", Box{{0.2, 0.2, 0.1}}, 2.0, {0, 0, 0.05}), friction, 0.0));
  Joint joint = joint_to(made.box, JointKind::kPlanar, "guide", {0, 0, 0.05});
  joint.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->position = to;
  joint.coordinates[0].motor->max_force = force;
  made.guide = made.world.add_joint(joint);
  return made;
}

// A motor brings a box over a rough floor to its position, by the same motion as in the air; a
// motor that is too weak leaves the box where it is, and is reported as saturated.
TEST_P(CoupledContactsAt, AMotorMovesABoxOverAFloorToItsPosition) {
  for (const double force : {400.0, 5.0}) {
    Pushed in_air = pushed(GetParam(), 0.5, false, 400.0, 0.02);
    Pushed on_floor = pushed(GetParam(), 0.5, true, force, 0.02);
    ASSERT_TRUE(on_floor.world.joint_state(on_floor.guide).closing);
    for (int i = 0; i < 40; ++i) {
      in_air.world.step();
      advance_to(&on_floor.world, in_air.world.time());
      const double x = force > 100.0 ? in_air.world.state(in_air.box).position.x() : 0.0;
      EXPECT_NEAR(on_floor.world.state(on_floor.box).position.x(), x, 1e-9) << i;
    }
    EXPECT_EQ(on_floor.world.joint_state(on_floor.guide).saturated, force < 100.0);
  }
}

// A motor that starts at a limit of its coordinate moves off it by its prescribed motion, as
// without the limit; one that is sent beyond the limit stays, and so does one that is too weak.
TEST_P(CoupledContactsAt, AMotorMovesOffALimit) {
  Pushed free = pushed(GetParam(), 0.0, true, 400.0, 0.02);
  for (const double goal : {0.02, -0.02}) {
    Pushed made = pushed(GetParam(), 0.0, true, 400.0, goal);
    Joint guide = made.world.joint(made.guide);
    made.world.remove_joint(made.guide);
    guide.coordinates[0].lower = 0.0;
    guide.frame_b.reset();
    made.world.add_joint(guide);
    World alone = free.world;
    for (int i = 0; i < 40; ++i) {
      alone.step();
      advance_to(&made.world, alone.time());
      const double x = goal > 0.0 ? alone.state(free.box).position.x() : 0.0;
      EXPECT_NEAR(made.world.state(made.box).position.x(), x, 1e-9) << i;
    }
  }
}

// A load on a platform that a motor moves sticks to it until the platform is faster than μ g, at
// every time step alike.
TEST(CoupledContacts, ALoadSlipsWhenItsPlatformLeavesIt) {
  std::vector<double> ends, slips;
  for (const double time_step : {0.05, 0.01, 0.001}) {
    WorldOptions options = by_events(time_step);
    options.closing_time = 0.1;
    World world(options);
    Body board =
        with_surface(make_body("board", Box{{1.0, 0.4, 0.1}}, 5.0, Vector3d::Zero()), 0.3, 0.0);
    const BodyId platform = world.add_body(board);
    const BodyId load = world.add_body(
        with_surface(make_body("load", Box{{0.1, 0.1, 0.1}}, 1.0, {0, 0, 0.1}), 0.3, 0.0));
    Joint slider = joint_to(platform, JointKind::kSlider, "slider", Vector3d::Zero());
    slider.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
    slider.coordinates[0].motor.emplace();
    slider.coordinates[0].motor->position = 0.05;
    world.add_joint(slider);
    const std::vector<Event> events = advance_to(&world, 0.2);
    ASSERT_FALSE(of_kind(events, EventKind::kSlips).empty()) << time_step;
    slips.push_back(of_kind(events, EventKind::kSlips)[0].time);
    ends.push_back(world.state(load).position.x());
  }
  // a = 60 · 0.05 m · u (1 − u)(1 − 2 u) / T² reaches μ g where u = t/T
  double u = 0.01;
  const double share = 0.3 * kGravity * 0.1 * 0.1 / (60.0 * 0.05);
  for (int i = 0; i < 50; ++i)
    u -= (u * (1.0 - u) * (1.0 - 2.0 * u) - share) / (1.0 - 6.0 * u + 6.0 * u * u);
  for (std::size_t i = 0; i < ends.size(); ++i) {
    EXPECT_NEAR(slips[i], 0.1 * u, 1e-7) << i;
    EXPECT_NEAR(ends[i], ends.back(), 1e-7) << i;
  }
}

// A motor that a wall stops before its position pushes with all its force, and a motor that comes
// free again reaches it.
TEST_P(CoupledContactsAt, AMotorIsStoppedByAWall) {
  Pushed made = pushed(GetParam(), 0.0, true, 30.0, 0.1);
  const BodyId wall =
      made.world.add_body(plane("wall", {0.1 + 0.04, 0, 0}, -Vector3d::UnitX(), 0.0, 0.0));
  advance_to(&made.world, 0.6);
  EXPECT_NEAR(made.world.state(made.box).position.x(), 0.04, 1e-10);
  EXPECT_NEAR(contact_force_on(made.world, made.box).x(), -30.0, 1e-8);
  EXPECT_TRUE(made.world.joint_state(made.guide).saturated);
  made.world.remove_body(wall);
  advance_to(&made.world, 2.0);
  EXPECT_NEAR(made.world.state(made.box).position.x(), 0.1, 1e-8);
  EXPECT_FALSE(made.world.joint_state(made.guide).saturated);
}

}  // namespace
}  // namespace constraint_sim::engine
