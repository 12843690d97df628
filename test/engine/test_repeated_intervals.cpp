// A contact group with joints at rest, in which an interval repeats the last one. Oracle: a world
// read from a snapshot, which remembers no interval.

#include <functional>

#include "constraint_sim/engine/snapshot.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Joint hinge(const std::string& name, BodyId a, const Vector3d& anchor_a, BodyId b) {
  Joint joint = make_joint(name, a, anchor_a, b, {-0.2, 0.0, 0.0});
  joint.kind = JointKind::kHinge;
  joint.frame_a = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), Vector3d::UnitY());
  joint.coordinates[0].motor = rate_motor(0.0, 20.0);
  joint.coordinates[0].motor->position = 0.0;
  return joint;
}

/// Two bars on hinges about y that motors hold at positions, the lower one on the floor, and a ball
/// on a rope that hangs from the upper one.
struct ArmOnFloor {
  ArmOnFloor() {
    WorldOptions options;
    options.sleep_after = std::numeric_limits<double>::infinity();
    world.set_options(options);
    world.add_body(make_floor(0.5));
    const Box bar{{0.4, 0.05, 0.05}};
    const BodyId upper = world.add_body(make_body("upper", bar, 1.0, {0.2, 0.0, 0.5}));
    lower = world.add_body(make_body("lower", bar, 1.0, {0.6, 0.0, 0.025}));
    const BodyId ball = world.add_body(make_body("ball", Sphere{0.02}, 0.1, {0.2, 0.0, 0.1}));
    world.add_joint(hinge("shoulder", kWorldBody, {0.0, 0.0, 0.5}, upper));
    elbow = world.add_joint(hinge("elbow", upper, {0.2, 0.0, -0.475}, lower));
    rope = world.add_joint(
        make_joint("rope", upper, Vector3d::Zero(), ball, Vector3d::Zero(), engine::rope(0.4)));
  }

  void change(JointId id, const std::function<void(Joint*)>& change) {
    Joint joint = world.joint(id);
    change(&joint);
    world.set_joint(id, joint);
  }
  void change_law(const std::function<void(CoordinateLaw*)>& change) {
    CoordinateLaw law = world.joint(elbow).coordinates[0];
    change(&law);
    world.set_law(elbow, 0, law);
  }

  World world;
  BodyId lower;
  JointId elbow, rope;
};

/// Bits that a world reports: states, forces, events and what motors and contacts do.
std::vector<double> report_of(const World& world) {
  std::vector<double> numbers{world.report().local_error, world.report().energy.correction_work,
                              static_cast<double>(world.state_hash())};
  for (const JointId id : world.joint_ids()) {
    const JointState& state = world.joint_state(id);
    const CoordinateState& first = state.coordinates[0];
    const World::JointWrench wrench = world.joint_wrench(id);
    for (const double number :
         {state.force, first.effort, first.held, first.braking, state.saturated ? 1.0 : 0.0,
          wrench.force.x(), wrench.force.z(), wrench.torque.y()})
      numbers.push_back(number);
  }
  for (const Contact& contact : world.contacts())
    for (const double number :
         {contact.force.x(), contact.force.z(), contact.depth, static_cast<double>(contact.state)})
      numbers.push_back(number);
  for (const Event& event : world.events())
    for (const double number : {event.time, static_cast<double>(event.kind), event.impulse})
      numbers.push_back(number);
  return numbers;
}

struct Edit {
  const char* name;
  std::function<void(ArmOnFloor*)> apply;
};

void PrintTo(const Edit& edit, std::ostream* out) { *out << edit.name; }

