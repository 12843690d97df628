// Links without mass: joints that move no mass, links between joints, and random robots.

#include <algorithm>
#include <cmath>
#include <map>

#include "constraint_sim/engine/plan.h"
#include "draw.h"
#include "robots.h"
#include "urdf/contact_exceptions.h"
#include "urdf/massless.h"
#include "urdf/parse.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using engine::refusal;
using engine::World;

const char* const kBody =
    "<inertial><origin xyz='0.2 0.1 -0.3'/><mass value='2'/>"
    "<inertia ixx='0.02' ixy='0' ixz='0' iyy='0.03' iyz='0' izz='0.015'/></inertial>";
const char* const kAboutX = "<axis xyz='1 0 0'/>";
const char* const kAboutY = "<axis xyz='0 1 0'/>";
const char* const kAboutZ = "<axis xyz='0 0 1'/>";

std::string link_of(const std::string& name, const std::string& inside = "") {
  return "<link name='" + name + "'>" + inside + "</link>";
}

std::string joint_of(const std::string& name, const std::string& type, const std::string& parent,
                     const std::string& child, const std::string& inside = "") {
  return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent +
         "'/><child link='" + child + "'/>" + inside + "</joint>";
}

Robot add_links(const std::string& inside, World* world, const RobotOptions& options = {}) {
  return add_robot("<robot name='r'>" + inside + "</robot>", options, world);
}

RobotOptions fixed_at(const Vector3d& position) {
  RobotOptions options;
  options.fixed = true;
  options.pose.position = position;
  return options;
}

std::string all_warnings(const Robot& robot) {
  std::string all;
  for (const std::string& warning : robot.warnings) all += warning + "; ";
  return all;
}

bool says(const Robot& robot, const std::string& part) {
  return all_warnings(robot).find(part) != std::string::npos;
}

// A tool frame on a turning wrist: the world is the one of a URDF that has the joint fixed.
TEST(Massless, JointsThatMoveNoMassAreFixed) {
  const std::string start = link_of("base", kBody) + link_of("wrist", kBody) + link_of("tool0") +
                            link_of("tip") + joint_of("a", "continuous", "base", "wrist", kAboutY) +
                            joint_of("t", "fixed", "tool0", "tip", "<origin xyz='0 0 0.1'/>");
  RobotOptions options;
  options.extra = "{positions: {turn: 0.5}, motors: {turn: {bias: 1}}}";
  World world, fixed;
  const Robot robot =
      add_links(start + joint_of("turn", "continuous", "wrist", "tool0", kAboutX), &world, options);
  add_links(start + joint_of("turn", "fixed", "wrist", "tool0", "<origin rpy='0.5 0 0'/>"), &fixed);
  EXPECT_EQ(world.state_hash(), fixed.state_hash());
  EXPECT_EQ(robot.constraints, (std::vector<std::string>{"a"}));
  EXPECT_EQ(robot.fixed_joints, (std::map<std::string, double>{{"turn", 0.5}}));
  EXPECT_TRUE(says(robot,
                   "joints that move no mass are fixed, since these links have no "
                   "<inertial>: 'turn' at 0.5 (link 'tool0')"))
      << all_warnings(robot);
  EXPECT_TRUE(says(robot, "joint 'turn' is fixed, since it moves no mass; its motor is left out"));
  ASSERT_EQ(robot.links.size(), 4u);
  Isometry3d tip(Eigen::AngleAxisd(0.5, Vector3d::UnitX()));
  tip.translate(Vector3d(0.0, 0.0, 0.1));
  EXPECT_LT(distance(frame_of(world, robot.links.back()), tip), 1e-15);  // rounding
}

