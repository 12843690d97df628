// Constraints and forces of other packages: the motion of equivalent joints of the engine, closed
// forms, and messages for errors.

#include "by_events.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "custom_types.h"
#include "engine/model/joint_data.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

class Custom : public testing::Test {
 protected:
  void SetUp() override { example_types::register_all(); }
};

Joint custom(const std::string& type, CustomParameters parameters, BodyId b,
             BodyId a = kWorldBody) {
  Joint joint;
  joint.name = "custom";
  const auto slash = type.substr(5);
  const bool is_force = slash == "drag" || slash == "shaker" || slash == "faulty";
  joint.kind = is_force ? JointKind::kCustomForce : JointKind::kCustom;
  joint.body_a = a;
  joint.body_b = b;
  joint.custom.type = type;
  joint.custom.parameters = std::move(parameters);
  return joint;
}

WorldOptions accurate_options(Method method, double time_step) {
  WorldOptions options;
  options.method = method;
  options.time_step = time_step;
  options.tolerance = 1e-10;
  return options;
}

const Method kAllMethods[] = {Method::kAuto, Method::kRungeKutta, Method::kEnergyMomentum,
                              Method::kSequentialImpulses, Method::kEventDriven};

/// Returns the largest difference of position [m], velocity [m/s] and spin [rad/s] between the
/// bodies of two worlds.
double state_difference(const World& a, const World& b) {
  double most = 0.0;
  for (const BodyId id : a.body_ids()) {
    const BodyState &x = a.state(id), &y = b.state(id);
    most = std::max({most, (x.position - y.position).norm(),
                     (x.linear_velocity - y.linear_velocity).norm(),
                     (x.angular_velocity - y.angular_velocity).norm()});
  }
  return most;
}

// ---- forces

// v(t) = v∞ + (v₀ − v∞) exp(−c t/m) with v∞ = w + m g/c.
double error_of_drag(Method method, int order, double time_step, bool* failed) {
  constexpr double kMass = 0.5, kDrag = 0.4, kWind = 3.0, kTime = 2.0;
  WorldOptions options = accurate_options(method, time_step);
  options.stiff_order = order;
  World world(options);
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, kMass, {0.0, 0.0, 10.0}));
  world.add_joint(custom("test/drag", {{"wind", kWind}, {"c", kDrag}}, ball));
  const auto steps = std::lround(kTime / time_step);
  for (int i = 0; i < steps; ++i) *failed = *failed || world.step().outcome.failed;
  const Vector3d terminal(kWind, 0.0, -kMass * kGravity / kDrag);
  const Vector3d v = terminal - std::exp(-kDrag * kTime / kMass) * terminal;
  return (world.state(ball).linear_velocity - v).norm();
}

TEST_F(Custom, ADisabledForceHasNoWrench) {
  World world;
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  const JointId drag = world.add_joint(custom("test/drag", {{"wind", 3.0}, {"c", 0.5}}, ball));
  EXPECT_EQ(world.joint_wrench(drag).force, Vector3d(1.5, 0.0, 0.0));  // c times wind, at rest
  world.set_enabled(drag, false);
  EXPECT_EQ(world.joint_wrench(drag).force, Vector3d(Vector3d::Zero()));
}

TEST_F(Custom, DragOfASphereIsTheClosedForm) {
  bool failed = false;
  // a thousand times the tolerance, for seconds
  EXPECT_LE(error_of_drag(Method::kRungeKutta, 4, 0.01, &failed), 1e-9);
  EXPECT_LE(error_of_drag(Method::kAuto, 4, 0.05, &failed), 1e-9);
  EXPECT_LE(error_of_drag(Method::kEventDriven, 4, 0.05, &failed), 1e-9);
  const std::vector<double> steps{0.1, 0.05, 0.025, 0.0125};
  std::vector<double> of_midpoint, of_impulses;
  for (const double step : steps) {
    of_midpoint.push_back(error_of_drag(Method::kEnergyMomentum, 2, step, &failed));
    of_impulses.push_back(error_of_drag(Method::kSequentialImpulses, 2, step, &failed));
  }
  EXPECT_NEAR(order(steps, of_impulses), 1.0, 0.1);
  EXPECT_NEAR(order(steps, of_midpoint), 2.0, 0.1);
  EXPECT_FALSE(failed);
}

