// An edit restarts the islands that it affects, and leaves all others unchanged, to the bit.

#include <functional>

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Five double pendula far from each other, of bars on balls and of points on rods, and a tumbling
/// box; with step sizes carried over between ticks.
World five_pendula() {
  World world(options(0.01));
  WorldOptions chosen = world.options();
  chosen.method = Method::kAuto;
  world.set_options(chosen);
  for (int i = 0; i < 5; ++i) {
    const std::string number = std::to_string(i);
    const Vector3d hook(5.0 * i, 0.0, 0.0);
    const Shape shape = i % 2 == 0 ? Shape(Point{}) : Shape(Box{{0.8, 0.1, 0.2}});
    Body upper = make_body("upper_" + number, shape, 1.0, hook + Vector3d(0.5, 0.0, 0.0));
    Body lower = make_body("lower_" + number, shape, 2.0, hook + Vector3d(1.5, 0.0, 0.0));
    for (Body* body : {&upper, &lower}) body->no_collision = true;
    const BodyId a = world.add_body(upper), b = world.add_body(lower);
    if (i % 2 == 0) {
      world.add_joint(make_joint("top_" + number, kWorldBody, hook, a, Vector3d::Zero()));
      world.add_joint(make_joint("low_" + number, a, Vector3d::Zero(), b, Vector3d::Zero()));
    } else {
      world.add_joint(
          make_joint("top_" + number, kWorldBody, hook, a, {-0.5, 0.0, 0.0}, JointKind::kBall));
      world.add_joint(
          make_joint("low_" + number, a, {0.5, 0.0, 0.0}, b, {-0.5, 0.0, 0.0}, JointKind::kBall));
    }
  }
  Body box = make_body("box", Box{{0.2, 0.5, 0.9}}, 1.0, {0.0, 20.0, 0.0});
  box.state.angular_velocity = {1.0, 2.0, 3.0};
  world.add_body(box);
  return world;
}

/// Returns bodies whose states differ in any bit after further steps of a world and of its edited
/// copy. All bodies of the first are in the second.
std::vector<std::string> changed_by(const std::function<void(World&)>& edit) {
  World world = five_pendula();
  for (int i = 0; i < 30; ++i) world.step();
  World edited = world;
  edit(edited);
  for (int i = 0; i < 30; ++i) {
    world.step();
    edited.step();
  }
  std::vector<std::string> changed;
  for (const BodyId id : world.body_ids()) {
    const std::string& name = world.body(id).name;
    const BodyState& a = world.state(id);
    const BodyState& b = edited.state(edited.find_body(name));
    if (a.position != b.position || a.orientation.coeffs() != b.orientation.coeffs() ||
        a.linear_velocity != b.linear_velocity || a.angular_velocity != b.angular_velocity)
      changed.push_back(name);
  }
  return changed;
}

using Names = std::vector<std::string>;

TEST(LocalEdits, AMotorRestartsItsIslandAlone) {
  Motor motor;
  motor.bias = 0.1;
  EXPECT_EQ(changed_by([&](World& w) { w.set_motor(w.find_joint("low_2"), motor); }),
            (Names{"upper_2", "lower_2"}));
  motor.max_force = 50.0;  // changes the method too
  EXPECT_EQ(changed_by([&](World& w) { w.set_motor(w.find_joint("top_4"), motor); }),
            (Names{"upper_4", "lower_4"}));
}

TEST(LocalEdits, AStateThatIsSetRestartsItsIslandAlone) {
  EXPECT_EQ(changed_by([](World& w) {
              BodyState state = w.state(w.find_body("lower_1"));
              state.angular_velocity.x() += 1e-3;
              w.set_state(w.find_body("lower_1"), state);
            }),
            (Names{"upper_1", "lower_1"}));
  EXPECT_EQ(changed_by([](World& w) {
              BodyState state = w.state(w.find_body("box"));
              state.angular_velocity.x() += 1e-3;
              w.set_state(w.find_body("box"), state);
            }),
            (Names{"box"}));
}

TEST(LocalEdits, ABrokenJointPartsItsIslandAlone) {
  EXPECT_EQ(changed_by([](World& w) { w.set_broken(w.find_joint("low_3"), true); }),
            (Names{"upper_3", "lower_3"}));
  EXPECT_EQ(changed_by([](World& w) {
              w.set_broken(w.find_joint("top_1"), true);
              w.set_broken(w.find_joint("top_1"), false);
            }),
            (Names{"upper_1", "lower_1"}));
}

TEST(LocalEdits, ADisabledJointPartsItsIslandAlone) {
  EXPECT_EQ(changed_by([](World& w) { w.set_enabled(w.find_joint("low_3"), false); }),
            (Names{"upper_3", "lower_3"}));
  EXPECT_EQ(changed_by([](World& w) {
              w.set_enabled(w.find_joint("top_1"), false);
              w.set_enabled(w.find_joint("top_1"), true);
            }),
            (Names{"upper_1", "lower_1"}));
}

TEST(LocalEdits, WhatIsAddedChangesNothingElse) {
  EXPECT_EQ(changed_by([](World& w) {
              const BodyId id = w.add_body(make_body("new", Point{}, 1.0, {0.0, -5.0, 0.0}));
              w.add_joint(make_joint("rope", kWorldBody, {0.0, -5.0, 1.0}, id, Vector3d::Zero()));
            }),
            Names{});
  EXPECT_EQ(changed_by([](World& w) {
              const BodyId id = w.add_body(make_body("load", Point{}, 1.0, {11.5, 0.0, -5.0}));
              w.add_joint(make_joint("rope", w.find_body("lower_2"), Vector3d::Zero(), id,
                                     Vector3d::Zero()));
            }),
            (Names{"upper_2", "lower_2"}));
}

