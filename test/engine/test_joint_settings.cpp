// Settings changed while a joint exists: whether it is enabled, laws, lengths, and motors with
// timeouts on every coordinate.

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/model/joint_data.h"
#include "random_joints.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr std::array<Method, 3> kTestedMethods{Method::kRungeKutta, Method::kEnergyMomentum,
                                               Method::kSequentialImpulses};

/// Two boxes in free space, in a consistent joint of this kind.
World pair(JointKind kind, Method method, double h, bool enabled = true) {
  Random random;
  WorldOptions chosen = weightless(h);
  chosen.method = method;
  chosen.tolerance = 1e-11;
  Joint joint = random_joint(kind, &random);
  joint.anchor_a *= 0.3;
  joint.anchor_b *= 0.3;
  joint.enabled = enabled;
  Body a = make_body("a", Box{{0.3, 0.5, 0.9}}, 2.0, Vector3d::Zero());
  Body b = make_body("b", Box{{0.8, 0.2, 0.4}}, 3.0, Vector3d::Zero());
  a.state = random.state();
  b.state = attached(joint, a.state, &random);
  a.no_collision = b.no_collision = true;
  World world(chosen);
  joint.body_a = world.add_body(a);
  joint.body_b = world.add_body(b);
  world.add_joint(joint);
  return world;
}

bool are_equal(const World& a, const World& b) {
  for (const BodyId id : a.body_ids()) {
    const BodyState& x = a.state(id);
    const BodyState& y = b.state(b.find_body(a.body(id).name));
    if (x.position != y.position || x.orientation.coeffs() != y.orientation.coeffs() ||
        x.linear_velocity != y.linear_velocity || x.angular_velocity != y.angular_velocity)
      return false;
  }
  return true;
}

TEST(DisabledJoint, DoesNotAct) {
  for (const Method method : kTestedMethods) {
    World world = pair(JointKind::kHinge, method, 0.01, false);
    World without = pair(JointKind::kHinge, method, 0.01);
    without.remove_joint(without.joint_ids().front());
    run(world, 20);
    run(without, 20);
    EXPECT_TRUE(are_equal(world, without)) << name(method);
    EXPECT_EQ(world.islands().size(), 2u);
    EXPECT_EQ(world.report().joints.max_error, 0.0);
    const JointId id = world.joint_ids().front();
    EXPECT_EQ(world.joint_wrench(id).force, Vector3d(Vector3d::Zero()));
    EXPECT_TRUE(world.unclosed_joints().empty());
    EXPECT_NE(explain(world).find("disabled: 1"), std::string::npos);
  }
}

TEST(DisabledJoint, HasNoEnergyAndLetsItsBodiesTouch) {
  World world(weightless(0.01));
  const BodyId a = world.add_body(make_body("a", Sphere{0.5}, 1.0, Vector3d::Zero()));
  const BodyId b = world.add_body(make_body("b", Sphere{0.5}, 1.0, {0.9, 0.0, 0.0}));
  const JointId id =
      world.add_joint(make_joint("s", a, Vector3d::Zero(), b, Vector3d::Zero(), spring(2, 50, 0)));
  EXPECT_DOUBLE_EQ(world.energy(), 0.5 * 50.0 * 1.1 * 1.1);
  world.step();
  EXPECT_TRUE(world.contacts().empty());
  world.set_enabled(id, false);
  world.step();
  EXPECT_FALSE(world.contacts().empty());
  world.reset();
  world.set_enabled(id, false);
  EXPECT_EQ(world.energy(), 0.0);
}

class EnabledJoint : public testing::TestWithParam<JointKind> {};