TEST_F(Custom, ForcesDependOnTimeAndTurnBodies) {
  constexpr double kForce = 2.0, kOmega = 5.0;
  for (const Method method : {Method::kAuto, Method::kEnergyMomentum}) {
    World world(accurate_options(method, 0.01));
    WorldOptions options = world.options();
    options.gravity.setZero();
    world.set_options(options);
    const Body body = make_body("box", Box{{0.3, 0.3, 0.3}}, 2.0, Vector3d::Zero());
    const BodyId box = world.add_body(body);
    world.add_joint(custom("test/shaker", {{"f", kForce}, {"omega", kOmega}}, box));
    run(world, 100);
    const double integral = kForce * std::sin(kOmega * 1.0) / kOmega;
    const double allowed = method == Method::kAuto ? 1e-9 : 1e-5;
    EXPECT_NEAR(world.state(box).linear_velocity.x(), integral / 2.0, allowed) << name(method);
    EXPECT_NEAR(world.state(box).angular_velocity.z(), integral / inertia_of(body).z(),
                100.0 * allowed);
    EXPECT_NEAR(world.joint_state(world.find_joint("custom")).force,
                kForce * std::abs(std::cos(kOmega)), 1e-9);
    EXPECT_EQ(world.report().energy.rise, 0.0);  // explained by the force
  }
}

// A force of two periods a step is the same at the start, in the middle and at the end of a step. A
// ball on a smooth floor is where it was after each step: x = f (1 − cos ω t)/(m ω²).
TEST_F(Custom, AForceThatRepeatsWithinAStepIsNotTakenForAConstant) {
  constexpr double kStep = 0.01, kForce = 5e-5;  // too little to rotate the ball noticeably
  World world(accurate_options(Method::kEventDriven, kStep));
  world.add_body(plane("floor", Vector3d::Zero(), Vector3d::UnitZ(), 0.0, 0.0));
  const BodyId ball =
      world.add_body(with_surface(make_body("ball", Sphere{0.5}, 1.0, {0.0, 0.0, 0.5}), 0.0, 0.0));
  world.add_joint(custom("test/shaker", {{"f", kForce}, {"omega", 4.0 * kPi / kStep}}, ball));
  run(world, 100);
  EXPECT_EQ(world.contacts().size(), 1u);
  EXPECT_NEAR(world.state(ball).position.x(), 0.0, 1e-10);  // f t²/(2 m) is 2.5e-5 m
}

TEST_F(Custom, ForcesBetweenTwoBodiesKeepMomentum) {
  for (const Method method : kAllMethods) {
    World world(accurate_options(method, 0.01));
    WorldOptions options = world.options();
    options.gravity.setZero();
    world.set_options(options);
    Body left = make_body("left", Sphere{0.1}, 1.0, {0.0, 0.0, 0.0});
    left.state.linear_velocity = {0.0, 1.0, 0.0};
    const BodyId a = world.add_body(left);
    const BodyId b = world.add_body(make_body("right", Sphere{0.1}, 3.0, {1.0, 0.0, 0.0}));
    world.add_joint(custom("test/drag", {{"c", 1.0}, {"wind", 0.0}}, b, a));
    run(world, 100);
    EXPECT_LE((momentum(world) - Vector3d(0.0, 1.0, 0.0)).norm(), 1e-12) << name(method);
    // relative velocities fall as exp(−c t/μ), μ = 3/4 kg; the other methods are of order 1 and 2:
    // relative errors h c/μ and (h c/μ)²/12
    const double apart = (world.state(b).linear_velocity - world.state(a).linear_velocity).norm();
    const double allowed = method == Method::kSequentialImpulses ? 5e-3
                           : method == Method::kEnergyMomentum   ? 1e-5
                                                                 : 1e-9;
    EXPECT_NEAR(apart, std::exp(-4.0 / 3.0), allowed) << name(method);
  }
}

// ---- constraints

struct Pendulum {
  World own, custom_one;

  // The pendulum with the engine's rod, and with a custom rod of the same equation.
  Pendulum(Method method, bool is_squared, bool is_pair) : own(accurate_options(method, 0.01)) {
    Body first = make_body("first", Sphere{0.1}, 1.0, {0.6, 0.0, -0.8});
    first.state.linear_velocity = {0.0, 0.5, 0.0};
    first.state.angular_velocity = {0.3, -0.2, 0.1};
    const BodyId a = own.add_body(first);
    BodyId b = a;
    if (is_pair) {
      b = own.add_body(make_body("second", Box{{0.2, 0.3, 0.1}}, 2.0, {0.6, 0.5, -0.8}));
      own.add_joint(
          make_joint("hold", kWorldBody, Vector3d::Zero(), a, Vector3d::Zero(), DistanceJoint{}));
    }
    custom_one = own;
    const Vector3d anchor_b = is_pair ? Vector3d(0.1, 0.0, 0.05) : Vector3d(Vector3d::Zero());
    const BodyId other = is_pair ? a : kWorldBody;
    own.add_joint(make_joint("rod", other, Vector3d::Zero(), b, anchor_b, DistanceJoint{}));
    const double length = distance(own, own.find_joint("rod"));
    Joint joint =
        custom("test/rod", {{"length", length}, {"squared", is_squared ? 1.0 : 0.0}}, b, other);
    joint.anchor_b = anchor_b;
    custom_one.add_joint(joint);
  }
};

