// shards: 2
// Random mechanisms of joints of all kinds, with loops, redundant joints, springs, four decades of
// mass, a moving base, laws on free coordinates, and joints added open: joints hold, and the motion
// is the same by each method, far from the origin, rotated, added in another order, and after
// saving and loading. Errors that remain are reported.

#include "constraint_sim/engine/scene.h"
#include "random_joints.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

const int kSeeds = 30 / kSeedShare + 1;
constexpr double kSpan = 0.3;  // few turns of the fastest body, so that errors stay small [s]

/// Parts of a World; body -1 is the world.
struct Mechanism {
  struct Link {
    Joint joint;
    int a, b;
  };
  std::vector<Body> bodies;
  std::vector<Link> links;
  std::vector<Link> couplings;  ///< between links instead of bodies
  Vector3d gravity{0.0, 0.0, -kGravity};

  const BodyState& state(int i) const { return bodies[static_cast<std::size_t>(i)].state; }
};

int below(int n, Random* random) {
  return std::min(n - 1, static_cast<int>(n * 0.5 * ((*random)() + 1.0)));
}

double draw_between(double low, double high, Random* random) {
  return low + 0.5 * ((*random)() + 1.0) * (high - low);
}

/// Returns a rate motor with a timeout, or a position-controlled motor.
Motor rigid_motor(Random* random) {
  Motor motor;
  if (below(2, random) == 0) {
    motor.position = (*random)();
    return motor;
  }
  motor.bias = 2.0 * (*random)();
  motor.amplitude = (*random)();
  motor.frequency = draw_between(0.0, 3.0, random);
  motor.phase = (*random)();
  if (below(2, random) == 0) motor.timeout = draw_between(0.03, 0.2, random);
  return motor;
}

Motor soft_motor(Random* random) {
  Motor motor;
  if (below(2, random) == 0) {
    motor.force = 3.0 * (*random)();
    return motor;
  }
  motor.position = (*random)();
  if (below(2, random) == 0) {
    motor.servo_frequency = draw_between(0.1, 3.0, random);
    motor.servo_damping_ratio = draw_between(0.0, 2.0, random);
  } else {
    motor.servo_stiffness = draw_between(0.1, 50.0, random);
    motor.servo_damping = draw_between(0.0, 2.0, random);
  }
  return motor;
}

/// Returns springs, dampers, forces and servos.
CoordinateLaw draw_soft_law(Random* random) {
  CoordinateLaw law;
  if (below(2, random) == 0) law.position = (*random)();
  law.rest = (*random)();
  switch (below(4, random)) {
    case 0:
      law.frequency = draw_between(0.1, 3.0, random);
      law.damping_ratio = draw_between(0.0, 2.0, random);
      break;
    case 1:
      law.stiffness = draw_between(0.1, 50.0, random);
      law.damping = draw_between(0.0, 2.0, random);
      break;
    case 2:
      law.damping = draw_between(0.0, 2.0, random);
      break;
    default:
      break;
  }
  if (below(2, random) == 0) law.motor = soft_motor(random);
  return law;
}

/// Returns limits, friction, and force-limited motors.
CoordinateLaw one_sided_law(Random* random) {
  CoordinateLaw law = draw_soft_law(random);
  law.position = (*random)();
  if (below(2, random) == 0) law.lower = *law.position - draw_between(0.0, 0.5, random);
  if (below(2, random) == 0) law.upper = *law.position + draw_between(0.01, 0.5, random);
  if (law.is_limited()) law.limit_restitution = std::max(0.0, (*random)());
  if (below(2, random) == 0) law.friction = draw_between(0.0, 2.0, random);
  if (below(2, random) == 0) law.motor = rigid_motor(random);
  if (law.motor && below(2, random) == 0) law.motor->max_force = draw_between(0.1, 10.0, random);
  return law;
}

/// Moves body B so that the joint is open by decimetres, and by any angle where it keeps axes;
/// velocities stay.
void open(const Joint& joint, Random* random, BodyState* b) {
  const Vector3d p = b->position + b->orientation * joint.anchor_b;
  if (forms(joint.kind).alignment != Alignment::kFree) {
    const double angle = joint.kind == JointKind::kUniversal ? 1.5 : 3.0;
    b->orientation = Quaterniond(Eigen::AngleAxisd(angle * (*random)(),
                                                   random->orientation() * Vector3d::UnitZ())) *
                     b->orientation;
  }
  b->position = p + 0.1 * random->vector() - b->orientation * joint.anchor_b;
}

enum class Laws { kNone, kSoft, kMotors, kOneSided };

void add_laws(Laws laws, Random* random, Joint* joint) {
  for (int i = 0; i < info(joint->kind).coordinates; ++i) {
    CoordinateLaw& law = joint->coordinates[static_cast<std::size_t>(i)];
    if (below(3, random) == 0) continue;
    law = laws == Laws::kOneSided ? one_sided_law(random) : draw_soft_law(random);
    if (laws == Laws::kMotors && below(2, random) == 0) law.motor = rigid_motor(random);
  }
}

