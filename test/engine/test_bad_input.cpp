// Bad input is rejected with field and value, and changes nothing.

#include <functional>

#include "constraint_sim/engine/scene.h"
#include "engine/model/validate.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// A moving world with one element of each kind, as the target of bad edits.
struct Victim {
  World world{options(0.01)};
  BodyId ball, point;
  JointId rod, hinge;

  Victim() {
    world.add_body(make_floor(0.5));
    ball = world.add_body(make_body("ball", Sphere{0.2}, 1.0, {0.0, 0.0, 2.0}));
    point = world.add_body(make_body("point", Point{}, 1.0, {1.0, 0.0, 2.0}));
    rod = world.add_joint(make_joint("rod", ball, {0.1, 0.0, 0.0}, point, Vector3d::Zero()));
    hinge = world.add_joint(
        make_joint("hinge", kWorldBody, {0.0, 0.0, 2.0}, ball, Vector3d::Zero(), JointKind::kBall));
    run(world, 5);
  }

  void expect_refused(const std::string& field, const std::string& value,
                      const std::function<void(World&)>& edit) {
    const std::uint64_t hash = world.state_hash();
    const std::size_t bodies = world.body_ids().size();
    const std::size_t joints = world.joint_ids().size();
    try {
      edit(world);
      ADD_FAILURE() << field << " = " << value << " was accepted";
    } catch (const std::invalid_argument& error) {
      const std::string text = error.what();
      EXPECT_EQ(text.rfind(field + ": ", 0), 0u) << text << " (should start with " << field << ")";
      EXPECT_NE(text.find(value), std::string::npos) << text << " (should contain " << value << ")";
    }
    EXPECT_EQ(world.state_hash(), hash) << field << " = " << value;
    EXPECT_EQ(world.body_ids().size(), bodies);
    EXPECT_EQ(world.joint_ids().size(), joints);
    EXPECT_FALSE(world.step().outcome.failed) << field << " = " << value;
  }
};

const std::vector<double> kNotFinite{kNaN, kInfinity, -kInfinity};
const std::vector<double> kNotPositive{kNaN, kInfinity, -kInfinity, 0.0, -0.0, -1.5};
const std::vector<double> kNegative{kNaN, kInfinity, -kInfinity, -1.5, -1e-300};
const std::vector<double> kNoShare{kNaN, kInfinity, -kInfinity, -0.25, 1.25};

/// A number of a T, and its invalid values.
template <class T>
struct Field {
  std::string name;
  std::vector<double> bad;
  std::function<void(T&, double)> set;
};

template <class T>
void add_vector(std::vector<Field<T>>* fields, const std::string& name,
                const std::function<Vector3d&(T&)>& vector) {
  for (int i = 0; i < 3; ++i)
    fields->push_back({name, kNotFinite, [=](T& t, double value) { vector(t)[i] = value; }});
}

std::vector<Field<BodyState>> state_fields() {
  std::vector<Field<BodyState>> fields;
  add_vector<BodyState>(&fields, "position", [](BodyState& s) -> Vector3d& { return s.position; });
  add_vector<BodyState>(&fields, "linear_velocity",
                        [](BodyState& s) -> Vector3d& { return s.linear_velocity; });
  add_vector<BodyState>(&fields, "angular_velocity",
                        [](BodyState& s) -> Vector3d& { return s.angular_velocity; });
  for (int i = 0; i < 4; ++i)
    fields.push_back({"orientation",
                      {kNaN, kInfinity, -kInfinity, -2.5},
                      [i](BodyState& s, double value) { s.orientation.coeffs()[i] = value; }});
  return fields;
}

TEST(BadInput, GroupsOfBodies) {
  for (auto groups : {&Body::collision_groups, &Body::collision_mask}) {
    World world;
    Body body = make_body("a", Sphere{0.1}, 1.0, Vector3d::Zero());
    body.*groups = 0;
    EXPECT_NE(refusal([&] { world.add_body(body); }).find("must be from 1 to 4294967295, got 0"),
              std::string::npos);
    EXPECT_TRUE(world.body_ids().empty());
  }
  for (const char* value : {"-1", "4294967296", "1.5", "all", "[1, 2]"})
    EXPECT_NE(
        refusal([&] {
          load_scene(std::string("bodies: [{name: a, mass: 1, collision_mask: ") + value + "}]");
        }).find("collision_mask"),
        std::string::npos)
        << value;
}

