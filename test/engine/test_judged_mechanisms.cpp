// shards: 2
// Random mechanisms of joints of all kinds against a reference in long double, by all methods and
// in several variants (bench/random_mechanisms.h), and that reference against minimal coordinates.
// constraint_sim_random_mechanisms does so with any number of mechanisms.

#include <gtest/gtest.h>

#include "coupled_mechanisms.h"
#include "mechanisms.h"
#include "random_mechanisms.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine::random_scenes {
namespace {

const std::uint64_t kMechanisms = 48 / kSeedShare;
constexpr std::uint64_t kMechanismsATest = kSanitizedShare > 1 ? 1 : 6;

class JudgedMechanisms : public testing::TestWithParam<std::uint64_t> {};

TEST_P(JudgedMechanisms, AreNeverSilentlyWrong) {
  for (std::uint64_t seed = GetParam(); seed < GetParam() + kMechanismsATest; ++seed) {
    const Verdict verdict = judge_mechanism(seed);
    EXPECT_TRUE(verdict.has_motion) << seed;
    for (const Finding& finding : verdict.findings) ADD_FAILURE() << line_of(verdict, finding);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, JudgedMechanisms,
                         testing::Range(std::uint64_t{1}, kMechanisms + 1, kMechanismsATest));

Scene scene_of(const World& world) {
  Scene scene;
  scene.options = world.options();
  for (const BodyId id : world.body_ids()) {
    scene.bodies.push_back(world.body(id));
    scene.bodies.back().state = world.state(id);
  }
  const std::vector<JointId> ids = world.joint_ids();
  const auto place = [&](JointId id) {
    const auto found = std::find(ids.begin(), ids.end(), id);
    return JointId{static_cast<std::uint32_t>(found - ids.begin() + 1)};
  };
  for (const JointId id : ids) {
    scene.joints.push_back(world.joint(id));
    if (!info(scene.joints.back().kind).couples_joints) continue;
    Coupling& coupling = scene.joints.back().coupling;
    coupling.first = place(coupling.first);
    coupling.second = place(coupling.second);
  }
  return scene;
}

// Seeds of faults: redundant rows that carry a force again after a pose where the other rows hold
// badly (951), and whole turns of a screw that moves to and fro within a tick (111).
TEST(JudgedMechanism, IsNeverSilentlyWrongWhereOnesLikeItWere) {
  for (const std::uint64_t seed : {951, 111}) {
    const Verdict verdict = judge_mechanism(seed);
    for (const Finding& finding : verdict.findings) ADD_FAILURE() << line_of(verdict, finding);
  }
}

// The two references share nothing: dense rows in long double with projection, and one or two
// coordinates. Bound 1e-9 m: some hundred steps with a tolerance of 1e-12, amplified tenfold.
TEST(MechanicsReference, MovesAsMinimalCoordinatesDo) {
  using mechanisms::with_couplings;
  for (const mechanisms::Mechanism& mechanism :
       {mechanisms::double_hinge_pendulum(), mechanisms::slider_crank(),
        mechanisms::universal_shaft(), mechanisms::bricard(),
        with_couplings(mechanisms::planetary_gear()), with_couplings(mechanisms::falling_nut()),
        with_couplings(mechanisms::falling_rack()), with_couplings(mechanisms::swinging_atwood(1)),
        with_couplings(mechanisms::swinging_atwood(2))}) {
    World world = mechanism.world({});
    const Mechanics mechanics(scene_of(world));
    reference::Integrator integrator(mechanics, 1e-12, 200000);
    integrator.advance_to(mechanism.duration);
    ASSERT_TRUE(integrator.is_valid()) << mechanism.name;
    const auto [worst, joint] =
        mechanics.worst_joint(integrator.poses(), mechanism.duration, integrator.readings());
    EXPECT_LE(worst, 1e-15) << mechanism.name << " " << joint;
    for (std::size_t i = 0; i < mechanism.bodies.size(); ++i) {
      const Pose& pose = integrator.poses()[i];
      BodyState state;
      state.position = (pose.x + mechanics.origin()).cast<double>();
      state.orientation = pose.q.cast<double>();
      world.set_state(world.find_body(mechanism.bodies[i].name), state);
    }
    EXPECT_LE(mechanism.error(world), 1e-9) << mechanism.name;
  }
}

// The judge finds a joint error slightly above its bound; in scenes the bound is 1e-6 m.
TEST(JudgeOfMechanisms, HoldsJointsToRounding) {
  const Setting setting = {"runge_kutta", Method::kRungeKutta, 8};
  const Scene scene = MechanismGenerator(2).make();
  World world = make_world(scene);
  EXPECT_EQ(Judge(scene, true).judge(setting, &world).what, "");
  for (const bool is_strict : {true, false}) {
    Scene off = scene;
    off.joints.front().anchor_b.x() +=
        1e-8;  // the engine keeps this anchor, and the scene does not have it
    off.joints.front().baumgarte = 0.0;
    World other = make_world(off);
    const std::string found = Judge(scene, is_strict).judge(setting, &other).what;
    EXPECT_EQ(found, is_strict ? "joints" : "");
  }
}

// The judge finds a gear with another ratio.
TEST(JudgeOfMechanisms, HoldsCouplingsToRounding) {
  const Setting setting = {"runge_kutta", Method::kRungeKutta, 8};
  Scene scene = MechanismGenerator(29).make();
  ASSERT_EQ(scene.joints.back().kind, JointKind::kGear);
  World world = make_world(scene);
  const Judge judge(scene, true);
  EXPECT_EQ(judge.judge(setting, &world).what, "");
  scene.joints.back().coupling.ratio *= 1.0 + 1e-8;
  World other = make_world(scene);
  EXPECT_EQ(judge.judge(setting, &other).what, "joints");
}

// ---- wrenches

/// Returns the residual of the Newton-Euler equations with the joints' wrenches after a step of h
/// [N], torques over radii of gyration, and the largest of the forces.
std::pair<Eigen::VectorXd, double> imbalance(World world, double h) {
  WorldOptions options = world.options();
  options.time_step = h;
  world.set_options(options);
  std::map<std::uint32_t, std::pair<Vector3d, Vector3d>>
      left;  // force, and torque about the centre
  const auto spin = [&](BodyId id) {
    const Quaterniond& q = world.state(id).orientation;
    const Vector3d w_B = q.conjugate() * world.state(id).angular_velocity;
    return Vector3d(q * inertia_of(world.body(id)).cwiseProduct(w_B));
  };
  const auto add_motion = [&](double sign) {
    for (const BodyId id : world.body_ids()) {
      if (world.body(id).type != BodyType::kDynamic) continue;
      left[id.value].first += sign / h * world.body(id).mass * world.state(id).linear_velocity;
      left[id.value].second += sign / h * spin(id);
    }
  };
  for (const BodyId id : world.body_ids())
    left[id.value] = {Vector3d(-world.body(id).mass * options.gravity), Vector3d::Zero()};
  add_motion(-1.0);
  world.step();
  add_motion(1.0);
  double largest = 0.0;
  for (const JointId id : world.joint_ids()) {
    const Joint& joint = world.joint(id);
    if (info(joint.kind).couples_joints) continue;  // acts through the joints that it couples
    const World::JointWrench wrench = world.joint_wrench(id);
    Quaterniond to_world = world.state(joint.body_b).orientation;
    if (info(joint.kind).has_frames) to_world = to_world * *joint.frame_b;
    const Vector3d f = to_world * wrench.force, tau = to_world * wrench.torque;
    for (const auto& [body, sign] : {std::pair(joint.body_a, -1.0), {joint.body_b, 1.0}}) {
      const Vector3d arm = world.anchors(id).p_b - world.state(body).position;
      left[body.value].first -= sign * f;
      left[body.value].second -= sign * (tau + arm.cross(f));
    }
    largest = std::max(largest, f.norm());
  }
  Eigen::VectorXd all(6 * static_cast<Eigen::Index>(world.body_ids().size()));
  all.setZero();
  Eigen::Index i = 0;
  for (const BodyId id : world.body_ids()) {
    const Body& body = world.body(id);
    if (body.type == BodyType::kDynamic) {
      all.segment<3>(i) = left[id.value].first;
      all.segment<3>(i + 3) =
          left[id.value].second / std::sqrt(inertia_of(body).maxCoeff() / body.mass);
      largest = std::max(largest, body.mass * options.gravity.norm());
    }
    i += 6;
  }
  return {all, largest};
}

// All kinds, redundant joints and couplings. Wrenches are means over a step, in the frames at its
// end, with a first-order error that two steps extrapolate; a second-order error remains, (30 rad/s
// · 2e-5 s)², and rounding of velocities over the step.
TEST(JointWrenches, AreThoseOfNewtonAndEuler) {
  constexpr double kStep = 2e-5;
  for (std::uint64_t seed = 1; seed <= 60u / kSeedShare; ++seed) {
    Scene scene = MechanismGenerator(seed).make();
    scene.options.time_step = 0.01;
    scene.options.method = Method::kRungeKutta;
    World world = make_world(scene);
    for (int i = 0; i < 10; ++i) world.step();
    const auto [whole, largest] = imbalance(world, kStep);
    const Eigen::VectorXd half = imbalance(world, 0.5 * kStep).first;
    EXPECT_LE((2.0 * half - whole).lpNorm<Eigen::Infinity>(), 1e-6 * largest)
        << seed << " " << scene.kind;
  }
}

}  // namespace
}  // namespace constraint_sim::engine::random_scenes
