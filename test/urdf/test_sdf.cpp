// Robots from SDF: the same robot as a URDF moves equally, loops close, joints of each kind settle
// where their springs rest, and poses resolve as computed by hand.

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <variant>

#include "robots.h"
#include "temporary_folder.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using engine::refusal;
using engine::World;

class Sdf : public testing::Test {
 protected:
  void SetUp() override {
    if (!reads_sdf()) GTEST_SKIP() << "built without libsdformat";
  }
};

std::string sdf_of(const std::string& inside) {
  return "<?xml version='1.0'?>\n<sdf version='1.7'>" + inside + "</sdf>";
}
std::string model_of(const std::string& inside, const std::string& name = "m") {
  return sdf_of("<model name='" + name + "'>" + inside + "</model>");
}

const char* const kUnitInertial =
    "<inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia>"
    "</inertial>";

std::string link_of(const std::string& name, const std::string& pose = "0 0 0 0 0 0",
                    const std::string& inside = kUnitInertial) {
  return "<link name='" + name + "'><pose>" + pose + "</pose>" + inside + "</link>";
}

std::string joint_of(const std::string& name, const std::string& type, const std::string& parent,
                     const std::string& child, const std::string& inside = "") {
  return "<joint name='" + name + "' type='" + type + "'><parent>" + parent + "</parent><child>" +
         child + "</child>" + inside + "</joint>";
}

std::string axis_of(const std::string& xyz, const std::string& inside = "",
                    const std::string& axis = "axis") {
  return "<" + axis + "><xyz>" + xyz + "</xyz>" + inside + "</" + axis + ">";
}

/// A spring and damper that settles within seconds.
std::string settling(double rest, double stiffness = 20.0, double damping = 4.0) {
  return "<dynamics><damping>" + std::to_string(damping) + "</damping><spring_stiffness>" +
         std::to_string(stiffness) + "</spring_stiffness><spring_reference>" +
         std::to_string(rest) + "</spring_reference></dynamics>";
}

World world_without_gravity() {
  engine::WorldOptions options;
  options.gravity = Vector3d::Zero();
  options.time_step = 0.01;
  return World(options);
}

World world_with_gravity() {
  engine::WorldOptions options;
  options.time_step = 0.01;
  return World(options);
}

void run_for(World* world, int steps) {
  for (int i = 0; i < steps; ++i) world->step();
}

Isometry3d frame_named(const World& world, const Robot& robot, const std::string& link) {
  for (const RobotLink& candidate : robot.links)
    if (candidate.name == link) return frame_of(world, candidate);
  ADD_FAILURE() << "no link " << link;
  return Isometry3d::Identity();
}

/// Returns the largest error of all constraints [m].
double largest_error(const World& world, const Robot& robot) {
  double largest = 0.0;
  for (const std::string& name : robot.constraints)
    if (name.find("no_contact/") == std::string::npos)
      largest = std::max(largest, std::abs(world.joint_state(world.find_joint(name)).error));
  return largest;
}

/// Returns the largest difference of the frames of links that two robots share.
double largest_difference(const World& a, const Robot& robot_a, const World& b,
                          const Robot& robot_b) {
  double largest = 0.0;
  int count = 0;
  for (const RobotLink& link : robot_a.links)
    for (const RobotLink& other : robot_b.links)
      if (link.name == other.name) {
        largest = std::max(largest, distance(frame_of(a, link), frame_of(b, other)));
        ++count;
      }
  EXPECT_GT(count, 1);
  return largest;
}

std::string all_warnings(const Robot& robot) {
  std::string text;
  for (const std::string& warning : robot.warnings) text += warning + "\n";
  return text;
}

Isometry3d pose_at(double x, double y, double z, const Eigen::Matrix3d& R) {
  return Eigen::Translation3d(x, y, z) * Isometry3d(R);
}
Eigen::Matrix3d about(const Vector3d& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
}

// ---- the same robot as a URDF

const char* const kArmUrdf = R"(<robot name='arm'>
  <link name='base'/>
  <link name='upper'><inertial><origin xyz='0.2 0.01 0' rpy='0.1 0.2 0.3'/><mass value='2'/>
    <inertia ixx='0.02' iyy='0.03' izz='0.04' ixy='0.001' ixz='0.002' iyz='-0.003'/></inertial>
    <collision><origin xyz='0.2 0 0' rpy='0 1.5 0'/><geometry><cylinder radius='0.03' length='0.3'/></geometry></collision></link>
  <link name='lower'><inertial><origin xyz='0 0 -0.1'/><mass value='1'/>
    <inertia ixx='0.01' iyy='0.01' izz='0.002' ixy='0' ixz='0' iyz='0'/></inertial>
    <collision><origin xyz='0 0 -0.2'/><geometry><box size='0.02 0.02 0.1'/></geometry></collision></link>
  <link name='hand'><inertial><origin xyz='0 0 0'/><mass value='0.3'/>
    <inertia ixx='0.001' iyy='0.001' izz='0.001' ixy='0' ixz='0' iyz='0'/></inertial></link>
  <link name='tool'><inertial><origin xyz='0.02 0 0'/><mass value='0.1'/>
    <inertia ixx='0.0001' iyy='0.0001' izz='0.0001' ixy='0' ixz='0' iyz='0'/></inertial></link>
  <joint name='j1' type='continuous'><parent link='base'/><child link='upper'/><origin xyz='0 0 1' rpy='0 0 0.4'/>
    <axis xyz='0 1 0'/><dynamics damping='0.1' friction='0.05'/></joint>
  <joint name='j2' type='revolute'><parent link='upper'/><child link='lower'/><origin xyz='0.4 0 0' rpy='0.3 0 0'/>
    <axis xyz='1 1 0'/><limit lower='-0.4' upper='0.5' effort='0' velocity='3'/></joint>
  <joint name='j3' type='prismatic'><parent link='lower'/><child link='hand'/><origin xyz='0 0 -0.3'/>
    <axis xyz='0 0 1'/><limit lower='-0.1' upper='0.2' effort='0' velocity='0'/></joint>
  <joint name='j4' type='fixed'><parent link='hand'/><child link='tool'/><origin xyz='0 0 -0.05' rpy='0 0 1'/></joint>