TEST(BadInput, Bodies) {
  std::vector<Field<Body>> fields{
      {"mass", kNotPositive, [](Body& b, double v) { b.mass = v; }},
      {"friction", kNegative, [](Body& b, double v) { b.friction = v; }},
      {"restitution", kNoShare, [](Body& b, double v) { b.restitution = v; }},
      {"gravity_compensation", kNoShare, [](Body& b, double v) { b.gravity_compensation = v; }},
      {"shape.radius", kNotPositive, [](Body& b, double v) { b.shape = Sphere{v}; }},
      {"shape.size.x", kNotPositive,
       [](Body& b, double v) {
         b.shape = Box{{v, 1.0, 1.0}};
       }},
      {"shape.size.y", kNotPositive,
       [](Body& b, double v) {
         b.shape = Box{{1.0, v, 1.0}};
       }},
      {"shape.size.z", kNotPositive,
       [](Body& b, double v) {
         b.shape = Box{{1.0, 1.0, v}};
       }},
  };
  for (int i = 0; i < 3; ++i)  // a zero beside positive numbers is neither given nor left out
    fields.push_back({"inertia", kNotPositive, [i](Body& b, double v) {
                        b.inertia = {1.0, 1.0, 1.0};
                        b.inertia[i] = v;
                      }});
  for (const Field<BodyState>& field : state_fields())
    fields.push_back({field.name, field.bad, [=](Body& b, double v) { field.set(b.state, v); }});

  Victim victim;
  for (const Field<Body>& field : fields) {
    for (const double bad : field.bad) {
      Body body = make_body("new", Sphere{0.1}, 1.0, {5.0, 0.0, 5.0});
      field.set(body, bad);
      victim.expect_refused(field.name, shortest(bad), [&](World& w) { w.add_body(body); });
    }
  }
}

TEST(BadInput, FixedBodiesTakeNoBadMassEither) {
  Victim victim;
  for (const BodyType type : {BodyType::kStatic, BodyType::kKinematic}) {
    for (const double bad : kNegative) {
      Body body = make_body("new", Sphere{0.1}, bad, {5.0, 0.0, 5.0});
      body.type = type;
      victim.expect_refused("mass", shortest(bad), [&](World& w) { w.add_body(body); });
    }
  }
}

TEST(BadInput, BodiesThatCannotBe) {
  Victim victim;
  const auto refused = [&](const std::string& field, const std::string& value, const Body& body) {
    victim.expect_refused(field, value, [&](World& w) { w.add_body(body); });
  };
  Body falling_plane = make_body("new", Plane{}, 1.0, Vector3d::Zero());
  refused("type", "dynamic", falling_plane);
  Body turning_point = make_body("new", Point{}, 1.0, Vector3d::Zero());
  turning_point.state.angular_velocity.z() = 2.5;
  refused("angular_velocity", "2.5", turning_point);
  Body moving_floor = make_floor(0.5);
  moving_floor.name = "new";
  moving_floor.state.linear_velocity.x() = 2.5;
  refused("linear_velocity", "2.5", moving_floor);
  moving_floor.state.linear_velocity.setZero();
  moving_floor.state.angular_velocity.x() = 2.5;
  refused("angular_velocity", "2.5", moving_floor);
}

const std::vector<std::string> kBadNames{"",   "world", "a b", "/a",    "-a",
                                         ".a", "ä",     "a:b", "\"a\"", "~a"};

TEST(BadInput, Names) {
  Victim victim;
  for (const std::string& bad : kBadNames) {
    victim.expect_refused("name", "'" + bad + "'", [&](World& w) {
      w.add_body(make_body(bad, Sphere{0.1}, 1.0, Vector3d::Zero()));
    });
    victim.expect_refused("name", "'" + bad + "'",
                          [&](World& w) { w.add_joint(hang(bad, victim.point)); });
  }
  victim.expect_refused("name", "'ball'", [](World& w) {
    w.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  });
  victim.expect_refused("name", "'rod'", [&](World& w) { w.add_joint(hang("rod", victim.point)); });
  for (const char* good : {"a", "_", "0", "Robot_1/left-arm.3"})
    EXPECT_NO_THROW(victim.world.add_body(make_body(good, Point{}, 1.0, Vector3d::Zero())));
}