// Returns a copy with the last body moved by rounding.
World by_rounding_off(const World& world) {
  World off = world;
  const BodyId last = off.body_ids().back();
  BodyState state = off.state(last);
  state.linear_velocity.array() += 2e-15;
  off.set_state(last, state);
  return off;
}

// Impulses use ‖d‖ − ℓ for a rod, all other methods ½(d·d − ℓ²). Bound: 1e-12 m, or the effect of
// rounding with the engine's own rods, which is larger for a tumbling pair.
TEST_F(Custom, RodMovesAsTheEnginesRodByEveryMethod) {
  for (const bool is_pair : {false, true}) {
    for (const Method method : kAllMethods) {
      SCOPED_TRACE(std::string(name(method)) + (is_pair ? ", a pair" : ""));
      Pendulum both(method, method != Method::kSequentialImpulses, is_pair);
      World off = by_rounding_off(both.own);
      run(both.own, 100);
      run(both.custom_one, 100);
      run(off, 100);
      const double of_rounding = state_difference(both.own, off);
      EXPECT_LE(of_rounding, 1e-9);
      EXPECT_LE(state_difference(both.own, both.custom_one), 1e-12 + 10.0 * of_rounding);
    }
  }
}

// One manifold described by another function: motions agree within the tolerance.
TEST_F(Custom, LengthAndItsSquareAreTheSameRod) {
  Pendulum both(Method::kRungeKutta, false, true);
  run(both.own, 100);
  run(both.custom_one, 100);
  EXPECT_LE(state_difference(both.own, both.custom_one), 1e-8);
}

TEST_F(Custom, RightAngleOnABallJointIsAUniversalJoint) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    World own(accurate_options(method, 0.01));
    Body body = make_body("box", Box{{0.2, 0.3, 0.4}}, 1.0, {0.5, 0.0, 0.0});
    body.state.angular_velocity = {0.0, 2.0, 0.0};
    body.state.linear_velocity = body.state.angular_velocity.cross(body.state.position);
    const BodyId box = own.add_body(body);
    World other = own;
    Joint universal = make_joint("universal", kWorldBody, Vector3d::Zero(), box, {-0.5, 0.0, 0.0});
    universal.kind = JointKind::kUniversal;
    universal.axis_b = Vector3d::UnitX();
    own.add_joint(universal);
    Joint ball = make_joint("ball", kWorldBody, Vector3d::Zero(), box, {-0.5, 0.0, 0.0});
    ball.kind = JointKind::kBall;
    other.add_joint(ball);
    Joint angle = custom("test/right_angle", {}, box);
    angle.frame_b = own.joint(own.find_joint("universal")).frame_b;
    other.add_joint(angle);
    run(own, 100);
    run(other, 100);
    EXPECT_LE(state_difference(own, other), 1e-10) << name(method);
  }
}

TEST_F(Custom, BowlKeepsEnergyAndItsEquation) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    WorldOptions options = accurate_options(method, 0.005);
    options.stiff_order = 2;
    World world(options);
    Body body = make_body("bead", Sphere{0.05}, 1.0, {0.8, 0.0, 0.5 * std::pow(0.8, 4)});
    body.state.linear_velocity = {0.0, 1.0, 0.0};
    const BodyId bead = world.add_body(body);
    world.add_joint(custom("test/bowl", {{"k", 0.5}}, bead));
    const double energy = world.energy();
    double drift = 0.0, error = 0.0;
    for (int i = 0; i < 400; ++i) {
      const StepReport& report = world.step();
      ASSERT_FALSE(report.outcome.failed);
      drift = std::max(drift, std::abs(world.energy() - energy));
      error = std::max(error, report.joints.max_error);
    }
    // energy of a few joules: rounding of a discrete gradient, and the tolerance of runge_kutta
    EXPECT_LE(drift, method == Method::kEnergyMomentum ? 1e-10 : 1e-8) << name(method);
    EXPECT_LE(error, 1e-11);
  }
}