</robot>)";

const char* const kArmSdf = R"(<model name='arm'>
  <link name='base'/>
  <link name='upper'><pose relative_to='j1'/>
    <inertial><pose>0.2 0.01 0 0.1 0.2 0.3</pose><mass>2</mass><inertia><ixx>0.02</ixx><iyy>0.03</iyy>
    <izz>0.04</izz><ixy>0.001</ixy><ixz>0.002</ixz><iyz>-0.003</iyz></inertia></inertial>
    <collision name='c'><pose>0.2 0 0 0 1.5 0</pose><geometry><cylinder><radius>0.03</radius><length>0.3</length></cylinder></geometry>
    <surface><friction><ode><mu>0</mu></ode></friction></surface></collision></link>
  <link name='lower'><pose relative_to='j2'/>
    <inertial><pose>0 0 -0.1 0 0 0</pose><mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.002</izz></inertia></inertial>
    <collision name='c'><pose>0 0 -0.2 0 0 0</pose><geometry><box><size>0.02 0.02 0.1</size></box></geometry>
    <surface><friction><ode><mu>0</mu></ode></friction></surface></collision></link>
  <link name='hand'><pose relative_to='j3'/>
    <inertial><mass>0.3</mass><inertia><ixx>0.001</ixx><iyy>0.001</iyy><izz>0.001</izz></inertia></inertial></link>
  <link name='tool'><pose relative_to='j4'/>
    <inertial><pose>0.02 0 0 0 0 0</pose><mass>0.1</mass><inertia><ixx>0.0001</ixx><iyy>0.0001</iyy><izz>0.0001</izz></inertia></inertial></link>
  <joint name='j1' type='continuous'><parent>base</parent><child>upper</child><pose relative_to='base'>0 0 1 0 0 0.4</pose>
    <axis><xyz>0 1 0</xyz><dynamics><damping>0.1</damping><friction>0.05</friction></dynamics></axis></joint>
  <joint name='j2' type='revolute'><parent>upper</parent><child>lower</child><pose relative_to='upper'>0.4 0 0 0.3 0 0</pose>
    <axis><xyz>1 1 0</xyz><limit><lower>-0.4</lower><upper>0.5</upper><velocity>3</velocity></limit></axis></joint>
  <joint name='j3' type='prismatic'><parent>lower</parent><child>hand</child><pose relative_to='lower'>0 0 -0.3 0 0 0</pose>
    <axis><xyz>0 0 1</xyz><limit><lower>-0.1</lower><upper>0.2</upper></limit></axis></joint>
  <joint name='j4' type='fixed'><parent>hand</parent><child>tool</child><pose relative_to='hand'>0 0 -0.05 0 0 1</pose></joint>
</model>)";

TEST_F(Sdf, MovesAsTheSameUrdf) {
  for (const bool is_moving : {false, true}) {
    RobotOptions options;
    options.fixed = !is_moving;
    options.prefix = "p/";
    options.pose.position = {0.5, -0.25, 2.0};
    options.pose.orientation = Eigen::Quaterniond(about({1.0, 2.0, 3.0}, 0.7));
    World by_urdf = world_with_gravity(), by_sdf = world_with_gravity();
    std::string urdf = kArmUrdf, sdf = kArmSdf;
    if (is_moving) {  // SDF gives a link without <inertial> 1 kg and 1 kg m²
      urdf.replace(urdf.find("<link name='base'/>"), 19,
                   "<link name='base'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' "
                   "ixy='0' ixz='0' iyz='0'/></inertial></link>");
    }
    const Robot given = add_robot(urdf, options, &by_urdf);
    const Robot robot = add_robot(sdf_of(sdf), options, &by_sdf);
    EXPECT_EQ(robot.name, "arm");
    EXPECT_EQ(robot.bodies, given.bodies);
    EXPECT_EQ(robot.bounds.at("p/j2").velocity, 3.0);
    // rounding of rotations from angles
    EXPECT_LE(largest_difference(by_urdf, given, by_sdf, robot), 1e-14);
    run_for(&by_urdf, 100);
    run_for(&by_sdf, 100);
    // Rounding that impacts on limits amplify.
    EXPECT_LE(largest_difference(by_urdf, given, by_sdf, robot), 1e-9) << is_moving;
    EXPECT_GT(distance(frame_named(by_sdf, robot, "p/tool"), frame_of(by_sdf, robot.links[0])),
              0.1);
  }
}

TEST_F(Sdf, OfOneTextGivesEqualBits) {
  World first = world_with_gravity(), second = world_with_gravity();
  for (World* world : {&first, &second}) {
    add_robot(sdf_of(kArmSdf), {}, world);
    run_for(world, 20);
  }
  EXPECT_EQ(first.state_hash(), second.state_hash());
}

// ---- loops

std::string digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

/// Returns a pose that is turned by `pitch` about y.
std::string pitched(double x, double z, double pitch) {
  return digits(x) + " 0 " + digits(z) + " 0 " + digits(pitch) + " 0";
}

/// Returns a bar of 0.4 kg along its x axis.
std::string bar(const std::string& name, double length, const std::string& pose) {
  const std::string moment = digits(0.4 * length * length / 12.0);
  return link_of(name, pose,
                 "<inertial><pose>" + digits(0.5 * length) +
                     " 0 0 0 0 0</pose><mass>0.4</mass><inertia><ixx>0.0001</ixx><iyy>" + moment +
                     "</iyy><izz>" + moment + "</izz></inertia></inertial>");
}

std::string hinge_at(const std::string& name, const std::string& parent, const std::string& child,
                     const std::string& pose = "0 0 0 0 0 0", const std::string& inside = "") {
  return joint_of(name, "revolute", parent, child,
                  "<pose>" + pose + "</pose>" + axis_of("0 1 0", inside));
}