TEST(BadInput, States) {
  Victim victim;
  for (const Field<BodyState>& field : state_fields()) {
    for (const double bad : field.bad) {
      BodyState state = victim.world.state(victim.ball);
      field.set(state, bad);
      victim.expect_refused(field.name, shortest(bad),
                            [&](World& w) { w.set_state(victim.ball, state); });
    }
  }
  BodyState zero = victim.world.state(victim.ball);
  zero.orientation.coeffs().setZero();
  victim.expect_refused("orientation", "(0, 0, 0, 0)",
                        [&](World& w) { w.set_state(victim.ball, zero); });
  BodyState turning = victim.world.state(victim.point);
  turning.angular_velocity.y() = 2.5;
  victim.expect_refused("angular_velocity", "2.5",
                        [&](World& w) { w.set_state(victim.point, turning); });
  BodyState moving;
  moving.linear_velocity.y() = 2.5;
  victim.expect_refused("linear_velocity", "2.5",
                        [&](World& w) { w.set_state(w.find_body("floor"), moving); });
}

std::vector<Field<Motor>> motor_fields() {
  return {{"bias", kNotFinite, [](Motor& m, double v) { m.bias = v; }},
          {"amplitude", kNotFinite, [](Motor& m, double v) { m.amplitude = v; }},
          {"frequency", kNegative, [](Motor& m, double v) { m.frequency = v; }},
          {"phase", kNotFinite, [](Motor& m, double v) { m.phase = v; }},
          {"max_force", kNegative, [](Motor& m, double v) { m.max_force = v; }},
          {"timeout", kNegative, [](Motor& m, double v) { m.timeout = v; }}};
}

TEST(BadInput, Motors) {
  Victim victim;
  for (const Field<Motor>& field : motor_fields()) {
    for (const double bad : field.bad) {
      Motor motor;
      field.set(motor, bad);
      victim.expect_refused(field.name, shortest(bad),
                            [&](World& w) { w.set_motor(victim.rod, motor); });
    }
  }
  Motor motor;
  motor.bias = 2.5;
  victim.expect_refused("motor", "2.5", [&](World& w) { w.set_motor(victim.hinge, motor); });
}

// A distance joint has a velocity motor alone; joints without coordinates have no motor.
TEST(BadInput, MotorsByPositionOrForce) {
  const std::vector<std::pair<std::string, std::function<void(Motor&)>>> settings{
      {"position", [](Motor& m) { m.position = 2.5; }},
      {"servo_frequency", [](Motor& m) { m.servo_frequency = 2.5; }},
      {"servo_damping_ratio", [](Motor& m) { m.servo_damping_ratio = 2.5; }},
      {"servo_stiffness", [](Motor& m) { m.servo_stiffness = 2.5; }},
      {"servo_damping", [](Motor& m) { m.servo_damping = 2.5; }},
      {"force", [](Motor& m) { m.force = 2.5; }},
  };
  Victim victim;
  for (const auto& [field, set] : settings) {
    Motor motor;
    set(motor);
    victim.expect_refused(field, "2.5", [&](World& w) { w.set_motor(victim.rod, motor); });
    victim.expect_refused("motor", "2.5", [&](World& w) { w.set_motor(victim.hinge, motor); });
    Joint joint = victim.world.joint(victim.rod);
    joint.motor = motor;
    victim.expect_refused(field, "free: true", [&](World& w) { w.set_joint(victim.rod, joint); });
    joint.name = "new";
    victim.expect_refused(field, "kFreeDistance", [&](World& w) { w.add_joint(joint); });
    const std::string scene =
        "bodies: [{name: a, mass: 1, position: [1, 0, 0]}]\nconstraints: "
        "[{name: rod, body_b: a, motor: {" +
        field + ": 2.5}}]";
    EXPECT_NE(refusal([&] { load_scene(scene); }).find("'" + field + "'"), std::string::npos)
        << field;
  }
}

