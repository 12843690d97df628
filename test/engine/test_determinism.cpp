// Equal steps give equal bits, and the hash covers every bit.

#include <functional>
#include <map>

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Contacts with friction, warm starting, motors, springs, a rope and a ball joint.
World busy_world() {
  World world(options(0.01));
  Body floor = make_floor(0.5);
  floor.restitution = 0.3;
  world.add_body(floor);
  Random random;
  std::vector<BodyId> boxes;
  for (int i = 0; i < 8; ++i) {
    boxes.push_back(world.add_body(make_tumbling_box(i, &random)));
    Body ball = make_body("ball_" + std::to_string(i), Sphere{0.15}, 0.5,
                          {0.3 * i, 1.0 + 0.1 * random(), 1.0});
    ball.friction = 0.3;
    boxes.push_back(world.add_body(ball));
  }
  const Vector3d corner(0.2, 0.15, 0.25);
  Joint driven = make_joint("driven", boxes[0], corner, boxes[2], -corner);
  driven.motor.bias = 0.01;
  driven.motor.amplitude = 0.2;
  driven.motor.frequency = 1.3;
  driven.motor.max_force = 50.0;
  world.add_joint(driven);
  world.add_joint(make_joint("ball", boxes[4], corner, boxes[6], -corner, JointKind::kBall));
  world.add_joint(make_joint("rope", kWorldBody, {0.0, 0.0, 3.0}, boxes[8], corner, rope(2.6)));
  world.add_joint(
      make_joint("spring", boxes[10], corner, boxes[12], corner, spring(0.5, 50.0, 1.0)));
  return world;
}

TEST(Determinism, TwoRunsGiveTheSameHash) {
  World first = busy_world();
  World second = busy_world();
  std::uint32_t contacts = 0;
  for (int step = 0; step < 500; ++step) {
    contacts += first.step().contacts.points;
    second.step();
    ASSERT_EQ(first.state_hash(), second.state_hash()) << step;
  }
  EXPECT_GT(contacts, 1000u);  // enough contacts to be distinguishable
}

TEST(Determinism, CopiesGoOnBitIdentically) {
  World original = busy_world();
  run(original, 100);
  World copy(original);
  World assigned;
  assigned = original;
  World moved = World(original);
  run(original, 200);
  run(copy, 200);
  run(assigned, 200);
  run(moved, 200);
  EXPECT_EQ(copy.state_hash(), original.state_hash());
  EXPECT_EQ(assigned.state_hash(), original.state_hash());
  EXPECT_EQ(moved.state_hash(), original.state_hash());
}

TEST(Determinism, CopiesAreIndependent) {
  World original = busy_world();
  World copy = original;
  const std::uint64_t before = original.state_hash();
  run(copy, 10);
  copy.remove_body(copy.find_body("box_0"));
  EXPECT_EQ(original.state_hash(), before);
  EXPECT_TRUE(original.has_joint("driven"));
}

TEST(Determinism, WatchingChangesNothing) {
  World watched = busy_world();
  World alone = busy_world();
  for (int step = 0; step < 100; ++step) {
    watched.step();
    watched.state_hash();
    watched.energy();
    watched.contacts();
    alone.step();
  }
  EXPECT_EQ(watched.state_hash(), alone.state_hash());
}

TEST(Determinism, GlobalStateIsNone) {
  World alone = busy_world();
  run(alone, 100);
  World first = busy_world();
  World other = busy_world();
  for (int step = 0; step < 100; ++step) {
    first.step();
    other.step();
    other.step();
  }
  EXPECT_EQ(first.state_hash(), alone.state_hash());
}

// ---- the hash

// The order of adding decides the order of rows, and thus the last bits of the motion.
TEST(Hash, SeesTheOrderOfAdding) {
  const auto a = [](World& world) {
    return world.add_body(make_body("a", Sphere{1.0}, 1.0, {0.0, 0.0, 0.0}));
  };
  const auto b = [](World& world) {
    return world.add_body(make_body("b", Sphere{1.0}, 2.0, {3.0, 0.0, 0.0}));
  };
  World first;
  World second;
  const BodyId a_1 = a(first);
  const BodyId b_1 = b(first);
  const BodyId b_2 = b(second);
  const BodyId a_2 = a(second);
  first.add_joint(make_joint("rod", a_1, Vector3d::Zero(), b_1, Vector3d::Zero()));
  first.add_joint(hang("rope", b_1, rope(9.0)));
  second.add_joint(hang("rope", b_2, rope(9.0)));
  second.add_joint(make_joint("rod", a_2, Vector3d::Zero(), b_2, Vector3d::Zero()));
  EXPECT_NE(first.state_hash(), second.state_hash());
}