// A parallelogram: crank and rocker stay parallel, and the coupler keeps its direction. The motion
// is that of a pendulum: (2 J + m l²) φ'' = −2 m g l sin φ, with the moment J = m l²/3 of crank and
// rocker about their pivots, and the angle φ from straight down.
TEST_F(Sdf, FourBarSwingsAsItsClosedForm) {
  constexpr double kLength = 0.5, kStart = 0.25 * engine::kPi, kGravity = 9.81;
  const double end = kLength * std::sqrt(0.5);
  World world = world_with_gravity();
  const Robot robot = add_robot(
      model_of(bar("crank", kLength, pitched(0.0, 2.0, kStart)) +
               bar("rocker", kLength, pitched(1.0, 2.0, kStart)) +
               bar("coupler", 1.0, pitched(end, 2.0 - end, 0.0)) + hinge_at("a", "world", "crank") +
               hinge_at("b", "crank", "coupler") + hinge_at("c", "world", "rocker") +
               // closes the loop; its pose is in the coupler's frame
               hinge_at("d", "rocker", "coupler", "1 0 0 0 0 0")),
      {}, &world);
  EXPECT_EQ(all_warnings(robot), "");
  EXPECT_EQ(robot.constraints, (std::vector<std::string>{"a", "b", "c", "d"}));
  EXPECT_LE(largest_error(world, robot), 1e-12);  // rounding
  const auto acceleration = [&](double phi) {
    return -2.0 * kGravity * std::sin(phi) / (5.0 / 3.0 * kLength);
  };
  double phi = kStart, rate = 0.0;
  constexpr int kParts = 1000;  // parts of a step, by velocity Verlet: error 1e-9
  const double h = 0.01 / kParts;
  for (int i = 0; i < 100; ++i) {
    world.step();
    EXPECT_LE(largest_error(world, robot), 1e-10);  // rounding of the projection
    for (int k = 0; k < kParts; ++k) {
      rate += 0.5 * h * acceleration(phi);
      phi += h * rate;
      rate += 0.5 * h * acceleration(phi);
    }
  }
  // The joint begins at 0, and the bar points down at 90° about y. Tolerance of the integration.
  EXPECT_NEAR(kStart + position_of(world, "a"), 0.5 * engine::kPi - phi, 1e-6);
  EXPECT_LE((frame_named(world, robot, "coupler").linear() - Eigen::Matrix3d::Identity())
                .cwiseAbs()
                .maxCoeff(),
            1e-8);  // follows from the errors of the hinges
}

TEST_F(Sdf, FiveBarMovesAsUrdfWithItsLoopInYaml) {
  const std::string folder = CONSTRAINT_SIM_SOURCE_DIR "/test/urdf/robots/fivebar";
  World by_urdf = world_with_gravity(), by_sdf = world_with_gravity();
  RobotOptions options;
  options.extra = read_text(folder + ".yaml");
  options.extra.replace(options.extra.find("motors:"),
                        options.extra.find("positions:") - options.extra.find("motors:"), "");
  const Robot given = add_robot(read_text(folder + ".urdf"), options, &by_urdf);
  const double q1 = 2.443460952792061, q2 = 0.6981317007977318, elbow = 1.856971863986924;
  const auto elbow_pose = [](double x, double q, double relative) {
    return pitched(x + 0.25 * std::cos(q), 1.0 - 0.25 * std::sin(q), q + relative);
  };
  const auto crank_limits = [](double q) {  // positions of SDF count from the poses
    return "<limit><lower>" + digits(-3.0 - q) + "</lower><upper>" + digits(3.0 - q) +
           "</upper></limit>";
  };
  const Robot robot = add_robot(
      model_of(
          bar("l1", 0.25, pitched(-0.1, 1.0, q1)) + bar("l2", 0.35, elbow_pose(-0.1, q1, -elbow)) +
          bar("r1", 0.25, pitched(0.1, 1.0, q2)) + bar("r2", 0.35, elbow_pose(0.1, q2, elbow)) +
          hinge_at("l_crank", "world", "l1", "0 0 0 0 0 0", crank_limits(q1)) +
          hinge_at("l_elbow", "l1", "l2") +
          hinge_at("r_crank", "world", "r1", "0 0 0 0 0 0", crank_limits(q2)) +
          hinge_at("r_elbow", "r1", "r2") + hinge_at("tip", "l2", "r2", "0.35 0 0 0 0 0")),
      {}, &by_sdf);
  // The tip of the YAML fits to rounding of its angles.
  EXPECT_LE(largest_difference(by_urdf, given, by_sdf, robot), 1e-8);
  for (int i = 0; i < 50; ++i) {
    by_urdf.step();
    by_sdf.step();
    EXPECT_LE(largest_error(by_sdf, robot), 1e-10) << i;  // rounding of the projection
  }
  // A hinge holds the plane a second time, where the YAML has a point on a line: errors of the
  // integration.
  EXPECT_LE(largest_difference(by_urdf, given, by_sdf, robot), 1e-6);
}