TEST_F(Custom, ErrorIsClosedSmoothly) {
  World world(accurate_options(Method::kAuto, 0.01));
  const BodyId bead = world.add_body(make_body("bead", Sphere{0.05}, 1.0, {0.8, 0.0, 0.4}));
  const JointId joint = world.add_joint(custom("test/bowl", {{"k", 0.5}}, bead));
  EXPECT_TRUE(world.joint_state(joint).closing);
  const double before = world.joint_state(joint).error;
  EXPECT_NEAR(before, 0.4 - 0.5 * std::pow(0.8, 4), 1e-15);
  run(world, 60);
  EXPECT_FALSE(world.joint_state(joint).closing);
  EXPECT_LE(std::abs(world.joint_state(joint).error), 1e-11);
}

// ---- rejections

TEST_F(Custom, WrongDerivativesAreRefusedInWords) {
  World world;
  const BodyId bead = world.add_body(make_body("bead", Sphere{0.05}, 1.0, {0.8, 0.1, 0.2}));
  const std::uint64_t hash = world.state_hash();
  const auto attempt = [&](double gradient, double gamma) {
    return refusal([&] {
      world.add_joint(custom(
          "test/bowl", {{"k", 0.5}, {"gradient_factor", gradient}, {"gamma_factor", gamma}}, bead));
    });
  };
  EXPECT_NE(attempt(1.01, 1.0).find("'custom' of type 'test/bowl': the gradient by d[0] is"),
            std::string::npos);
  EXPECT_NE(attempt(1.0, 0.5).find("gamma for a rate of 1 of d[0] is"), std::string::npos);
  EXPECT_EQ(world.state_hash(), hash);
  EXPECT_EQ(attempt(1.0, 1.0), "");
}

TEST_F(Custom, WhatIsNotThereIsRefused) {
  World world;
  const BodyId bead = world.add_body(make_body("bead", Sphere{0.05}, 1.0, {0.8, 0.1, 0.2}));
  const auto attempt = [&](const Joint& joint) { return refusal([&] { world.add_joint(joint); }); };
  Joint joint = custom("test/none", {}, bead);
  EXPECT_EQ(
      attempt(joint).find("custom: no plugin has a constraint of type 'test/none'; types are"), 0u);
  joint.custom.type = "test/drag";  // a force
  EXPECT_EQ(attempt(joint).find("custom: no plugin has a constraint of type 'test/drag'"), 0u);
  joint.custom.type = "test/bowl";
  EXPECT_NE(attempt(joint).find("parameters: 'k' is left out"), std::string::npos);
  joint.custom.parameters = {{"k", 1.0}, {"k", 2.0}};
  EXPECT_EQ(attempt(joint), "parameters: 'k' is there twice");
  joint.custom.parameters = {{"k", kNaN}};
  EXPECT_EQ(attempt(joint).find("k: must be a finite number"), 0u);
  Joint force = custom("test/drag", {{"c", 1.0}, {"wind", 0.0}}, bead);
  force.break_force = 1.0;
  EXPECT_EQ(attempt(force).find("break_force: "), 0u);
  EXPECT_TRUE(world.joint_ids().empty());
}

// ---- failures in a step

/// The distance from the plane x = 0, times 1e30.
struct SteepPlane : CustomConstraint {
  double value(const FramePair& at) const override { return 1e30 * at.d.x(); }
  FramePair gradient(const FramePair& /*at*/) const override {
    FramePair g;
    g.d.x() = 1e30;
    return g;
  }
  double gamma(const FramePair& /*at*/, const FramePair& /*rates*/) const override { return 0.0; }
};

// Values have the bound of all numbers of a scene, so that an error which is closing can be saved.
TEST_F(Custom, ValuesBeyondTheBoundFail) {
  register_custom_constraint(
      "test/steep", [](const CustomParameters& /*p*/) { return std::make_shared<SteepPlane>(); });
  World world;
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {1.0, 0.0, 0.0}));
  try {
    world.add_joint(custom("test/steep", {}, id));
    ADD_FAILURE() << "a value of 1e30 was accepted";
  } catch (const std::invalid_argument& rejected) {
    EXPECT_NE(std::string(rejected.what()).find("value 1e+30 is beyond 1e20"), std::string::npos)
        << rejected.what();
  }
  const BodyState there = world.state(id);
  BodyState on_plane = there;
  on_plane.position.x() = 0.0;
  world.set_state(id, on_plane);
  world.add_joint(custom("test/steep", {}, id));
  world.set_state(id, there);
  const std::string text = save_scene(world);
  EXPECT_EQ(save_scene(load_scene(text)), text);
  EXPECT_EQ(world.step().outcome.failure, Failure::kCustom);
}

