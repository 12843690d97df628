// The plan of a world: methods in use, and those left out.

#include <yaml-cpp/yaml.h>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

constexpr const char* kScene = R"(
bodies:
  - {name: floor, type: static, shape: {plane: {}}}
  - {name: cart, type: kinematic, shape: {box: {size: [1, 1, 1]}}}
  - {name: ball, shape: {sphere: {radius: 0.1}}, mass: 1, position: [1, 0, 2]}
  - {name: bob, mass: 1, position: [2, 0, 2]}
constraints:
  - {name: rod, body_a: ball, body_b: bob, motor: {bias: 0.1}}
  - {name: rope, type: rope, body_b: bob}
  - {name: spring, type: spring, stiffness: 5, body_b: bob, broken: true}
  - {name: ball, type: ball, anchor_a: [1, 0, 2], body_b: ball}
wrenches:
  - {body: bob, force: [1, 0, 0]}
  - {body: ball, torque: [1, 0, 0], start: 1, duration: 2}
)";

TEST(Plan, SaysWhatThereIs) {
  const YAML::Node plan = YAML::Load(explain(load_scene(kScene)));
  EXPECT_EQ(plan["method"]["asked_for"].as<std::string>(), "auto");
  ASSERT_EQ(plan["islands"].size(), 1u);  // ball and bob
  const YAML::Node island = plan["islands"][0];
  EXPECT_EQ(island["method"].as<std::string>(), "event_driven");
  EXPECT_EQ(island["why"].as<std::string>(), "has limits");
  EXPECT_EQ(island["count"].as<int>(), 1);
  EXPECT_EQ(island["bodies"].as<int>(), 2);
  EXPECT_EQ(island["constraints"].as<int>(), 3);  // without the broken one
  for (const char* type : {"static", "kinematic"}) EXPECT_EQ(plan["bodies"][type].as<int>(), 1);
  EXPECT_EQ(plan["bodies"]["dynamic"].as<int>(), 2);
  for (const char* shape : {"point", "sphere", "box", "plane"})
    EXPECT_EQ(plan["shapes"][shape].as<int>(), 1) << shape;
  for (const char* kind : {"rod", "limited", "spring", "ball", "motor", "broken"})
    EXPECT_EQ(plan["constraints"][kind].as<int>(), 1) << kind;
  EXPECT_EQ(plan["wrenches"].as<int>(), 2);
  EXPECT_TRUE(plan["collision"].as<bool>());
  EXPECT_TRUE(plan["rotation"].as<bool>());
  // two bodies without friction, and no single or stiff body
  EXPECT_EQ(
      plan["left_out"].as<std::vector<std::string>>(),
      (std::vector<std::string>{
          "friction: no two bodies that could touch have it", "runge_kutta: advances no island",
          "energy_momentum: advances no island", "time_stepping: advances no island"}));
}

TEST(Plan, SaysWhatIsLeftOut) {
  const World world = load_scene("bodies:\n  - {name: bob, mass: 1}\n");
  const YAML::Node plan = YAML::Load(explain(world));
  EXPECT_FALSE(plan["collision"].as<bool>());
  EXPECT_FALSE(plan["rotation"].as<bool>());
  EXPECT_EQ(plan["left_out"].as<std::vector<std::string>>(), left_out(world));
  const std::vector<std::string> lines = left_out(world);
  for (const char* what :
       {"collision", "boxes", "friction", "constraints", "limits", "springs", "motors", "rotation",
        "wrenches", "energy_momentum", "event_driven", "time_stepping"}) {
    const auto is_it = [&](const std::string& line) {
      return line.rfind(what + std::string(": "), 0) == 0;
    };
    EXPECT_EQ(std::count_if(lines.begin(), lines.end(), is_it), 1) << what;
  }
  EXPECT_EQ(lines.size(), 12u);
  ASSERT_EQ(plan["islands"].size(), 1u);
  EXPECT_EQ(plan["islands"][0]["method"].as<std::string>(), "runge_kutta");
  EXPECT_EQ(plan["islands"][0]["why"].as<std::string>(), "smooth");
}

TEST(Plan, OfAnEmptyWorldIsYamlToo) {
  EXPECT_EQ(YAML::Load(explain(World()))["bodies"]["dynamic"].as<int>(), 0);
}

TEST(Plan, FollowsEdits) {
  World world = load_scene(kScene);
  const std::string before = explain(world);
  run(world, 10);
  EXPECT_EQ(explain(world), before);
  world.clear_wrenches(world.find_body("bob"));
  world.set_motor(world.find_joint("rod"), {});
  world.remove_body(world.find_body("ball"));
  const YAML::Node plan = YAML::Load(explain(world));
  EXPECT_EQ(plan["wrenches"].as<int>(), 0);
  EXPECT_EQ(plan["constraints"]["motor"].as<int>(), 0);
  EXPECT_FALSE(plan["collision"].as<bool>());
  EXPECT_FALSE(plan["rotation"].as<bool>());
}