// A joint that opened during 0.1 s closes from the present poses: finally joints hold to the
// rounding of their coordinates, and free bodies have kept their momenta (by energy_momentum: to
// Newton's tolerance over 60 steps; a ball joint closes by offsets that keep only the linear one).
TEST_P(EnabledJoint, ClosesWhatHasOpened) {
  for (const Method method : kTestedMethods) {
    World world = pair(GetParam(), method, 0.01);
    const JointId id = world.joint_ids().front();
    run(world, 10);
    const double error = world.joint_state(id).error;
    world.set_enabled(id, false);
    run(world, 10);
    EXPECT_EQ(world.joint_state(id).error, error) << "is not looked at meanwhile";
    world.set_enabled(id, true);
    EXPECT_TRUE(world.joint_state(id).closing) << name(method);
    EXPECT_GT(world.joint_state(id).error, 1e-4) << name(method);
    EXPECT_NE(text_of_opening(world, id).find("closes"), std::string::npos);
    const BodyState before = world.state(world.find_body("b"));
    world.step();
    const BodyState after = world.state(world.find_body("b"));
    EXPECT_LE((after.position - before.position).norm(), 0.2) << "bodies never jump";
    const Vector3d p = momentum(world);
    run(world, method == Method::kSequentialImpulses ? 400 : 60);
    EXPECT_LE((momentum(world) - p).norm(), 1e-10) << name(method);
    // impulses remove a tenth of the error a step, and leave a first-order error by the bodies'
    // motion
    const double allowed = method == Method::kSequentialImpulses ? 5e-3 : 1e-12;
    EXPECT_LE(world.joint_state(id).error, allowed) << name(method);
    if (method != Method::kSequentialImpulses) {
      EXPECT_FALSE(world.joint_state(id).closing);
      EXPECT_EQ(text_of_opening(world, id), "");
    }
  }
}

std::vector<JointKind> kinds_with_rows() {
  std::vector<JointKind> kinds;
  for (const JointKind kind : joint_kinds())
    if (forms(kind).rows > 0) kinds.push_back(kind);
  return kinds;
}

INSTANTIATE_TEST_SUITE_P(Kinds, EnabledJoint, testing::ValuesIn(kinds_with_rows()),
                         [](const auto& kind) { return std::string(name(kind.param)); });

TEST(DisabledJoint, IsSavedHashedAndReset) {
  World world = pair(JointKind::kSlider, Method::kRungeKutta, 0.01);
  const JointId id = world.joint_ids().front();
  const std::uint64_t before = world.state_hash();
  world.set_enabled(id, true);
  EXPECT_EQ(world.state_hash(), before) << "nothing has changed";
  world.set_enabled(id, false);
  EXPECT_NE(world.state_hash(), before);
  const std::string saved = save_scene(world);
  EXPECT_NE(saved.find("enabled: false"), std::string::npos);
  World loaded = load_scene(saved, "saved");
  EXPECT_FALSE(loaded.joint(loaded.joint_ids().front()).enabled);
  EXPECT_EQ(save_scene(loaded), saved);
  run(world, 10);
  run(loaded, 10);
  EXPECT_EQ(world.state_hash(), loaded.state_hash());
  loaded.set_enabled(loaded.joint_ids().front(), true);
  loaded.reset();
  EXPECT_FALSE(loaded.joint(loaded.joint_ids().front()).enabled) << "as it was loaded";
  world.reset();
  EXPECT_TRUE(world.joint(id).enabled) << "as it was added";
}

// A rate motor continues from the present coordinate, not from where it would have been.
TEST(EnabledJoint, ItsMotorStartsFromHere) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    World world = pair(JointKind::kHinge, method, 0.01);
    const JointId id = world.joint_ids().front();
    Motor motor;
    motor.bias = 0.5;
    world.set_motor(id, 0, motor);
    run(world, 10);
    world.set_enabled(id, false);
    run(world, 10);
    world.set_enabled(id, true);
    const CoordinateState& angle = world.joint_state(id).coordinates[0];
    EXPECT_EQ(angle.held, angle.position);
    const double start = angle.position;
    run(world, 60);
    EXPECT_NEAR(angle.position, start + 0.3, 1e-12) << name(method);
  }
}

// ---- timeouts of all coordinates

/// A box on a cylindrical joint along and about z, both driven, with timeouts that are no multiples
/// of a tick.
World driven_box(Method method, double h) {
  WorldOptions chosen = weightless(h);
  chosen.method = method;
  World world(chosen);
  const BodyId box = world.add_body(make_body("box", Box{{0.3, 0.5, 0.9}}, 2.0, Vector3d::Zero()));
  Joint joint = hang("rod", box, JointKind::kCylindrical);
  const std::array<std::pair<double, double>, 2> motors{{{0.7, 0.123}, {-1.3, 0.0777}}};
  for (std::size_t i = 0; i < 2; ++i) {
    Motor& motor = joint.coordinates[i].motor.emplace();
    motor.bias = motors[i].first;
    motor.timeout = motors[i].second;
  }
  world.add_joint(joint);
  return world;
}