// Joints that mimic a fixed joint stand as well, although they move a mass.
TEST(Massless, FollowersOfFixedJointsAreFixed) {
  World world;
  const Robot robot = add_links(
      link_of("base", kBody) + link_of("dial") + link_of("finger", kBody) + link_of("nail", kBody) +
          joint_of("lead", "continuous", "base", "dial", kAboutY) +
          joint_of("follow", "continuous", "base", "finger",
                   std::string(kAboutX) + "<mimic joint='lead' multiplier='2' offset='0.25'/>") +
          joint_of("last", "continuous", "finger", "nail",
                   std::string(kAboutX) + "<mimic joint='follow'/>"),
      &world);
  EXPECT_EQ(world.body_ids().size(), 1u);
  EXPECT_EQ(robot.fixed_joints,
            (std::map<std::string, double>{{"follow", 0.25}, {"last", 0.25}, {"lead", 0.0}}));
}

// Two hinges on a massless cross are a universal joint. The deviation grows with the share of the
// mass: 2e-6 m in 2 s at 1e-4, as computed with shares of 1e-2 to 1e-8 [m].
TEST(Massless, ACrossBetweenHingesIsAUniversalJoint) {
  engine::WorldOptions options;
  options.time_step = 0.01;
  World hinges(options), universal(options);
  const Robot robot = add_links(link_of("shin") + link_of("cross") + link_of("foot", kBody) +
                                    joint_of("a", "continuous", "shin", "cross", kAboutX) +
                                    joint_of("b", "continuous", "cross", "foot", kAboutY),
                                &hinges, fixed_at({0.0, 0.0, 1.0}));
  EXPECT_TRUE(says(robot, "links between joints have no mass")) << all_warnings(robot);
  EXPECT_TRUE(says(robot, "'cross' 0.0002 kg")) << all_warnings(robot);
  engine::Body foot = hinges.body(hinges.find_body("foot/com"));
  engine::Joint joint;
  joint.name = "u";
  joint.kind = engine::JointKind::kUniversal;
  joint.body_b = universal.add_body(foot);
  joint.anchor_a = {0.0, 0.0, 1.0};
  joint.anchor_b = {-0.2, -0.1, 0.3};
  joint.frame_a = engine::frame_along(Vector3d::UnitX());
  joint.axis_b = Vector3d::UnitY();
  universal.add_joint(joint);
  for (int i = 0; i < 200; ++i) {
    ASSERT_FALSE(hinges.step().outcome.failed);
    ASSERT_FALSE(universal.step().outcome.failed);
  }
  const Vector3d found = hinges.state(hinges.find_body("foot/com")).position;
  const Vector3d expected = universal.state(universal.find_body("foot/com")).position;
  EXPECT_GT((expected - foot.state.position).norm(), 0.1);
  EXPECT_LT((found - expected).norm(), 1e-5);
}

// A base on x, y and yaw slides down a slope of 0.3 rad: x = g sin(0.3) t² / 2, and the yaw turns
// at its own rate. The relative deviation is the masses of both links, of 1e-4 each.
TEST(Massless, LinksOfAPlanarBaseMoveAlongIt) {
  engine::WorldOptions world_options;
  world_options.time_step = 0.01;
  world_options.gravity = {9.81 * std::sin(0.3), 0.0, -9.81 * std::cos(0.3)};
  World world(world_options);
  const std::string body =
      "<inertial><mass value='20'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/>"
      "</inertial>";
  const std::string limit = "<limit lower='-10' upper='10' effort='100' velocity='1'/>";
  const Robot robot =
      add_links(link_of("world") + link_of("x_link") + link_of("y_link") + link_of("base", body) +
                    joint_of("x", "prismatic", "world", "x_link", kAboutX + limit) +
                    joint_of("y", "prismatic", "x_link", "y_link", kAboutY + limit) +
                    joint_of("yaw", "continuous", "y_link", "base", kAboutZ),
                &world);
  EXPECT_EQ(robot.constraints, (std::vector<std::string>{"x", "y", "yaw"}));
  engine::BodyState state = world.state(world.find_body("base/com"));
  state.angular_velocity = {0.0, 0.0, 2.0};
  world.set_state(world.find_body("base/com"), state);
  for (int i = 0; i < 100; ++i) ASSERT_FALSE(world.step().outcome.failed);
  const double x = 0.5 * 9.81 * std::sin(0.3);
  EXPECT_NEAR(position_of(world, "x"), x, 3e-4 * x);
  EXPECT_NEAR(position_of(world, "y"), 0.0, 1e-9);
  EXPECT_NEAR(position_of(world, "yaw"), 2.0, 1e-3);
}

