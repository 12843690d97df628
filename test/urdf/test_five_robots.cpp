// Five robots in the shape of public ones (test/urdf/robots): each loads, holds its pose and
// follows a trajectory, with all collisions on.

#include <cmath>
#include <tuple>

#include "robots.h"
#include "sim/trajectories.h"
#include "urdf/contact_exceptions.h"

namespace constraint_sim {
namespace {

using engine::World;

const char* const kFolder = CONSTRAINT_SIM_SOURCE_DIR "/test/urdf/robots";

/// A robot with motors to positions, for joints that have an effort.
struct Case {
  std::string name;
  std::vector<const char*> motors;
  std::string extra;  ///< further keys of the YAML

  World world(double rate, Robot* robot) const {
    engine::WorldOptions world_options;
    world_options.time_step = 1.0 / rate;
    World world(world_options);
    RobotOptions options;
    options.fixed = true;
    options.folder = kFolder;
    options.extra = extra + "\nmotors: {";
    for (const char* motor : motors) options.extra += std::string(motor) + ", ";
    options.extra += "}";
    *robot = add_robot(read_text(std::string(kFolder) + "/" + name + ".urdf"), options, &world);
    return world;
  }
};

/// Returns the YAML beside a robot without its motors, which are servos, or rates.
std::string without_motors(const std::string& name) {
  const std::string text = read_text(std::string(kFolder) + "/" + name + ".yaml");
  const std::size_t motors = text.find("motors:"), positions = text.find("positions:");
  return text.substr(0, motors) + (positions == std::string::npos ? "" : text.substr(positions));
}

std::vector<Case> cases() {
  return {{"arm6",
           {"joint_1: {position: 0}", "joint_2: {position: 0}", "joint_3: {position: 0}",
            "joint_4: {position: 0}", "joint_5: {position: 0}", "joint_6: {position: 0}",
            "finger_joint: {position: 0}"},
           ""},
          {"delta",
           {"m0: {position: 0}", "m1: {position: 0}", "m2: {position: 0}"},
           without_motors("delta")},
          {"fivebar", {"l_crank: {bias: 0}", "r_crank: {bias: 0}"}, without_motors("fivebar")},
          {"gantry", {"x: {position: 0}", "y: {position: 0}", "z: {position: 0}"}, ""},
          {"quad12",
           {"FL_hip_joint: {bias: 0}", "FR_hip_joint: {bias: 0}", "RL_hip_joint: {bias: 0}",
            "RR_hip_joint: {bias: 0}", "FL_thigh_joint: {bias: 0}", "FR_thigh_joint: {bias: 0}",
            "RL_thigh_joint: {bias: 0}", "RR_thigh_joint: {bias: 0}", "FL_calf_joint: {bias: 0}",
            "FR_calf_joint: {bias: 0}", "RL_calf_joint: {bias: 0}", "RR_calf_joint: {bias: 0}"},
           ""}};
}

std::vector<engine::JointId> driven(const World& world) {
  std::vector<engine::JointId> joints;
  for (const engine::JointId id : world.joint_ids())
    if (engine::info(world.joint(id).kind).coordinates > 0 && world.joint(id).coordinates[0].motor)
      joints.push_back(id);
  return joints;
}

double position(const World& world, engine::JointId id) {
  return world.joint_state(id).coordinates[0].position;
}

// Rigid motors within their efforts leave rounding; 1e-9 rad is far below the promised 1e-3.
TEST(FiveRobots, HoldTheirPoses) {
  for (const Case& robot_case : cases())
    for (const double rate : {30.0, 240.0}) {
      SCOPED_TRACE(robot_case.name + " at " + std::to_string(rate));
      Robot robot;
      World world = robot_case.world(rate, &robot);
      const World first = world;
      ASSERT_EQ(driven(world).size(), robot_case.motors.size());
      double most = 0.0;
      for (int i = 0; i < static_cast<int>(5.0 * rate); ++i) {
        world.step();
        ASSERT_FALSE(world.report().outcome.failed);
        for (const engine::JointId id : driven(world))
          most = std::max(most, std::abs(position(world, id) - position(first, id)));
      }
      EXPECT_LT(most, 1e-9);
    }
}

// There and back along quintics within 2 s. 1e-8 rad: in a tick that begins or ends at rest the
// rate jumps by 3 %, for which a motor within its effort needs some microseconds. At 1/1000 s the
// first 0.3 s are enough, since one such tick is in them. 1e-6 rad in the 0.1 s after the end:
// motors to positions set out from the rates at the end, which are off by 1e-6 rad/s where the arm
// left event_driven for sequential_impulses in the last tick.
TEST(FiveRobots, FollowTrajectories) {
  for (const Case& robot_case : cases())
    for (const double rate : {30.0, 60.0, 240.0, 1000.0}) {
      SCOPED_TRACE(robot_case.name + " at " + std::to_string(rate));
      Robot robot;
      World world = robot_case.world(rate, &robot);
      JointTrajectory trajectory;
      trajectory.points.resize(2);
      std::map<std::uint32_t, Spline> splines;
      for (const engine::JointId id : driven(world)) {
        const engine::Joint& joint = world.joint(id);
        const double from = position(world, id);
        const double by = joint.kind == engine::JointKind::kSlider ? 0.03 : 0.2;
        const double to = from + by > joint.coordinates[0].upper ? from - by : from + by;
        trajectory.joints.push_back(joint.name);
        for (const auto& [i, end] : {std::pair{0, to}, std::pair{1, from}}) {
          JointTrajectory::Point& point = trajectory.points[static_cast<std::size_t>(i)];
          point.time = 1.0 + i;
          point.positions.push_back(end);
          point.velocities.push_back(0.0);
          point.accelerations.push_back(0.0);
        }
        splines.emplace(
            id.value,
            Spline({{0.0, from, 0.0, 0.0}, {1.0, to, 0.0, 0.0}, {2.0, from, 0.0, 0.0}}, 5));
      }
      Trajectories trajectories;
      trajectories.begin(world, trajectory);
      double most = 0.0, most_after = 0.0;
      for (int i = 0; i < static_cast<int>((rate > 500.0 ? 0.3 : 2.1) * rate); ++i) {
        trajectories.before_step(&world);
        world.step();
        ASSERT_FALSE(world.report().outcome.failed);
        double& largest = world.time() < 2.0 + 1e-9 ? most : most_after;
        for (const engine::JointId id : driven(world))
          largest = std::max(largest,
                             std::abs(position(world, id) - splines.at(id.value).at(world.time())));
      }
      EXPECT_LT(most, 1e-8);
      EXPECT_LT(most_after, 1e-6);
    }
}

// `hold` gives a motor to each joint with an effort that has none: not to elbows, which have no
// limits and hang in the loop, and not to joints that mimic.
TEST(FiveRobots, HoldGivesMotors) {
  for (const auto& [name, extra, motors] :
       {std::tuple{"arm6", std::string("hold: true"), 7},
        std::tuple{"quad12", std::string("hold: true"), 12},
        std::tuple{"fivebar", without_motors("fivebar") + "hold: true", 2}}) {
    Robot robot;
    World world = Case{name, {}, extra}.world(100.0, &robot);
    EXPECT_EQ(driven(world).size(), static_cast<std::size_t>(motors)) << name;
    for (const engine::JointId id : driven(world)) {
      const engine::Motor& motor = *world.joint(id).coordinates[0].motor;
      EXPECT_EQ(motor.max_force, robot.bounds.at(world.joint(id).name).effort);
      EXPECT_NEAR(*motor.position, position(world, id), 1e-12);  // rounding of the pose
    }
  }
}

// The answer names what deviates from the URDF.
TEST(FiveRobots, SayWhatDeviates) {
  std::map<std::string, std::vector<std::string>> warnings;
  for (const Case& robot_case : cases()) {
    Robot robot;
    robot_case.world(100.0, &robot);
    warnings[robot_case.name] = robot.warnings;
  }
  const std::string mesh = std::string("file://") + kFolder + "/";
  EXPECT_EQ(warnings["arm6"],
            (std::vector<std::string>{
                "elements that are not read: <transmission> (line 26), <gazebo> (line 27)"}));
  EXPECT_EQ(warnings["gantry"], (std::vector<std::string>{
                                    "link 'bridge': the mesh '" + mesh +
                                        "bridge.stl' collides as its convex hull with 8 vertices",
                                    "link 'carriage': the mesh '" + mesh +
                                        "carriage.dae' collides as its convex hull with 4 vertices",
                                    "link 'hook': the mesh '" + mesh +
                                        "hook.stl' collides as its convex hull with 8 vertices"}));
  EXPECT_EQ(warnings["fivebar"], std::vector<std::string>{});
  ASSERT_EQ(warnings["quad12"].size(), 4u);
  EXPECT_EQ(warnings["quad12"][0],
            "joint 'FL_calf_joint' begins at -0.900000, since 0 is beyond its limits");
  // the platform is 0.04 m below the place where the rods fit: sqrt(0.3² + 0.5²) - 0.55 = 0.0331 m
  ASSERT_EQ(warnings["delta"].size(), 6u);
  EXPECT_EQ(warnings["delta"][0],
            "constraint 'rod0a' does not fit the links by 0.0331; it closes within closing_time");
}

// Virtual work of a delta with level arms, whose rods fit: a servo carries the arm of 0.25 kg at
// 0.1 m, and a third of the platform of 0.3 kg, which sinks by 0.2 m/rad: 9.81 (0.25·0.1 +
// 0.3·0.2/3) = 0.4415 N m. Three digits are printed.
TEST(FiveRobots, ServosInLoopsThatGravityTurnsAreReported) {
  std::string text = read_text(std::string(kFolder) + "/delta.urdf");
  text.replace(text.find("0 0 -0.50"), 9, "0 0 -0.46097722286464435");
  RobotOptions options;
  options.extra = without_motors("delta") +
                  "\nmotors: {m0: {position: 0, servo_stiffness: 10}, m1: {position: 0, "
                  "servo_stiffness: 1e4}, m2: {position: 0}}";
  World world;
  EXPECT_EQ(add_robot(text, options, &world).warnings,
            (std::vector<std::string>{
                "joint 'm0': gravity alone turns its servo by 0.0441 rad; servo_stiffness 446 N "
                "m/rad keeps that below 0.001 rad, and a position without servo holds it"}));
}

// Feet and palm are parts of the bodies of the links that they are fixed to, so neighbours of these
// do not collide with them, and no pair needs an exception.
TEST(FiveRobots, FeetAndPalmArePartsOfTheirLinks) {
  Robot robot;
  for (const std::size_t number : {0u, 4u}) {
    World world = cases()[number].world(100.0, &robot);
    for (const engine::JointId id : world.joint_ids()) {
      EXPECT_FALSE(is_contact_exception(world.joint(id))) << world.joint(id).name;
      EXPECT_NE(world.joint(id).kind, engine::JointKind::kWeld) << world.joint(id).name;
    }
    const bool has_compound =
        std::any_of(robot.bodies.begin(), robot.bodies.end(), [&](const std::string& body) {
          return engine::part_count(world.body(world.find_body(body)).shape) > 1;
        });
    EXPECT_TRUE(has_compound);
    world.step();
    EXPECT_TRUE(world.contacts().empty());
  }
}

TEST(FiveRobots, MeshesAreShownByTheirFiles) {
  Robot robot;
  cases()[3].world(100.0, &robot);
  std::vector<std::string> files;
  for (const RobotVisual& visual : robot.visuals)
    if (visual.geometry->type == urdf::Geometry::MESH)
      files.push_back(static_cast<const urdf::Mesh&>(*visual.geometry).filename);
  const std::string folder = std::string("file://") + kFolder + "/";
  EXPECT_EQ(files, (std::vector<std::string>{folder + "bridge.stl", folder + "carriage.dae",
                                             folder + "hook.stl"}));
}

}  // namespace
}  // namespace constraint_sim