// The coordinate is bias · timeout to rounding, at any tick; by impulses within the sweeps'
// residual.
TEST(Timeouts, OfEachCoordinateEndInTime) {
  for (const Method method : kTestedMethods) {
    for (const double h : {0.05, 0.01, 0.003}) {
      World world = driven_box(method, h);
      run(world, static_cast<int>(std::lround(0.3 / h)));
      const JointState& state = world.joint_state(world.joint_ids().front());
      const double allowed = method == Method::kSequentialImpulses ? 1e-6 : 1e-13;
      EXPECT_NEAR(state.coordinates[0].position, 0.7 * 0.123, allowed) << name(method) << h;
      EXPECT_NEAR(state.coordinates[1].position, -1.3 * 0.0777, allowed) << name(method) << h;
      EXPECT_NEAR(state.coordinates[1].velocity, 0.0, 1e-6) << name(method) << h;
    }
  }
}

TEST(Timeouts, OfEachCoordinateAreSavedMovedAndSetApart) {
  World world = driven_box(Method::kRungeKutta, 0.01);
  run(world, 3);
  World loaded = load_scene(save_scene(world), "saved");
  EXPECT_EQ(save_scene(loaded), save_scene(world));
  loaded.set_time(100.0, 7);
  Motor motor = *world.joint(world.joint_ids().front()).coordinates[1].motor;
  motor.timeout = 0.05;  // counts from now and stops this coordinate only
  world.set_motor(world.joint_ids().front(), 1, motor);
  run(world, 20);
  run(loaded, 20);
  const auto position = [](const World& w, std::size_t i) {
    return w.joint_state(w.joint_ids().front()).coordinates[i].position;
  };
  for (const World* w : {&world, &loaded}) EXPECT_NEAR(position(*w, 0), 0.7 * 0.123, 1e-12);
  EXPECT_NEAR(position(loaded, 1), -1.3 * 0.0777, 1e-12);
  EXPECT_NEAR(position(world, 1), -1.3 * 0.08, 1e-12);
}

// ---- changes while a joint acts

TEST(SetJoint, ChangesLengthsAndSprings) {
  World world(weightless(0.01));
  WorldOptions chosen = world.options();
  chosen.method = Method::kRungeKutta;
  world.set_options(chosen);
  const BodyId bob = world.add_body(make_body("bob", Point{}, 2.0, {1.0, 0.0, 0.0}));
  const JointId id = world.add_joint(hang("rod", bob));
  Joint joint = world.joint(id);
  joint.distance.length = 1.5;
  world.set_joint(id, joint);
  EXPECT_EQ(text_of_opening(world, id), "length 0.5 m off; closes in 0.5 s");
  run(world, 60);
  EXPECT_NEAR(world.state(bob).position.norm(), 1.5, 1e-14);
  joint = world.joint(id);
  joint.distance.frequency = 2.0;
  world.set_joint(id, joint);
  const double omega = 4.0 * kPi;
  EXPECT_NEAR(world.joint(id).distance.stiffness, 2.0 * omega * omega, 1e-9);
  joint = world.joint(id);
  joint.distance.frequency = 1.0;  // replaces the stiffness from the previous frequency
  world.set_joint(id, joint);
  EXPECT_NEAR(world.joint(id).distance.stiffness, 0.5 * omega * omega, 1e-9);
}

/// A ball on a rod that is 0.5 m too long, after 20 steps of closing.
World closing_rod(Method method) {
  WorldOptions chosen = weightless(0.01);
  chosen.method = method;
  World world(chosen);
  Body ball = make_body("ball", Sphere{0.1}, 2.0, {2.0, 0.0, 0.0});
  ball.state.linear_velocity = {0.0, 0.3, 0.0};
  world.add_joint(hang("rod", world.add_body(ball), rod(1.5)));
  run(world, 20);
  return world;
}