// A free root without mass belongs to the link behind its only joint.
TEST(Massless, ARootBeforeOneJointIsUnitedWithItsLink) {
  World world;
  const Robot robot =
      add_links(link_of("footprint") + link_of("base", kBody) + link_of("arm", kBody) +
                    joint_of("a", "continuous", "footprint", "base", kAboutZ) +
                    joint_of("b", "continuous", "base", "arm", kAboutX),
                &world);
  EXPECT_EQ(robot.bodies, (std::vector<std::string>{"footprint/com", "arm/com"}));
  EXPECT_EQ(robot.constraints, (std::vector<std::string>{"b"}));
  EXPECT_TRUE(says(robot, "'a' (link 'base')")) << all_warnings(robot);
}

TEST(Massless, ARootWithFloatingJointsStands) {
  World world;
  const Robot robot = add_links(
      link_of("odom") + link_of("base", kBody) + joint_of("a", "floating", "odom", "base"), &world);
  EXPECT_EQ(world.body(world.find_body("odom/com")).type, engine::BodyType::kStatic);
  EXPECT_EQ(world.body(world.find_body("base/com")).type, engine::BodyType::kDynamic);
  EXPECT_TRUE(says(robot, "link 'odom' has no mass and only floating joints: it does not move"));
}

TEST(Massless, MotionsWithoutAMassAreRejected) {
  const std::string coaxial =
      link_of("base", kBody) + link_of("ring") + link_of("wheel", kBody) +
      joint_of("a", "continuous", "base", "ring", kAboutY) +
      joint_of("b", "continuous", "ring", "wheel", std::string(kAboutY) + "<origin xyz='0 1 0'/>");
  World world;
  EXPECT_NE(refusal([&] { add_links(coaxial, &world); })
                .find("link 'ring' has no mass, and joints 'a', 'b' can turn or move without "
                      "moving a mass"),
            std::string::npos)
      << refusal([&] { add_links(coaxial, &world); });
  EXPECT_NE(refusal([&] {
              add_links(link_of("base"), &world);
            }).find("link 'base' moves and has no mass, and neither has any other link"),
            std::string::npos);
  EXPECT_EQ(world.body_ids().size(), 0u);
  // gears hold such joints
  std::string geared = coaxial;
  const std::string end = "<child link='ring'/>";
  geared.insert(geared.find(end) + end.size(), "<mimic joint='b' multiplier='0.5'/>");
  EXPECT_EQ(add_links(geared, &world).constraints, (std::vector<std::string>{"a", "b", "a/mimic"}));
}

// A link without mass that has an inertia turns as it should: a rotor.
TEST(Massless, AnInertiaWithoutAMassTurns) {
  World world;
  const std::string rotor =
      "<inertial><mass value='0'/><inertia ixx='1e-4' ixy='0' ixz='0' iyy='1e-4' iyz='0' "
      "izz='1e-4'/></inertial>";
  RobotOptions options;
  options.extra = "motors: {a: {force: 1e-3}}";
  add_links(link_of("world") + link_of("rotor", rotor) +
                joint_of("a", "continuous", "world", "rotor", kAboutZ),
            &world, options);
  engine::run(world, 10);
  const double t = world.time();
  EXPECT_NEAR(position_of(world, "a"), 0.5 * 10.0 * t * t, 1e-2 * 5.0 * t * t);
}

