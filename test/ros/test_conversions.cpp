#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "engine/math/numbers.h"
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
  msg.shape.type = Shape::BOX;
  msg.shape.dimensions = {1.0, 2.0, 3.0};
  msg.mass = 4.0;
  msg.inertia.x = 5.0;
  msg.inertia.y = 6.0;
  msg.inertia.z = 7.0;
  msg.pose.position.y = 8.0;
  msg.twist.angular.z = 9.0;
  msg.friction = 0.1;
  msg.restitution = 0.2;
  msg.no_collision = true;
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
  EXPECT_TRUE(body.no_collision);
}

TEST(Conversions, EachShapeNeedsItsOwnDimensions) {
  Shape shape;
  for (const auto& [type, count] : {std::pair<int, std::size_t>{Shape::POINT, 0},
                                    {Shape::SPHERE, 1},
                                    {Shape::BOX, 3},
                                    {Shape::PLANE, 0}}) {
    shape.type = static_cast<std::uint8_t>(type);
    for (std::size_t n = 0; n < 5; ++n) {
      shape.dimensions.assign(n, 1.0);
      const std::string error = error_of([&] { from_msg(shape); });
      EXPECT_EQ(error.empty(), n == count) << type << " " << n;
      if (n != count) {
        EXPECT_EQ(error.rfind("shape.dimensions: ", 0), 0u) << error;
      }
    }
  }
}

