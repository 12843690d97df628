// Loops of joints in joint coordinates, against the rows of the same mechanisms, closed forms and
// themselves with smaller steps.

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "constraint_sim/engine/snapshot.h"
#include "engine/math/numbers.h"
#include "random_loops.h"
#include "sanitized.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

const int kSeeds = 300 / kSeedShare;

RandomTree random_mechanism(int seed) {
  return seed % 2 == 0 ? random_planar_loops(seed) : random_loops(seed);
}

// As for trees: rows lose digits by masses over six decades. Where both differ by more than 2e-8 m,
// the loops are at least the same with a quarter of the step. Means over a step of redundant
// forces, along axes that turn, depend on which rows have them, by a share that is the turn in a
// step.
TEST(TreeClosings, MoveAsTheirRowsDo) {
  int apart = 0;
  for (int seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    const RandomTree tree = random_mechanism(seed);
    const World coordinates = after_steps(tree.world()), rows = after_steps(tree.world_by_rows());
    if (difference(coordinates, rows) <= kRowsAgree)
      expect_same_forces(coordinates, rows, tree.links.size(),
                         rows.report().joints.dependent_rows > 0 ? 0.1 : 1e-6);
    else if (difference(coordinates, after_steps(tree.world(), 4)) > 1e-7)
      ++apart;
  }
  EXPECT_LE(apart, kSeeds / 100);
}

TEST(TreeClosings, GoOnFromCopiesAndSnapshots) {
  for (int seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    expect_goes_on(random_mechanism(seed));
  }
}

/// Largest opening of a joint [m], of joints with rows of their own.
double largest_opening(const World& world) {
  double largest = 0.0;
  for (const JointId id : world.joint_ids()) {
    const JointKind kind = world.joint(id).kind;
    if (forms(kind).form == RowsForm::kDistance || info(kind).couples_joints) continue;
    largest = std::max(largest, opening(world, id));
  }
  return largest;
}

// Newton steps end within 16 roundings of lengths of some metres; redundant rows of planar loops
// follow from the others.
TEST(TreeClosings, MeetJointsToRounding) {
  for (int seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    RandomTree tree = random_planar_loops(seed);
    tree.options.tolerance = 1e-6;
    World world = tree.world();
    for (int i = 0; i < 50; ++i) ASSERT_FALSE(world.step().outcome.failed);
    EXPECT_LE(largest_opening(world), 1e-13);
  }
}

/// Four-bar with a crank of 0.3 m that points up, a coupler of 1 m, a rocker and a base of 1 m, on
/// hinges about y.
World four_bar(const WorldOptions& options, double rocker = 0.7) {
  World world(options);
  const std::array<double, 3> lengths{0.3, 1.0, rocker};
  // The joint of coupler and rocker is where two circles meet.
  const Vector3d tip(0.0, 0.0, 0.3), base(1.0, 0.0, 0.0);
  const Vector3d between = base - tip;
  const double along = (1.0 - rocker * rocker + between.squaredNorm()) / (2.0 * between.norm());
  const double across = std::sqrt(1.0 - along * along);
  const Vector3d unit = between.normalized();
  const Vector3d knee = tip + along * unit + across * Vector3d(-unit.z(), 0.0, unit.x());
  const std::array<Vector3d, 4> points{Vector3d::Zero(), tip, knee, base};
  std::vector<BodyId> ids{kWorldBody};
  for (std::size_t i = 0; i < 3; ++i) {
    Body bar = make_body("bar_" + std::to_string(i), Box{{lengths[i], 0.05, 0.05}}, lengths[i],
                         0.5 * (points[i] + points[i + 1]));
    bar.no_collision = true;
    bar.state.orientation =
        Quaterniond::FromTwoVectors(Vector3d::UnitX(), points[i + 1] - points[i]);
    ids.push_back(world.add_body(bar));
  }
  ids.push_back(kWorldBody);
  const auto state_of = [&](BodyId id) { return id == kWorldBody ? BodyState{} : world.state(id); };
  for (std::size_t i = 0; i < 4; ++i) {
    Joint hinge;
    hinge.name = "hinge_" + std::to_string(i);
    hinge.kind = JointKind::kHinge;
    hinge.body_a = ids[i];
    hinge.body_b = ids[i + 1];
    const BodyState a = state_of(ids[i]), b = state_of(ids[i + 1]);
    hinge.anchor_a = a.orientation.conjugate() * (points[i] - a.position);
    hinge.anchor_b = b.orientation.conjugate() * (points[i] - b.position);
    const Quaterniond frame = frame_along(Vector3d::UnitY());
    hinge.frame_a = a.orientation.conjugate() * frame;
    hinge.frame_b = b.orientation.conjugate() * frame;
    world.add_joint(hinge);
  }
  return world;
}