// A trunk of 5 kg stands on one foot, on a two-hinge ankle whose cross has no mass, and whose
// motors hold it: the floor carries the weight through the cross.
TEST(Massless, ATrunkStandsOnAMasslessAnkle) {
  const auto box = [](const char* mass, const char* centre, const char* size) {
    return std::string("<inertial><origin xyz='") + centre + "'/><mass value='" + mass +
           "'/><inertia ixx='0.05' ixy='0' ixz='0' iyy='0.05' iyz='0' izz='0.05'/></inertial>"
           "<collision><origin xyz='" +
           centre + "'/><geometry><box size='" + size + "'/></geometry></collision>";
  };
  const std::string limit = "<limit effort='200' velocity='3'/>";
  engine::WorldOptions options;
  options.time_step = 0.005;
  World world(options);
  engine::Body floor;
  floor.name = "floor";
  floor.type = engine::BodyType::kStatic;
  floor.shape = engine::Plane{};
  floor.friction = 0.8;
  world.add_body(floor);
  RobotOptions robot_options;
  robot_options.pose.position.z() = 0.1;
  robot_options.extra = "{hold: true, links: {foot: {friction: 0.8}}}";
  const Robot robot =
      add_links(link_of("trunk", box("5", "0.01 0.01 0.3", "0.1 0.1 0.4")) + link_of("cross") +
                    link_of("foot", box("0.5", "0 0 -0.075", "0.3 0.2 0.05")) +
                    joint_of("pitch", "continuous", "trunk", "cross", kAboutY + limit) +
                    joint_of("roll", "continuous", "cross", "foot", kAboutX + limit),
                &world, robot_options);
  EXPECT_TRUE(says(robot, "'cross' 5e-05 kg")) << all_warnings(robot);
  const Vector3d before = world.state(world.find_body("trunk/com")).position;
  double force = 0.0;
  for (int i = 0; i < 400; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    force = 0.0;
    for (const engine::Contact& contact : world.contacts()) force += contact.normal_force;
  }
  EXPECT_NEAR(force, 5.5 * 9.81, 1e-3 * 5.5 * 9.81);
  EXPECT_LT((world.state(world.find_body("trunk/com")).position - before).norm(), 1e-3);
  for (const char* joint : {"pitch", "roll"}) EXPECT_LT(std::abs(position_of(world, joint)), 1e-3);
}

// ---- random robots

struct RandomRobot {
  std::string text;
  std::string extra;
  std::vector<std::string> links, joints;
  double mass = 0.0;
};

RandomRobot make_random_robot(std::uint64_t seed) {
  engine::Draw draw(static_cast<unsigned>(seed));
  const auto number = [&](int most) { return draw.below(most); };
  static const char* const kNames[] = {"link", "a.b", "tool-0", "L/R/x", "0", "_", "ünïcode"};
  RandomRobot robot;
  const int count = 2 + number(9);
  const bool has_odd_names = number(4) == 0;
  for (int i = 0; i < count; ++i) {
    std::string name = has_odd_names ? kNames[number(6)] : "link";
    name += std::to_string(i);
    if (name[0] == '_') name = "n" + name;
    robot.links.push_back(name);
    std::string inside;
    if (number(5) < 3) {
      const double mass = 0.1 + number(50) * 0.1;
      robot.mass += mass;
      inside = "<inertial><origin xyz='0." + std::to_string(number(3)) + " 0 -0." +
               std::to_string(number(3)) + "' rpy='0 0." + std::to_string(number(9)) +
               " 0'/><mass value='" + std::to_string(mass) +
               "'/><inertia ixx='0.01' ixy='0' ixz='0' iyy='0.012' iyz='0' izz='0.015'/>"
               "</inertial>";
    }
    while (number(3) == 0)
      inside += "<collision><origin xyz='0." + std::to_string(number(4)) + " 0 0." +
                std::to_string(number(4)) + "' rpy='0." + std::to_string(number(9)) +
                " 0 0'/><geometry>" +
                (number(2) == 0 ? "<box size='0.1 0.2 0.3'/>" : "<sphere radius='0.1'/>") +
                "</geometry></collision>";
    if (number(6) == 0) inside += "<visual><geometry><box size='1 1 1'/></geometry></visual>";
    robot.text += link_of(name, inside);
    if (i == 0) continue;
    static const char* const kTypes[] = {"revolute", "continuous", "prismatic",
                                         "fixed",    "planar",     "floating"};
    const int kind = number(12);
    const std::string type = kTypes[kind < 6 ? kind % 3 : kind < 10 ? 3 * (kind % 2) : kind - 6];
    const std::string joint = "j" + std::to_string(i);
    robot.joints.push_back(joint);
    static const char* const kAxes[] = {kAboutX, kAboutY, kAboutZ, "<axis xyz='1 2 -1'/>"};
    std::string more = kAxes[number(4)];
    more += "<origin xyz='0." + std::to_string(number(4)) + " 0 0." + std::to_string(number(4)) +
            "' rpy='0." + std::to_string(number(9)) + " 0 0'/>";
    if (type == "revolute" || type == "prismatic")
      more += number(5) == 0 ? "<limit lower='0.2' upper='1' effort='900' velocity='3'/>"
                             : "<limit lower='-1' upper='1' effort='900' velocity='3'/>";
    if (type == "continuous") more += "<limit effort='900' velocity='3'/>";
    const bool has_position = type == "revolute" || type == "prismatic" || type == "continuous";
    if (has_position && number(4) == 0) more += "<dynamics damping='0.1' friction='0.1'/>";
    robot.text +=
        joint_of(joint, type, robot.links[static_cast<std::size_t>(number(i))], name, more);
  }
  robot.text = "<robot name='r'>" + robot.text + "</robot>";
  robot.extra = "hold: true";
  return robot;
}