// An error that does not exist is not 0: it is infinite where the function of the joint fails, and
// the joint does not close. A disabled joint is not asked, and so ends no step.
TEST_F(Custom, HasNoErrorWhereItsFunctionFails) {
  for (const bool is_enabled : {true, false}) {
    World world(options(0.01));
    const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
    const JointId joint = world.add_joint(custom("test/ending", {}, id));
    world.set_enabled(joint, is_enabled);
    BodyState there = world.state(id);
    there.position.x() = 2.0;
    world.set_state(id, there);
    const World read = read_snapshot(write_snapshot(world));
    const World loaded = load_scene(save_scene(world));
    for (const World* of : std::initializer_list<const World*>{&world, &read, &loaded}) {
      const JointData& state = joint_data(*of, of->find_joint("custom"));
      EXPECT_EQ(state.error, kInfinity);
      EXPECT_EQ(state.initial_error, 0.0);
      EXPECT_FALSE(state.closing);
    }
    EXPECT_EQ(world.step().outcome.failure, is_enabled ? Failure::kCustom : Failure::kNone);
    there.position.x() = 0.5;
    world.set_state(id, there);
    EXPECT_EQ(world.joint_state(joint).error, 0.5);
    EXPECT_EQ(world.step().outcome.failure, Failure::kNone);
  }
}

// set_joint() takes settings alone: a description without the functions keeps the joint's own.
TEST_F(Custom, KeepsItsFunctionsWhenItsSettingsChange) {
  World world(accurate_options(Method::kRungeKutta, 0.01));
  const BodyId id = world.add_body(make_body("bob", Sphere{0.1}, 1.0, Vector3d::UnitX()));
  const CustomParameters rod{{"length", 1.0}, {"squared", 0.0}};
  const JointId joint = world.add_joint(custom("test/rod", rod, id));
  Joint changed = world.joint(joint);
  changed.custom.code.reset();
  changed.break_force = 1e6;
  World copy = world;
  Joint whole = copy.joint(joint);
  whole.break_force = 1e6;
  world.set_joint(joint, changed);
  copy.set_joint(joint, whole);
  run(world, 100);
  run(copy, 100);
  EXPECT_EQ(world.state_hash(), copy.state_hash());
  EXPECT_NEAR(world.state(id).position.norm(), 1.0, 1e-9);  // rods hold to rounding
  EXPECT_LT(world.state(id).position.x(), 0.9);             // it swings
}

// A world with a body where the function of a joint fails is saved, loaded and copied, and says in
// its next step what failed.
TEST_F(Custom, WhereItsFunctionFailsIsSavedAndLoaded) {
  for (const double error : {0.0, 0.1})  // also while an error is closing
    for (const bool steps : {false, true}) {
      World world;
      const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {error, 0.0, 0.0}));
      world.add_joint(custom("test/ending", {}, id));
      if (steps) run(world, 3);
      BodyState there = world.state(id);
      there.position.x() = 2.0;
      world.set_state(id, there);
      const std::string text = save_scene(world);
      World loaded = load_scene(text);
      EXPECT_EQ(save_scene(loaded), text);
      World read = read_snapshot(write_snapshot(world));
      EXPECT_EQ(read.state_hash(), world.state_hash());
      World reset = loaded;
      reset.reset();
      EXPECT_EQ(save_scene(load_scene(save_scene(reset))), save_scene(reset));
      for (World* of : {&world, &loaded, &read}) {
        EXPECT_EQ(of->step().outcome.failure, Failure::kCustom);
        EXPECT_EQ(of->failed_joint(), of->find_joint("custom"));
      }
    }
}

