// The package's robots: their joints hold, and they move as references predict.

#include "arm_reference.h"
#include "constraint_sim/engine/scene.h"
#include "robots.h"
#include "sim/trajectories.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using engine::World;
using engine::WorldOptions;

const char* const kPose =
    "positions: {shoulder_pan: 0.3, shoulder_lift: -0.4, elbow: 0.9, wrist_1: -0.5, wrist_2: 0.4, "
    "wrist_3: 1.1}\n"
    "links: {base_link: {no_collision: true}, upper_arm: {no_collision: true}, forearm: "
    "{no_collision: true}}";
const char* const kBent =
    "positions: {front_left_calf: -1.5, front_right_calf: -1.5, rear_left_calf: -1.2, "
    "rear_right_calf: -1.8}";

RobotOptions with_extra(const std::string& extra, bool fixed) {
  RobotOptions options;
  options.extra = extra;
  options.fixed = fixed;
  return options;
}

// Two links of the arm touch at its zero pose, where its joints hold them as well: of the many
// forces that hold it, those of contacts push, and nothing moves.
TEST(Robots, TheArmRestsWhereItsLinksTouch) {
  const std::string extra =
      "motors: {shoulder_pan: {position: 0}, shoulder_lift: {position: 0}, elbow: {position: 0}, "
      "wrist_1: {position: 0}, wrist_2: {position: 0}, wrist_3: {position: 0}}";
  World world;
  add_robot(shipped_urdf("arm"), with_extra(extra, true), &world);
  for (int i = 0; i < 30; ++i) world.step();
  for (int i = 0; i < 5; ++i) {
    const engine::StepReport& report = world.step();
    EXPECT_EQ(report.costs.substeps + report.costs.rejected + report.costs.events, 0u);
    ASSERT_EQ(world.contacts().size(), 4u);
    for (const engine::Contact& contact : world.contacts())
      EXPECT_GT(contact.force.dot(contact.normal), 0.0);
  }
}

TEST(Robots, FramesOfLinksAreThoseOfTheUrdf) {
  World world;
  const Robot arm = add_robot(shipped_urdf("arm"), with_extra(kPose, true), &world);
  EXPECT_EQ(arm.bodies.front(), "base_link/com");
  EXPECT_EQ(world.joint_ids().size(), 6u);
  const auto model = parse_urdf(shipped_urdf("arm"));
  const TreeReference reference(*model, {0.0, 0.0, -9.81});
  Eigen::VectorXd q(6);
  q << 0.3, -0.4, 0.9, -0.5, 0.4, 1.1;
  ASSERT_EQ(reference.names(), (std::vector<std::string>{"shoulder_pan", "shoulder_lift", "elbow",
                                                         "wrist_1", "wrist_2", "wrist_3"}));
  const auto names = reference.link_names();
  const auto frames = reference.frames(q);
  ASSERT_EQ(arm.links.size(), names.size());
  for (const RobotLink& link : arm.links) {
    const auto i =
        static_cast<std::size_t>(std::find(names.begin(), names.end(), link.name) - names.begin());
    ASSERT_LT(i, names.size()) << link.name;
    // rounding of a product of ten transforms
    EXPECT_LT(distance(frame_of(world, link), frames[i]), 1e-14) << link.name;
  }
  for (Eigen::Index k = 0; k < q.size(); ++k)
    EXPECT_NEAR(position_of(world, reference.names()[static_cast<std::size_t>(k)]), q[k], 1e-14);
}