// Each link is where the URDF has it, each joint is there or named, and the masses add up. Robots
// hold their poses, or are rejected with the name of a link.
TEST(Massless, RandomRobotsLoadOrAreRejectedByName) {
  int loaded = 0, rejected = 0, changed = 0, held = 0;
  const std::uint64_t count = engine::kIsLongRun ? 20000 : 500;
  for (std::uint64_t seed = 1; seed <= count; ++seed) {
    SCOPED_TRACE(seed);
    const RandomRobot random = make_random_robot(seed);
    RobotOptions options;
    options.extra = random.extra;
    options.fixed = seed % 2 == 0;
    World world;
    Robot robot;
    const std::string message = refusal([&] { robot = add_robot(random.text, options, &world); });
    if (!message.empty()) {
      ++rejected;
      const bool names_one = message.find("urdf: link '") != std::string::npos ||
                             message.find("urdf: joint '") != std::string::npos;
      EXPECT_TRUE(names_one) << message;
      EXPECT_TRUE(world.body_ids().empty());
      continue;
    }
    ++loaded;
    if (!robot.fixed_joints.empty()) ++changed;
    ASSERT_EQ(robot.links.size(), random.links.size());
    double mass = 0.0;
    for (const engine::BodyId id : world.body_ids()) mass += world.body(id).mass;
    if (!options.fixed && world.body(world.body_ids().front()).type == engine::BodyType::kDynamic) {
      EXPECT_NEAR(mass, random.mass, 1e-3 * random.mass);
    }
    for (const auto& [joint, q] : robot.fixed_joints) {
      EXPECT_TRUE(says(robot, "'" + joint + "'")) << joint;
      if (world.has_joint(joint)) {  // between bodies with masses and shapes of their own
        EXPECT_EQ(world.joint(world.find_joint(joint)).kind, engine::JointKind::kWeld);
      }
    }
    std::map<std::string, double> before;
    for (const std::string& joint : robot.constraints)
      if (engine::info(world.joint(world.find_joint(joint)).kind).coordinates == 1 &&
          !is_contact_exception(world.joint(world.find_joint(joint))))
        before[joint] = position_of(world, joint);
    bool is_touched = false;
    for (int i = 0; i < 20; ++i) {
      ASSERT_FALSE(world.step().outcome.failed) << random.text;
      // sequential_impulses holds motors to its iterations alone
      is_touched = is_touched || !world.contacts().empty() ||
                   engine::explain(world).find("sequential_impulses, why") != std::string::npos;
    }
    if (is_touched) continue;
    ++held;
    // motors within their efforts leave rounding
    for (const auto& [joint, q] : before)
      EXPECT_NEAR(position_of(world, joint), q, 1e-6) << joint << "\n" << random.text;
  }
  EXPECT_GT(loaded, static_cast<int>(count / 2));
  EXPECT_GT(held, static_cast<int>(count / 4));
  EXPECT_GT(changed, 10);
  EXPECT_GT(rejected, 0);
}

}  // namespace
}  // namespace constraint_sim