TEST(Conversions, UnknownTypesAreNamed) {
  Body body;
  body.type = 3;
  EXPECT_EQ(error_of([&] { from_msg(body); }).rfind("type: ", 0), 0u);
  Shape shape;
  for (const std::uint8_t type : {std::uint8_t{Shape::CAPSULE}, std::uint8_t{6}}) {
    shape.type = type;
    EXPECT_EQ(error_of([&] { from_msg(shape); }).rfind("shape.type: ", 0), 0u);
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

/// Sets a key, for settings without a field in the message.
void set(Constraint& msg, const std::string& key, double value) {
  msg.keys.push_back(key);
  msg.values.push_back(value);
}

TEST(Conversions, ARopeWithStiffnessIsASpringThatOnlyPulls) {
  const engine::World world = world_of_two();
  Constraint msg;
  msg.name = "c";
  msg.body_b = "b";
  msg.type = "rope";
  msg.max_length = 2.0;
  set(msg, "stiffness", 9.0);
  set(msg, "damping", 0.5);
  const engine::DistanceJoint rope = from_msg(msg, world).distance;
  EXPECT_TRUE(rope.one_sided);
  EXPECT_EQ(rope.length, 2.0);
  EXPECT_FALSE(rope.is_limited());
  EXPECT_EQ(rope.stiffness, 9.0);
  EXPECT_EQ(rope.damping, 0.5);
  msg.type = "strut";
  msg.max_length = 0.0;
  msg.min_length = 2.0;
  EXPECT_EQ(error_of([&] { from_msg(msg, world); }),
            "keys: constraints of type 'strut' have no 'stiffness'");
}

TEST(Conversions, APulleyMayBeOneSided) {
  engine::World world = world_of_two();
  for (const char* body : {"a", "b"}) {
    engine::Joint length;
    length.name = std::string("to_") + body;
    length.kind = engine::free_length();
    length.body_b = world.find_body(body);
    length.anchor_a = {0.0, 0.0, 1.0};
    world.add_joint(length);
  }
  Constraint msg;
  msg.name = "c";
  msg.type = "pulley";
  msg.body_a = "to_a";
  msg.body_b = "to_b";
  set(msg, "ratio", 1.0);
  set(msg, "one_sided", 1.0);
  EXPECT_TRUE(from_msg(msg, world).coupling.one_sided);
  msg.values.back() = 2.0;
  EXPECT_EQ(error_of([&] { from_msg(msg, world); }).rfind("one_sided: must be 0 or 1", 0), 0u);
  msg.type = "gear";
  EXPECT_EQ(error_of([&] { from_msg(msg, world); }),
            "keys: constraints of type 'gear' have no 'one_sided'");
}

TEST(Conversions, FieldsAndKeysAreLawsOfTheFirstCoordinate) {
  Door door;
  door.msg.bias = 0.1;
  door.msg.amplitude = 0.2;
  door.msg.motor_frequency = 3.0;
  door.msg.phase = 0.4;
  door.msg.max_force = 5.0;
  door.msg.break_force = 6.0;
  double value = 10.0;
  for (const char* key : {"lower", "upper", "limit_restitution", "friction", "damping", "stiffness",
                          "rest", "position", "zero", "timeout", "break_torque"})
    set(door.msg, key, value++);
  const engine::Joint joint = from_msg(door.msg, door.world);
  const engine::CoordinateLaw& law = joint.coordinates[0];
  EXPECT_EQ(law.lower, 10.0);
  EXPECT_EQ(law.upper, 11.0);
  EXPECT_EQ(law.limit_restitution, 12.0);
  EXPECT_EQ(law.friction, 13.0);
  EXPECT_EQ(law.damping, 14.0);
  EXPECT_EQ(law.stiffness, 15.0);
  EXPECT_EQ(law.rest, 16.0);
  EXPECT_EQ(law.position, 17.0);
  EXPECT_EQ(law.zero, 18.0);
  EXPECT_EQ(joint.break_force, 6.0);
  EXPECT_EQ(joint.break_torque, 20.0);
  ASSERT_TRUE(law.motor);
  EXPECT_EQ(law.motor->bias, 0.1);
  EXPECT_EQ(law.motor->amplitude, 0.2);
  EXPECT_EQ(law.motor->frequency, 3.0);
  EXPECT_EQ(law.motor->phase, 0.4);
  EXPECT_EQ(law.motor->max_force, 5.0);
  EXPECT_EQ(law.motor->timeout, 19.0);
  EXPECT_FALSE(law.motor->position || law.motor->force);
  EXPECT_TRUE(joint.coordinates[1].is_none() && joint.coordinates[2].is_none());
}

TEST(Conversions, KeysOfMotorsArriveOnTheirCoordinates) {
  Door door;
  door.msg.type = "planar";
  door.msg.frequency = 2.0;
  door.msg.damping_ratio = 0.3;
  const char* keys[] = {
      "motor_position", "motor_force", "servo_frequency", "servo_damping_ratio", "servo_stiffness",
      "servo_damping",  "bias",        "amplitude",       "motor_frequency",     "phase",
      "max_force",      "frequency",   "damping_ratio"};
  double value = 1.0;
  for (const char* key : keys) set(door.msg, std::string("2/") + key, value++);
  set(door.msg, "1/motor", 1.0);
  const engine::Joint joint = from_msg(door.msg, door.world);
  EXPECT_FALSE(joint.coordinates[0].motor);
  EXPECT_EQ(joint.coordinates[0].frequency, 2.0);
  EXPECT_EQ(joint.coordinates[0].damping_ratio, 0.3);
  ASSERT_TRUE(joint.coordinates[1].motor);
  EXPECT_FALSE(joint.coordinates[1].motor->is_moving());
  ASSERT_TRUE(joint.coordinates[2].motor);
  const engine::CoordinateMotor& motor = *joint.coordinates[2].motor;
  EXPECT_EQ(motor.position, 1.0);
  EXPECT_EQ(motor.force, 2.0);
  EXPECT_EQ(motor.servo_frequency, 3.0);
  EXPECT_EQ(motor.servo_damping_ratio, 4.0);
  EXPECT_EQ(motor.servo_stiffness, 5.0);
  EXPECT_EQ(motor.servo_damping, 6.0);
  EXPECT_EQ(motor.bias, 7.0);
  EXPECT_EQ(motor.amplitude, 8.0);
  EXPECT_EQ(motor.frequency, 9.0);
  EXPECT_EQ(motor.phase, 10.0);
  EXPECT_EQ(motor.max_force, 11.0);
  EXPECT_EQ(joint.coordinates[2].frequency, 12.0);
  EXPECT_EQ(joint.coordinates[2].damping_ratio, 13.0);
}

TEST(Conversions, AMotorThatHoldsNeedsAKeyAndNoMotorIsMadeOfNothing) {
  Door door;
  EXPECT_FALSE(from_msg(door.msg, door.world).coordinates[0].motor);
  set(door.msg, "motor", 1.0);
  ASSERT_TRUE(from_msg(door.msg, door.world).coordinates[0].motor);
  EXPECT_TRUE(from_msg(door.msg, door.world).coordinates[0].motor->is_rigid());
}

TEST(Conversions, KeysThatCannotBeAreNamed) {
  const auto error = [](const char* type, const char* key, double value) {
    Door door;
    door.msg.type = type;
    if (std::string(type) == "universal") door.msg.axis_b.x = 1.0;
    set(door.msg, key, value);
    return error_of([&] { from_msg(door.msg, door.world); });
  };
  EXPECT_EQ(error("hinge", "stiffness", 1.0), "");
  EXPECT_EQ(error("universal", "1/stiffness", 1.0), "");
  EXPECT_EQ(error("weld", "break_torque", 1.0), "");
  EXPECT_EQ(error("ball", "break_torque", 1.0), "");
  EXPECT_EQ(error("hinge", "stifness", 1.0),
            "keys: constraints of type 'hinge' have no 'stifness'");
  EXPECT_EQ(error("universal", "1/stifness", 1.0),
            "keys: constraints of type 'universal' have no '1/stifness'");
  EXPECT_EQ(error("universal", "1/break_torque", 1.0),
            "keys: constraints of type 'universal' have no '1/break_torque'");
  EXPECT_EQ(error("hinge", "1/stiffness", 1.0),
            "keys: '1/stiffness': constraints of type 'hinge' have 1 coordinate");
  EXPECT_EQ(error("planar", "3/stiffness", 1.0),
            "keys: '3/stiffness': constraints of type 'planar' have 3 coordinates");
  EXPECT_EQ(error("hinge", "bias", 1.0),
            "keys: 'bias' of the first coordinate is a field of the message");
  EXPECT_EQ(error("hinge", "motor", 0.0).rfind("keys: 'motor' must be 1", 0), 0u);
  EXPECT_EQ(error("weld", "stiffness", 1.0),
            "keys: constraints of type 'weld' have no 'stiffness'");
  EXPECT_EQ(error("distance", "break_torque", 1.0),
            "keys: constraints of type 'distance' have no 'break_torque'");
  Door door;
  set(door.msg, "rest", 1.0);
  set(door.msg, "rest", 2.0);
  EXPECT_EQ(error_of([&] { from_msg(door.msg, door.world); }), "keys: 'rest' is there twice");
  Door lost;
  lost.msg.phase = 1.0;
  EXPECT_EQ(error_of([&] { from_msg(lost.msg, lost.world); }).rfind("phase: needs a motor", 0), 0u);
}

TEST(Conversions, CoordinatesAreJointStates) {
  engine::Joint joint;
  engine::JointState state;
  for (std::size_t i = 0; i < 3; ++i) {
    const double first = 10.0 * static_cast<double>(i);
    state.coordinates[i].position = first + 1.0;
    state.coordinates[i].velocity = first + 2.0;
    state.coordinates[i].effort = first + 3.0;
  }
  sensor_msgs::JointState msg;
  for (const auto& [name, kind] : {std::pair("rod", engine::JointKind::kDistance),
                                   {"door", engine::JointKind::kHinge},
                                   {"ice", engine::JointKind::kPlanar}}) {
    joint.name = name;
    joint.kind = kind;
    add_coordinates(joint, state, &msg);
  }
  EXPECT_EQ(msg.name, (std::vector<std::string>{"door", "ice", "ice/1", "ice/2"}));
  EXPECT_EQ(msg.position, (std::vector<double>{1.0, 1.0, 11.0, 21.0}));
  EXPECT_EQ(msg.velocity, (std::vector<double>{2.0, 2.0, 12.0, 22.0}));
  EXPECT_EQ(msg.effort, (std::vector<double>{3.0, 3.0, 13.0, 23.0}));
}

TEST(Conversions, EachFieldOfAConstraintStateArrives) {
  engine::Joint joint;
  joint.name = "rod";
  engine::JointState state;
  state.error = 1.0;
  state.error_rate = 2.0;
  state.force = 3.0;
  state.bias = 4.0;
  state.reached_rate = 5.0;
  state.broken = true;
  const ConstraintState msg = to_msg(joint, state);
  EXPECT_EQ(msg.name, "rod");
  EXPECT_EQ(msg.type, "distance");
  EXPECT_EQ(msg.error, 1.0);
  EXPECT_EQ(msg.error_rate, 2.0);
  EXPECT_EQ(msg.force, 3.0);
  EXPECT_EQ(msg.bias, 4.0);
  EXPECT_EQ(msg.reached_rate, 5.0);
  EXPECT_FALSE(msg.saturated);
  EXPECT_TRUE(msg.broken);
  EXPECT_FALSE(msg.closing);
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
    body.shape.dimensions.assign(static_cast<std::size_t>(i), 0.5 * i);
    body.no_collision = i == 1;
    Constraint& constraint = request.constraints.emplace_back();
    constraint.keys = {"lower", "upper"};
    constraint.values = {-1.0, 2.0};
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
