// Groups of bodies that collide. Oracles: the rule itself for all pairs, and free fall.

#include <set>
#include <utility>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr std::array<Method, 3> kMethods{Method::kAuto, Method::kTimeStepping,
                                         Method::kSequentialImpulses};

WorldOptions options_of(Method method, double gravity = 10.0) {
  WorldOptions options;
  options.method = method;
  options.time_step = 0.01;
  options.gravity = {0.0, 0.0, -gravity};
  return options;
}

/// A ball at rest on a floor.
struct BallOnFloor {
  World world;
  BodyId floor, ball;

  BallOnFloor(Method method, std::uint32_t floor_groups, std::uint32_t ball_mask)
      : world(options_of(method)) {
    Body plane = make_floor(0.5);
    plane.collision_groups = floor_groups;
    floor = world.add_body(plane);
    Body body = make_body("ball", Sphere{0.5}, 1.0, {0.0, 0.0, 0.5});
    body.collision_mask = ball_mask;
    ball = world.add_body(body);
  }
  double z() const { return world.state(ball).position.z(); }
  double speed() const { return world.state(ball).linear_velocity.z(); }
  void set_mask(std::uint32_t mask) {
    Body body = world.body(ball);
    body.collision_mask = mask;
    world.set_body(ball, body);
  }
};

// Balls and boxes of random groups overlap in one heap; those that touch are the pairs that the
// rule names. Bodies without a common group make no pair of the broadphase.
TEST(CollisionGroups, DecideWhichBodiesTouch) {
  Random random;
  const auto bits = [&random] {
    const auto number = static_cast<std::uint32_t>(7.99 * std::abs(random()));
    return number == 0 ? 8u : number;
  };
  int apart = 0, touching = 0;
  for (int scene = 0; scene < 50; ++scene) {
    World world(options_of(Method::kSequentialImpulses, 0.0));
    for (int i = 0; i < 8; ++i) {
      Body body = make_body("body_" + std::to_string(i), Sphere{1.0}, 1.0, 0.2 * random.vector());
      if (i % 3 == 1) body.shape = Box{{2.0, 2.0, 2.0}};
      if (i == 7) body.type = BodyType::kStatic;
      body.collision_groups = bits();
      body.collision_mask = bits();
      world.add_body(body);
    }
    std::set<std::pair<std::string, std::string>> expected, found;
    const std::vector<BodyId> ids = world.body_ids();
    for (std::size_t a = 0; a < ids.size(); ++a)
      for (std::size_t b = a + 1; b < ids.size(); ++b) {
        const Body &first = world.body(ids[a]), &second = world.body(ids[b]);
        if ((first.collision_groups & second.collision_mask) != 0 &&
            (second.collision_groups & first.collision_mask) != 0)
          expected.emplace(first.name, second.name);
        else
          ++apart;
      }
    world.step();
    for (const Contact& contact : world.contacts())
      found.emplace(world.body(contact.body_a).name, world.body(contact.body_b).name);
    EXPECT_EQ(found, expected);
    EXPECT_EQ(world.report().costs.candidate_pairs, expected.size());
    touching += static_cast<int>(expected.size());
  }
  EXPECT_GT(apart, 100);
  EXPECT_GT(touching, 100);
}

TEST(CollisionGroups, LetABodyFallThroughAFloor) {
  for (const Method method : kMethods) {
    BallOnFloor lies(method, 4, kAllGroups), falls(method, 4, ~4u);
    run(lies.world, 100);
    run(falls.world, 100);
    EXPECT_NEAR(lies.z(), 0.5, 1.01 * slop(lies.world));  // impulses leave that much overlap
    EXPECT_NEAR(falls.speed(), -10.0, 1e-12);             // rounding of 100 steps
    EXPECT_TRUE(falls.world.contacts().empty());
    EXPECT_EQ(falls.world.report().costs.candidate_pairs, 0u);
  }
}

TEST(CollisionGroups, ChangeWhileTheWorldRuns) {
  for (const Method method : kMethods) {
    BallOnFloor ball(method, 4, kAllGroups);
    run(ball.world, 200);  // asleep by then
    ball.set_mask(1);
    run(ball.world, 10);
    EXPECT_NEAR(ball.speed(), -1.0, 1e-12);
    BodyState back = ball.world.state(ball.ball);
    back.position.z() = 0.6;
    back.linear_velocity.setZero();
    ball.world.set_state(ball.ball, back);
    ball.set_mask(5);
    run(ball.world, 200);
    EXPECT_NEAR(ball.z(), 0.5, 1.01 * slop(ball.world));
  }
}

// A bullet passes what it does not collide with, and hits what it does, within one step.
TEST(CollisionGroups, HoldForFastBodies) {
  for (const Method method : kMethods) {
    World world(options_of(method, 0.0));
    for (const double x : {1.0, 2.0}) {
      Body wall = make_body(x < 1.5 ? "ghost" : "wall", Box{{0.02, 2.0, 2.0}}, 1.0, {x, 0.0, 0.0});
      wall.type = BodyType::kStatic;
      wall.collision_groups = x < 1.5 ? 2 : 1;
      world.add_body(wall);
    }
    Body bullet = make_body("bullet", Sphere{0.01}, 0.01, Vector3d::Zero());
    bullet.state.linear_velocity = {1000.0, 0.0, 0.0};
    bullet.collision_mask = 1;
    const BodyId id = world.add_body(bullet);
    run(world, 2);
    EXPECT_NEAR(world.state(id).position.x(), 1.98, 1e-4);  // 2 − 0.01 − 0.01
  }
}