/// All inputs of a world with one body on one joint, and their modifications.
struct WorldInputs {
  Body body = make_body("body", Box{{1.0, 2.0, 3.0}}, 2.0, {1.1, 1.2, 1.3});
  Body fixture = make_body("fixture", Sphere{1.0}, 2.0, {9.0, 0.0, 0.0});
  Joint joint = make_joint("joint", kWorldBody, {0.1, 0.2, 0.3}, kWorldBody, {0.4, 0.5, 0.6});
  Wrench wrench{{}, {0.1, 0.2, 0.3}, {0.4, 0.5, 0.6}, 2.75, 3.5};
  WorldOptions options;
  double time = 2.5;
  std::uint64_t step = 10;
  bool broken = false;

  WorldInputs() {
    fixture.type = BodyType::kStatic;
    body.inertia = {1.0, 1.5, 2.0};
    body.state.orientation = Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5);
    body.state.linear_velocity = {0.1, 0.2, 0.3};
    body.state.angular_velocity = {0.4, 0.5, 0.6};
    DistanceJoint distance = spring(1.7, 3.0, 0.2);
    distance.min_length = 0.5;
    distance.max_length = 2.5;
    joint.distance = distance;
    joint.motor = {0.1, 0.2, 0.3, 0.4, 5.0, 6.0};
    joint.baumgarte = 0.3;
    joint.break_force = 1000.0;
  }

  DistanceJoint& distance() { return joint.distance; }

  std::uint64_t hash() const {
    World world(options);
    Joint filled = joint;
    filled.body_b = world.add_body(body);
    world.add_body(fixture);
    const JointId id = world.add_joint(filled);
    world.set_broken(id, broken);
    world.set_time(time, step);
    Wrench acting = wrench;
    acting.body = filled.body_b;
    world.add_wrench(acting);
    return world.state_hash();
  }
};

double up(double value) { return std::nextafter(value, kInfinity); }

TEST(Hash, SeesOneUlpInEveryField) {
  std::map<std::string, std::function<void(WorldInputs&)>> changes{
      {"body name", [](WorldInputs& p) { p.body.name = "bodz"; }},
      {"order", [](WorldInputs& p) { p.options.order = 5; }},
      {"gravity", [](WorldInputs& p) { p.options.gravity.x() = up(0.0); }},
      {"time_step", [](WorldInputs& p) { p.options.time_step = up(p.options.time_step); }},
      {"tolerance", [](WorldInputs& p) { p.options.tolerance = up(p.options.tolerance); }},
      {"baumgarte of all", [](WorldInputs& p) { p.options.baumgarte = up(p.options.baumgarte); }},
      {"iterations", [](WorldInputs& p) { ++p.options.iterations; }},
      {"method", [](WorldInputs& p) { p.options.method = Method::kEnergyMomentum; }},
      {"shape",
       [](WorldInputs& p) {
         p.body.shape = Box{{1.0, 2.0, up(3.0)}};
       }},
      {"friction", [](WorldInputs& p) { p.body.friction = up(p.body.friction); }},
      {"restitution", [](WorldInputs& p) { p.body.restitution = up(p.body.restitution); }},
      {"no_collision", [](WorldInputs& p) { p.body.no_collision = true; }},
      {"body type", [](WorldInputs& p) { p.fixture.type = BodyType::kKinematic; }},
      {"mass", [](WorldInputs& p) { p.body.mass = up(p.body.mass); }},
      {"joint name", [](WorldInputs& p) { p.joint.name = "joinu"; }},
      {"joint type",
       [](WorldInputs& p) {
         p.joint.kind = JointKind::kBall;
         p.joint.motor = {};
       }},
      {"length", [](WorldInputs& p) { p.distance().length = up(*p.distance().length); }},
      {"min_length", [](WorldInputs& p) { p.distance().min_length = up(p.distance().min_length); }},
      {"max_length", [](WorldInputs& p) { p.distance().max_length = up(p.distance().max_length); }},
      {"stiffness", [](WorldInputs& p) { p.distance().stiffness = up(p.distance().stiffness); }},
      {"damping", [](WorldInputs& p) { p.distance().damping = up(p.distance().damping); }},
      {"bias", [](WorldInputs& p) { p.joint.motor.bias = up(p.joint.motor.bias); }},
      {"amplitude", [](WorldInputs& p) { p.joint.motor.amplitude = up(p.joint.motor.amplitude); }},
      {"motor frequency",
       [](WorldInputs& p) { p.joint.motor.frequency = up(p.joint.motor.frequency); }},
      {"phase", [](WorldInputs& p) { p.joint.motor.phase = up(p.joint.motor.phase); }},
      {"max_force", [](WorldInputs& p) { p.joint.motor.max_force = up(p.joint.motor.max_force); }},
      {"timeout",
       [](WorldInputs& p) { p.joint.motor.timeout += 2e-15; }},  // an ulp of its end, at 8.5 s
      {"baumgarte", [](WorldInputs& p) { p.joint.baumgarte = up(*p.joint.baumgarte); }},
      {"no baumgarte", [](WorldInputs& p) { p.joint.baumgarte.reset(); }},
      {"break_force", [](WorldInputs& p) { p.joint.break_force = up(p.joint.break_force); }},
      {"collide_connected", [](WorldInputs& p) { p.joint.collide_connected = true; }},
      {"broken", [](WorldInputs& p) { p.broken = true; }},
      {"enabled", [](WorldInputs& p) { p.joint.enabled = false; }},
      {"wrench start", [](WorldInputs& p) { p.wrench.start = up(p.wrench.start); }},
      {"wrench end", [](WorldInputs& p) { p.wrench.end = up(p.wrench.end); }},
      {"no wrench end", [](WorldInputs& p) { p.wrench.end = kInfinity; }},
      {"time", [](WorldInputs& p) { p.time = up(p.time); }},
      {"step", [](WorldInputs& p) { ++p.step; }},
  };
  for (int i = 0; i < 3; ++i) {
    const std::string axis(1, "xyz"[i]);
    const auto raise = [i](Vector3d& v) { v[i] = up(v[i]); };
    changes["inertia." + axis] = [raise](WorldInputs& p) { raise(p.body.inertia); };
    changes["position." + axis] = [raise](WorldInputs& p) { raise(p.body.state.position); };
    changes["linear_velocity." + axis] = [raise](WorldInputs& p) {
      raise(p.body.state.linear_velocity);
    };
    changes["angular_velocity." + axis] = [raise](WorldInputs& p) {
      raise(p.body.state.angular_velocity);
    };
    changes["force." + axis] = [raise](WorldInputs& p) { raise(p.wrench.force); };
    changes["torque." + axis] = [raise](WorldInputs& p) { raise(p.wrench.torque); };
    changes["anchor_a." + axis] = [raise](WorldInputs& p) { raise(p.joint.anchor_a); };
    changes["anchor_b." + axis] = [raise](WorldInputs& p) { raise(p.joint.anchor_b); };
  }
  for (int i = 0; i < 4; ++i)
    changes["orientation[" + std::to_string(i)] = [i](WorldInputs& p) {
      double& q_i = p.body.state.orientation.coeffs()[i];
      q_i = up(q_i);
    };

  std::map<std::uint64_t, std::string> seen{{WorldInputs().hash(), "unchanged"}};
  EXPECT_EQ(WorldInputs().hash(), seen.begin()->first);
  for (const auto& [what, change] : changes) {
    WorldInputs parts;
    change(parts);
    const auto [found, is_new] = seen.emplace(parts.hash(), what);
    EXPECT_TRUE(is_new) << what << " hashes as " << found->second;
  }
}