// Removal changes indices, and everything is compiled again.
TEST(LocalEdits, WhatIsRemovedOrConcernsAllRestartsAll) {
  EXPECT_FALSE(changed_by([](World& w) {
                 WorldOptions options = w.options();
                 options.tolerance *= 0.5;
                 w.set_options(options);
               }).empty());
  const Names changed = changed_by([](World& w) { w.remove_joint(w.find_joint("low_4")); });
  EXPECT_EQ(std::count(changed.begin(), changed.end(), "upper_1"), 1);
}

// A world with a pending edit has the hash that it has after compiling, different from that of an
// unedited world; a copy has it too.
TEST(LocalEdits, HashesTellWhatBeginsAnew) {
  World world = five_pendula();
  for (int i = 0; i < 30; ++i) world.step();
  World edited = world;
  Motor winding;
  winding.bias = 0.1;
  edited.set_motor(edited.find_joint("low_2"), winding);
  EXPECT_NE(edited.state_hash(), world.state_hash());
  World other = world;
  other.set_motor(other.find_joint("low_4"), winding);
  EXPECT_NE(other.state_hash(), edited.state_hash());
  World same = world;
  same.set_motor(same.find_joint("low_2"), winding);
  EXPECT_EQ(same.state_hash(), edited.state_hash());
  for (int i = 0; i < 20; ++i) {
    same.step();
    edited.step();
    ASSERT_EQ(same.state_hash(), edited.state_hash()) << i;
  }
}

/// Twelve touching boxes on a floor, with every second pair on a hinge, and gears between these
/// hinges.
World row_of_boxes() {
  World world(options(0.01));
  Body floor = make_body("floor", Plane{}, 0.0, Vector3d::Zero());
  floor.type = BodyType::kStatic;
  world.add_body(floor);
  std::vector<BodyId> boxes;
  std::vector<JointId> hinges;
  for (int i = 0; i < 12; ++i)
    boxes.push_back(world.add_body(
        make_body("box_" + std::to_string(i), Box{{0.2, 0.2, 0.2}}, 1.0, {0.2 * i, 0.0, 0.1})));
  for (std::size_t i = 0; i + 1 < boxes.size(); i += 2)
    hinges.push_back(
        world.add_joint(make_joint("hinge_" + std::to_string(i), boxes[i], {0.1, 0.0, 0.0},
                                   boxes[i + 1], {-0.1, 0.0, 0.0}, JointKind::kHinge)));
  for (std::size_t i = 0; i + 1 < hinges.size(); i += 2) {
    Joint gear;
    gear.name = "gear_" + std::to_string(i);
    gear.kind = JointKind::kGear;
    gear.coupling = {hinges[i], hinges[i + 1], -1.0, 0.0};
    world.add_joint(gear);
  }
  return world;
}

// Removing several at a time equals removing them one by one, to the bit, also for sleeping boxes.
TEST(Removal, OfManyIsThatOfEach) {
  for (const int steps : {0, 3, 200}) {
    World one_by_one = row_of_boxes();
    for (int i = 0; i < steps; ++i) one_by_one.step();
    World at_once = one_by_one;
    std::vector<JointId> joints;
    for (const char* name : {"gear_2", "hinge_6", "hinge_4"})
      joints.push_back(at_once.find_joint(name));
    std::vector<BodyId> bodies;
    for (const char* name : {"box_1", "box_0", "box_5", "box_4"})
      bodies.push_back(at_once.find_body(name));
    std::vector<std::string> names;
    for (const JointId id : joints) one_by_one.remove_joint(id);
    for (const BodyId id : bodies)
      for (const std::string& name : one_by_one.remove_body(id)) names.push_back(name);
    EXPECT_EQ(at_once.remove(joints, bodies), names);
    EXPECT_EQ(names, (std::vector<std::string>{"hinge_0", "gear_0"}));
    EXPECT_EQ(at_once.body_ids(), one_by_one.body_ids());
    EXPECT_EQ(at_once.joint_ids(), one_by_one.joint_ids());
    for (int i = 0; i < 20; ++i) {
      ASSERT_EQ(at_once.state_hash(), one_by_one.state_hash()) << steps << " " << i;
      at_once.step();
      one_by_one.step();
    }
  }
}

TEST(Removal, OfWhatCannotBeRemovedRemovesNothing) {
  World world = row_of_boxes();
  world.step();
  const std::uint64_t hash = world.state_hash();
  const JointId hinge = world.find_joint("hinge_0"), gear = world.find_joint("gear_0");
  const BodyId box = world.find_body("box_5");
  EXPECT_THROW(world.remove({hinge, gear}, {}), std::invalid_argument);  // coupled until then
  EXPECT_THROW(world.remove({gear, gear}, {}), std::invalid_argument);
  EXPECT_THROW(world.remove({gear}, {box, box}), std::invalid_argument);
  EXPECT_THROW(world.remove({gear}, {box, kWorldBody}), std::invalid_argument);
  EXPECT_THROW(world.remove({gear}, {BodyId{1000}}), std::invalid_argument);
  EXPECT_THROW(world.remove({JointId{1000}}, {}), std::invalid_argument);
  EXPECT_EQ(world.state_hash(), hash);
  EXPECT_EQ(world.remove({gear, hinge}, {box}), (std::vector<std::string>{"hinge_4", "gear_2"}));
}

}  // namespace
}  // namespace constraint_sim::engine