Joint soft(Joint joint) {
  joint.distance.stiffness = 20.0;
  joint.distance.damping = 1.0;
  return joint;
}

// Oracle: a spring that was added to the moving bodies. A spring closes nothing, so its force must
// not follow the motion by which the rod would have closed.
TEST(SetJoint, MakesASpringOfAClosingRod) {
  for (std::size_t m = 0; m < kMethodCount; ++m) {
    const auto method = static_cast<Method>(m);
    World world = closing_rod(method);
    const JointId id = world.joint_ids().front();
    const BodyId ball = world.body_ids().front();
    world.set_state(ball, world.state(ball));  // without the corrections of the last step
    ASSERT_TRUE(world.joint_state(id).closing) << name(method);
    World added = world;
    world.set_joint(id, soft(world.joint(id)));
    EXPECT_FALSE(world.joint_state(id).closing) << name(method);
    const std::string text = save_scene(world);
    EXPECT_EQ(save_scene(load_scene(text)), text) << name(method);
    added.remove_joint(id);
    added.add_joint(soft(hang("rod", ball, rod(1.5))));
    run(world, 50);
    run(added, 50);
    EXPECT_TRUE(are_equal(world, added)) << name(method);
    // and a rod again, which closes the error that it then has
    world.set_joint(id, hang("rod", ball, rod(1.5)));
    EXPECT_TRUE(world.joint_state(id).closing) << name(method);
    EXPECT_EQ(joint_data(world, id).to_close.since, world.time()) << name(method);
  }
}

// A reset returns to the saved state of a joint only with the length and the law of that state.
TEST(SetJoint, LeavesNothingOfASavedStateToAReset) {
  World loaded = load_scene(save_scene(closing_rod(Method::kRungeKutta)));
  const JointId id = loaded.joint_ids().front();
  World resized = loaded;
  loaded.set_joint(id, soft(loaded.joint(id)));
  loaded.reset();
  EXPECT_FALSE(loaded.joint_state(id).closing);
  Joint joint = resized.joint(id);
  joint.distance.length = 1.2;
  resized.set_joint(id, joint);
  resized.reset();
  EXPECT_EQ(joint_data(resized, id).to_close.since, resized.time());
  EXPECT_EQ(joint_data(resized, id).to_close.offset[0],
            resized.state(resized.body_ids().front()).position.norm() - 1.2);
  for (const World& world : {loaded, resized}) {
    const std::string text = save_scene(world);
    EXPECT_EQ(save_scene(load_scene(text)), text);
  }
}

// A reset joint of a saved scene turns angles into distances by the inertia of its bodies as it is.
TEST(SetBody, ChangesTheErrorOfASavedJointThatIsReset) {
  World world(weightless(0.01));
  const BodyId box = world.add_body(make_body("box", Box{{0.2, 0.2, 0.2}}, 1.0, Vector3d::Zero()));
  Joint weld = hang("weld", box, JointKind::kWeld);
  weld.frame_a = Eigen::AngleAxisd(0.1, Vector3d::UnitX());
  weld.frame_b = Eigen::Quaterniond::Identity();
  const JointId id = world.add_joint(weld);
  world.step();
  World loaded = load_scene(save_scene(world));
  Body heavy = loaded.body(box);
  heavy.inertia = {4.0, 4.0, 4.0};
  for (World* changed : {&world, &loaded}) {
    changed->set_body(box, heavy);
    changed->reset();
  }
  EXPECT_EQ(loaded.joint_state(id).radius, 2.0);  // sqrt(4 kg m^2 / 1 kg)
  EXPECT_EQ(world.joint_state(id).radius, 2.0);
}

// A motor of a kind without length and coordinates has no end, which no scene could keep.
TEST(SetMotor, GivesNoEndToAWeld) {
  Motor motor;
  motor.timeout = 1.5;
  for (const bool by_settings : {false, true}) {
    World world = pair(JointKind::kWeld, Method::kRungeKutta, 0.01);
    const JointId id = world.joint_ids().front();
    Joint joint = world.joint(id);
    joint.motor = motor;
    by_settings ? world.set_joint(id, joint) : world.set_motor(id, motor);
    EXPECT_EQ(world.joint_state(id).expires_at, kInfinity);
    const std::string saved = save_scene(world);
    EXPECT_EQ(save_scene(load_scene(saved)), saved);
  }
}