const Edit kEdits[] = {
    {"nothing", [](ArmOnFloor*) {}},
    {"position",
     [](ArmOnFloor* arm) { arm->change_law([](auto* law) { law->motor->position = 0.01; }); }},
    {"rate", [](ArmOnFloor* arm) { arm->world.set_motor(arm->elbow, 0, rate_motor(0.1)); }},
    {"force",
     [](ArmOnFloor* arm) { arm->change_law([](auto* law) { law->motor->max_force = 0.5; }); }},
    {"no motor", [](ArmOnFloor* arm) { arm->world.set_motor(arm->elbow, 0, std::nullopt); }},
    {"friction", [](ArmOnFloor* arm) { arm->change_law([](auto* law) { law->friction = 1.0; }); }},
    {"limit", [](ArmOnFloor* arm) { arm->change_law([](auto* law) { law->upper = 0.0; }); }},
    {"spring",
     [](ArmOnFloor* arm) {
       arm->change_law([](auto* law) {
         law->stiffness = 10.0;
         law->rest = 0.2;
       });
     }},
    {"break",
     [](ArmOnFloor* arm) {
       arm->change(arm->elbow, [](Joint* joint) { joint->break_force = 1.0; });
     }},
    {"rope",
     [](ArmOnFloor* arm) {
       arm->change(arm->rope, [](Joint* joint) { joint->distance.max_length = 0.41; });
     }},
    {"winch", [](ArmOnFloor* arm) { arm->world.set_motor(arm->rope, rate_motor(-0.1)); }},
    {"mass",
     [](ArmOnFloor* arm) {
       Body body = arm->world.body(arm->lower);
       body.mass = 2.0;
       arm->world.set_body(arm->lower, body);
     }},
    {"wrench",
     [](ArmOnFloor* arm) {
       arm->world.add_wrench({arm->lower, {0.0, 0.0, 12.0}, Vector3d::Zero(), 0.0, 10.0});
     }},
    {"overlap",
     [](ArmOnFloor* arm) {
       BodyState state = arm->world.state(arm->lower);
       state.position.z() -= 2e-6;
       arm->world.set_state(arm->lower, state);
     }},
    {"gravity",
     [](ArmOnFloor* arm) {
       WorldOptions options = arm->world.options();
       options.gravity.z() = -5.0;
       arm->world.set_options(options);
     }},
    {"tick",
     [](ArmOnFloor* arm) {
       WorldOptions options = arm->world.options();
       options.time_step = 0.02;
       arm->world.set_options(options);
     }},
};

void expect_what_is_computed(World* world, const std::string& where) {
  World computed = read_snapshot(write_snapshot(*world));
  computed.step();
  world->step();
  EXPECT_EQ(report_of(*world), report_of(computed)) << where;
}

class RepeatedIntervals : public testing::TestWithParam<Edit> {};

INSTANTIATE_TEST_SUITE_P(Edits, RepeatedIntervals, testing::ValuesIn(kEdits));

TEST_P(RepeatedIntervals, AreWhatAComputedOneWouldBe) {
  ArmOnFloor arm;
  run(arm.world, 5);
  EXPECT_EQ(arm.world.report().costs.substeps, 0u);
  ASSERT_EQ(arm.world.contacts().size(), 4u);
  for (int edits = 0; edits < 2; ++edits) {
    for (int i = 0; i < 5; ++i)
      expect_what_is_computed(&arm.world, std::to_string(edits) + " " + std::to_string(i));
    GetParam().apply(&arm);
  }
}

// Also from the first interval on, after which contacts count as touched. At the friction of the
// slope they may stick or slip.
TEST(RepeatedIntervals, OfABoxOnASlopeAreWhatComputedOnesWouldBe) {
  constexpr double kSlope = 0.5;
  for (const double friction : {0.7, kSlope, 0.0})
    for (const double height : {0.0, 0.001}) {
      WorldOptions options;
      options.time_step = 0.01;
      options.gravity = friction > 0.0 ? Vector3d(9.0 * kSlope, 0.0, -9.0) : Vector3d(0, 0, -9.0);
      options.sleep_after = std::numeric_limits<double>::infinity();
      World world(options);
      world.add_body(make_floor(friction));
      Body box = make_body("box", Box{{0.4, 0.4, 0.2}}, 1.0, {0.0, 0.0, 0.1 + height});
      box.friction = friction;
      world.add_body(box);
      for (int i = 0; i < 10; ++i) {
        expect_what_is_computed(&world, std::to_string(friction) + " " + std::to_string(i));
        EXPECT_TRUE(height > 0.0 || world.events().empty());
      }
      EXPECT_EQ(world.islands().front().method, Method::kEventDriven);
    }
}

}  // namespace
}  // namespace constraint_sim::engine