// The global error falls with the order of the pair while it is above rounding.
TEST(TreeClosings, HaveTheOrderOfThePair) {
  const auto after = [](int order, int steps) {
    WorldOptions options;
    options.method = Method::kRungeKutta;
    options.order = order;
    options.tolerance = 0.0;
    options.time_step = 0.4 / steps;
    World world = four_bar(options);
    for (int i = 0; i < steps; ++i) world.step();
    return world;
  };
  const World reference = after(8, 400);
  const auto error = [&](int order, int steps) {
    return difference(after(order, steps), reference);
  };
  EXPECT_NEAR(std::log2(error(5, 20) / error(5, 40)), 5.0, 0.6);
  EXPECT_NEAR(std::log2(error(8, 10) / error(8, 20)), 8.0, 1.5);
}

// A crank that a motor turns at constant rate: the angle of the rocker follows from the lengths
// alone, and the torque of the motor from the power that bodies and weights take.
TEST(TreeClosings, FollowACrank) {
  for (const std::size_t driven : {0u, 3u}) {  // a joint of the tree, and the one that closes it
    SCOPED_TRACE(driven);
    WorldOptions options;
    options.method = Method::kRungeKutta;
    options.tolerance = 1e-10;
    World world = four_bar(options);
    const JointId crank = world.joint_ids()[driven];
    world.set_law(crank, 0, [] {
      CoordinateLaw law;
      law.motor.emplace().bias = 0.5;
      return law;
    }());
    world.step();
    const double before = world.energy();
    double work = 0.0;
    for (int i = 0; i < 100; ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      EXPECT_LE(largest_opening(world), 1e-14);
      // The mean torque over a step times the angle of the step.
      work += world.joint_state(crank).coordinates[0].effort * 0.5 * options.time_step;
      EXPECT_NEAR(world.energy() - before, work, 1e-8);
    }
    EXPECT_NEAR(world.joint_state(crank).coordinates[0].velocity, 0.5, 1e-12);
  }
}

// A shaft in two bearings, the second of which closes a loop: whole turns are counted alike on
// both, whether few or many are made in a step. A motor on the first gives x = A (1 − cos ω t)/ω.
TEST(TreeClosings, CountTurnsOfBothBearings) {
  for (const double amplitude : {3.0, 100.0, 3000.0})
    for (const double step : {0.1, 0.01}) {
      SCOPED_TRACE(std::to_string(amplitude) + " " + std::to_string(step));
      WorldOptions options;
      options.method = Method::kRungeKutta;
      options.time_step = step;
      World world(options);
      Body shaft = make_body("shaft", Box{{0.1, 0.1, 1.0}}, 1.0, Vector3d::Zero());
      shaft.no_collision = true;
      const BodyId id = world.add_body(shaft);
      for (const double z : {-0.5, 0.5}) {
        Joint bearing;
        bearing.name = z < 0.0 ? "driven" : "other";
        bearing.kind = JointKind::kHinge;
        bearing.body_b = id;
        bearing.anchor_a = bearing.anchor_b = {0.0, 0.0, z};
        if (z < 0.0) {
          auto& motor = bearing.coordinates[0].motor.emplace();
          motor.amplitude = amplitude;
          motor.frequency = 1.0;
        }
        world.add_joint(bearing);
      }
      for (int i = 0; i < std::lround(0.7 / step); ++i) ASSERT_FALSE(world.step().outcome.failed);
      const double turned = amplitude * (1.0 - std::cos(2.0 * kPi * world.time())) / (2.0 * kPi);
      for (const JointId joint : world.joint_ids())
        EXPECT_NEAR(world.joint_state(joint).coordinates[0].position, turned, 1e-9 * amplitude);
    }
}

