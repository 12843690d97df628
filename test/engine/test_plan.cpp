// What a world says that it uses and leaves out.

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
  EXPECT_EQ(island["method"].as<std::string>(), "sequential_impulses");
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
  // two bodies without friction, and no body alone or stiff
  EXPECT_EQ(plan["left_out"].as<std::vector<std::string>>(),
            (std::vector<std::string>{"friction: no two bodies that could touch have it",
                                      "runge_kutta: carries no island now",
                                      "energy_momentum: carries no island now"}));
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
        "wrenches", "energy_momentum", "sequential_impulses"}) {
    const auto is_it = [&](const std::string& line) {
      return line.rfind(what + std::string(": "), 0) == 0;
    };
    EXPECT_EQ(std::count_if(lines.begin(), lines.end(), is_it), 1) << what;
  }
  EXPECT_EQ(lines.size(), 11u);
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

}  // namespace
}  // namespace constraint_sim::engine