/// Additions to consistent joints. Motors without force limit and open joints are tested
/// separately, since loops are inconsistent with them.
struct Extras {
  Laws laws = Laws::kNone;
  bool is_open = false;  ///< joints are added open
  bool has_loops = true;
  bool has_couplings = false;  ///< gears between joints with coordinates, and screws
};

JointKind kind_with_coordinates(Random* random) {
  for (;;) {
    const JointKind kind = joint_kinds()[static_cast<std::size_t>(below(14, random))];
    if (info(kind).coordinates > 0) return kind;
  }
}

/// Gears each joint to the next, and sometimes that one to the one after.
void add_couplings(Random* random, Mechanism* made) {
  const int joints = static_cast<int>(made->links.size());
  for (int i = 0; i + 1 < joints && i < 1 + below(3, random); ++i) {
    Mechanism::Link gear;
    gear.joint.name = "gear_" + std::to_string(i);
    gear.joint.kind = JointKind::kGear;
    gear.joint.coupling.ratio =
        (below(2, random) == 0 ? 1.0 : -1.0) * draw_between(0.3, 3.0, random);
    gear.a = i;
    gear.b = i + 1;
    made->couplings.push_back(gear);
  }
}

Mechanism make_mechanism(int seed, const Extras& extras = {}) {
  Random random;
  for (int i = 0; i < 97 * seed; ++i) random();
  Mechanism made;
  const bool has_base = seed % 3 == 0;  // moving; else the world, or none
  const bool is_free = seed % 3 == 1;
  if (has_base) {
    Body base = make_body("base", Box{{0.3, 0.3, 0.3}}, 0.0, random.vector());
    base.type = BodyType::kKinematic;
    base.state = random.state();
    base.no_collision = true;
    made.bodies.push_back(base);
  }
  const int first = static_cast<int>(made.bodies.size());
  const auto add = [&](const Joint& joint, int a, int b) {
    made.links.push_back({joint, a, b});
    made.links.back().joint.name = "joint_" + std::to_string(made.links.size());
  };
  for (int i = 0; i < 5; ++i) {
    Body body =
        make_body("body_" + std::to_string(i), Box{Vector3d::Constant(0.4) + 0.2 * random.vector()},
                  std::pow(10.0, 2.0 * random()), Vector3d::Zero());
    body.no_collision = true;
    body.state = random.state();
    const int parent = i > 0 ? first + below(i, &random) : (has_base ? 0 : -1);
    if (i > 0 || !is_free) {
      const JointKind kind = extras.has_couplings
                                 ? kind_with_coordinates(&random)
                                 : joint_kinds()[static_cast<std::size_t>(below(10, &random))];
      Joint joint = random_joint(kind, &random);
      joint.anchor_a *= 0.5;
      joint.anchor_b *= 0.5;
      body.state = attached(joint, parent < 0 ? BodyState{} : made.state(parent), &random);
      if (kind == JointKind::kDistance && below(2, &random) == 0) joint.distance.stiffness = 50.0;
      if (extras.laws != Laws::kNone) add_laws(extras.laws, &random, &joint);
      if (extras.is_open && below(2, &random) == 0) open(joint, &random, &body.state);
      add(joint, parent, static_cast<int>(made.bodies.size()));
    }
    made.bodies.push_back(body);
  }
  if (extras.has_couplings) add_couplings(&random, &made);
  if (!extras.has_loops) return made;
  // loops that fit the initial poses, and duplicated joints
  for (int i = 0; i < seed % 4; ++i) {
    const int a = first + below(5, &random), b = first + below(5, &random);
    const JointKind kind = joint_kinds()[static_cast<std::size_t>(below(10, &random))];
    if (a == b) continue;
    Joint joint = random_joint(kind, &random);
    const BodyState &of_a = made.state(a), &of_b = made.state(b);
    joint.frame_b = of_b.orientation.conjugate() * of_a.orientation * joint.frame_a *
                    home(forms(kind).alignment);
    const Vector3d p = of_b.position + of_b.orientation * (0.4 * random.vector());
    if (extras.laws != Laws::kNone) add_laws(extras.laws, &random, &joint);
    const Vector3d off = kind == JointKind::kDistance ? Vector3d(0.5, 0.2, 0.3) : Vector3d::Zero();
    joint.anchor_a = of_a.orientation.conjugate() * (p - of_a.position);
    joint.anchor_b = of_b.orientation.conjugate() * (p + off - of_b.position);
    add(joint, a, b);
  }
  if (seed % 2 == 0) add(made.links.back().joint, made.links.back().a, made.links.back().b);
  return made;
}