// Falls for a second from rest, with damping, and is compared with the reference, whose own error,
// by halving its step, is a hundredth of the bound.
TEST(Robots, ArmMovesAsItsMinimalCoordinatesSay) {
  WorldOptions options;
  options.tolerance = 1e-9;
  World world(options);
  add_robot(shipped_urdf("arm"), with_extra(kPose, true), &world);
  for (int i = 0; i < 50; ++i) world.step();

  const auto model = parse_urdf(shipped_urdf("arm"));
  const TreeReference reference(*model, {0.0, 0.0, -9.81});
  Eigen::VectorXd q(6), coarse;
  for (const int steps : {2500, 5000}) {
    coarse = q;
    q << 0.3, -0.4, 0.9, -0.5, 0.4, 1.1;
    Eigen::VectorXd v = Eigen::VectorXd::Zero(6);
    for (int i = 0; i < steps; ++i) reference.step(0.5 / steps, &q, &v);
  }
  EXPECT_LT((q - coarse).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT(std::abs(q[1] + 0.4), 0.1);  // the arm has moved
  for (Eigen::Index k = 0; k < q.size(); ++k)
    EXPECT_NEAR(position_of(world, reference.names()[static_cast<std::size_t>(k)]), q[k], 1e-7)
        << reference.names()[static_cast<std::size_t>(k)];
}

// Rotates freely, first with bent legs, which the rotation then stretches; compared with the
// reference, whose root is on six massless joints.
TEST(Robots, QuadrupedFliesAsItsMinimalCoordinatesSay) {
  const std::string text = shipped_urdf("quadruped");
  const Vector3d turning(0.5, -0.7, 1.0);
  WorldOptions options;
  options.tolerance = 1e-9;
  options.gravity.setZero();
  World world(options);
  const Robot robot = add_robot(text, with_extra(kBent, false), &world);
  const Vector3d root = world.state(world.find_body("trunk/com")).position;
  for (const engine::BodyId id : world.body_ids()) {
    engine::BodyState state = world.state(id);
    state.linear_velocity = turning.cross(state.position - root);
    state.angular_velocity = turning;
    world.set_state(id, state);
  }
  const World start = world;
  for (int i = 0; i < 20; ++i) world.step();

  // x, y and z, then rotations about z, y and x
  std::string joints, parent = "free_root";
  const char* const kFree[] = {"prismatic x",  "prismatic y",  "prismatic z",
                               "continuous z", "continuous y", "continuous x"};
  for (int i = 0; i < 6; ++i) {
    const std::string name = "free_" + std::to_string(i), type = kFree[i];
    const std::string child = i < 5 ? "free_link_" + std::to_string(i) : robot.links.front().name;
    const std::string axis = type.back() == 'x' ? "1 0 0" : type.back() == 'y' ? "0 1 0" : "0 0 1";
    if (i < 5) joints += "<link name='" + child + "'/>";
    joints += "<joint name='" + name + "' type='" + type.substr(0, type.find(' ')) +
              "'><parent link='" + parent + "'/><child link='" + child + "'/><axis xyz='" + axis +
              "'/><limit lower='-9' upper='9' effort='0' velocity='0'/></joint>";
    parent = child;
  }
  std::string extended = text;
  extended.insert(extended.find("</robot>"), "<link name='free_root'/>" + joints);
  const auto model = parse_urdf(extended);
  const TreeReference reference(*model, Vector3d::Zero());
  const auto names = reference.names();
  Eigen::VectorXd q, coarse;
  for (const int steps : {1000, 2000}) {
    coarse = q;
    q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(names.size()));
    Eigen::VectorXd v = q;
    for (std::size_t k = 6; k < names.size(); ++k)
      q[static_cast<Eigen::Index>(k)] = position_of(start, names[k]);
    v.head(6) << turning.cross(-root), turning.z(), turning.y(), turning.x();
    for (int i = 0; i < steps; ++i) reference.step(0.2 / steps, &q, &v);
  }
  EXPECT_LT((q - coarse).cwiseAbs().maxCoeff(), 1e-9);
  double moved = 0.0;
  for (std::size_t k = 6; k < names.size(); ++k) {
    const double position = position_of(world, names[k]);
    EXPECT_NEAR(position, q[static_cast<Eigen::Index>(k)], 1e-7) << names[k];
    moved = std::max(moved, std::abs(position - position_of(start, names[k])));
  }
  EXPECT_GT(moved, 1e-3);
  const auto frames = reference.frames(q);
  const auto links = reference.link_names();
  for (const RobotLink& link : robot.links) {
    const auto i =
        static_cast<std::size_t>(std::find(links.begin(), links.end(), link.name) - links.begin());
    EXPECT_LT(distance(frame_of(world, link), frames[i]), 1e-7) << link.name;
  }
}

