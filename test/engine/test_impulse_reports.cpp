// Errors of contacts by impulses are reported by name: overlap, creep,
// and joints that they open. Correct states are not reported.

#include <set>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "support.h"
#include "test_paths.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kStackTimeSteps[] = {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0};

struct Stack {
  const char* scene;
  double duration;
};

void PrintTo(const Stack& stack, std::ostream* os) { *os << stack.scene; }

class ImpulseStacks : public testing::TestWithParam<Stack> {};

// Oracle: statics, nothing moves. Where a body moves by more than the overlap of contacts, or by
// more than 1e-3 of its size along the floor, a warning names a body of the stack.
TEST_P(ImpulseStacks, StandOrAreReported) {
  for (const double h : kStackTimeSteps) {
    World world = load_scene_file(std::string(CONSTRAINT_SIM_SOURCE_DIR "/test/engine/cases/") +
                                  GetParam().scene + ".yaml");
    WorldOptions options = world.options();
    options.time_step = h;
    world.set_options(options);
    std::vector<Vector3d> start;
    for (const BodyId id : world.body_ids()) start.push_back(world.state(id).position);
    std::set<std::string> reported;
    double moved = 0.0;
    for (int i = 0; i < static_cast<int>(std::lround(GetParam().duration / h)); ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      for (const StepWarning& warning : faults_of(world)) reported.insert(warning.name);
      for (std::size_t k = 0; k < start.size(); ++k)
        moved = std::max(moved, (world.state(world.body_ids()[k]).position - start[k]).norm());
    }
    // six boxes on each other sink in by g h² each
    if (moved > 6.0 * kGravity * h * h + 5e-4) {
      EXPECT_FALSE(reported.empty())
          << GetParam().scene << " moved by " << moved << " m at 1/" << 1.0 / h;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Stacks, ImpulseStacks,
                         testing::Values(Stack{"heavy_cylinder_on_light", 3.0},
                                         Stack{"small_cylinders", 10.0},
                                         Stack{"six_equal_boxes", 5.0},
                                         Stack{"tower_1_to_1e5", 5.0}),
                         [](const auto& stack) { return std::string(stack.param.scene); });

World cylinder_on_floor(double h, double tilt) {
  WorldOptions options;
  options.time_step = h;
  World world(options);
  Body floor = make_body("floor", Plane{}, 1.0, Vector3d::Zero());
  floor.type = BodyType::kStatic;
  floor.friction = 0.6;
  floor.state.orientation = Eigen::Quaterniond(Eigen::AngleAxisd(tilt, Vector3d::UnitY()));
  world.add_body(floor);
  Body cylinder = make_body("cylinder", Cylinder{0.1, 0.1}, 1.0,
                            floor.state.orientation * Vector3d(0.0, 0.0, 0.05));
  cylinder.state.orientation = floor.state.orientation;
  cylinder.friction = 0.6;
  world.add_body(cylinder);
  return world;
}

// Islands advanced by impulses have an estimate like others, also where `auto` watches the gap of
// their contact.
TEST(ImpulseReports, HaveAnEstimate) {
  World world = cylinder_on_floor(1.0 / 60.0, 0.0);
  Body ball = make_body("ball", Sphere{0.1}, 1.0, {5.0, 0.0, 5.0});
  world.add_body(ball);
  for (int i = 0; i < 10; ++i) world.step();
  int by_impulses = 0;
  for (const Island& island : world.islands()) {
    EXPECT_FALSE(std::isnan(island.local_error));
    EXPECT_LE(island.local_error, world.report().local_error);
    by_impulses += uses_impulses(island.method) ? 1 : 0;
  }
  EXPECT_EQ(by_impulses, 1);
}

TEST(ImpulseReports, SayNothingOfWhatRests) {
  for (const double h : kStackTimeSteps) {
    for (const double tilt : {0.0, 0.2}) {
      World world = cylinder_on_floor(h, tilt);
      for (int i = 0; i < static_cast<int>(std::lround(2.0 / h)); ++i) {
        world.step();
        ASSERT_TRUE(faults_of(world).empty())
            << to_string(faults_of(world).front()) << " at 1/" << 1.0 / h << ", " << i;
      }
    }
  }
}

// A ball rolls while it spins about the vertical: its point of contact moves on by v h in a step,
// where the spin has a velocity across the path, which is no slip.
TEST(ImpulseReports, ABallThatRollsAndSpinsDoesNotCreep) {
  for (const Method method : {Method::kTimeStepping, Method::kSequentialImpulses})
    for (const double h : {1.0 / 100.0, 1.0 / 1000.0}) {
      constexpr double kRadius = 0.05, kSpeed = 1.0, kSpin = 40.0;  // [m], [m/s], [rad/s]
      WorldOptions options;
      options.method = method;
      options.time_step = h;
      World world(options);
      Body floor = make_body("floor", Plane{}, 1.0, Vector3d::Zero());
      floor.type = BodyType::kStatic;
      floor.friction = 0.8;
      world.add_body(floor);
      Body ball = make_body("ball", Sphere{kRadius}, 1.0, Vector3d(0.0, 0.0, kRadius));
      ball.friction = 0.8;
      ball.state.linear_velocity = Vector3d(kSpeed, 0.0, 0.0);
      ball.state.angular_velocity = Vector3d(0.0, kSpeed / kRadius, kSpin);
      const BodyId id = world.add_body(ball);
      for (int i = 0; i < static_cast<int>(std::lround(2.0 / h)); ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        ASSERT_FALSE(world.report().contacts.creep_body) << "1/" << 1.0 / h << " step " << i;
      }
      EXPECT_NEAR(world.state(id).position.x(), 2.0 * kSpeed, 1e-3);
      EXPECT_NEAR(world.state(id).angular_velocity.z(), kSpin, 1e-3);
    }
}

}  // namespace
}  // namespace constraint_sim::engine