TEST(Plan, CountsLawsOfCoordinates) {
  World world = load_scene(R"(
bodies:
  - {name: a, shape: {sphere: {radius: 0.1}}, mass: 1}
  - {name: b, shape: {sphere: {radius: 0.1}}, mass: 1, position: [3, 0, 0]}
constraints:
  - {name: door, type: hinge, body_b: a, motor: {bias: 0.0}, lower: -1}
  - name: ice
    type: planar
    anchor_a: [3, 0, 0]
    body_b: b
    coordinates: [{stiffness: 5}, {damping: 1, friction: 0.1}, {motor: {position: 1, servo_stiffness: 3}}]
)");
  const YAML::Node constraints = YAML::Load(explain(world))["constraints"];
  EXPECT_EQ(constraints["hinge"].as<int>(), 1);
  EXPECT_EQ(constraints["planar"].as<int>(), 1);
  EXPECT_EQ(constraints["motor"].as<int>(), 2);   // a holding motor and a servo
  EXPECT_EQ(constraints["spring"].as<int>(), 3);  // a spring, a damper, a servo
  EXPECT_EQ(constraints["limited"].as<int>(), 1);
  EXPECT_EQ(constraints["friction"].as<int>(), 1);
  for (const std::string& line : left_out(world))
    for (const char* what : {"motors: ", "springs: ", "limits: ", "friction: "})
      EXPECT_NE(line.rfind(what, 0), 0u) << line;
  world.remove_joint(world.find_joint("ice"));
  EXPECT_FALSE(YAML::Load(explain(world))["constraints"]["friction"]);
  world.set_motor(world.find_joint("door"), 0, std::nullopt);
  EXPECT_EQ(YAML::Load(explain(world))["constraints"]["motor"].as<int>(), 0);
}

TEST(Plan, SaysHowFarAJointIsOpen) {
  World world;
  world.add_body(make_body("a", Sphere{0.1}, 1.0, {0.0, 0.0, 0.0}));
  const BodyId b = world.add_body(make_body("b", Sphere{0.1}, 1.0, {1.0, 0.0, 0.0}));
  const auto opening = [&](JointKind kind, double gap, double degrees, const char* law = "") {
    World copy = world;
    Joint joint;
    joint.name = "joint";
    joint.kind = kind;
    joint.body_a = copy.find_body("a");
    joint.body_b = b;
    joint.anchor_a = {1.0 + gap, 0.0, 0.0};
    const double angle = degrees / 180.0 * kPi;
    if (info(kind).has_frames)
      joint.axis_b = Eigen::Vector3d(0.0, std::sin(angle), std::cos(angle));
    if (kind == JointKind::kDistance) joint.distance.length = 2.0 * gap;
    CoordinateLaw& first = joint.coordinates[0];
    if (law == std::string("motor")) first.motor.emplace().position = 1.5;
    if (law == std::string("limit")) first.lower = 0.25;
    return text_of_opening(copy, copy.add_joint(joint));
  };
  EXPECT_EQ(opening(JointKind::kHinge, 0.0, 0.0), "");
  EXPECT_EQ(opening(JointKind::kHinge, 0.0, 0.0, "limit"),
            "coordinate 0 0.25 rad beyond its limit; closes in 0.5 s");
  EXPECT_EQ(opening(JointKind::kHinge, 0.12, 80.0),
            "anchors 0.12 m apart, axes 80 degrees off; closes in 0.5 s");
  EXPECT_EQ(opening(JointKind::kHinge, 0.12, 170.0),
            "anchors 0.12 m apart, axes 170 degrees off; closes in 0.5 s; was the axis meant the "
            "other way round?");
  EXPECT_EQ(opening(JointKind::kSlider, 0.12, 0.0), "anchors 0.12 m apart; closes in 0.5 s");
  EXPECT_EQ(opening(JointKind::kBall, 0.12, 0.0), "anchors 0.12 m apart; closes in 0.5 s");
  EXPECT_EQ(opening(JointKind::kDistance, 0.12, 0.0), "length 0.12 m off; closes in 0.5 s");
  EXPECT_EQ(opening(JointKind::kHinge, 0.0, 0.0, "motor"),
            "coordinate 0 1.5 rad from where its motor holds it; closes in 0.5 s");
  WorldOptions chosen = world.options();
  chosen.method = Method::kSequentialImpulses;
  world.set_options(chosen);
  EXPECT_EQ(opening(JointKind::kHinge, 0.12, 0.0),
            "anchors 0.12 m apart; closes by the share 0.1 of it a step");
}

}  // namespace
}  // namespace constraint_sim::engine