struct Held {
  const char* robot;
  std::string extra;
  bool fixed;
};

// Joint errors after two seconds under gravity, at 30 to 1000 ticks a second: rounding of
// coordinates of metres over some thousand substeps.
TEST(Robots, JointsHoldToRounding) {
  for (const Held& held : {Held{"arm", kPose, true}, Held{"quadruped", kBent, false},
                           Held{"gripper", shipped_extra("gripper"), true}})
    for (const double rate : {30.0, 100.0, 1000.0}) {
      WorldOptions options;
      options.time_step = 1.0 / rate;
      World world(options);
      add_robot(shipped_urdf(held.robot), with_extra(held.extra, held.fixed), &world);
      double most = 0.0;
      for (int i = 0; i < static_cast<int>(2.0 * rate); ++i) {
        world.step();
        ASSERT_FALSE(world.report().outcome.failed);
        most = std::max(most, world.report().joints.max_error);
      }
      EXPECT_LT(most, 1e-12) << held.robot << " at " << rate << " Hz";
    }
}

// Rate motors are on their splines at the end of each tick, under gravity: to the rounding of
// integrated joints and loops.
TEST(Robots, FollowTrajectories) {
  struct Way {
    Held held;
    const char *first, *second;
    double by_first, by_second;  // [m or rad]
  };
  for (const Way& way :
       {Way{{"arm", kPose, true}, "shoulder_lift", "elbow", 0.4, -0.5},
        Way{{"quadruped", kBent, true}, "front_left_thigh", "front_left_calf", 0.3, 0.2},
        Way{{"gripper", shipped_extra("gripper"), true}, "lift", "left_crank", 0.2, -0.1}}) {
    SCOPED_TRACE(way.held.robot);
    World world;
    add_robot(shipped_urdf(way.held.robot), with_extra(way.held.extra, way.held.fixed), &world);
    JointTrajectory trajectory;
    std::vector<Spline> splines;
    JointTrajectory::Point end{0.5, {}, {0.0, 0.0}, {0.0, 0.0}};
    for (const auto& [joint, by] :
         {std::pair{way.first, way.by_first}, std::pair{way.second, way.by_second}}) {
      world.set_motor(world.find_joint(joint), engine::Motor());
      const double from = position_of(world, joint);
      trajectory.joints.push_back(joint);
      end.positions.push_back(from + by);
      splines.emplace_back(
          std::vector<TrajectoryPoint>{{0.0, from, 0.0, 0.0}, {0.5, from + by, 0.0, 0.0}}, 5);
    }
    trajectory.points = {end};
    Trajectories trajectories;
    trajectories.begin(world, trajectory);
    for (int i = 0; i < 60; ++i) {
      trajectories.before_step(&world);
      world.step();
      ASSERT_FALSE(world.report().outcome.failed);
      EXPECT_NEAR(position_of(world, way.first), splines[0].at(world.time()), 1e-12) << i;
      EXPECT_NEAR(position_of(world, way.second), splines[1].at(world.time()), 1e-12) << i;
      EXPECT_LT(world.report().joints.max_error, 1e-12) << i;
    }
    EXPECT_TRUE(trajectories.empty());
  }
}