// Balls that keep all energy, which events of pairs carry: the second is none of those that the
// first collides with, so the third gets the velocity of the first, and the second stays.
TEST(CollisionGroups, HoldForElasticBalls) {
  for (const Method method : kMethods) {
    World world(options_of(method, 0.0));
    std::vector<BodyId> balls;
    for (int i = 0; i < 3; ++i) {
      Body ball = make_body("ball_" + std::to_string(i), Sphere{0.1}, 1.0, {0.5 * i, 0.0, 0.0});
      ball.restitution = 1.0;
      if (i == 0) ball.state.linear_velocity.x() = 1.0;
      if (i == 1) ball.collision_mask = 2;
      balls.push_back(world.add_body(ball));
    }
    run(world, 150);
    EXPECT_NEAR(world.state(balls[1]).position.x(), 0.5, 1e-12);
    EXPECT_NEAR(world.state(balls[2]).linear_velocity.x(), 1.0, 1e-12);
    EXPECT_NEAR(world.state(balls[0]).linear_velocity.x(), 0.0, 1e-12);
  }
}

/// Adds bodies of all shapes with masses of six decades, some on joints and ropes, that fall onto a
/// floor through the place of other crowds.
void add_crowd(const std::string& name, std::uint32_t group, Random* random, World* world) {
  const int count = 4 + random->below(5);
  BodyId last = kWorldBody;
  for (int i = 0; i < count; ++i) {
    const double size = random->between(0.1, 0.25);
    const Shape shapes[] = {Sphere{size}, Box{{size, 1.5 * size, 2.0 * size}},
                            Cylinder{size, 1.5 * size}, Capsule{0.6 * size, size},
                            Hull({{size, 0.0, -0.7 * size},
                                  {-size, size, -0.7 * size},
                                  {-size, -size, -0.7 * size},
                                  {0.0, 0.0, size}})};
    const auto number = std::to_string(i);
    Body body =
        make_body(name + number, shapes[random->below(5)], std::exp(random->between(-7.0, 7.0)),
                  {0.3 * (*random)(), 0.3 * (*random)(), 0.4 + 0.45 * i});
    body.state.orientation = random->turn();
    body.state.linear_velocity = random->vector();
    body.state.angular_velocity = random->vector();
    body.friction = random->share();
    body.collision_groups = group;
    body.collision_mask = group;
    const BodyId id = world->add_body(body);
    if (i > 0 && random->below(3) == 0) {
      const JointType type =
          random->below(2) == 0 ? JointType(JointKind::kBall) : JointType(rope(0.8));
      world->add_joint(
          make_joint(name + number, last, {0.0, 0.0, 0.2}, id, {0.0, 0.0, -0.25}, type));
    }
    last = id;
  }
}

// Crowds of different groups in one place move as each alone, to the last bit, until a fast body
// hits something: the steps of all fast bodies are divided at each of their hits.
TEST(CollisionGroups, CrowdsInOnePlaceMoveAsEachAlone) {
  Random random;
  int compared = 0;
  for (int scene = 0; scene < 60 / kSeedShare; ++scene) {
    WorldOptions options = options_of(kMethods[static_cast<std::size_t>(scene) % kMethods.size()]);
    options.time_step = 0.002;  // no body moves by a quarter of its size in a step
    std::vector<World> alone(2, World(options));
    World both(options);
    Body floor = make_floor(0.5);
    floor.collision_groups = 3;
    for (World* world : {&alone[0], &alone[1], &both}) world->add_body(floor);
    for (const std::uint32_t group : {1u, 2u}) {
      const std::string name(1, static_cast<char>('a' + group));
      Random again = random;
      add_crowd(name, group, &random, &both);
      add_crowd(name, group, &again, &alone[group - 1]);
    }
    bool any_hit = false;
    for (int step = 0; step < 400 && !any_hit; ++step)
      for (World* world : {&alone[0], &alone[1], &both}) {
        ASSERT_FALSE(world->step().outcome.failed) << "scene " << scene << " step " << step;
        any_hit = any_hit || world->report().contacts.hits > 0;
      }
    if (any_hit) continue;
    ++compared;
    for (const World& world : alone)
      for (const BodyId id : world.body_ids()) {
        const std::string& name = world.body(id).name;
        const BodyState &expected = world.state(id), &found = both.state(both.find_body(name));
        EXPECT_EQ(found.position, expected.position) << "scene " << scene << ' ' << name;
        EXPECT_EQ(found.orientation.coeffs(), expected.orientation.coeffs());
        EXPECT_EQ(found.linear_velocity, expected.linear_velocity);
      }
  }
  EXPECT_GT(compared, 30 / kSeedShare);
}

TEST(CollisionGroups, AreSavedAndHashed) {
  BallOnFloor ball(Method::kAuto, 4, 5);
  run(ball.world, 10);
  const World again = read_snapshot(write_snapshot(ball.world));
  EXPECT_EQ(again.state_hash(), ball.world.state_hash());
  EXPECT_EQ(again.body(ball.ball).collision_mask, 5u);
  const std::string text = save_scene(ball.world);
  const World loaded = load_scene(text);
  EXPECT_EQ(loaded.body(loaded.find_body("ball")).collision_mask, 5u);
  EXPECT_EQ(loaded.body(loaded.find_body("floor")).collision_groups, 4u);
  EXPECT_EQ(save_scene(loaded), text);
  const std::uint64_t hash = ball.world.state_hash();
  ball.set_mask(13);
  EXPECT_NE(ball.world.state_hash(), hash);
}

}  // namespace
}  // namespace constraint_sim::engine
