// The command-line runner takes a URDF in place of a scene.

#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>

#include "constraint_sim/engine/scene.h"
#include "robots.h"
#include "temporary_folder.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {
namespace {

class RunRobot : public testing::Test {
 protected:
  /// Runs the program in a folder of its own and returns its exit status.
  int run(const std::string& arguments) {
    const std::string command = "cd '" + folder_.path() + "' && '" CONSTRAINT_SIM_RUN "' " +
                                arguments + " >out.txt 2>err.txt";
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string file(const std::string& name) const { return folder_.path() + "/" + name; }

  engine::TemporaryFolder folder_;
  const std::string arm_ = CONSTRAINT_SIM_ROBOT_DIR "/arm.urdf";
};

// The arm holds the pose of the YAML beside it, as Robots.HoldTheirPoses says: 1e-3 rad.
TEST_F(RunRobot, TheArmHoldsItsPose) {
  ASSERT_EQ(run("'" + arm_ + "' --duration 5 --robot-fixed --save end.yaml"), 0)
      << read_text(file("err.txt"));
  const engine::World world = engine::load_scene_file(file("end.yaml"));
  EXPECT_EQ(world.joint_ids().size(), 6u);
  EXPECT_NEAR(position_of(world, "shoulder_lift"), -1.2, 1e-3);
  EXPECT_NEAR(position_of(world, "elbow"), 1.5, 1e-3);
}

TEST_F(RunRobot, NoOutputReplacesAFileOfTheRobot) {
  ASSERT_EQ(std::system(("cp '" + arm_ + "' '" + file("arm.urdf") + "'").c_str()), 0);
  std::ofstream(file("arm.srdf")) << "";
  for (const char* name : {"arm.yaml", "extra.yaml"}) std::ofstream(file(name)) << "hold: true\n";
  for (const char* arguments : {"--csv arm.urdf", "--save ./arm.yaml", "--snapshot arm.srdf",
                                "--robot-extra extra.yaml --save extra.yaml"}) {
    EXPECT_EQ(run("arm.urdf --duration 0 " + std::string(arguments)), 2) << arguments;
    EXPECT_NE(read_text(file("err.txt")).find("is the file of "), std::string::npos) << arguments;
  }
  for (const char* name : {"arm.yaml", "extra.yaml"})
    EXPECT_EQ(read_text(file(name)), "hold: true\n");
  EXPECT_EQ(run("arm.urdf --duration 0 --robot-extra extra.yaml --save arm.yaml"), 0)
      << read_text(file("err.txt"));  // read in no such run
}

// The file of the option replaces the YAML beside the URDF, the root is where it is asked to be,
// and a URDF on standard input has no file beside it.
TEST_F(RunRobot, HasTheArgumentsOfTheNode) {
  std::ofstream(file("extra.yaml")) << "positions: {shoulder_lift: -1.2, elbow: 0.5}\nhold: true\n"
                                       "motors: {elbow: {bias: 0.2, max_force: 0}}\n";
  ASSERT_EQ(run("'" + arm_ +
                "' --duration 1 --robot-fixed --robot-z 2 --robot-extra extra.yaml "
                "--save end.yaml"),
            0);
  const engine::World world = engine::load_scene_file(file("end.yaml"));
  EXPECT_NEAR(position_of(world, "elbow"), 0.7, 1e-9);  // a motor by rate is rigid
  ASSERT_EQ(run("'" + arm_ + "' --duration 0 --robot-fixed --save low.yaml"), 0);
  const engine::World low = engine::load_scene_file(file("low.yaml"));
  const auto height = [](const engine::World& of) {
    return of.state(of.find_body("base_link/com")).position.z();
  };
  EXPECT_NEAR(height(world) - height(low), 2.0, 1e-12);

  ASSERT_EQ(run("- --duration 0 --robot-fixed --save piped.yaml <'" + arm_ + "'"), 0);
  const engine::World piped = engine::load_scene_file(file("piped.yaml"));
  EXPECT_NEAR(position_of(piped, "elbow"), 0.0, 1e-12);  // rounding
  EXPECT_FALSE(piped.joint(piped.find_joint("elbow")).coordinates[0].motor);
}

TEST_F(RunRobot, DeviationsArePrintedAndFaultsRejected) {
  std::string text = shipped_urdf("arm");
  text.insert(text.find("</robot>"), "<gazebo reference='tool0'/>");
  std::ofstream(file("arm.urdf")) << text;
  ASSERT_EQ(run("arm.urdf --duration 0 --robot-fixed"), 0);
  EXPECT_NE(read_text(file("err.txt")).find("robot arm: "), std::string::npos);
  EXPECT_NE(read_text(file("err.txt")).find("<gazebo>"), std::string::npos)
      << read_text(file("err.txt"));

  std::ofstream(file("arm.urdf")) << "<robot name='r'><link name='a'/></robot>";
  EXPECT_EQ(run("arm.urdf --duration 1"), 2);
  std::ofstream(file("model.sdf")) << "<sdf version='1.9'><model name='m'/></sdf>";
  EXPECT_EQ(run("model.sdf --duration 1"), 2);
  EXPECT_NE(read_text(file("err.txt")).find("SDF"), std::string::npos)
      << read_text(file("err.txt"));
  std::ofstream(file("model.sdf"))
      << "<sdf version='1.7'><model name='m'><link name='a'/><joint name='j' type='ball'>"
         "<parent>world</parent><child>a</child></joint></model></sdf>";
  EXPECT_EQ(run("model.sdf --duration 0 --save model.yaml"), reads_sdf() ? 0 : 2)
      << read_text(file("err.txt"));
  if (reads_sdf()) {
    const engine::World world = engine::load_scene_file(file("model.yaml"));
    EXPECT_EQ(world.joint(world.find_joint("j")).kind, engine::JointKind::kBall);
  }
  EXPECT_EQ(run("pendulum --duration 1 --robot-fixed"), 2);
  EXPECT_NE(read_text(file("err.txt")).find("are for URDFs, and 'pendulum' is none"),
            std::string::npos)
      << read_text(file("err.txt"));
}

}  // namespace
}  // namespace constraint_sim