// Each shipped robot, with the YAML beside it, and the arm with the YAML of docs/robots.md, hold
// their poses for 5 s; the quadruped that falls on its feet from a height of millimetres after 1 s.
// 1e-3 rad is the promise; rigid motors within their limits leave rounding. At 1/30 s the motors of
// the quadruped on its feet are at their limits now and then, and it moves by 7e-3 rad.
TEST(Robots, HoldTheirPoses) {
  const std::string page = read_text(CONSTRAINT_SIM_SOURCE_DIR "/docs/robots.md");
  const std::size_t begin = page.find("```yaml\n") + 8;
  const std::string documented = page.substr(begin, page.find("```", begin) - begin);
  for (const Held& held : {Held{"arm", shipped_extra("arm"), true}, Held{"arm", documented, true},
                           Held{"gripper", shipped_extra("gripper"), true},
                           Held{"quadruped", shipped_extra("quadruped"), true},
                           Held{"quadruped", shipped_extra("quadruped"), false}})
    for (const double rate : {30.0, 100.0, 1000.0}) {
      if (!held.fixed && rate < 100.0) continue;
      SCOPED_TRACE(std::string(held.robot) + " at " + std::to_string(rate) +
                   (held.fixed ? "" : " on its feet"));
      WorldOptions options;
      options.time_step = 1.0 / rate;
      options.iterations = 100;
      World world(options);
      RobotOptions robot_options = with_extra(held.extra, held.fixed);
      robot_options.pose.position.z() = held.fixed ? 1.0 : 0.31;
      if (!held.fixed) world.add_body(engine::make_floor(1.0));
      const Robot robot = add_robot(shipped_urdf(held.robot), robot_options, &world);
      EXPECT_EQ(robot.warnings, std::vector<std::string>{});
      std::map<std::string, double> first;
      for (const engine::JointId id : world.joint_ids())
        first[world.joint(id).name] = world.joint_state(id).coordinates[0].position;
      double most = 0.0;
      for (int i = 0; i < static_cast<int>(5.0 * rate); ++i) {
        world.step();
        ASSERT_FALSE(world.report().outcome.failed);
        if (!held.fixed && world.time() < 1.0) continue;
        for (const engine::JointId id : world.joint_ids())
          if (engine::info(world.joint(id).kind).coordinates > 0)
            most = std::max(most, std::abs(world.joint_state(id).coordinates[0].position -
                                           first[world.joint(id).name]));
      }
      EXPECT_LT(most, 1e-3);
    }
}

// A bar of 2 kg, 0.5 m before a hinge, with another of 1 kg at 1.5 m: 9.81 (2·0.5 + 1·1.5) = 24.5 N
// m on the first, 4.9 N m on the second.
TEST(Robots, ServosThatGravityMovesAreReported) {
  const auto body = [](const std::string& name, double mass) {
    return "<link name='" + name + "'><inertial><origin xyz='0.5 0 0'/><mass value='" +
           std::to_string(mass) +
           "'/><inertia ixx='0.1' iyy='0.1' izz='0.1' ixy='0' ixz='0' iyz='0'/></inertial></link>";
  };
  const auto hinge = [](const std::string& name, const std::string& parent,
                        const std::string& child, double x) {
    return "<joint name='" + name + "' type='continuous'><parent link='" + parent +
           "'/><child link='" + child + "'/><origin xyz='" + std::to_string(x) +
           " 0 0'/><axis xyz='0 1 0'/></joint>";
  };
  const std::string urdf = "<robot name='r'>" + body("base", 1.0) + body("upper", 2.0) +
                           body("lower", 1.0) + hinge("a", "base", "upper", 0.0) +
                           hinge("b", "upper", "lower", 1.0) + "</robot>";
  const auto warnings = [&](const std::string& extra, double gravity = 9.81) {
    WorldOptions options;
    options.gravity = {0.0, 0.0, -gravity};
    World world(options);
    return add_robot(urdf, with_extra(extra, true), &world).warnings;
  };
  const std::string ends = " rad, and a position without servo holds it";
  EXPECT_EQ(warnings("motors: {a: {position: 0, servo_stiffness: 100}, b: {position: 0, "
                     "servo_stiffness: 30}}"),
            (std::vector<std::string>{
                "joint 'a': gravity alone turns its servo by 0.245 rad; servo_stiffness 2.48e+04 N "
                "m/rad keeps that below 0.001" +
                    ends,
                "joint 'b': gravity alone turns its servo by 0.163 rad; servo_stiffness 4.95e+03 N "
                "m/rad keeps that below 0.001" +
                    ends}));
  const std::string stiff = "motors: {a: {position: 0, servo_stiffness: 24600}}";
  EXPECT_TRUE(warnings(stiff).empty());
  EXPECT_EQ(warnings(stiff, 20.0).size(), 1u);
  EXPECT_TRUE(warnings("motors: {a: {position: 0}, b: {bias: 0}}").empty());
  // hanging down, at q = pi/2, a servo carries nothing
  EXPECT_TRUE(warnings("positions: {a: 1.5707963}\nmotors: {a: {position: 1.5707963, "
                       "servo_stiffness: 1}}")
                  .empty());
  // a frequency gives the stiffness by all that hangs on the joint
  EXPECT_EQ(warnings("motors: {a: {position: 0, servo_frequency: 0.1}}").size(), 1u);
}