TEST_F(Custom, WhatFailsIsToldByItsNameAndKeepsTheStateBefore) {
  for (const Method method : kAllMethods) {
    for (const double throws : {0.0, 1.0}) {
      SCOPED_TRACE(std::string(name(method)) + (throws != 0.0 ? " throws" : " returns NaN"));
      WorldOptions options = accurate_options(method, 0.01);
      options.threads = 2;
      World world(options);
      for (int i = 0; i < 8; ++i) {
        Body body = make_body("ball" + std::to_string(i), Sphere{0.1}, 1.0, {1.0 * i, 0.0, 0.0});
        const BodyId id = world.add_body(body);
        Joint joint =
            custom("test/faulty", {{"from", i == 5 ? 0.045 : 1e9}, {"throws", throws}}, id);
        joint.name = "faulty" + std::to_string(i);
        world.add_joint(joint);
      }
      int steps = 0;
      World before = world;
      while (steps < 20 && !world.step().outcome.failed) {
        before = world;
        ++steps;
      }
      const StepReport& report = world.report();
      ASSERT_TRUE(report.outcome.failed);
      EXPECT_GE(steps, 3);
      EXPECT_LE(steps, 5);
      EXPECT_EQ(report.outcome.failure, Failure::kCustom);
      EXPECT_EQ(world.failed_joint(), world.find_joint("faulty5"));
      EXPECT_NE(world.failed_why().find(
                    "'faulty5' of type 'test/faulty': wrench " +
                    std::string(throws != 0.0 ? "threw: the sensor is gone" : "is not finite")),
                std::string::npos);
      EXPECT_EQ(state_difference(world, before), 0.0);
      EXPECT_EQ(world.time(), before.time());
      EXPECT_EQ(world.step_count(), static_cast<std::uint64_t>(steps));
      world.remove_joint(world.find_joint("faulty5"));
      run(world, 5);
    }
  }
}

// ---- saved, restored, hashed

World windy(Method method) {
  World world(accurate_options(method, 0.01));
  Body body = make_body("bead", Sphere{0.05}, 1.0, {0.8, 0.0, 0.5 * std::pow(0.8, 4)});
  body.state.linear_velocity = {0.0, 1.0, 0.0};
  const BodyId bead = world.add_body(body);
  Joint drag = custom("test/drag", {{"c", 0.1}, {"wind", 2.0}}, bead);
  drag.name = "drag";
  world.add_joint(drag);
  world.add_joint(custom("test/bowl", {{"k", 0.5}}, bead));
  return world;
}

TEST_F(Custom, ScenesAndSnapshotsGoOnAsTheirWorldDoes) {
  for (const Method method : kAllMethods) {
    SCOPED_TRACE(name(method));
    World world = windy(method);
    run(world, 30);
    const std::string text = save_scene(world);
    World loaded = load_scene(text);
    EXPECT_EQ(save_scene(loaded), text);
    World restored = read_snapshot(write_snapshot(world));
    EXPECT_EQ(restored.state_hash(), world.state_hash());
    World copy = world;
    for (World* each : {&world, &restored, &copy}) run(*each, 50);
    EXPECT_EQ(restored.state_hash(), world.state_hash());
    EXPECT_EQ(copy.state_hash(), world.state_hash());
  }
}

TEST_F(Custom, HashHasTypeAndParameters) {
  const auto hash_of = [](const std::string& type, double k) {
    World world;
    const BodyId bead = world.add_body(make_body("bead", Sphere{0.05}, 1.0, {0.8, 0.0, 0.0}));
    CustomParameters parameters{{"c", k}, {"wind", 0.0}};
    if (type == "test/shaker") parameters = {{"f", k}, {"omega", 0.0}};
    world.add_joint(custom(type, parameters, bead));
    return world.state_hash();
  };
  EXPECT_EQ(hash_of("test/drag", 0.5), hash_of("test/drag", 0.5));
  EXPECT_NE(hash_of("test/drag", 0.5), hash_of("test/drag", std::nextafter(0.5, 1.0)));
  EXPECT_NE(hash_of("test/drag", 0.5), hash_of("test/shaker", 0.5));
}

TEST_F(Custom, ThreadsDoNotChangeTheResult) {
  std::vector<std::uint64_t> hashes;
  for (const int threads : {1, 2}) {
    WorldOptions options = accurate_options(Method::kAuto, 0.01);
    options.threads = threads;
    World world(options);
    for (int i = 0; i < 40; ++i) {
      const BodyId id = world.add_body(
          make_body("ball" + std::to_string(i), Sphere{0.1}, 1.0, {1.0 * i, 0.0, 0.0}));
      Joint drag = custom("test/drag", {{"c", 0.1 * i}, {"wind", 2.0}}, id);
      drag.name = "drag" + std::to_string(i);
      world.add_joint(drag);
    }
    run(world, 20);
    WorldOptions same = world.options();
    same.threads = 1;
    world.set_options(same);
    hashes.push_back(world.state_hash());
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

}  // namespace
}  // namespace constraint_sim::engine
