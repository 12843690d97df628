// Motors that the panel finds in a scene, against parsing all of it.

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "panel/motors.h"
#include "test_paths.h"

namespace constraint_sim::panel {
namespace {

std::vector<std::string> names_of_motors(const std::string& scene) {
  std::vector<std::string> names;
  for (const YAML::Node& constraint : YAML::Load(scene)["constraints"]) {
    const YAML::Node coordinates = constraint["coordinates"];
    if (constraint["motor"] || (coordinates && coordinates[0]["motor"]))
      names.push_back(constraint["name"].as<std::string>());
  }
  return names;
}

TEST(Motors, AreThoseOfEachShippedScene) {
  std::size_t found = 0;
  for (const auto& file : std::filesystem::directory_iterator(CONSTRAINT_SIM_SCENE_DIR)) {
    engine::World world = engine::load_scene_file(file.path().string());
    for (int step = 0; step < 3; ++step) world.step();  // the saved scene has contacts and islands
    const std::string scene = engine::save_scene(world);
    std::vector<std::string> names;
    for (const Motor& motor : motors_in(scene, 1000)) names.push_back(motor.constraint);
    EXPECT_EQ(names, names_of_motors(scene)) << file.path();
    found += names.size();
  }
  EXPECT_GT(found, 10u);
}

TEST(Motors, HaveTheKeyAndValueOfTheirKind) {
  const std::string scene = engine::save_scene(engine::load_scene(R"(
bodies:
  - {name: a, mass: 1, shape: {sphere: {radius: 0.1}}, position: [1, 0, 0]}
constraints:
  - {name: rod, body_b: a}
  - {name: winch, body_b: a, motor: {bias: -0.5}}
  - {name: turned, type: hinge, body_b: a, motor: {position: 0.25}}
  - {name: pushed, type: cylindrical, body_b: a, coordinates: [{motor: {force: 2}}, {}]}
)"));
  const std::vector<Motor> motors = motors_in(scene, 10);
  ASSERT_EQ(motors.size(), 3u);
  EXPECT_EQ(motors[0].constraint + " " + motors[0].key, "winch bias");
  EXPECT_EQ(motors[0].value, -0.5);
  EXPECT_EQ(motors[1].constraint + " " + motors[1].key, "turned motor_position");
  EXPECT_EQ(motors[1].value, 0.25);
  EXPECT_EQ(motors[2].constraint + " " + motors[2].key, "pushed motor_force");
  EXPECT_EQ(motors[2].value, 2.0);
  EXPECT_EQ(motors_in(scene, 2).size(), 2u);
  EXPECT_TRUE(motors_in("constraints: []\n", 10).empty());
  EXPECT_TRUE(motors_in("", 10).empty());
}

}  // namespace
}  // namespace constraint_sim::panel
