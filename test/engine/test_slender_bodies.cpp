// Springs and servos on slender bodies. The frequency of a spring depends on the inertia about the
// axis of rotation. The least inertia, about the long axis of the body, is up to a thousand times
// smaller and takes no part in the motion. Oracle: runge_kutta with a tolerance of 1e-13 m/s.

#include "constraint_sim/engine/island.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kSlenderTimeSteps[] = {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0};
constexpr int kSlenderSeeds = kSanitizedShare > 1 ? 2 : 12;

double between_logs(double low, double high, Random* random) {
  return low * std::pow(high / low, random->share());
}

enum class Elastic { kSpring, kServo, kLine };

const char* name_of(Elastic kind) {
  constexpr const char* kNames[] = {"Springs", "Servos", "Lines"};
  return kNames[static_cast<std::size_t>(kind)];
}

/// One or two slender arms along x from the origin, each with a spring at its inner end.
struct SlenderArms {
  double length, mass, frequency, damping_ratio, start;
  double aspect;  // length over thickness
  int count;

  explicit SlenderArms(Random* random)
      : length(between_logs(0.1, 2.0, random)),
        mass(between_logs(0.1, 10.0, random)),
        frequency(between_logs(3.0, 30.0, random)),
        damping_ratio(random->below(2) == 0 ? 0.0 : 0.3 * random->share()),
        start(0.3 * (*random)()),
        aspect(between_logs(3.0, 40.0, random)),
        count(1 + random->below(2)) {}

  // Returns the stiffness [N m/rad] at which an arm oscillates about its end with `frequency`
  // [rad/s].
  double stiffness() const { return frequency * frequency * mass * length * length / 3.0; }

  Joint joint(int number, Elastic kind, BodyId inner, BodyId arm) const {
    Joint joint;
    joint.name = "joint" + std::to_string(number);
    joint.kind = JointKind::kHinge;
    joint.body_a = inner;
    joint.body_b = arm;
    if (number > 0) joint.anchor_a = {0.5 * length, 0.0, 0.0};
    joint.anchor_b = {-0.5 * length, 0.0, 0.0};
    joint.frame_a = frame_along(Vector3d::UnitY());
    if (kind == Elastic::kLine) return joint;
    CoordinateLaw& law = joint.coordinates[0];
    const double damping = 2.0 * damping_ratio * stiffness() / frequency;
    if (kind == Elastic::kServo) {
      Motor motor;
      motor.position = start;
      motor.servo_stiffness = stiffness();
      motor.servo_damping = damping;
      law.motor = motor;
    } else {
      law.stiffness = stiffness();
      law.damping = damping;
      law.rest = start;
    }
    return joint;
  }

  World world(Elastic kind, const WorldOptions& options) const {
    World world(options);
    BodyId inner = kWorldBody;
    const double thickness = length / aspect;
    for (int i = 0; i < count; ++i) {
      Body arm = make_body("arm" + std::to_string(i), Box{{length, thickness, thickness}}, mass,
                           {(0.5 + i) * length, 0.0, 0.0});
      arm.no_collision = true;
      const BodyId id = world.add_body(arm);
      world.add_joint(joint(i, kind, inner, id));
      if (kind == Elastic::kLine) {  // spring from above to the outer end
        Joint line;
        line.name = "line" + std::to_string(i);
        line.kind = JointKind::kDistance;
        line.anchor_a = {(1.0 + i) * length, 0.0, 2.0 * length};
        line.body_b = id;
        line.anchor_b = {0.5 * length, 0.0, 0.0};
        line.distance = spring(1.9 * length, stiffness() / (length * length),
                               2.0 * damping_ratio * stiffness() / frequency / (length * length));
        world.add_joint(line);
      }
      inner = id;
    }
    return world;
  }
};

class SlenderBodies : public testing::TestWithParam<Elastic> {};

// 1e-6 m: the default tolerance of runge_kutta is 1e-8 m/s for 0.5 s, and two arms amplify an error
// some hundred times in that time.
TEST_P(SlenderBodies, AreStiffByTheAxisOfTheirSprings) {
  Random random;
  for (int seed = 0; seed < kSlenderSeeds; ++seed) {
    const SlenderArms arms(&random);
    for (const double h : kSlenderTimeSteps) {
      WorldOptions options;
      options.time_step = h;
      World world = arms.world(GetParam(), options);
      options.method = Method::kRungeKutta;
      options.tolerance = 1e-13;
      World reference = arms.world(GetParam(), options);
      const int steps = static_cast<int>(std::lround(0.5 / h));
      run(world, steps);
      run(reference, steps);
      for (const Island& island : world.islands())
        EXPECT_EQ(island.method, Method::kRungeKutta)
            << seed << " at 1/" << 1.0 / h << ": " << to_string(island.why);
      for (const BodyId id : world.body_ids())
        EXPECT_LE((world.state(id).position - reference.state(id).position).norm(), 1e-6)
            << seed << " at 1/" << 1.0 / h << ", aspect " << arms.aspect << ", " << arms.frequency
            << " rad/s, " << arms.count << " arms";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Elements, SlenderBodies,
                         testing::Values(Elastic::kSpring, Elastic::kServo, Elastic::kLine),
                         [](const auto& kind) { return std::string(name_of(kind.param)); });

}  // namespace
}  // namespace constraint_sim::engine