World make_world(const Mechanism& mechanism, Method method, double h, bool is_reversed = false) {
  WorldOptions chosen;
  chosen.gravity = mechanism.gravity;
  chosen.method = method;
  chosen.time_step = h;
  chosen.tolerance = 1e-10;
  World world(chosen);
  std::vector<BodyId> ids(mechanism.bodies.size());
  const auto in_order = [&](std::size_t n, auto&& apply) {
    for (std::size_t i = 0; i < n; ++i) apply(is_reversed ? n - 1 - i : i);
  };
  in_order(ids.size(), [&](std::size_t i) { ids[i] = world.add_body(mechanism.bodies[i]); });
  in_order(mechanism.links.size(), [&](std::size_t i) {
    const Mechanism::Link& link = mechanism.links[i];
    const auto id = [&](int body) {
      return body < 0 ? kWorldBody : ids[static_cast<std::size_t>(body)];
    };
    Joint joint = link.joint;
    joint.body_a = id(link.a);
    joint.body_b = id(link.b);
    world.add_joint(joint);
  });
  for (const Mechanism::Link& gear : mechanism.couplings) {
    Joint joint = gear.joint;
    const auto named = [&](int link) {
      return world.find_joint(mechanism.links[static_cast<std::size_t>(link)].joint.name);
    };
    joint.coupling.first = named(gear.a);
    joint.coupling.second = named(gear.b);
    world.add_joint(joint);
  }
  return world;
}

Mechanism moved_mechanism(Mechanism mechanism, const Quaterniond& R, const Vector3d& p) {
  for (Body& body : mechanism.bodies) {
    BodyState& state = body.state;
    state = {R * state.position + p, R * state.orientation, R * state.linear_velocity,
             R * state.angular_velocity};
  }
  for (Mechanism::Link& link : mechanism.links) {
    if (link.a >= 0) continue;
    link.joint.anchor_a = R * link.joint.anchor_a + p;
    link.joint.frame_a = R * link.joint.frame_a;
  }
  mechanism.gravity = R * mechanism.gravity;
  return mechanism;
}

/// Returns whether the world reports that bodies were too fast, or that it is inaccurate.
bool is_told(const World& world) {
  return world.report().unresolved_bodies > 0 || world.report().local_error > 1e-8;
}

/// Steps for kSpan. Joints must hold to rounding, of coordinates, and of lengths over small pivots;
/// inconsistent joints must be reported, returned in `told`.
void run_and_check(World* world, const std::string& what, bool* told = nullptr) {
  const int steps = static_cast<int>(std::lround(kSpan / world->options().time_step));
  for (int i = 0; i < steps; ++i) {
    const StepReport& report = world->step();
    ASSERT_FALSE(report.outcome.failed) << what;
    if (told != nullptr) *told = *told || is_told(*world);
    double size = 1.0;
    for (const BodyId id : world->body_ids())
      size = std::max(size, world->state(id).position.cwiseAbs().maxCoeff());
    for (const JointId id : world->joint_ids()) {
      const JointState& state = world->joint_state(id);
      if (world->joint(id).distance.stiffness > 0.0 || state.closing) continue;
      ASSERT_LE(std::abs(state.error), 1e-11 + 1e-12 * size)
          << what << " " << name(world->joint(id).kind) << " step " << i;
      ASSERT_LE(state.angle_error, 1e-9) << what << " " << name(world->joint(id).kind);
    }
  }
}

/// Returns the largest distance of points a metre from the centres [m], with the second world moved
/// back.
double point_difference(const World& a, const World& b,
                        const Quaterniond& R = Quaterniond::Identity(),
                        const Vector3d& p = Vector3d::Zero()) {
  double largest = 0.0;
  for (const BodyId id : a.body_ids()) {
    const BodyState& there = b.state(b.find_body(a.body(id).name));
    const Vector3d x = R.conjugate() * (there.position - p);
    const Quaterniond q = R.conjugate() * there.orientation;
    largest = std::max(
        {largest, (a.state(id).position - x).norm(), a.state(id).orientation.angularDistance(q)});
  }
  return largest;
}

class RandomMechanism : public testing::TestWithParam<int> {};