// A loop that comes near a singular pose without passing it, in steps without a tolerance of up to
// half a turn: too long ones are rejected. Without that the energy rose by 94 J of 6 J.
TEST(TreeClosings, DoNotExplodeWithoutATolerance) {
  for (const double rocker : {0.31, 0.299})
    for (const double step : {0.1, 0.05, 0.02}) {
      SCOPED_TRACE(std::to_string(rocker) + " " + std::to_string(step));
      WorldOptions options;
      options.method = Method::kRungeKutta;
      options.tolerance = 0.0;
      options.time_step = step;
      World world = four_bar(options, rocker);
      BodyState pushed = world.state(world.body_ids().front());
      pushed.angular_velocity = {0.0, 20.0, 0.0};
      world.set_state(world.body_ids().front(), pushed);
      world.step();
      const double energy = world.energy();
      for (double t = step; t < 1.0; t += step) {
        ASSERT_FALSE(world.step().outcome.failed);
        EXPECT_NEAR(world.energy(), energy, 0.1 * energy);
      }
    }
}

// Where crank and rocker are equally long, all bars are in line twice a turn, and the loop may go
// on in two ways. The rows of all joints pass the pose.
TEST(TreeClosings, PassSingularPoses) {
  WorldOptions options;
  options.method = Method::kRungeKutta;
  options.tolerance = 1e-8;
  World world = four_bar(options, 0.3);
  BodyState pushed = world.state(world.body_ids().front());
  pushed.angular_velocity = {0.0, 4.0, 0.0};
  world.set_state(world.body_ids().front(), pushed);
  world.step();
  const double energy = world.energy();
  int passed = 0;
  for (int i = 0; i < 400; ++i) {
    const double before = world.joint_state(world.joint_ids().front()).coordinates[0].position;
    ASSERT_FALSE(world.step().outcome.failed) << i;
    const double after = world.joint_state(world.joint_ids().front()).coordinates[0].position;
    passed += std::floor(before / kPi + 0.5) != std::floor(after / kPi + 0.5) ? 1 : 0;
    EXPECT_NEAR(world.energy(), energy, 1e-6);
    EXPECT_LE(largest_opening(world), 1e-10);
    EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), world.state_hash()) << i;
  }
  EXPECT_GE(passed, 4);
}

// Joints of all kinds, on loops in joint coordinates, break off, are added, pushed and stopped.
TEST(TreeClosings, TakeEditsAndBreaking) {
  for (int seed = 0; seed < kSeeds / 2; ++seed) {
    SCOPED_TRACE(seed);
    RandomTree tree = random_planar_loops(seed);
    tree.options.tolerance = 1e-10;
    World world = tree.world(), rows = tree.world_by_rows();
    const auto step_both = [&] {
      for (int i = 0; i < 5; ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        ASSERT_FALSE(rows.step().outcome.failed);
      }
    };
    step_both();
    const std::string last = tree.links.back().joint.name;
    for (World* each : {&world, &rows}) each->remove_joint(each->find_joint(last));
    step_both();
    for (World* each : {&world, &rows}) {
      const BodyId body = each->body_ids().back();
      BodyState pushed = each->state(body);
      pushed.linear_velocity += Vector3d(0.3, -0.2, 0.1);
      each->set_state(body, pushed);
    }
    step_both();
    // A rod between any two points closes a loop of another kind at run time.
    for (World* each : {&world, &rows}) {
      Joint rod;
      rod.name = "rod";
      rod.kind = JointKind::kDistance;
      rod.body_b = each->body_ids().back();
      rod.anchor_a = {2.0, 1.0, 1.0};
      each->add_joint(rod);
    }
    step_both();
    EXPECT_LE(difference(world, rows), 1e-7);
    EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), world.state_hash());
  }
}

}  // namespace
}  // namespace constraint_sim::engine