// Without motors, friction and weight an arm stays where it is put, and gravity moves no servo.
// 1e-12 m: rounding of the rows in 500 steps.
TEST(Robots, AnArmWithoutWeightStaysWhereItIsPut) {
  World world;
  const Robot arm =
      add_robot(shipped_urdf("arm"),
                with_extra(std::string(kPose) + "\ngravity_compensation: 1", true), &world);
  const World first = world;
  for (int i = 0; i < 500; ++i) ASSERT_FALSE(world.step().outcome.failed);
  for (const engine::BodyId id : world.body_ids())
    EXPECT_LT((world.state(id).position - first.state(id).position).norm(), 1e-12);
  EXPECT_LT(std::abs(world.energy() - first.energy()), 1e-12);
  World with_servos;
  EXPECT_TRUE(add_robot(shipped_urdf("arm"),
                        with_extra("gravity_compensation: 1\nmotors: {shoulder_lift: {position: 0, "
                                   "servo_stiffness: 1}}",
                                   true),
                        &with_servos)
                  .warnings.empty());
  EXPECT_NE(engine::refusal([&] {
              add_robot(shipped_urdf("arm"), with_extra("gravity_compensation: 2", true), &world);
            }).find("gravity_compensation"),
            std::string::npos);
}

// A lift of 2 kg on a servo: 2 * 9.81 N / 1000 N/m = 0.0196 m.
TEST(Robots, ServosOfSlidersThatGravityMovesAreReported) {
  World world;
  const std::string body =
      "<inertial><mass value='2'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
      "</inertial>";
  const std::string urdf =
      "<robot name='r'><link name='base'>" + body + "</link><link name='lift'>" + body +
      "</link><joint name='z' type='prismatic'><parent link='base'/><child link='lift'/>"
      "<axis xyz='0 0 1'/><limit lower='-1' upper='1' effort='100' velocity='1'/></joint></robot>";
  EXPECT_EQ(
      add_robot(urdf, with_extra("motors: {z: {position: 0, servo_stiffness: 1000}}", true), &world)
          .warnings,
      (std::vector<std::string>{
          "joint 'z': gravity alone moves its servo by 0.0196 m; servo_stiffness 1.98e+04 N/m "
          "keeps that below 0.001 m, and a position without servo holds it"}));
}

