#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "custom_types.h"
#include "engine/math/numbers.h"
#include "ros/actuator_efforts.h"
#include "ros/body_messages.h"
#include "ros/constraint_messages.h"
#include "ros/constraint_state.h"
#include "ros/conversions.h"
#include "ros/edits.h"
#include "ros/received.h"

namespace constraint_sim {
namespace {

// Returns the error of a call; empty without one.
template <class Call>
std::string error_of(Call call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

class Random {
 public:
  double number() { return 2.0 * std::ldexp(static_cast<double>(engine_()), -32) - 1.0; }
  Eigen::Vector3d vector() { return {number(), number(), number()}; }
  engine::BodyState state() {
    engine::BodyState state;
    state.position = vector();
    state.orientation = Eigen::Quaterniond(number(), number(), number(), number()).normalized();
    state.linear_velocity = vector();
    state.angular_velocity = vector();
    return state;
  }

 private:
  std::mt19937 engine_{1};
};

TEST(Conversions, StatesGoRoundWithoutLosingABit) {
  Random random;
  for (int i = 0; i < 100; ++i) {
    const engine::BodyState state = random.state();
    const BodyState msg = to_msg("name", state);
    const engine::BodyState back = from_msg(msg.pose, msg.twist);
    EXPECT_EQ(msg.name, "name");
    EXPECT_EQ(back.position, state.position);
    EXPECT_EQ(back.orientation.coeffs(), state.orientation.coeffs());
    EXPECT_EQ(back.linear_velocity, state.linear_velocity);
    EXPECT_EQ(back.angular_velocity, state.angular_velocity);
  }
}

TEST(Conversions, ATransformIsThePose) {
  const engine::BodyState state = Random().state();
  const geometry_msgs::Transform transform = to_transform(state);
  const geometry_msgs::Pose pose = to_pose(state);
  EXPECT_EQ(transform.translation.x, pose.position.x);
  EXPECT_EQ(transform.translation.y, pose.position.y);
  EXPECT_EQ(transform.translation.z, pose.position.z);
  EXPECT_EQ(transform.rotation, pose.orientation);
}

TEST(Conversions, AQuaternionLeftOutIsTheIdentity) {
  EXPECT_EQ(from_msg(geometry_msgs::Quaternion()).coeffs(),
            Eigen::Quaterniond::Identity().coeffs());
}

TEST(Conversions, EachBodyFieldArrivesWhereItBelongs) {
  Body msg;
  msg.name = "crate";
  msg.type = Body::KINEMATIC;
  msg.shapes.resize(1);
  msg.shapes[0].type = Shape::BOX;
  msg.shapes[0].dimensions = {1.0, 2.0, 3.0};
  msg.mass = 4.0;
  msg.inertia.x = 5.0;
  msg.inertia.y = 6.0;
  msg.inertia.z = 7.0;
  msg.pose.position.y = 8.0;
  msg.twist.angular.z = 9.0;
  msg.friction = 0.1;
  msg.restitution = 0.2;
  msg.gravity_compensation = 0.7;
  msg.no_collision = true;
  msg.collision_groups = 6;
  msg.collision_mask = 9;
  const engine::Body body = from_msg(msg);
  EXPECT_EQ(body.name, "crate");
  EXPECT_EQ(body.type, engine::BodyType::kKinematic);
  EXPECT_EQ(std::get<engine::Box>(body.shape).size, Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(body.mass, 4.0);
  EXPECT_EQ(body.inertia, Eigen::Vector3d(5.0, 6.0, 7.0));
  EXPECT_EQ(body.state.position, Eigen::Vector3d(0.0, 8.0, 0.0));
  EXPECT_EQ(body.state.angular_velocity, Eigen::Vector3d(0.0, 0.0, 9.0));
  EXPECT_EQ(body.friction, 0.1);
  EXPECT_EQ(body.restitution, 0.2);
  EXPECT_EQ(body.gravity_compensation, 0.7);
  EXPECT_TRUE(body.no_collision);
  EXPECT_EQ(body.collision_groups, 6u);
  EXPECT_EQ(body.collision_mask, 9u);
}

TEST(Conversions, SeveralShapesAreACompound) {
  Body msg;
  msg.shapes.resize(2);
  msg.shapes[0].type = Shape::BOX;
  msg.shapes[0].dimensions = {1.0, 2.0, 3.0};
  msg.shapes[1].type = Shape::SPHERE;
  msg.shapes[1].dimensions = {0.5};
  msg.shapes[1].pose.position.z = 2.0;
  const engine::Body body = from_msg(msg);
  EXPECT_FALSE(body.shape_pose);
  const auto& parts = *std::get<engine::Compound>(body.shape).parts;
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(std::get<engine::Box>(parts[0].shape).size, Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(parts[0].pose.position, Eigen::Vector3d(0.0, 0.0, 0.0));
  EXPECT_EQ(std::get<engine::Sphere>(parts[1].shape).radius, 0.5);
  EXPECT_EQ(parts[1].pose.position, Eigen::Vector3d(0.0, 0.0, 2.0));
  msg.shapes[1].dimensions.clear();
  EXPECT_EQ(error_of([&] { from_msg(msg); }),
            "shapes[1].dimensions: a sphere has one: its radius, got 0 numbers");
  msg.shapes[1].type = Shape::POINT;
  msg.shapes[1].pose.position.z = 0.0;
  EXPECT_EQ(error_of([&] { from_msg(msg); }),
            "shapes[1].shape: a part must be a sphere, a box, a cylinder, a capsule or a hull");
}

TEST(Conversions, ABodyWithoutAShapeIsAPointOfTheFirstGroup) {
  Body msg;
  EXPECT_TRUE(std::holds_alternative<engine::Point>(from_msg(msg).shape));
  EXPECT_EQ(from_msg(msg).collision_groups, 1u);
  EXPECT_EQ(from_msg(msg).collision_mask, engine::kAllGroups);
  msg.shapes.resize(1);
  msg.shapes[0].type = Shape::SPHERE;
  EXPECT_EQ(error_of([&] { from_msg(msg); }),
            "shapes[0].dimensions: a sphere has one: its radius, got 0 numbers");
}

TEST(Conversions, AColourIsOpaqueUnlessItSaysSo) {
  Body msg;
  EXPECT_FALSE(from_msg(msg).color);
  msg.color.g = 0.5F;
  EXPECT_EQ(from_msg(msg).color, (std::array<double, 4>{0.0, 0.5, 0.0, 1.0}));
  msg.color.a = 0.25F;
  EXPECT_EQ(from_msg(msg).color, (std::array<double, 4>{0.0, 0.5, 0.0, 0.25}));
}

TEST(Conversions, EachShapeNeedsItsOwnDimensions) {
  Shape shape;
  for (const auto& [type, count] : {std::pair<int, std::size_t>{Shape::POINT, 0},
                                    {Shape::SPHERE, 1},
                                    {Shape::BOX, 3},
                                    {Shape::CAPSULE, 2},
                                    {Shape::PLANE, 0},
                                    {Shape::CYLINDER, 2}}) {
    shape.type = static_cast<std::uint8_t>(type);
    for (std::size_t n = 0; n < 5; ++n) {
      shape.dimensions.assign(n, 1.0);
      const std::string error = error_of([&] { from_msg(shape); });
      EXPECT_EQ(error.empty(), n == count) << type << " " << n;
      if (n != count) {
        EXPECT_EQ(error.rfind("dimensions: ", 0), 0u) << error;
      }
    }
  }
}

TEST(Conversions, UnknownTypesAreNamed) {
  Body body;
  body.type = 3;
  EXPECT_EQ(error_of([&] { from_msg(body); }).rfind("type: ", 0), 0u);
  Shape shape;
  for (const auto& [type, name] :
       {std::pair<int, const char*>{Shape::MESH, "meshes"}, {8, "got 8"}}) {
    shape.type = static_cast<std::uint8_t>(type);
    const std::string error = error_of([&] { from_msg(shape); });
    EXPECT_EQ(error.rfind("type: ", 0), 0u) << error;
    EXPECT_NE(error.find(name), std::string::npos) << error;
  }
}

TEST(Conversions, HullsHaveVertices) {
  Shape shape;
  shape.type = Shape::HULL;
  EXPECT_EQ(error_of([&] { from_msg(shape); }), "vertices: must be at least 4, got 0");
  shape.vertices.resize(4);
  shape.vertices[1].x = shape.vertices[2].y = shape.vertices[3].z = 1.0;
  EXPECT_EQ(std::get<engine::Hull>(from_msg(shape)).surface->vertices().size(), 4u);
  shape.mesh_resource = "x.stl";
  EXPECT_EQ(error_of([&] { from_msg(shape); }).rfind("mesh_resource: ", 0), 0u);
}

TEST(Conversions, OnlyHullsAndMeshesHaveASurface) {
  const auto error_with = [](void (*set)(Shape&)) {
    Shape shape;
    shape.type = Shape::SPHERE;
    shape.dimensions = {0.1};
    set(shape);
    return error_of([&] { from_msg(shape); });
  };
  EXPECT_EQ(error_with([](Shape&) {}), "");
  EXPECT_EQ(error_with([](Shape& shape) { shape.vertices.resize(4); }),
            "vertices: only a hull or a mesh has this field, got 4 points");
  EXPECT_EQ(error_with([](Shape& shape) {
              shape.triangles = {0, 1, 2};
            }),
            "triangles: only a hull or a mesh has this field, got 3 numbers");
  EXPECT_EQ(error_with([](Shape& shape) { shape.mesh_resource = "x.stl"; }),
            "mesh_resource: only a hull or a mesh has this field, got 'x.stl'");
  EXPECT_EQ(error_with([](Shape& shape) {
              shape.mesh_scale.y = 2.0;
            }).rfind("mesh_scale: only a hull or a mesh has this field, got 0.0", 0),
            0u);
}

TEST(Conversions, AShapeHasItsPoseInTheBody) {
  Body msg;
  msg.shapes.resize(1);
  msg.shapes[0].type = Shape::CYLINDER;
  msg.shapes[0].dimensions = {0.1, 0.5};
  EXPECT_FALSE(from_msg(msg).shape_pose);
  msg.shapes[0].pose.orientation.w = 1.0;
  EXPECT_FALSE(from_msg(msg).shape_pose);  // the identity is no pose, so the inertia may follow
  msg.shapes[0].pose.position.z = 0.2;
  msg.shapes[0].pose.orientation.x = 0.6;
  msg.shapes[0].pose.orientation.w = 0.8;
  const engine::Body body = from_msg(msg);
  ASSERT_TRUE(body.shape_pose);
  EXPECT_EQ(body.shape_pose->position, Eigen::Vector3d(0.0, 0.0, 0.2));
  EXPECT_EQ(body.shape_pose->orientation.coeffs(), Eigen::Vector4d(0.6, 0.0, 0.0, 0.8));
  msg.shapes[0].dimensions.clear();
  for (const int type : std::vector<int>{Shape::POINT, Shape::PLANE}) {
    msg.shapes[0].type = static_cast<std::uint8_t>(type);
    EXPECT_EQ(error_of([&] { from_msg(msg); }).rfind("shapes[0].pose: ", 0), 0u);
  }
}

engine::World world_of_two() {
  engine::World world;
  engine::Body body;
  body.mass = 1.0;
  body.name = "a";
  world.add_body(body);
  body.name = "b";
  world.add_body(body);
  return world;
}

TEST(Conversions, AConstraintFindsItsBodies) {
  const engine::World world = world_of_two();
  AddDistanceConstraintRequest request;
  request.name = "rod";
  request.body_b = "b";
  request.anchor_a.x = 1.0;
  request.anchor_b.z = 2.0;
  for (const char* name : {"", "world"}) {
    request.body_a = name;
    const engine::Joint joint = from_msg(request, world);
    EXPECT_EQ(joint.body_a, engine::kWorldBody);
    EXPECT_EQ(joint.body_b, world.find_body("b"));
    EXPECT_EQ(joint.anchor_a, Eigen::Vector3d(1.0, 0.0, 0.0));
    EXPECT_EQ(joint.anchor_b, Eigen::Vector3d(0.0, 0.0, 2.0));
  }
  request.body_a = "nobody";
  EXPECT_EQ(error_of([&] { from_msg(request, world); }), "body_a: there is no body named 'nobody'");
}

TEST(Conversions, ALengthOfZeroOrLessIsThePresentDistance) {
  const engine::World world = world_of_two();
  AddDistanceConstraintRequest request;
  request.body_a = "a";
  request.body_b = "b";
  const auto length = [&](double value) {
    request.length = value;
    return from_msg(request, world).distance.length;
  };
  EXPECT_EQ(length(2.0), 2.0);
  EXPECT_FALSE(length(0.0));
  EXPECT_FALSE(length(-1.0));
  using engine::kInfinity;
  for (const double value : {kInfinity, -kInfinity, std::nan("")})
    EXPECT_EQ(error_of([&] { length(value); }).rfind("length: ", 0), 0u);
}

TEST(Conversions, AFrameAndBackIsTheSameState) {
  Random random;
  for (int i = 0; i < 100; ++i) {
    const engine::BodyState frame = random.state();
    const engine::BodyState state = random.state();
    const engine::BodyState back = from_relative(frame, relative_to(frame, state));
    // a few rotations of numbers of order 1
    constexpr double kTolerance = 1e-14;
    EXPECT_LT((back.position - state.position).norm(), kTolerance);
    EXPECT_LT((back.orientation.coeffs() - state.orientation.coeffs()).norm(), kTolerance);
    EXPECT_LT((back.linear_velocity - state.linear_velocity).norm(), kTolerance);
    EXPECT_LT((back.angular_velocity - state.angular_velocity).norm(), kTolerance);
  }
}

TEST(Conversions, RelativeVelocitiesAreTheRatesOfRelativePlaces) {
  Random random;
  const auto moved = [](const engine::BodyState& state, double t) {
    engine::BodyState later = state;
    later.position += t * state.linear_velocity;
    const Eigen::Vector3d turn = t * state.angular_velocity;
    later.orientation =
        Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized())) * state.orientation;
    return later;
  };
  for (int i = 0; i < 20; ++i) {
    const engine::BodyState frame = random.state();
    const engine::BodyState state = random.state();
    constexpr double kStep = 1e-5;
    const engine::BodyState after = relative_to(moved(frame, kStep), moved(state, kStep));
    const engine::BodyState before = relative_to(moved(frame, -kStep), moved(state, -kStep));
    const Eigen::Vector3d rate = (after.position - before.position) / (2.0 * kStep);
    // central differences: h² times third derivatives of order 10, and rounding over h
    EXPECT_LT((rate - relative_to(frame, state).linear_velocity).norm(), 1e-8);
  }
}

TEST(Conversions, ARopeAndAStrutTakeThePresentDistance) {
  engine::World world = world_of_two();
  engine::BodyState state;
  state.position = {3.0, 4.0, 0.0};
  world.set_state(world.find_body("b"), state);
  Constraint msg;
  msg.name = "c";
  msg.body_b = "b";
  msg.type = "rope";
  EXPECT_EQ(from_msg(msg, world).distance.max_length, 5.0);
  msg.type = "strut";
  EXPECT_EQ(from_msg(msg, world).distance.min_length, 5.0);
}

/// A hinge between two boxes, b rotated by 90 degrees about x.
struct Door {
  engine::World world;
  Constraint msg;

  Door() {
    engine::Body body;
    body.mass = 1.0;
    body.shape = engine::Box{{1.0, 1.0, 1.0}};
    body.name = "a";
    world.add_body(body);
    body.name = "b";
    body.state.orientation = Eigen::Quaterniond(std::sqrt(0.5), std::sqrt(0.5), 0.0, 0.0);
    world.add_body(body);
    msg.name = "hinge";
    msg.type = "hinge";
    msg.body_a = "a";
    msg.body_b = "b";
  }

  /// Returns the joint as the world has it after adding.
  engine::Joint added() {
    engine::World copy = world;
    return copy.joint(copy.add_joint(from_msg(msg, copy)));
  }
};

// Rounding of two rotations of unit vectors.
constexpr double kRounding = 1e-15;

TEST(Conversions, TheAxesOfAHingeArriveOnTheirBodies) {
  Door door;
  door.msg.axis_a.y = 2.0;   // any length
  door.msg.axis_b.z = -0.5;  // b's -z is along a's y
  const engine::Joint joint = from_msg(door.msg, door.world);
  EXPECT_EQ(joint.kind, engine::JointKind::kHinge);
  EXPECT_EQ(joint.body_a, door.world.find_body("a"));
  EXPECT_EQ(joint.body_b, door.world.find_body("b"));
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  EXPECT_LT((joint.frame_a * z - Eigen::Vector3d::UnitY()).norm(), kRounding);
  ASSERT_TRUE(joint.axis_b);
  EXPECT_EQ(*joint.axis_b, Eigen::Vector3d(0.0, 0.0, -0.5));
  EXPECT_LT((*door.added().frame_b * z + z).norm(), kRounding);
}

TEST(Conversions, AxesLeftOutAreZOfAAndAsBLies) {
  Door door;
  const engine::Joint joint = from_msg(door.msg, door.world);
  EXPECT_EQ(joint.frame_a.coeffs(), Eigen::Quaterniond::Identity().coeffs());
  EXPECT_FALSE(joint.axis_b || joint.frame_b);
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  // a's z is b's y
  EXPECT_LT((*door.added().frame_b * z - Eigen::Vector3d::UnitY()).norm(), kRounding);
}

TEST(Conversions, AxesThatCannotBeAreNamed) {
  Door door;
  const auto error = [&](double x, const char* type) {
    door.msg.type = type;
    door.msg.axis_a.x = x;
    return error_of([&] { from_msg(door.msg, door.world); });
  };
  EXPECT_EQ(error(1.0, "hinge"), "");
  EXPECT_EQ(error(std::nan(""), "hinge").rfind("axis_a: must be finite numbers", 0), 0u);
  EXPECT_EQ(error(1.0, "ball").rfind("axis_a: constraints of type 'ball' have none", 0), 0u);
  EXPECT_EQ(error(1.0, "rope").rfind("axis_a: constraints of type 'rope' have none", 0), 0u);
}

TEST(ConstraintMessages, ARopeWithStiffnessIsASpringThatOnlyPulls) {
  const engine::World world = world_of_two();
  Constraint msg;
  msg.name = "c";
  msg.body_b = "b";
  msg.type = "rope";
  msg.max_length = 2.0;
  msg.coordinates.resize(1);
  msg.coordinates[0].stiffness = 9.0;
  msg.coordinates[0].damping = 0.5;
  const engine::DistanceJoint rope = from_msg(msg, world).distance;
  EXPECT_TRUE(rope.one_sided);
  EXPECT_EQ(rope.length, 2.0);
  EXPECT_FALSE(rope.is_limited());
  EXPECT_EQ(rope.stiffness, 9.0);
  EXPECT_EQ(rope.damping, 0.5);
  msg.type = "strut";
  msg.max_length = 0.0;
  msg.min_length = 2.0;
  EXPECT_EQ(
      error_of([&] { from_msg(msg, world); }).rfind("coordinates[0].stiffness: constraints", 0),
      0u);
}

TEST(ConstraintMessages, APulleyMayBeOneSided) {
  engine::World world = world_of_two();
  for (const char* body : {"a", "b"}) {
    engine::Joint length;
    length.name = std::string("to_") + body;
    length.kind = engine::JointKind::kFreeDistance;
    length.body_b = world.find_body(body);
    length.anchor_a = {0.0, 0.0, 1.0};
    world.add_joint(length);
  }
  Constraint msg;
  msg.name = "c";
  msg.type = "pulley";
  msg.body_a = "to_a";
  msg.body_b = "to_b";
  msg.coupling.one_sided = true;
  EXPECT_TRUE(from_msg(msg, world).coupling.one_sided);
  msg.type = "gear";
  EXPECT_EQ(error_of([&] { from_msg(msg, world); }),
            "coupling.one_sided: constraints of type 'gear' have none, got 1.000000");
}

TEST(ConstraintMessages, EachFieldOfALawArrives) {
  Door door;
  door.msg.type = "universal";
  door.msg.axis_b.x = 1.0;
  door.msg.break_force = 6.0;
  door.msg.break_torque = 7.0;
  door.msg.coordinates.resize(2);
  CoordinateLaw& msg = door.msg.coordinates[1];
  msg.has_limits = msg.has_position = true;
  msg.lower = 10.0;
  msg.upper = 11.0;
  msg.limit_restitution = 0.12;
  msg.friction = 13.0;
  msg.damping = 14.0;
  msg.stiffness = 15.0;
  msg.rest = 16.0;
  msg.position = 17.0;
  msg.motor.mode = Motor::RATE;
  msg.motor.bias = 0.1;
  msg.motor.amplitude = 0.2;
  msg.motor.frequency = 3.0;
  msg.motor.phase = 0.4;
  msg.motor.max_force = 5.0;
  msg.motor.timeout = 19.0;
  door.msg.coordinates[0].zero = 18.0;
  door.msg.coordinates[0].frequency = 20.0;
  door.msg.coordinates[0].damping_ratio = 21.0;
  const engine::Joint joint = from_msg(door.msg, door.world);
  const engine::CoordinateLaw& law = joint.coordinates[1];
  EXPECT_EQ(law.lower, 10.0);
  EXPECT_EQ(law.upper, 11.0);
  EXPECT_EQ(law.limit_restitution, 0.12);
  EXPECT_EQ(law.friction, 13.0);
  EXPECT_EQ(law.damping, 14.0);
  EXPECT_EQ(law.stiffness, 15.0);
  EXPECT_EQ(law.rest, 16.0);
  EXPECT_EQ(law.position, 17.0);
  EXPECT_EQ(joint.coordinates[0].zero, 18.0);
  EXPECT_EQ(joint.coordinates[0].frequency, 20.0);
  EXPECT_EQ(joint.coordinates[0].damping_ratio, 21.0);
  EXPECT_FALSE(joint.coordinates[0].motor || joint.coordinates[0].position);
  EXPECT_FALSE(joint.coordinates[0].is_limited());
  EXPECT_EQ(joint.break_force, 6.0);
  EXPECT_EQ(joint.break_torque, 7.0);
  ASSERT_TRUE(law.motor);
  EXPECT_EQ(law.motor->bias, 0.1);
  EXPECT_EQ(law.motor->amplitude, 0.2);
  EXPECT_EQ(law.motor->frequency, 3.0);
  EXPECT_EQ(law.motor->phase, 0.4);
  EXPECT_EQ(law.motor->max_force, 5.0);
  EXPECT_EQ(law.motor->timeout, 19.0);
  EXPECT_FALSE(law.motor->position || law.motor->force);
  EXPECT_TRUE(joint.coordinates[2].is_none());
}

TEST(ConstraintMessages, MotorsHaveModes) {
  const auto motor_of = [](void (*set)(Motor&)) {
    Door door;
    set(door.msg.coordinates.emplace_back().motor);
    return from_msg(door.msg, door.world).coordinates[0].motor;
  };
  EXPECT_FALSE(motor_of([](Motor&) {}));
  const auto holds = motor_of([](Motor& msg) { msg.mode = Motor::RATE; });
  ASSERT_TRUE(holds);
  EXPECT_TRUE(holds->is_rigid() && !holds->is_moving() && !holds->position);
  const auto pushes = motor_of([](Motor& msg) {
    msg.mode = Motor::FORCE;
    msg.force = 2.0;
  });
  EXPECT_EQ(pushes->force, 2.0);
  EXPECT_FALSE(pushes->position);
  const auto goes = motor_of([](Motor& msg) { msg.mode = Motor::POSITION; });
  EXPECT_EQ(goes->position, 0.0);
  EXPECT_FALSE(goes->force);
  EXPECT_TRUE(goes->is_rigid());
  const auto by_frequency = motor_of([](Motor& msg) {
    msg.mode = Motor::POSITION;
    msg.position = 1.0;
    msg.servo_frequency = 3.0;
  });
  EXPECT_EQ(by_frequency->position, 1.0);
  EXPECT_EQ(by_frequency->servo_frequency, 3.0);
  EXPECT_EQ(by_frequency->servo_damping_ratio, 1.0);  // left out: critical
  const auto by_stiffness = motor_of([](Motor& msg) {
    msg.mode = Motor::POSITION;
    msg.servo_damping_ratio = 4.0;
    msg.servo_stiffness = 5.0;
    msg.servo_damping = 6.0;
  });
  EXPECT_EQ(by_stiffness->servo_damping_ratio, 4.0);
  EXPECT_EQ(by_stiffness->servo_stiffness, 5.0);
  EXPECT_EQ(by_stiffness->servo_damping, 6.0);
}

TEST(ConstraintMessages, TheLengthOfADistanceHasASpringAndAMotor) {
  Door door;
  door.msg.type = "distance";
  CoordinateLaw& law = door.msg.coordinates.emplace_back();
  law.stiffness = 1.0;
  law.damping = 2.0;
  law.motor.mode = Motor::RATE;
  law.motor.bias = 3.0;
  law.motor.timeout = 4.0;
  const engine::Joint joint = from_msg(door.msg, door.world);
  EXPECT_EQ(joint.distance.stiffness, 1.0);
  EXPECT_EQ(joint.distance.damping, 2.0);
  EXPECT_EQ(joint.motor.bias, 3.0);
  EXPECT_EQ(joint.motor.timeout, 4.0);
  EXPECT_TRUE(joint.coordinates[0].is_none());
  door.msg.free = true;
  const engine::Joint free = from_msg(door.msg, door.world);
  EXPECT_EQ(free.kind, engine::JointKind::kFreeDistance);
  EXPECT_EQ(free.coordinates[0].stiffness, 1.0);
  ASSERT_TRUE(free.coordinates[0].motor);
  EXPECT_EQ(free.coordinates[0].motor->bias, 3.0);
}

TEST(ConstraintMessages, FieldsThatDoNotActAreNamed) {
  const auto error = [](const char* type, void (*set)(Constraint&)) {
    Door door;
    door.msg.type = type;
    set(door.msg);
    return error_of([&] { from_msg(door.msg, door.world); });
  };
  EXPECT_EQ(error("hinge", [](Constraint& msg) { msg.coordinates.resize(1); }), "");
  EXPECT_EQ(error("weld", [](Constraint& msg) { msg.break_torque = 1.0; }), "");
  EXPECT_EQ(error("ball", [](Constraint& msg) { msg.coordinates.resize(1); }),
            "coordinates: constraints of type 'ball' have 0 coordinates, got 1");
  EXPECT_EQ(error("planar", [](Constraint& msg) { msg.coordinates.resize(4); }),
            "coordinates: constraints of type 'planar' have 3 coordinates, got 4");
  EXPECT_EQ(error("distance", [](Constraint& msg) { msg.coordinates.resize(2); }),
            "coordinates: constraints of type 'distance' have 1 coordinate, got 2");
  EXPECT_EQ(
      error("hinge", [](Constraint& msg) { msg.coordinates.emplace_back().motor.phase = 1.0; }),
      "coordinates[0].motor.phase: only a motor of mode RATE=1 has this, got 1.000000");
  EXPECT_EQ(error("hinge", [](Constraint& msg) { msg.coordinates.emplace_back().upper = 1.0; }),
            "coordinates[0].upper: needs has_limits, got 1.000000");
  EXPECT_EQ(error("strut", [](Constraint& msg) { msg.coordinates.emplace_back().damping = 1.0; }),
            "coordinates[0].damping: constraints of type 'strut' have none, got 1.000000");
  EXPECT_EQ(error("hinge", [](Constraint& msg) { msg.coupling.pitch = 1.0; }),
            "coupling.pitch: constraints of type 'hinge' have none, got 1.000000");
  EXPECT_EQ(error("screw", [](Constraint& msg) { msg.coupling.value = 1.0; }),
            "coupling.value: needs has_value, got 1.000000");
  EXPECT_EQ(error("hinge", [](Constraint& msg) { msg.free = true; }),
            "free: constraints of type 'hinge' have none, got true");
  EXPECT_EQ(error("distance", [](Constraint& msg) { msg.break_torque = 1.0; }),
            "break_torque: constraints of type 'distance' have none, got 1.000000");
  EXPECT_EQ(error("hinge", [](Constraint& msg) { msg.parameters.emplace_back().name = "drag"; }),
            "parameters: constraints of type 'hinge' have none, got 'drag'");
  EXPECT_EQ(error("custom:a/b",
                  [](Constraint& msg) {
                    msg.parameters.resize(2);
                    for (Parameter& parameter : msg.parameters) parameter.name = "drag";
                  }),
            "parameters: 'drag' is there twice");
}

TEST(Conversions, CoordinatesAreJointStates) {
  engine::Joint joint;
  engine::JointState state;
  for (std::size_t i = 0; i < 3; ++i) {
    const double first = 10.0 * static_cast<double>(i);
    state.coordinates[i].position = first + 1.0;
    state.coordinates[i].velocity = first + 2.0;
  }
  sensor_msgs::JointState msg;
  for (const auto& [name, kind] : {std::pair("rod", engine::JointKind::kDistance),
                                   {"door", engine::JointKind::kHinge},
                                   {"ice", engine::JointKind::kPlanar}}) {
    joint.name = name;
    joint.kind = kind;
    add_coordinates(joint, state, {3.0, 13.0, 23.0}, &msg);
  }
  EXPECT_EQ(msg.name, (std::vector<std::string>{"door", "ice", "ice/1", "ice/2"}));
  EXPECT_EQ(msg.position, (std::vector<double>{1.0, 1.0, 11.0, 21.0}));
  EXPECT_EQ(msg.velocity, (std::vector<double>{2.0, 2.0, 12.0, 22.0}));
  EXPECT_EQ(msg.effort, (std::vector<double>{3.0, 3.0, 13.0, 23.0}));
}

/// Returns the effort of the motor of joint `j` of a bar that gravity turns by +9.81 N m about the
/// joint, after some seconds.
double effort_with(const std::string& laws, double seconds = 0.1, const std::string& more = "",
                   const std::string& joint = "j") {
  engine::World world = engine::load_scene(R"(
bodies:
- {name: bar, mass: 2, shape: {box: {size: [0.4, 0.1, 0.1]}}, position: [0.5, 0, 0]}
- {name: wheel, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 5, 0]}
constraints:
- {name: j, type: hinge, body_b: bar, anchor_b: [-0.5, 0, 0], axis_a: [0, 1, 0], )" +
                                           laws + "}\n" + more);
  const auto steps = static_cast<int>(std::lround(seconds / world.options().time_step));
  for (int i = 0; i < steps; ++i) world.step();
  return ActuatorEfforts(world).of(world.find_joint(joint))[0];
}

// Statics of a bar whose weight turns it by 0.5 m times 2 kg times 9.81 m/s² = 9.81 N m.
TEST(ActuatorEfforts, AreThoseOfTheMotorAlone) {
  constexpr double kRounding = 1e-8;  // rows of motors hold the bar to rounding
  EXPECT_NEAR(effort_with("motor: {position: 0}"), -9.81, kRounding);
  // A spring of 3 N m at its largest helps gravity; the damper does nothing at rest.
  EXPECT_NEAR(effort_with("motor: {bias: 0}, stiffness: 3, rest: 1, damping: 2"), -12.81,
              kRounding);
  EXPECT_EQ(effort_with("upper: 0"), 0.0);  // a limit carries the bar
  EXPECT_EQ(effort_with("damping: 2"), 0.0);
  EXPECT_EQ(effort_with("motor: {force: 1.5}, upper: 0, damping: 1"), 1.5);
  EXPECT_EQ(effort_with("motor: {force: 1.5}, enabled: false"), 0.0);
  // The motor is too weak, and the bar rests on the limit.
  EXPECT_EQ(effort_with("motor: {bias: -0.5, max_force: 1}, upper: 0"), -1.0);
  // A servo that stands has the bar's torque at its angle q: 9.81 cos(q) = 200 q, q = 0.048993.
  EXPECT_NEAR(effort_with("motor: {position: 0, servo_stiffness: 200, servo_damping: 40}", 10.0),
              -9.81 * std::cos(0.048993), 1e-4);  // digits of q times the stiffness
}

// At a constant rate without gravity the motor works against damper and friction alone.
TEST(ActuatorEfforts, OfAMovingMotorCarryDamperAndFriction) {
  engine::World world = engine::load_scene(R"(
world: {gravity: [0, 0, 0]}
bodies:
- {name: wheel, mass: 1, shape: {sphere: {radius: 0.1}}}
constraints:
- {name: j, type: hinge, body_b: wheel, damping: 2, friction: 0.5, motor: {bias: 0.25}}
)");
  for (int i = 0; i < 10; ++i) world.step();
  EXPECT_NEAR(ActuatorEfforts(world).of(world.find_joint("j"))[0], 1.0, 1e-10);  // rounding
}

// A gear of ratio r carries the bar's torque to a wheel, whose motor holds it with r times that.
TEST(ActuatorEfforts, OfGearedJointsAreTheMotors) {
  const std::string gear =
      "- {name: w, type: hinge, body_b: wheel, anchor_a: [0, 5, 0], axis_a: [0, 1, 0], motor: "
      "{position: 0}}\n- {name: g, type: gear, joints: [j, w], ratio: 2}\n";
  EXPECT_EQ(effort_with("damping: 0", 0.1, gear), 0.0);
  EXPECT_NEAR(effort_with("damping: 0", 0.1, gear, "w"), 2.0 * 9.81, 1e-8);  // rounding
}

// ---- states of constraints

/// Returns the message of the constraint after `steps` steps of the scene.
ConstraintState state_after(engine::World* world, int steps, const std::string& constraint) {
  for (int i = 0; i < steps; ++i) world->step();
  return to_msg(*world, world->find_joint(constraint));
}

TEST(ConstraintStates, AWeldOfATurnedBeamCarriesItsWeightAtItsEnd) {
  engine::World world = engine::load_scene(R"(
bodies:
- {name: beam, mass: 3, shape: {box: {size: [1, 0.1, 0.1]}}, position: [0.4, 0.3, 2], orientation: [0, 0, 0.6, 0.8]}
constraints:
- {name: glue, type: weld, anchor_a: [0.26, -0.18, 2], body_b: beam, anchor_b: [-0.5, 0, 0]}
)");
  const ConstraintState msg = state_after(&world, 5, "glue");
  EXPECT_EQ(msg.name, "glue");
  EXPECT_EQ(msg.type, "weld");
  // A turn by 2 atan(0.6 / 0.8) about z: the beam points along (0.28, 0.96, 0), and its centre lies
  // 0.5 m from the anchor.
  const double weight = 3.0 * 9.81;
  constexpr double kRounding = 1e-9;  // rounding of a few factorisations, numbers of order 30
  EXPECT_NEAR(msg.wrench_point.x, 0.4 - 0.5 * 0.28, kRounding);
  EXPECT_NEAR(msg.wrench_point.y, 0.3 - 0.5 * 0.96, kRounding);
  EXPECT_NEAR(msg.wrench_point.z, 2.0, kRounding);
  EXPECT_NEAR(msg.wrench.force.x, 0.0, kRounding);
  EXPECT_NEAR(msg.wrench.force.y, 0.0, kRounding);
  EXPECT_NEAR(msg.wrench.force.z, weight, kRounding);
  EXPECT_NEAR(msg.wrench.torque.x, 0.5 * 0.96 * weight, kRounding);
  EXPECT_NEAR(msg.wrench.torque.y, -0.5 * 0.28 * weight, kRounding);
  EXPECT_NEAR(msg.wrench.torque.z, 0.0, kRounding);
  EXPECT_NEAR(msg.force, weight, kRounding);
  EXPECT_TRUE(std::isnan(msg.position) && std::isnan(msg.reached_rate) && std::isnan(msg.bias));
}

TEST(ConstraintStates, FiguresThatDoNotExistAreNotNumbers) {
  engine::World world = engine::load_scene(R"(
bodies:
- {name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1]}
- {name: door, mass: 1, shape: {sphere: {radius: 0.1}}, position: [3, 0, 0]}
- {name: gate, mass: 1, shape: {sphere: {radius: 0.1}}, position: [6, 0, 0]}
constraints:
- {name: coil, type: spring, anchor_a: [0, 0, 3], body_b: bob, length: 1.5, stiffness: 10}
- {name: socket, type: ball, anchor_a: [0, 0, 1], body_b: bob, break_force: 1}
- {name: hinge, type: hinge, anchor_a: [3, 0, 0], axis_a: [0, 1, 0], body_b: door, motor: {bias: 0.5}}
- {name: free, type: hinge, anchor_a: [6, 0, 0], axis_a: [0, 1, 0], body_b: gate}
- {name: pushed, type: slider, anchor_a: [6, 0, 0], body_b: gate, motor: {force: 2}, enabled: false}
- {name: gear, type: gear, joints: [hinge, free], ratio: -1}
)");
  const ConstraintState broken = state_after(&world, 2, "socket");  // carries 4.81 N upwards
  const auto state = [&](const char* name) { return to_msg(world, world.find_joint(name)); };
  const ConstraintState coil = state("coil"), hinge = state("hinge"), free = state("free"),
                        gear = state("gear"), pushed = state("pushed");
  EXPECT_TRUE(broken.broken);
  for (const ConstraintState* msg : {&broken, &coil, &pushed})
    EXPECT_TRUE(std::isnan(msg->error) && std::isnan(msg->closing_error) &&
                std::isnan(msg->error_rate))
        << msg->name;
  for (const ConstraintState* msg : {&broken, &free, &gear, &pushed})
    EXPECT_TRUE(std::isnan(msg->bias)) << msg->name;
  for (const ConstraintState* msg : {&broken, &gear, &pushed})
    EXPECT_TRUE(std::isnan(msg->position) && std::isnan(msg->reached_rate)) << msg->name;
  EXPECT_TRUE(std::isnan(gear.wrench.force.x) && std::isnan(gear.wrench.torque.z) &&
              std::isnan(gear.wrench_point.y));
  EXPECT_EQ(pushed.wrench.force.z, 0.0);  // disabled: exerts nothing
  EXPECT_EQ(pushed.force, 0.0);

