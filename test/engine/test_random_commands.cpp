// Random arms whose motors get commands. Oracles: an arm whose command is sent once, the target
// itself, and reports without errors or warnings, since all that moves is commanded.

#include "constraint_sim/engine/plan.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kCommandSeeds = kSanitizedShare > 1 ? 3 : 25;
constexpr double kCommandTimeSteps[] = {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0};

int command_seeds() { return kIsLongRun ? 20 * kCommandSeeds : kCommandSeeds; }

/// One to three links on hinges and sliders, each with a motor.
class CommandedArm {
 public:
  /// `limits`: each coordinate is limited to the range of its targets.
  CommandedArm(Random* random, double time_step, bool limits) {
    WorldOptions options;
    options.time_step = time_step;
    options.gravity = random->turn() * Vector3d(0.0, 0.0, -kGravity);
    world = World(options);
    BodyId inner = kWorldBody;
    Vector3d end = Vector3d::Zero();  // in the frame of `inner`
    Vector3d place = Vector3d::Zero();
    const int links = 1 + random->below(3);
    for (int i = 0; i < links; ++i) {
      const Vector3d half = 0.3 * random->vector();
      Body link = make_body("link_" + std::to_string(i),
                            Box{Vector3d(0.1, 0.1, 0.1) + random->vector().cwiseAbs() * 0.3},
                            random->between(0.5, 2.0), place + half);
      link.no_collision = true;
      Joint joint;
      joint.name = "joint_" + std::to_string(i);
      joint.kind = random->below(2) == 0 ? JointKind::kHinge : JointKind::kSlider;
      joint.body_a = inner;
      joint.body_b = world.add_body(link);
      joint.anchor_a = end;
      joint.anchor_b = -half;
      joint.frame_a = random->turn();
      const double lower = -random->between(0.1, 0.4), upper = random->between(0.1, 0.4);
      if (limits) {
        joint.coordinates[0].lower = lower;
        joint.coordinates[0].upper = upper;
      }
      joint.coordinates[0].motor.emplace();
      joint.coordinates[0].motor->position = 0.0;
      if (random->below(2) == 0) joint.coordinates[0].motor->max_force = 1000.0;
      joints.push_back(world.add_joint(joint));
      targets.push_back(random->below(2) == 0 ? lower : upper);
      inner = joint.body_b;
      end = half;
      place += 2.0 * half;
    }
  }

  void send(double share = 1.0) {
    for (std::size_t i = 0; i < joints.size(); ++i) {
      Motor motor = *world.joint(joints[i]).coordinates[0].motor;
      motor.position = share * targets[i];
      world.set_motor(joints[i], 0, motor);
    }
  }

  const CoordinateState& coordinate(std::size_t joint) const {
    return world.joint_state(joints[joint]).coordinates[0];
  }

  World world;
  std::vector<JointId> joints;
  std::vector<double> targets;
};

// A target that is sent in each step gives the motion of a target that is sent once.
TEST(RandomCommands, RepeatedTargetsKeepTheirMotion) {
  Random random;
  for (int seed = 0; seed < command_seeds(); ++seed) {
    CommandedArm once(&random, kCommandTimeSteps[seed % 3], false);
    CommandedArm repeated = once;
    const int steps = static_cast<int>(std::lround(1.0 / once.world.options().time_step));
    for (int i = 0; i < steps; ++i) {
      if (i == 3) once.send();
      if (i >= 3) repeated.send();
      ASSERT_FALSE(once.world.step().outcome.failed) << seed;
      ASSERT_FALSE(repeated.world.step().outcome.failed) << seed;
      for (std::size_t k = 0; k < once.joints.size(); ++k)
        ASSERT_EQ(once.coordinate(k).position, repeated.coordinate(k).position)
            << seed << " step " << i << " joint " << k;
    }
    for (std::size_t k = 0; k < once.joints.size(); ++k)
      EXPECT_NEAR(once.coordinate(k).position, once.targets[k], 1e-8) << seed << " joint " << k;
  }
}

// Motors that are sent exactly to a limit rest on it, at any time step, without repeated events.
TEST(RandomCommands, MotorsRestOnTheirStops) {
  Random random;
  for (int seed = 0; seed < command_seeds(); ++seed) {
    CommandedArm arm(&random, kCommandTimeSteps[seed % 4], true);
    const double h = arm.world.options().time_step;
    for (int i = 0; i < 3; ++i) ASSERT_FALSE(arm.world.step().outcome.failed) << seed;
    arm.send();
    std::size_t events = 0;
    for (int i = 0; i < static_cast<int>(std::lround(1.0 / h)); ++i) {
      ASSERT_FALSE(arm.world.step().outcome.failed) << seed << " at 1/" << 1.0 / h;
      events += arm.world.events().size();
    }
    // reached, saturated and released once or twice per joint
    EXPECT_LE(events, 8 * arm.joints.size()) << seed << " at 1/" << 1.0 / h;
    for (std::size_t k = 0; k < arm.joints.size(); ++k) {
      EXPECT_NEAR(arm.coordinate(k).position, arm.targets[k], 1e-8) << seed << " joint " << k;
      EXPECT_LE(std::abs(arm.coordinate(k).velocity), 1e-8) << seed << " joint " << k;
    }
  }
}

// Commands to motors at rest and in motion, and changes of the method at any time, are no errors:
// the joints stay closed, nothing is reported as unclosed, no step has a warning, as of energy that
// nobody supplied, and the arm arrives at the last targets.
TEST(RandomCommands, AreNoErrors) {
  constexpr Method kMethods[] = {Method::kAuto, Method::kEnergyMomentum, Method::kRungeKutta};
  Random random;
  for (int seed = 0; seed < command_seeds(); ++seed) {
    CommandedArm arm(&random, kCommandTimeSteps[1 + seed % 3], false);
    const double h = arm.world.options().time_step;
    // A motion to a new position takes 0.5 s.
    const int moves = static_cast<int>(std::lround(0.6 / h)), steps = 2 * moves;
    const int sent = random.below(steps / 2), sent_again = random.below(steps);
    const int switched = random.below(steps);
    WorldOptions options = arm.world.options();
    options.method = kMethods[random.below(3)];
    const double last_share = sent_again < sent ? 1.0 : 0.5;
    for (int i = 0; i < steps + moves; ++i) {
      if (i == sent) arm.send();
      if (i == sent_again) arm.send(0.5);
      if (i == switched) arm.world.set_options(options);
      const StepReport& report = arm.world.step();
      ASSERT_FALSE(report.outcome.failed) << seed;
      ASSERT_LE(report.joints.max_error, 1e-9)
          << seed << " step " << i << " of " << steps << ", sent at " << sent << " and "
          << sent_again << ", switched at " << switched << " to " << name(options.method);
      ASSERT_EQ(report.joints.unclosed, 0u) << seed << " step " << i;
      const std::vector<StepWarning> warnings = faults_of(arm.world);
      ASSERT_TRUE(warnings.empty()) << seed << " step " << i << " of " << steps << ", switched at "
                                    << switched << ": " << to_string(warnings.front());
    }
    for (std::size_t k = 0; k < arm.joints.size(); ++k)
      EXPECT_NEAR(arm.coordinate(k).position, last_share * arm.targets[k], 1e-8)
          << seed << " joint " << k;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