// Bound: the tolerance is 1e-10 m/s, and mechanisms with four decades of mass amplify an error some
// thousand times within 0.3 s; coordinates of a kilometre are rounded to 1e-13 m, which velocities
// of light bodies amplify too.
TEST_P(RandomMechanism, MovesAlikeHoweverItIsPut) {
  const Mechanism mechanism = make_mechanism(GetParam());
  World world = make_world(mechanism, Method::kRungeKutta, 0.01);
  run_and_check(&world, "as it is");
  if (HasFatalFailure()) return;

  for (const double h : {0.1, 0.001}) {
    World other = make_world(mechanism, Method::kRungeKutta, h);
    run_and_check(&other, "tick " + std::to_string(h));
    EXPECT_LE(point_difference(world, other), 1e-6) << h;
  }
  World reversed = make_world(mechanism, Method::kRungeKutta, 0.01, true);
  run_and_check(&reversed, "reversed");
  EXPECT_LE(point_difference(world, reversed), 1e-6);

  const Quaterniond R = Quaterniond(0.3, -0.5, 0.7, 0.4).normalized();
  const Vector3d p(1000.0, -500.0, 300.0);
  World far = make_world(moved_mechanism(mechanism, R, p), Method::kRungeKutta, 0.01);
  run_and_check(&far, "far");
  EXPECT_LE(point_difference(world, far, R, p), 1e-6);
}

// Order 4 at 1/1000 s, with bodies that light links move much faster than themselves.
TEST_P(RandomMechanism, MovesAlikeByGradients) {
  const Mechanism mechanism = make_mechanism(GetParam());
  World world = make_world(mechanism, Method::kRungeKutta, 0.01);
  World other = make_world(mechanism, Method::kEnergyMomentum, 0.001);
  run_and_check(&world, "runge_kutta");
  run_and_check(&other, "energy_momentum");
  if (HasFatalFailure()) return;
  EXPECT_LE(point_difference(world, other), 1e-5);
}

// Motors, forces and springs amplify errors more than gravity does.
TEST_P(RandomMechanism, MovesAlikeWithLaws) {
  for (const Extras& extras :
       {Extras{Laws::kSoft}, {Laws::kMotors, false, false}, {Laws::kMotors, true, false}}) {
    const Mechanism mechanism = make_mechanism(GetParam(), extras);
    World world = make_world(mechanism, Method::kRungeKutta, 0.01);
    World other = make_world(mechanism, Method::kRungeKutta, 0.1);
    World reversed = make_world(mechanism, Method::kRungeKutta, 0.01, true);
    run_and_check(&world, "as it is");
    run_and_check(&other, "tick 0.1");
    run_and_check(&reversed, "reversed");
    if (HasFatalFailure()) return;
    EXPECT_LE(point_difference(world, other), 1e-6);
    EXPECT_LE(point_difference(world, reversed), 1e-6);
  }
}

// Gears between joints of the tree; loops of gears may lock them.
TEST_P(RandomMechanism, MovesAlikeWithCouplings) {
  for (const Laws laws : {Laws::kNone, Laws::kSoft}) {
    const Mechanism mechanism = make_mechanism(GetParam(), {laws, false, false, true});
    World world = make_world(mechanism, Method::kRungeKutta, 0.01);
    World other = make_world(mechanism, Method::kRungeKutta, 0.1);
    World reversed = make_world(mechanism, Method::kRungeKutta, 0.01, true);
    World gradients = make_world(mechanism, Method::kEnergyMomentum, 0.001);
    const Quaterniond R = Quaterniond(0.3, -0.5, 0.7, 0.4).normalized();
    const Vector3d p(1000.0, -500.0, 300.0);
    World far = make_world(moved_mechanism(mechanism, R, p), Method::kRungeKutta, 0.01);
    run_and_check(&world, "as it is");
    run_and_check(&other, "tick 0.1");
    run_and_check(&reversed, "reversed");
    bool is_gradients_told = false;
    run_and_check(&gradients, "energy_momentum", &is_gradients_told);
    run_and_check(&far, "far");
    if (HasFatalFailure()) return;
    EXPECT_LE(point_difference(world, other), 1e-6);
    EXPECT_LE(point_difference(world, reversed), 1e-6);
    EXPECT_TRUE(is_gradients_told || point_difference(world, gradients) <= 1e-4);
    EXPECT_LE(point_difference(world, far, R, p), 1e-6);
  }
}

TEST_P(RandomMechanism, GoesOnFromWhatWasSaved) {
  for (const auto& [method, extras] :
       {std::pair(Method::kAuto, Extras{}),
        {Method::kSequentialImpulses, Extras{}},
        {Method::kAuto, Extras{Laws::kMotors, true, false}},
        {Method::kSequentialImpulses, Extras{Laws::kOneSided, true, true}}}) {
    World world = make_world(make_mechanism(GetParam(), extras), method, 0.01);
    for (int i = 0; i < 10; ++i) world.step();
    World loaded = load_scene(save_scene(world), "saved");
    EXPECT_EQ(save_scene(loaded), save_scene(world));
    for (int i = 0; i < 20; ++i) {
      world.step();
      loaded.step();
    }
    if (method == Method::kSequentialImpulses)
      EXPECT_EQ(world.state_hash(), loaded.state_hash());
    else
      EXPECT_LE(point_difference(world, loaded), 1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomMechanism, testing::Range(1, kSeeds + 1));

}  // namespace
}  // namespace constraint_sim::engine