TEST(Hash, SeesWrenchesByBodyAndInTheirOrder) {
  World world;
  const BodyId a = world.add_body(make_body("a", Sphere{1.0}, 1.0, {0.0, 0.0, 0.0}));
  const BodyId b = world.add_body(make_body("b", Sphere{1.0}, 1.0, {9.0, 0.0, 0.0}));
  const auto hash = [&](const std::vector<std::pair<BodyId, double>>& forces) {
    World pushed = world;
    for (const auto& [body, x] : forces)
      pushed.add_wrench({body, {x, 0.0, 0.0}, Vector3d::Zero(), 0.0, 1.0});
    return pushed.state_hash();
  };
  EXPECT_EQ(hash({{a, 1.0}, {b, 2.0}, {a, 3.0}}), hash({{b, 2.0}, {a, 1.0}, {a, 3.0}}));
  EXPECT_NE(hash({{a, 1.0}}), hash({{b, 1.0}}));
  EXPECT_NE(hash({{a, 1.0}}), world.state_hash());
  EXPECT_NE(hash({{a, 1.0}}), hash({{a, 1.0}, {a, 1.0}}));
  // wrenches of a body are summed in order of addition, which affects rounding
  EXPECT_NE(hash({{a, 1.0}, {a, 3.0}}), hash({{a, 3.0}, {a, 1.0}}));
}

TEST(Hash, SeesNothingOfWrenchesThatAreOver) {
  World pushed = busy_world();
  World alone = busy_world();
  pushed.add_wrench({pushed.find_body("box_0"), Vector3d::Zero(), Vector3d::Zero(), 0.0, 0.1});
  run(pushed, 10);
  run(alone, 10);
  EXPECT_EQ(pushed.state_hash(), alone.state_hash());
}

TEST(Hash, SeesTheMotorsTravel) {
  World world(weightless(0.01));
  const BodyId id = world.add_body(make_body("body", Point{}, 1.0, {1.0, 0.0, 0.0}));
  Joint joint = hang("joint", id, rope(5.0));
  joint.motor.bias = 1e-9;  // slack: only the motor's travel changes
  world.add_joint(joint);
  World still = world;
  still.set_motor(still.find_joint("joint"), {});
  world.step();
  world.set_motor(world.find_joint("joint"), {});
  still.step();
  EXPECT_NE(world.state_hash(), still.state_hash());
}

}  // namespace
}  // namespace constraint_sim::engine