// Fields that a kind does not use may hold anything: they are neither kept nor compared.
TEST(SetJoint, IgnoresFieldsOfOtherKinds) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t k = 0; k < kJointKindCount; ++k) {
    const auto kind = static_cast<JointKind>(k);
    if (info(kind).is_custom || info(kind).couples_joints) continue;
    World world = pair(kind, Method::kRungeKutta, 0.01);
    const Joint plain = world.joint(world.joint_ids().front());
    world.remove_joint(world.joint_ids().front());
    Joint joint = plain;
    joint.coupling.ratio = kNone;
    if (!info(kind).has_pitch) joint.pitch = kNone;
    joint.custom = {"none", {{"k", kNone}}, {}};
    if (if_distance(joint) == nullptr) joint.distance.stiffness = kNone;
    const JointId id = world.add_joint(joint);
    joint = world.joint(id);
    joint.coupling.ratio = kNone;
    if (if_distance(joint) == nullptr) joint.distance.damping = kNone;
    world.set_joint(id, joint);
    const World read = read_snapshot(write_snapshot(world));
    EXPECT_EQ(read.state_hash(), world.state_hash()) << name(kind);
    if (info(kind).coordinates == static_cast<int>(kMaxCoordinates)) continue;
    joint = plain;
    joint.name = "other";
    joint.coordinates.back().rest = kNone;
    EXPECT_THROW(world.add_joint(joint), std::invalid_argument) << name(kind);
    EXPECT_THROW(world.set_joint(id, joint), std::invalid_argument) << name(kind);
  }
}

// The laws of one coordinate leave the others, and their timeouts, unchanged.
TEST(SetJoint, ChangesLawsApart) {
  World world = driven_box(Method::kRungeKutta, 0.01);
  const JointId id = world.joint_ids().front();
  run(world, 3);
  Joint joint = world.joint(id);
  joint.coordinates[1].motor.reset();
  joint.coordinates[1].stiffness = 50.0;
  joint.break_torque = 1e6;
  world.set_joint(id, joint);
  EXPECT_EQ(world.joint(id).break_torque, 1e6);
  run(world, 27);
  EXPECT_NEAR(world.joint_state(id).coordinates[0].position, 0.7 * 0.123, 1e-12);
  EXPECT_FALSE(world.joint(id).coordinates[1].motor);
  EXPECT_NE(world.joint_state(id).coordinates[1].velocity, 0.0);
}

TEST(SetJoint, RefusesWhatCannotBe) {
  World world = driven_box(Method::kRungeKutta, 0.01);
  const JointId id = world.joint_ids().front();
  const std::uint64_t before = world.state_hash();
  const auto refused = [&](const std::string& field, auto change) {
    Joint joint = world.joint(id);
    change(joint);
    try {
      world.set_joint(id, joint);
      ADD_FAILURE() << field << " was accepted";
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).find(field), 0u) << error.what();
    }
    EXPECT_EQ(world.state_hash(), before);
  };
  refused("name", [](Joint& j) { j.name = "other"; });
  refused("type", [](Joint& j) { j.kind = JointKind::kSlider; });
  refused("body_a", [](Joint& j) { j.body_a = j.body_b; });
  refused("anchor_b", [](Joint& j) { j.anchor_b.x() = 1.0; });
  refused("frame_b", [](Joint& j) { j.frame_b.reset(); });
  refused("upper", [](Joint& j) {
    j.coordinates[0].lower = 1.0;
    j.coordinates[0].upper = -1.0;
  });
  refused("friction", [](Joint& j) { j.coordinates[1].friction = kNaN; });
  refused("break_force", [](Joint& j) { j.break_force = -1.0; });
  refused("coordinates", [](Joint& j) { j.coordinates[2].stiffness = 1.0; });
}

}  // namespace
}  // namespace constraint_sim::engine