// An arm without gravity, whose elbow is held and whose shoulder is released 0.1 rad beside the
// target of its servo: q = 0.1 cos(2 pi f t). The elbow's links, a part that shares mass, and a
// lift count. The bound is the tolerance of the integration, 1e-8 m/s on a length of 1 m, with
// room.
TEST(Robots, ServosHaveTheFrequencyOfAllThatHangsOnThem) {
  const std::string ball =
      "<collision><origin xyz='9 0 0'/><geometry><sphere radius='0.1'/>"
      "</geometry></collision>";
  const auto link = [&](const std::string& name, double mass, const std::string& more) {
    return "<link name='" + name + "'><inertial><origin xyz='0.5 0.1 0'/><mass value='" +
           std::to_string(mass) +
           "'/><inertia ixx='0.1' iyy='0.2' izz='0.15' ixy='0' ixz='0' iyz='0'/></inertial>" +
           more + "</link>";
  };
  const auto joint = [](const std::string& name, const std::string& type, const std::string& parent,
                        const std::string& child, double x) {
    return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent +
           "'/><child link='" + child + "'/><origin xyz='" + std::to_string(x) +
           " 0 0' rpy='0.2 0 0'/><axis xyz='0 1 0'/><limit lower='-9' upper='9' effort='1000' "
           "velocity='9'/></joint>";
  };
  const std::string urdf = "<robot name='r'>" + link("base", 1.0, "") +
                           link("upper", 2.0, ball + ball) + link("lower", 1.0, "") +
                           link("lift", 0.5, "") + joint("a", "continuous", "base", "upper", 0.0) +
                           joint("b", "continuous", "upper", "lower", 1.0) +
                           joint("c", "prismatic", "lower", "lift", 0.3) + "</robot>";
  WorldOptions options;
  options.gravity.setZero();
  options.time_step = 0.01;
  World world(options);
  add_robot(urdf,
            with_extra("positions: {a: 0.1, b: 0.7, c: 0.2}\n"
                       "motors: {a: {position: 0, servo_frequency: 2, servo_damping_ratio: 0}, "
                       "b: {position: 0.7}, c: {position: 0.2}}",
                       true),
            &world);
  for (int i = 0; i < 100; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    ASSERT_NEAR(position_of(world, "a"), 0.1 * std::cos(4.0 * engine::kPi * world.time()), 1e-7);
  }
}

// Feet of grams below a trunk of kilograms need more sweeps than the default.
WorldOptions for_contacts() {
  WorldOptions options;
  options.iterations = 100;
  options.time_step = 0.002;
  return options;
}

// The quadruped stands on its motors: the feet carry its weight, and the trunk stays where the legs
// hold it.
TEST(Robots, QuadrupedStands) {
  World world(for_contacts());
  world.add_body(engine::make_floor(1.0));
  RobotOptions options;
  options.extra = shipped_extra("quadruped");
  options.pose.position.z() = 0.31;
  const Robot robot = add_robot(shipped_urdf("quadruped"), options, &world);
  EXPECT_EQ(robot.bodies.size(), 13u);
  EXPECT_TRUE(robot.warnings.empty());
  double mass = 0.0;
  for (const engine::BodyId id : world.body_ids()) mass += world.body(id).mass;
  for (int i = 0; i < 1500; ++i) world.step();
  double weight = 0.0;
  for (const engine::Contact& contact : world.contacts()) weight += contact.normal_force;
  EXPECT_NEAR(weight, mass * 9.81, 0.01 * mass * 9.81);
  EXPECT_EQ(world.contacts().size(), 4u);
  const engine::BodyState& trunk = world.state(world.find_body("trunk/com"));
  EXPECT_GT(trunk.position.z(), 0.2);
  EXPECT_LT(trunk.linear_velocity.norm(), 1e-2);

  // Pushed aside by 30 N it stays: friction of its feet bears the push.
  const Vector3d before = trunk.position;
  engine::Wrench push;
  push.body = world.find_body("trunk/com");
  push.force = {0.0, 30.0, 0.0};
  push.start = world.time();
  world.add_wrench(push);
  for (int i = 0; i < 100; ++i) world.step();
  Vector3d force = Vector3d::Zero();
  for (const engine::Contact& contact : world.contacts()) force += contact.force;
  EXPECT_NEAR(std::abs(force.y()), 30.0, 0.1);
  EXPECT_LT((trunk.position - before).norm(), 1e-4);
}

