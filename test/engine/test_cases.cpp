// Scenes of test/engine/cases with known results, at time steps of 1/30, 1/60, 1/240 and 1/1000 s.
// The first comment of each scene states the source of its result. The result agrees to 1e-6, or
// the run reports the error by name.

#include "constraint_sim/engine/scene.h"
#include "support.h"
#include "test_paths.h"

namespace constraint_sim::engine {
namespace {

constexpr double kCaseTimeSteps[] = {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0};

World load_case(const std::string& name, double time_step) {
  World world = load_scene_file(CONSTRAINT_SIM_SOURCE_DIR "/test/engine/cases/" + name + ".yaml");
  WorldOptions options = world.options();
  options.time_step = time_step;
  world.set_options(options);
  return world;
}

/// Steps to a time [s].
void run_case_until(World& world, double time) {
  const auto steps = std::lround((time - world.time()) / world.options().time_step);
  for (long i = 0; i < steps; ++i)
    ASSERT_FALSE(world.step().outcome.failed) << "at t = " << world.time();
}

/// Position of a body after a time [s].
struct Place {
  const char* scene;
  double duration;
  const char* body;
  Eigen::Vector3d position;
};

void PrintTo(const Place& place, std::ostream* os) { *os << place.scene; }

class Cases : public testing::TestWithParam<Place> {};

TEST_P(Cases, EndWhereTheyShould) {
  const Place& place = GetParam();
  for (const double h : kCaseTimeSteps) {
    World world = load_case(place.scene, h);
    run_case_until(world, place.duration);
    const Eigen::Vector3d& p = world.state(world.find_body(place.body)).position;
    EXPECT_LE((p - place.position).norm(), 1e-6) << p.transpose() << " at 1/" << 1.0 / h;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Places, Cases,
    testing::Values(Place{"parallel_falls", 1.0, "tray", {0.0, 0.0, -4.905}},
                    Place{"parallel_keeps_momentum", 1.0, "tray", {1.0, 2.0, 3.0}},
                    Place{"spring_gun_through_wall", 1.0, "ball", {0.2, 0.0, 0.0}},
                    Place{"wrench_through_wall", 0.5, "ball", {0.03, 0.0, 0.0}},
                    Place{"motor_through_wall", 0.5, "ball", {0.03, 0.0, 0.0}},
                    // the ring falls from rest when the ball has fallen 0.2 m
                    Place{"break_by_impact", 1.0, "ring", {0.0, 0.0, -4.1240911177}}),
    [](const auto& place) { return std::string(place.param.scene); });

// A gear keeps the fingers from being event-driven. Impulses hold the box between them, to two
// digits of the distance at 1/1000 s; at longer time steps they report the joints that they open.
TEST(Case, GrippersStopAtTheirBox) {
  for (const double h : kCaseTimeSteps) {
    World world = load_case("gripper_through_box", h);
    run_case_until(world, 0.5);
    for (const char* const finger : {"l", "r"}) {
      const double right = finger[0] == 'l' ? -0.06 : 0.06;
      const double x = world.state(world.find_body(finger)).position.x();
      if (h > 0.9e-3 && world.report().joints.unclosed > 0)
        EXPECT_NEAR(x, right, 0.02) << finger << " at 1/" << 1.0 / h;
      else
        EXPECT_NEAR(x, right, 0.005) << finger << " at 1/" << 1.0 / h;
    }
  }
}

// Expected x and z come from runge_kutta at tolerances of 1e-8 and 1e-13.
TEST(Case, SlenderArmsFollowTheirServo) {
  for (const double h : kCaseTimeSteps) {
    World world = load_case("slender_arm_servo", h);
    run_case_until(world, 2.0);
    const Eigen::Vector3d& p = world.state(world.find_body("b")).position;
    EXPECT_NEAR(p.x(), 1.03191236, 1e-6) << "at 1/" << 1.0 / h;
    EXPECT_NEAR(p.z(), -0.95677395, 1e-6) << "at 1/" << 1.0 / h;
  }
}

// A finger driven exactly to its joint's limit rests there: it reaches its stop once or not at all.
TEST(Case, MotorsRestOnTheirStops) {
  World world = load_scene_file(CONSTRAINT_SIM_SOURCE_DIR "/test/engine/cases/arm_slow.yaml");
  const JointId finger = world.find_joint("finger_joint");
  int events = 0, reached = 0;
  for (int i = 0; i < 400; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    for (const Event& event : world.events()) {
      ++events;
      if (event.joint == finger && event.kind == EventKind::kLimitReached) ++reached;
    }
  }
  EXPECT_LE(events, 40);
  EXPECT_LE(reached, 1);
  EXPECT_NEAR(world.joint_state(finger).coordinates[0].position, 0.045, 1e-9);
  EXPECT_LE(std::abs(world.joint_state(finger).coordinates[0].velocity), 1e-9);
}

// Motors of any strength move from stop to stop, pressed against the stops or not.
TEST(Case, MotorsGoFromStopToStop) {
  for (const double max_force : {0.0, 1.0, 9.0, 11.0, 100.0}) {
    for (const double h : kCaseTimeSteps) {
      WorldOptions options;
      options.time_step = h;
      World world(options);
      Body load = make_body("load", Box{{0.1, 0.1, 0.1}}, 1.0, Eigen::Vector3d::Zero());
      load.no_collision = true;
      Joint rail;
      rail.name = "rail";
      rail.kind = JointKind::kSlider;
      rail.body_b = world.add_body(load);
      rail.coordinates[0].lower = 0.0;
      rail.coordinates[0].upper = 0.2;
      const JointId id = world.add_joint(rail);
      Motor motor;
      motor.max_force = max_force;
      int events = 0;
      for (const double goal : {0.2, 0.0, 0.2}) {
        motor.position = goal;
        world.set_motor(id, 0, motor);
        for (int i = 0; i < static_cast<int>(std::lround(2.0 / h)); ++i) {
          ASSERT_FALSE(world.step().outcome.failed);
          events += static_cast<int>(world.events().size());
        }
        const bool is_weak = max_force > 0.0 && max_force < 9.81;  // weaker than its weight
        EXPECT_NEAR(world.joint_state(id).coordinates[0].position, is_weak ? 0.0 : goal, 1e-9)
            << max_force << " N at 1/" << 1.0 / h;
      }
      EXPECT_LE(events, 30) << max_force << " N at 1/" << 1.0 / h;
    }
  }
}

// A target that is sent in each step, as by a topic, is reached.
TEST(Case, RepeatedTargetsAreReached) {
  for (const double h : kCaseTimeSteps) {
    WorldOptions options;
    options.time_step = h;
    options.gravity.setZero();
    World world(options);
    Body load = make_body("load", Box{{0.1, 0.1, 0.1}}, 1.0, Eigen::Vector3d::Zero());
    load.no_collision = true;
    Joint rail;
    rail.name = "rail";
    rail.kind = JointKind::kSlider;
    rail.body_b = world.add_body(load);
    const JointId id = world.add_joint(rail);
    Motor motor;
    motor.position = 0.3;
    for (int i = 0; i < static_cast<int>(std::lround(1.0 / h)); ++i) {
      world.set_motor(id, 0, motor);
      ASSERT_FALSE(world.step().outcome.failed);
    }
    EXPECT_NEAR(world.joint_state(id).coordinates[0].position, 0.3, 1e-9) << "at 1/" << 1.0 / h;
  }
}

// 1e-6 rad: each stop is met to 1e-15 s, 300 times.
TEST(Case, GearedArmKeepsItsTurnsBetweenStops) {
  for (const double h : kCaseTimeSteps) {
    World world = load_case("geared_arm_stop", h);
    run_case_until(world, 3.0);
    const double arm = world.joint_state(world.find_joint("ha")).coordinates[0].position;
    const double rotor = world.joint_state(world.find_joint("hr")).coordinates[0].position;
    EXPECT_NEAR(arm, 0.0, 1e-6) << "at 1/" << 1.0 / h;
    EXPECT_NEAR(rotor, 50.0 * arm, 1e-6) << "at 1/" << 1.0 / h;
  }
}

// 1e-6 of the energy: the tolerance of runge_kutta, summed over 2 s.
TEST(Case, SpringAndStopsKeepTheEnergy) {
  for (const double h : kCaseTimeSteps) {
    World world = load_case("spring_and_stops_gain", h);
    for (int i = 0; i < static_cast<int>(std::lround(2.0 / h)); ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      ASSERT_NEAR(world.energy(), 300.0, 300.0 * 1e-6) << "at 1/" << 1.0 / h;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