TEST(BadInput, Joints) {
  const auto distance = [](Joint& j) -> DistanceJoint& { return j.distance; };
  std::vector<Field<Joint>> fields{
      {"length", kNegative, [=](Joint& j, double v) { distance(j).length = v; }},
      {"min_length", kNegative, [=](Joint& j, double v) { distance(j).min_length = v; }},
      {"max_length",
       {kNaN, -kInfinity, 0.0, -1.5},
       [=](Joint& j, double v) { distance(j).max_length = v; }},
      {"frequency", kNegative, [=](Joint& j, double v) { distance(j).frequency = v; }},
      {"damping_ratio", kNegative, [=](Joint& j, double v) { distance(j).damping_ratio = v; }},
      {"stiffness", kNegative, [=](Joint& j, double v) { distance(j).stiffness = v; }},
      {"damping", kNegative, [=](Joint& j, double v) { distance(j).damping = v; }},
      {"baumgarte", kNoShare, [](Joint& j, double v) { j.baumgarte = v; }},
      {"break_force", kNegative, [](Joint& j, double v) { j.break_force = v; }},
  };
  add_vector<Joint>(&fields, "anchor_a", [](Joint& j) -> Vector3d& { return j.anchor_a; });
  add_vector<Joint>(&fields, "anchor_b", [](Joint& j) -> Vector3d& { return j.anchor_b; });
  for (const Field<Motor>& field : motor_fields())
    fields.push_back({field.name, field.bad, [=](Joint& j, double v) { field.set(j.motor, v); }});

  Victim victim;
  for (const Field<Joint>& field : fields) {
    for (const double bad : field.bad) {
      Joint joint = make_joint("new", kWorldBody, Vector3d::Zero(), victim.ball, Vector3d::Zero());
      field.set(joint, bad);
      victim.expect_refused(field.name, shortest(bad), [&](World& w) { w.add_joint(joint); });
    }
  }
}

TEST(BadInput, JointsThatCannotBe) {
  Victim victim;
  const auto refused = [&](const std::string& field, const std::string& value, const Joint& joint) {
    victim.expect_refused(field, value, [&](World& w) { w.add_joint(joint); });
  };
  const auto with_type = [&](const DistanceJoint& type) { return hang("new", victim.ball, type); };
  refused("max_length", "1.25", with_type(between(2.5, 1.25)));
  DistanceJoint both = rope(2.0);
  both.length = 1.25;
  refused("length", "1.25", with_type(both));
  DistanceJoint only_ratio = rod(1.0);
  only_ratio.damping_ratio = 0.25;
  refused("damping_ratio", "0.25", with_type(only_ratio));
  DistanceJoint two_springs = spring(1.0, 2.0, 0.0);
  two_springs.frequency = 1.25;
  refused("frequency", "1.25", with_type(two_springs));
  DistanceJoint too_stiff = rod(1.0);
  too_stiff.frequency = 1e15;  // ω² is 4e31
  refused("stiffness", "e+31", with_type(too_stiff));

  const Vector3d zero = Vector3d::Zero();
  refused("body_b", "'ball'", make_joint("new", victim.ball, zero, victim.ball, zero));
  const BodyId floor = victim.world.find_body("floor");
  refused("body_b", "'floor'", make_joint("new", kWorldBody, zero, floor, zero));
  refused("body", "99", make_joint("new", BodyId{99}, zero, victim.ball, zero));
  refused("body", "99", make_joint("new", victim.ball, zero, BodyId{99}, zero));
  refused("anchor_b", "0.5", make_joint("new", victim.ball, zero, victim.point, {0.5, 0.0, 0.0}));
  refused("anchor_a", "0.5", make_joint("new", victim.point, {0.5, 0.0, 0.0}, victim.ball, zero));
  Joint driven =
      make_joint("new", kWorldBody, victim.world.state(victim.ball).position, victim.ball, zero);
  driven.motor.bias = 0.75;  // without a length, so a ball joint
  refused("motor", "0.75", driven);
}

// Bodies whose distance exceeds the largest coordinate.
TEST(BadInput, LengthThatIsTooLong) {
  Victim victim;
  const BodyId far = victim.world.add_body(make_body("far", Point{}, 1.0, {1e20, 1e20, 0.0}));
  const std::uint64_t hash = victim.world.state_hash();
  EXPECT_THROW(victim.world.add_joint(hang("new", far)), std::invalid_argument);
  EXPECT_EQ(victim.world.state_hash(), hash);
}