// The gripper closes on a box of 0.2 kg until the crank is at its effort limit, and lifts it by 0.2
// m.
TEST(Robots, GripperLiftsItsLoad) {
  World world(for_contacts());
  world.add_body(engine::make_floor(1.0));
  engine::Body load =
      engine::make_body("load", engine::Box{{0.04, 0.04, 0.06}}, 0.2, Vector3d{0.0, 0.0, 0.03});
  load.friction = 1.0;
  const engine::BodyId id = world.add_body(load);
  RobotOptions options;
  options.extra = shipped_extra("gripper");
  options.fixed = true;
  options.pose.position.z() = -0.05;
  add_robot(shipped_urdf("gripper"), options, &world);
  const auto drive = [&](const char* joint, double rate, double max_force, double seconds) {
    engine::Motor motor;
    motor.bias = rate;
    motor.max_force = max_force;
    world.set_motor(world.find_joint(joint), motor);
    for (int i = 0; i < static_cast<int>(seconds / 0.002); ++i) world.step();
  };
  drive("left_crank", -0.5, 1.0, 1.0);
  // the crank presses, with a share of its limit that depends on friction in the linkage
  EXPECT_LT(world.joint_state(world.find_joint("left_crank")).coordinates[0].effort, -0.2);
  const double squeezed = world.state(id).position.z();
  drive("lift", 0.1, 200.0, 2.0);
  drive("lift", 0.0, 200.0, 1.0);
  EXPECT_NEAR(position_of(world, "lift"), 0.2, 1e-3);
  // contacts creep by a part of a millimetre
  EXPECT_NEAR(world.state(id).position.z() - squeezed, 0.2, 2e-3);
  // fingers stay upright
  const engine::BodyState& finger = world.state(world.find_body("left_finger/com"));
  EXPECT_GT(finger.orientation.w(), 0.9999);
}

/// Follows a trajectory of some joints to one point within 2 s.
void follow(const std::vector<std::string>& joints, const std::vector<double>& end, World* world) {
  JointTrajectory trajectory;
  trajectory.joints = joints;
  trajectory.points = {{2.0, end, std::vector<double>(end.size(), 0.0), {}}};
  Trajectories trajectories;
  trajectories.begin(*world, trajectory);
  while (!trajectories.empty()) {
    trajectories.before_step(world);
    ASSERT_FALSE(world->step().outcome.failed);
  }
}

// The tutorial of an own robot: the picker lowers its arm, presses a box of 0.2 kg to its pad,
// lifts it by 0.25 m and turns by 1.2 rad, so that the box is at 0.45 m (cos 1.2, sin 1.2).
// time_stepping is of first order: the box is 1.01 mm away at 0.002 s, where it tilts by 0.5° when
// the finger hits it, and 0.29 mm at half of the time step.
TEST(Robots, PickerCarriesABox) {
  const std::string folder = CONSTRAINT_SIM_SOURCE_DIR "/examples/";
  std::vector<double> off;
  for (const double h : {0.002, 0.001}) {
    WorldOptions options;
    options.method = engine::Method::kTimeStepping;
    options.time_step = h;
    World world(options);
    const Robot robot = add_robot(read_text(folder + "picker.urdf"),
                                  with_extra(read_text(folder + "picker.yaml"), true), &world);
    EXPECT_EQ(robot.warnings, std::vector<std::string>{});
    world.add_body(engine::make_floor(1.0));
    engine::Body box =
        engine::make_body("box", engine::Box{{0.04, 0.04, 0.06}}, 0.2, Vector3d{0.45, 0.0, 0.03});
    box.friction = 1.0;
    const engine::BodyId id = world.add_body(box);
    follow({"turn", "lift"}, {0.0, 0.0}, &world);
    engine::Motor motor;
    motor.bias = 0.05;
    motor.max_force = 20.0;
    world.set_motor(world.find_joint("left_finger"), motor);
    for (int i = 0; i < static_cast<int>(1.0 / h); ++i) ASSERT_FALSE(world.step().outcome.failed);
    follow({"lift", "turn"}, {0.25, 1.2}, &world);
    const Vector3d exact{0.45 * std::cos(1.2), 0.45 * std::sin(1.2), 0.28};
    off.push_back((world.state(id).position - exact).norm());
  }
  EXPECT_LT(off[0], 1.2e-3);
  EXPECT_LT(off[1], 0.6 * off[0]);
}