  EXPECT_LT(std::abs(hinge.error), 1e-9);  // rigid rows: to the tolerance of 1e-8 per second
  EXPECT_LT(std::abs(gear.error), 1e-9);
  EXPECT_EQ(hinge.closing_error, 0.0);
  EXPECT_EQ(hinge.bias, 0.5);
  EXPECT_NEAR(hinge.position, 0.5 * world.time(), 1e-9);
  EXPECT_NEAR(free.reached_rate, 0.5, 1e-9);
  EXPECT_NEAR(coil.position, 2.0, 0.01);  // falls for two steps
}

TEST(ConstraintStates, AFunctionThatFailsHasNoError) {
  engine::example_types::register_all();
  engine::World world = engine::load_scene(R"(
bodies:
- {name: bob, mass: 1, shape: {sphere: {radius: 0.1}}}
constraints:
- {name: plane, type: custom, custom: test/ending, body_b: bob}
)");
  EXPECT_EQ(to_msg(world, world.find_joint("plane")).error, 0.0);
  engine::BodyState state = world.state(world.find_body("bob"));
  state.position.x() = 2.0;
  world.set_state(world.find_body("bob"), state);
  const ConstraintState msg = to_msg(world, world.find_joint("plane"));
  EXPECT_TRUE(std::isnan(msg.error) && std::isnan(msg.closing_error) && std::isnan(msg.error_rate));
}

TEST(ConstraintStates, AnErrorThatAnEditLeftIsApartFromErrors) {
  engine::World world = engine::load_scene(R"(
world: {gravity: [0, 0, 0]}
bodies:
- {name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [2, 0, 0]}
constraints:
- {name: rod, type: distance, body_b: bob, length: 2}
)");
  engine::BodyState state = world.state(world.find_body("bob"));
  state.position.x() = 2.25;
  world.set_state(world.find_body("bob"), state);
  const ConstraintState open = state_after(&world, 0, "rod");
  EXPECT_TRUE(open.closing);
  EXPECT_EQ(open.closing_error, 0.25);
  EXPECT_EQ(open.error, 0.0);
  EXPECT_EQ(open.position, 2.25);
  const ConstraintState closed = state_after(&world, 60, "rod");  // closing_time is 0.5 s
  EXPECT_FALSE(closed.closing);
  EXPECT_EQ(closed.closing_error, 0.0);
  EXPECT_LT(std::abs(closed.error), 1e-9);
}

// ---- bytes of messages

template <class Message>
std::vector<std::uint8_t> bytes_of_message(const Message& message) {
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

// Reads a message as roscpp does for topics and services of the node.
template <class Message>
Message received(std::vector<std::uint8_t> bytes) {
  Received<Message> received;
  ros::serialization::IStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::deserialize(stream, received);
  return received.message;
}

TEST(Received, MessagesAreReadAsTheyWereWritten) {
  ApplyEditsRequest request;
  for (int i = 0; i < 3; ++i) {
    Body& body = request.bodies.emplace_back();
    body.name = "b" + std::to_string(i);
    body.shapes.resize(static_cast<std::size_t>(i));
    for (Shape& shape : body.shapes) {
      shape.dimensions.assign(static_cast<std::size_t>(i), 0.5 * i);
      shape.vertices.resize(2);
      shape.triangles = {0, 1, 1};
    }
    body.no_collision = i == 1;
    Constraint& constraint = request.constraints.emplace_back();
    constraint.coordinates.resize(static_cast<std::size_t>(i));
    for (CoordinateLaw& law : constraint.coordinates) law.motor.bias = 0.5 * i;
    constraint.parameters.resize(2);
    request.remove_bodies.push_back(std::string(static_cast<std::size_t>(i), 'x'));
  }
  const std::vector<std::uint8_t> bytes = bytes_of_message(request);
  EXPECT_EQ(bytes_of_message(received<ApplyEditsRequest>(bytes)), bytes);
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_THROW(
        received<ApplyEditsRequest>({bytes.begin(), bytes.begin() + static_cast<long>(size)}),
        ros::serialization::StreamOverrunException);
  EXPECT_STREQ(ros::message_traits::md5sum<Received<MotorBias>>(),
               ros::message_traits::md5sum<MotorBias>());
  EXPECT_STREQ(ros::service_traits::md5sum<Received<ApplyEditsRequest>>(),
               ros::service_traits::md5sum<ApplyEditsRequest>());
}

// Announced lengths: roscpp would allocate 2 TB, and 4 GiB of numbers, whose size in bytes is 8 in
// 32-bit arithmetic.
TEST(Received, ListsAreAsLongAsTheBytesThatAreThere) {
  EXPECT_THROW(received<ApplyEditsRequest>({0xff, 0xff, 0xff, 0xff}),
               ros::serialization::StreamOverrunException);
  std::vector<std::uint8_t> numbers(20,
                                    0);  // no name, no keys, the number of values, and one value
  numbers[8] = 1;
  numbers[11] = 0x20;
  EXPECT_THROW(received<SetBodyPropertiesRequest>(numbers),
               ros::serialization::StreamOverrunException);
}

}  // namespace
}  // namespace constraint_sim