TEST(BadInput, Options) {
  std::vector<Field<WorldOptions>> fields{
      {"time_step", kNotPositive, [](WorldOptions& o, double v) { o.time_step = v; }},
      {"baumgarte", kNoShare, [](WorldOptions& o, double v) { o.baumgarte = v; }},
      {"iterations",
       {0.0, -1.0},
       [](WorldOptions& o, double v) { o.iterations = static_cast<int>(v); }},
      {"order", {0.0, 7.0, -8.0}, [](WorldOptions& o, double v) { o.order = static_cast<int>(v); }},
      {"tolerance", {-1e-8, kNaN, kInfinity}, [](WorldOptions& o, double v) { o.tolerance = v; }},
  };
  add_vector<WorldOptions>(&fields, "gravity",
                           [](WorldOptions& o) -> Vector3d& { return o.gravity; });
  Victim victim;
  for (const Field<WorldOptions>& field : fields) {
    for (const double bad : field.bad) {
      WorldOptions options;
      field.set(options, bad);
      const WorldOptions before = victim.world.options();
      victim.expect_refused(field.name, shortest(bad), [&](World& w) { w.set_options(options); });
      EXPECT_EQ(victim.world.options().time_step, before.time_step);
      EXPECT_EQ(victim.world.options().gravity, before.gravity);
      EXPECT_EQ(victim.world.options().iterations, before.iterations);
      EXPECT_EQ(victim.world.options().baumgarte, before.baumgarte);
      EXPECT_THROW(World{options}, std::invalid_argument);
    }
  }
}

TEST(BadInput, Wrenches) {
  std::vector<Field<Wrench>> fields{
      {"start", kNotFinite, [](Wrench& w, double v) { w.start = v; }},
      {"end", {kNaN, -kInfinity, -1.5, 1.0, 0.5}, [](Wrench& w, double v) { w.end = v; }},
  };
  add_vector<Wrench>(&fields, "force", [](Wrench& w) -> Vector3d& { return w.force; });
  add_vector<Wrench>(&fields, "torque", [](Wrench& w) -> Vector3d& { return w.torque; });
  Victim victim;
  const auto refused = [&](const std::string& field, const std::string& value,
                           const Wrench& wrench) {
    victim.expect_refused(field, value, [&](World& w) { w.add_wrench(wrench); });
    EXPECT_TRUE(victim.world.wrenches().empty()) << field << " = " << value;
  };
  const Wrench good{victim.ball, {1.0, 2.0, 3.0}, {4.0, 5.0, 6.0}, 1.0, 2.0};
  for (const Field<Wrench>& field : fields) {
    for (const double bad : field.bad) {
      Wrench wrench = good;
      field.set(wrench, bad);
      refused(field.name, shortest(bad), wrench);
    }
  }

  Body carriage = make_body("carriage", Box{{1.0, 1.0, 1.0}}, 0.0, {0.0, 0.0, 9.0});
  carriage.type = BodyType::kKinematic;
  victim.world.add_body(carriage);
  for (const char* name : {"world", "floor", "carriage"}) {
    Wrench wrench = good;
    wrench.body = victim.world.find_body(name);
    refused("body", "'" + std::string(name) + "' is not dynamic", wrench);
  }
  Wrench unknown = good;
  unknown.body = BodyId{99};
  refused("body", "99", unknown);
  Wrench turning = good;
  turning.body = victim.point;
  refused("torque", "(4, 5, 6)", turning);
  turning.torque.setZero();
  EXPECT_NO_THROW(victim.world.add_wrench(turning));
}

TEST(BadInput, Times) {
  Victim victim;
  for (const double bad : kNotFinite)
    victim.expect_refused("time", shortest(bad), [&](World& w) { w.set_time(bad, 1); });
}

TEST(BadInput, UnknownNamesAndIds) {
  Victim victim;
  victim.expect_refused("body", "'nobody'", [](World& w) { w.find_body("nobody"); });
  victim.expect_refused("constraint", "'none'", [](World& w) { w.find_joint("none"); });
  victim.expect_refused("body", "99", [](World& w) { w.state(BodyId{99}); });
  victim.expect_refused("body", "99", [](World& w) { w.remove_body(BodyId{99}); });
  victim.expect_refused("constraint", "99", [](World& w) { w.remove_joint(JointId{99}); });
  victim.expect_refused("constraint", "99", [](World& w) { w.set_motor(JointId{99}, {}); });
  victim.expect_refused("constraint", "99", [](World& w) { w.set_broken(JointId{99}, true); });
  victim.expect_refused("body", "99", [](World& w) { w.clear_wrenches(BodyId{99}); });
  victim.expect_refused("name", "'world'", [](World& w) { w.remove_body(kWorldBody); });
  victim.expect_refused("name", "'world'", [](World& w) { w.set_state(kWorldBody, {}); });
}

}  // namespace
}  // namespace constraint_sim::engine