TEST(Robots, ExportsAsAnyOtherScene) {
  World world;
  for (const char* name : {"arm", "quadruped", "gripper"}) {
    RobotOptions options;
    options.extra = std::string(name) == "arm" ? kPose : shipped_extra(name);
    options.prefix = std::string(name) + "_1/";
    options.fixed = std::string(name) != "quadruped";
    add_robot(shipped_urdf(name), options, &world);
  }
  const std::string text = engine::save_scene(world);
  const World loaded = engine::load_scene(text);
  EXPECT_EQ(engine::save_scene(loaded), text);
  EXPECT_EQ(loaded.joint_ids().size(), world.joint_ids().size());
}

// A robot added to a world with other robots has joints and couplings on its own bodies; where a
// name is taken the world stays unchanged.
TEST(Robots, AreAddedAfterOthers) {
  World world;
  RobotOptions options = with_extra("", true);
  options.prefix = "a/";
  const Robot gone = add_robot(shipped_urdf("arm"), options, &world);
  add_robot(shipped_urdf("quadruped"), {}, &world);
  world.remove({}, {world.find_body(gone.bodies[3])});
  options.extra = shipped_extra("gripper");
  options.prefix = "b/";
  const BuiltRobot built = build_robot(shipped_urdf("gripper"), options);
  const Robot gripper = add_robot(built, &world);
  EXPECT_EQ(gripper.bodies, built.robot.bodies);
  const auto is_own = [&](const std::string& name) { return name.compare(0, 2, "b/") == 0; };
  bool any_coupling = false;
  for (const std::string& name : gripper.constraints) {
    const engine::Joint& joint = world.joint(world.find_joint(name));
    for (const engine::BodyId id : {joint.body_a, joint.body_b})
      EXPECT_TRUE(is_own(world.body(id).name)) << name;
    if (!engine::info(joint.kind).couples_joints) continue;
    any_coupling = true;
    for (const engine::JointId id : {joint.coupling.first, joint.coupling.second})
      EXPECT_TRUE(is_own(world.joint(id).name)) << name;
  }
  EXPECT_TRUE(any_coupling);
  for (const RobotLink& link : gripper.links) EXPECT_TRUE(is_own(world.body(link.body).name));
  const std::uint64_t hash = world.state_hash();
  EXPECT_THROW(add_robot(built, &world), std::invalid_argument);
  EXPECT_EQ(world.state_hash(), hash);
}

// Costs of a chain are linear, and the warnings of a robot are bounded: each link overlaps all
// others.
TEST(Robots, ALongChainIsBuiltAtOnce) {
  std::ostringstream text;
  text << "<robot name='chain'>";
  constexpr int kLinks = 2000;
  for (int i = 0; i < kLinks; ++i)
    text << "<link name='l" << i << "'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' "
         << "ixy='0' ixz='0' iyz='0'/></inertial><collision><geometry><sphere radius='1'/>"
         << "</geometry></collision></link>";
  for (int i = 0; i + 1 < kLinks; ++i)
    text << "<joint name='j" << i << "' type='continuous'><origin xyz='0.1 0 0'/><parent link='l"
         << i << "'/><child link='l" << i + 1 << "'/><axis xyz='0 1 0'/></joint>";
  text << "</robot>";
  World world;
  const Robot robot = add_robot(text.str(), {}, &world);
  EXPECT_EQ(robot.constraints.size(), static_cast<std::size_t>(kLinks - 1 + 1000));
  EXPECT_EQ(robot.warnings.size(),
            22u);  // 20 pairs of some 17 a link, that there are more, and that most collide
}

}  // namespace
}  // namespace constraint_sim