// Arms of a delta robot drive the platform by pairs of rods, which are parallelograms: the platform
// keeps its direction. Rods of little mass move as distances without mass.
TEST_F(Sdf, DeltaWithRodsAsLinksMovesAsWithDistances) {
  const std::string folder = CONSTRAINT_SIM_SOURCE_DIR "/test/urdf/robots/delta";
  const double drop =
      std::sqrt(0.55 * 0.55 - 0.3 * 0.3);  // drop of the platform where the rods fit
  std::string urdf = read_text(folder + ".urdf");
  urdf.replace(urdf.find("0 0 -0.50"), 9, "0 0 " + digits(-drop));
  RobotOptions options;
  const std::string yaml = read_text(folder + ".yaml");
  options.extra = yaml.substr(0, yaml.find("motors:"));
  World by_urdf = world_with_gravity(), by_sdf = world_with_gravity();
  const Robot given = add_robot(urdf, options, &by_urdf);
  const std::string rod_inertial =
      "<inertial><mass>1e-6</mass><inertia><ixx>1e-8</ixx><iyy>1e-8</iyy><izz>1e-8</izz></inertia>"
      "</inertial>";
  std::string inside = link_of("base", "0 0 1 0 0 0") + joint_of("mount", "fixed", "world", "base");
  std::string rods, closing;
  for (int i = 0; i < 3; ++i) {
    const double turn = i * 2.0 * engine::kPi / 3.0, c = std::cos(turn), s = std::sin(turn);
    const std::string n = std::to_string(i), yaw = " 0 0 " + digits(turn);
    inside += link_of("arm" + n, digits(0.15 * c) + " " + digits(0.15 * s) + " 1" + yaw,
                      "<inertial><pose>0.1 0 0 0 0 0</pose><mass>.25</mass><inertia><ixx>1e-4</ixx>"
                      "<iyy>1e-3</iyy><izz>1e-3</izz></inertia></inertial>") +
              joint_of("m" + n, "revolute", "base", "arm" + n,
                       axis_of("0 1 0", "<limit><lower>-1.2</lower><upper>1.5</upper></limit>"));
    for (const double side : {-0.04, 0.04}) {
      const std::string rod = "rod" + n + (side < 0.0 ? "a" : "b");
      const auto at = [&](double radius, double z) {
        return digits(radius * c - side * s) + " " + digits(radius * s + side * c) + " " +
               digits(z);
      };
      rods += link_of(rod, at(0.35, 1.0) + yaw, rod_inertial) +
              joint_of(rod + "_top", "ball", "arm" + n, rod);
      closing += joint_of(rod + "_end", "ball", rod, "platform",
                          "<pose>" + at(0.05, 0.0) + " 0 0 0</pose>");
    }
  }
  inside += rods +
            link_of("platform", "0 0 " + digits(1.0 - drop) + " 0 0 0",
                    "<inertial><mass>.3</mass><inertia><ixx>.0005</ixx><iyy>.0005</iyy>"
                    "<izz>.001</izz></inertia></inertial>") +
            closing;
  const Robot robot = add_robot(model_of(inside), {}, &by_sdf);
  EXPECT_EQ(all_warnings(robot), "");
  EXPECT_LE(largest_error(by_sdf, robot), 1e-12);  // rounding
  for (int i = 0; i < 20; ++i) {
    by_urdf.step();
    by_sdf.step();
    EXPECT_LE(largest_error(by_sdf, robot), 1e-10) << i;  // rounding of the projection
  }
  const Isometry3d platform = frame_named(by_sdf, robot, "platform");
  EXPECT_LT(platform.translation().z(), 0.95 * (1.0 - drop));  // it falls
  EXPECT_LE((platform.linear() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-8);
  // rods have 1e-5 of the platform's mass
  EXPECT_LE(distance(platform, frame_named(by_urdf, given, "platform")), 1e-4);
}

// ---- kinds of joints

// Returns the frame of link `b`, whose joint to `a` settles; the parent stays at the origin.
Isometry3d settled(const std::string& type, const std::string& inside,
                   const std::string& pose = "0 0 0 0 0 0") {
  World world = world_without_gravity();
  RobotOptions options;
  options.fixed = true;
  const Robot robot =
      add_robot(model_of(link_of("a") + link_of("b", pose) + joint_of("j", type, "a", "b", inside)),
                options, &world);
  EXPECT_EQ(all_warnings(robot), "") << type;
  run_for(&world, 1000);
  EXPECT_LE(largest_error(world, robot), 1e-9) << type;
  return frame_named(world, robot, "b");
}

// Springs settle by exp(−t / 0.2 s) or faster: to rounding of the closest step after 10 s.
constexpr double kSettled = 1e-6;

TEST_F(Sdf, JointsSettleWhereTheirSpringsRest) {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  EXPECT_LE(distance(settled("revolute", axis_of("0 1 0", settling(0.4))),
                     pose_at(0, 0, 0, about(y, 0.4))),
            kSettled);
  EXPECT_LE(distance(settled("continuous", axis_of("0 0 2", settling(-0.4))),
                     pose_at(0, 0, 0, about(z, -0.4))),
            kSettled);
  EXPECT_LE(distance(settled("prismatic", axis_of("0 1 0", settling(0.3)), "1 0 0 0 0 0"),
                     pose_at(1, 0.3, 0, about(z, 0.0))),
            kSettled);
  for (const char* type : {"universal", "revolute2"})
    EXPECT_LE(distance(settled(type, axis_of("1 0 0", settling(0.5)) +
                                         axis_of("0 1 0", settling(-0.3), "axis2")),
                       pose_at(0, 0, 0, about(x, 0.5) * about(y, -0.3))),
              kSettled)
        << type;
  // angle = −thread_pitch · translation
  EXPECT_LE(distance(settled("screw",
                             "<thread_pitch>-20</thread_pitch>" + axis_of("1 0 0", settling(0.8))),
                     pose_at(0.04, 0, 0, about(x, 0.8))),
            kSettled);
  EXPECT_LE(
      distance(settled("fixed", "", "0.1 0.2 0.3 0 0 0.5"), pose_at(0.1, 0.2, 0.3, about(z, 0.5))),
      1e-12);
}

// The frame of the joint turns on the circle about the child's axis.
TEST_F(Sdf, JointsLieWhereTheirPoseSays) {
  const Isometry3d joint = pose_at(1.0, 0.5, 0.0, about(Vector3d::UnitX(), 0.3));
  const Isometry3d child = pose_at(1.5, 0.5, 0.2, about(Vector3d::UnitZ(), 0.7));
  const Isometry3d turn = pose_at(0, 0, 0, about(Vector3d::UnitZ(), 0.4));
  const Isometry3d expected = joint * turn * joint.inverse() * child;
  EXPECT_LE(distance(settled("revolute",
                             "<pose relative_to='a'>1 0.5 0 0.3 0 0</pose>" +
                                 axis_of("0 0 1", settling(0.4)),
                             "1.5 0.5 0.2 0 0 0.7"),
                     expected),
            kSettled);
  World world;
  RobotOptions options;
  options.fixed = true;
  options.extra = "positions: {j: 0.4}";
  const Robot robot = add_robot(
      model_of(link_of("a") + link_of("b", "1.5 0.5 0.2 0 0 0.7") +
               joint_of("j", "revolute", "a", "b",
                        "<pose relative_to='a'>1 0.5 0 0.3 0 0</pose>" + axis_of("0 0 1"))),
      options, &world);
  EXPECT_EQ(robot.bodies, (std::vector<std::string>{"a/com", "b/com"}));
  EXPECT_LE(distance(frame_named(world, robot, "b"), expected), 1e-14);  // rounding
  EXPECT_LE(distance(frame_named(world, robot, "j/frame"), joint * turn), 1e-14);
}

// A ball joint lets a pendulum swing in a plane as a hinge does, and turn about any axis.
TEST_F(Sdf, BallJointHoldsAPointAlone) {
  World ball = world_with_gravity(), hinge = world_with_gravity();
  const std::string pendulum = link_of("b", "0.5 0 0 0 0 0"), at = "<pose>-0.5 0 0 0 0 0</pose>";
  const Robot one =
      add_robot(model_of(pendulum + joint_of("j", "ball", "world", "b", at)), {}, &ball);
  const Robot other =
      add_robot(model_of(pendulum + joint_of("j", "revolute", "world", "b", at + axis_of("0 1 0"))),
                {}, &hinge);
  run_for(&ball, 100);
  run_for(&hinge, 100);
  EXPECT_LE(largest_error(ball, one), 1e-10);
  EXPECT_LE(distance(frame_named(ball, one, "b"), frame_named(hinge, other, "b")), 1e-8);
  EXPECT_EQ(ball.joint(ball.find_joint("j")).kind, engine::JointKind::kBall);
}

// θ₂ + ratio θ₁ = 0, whichever way the hinges are written.
TEST_F(Sdf, GearboxCouplesTwoHinges) {
  for (const bool is_reverse : {false, true}) {
    World world = world_without_gravity();
    const std::string second = is_reverse
                                   ? joint_of("q2", "revolute", "c", "base", axis_of("0 0 -1"))
                                   : joint_of("q2", "revolute", "base", "c", axis_of("0 0 1"));
    const Robot robot = add_robot(
        model_of(link_of("base") + link_of("b") + link_of("c") +
                 joint_of("q1", "revolute", "base", "b", axis_of("0 0 1", settling(0.6))) + second +
                 joint_of("g", "gearbox", "b", "c",
                          "<gearbox_ratio>3</gearbox_ratio>"
                          "<gearbox_reference_body>base</gearbox_reference_body>" +
                              axis_of("0 0 1") + axis_of("0 0 1", "", "axis2"))),
        {}, &world);
    run_for(&world, 1000);
    const Isometry3d base = frame_named(world, robot, "base").inverse();
    EXPECT_LE(distance(base * frame_named(world, robot, "b"),
                       pose_at(0, 0, 0, about(Vector3d::UnitZ(), 0.6))),
              kSettled);
    EXPECT_LE(distance(base * frame_named(world, robot, "c"),
                       pose_at(0, 0, 0, about(Vector3d::UnitZ(), -1.8))),
              kSettled);
  }
}

// Each kind once more, as the joint that closes a loop: `b` is held by a prismatic joint before.
TEST_F(Sdf, ClosingJointsHaveLimitsAndSprings) {
  World world = world_without_gravity();
  RobotOptions options;
  options.fixed = true;
  const Robot robot = add_robot(
      model_of(
          link_of("a") + link_of("b") + link_of("c") +
          joint_of("p", "prismatic", "a", "b", axis_of("1 0 0")) +
          joint_of("w", "fixed", "b", "c") +
          joint_of("s", "prismatic", "a", "c",
                   axis_of("1 0 0", settling(0.5) +
                                        "<limit><lower>-0.1</lower><upper>0.2</upper></limit>"))),
      options, &world);
  run_for(&world, 1000);
  EXPECT_NEAR(position_of(world, "s"), 0.2, 1e-6);
  EXPECT_NEAR(position_of(world, "p"), 0.2, 1e-6);
  const engine::Joint& slider = world.joint(world.find_joint("s"));
  EXPECT_EQ(slider.kind, engine::JointKind::kSlider);
  EXPECT_EQ(slider.coordinates[0].upper, 0.2);
  EXPECT_EQ(slider.coordinates[0].stiffness, 20.0);
}

// ---- poses

TEST_F(Sdf, PosesResolveAlongChains) {
  const std::string inside =
      "<pose>0 0 1 0 0 1.5707963267948966</pose>"
      "<frame name='f'><pose>1 0 0 0 0 0</pose></frame>"
      "<frame name='g' attached_to='a'><pose>0 0 2 0 0 0</pose></frame>" +
      std::string("<link name='a'><pose relative_to='f'>0 1 0 0 0 0</pose></link>") +
      "<link name='b'><pose relative_to='j'>0.5 0 0 0 0 0</pose></link>" +
      "<link name='c'><pose relative_to='g'/></link>"
      "<model name='n'><pose relative_to='a'>0 0 3 0 0 0</pose><link name='d'><pose>1 0 0 0 0 "
      "0</pose>"
      "</link></model>" +
      joint_of("j", "revolute", "a", "b",
               "<pose relative_to='a'>0 0 0.25 0 0 0</pose>"
               "<axis><xyz expressed_in='__model__'>0 1 0</xyz></axis>") +
      joint_of("k", "fixed", "b", "c") +
      (sdformat_version() < 11 ? "" : joint_of("l", "ball", "c", "n::d"));
  World world;
  RobotOptions options;
  options.pose.position = {10.0, 0.0, 0.0};
  const Robot robot = add_robot(model_of(inside), options, &world);
  const Isometry3d model = pose_at(10, 0, 1, about(Vector3d::UnitZ(), 0.5 * engine::kPi));
  const auto expect_at = [&](const char* link, double x, double y, double z) {
    const Isometry3d expected = model * pose_at(x, y, z, Eigen::Matrix3d::Identity());
    EXPECT_LE(distance(frame_named(world, robot, link), expected), 1e-14) << link;  // rounding
  };
  expect_at("a", 1, 1, 0);
  expect_at("b", 1.5, 1, 0.25);
  expect_at("c", 1, 1, 2);
  expect_at("n/d", 2, 1, 3);
  const engine::Joint& hinge = world.joint(world.find_joint("j"));
  const engine::BodyState& a = world.state(hinge.body_a);
  const Vector3d axis = a.orientation * (hinge.frame_a * Vector3d::UnitZ());
  EXPECT_LE((axis - model.linear() * Vector3d::UnitY()).norm(), 1e-14);
}

TEST_F(Sdf, LinksWithoutJointsMoveFreely) {
  World world = world_with_gravity();
  const Robot robot =
      add_robot(model_of("<pose>0 0 5 0 0 0</pose>" + link_of("a") + link_of("b", "3 0 1 0 0 0")),
                {}, &world);
  EXPECT_EQ(robot.constraints, std::vector<std::string>{});
  run_for(&world, 100);
  const double fall = 0.5 * 9.81;
  EXPECT_NEAR(frame_named(world, robot, "a").translation().z(), 5.0 - fall, 1e-9);
  EXPECT_NEAR(frame_named(world, robot, "b").translation().z(), 6.0 - fall, 1e-9);
}

// A fixed joint that closes a loop of fixed joints holds what is one body already.
TEST_F(Sdf, FixedJointsInALoopAreOneBody) {
  World world;
  const Robot robot =
      add_robot(model_of(link_of("a") + link_of("b", "1 0 0 0 0 0") + link_of("c", "0 1 0 0 0 0") +
                         joint_of("ab", "fixed", "a", "b") + joint_of("ac", "fixed", "a", "c") +
                         joint_of("bc", "fixed", "b", "c")),
                {}, &world);
  EXPECT_EQ(robot.bodies, std::vector<std::string>{"a/com"});
  EXPECT_EQ(robot.constraints, std::vector<std::string>{});
  EXPECT_EQ(robot.warnings, std::vector<std::string>{
                                "constraint 'bc' is left out: links 'b' and 'c' are one body"});
}

// ---- shapes and surfaces

std::string shape(const std::string& kind, const std::string& inside, const std::string& more = "",
                  const std::string& name = "c") {
  return "<collision name='" + name + "'><geometry><" + kind + ">" + inside + "</" + kind +
         "></geometry>" + more + "</collision>";
}

TEST_F(Sdf, WorldOfSeveralModels) {
  World world = world_with_gravity();
  const Robot robot = add_robot(
      sdf_of(
          "<world name='w'><model name='ground'><static>true</static><link name='link'>" +
          shape("plane", "<normal>0 0 1</normal>") +
          "</link></model><model name='ball'>"
          "<pose>0 0 1 0 0 0</pose>" +
          link_of("link", "0 0 0 0 0 0", kUnitInertial + shape("sphere", "<radius>0.2</radius>")) +
          "</model><model name='bar'><pose>2 0 0.3 0 1.5707963267948966 0</pose>" +
          link_of("link", "0 0 0 0 0 0",
                  kUnitInertial + shape("capsule", "<radius>0.1</radius><length>0.5</length>")) +
          "</model></world>"),
      {}, &world);
  EXPECT_EQ(robot.name, "w");
  run_for(&world, 300);
  EXPECT_NEAR(frame_named(world, robot, "ball/link").translation().z(), 0.2, 1e-3);  // contact
  if (sdformat_version() < 11) return;  // has no capsules
  EXPECT_NEAR(frame_named(world, robot, "bar/link").translation().z(), 0.1, 1e-3);
  const engine::Body& bar = world.body(world.find_body("bar/link/com"));
  ASSERT_TRUE(std::holds_alternative<engine::Capsule>(bar.shape));
  EXPECT_EQ(std::get<engine::Capsule>(bar.shape).length, 0.5);
  EXPECT_EQ(bar.friction, 1.0);  // default of SDF
}

// The slider begins 1e-4 m in the ground, and its joint to the world leaves its contacts. The
// ground has a plane beside a wall, as a body of its own.
TEST_F(Sdf, ModelsOfAWorldCollideThoughTheyOverlap) {
  World world = world_with_gravity();
  const Robot robot = add_robot(
      sdf_of("<world name='w'><model name='ground'><static>true</static><link name='link'>" +
             shape("plane", "<normal>0 0 1</normal>") +
             shape("box", "<size>0.1 1 1</size>", "", "wall") +
             "</link></model><model name='slider'>" +
             link_of("link", "0.8 0 0.0999 0 0 0",
                     kUnitInertial + shape("sphere", "<radius>0.1</radius>")) +
             joint_of("j", "prismatic", "world", "link", axis_of("0 0 1")) + "</model></world>"),
      {}, &world);
  EXPECT_EQ(all_warnings(robot), "");
  EXPECT_EQ(robot.constraints, std::vector<std::string>{"slider/j"});
  run_for(&world, 200);
  EXPECT_NEAR(frame_named(world, robot, "slider/link").translation().z(), 0.1, 1e-3);
  EXPECT_EQ(world.body(world.find_body("ground/link/2/com")).type, engine::BodyType::kStatic);
}

TEST_F(Sdf, StaticModelsDoNotMove) {
  World world = world_with_gravity();
  const Robot robot =
      add_robot(model_of("<static>true</static><pose>0 0 1 0 0.5 0</pose>" +
                         link_of("a", "0 0 0 0 0 0", shape("plane", "<normal>1 0 0</normal>")) +
                         link_of("b", "1 0 0 0 0 0", shape("box", "<size>1 1 1</size>")) +
                         joint_of("j", "revolute", "a", "b", axis_of("0 1 0"))),
                {}, &world);
  EXPECT_EQ(all_warnings(robot), "model 'm' is static: its joints are left out\n");
  for (const std::string& body : robot.bodies)
    EXPECT_EQ(world.body(world.find_body(body)).type, engine::BodyType::kStatic);
  // the normal of the plane is the z axis of its body, which is beside the body of the box
  const Vector3d normal = world.state(world.find_body("a/2/com")).orientation * Vector3d::UnitZ();
  EXPECT_LE((normal - about(Vector3d::UnitY(), 0.5) * Vector3d::UnitX()).norm(), 1e-14);
  EXPECT_LE(
      distance(frame_named(world, robot, "b"),
               pose_at(0, 0, 1, about(Vector3d::UnitY(), 0.5)) * Eigen::Translation3d(1, 0, 0)),
      1e-14);
}

TEST_F(Sdf, SurfacesAndSelfCollisions) {
  const auto box_link = [](const std::string& name, const std::string& x, const std::string& more) {
    return link_of(name, x + " 0 0 0 0 0",
                   kUnitInertial +
                       shape("box", "<size>0.1 0.1 0.1</size>",
                             "<surface><friction><ode><mu>0.3</mu></ode></friction><bounce>"
                             "<restitution_coefficient>0.5</restitution_coefficient>"
                             "</bounce></surface>") +
                       more);
  };
  for (const bool do_collide : {false, true}) {
    World world;
    RobotOptions options;
    options.extra = "links: {b: {friction: 0.9}}";
    const Robot robot = add_robot(
        model_of((do_collide ? "<self_collide>true</self_collide>" : "") + box_link("a", "0", "") +
                 box_link("b", "1", "") + box_link("c", "2", "")),
        options, &world);
    EXPECT_EQ(world.body(world.find_body("a/com")).friction, 0.3);
    EXPECT_EQ(world.body(world.find_body("a/com")).restitution, 0.5);
    EXPECT_EQ(world.body(world.find_body("b/com")).friction, 0.9);
    EXPECT_EQ(robot.constraints.size(), do_collide ? 0u : 3u);  // pairs that do not collide
  }
}

TEST_F(Sdf, MeshesOfModelsAreFoundBesideTheFolder) {
  const engine::TemporaryFolder folder;
  std::filesystem::create_directories(folder.path() + "/robot/meshes");
  std::filesystem::copy_file(CONSTRAINT_SIM_SOURCE_DIR "/test/urdf/robots/hook.stl",
                             folder.path() + "/robot/meshes/hook.stl");
  const auto built = [&](const std::string& uri, const std::string& where) {
    RobotOptions options;
    options.folder = where;
    return build_robot(model_of(link_of("a", "0 0 0 0 0 0",
                                        kUnitInertial + shape("mesh", "<uri>" + uri + "</uri>"))),
                       options);
  };
  for (const char* uri : {"model://robot/meshes/hook.stl", "meshes/hook.stl"}) {
    const BuiltRobot robot = built(uri, folder.path() + "/robot");
    EXPECT_NE(all_warnings(robot.robot).find("convex hull"), std::string::npos)
        << all_warnings(robot.robot);
  }
  for (const char* uri : {"model://other/meshes/none.stl", "model://", "https://host/a.stl"}) {
    const std::string sentences = all_warnings(built(uri, folder.path() + "/robot").robot);
    EXPECT_NE(sentences.find(std::string("the mesh '") + uri + "' is not available"),
              std::string::npos)
        << sentences;
  }
}

// ---- what is not carried over

TEST_F(Sdf, PartsThatAreNotCarriedOverAreNamed) {
  World world;
  const Robot robot = add_robot(
      sdf_of(
          "<world name='w'><physics type='ode'/>\n<light name='sun' type='directional'/>"
          "<model name='m'><plugin name='p' filename='p.so'/>\n" +
          link_of("a", "0 0 0 0 0 0",
                  kUnitInertial + std::string("<sensor name='s' type='imu'/><gravity>0</gravity>") +
                      "<visual name='v'><geometry><heightmap><uri>h.png</uri></heightmap>"
                      "</geometry></visual>" +
                      shape("plane", "<normal>0 0 1</normal>")) +
          "<link name='b'/>" +
          joint_of("g", "gearbox", "a", "b",
                   "<gearbox_reference_body>a</gearbox_reference_body>" + axis_of("1 0 0") +
                       axis_of("1 0 0", "", "axis2")) +
          joint_of("j", "revolute", "a", "b",
                   axis_of("0 0 1", "<limit><effort>0</effort><stiffness>1</stiffness></limit>")) +
          "</model></world>"),
      {}, &world);
  for (const char* sentence :
       {"link 'a' has gravity all the same",
        "link 'b' has no <inertial>: SDF gives it a mass of 1 kg",
        "link 'a': visual 'v' is left out: its geometry is <heightmap>",
        "link 'a': collision 'c' is a <plane>, which collides only where its model is static",
        "joint 'g' is left out: a gearbox needs a revolute joint",
        "joint 'j' has an effort limit of 0, which is none here",
        "elements that are not read: <physics> in <world> (line 2), <light> in <world> (line 3), "
        "<plugin> in <model> (line 3), <sensor> in <link> (line 4), <stiffness> in <limit> (line "
        "4)"})
    EXPECT_NE(all_warnings(robot).find(sentence), std::string::npos) << sentence << "\n"
                                                                     << all_warnings(robot);
}

TEST_F(Sdf, DescriptionForOtherProgramsIsAUrdf) {
  RobotOptions options;
  options.fixed = true;
  std::string text = kArmSdf;
  // an up-right angle, where roll and yaw turn about one axis
  text.replace(text.find("0.4 0 0 0.3 0 0"), 15, "0.4 0 0 0.3 1.5707963267948966 0.2");
  text.replace(text.find("<link name='hand'>"), 18,
               "<link name='hand'><visual name='v'><geometry><capsule><radius>0.1</radius><length>1"
               "</length></capsule></geometry><material><diffuse>1 0 0 1</diffuse></material>"
               "</visual>");
  const BuiltRobot built = build_robot(sdf_of(text), options);
  World by_sdf, by_urdf;
  const Robot robot = add_robot(built, &by_sdf);
  // a cylinder and two spheres
  EXPECT_EQ(robot.visuals.size(), sdformat_version() < 11 ? 0u : 3u);
  const Robot again = add_robot(built.urdf, options, &by_urdf);
  EXPECT_EQ(again.bodies, robot.bodies);
  EXPECT_EQ(again.visuals.size(), robot.visuals.size());
  EXPECT_LE(largest_difference(by_sdf, robot, by_urdf, again), 1e-14);  // rounding
}

// ---- rejections

TEST_F(Sdf, InvalidTextsAreRejected) {
  const std::string a = link_of("a"), b = link_of("b");
  const auto hinge = [&](const std::string& inside, const std::string& type = "revolute") {
    return model_of(a + b + joint_of("j", type, "a", "b", inside));
  };
  std::string deep;
  for (int i = 0; i < 70; ++i) deep += "<x>";
  std::string many;
  for (int i = 0; i < 2100; ++i) many += link_of("l" + std::to_string(i));
  std::string elements;
  for (int i = 0; i < 21000; ++i) elements += "<x/>";
  const std::pair<std::string, const char*> cases[] = {
      {"<sdf version='1.7'", "urdf: "},
      {"<sdf/>", "urdf: <sdf> needs the attribute version, such as '1.7', got ''"},
      {"<sdf version='x.y'><model name='m'><link name='a'/></model></sdf>", "got 'x.y'"},
      {sdf_of(""), "urdf: "},
      {sdf_of("<world name='w'/>"), "the SDF has no <model>"},
      {model_of(""), "A model must have at least one link"},
      {model_of(deep), "elements are nested more than 64 deep"},
      {model_of(many), "the SDF has more than 2000 elements with names"},
      {model_of(elements), "the SDF has more than 20000 elements"},
      {model_of("\n<include><uri>model://sun</uri></include>" + a),
       "the SDF has <include> (line 3), which is not read"},
      {model_of("\n<include><uri>https://fuel.gazebosim.org/x</uri></include>" + a),
       "the SDF has <include>"},
      {"<!DOCTYPE x [<!ENTITY y 'z'>]>" + model_of(a), "has a declaration '<!DOCTYPE"},
      {model_of(a + "<?a > <!-- ?> <include/> -->"), "has a declaration `<?`"},
      {"<?a > <!-- ?> <sdf/> -->" + model_of(a), "has a declaration `<?`"},
      {model_of(a + "<:x/>"), "begins with a colon"},
      {model_of(a + a), "a"},
      {model_of(link_of("world")), "world"},
      {model_of(link_of("a b")), "link 'a b': names have letters, digits, _, ., / and -"},
      {model_of(link_of("a", "nan 0 0 0 0 0")),
       "<pose> (line 2) must have 6 finite numbers, got 'nan 0 0 0 0 0'"},
      {model_of(link_of("a", "1e400 0 0 0 0 0")), "<pose> (line 2) must have 6 finite numbers"},
      {model_of(link_of("a", "1 2 3")), "<pose> (line 2) must have 6 finite numbers"},
      {hinge(axis_of("1 x 0")), "<xyz> (line 2) must have 3 finite numbers, got '1 x 0'"},
      {model_of("<link name='a'><pose relative_to='b'/></link><link name='b'><pose "
                "relative_to='a'/></link>"),
       "urdf: libsdformat rejects the SDF: "},
      {model_of(link_of("a", "0 0 0 0 0 0", "<inertial><mass>nan</mass></inertial>")),
       "A link named a has invalid inertia"},
      {model_of(link_of("a", "0 0 0 0 0 0", "<inertial><mass>-1</mass></inertial>")),
       "A link named a has invalid inertia"},
      {model_of(
           link_of("a", "0 0 0 0 0 0", kUnitInertial + shape("sphere", "<radius>-1</radius>"))),
       "link 'a'"},
      {model_of(link_of("a", "0 0 0 0 0 0",
                        kUnitInertial + shape("sphere", "<radius>1</radius>",
                                              "<surface><friction><ode><mu>-1</mu></ode></friction>"
                                              "</surface>"))),
       sdformat_version() < 11
           ? "link 'a' must have a friction >= 0"
           : "The value [-1] is less than the minimum allowed value of [0] for key [mu]"},
      {hinge(axis_of("0 0 0")), "urdf: "},
      {hinge(axis_of("nan 0 0")), "urdf: "},
      {hinge(axis_of("0 0 1", "<dynamics><damping>nan</damping></dynamics>")),
       "joint 'j': damping: must be finite, got nan"},
      {hinge(axis_of("0 0 1", "<dynamics><damping>-1</damping></dynamics>")),
       "joint 'j': damping: must be >= 0, got -1"},
      {hinge(axis_of("0 0 1", "<limit><lower>2</lower><upper>1</upper></limit>")), "urdf: "},
      {hinge(""), "urdf: "},
      {hinge(axis_of("0 0 1"), "planar"), "urdf: "},
      {hinge("<thread_pitch>0</thread_pitch>" + axis_of("0 0 1"), "screw"),
       "joint 'j': thread_pitch: must be finite, got -inf"},
      {hinge(axis_of("0 0 1") + axis_of("0 0.1 1", "", "axis2"), "universal"),
       "joint 'j': axis2: must be at a right angle to axis"},
      {model_of(a + joint_of("j", "fixed", "a", "c")), "urdf: "},
      {model_of(a + joint_of("j", "fixed", "a", "a")), "urdf: "},
      {model_of(a + joint_of("j", "fixed", "a", "world")), "urdf: "},
      {sdf_of("<world name='w'><model name='m'>" + a + "</model><model name='m'>" + a +
              "</model></world>"),
       "urdf: "},
  };
  for (const auto& [text, part] : cases) {
    World world;
    const std::string message = refusal([&, text = text] { add_robot(text, {}, &world); });
    EXPECT_NE(message.find(part), std::string::npos) << part << "\n"
                                                     << message << "\n"
                                                     << text.substr(0, 300);
    EXPECT_TRUE(world.body_ids().empty());
  }
}

// Cut and mutated texts end in an answer.
TEST_F(Sdf, MutatedTextsAreAddedOrRejected) {
  const std::string text = sdf_of(kArmSdf);
  engine::Random random;
  for (int i = 0; i < 60; ++i) {
    std::string mutated = text;
    for (int k = 0; k < 4; ++k) {
      const auto place =
          static_cast<std::size_t>(std::abs(random()) * static_cast<double>(mutated.size() - 1));
      if (i % 3 == 0)
        mutated.erase(place, 1 + place % 30);
      else
        mutated[place] = "<>/'0-e "[(place + static_cast<std::size_t>(i)) % 8];
    }
    World world;
    refusal([&] { add_robot(mutated, {}, &world); });
  }
}

TEST(SdfText, IsReadOrTheLibraryThatIsMissingIsNamed) {
  World world;
  EXPECT_EQ(
      refusal([&] { add_robot(sdf_of(kArmSdf), {}, &world); }),
      reads_sdf()
          ? ""
          : "urdf: the text begins with <sdf>, and this program was built without libsdformat, "
            "which reads SDF; a URDF begins with <robot>");
}

}  // namespace
}  // namespace constraint_sim
