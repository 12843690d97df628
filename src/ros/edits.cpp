#include "ros/edits.h"

#include <ros/serialization.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <unordered_set>
#include <utility>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "ros/body_messages.h"
#include "ros/constraint_messages.h"
#include "ros/conversions.h"
#include "ros/laws.h"
#include "ros/parameters.h"
#include "ros/received.h"
#include "sim/stepper.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

// Adds a joint. Reports its initial error, and the text about the error if there is one.
engine::JointId add_joint(World& world, const engine::Joint& joint, double* initial_error,
                          std::string* status_message) {
  const engine::JointId id = world.add_joint(joint);
  const double error = world.joint_state(id).error;
  *initial_error = std::isfinite(error) ? error : 0.0;
  *status_message = engine::text_of_opening(world, id);
  return id;
}

// Sets bias, force limit and timeout of a motor, on the first coordinate of a joint that has
// coordinates. Amplitude, frequency and phase stay. A motor that controls position or force becomes
// a rate motor.
template <class Bias>
void set_bias(World& world, const Bias& bias) {
  const engine::JointId id = find_joint(world, "constraint", bias.constraint);
  const engine::Joint& joint = world.joint(id);
  engine::Motor motor;
  const engine::Motor& present = joint.coordinates[0].motor.value_or(joint.motor);
  motor.amplitude = present.amplitude;
  motor.frequency = present.frequency;
  motor.phase = present.phase;
  motor.bias = bias.bias;
  motor.max_force = bias.max_force;
  motor.timeout = bias.timeout;
  world.set_motor(id, motor);
}

void set_state(World& world, const BodyState& message, const std::string& reference_frame) {
  const engine::BodyId body = find_own_body(world, "name", message.name);
  const engine::BodyId frame = find_body(world, "reference_frame", reference_frame);
  const engine::BodyState state = from_msg(message.pose, message.twist);
  engine::validate(state);
  world.set_state(body, from_relative(world.state(frame), state));
}

// Calls `act` with each element and adds the index to the text of exceptions. Throws NotNow when
// the world is asked to stop.
template <class Element, class Act>
void for_each(const World& world, const char* field, const std::vector<Element>& list, Act act) {
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (world.is_asked_to_stop())
      throw NotNow(std::string(field) + "[" + std::to_string(i) + "]: the edit was cancelled");
    try {
      act(list[i]);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(std::string(field) + "[" + std::to_string(i) +
                                  "]: " + error.what());
    }
  }
}

// Sets a property of a body by its key; returns false for an unknown key.
bool set_property(const std::string& key, double value, engine::Body* body) {
  const std::map<std::string, double*> numbers{
      {"mass", &body->mass},
      {"inertia_x", &body->inertia.x()},
      {"inertia_y", &body->inertia.y()},
      {"inertia_z", &body->inertia.z()},
      {"friction", &body->friction},
      {"restitution", &body->restitution},
      {"gravity_compensation", &body->gravity_compensation}};
  const auto found = numbers.find(key);
  if (found != numbers.end()) {
    *found->second = value;
    return true;
  }
  for (auto [name, bits] : {std::pair{"collision_groups", &body->collision_groups},
                            std::pair{"collision_mask", &body->collision_mask}}) {
    if (key != name) continue;
    constexpr double kMost = engine::kAllGroups;
    if (!(value >= 1.0 && value <= kMost && value == std::floor(value)))
      throw std::invalid_argument(key + ": must be a whole number from 1 to 4294967295");
    *bits = static_cast<std::uint32_t>(value);
    return true;
  }
  if (key != "no_collision") return false;
  if (value != 0.0 && value != 1.0) throw std::invalid_argument("no_collision: must be 0 or 1");
  body->no_collision = value == 1.0;
  return true;
}

constexpr std::size_t kMostEdits = 100000;     // edits per request
constexpr std::size_t kMostWrenches = 100000;  // active and pending

template <class Request>
void check_pairs(const Request& request) {
  if (request.keys.size() != request.values.size())
    throw std::invalid_argument("values: must be as many as keys, got " +
                                std::to_string(request.values.size()) + " for " +
                                std::to_string(request.keys.size()));
  std::unordered_set<std::string> seen;
  for (const std::string& key : request.keys)
    if (!seen.insert(key).second)
      throw std::invalid_argument("keys: '" + shortened(key) + "' is there twice");
}

double number(const std::string& key, const std::string& value) {
  std::size_t end = 0;
  double number = 0.0;
  try {
    number = std::stod(value, &end);
  } catch (const std::exception&) {
    end = 0;
  }
  if (end == 0 || end != value.size())
    throw std::invalid_argument(key + ": must be a number, got '" + shortened(value) + "'");
  return number;
}

}  // namespace

SetMotorBiasRequest request_of(const MotorBias& message) {
  SetMotorBiasRequest request;
  request.constraint = message.constraint;
  request.bias = message.bias;
  request.max_force = message.max_force;
  request.timeout = message.timeout;
  return request;
}

std::size_t size(const ApplyEditsRequest& request) {
  return request.bodies.size() + request.constraints.size() + request.remove_bodies.size() +
         request.remove_constraints.size() + request.states.size() + request.motors.size();
}

void check_size(const ApplyEditsRequest& request) {
  if (size(request) > kMostEdits)
    throw std::invalid_argument("at most " + std::to_string(kMostEdits) +
                                " edits may be in one request, got " +
                                std::to_string(size(request)));
}

void change(World& world, const AddBodyRequest& request, AddBodyResponse*) {
  world.add_body(from_msg(request.body));
}

void change(World& world, const RemoveBodyRequest& request, RemoveBodyResponse* response) {
  response->removed_constraints = world.remove_body(find_own_body(world, "name", request.name));
}

void change(World& world, const AddDistanceConstraintRequest& request,
            AddDistanceConstraintResponse* response) {
  add_joint(world, from_msg(request, world), &response->initial_error, &response->status_message);
}

void change(World& world, const AddConstraintRequest& request, AddConstraintResponse* response) {
  add_joint(world, from_msg(request.constraint, world), &response->initial_error,
            &response->status_message);
}

void change(World& world, const RemoveConstraintRequest& request, RemoveConstraintResponse*) {
  world.remove_joint(find_joint(world, "name", request.name));
}

void change(World& world, const SetMotorBiasRequest& request, SetMotorBiasResponse*) {
  set_bias(world, request);
}

void change(World& world, const SetConstraintPropertiesRequest& request,
            SetConstraintPropertiesResponse* response) {
  const engine::JointId id = find_joint(world, "name", request.name);
  engine::Joint joint = world.joint(id);
  change_properties(request.keys, request.values, &joint);
  world.set_joint(id, joint);
  response->status_message = engine::text_of_opening(world, id);
}

void change(World& world, const ApplyBodyWrenchRequest& request, ApplyBodyWrenchResponse*) {
  if (world.wrenches().size() >= kMostWrenches)
    throw std::invalid_argument("wrench: there are " + std::to_string(kMostWrenches) +
                                " already; clear_body_wrenches ends those of a body");
  world.add_wrench(from_msg(request, world));
}

void change(World& world, const ClearBodyWrenchesRequest& request, ClearBodyWrenchesResponse*) {
  world.clear_wrenches(find_own_body(world, "body_name", request.body_name));
}

void change(World& world, const SetBodyStateRequest& request, SetBodyStateResponse*) {
  set_state(world, request.state, request.reference_frame);
}

// Edits a copy, which replaces the world at the end: the request takes effect as a whole or not at
// all.
void change(World& world, const ApplyEditsRequest& request, ApplyEditsResponse* response) {
  check_size(request);
  World changed = world;
  std::vector<engine::JointId> joints;
  std::vector<engine::BodyId> bodies;
  for_each(world, "remove_constraints", request.remove_constraints,
           [&](const std::string& name) { joints.push_back(find_joint(changed, "name", name)); });
  std::unordered_set<std::string> seen;
  for_each(world, "remove_bodies", request.remove_bodies, [&](const std::string& name) {
    bodies.push_back(find_own_body(changed, "name", name));
    if (!seen.insert(name).second)
      throw std::invalid_argument("name: '" + shortened(name) + "' is there twice");
  });
  try {
    response->removed_constraints = changed.remove(joints, bodies);
  } catch (const std::invalid_argument&
               error) {  // the bodies were found above, so the error is of a constraint
    throw std::invalid_argument(std::string("remove_constraints: ") + error.what());
  }
  for_each(world, "bodies", request.bodies,
           [&](const Body& body) { changed.add_body(from_msg(body)); });
  for_each(world, "constraints", request.constraints, [&](const Constraint& constraint) {
    std::string opening;
    add_joint(changed, from_msg(constraint, changed), &response->initial_errors.emplace_back(0.0),
              &opening);
    if (response->status_message.empty() && !opening.empty())
      response->status_message = constraint.name + ": " + opening;
  });
  for_each(world, "states", request.states,
           [&](const BodyState& state) { set_state(changed, state, ""); });
  for_each(world, "motors", request.motors,
           [&](const MotorBias& bias) { set_bias(changed, bias); });
  world = std::move(changed);
}

void change(World& world, const SetBodyPropertiesRequest& request, SetBodyPropertiesResponse*) {
  const engine::BodyId id = find_own_body(world, "name", request.name);
  check_pairs(request);
  engine::Body body = world.body(id);
  for (std::size_t i = 0; i < request.keys.size(); ++i)
    if (!set_property(request.keys[i], request.values[i], &body))
      throw std::invalid_argument(
          "keys: there is no '" + shortened(request.keys[i]) +
          "' of a body; there are mass, inertia_x, inertia_y, inertia_z, friction, restitution, "
          "no_collision, collision_groups, collision_mask, gravity_compensation");
  world.set_body(id, body);
}

Pacing pacing(const SetOptionsRequest& request) {
  Pacing pacing;
  for (std::size_t i = 0; i < request.keys.size(); ++i) {
    if (request.keys[i] == "real_time_factor")
      pacing.real_time_factor = number(request.keys[i], request.values[i]);
    if (request.keys[i] == "publish_rate")
      pacing.publish_rate = number(request.keys[i], request.values[i]);
  }
  return pacing;
}

void change(World& world, const SetOptionsRequest& request, SetOptionsResponse*) {
  check_pairs(request);
  const Pacing beside = pacing(request);
  if (beside.real_time_factor) check_real_time_factor(*beside.real_time_factor);
  if (beside.publish_rate) check_publish_rate(*beside.publish_rate);
  std::vector<std::string> known{"real_time_factor", "publish_rate"};
  engine::WorldOptions options = world.options();
  engine::visit_options(
      options, [&](const engine::OptionInfo& info, auto&, auto) { known.emplace_back(info.name); });
  bool any = false;
  for (std::size_t i = 0; i < request.keys.size(); ++i) {
    const std::string& key = request.keys[i];
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw std::invalid_argument("keys: there is no option '" + shortened(key) + "'" +
                                  did_you_mean(key, known));
    if (key == "real_time_factor" || key == "publish_rate") continue;
    engine::set_option(key, request.values[i], &options);
    any = true;
  }
  if (any) world.set_options(options);
}

void reset_world(World& world) { world.reset(); }

void reset_simulation(World& world) {
  world.reset();
  world.set_time(0.0, 0);
}

namespace {

// Streams of ros::serialization visit the changes to measure, write and read them.

template <class Stream, class Value>
void visit_drive(Stream& stream, std::optional<Value>& value) {
  auto is_there = static_cast<std::uint8_t>(value.has_value());
  stream.next(is_there);
  if (is_there == 0) return value.reset();
  if (!value) value.emplace();
  stream.next(*value);
}

template <class Stream>
void visit_drive(Stream& stream, DriveChanges::Motor& each) {
  auto has_coordinate = static_cast<std::uint8_t>(each.has_coordinate);
  stream.next(each.joint);
  stream.next(has_coordinate);
  each.has_coordinate = has_coordinate != 0;
  engine::Motor& motor = each.motor;
  for (double* number : {&motor.bias, &motor.amplitude, &motor.frequency, &motor.phase,
                         &motor.max_force, &motor.timeout, &motor.servo_frequency,
                         &motor.servo_damping_ratio, &motor.servo_stiffness, &motor.servo_damping})
    stream.next(*number);
  visit_drive(stream, motor.position);
  visit_drive(stream, motor.force);
}

template <class Stream>
void visit_drive(Stream& stream, Eigen::Vector3d& vector) {
  for (int i = 0; i < 3; ++i) stream.next(vector[i]);
}

template <class Stream>
void visit_drive(Stream& stream, DriveChanges::State& each) {
  stream.next(each.body);
  visit_drive(stream, each.state.position);
  for (int i = 0; i < 4; ++i) stream.next(each.state.orientation.coeffs()[i]);
  visit_drive(stream, each.state.linear_velocity);
  visit_drive(stream, each.state.angular_velocity);
}

template <class Stream>
void visit_drive(Stream& stream, DriveChanges::Wrench& each) {
  stream.next(each.body);
  visit_drive(stream, each.wrench.force);
  visit_drive(stream, each.wrench.torque);
  stream.next(each.wrench.start);
  stream.next(each.wrench.end);
}

template <class Stream, class Change>
void visit_drive(Stream& stream, std::vector<Change>& changes) {
  auto count = static_cast<std::uint32_t>(changes.size());
  stream.next(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (i == changes.size())
      changes.emplace_back();  // grows by single entries, since a damaged count may be huge
    visit_drive(stream, changes[i]);
  }
}

template <class Stream>
void visit_drive(Stream& stream, DriveChanges& changes) {
  visit_drive(stream, changes.motors);
  visit_drive(stream, changes.states);
  visit_drive(stream, changes.wrenches);
}

template <class Read>
void read_request(const std::string& service, std::vector<std::uint8_t> bytes, Read read) {
  BoundedStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  try {
    read(stream);
  } catch (const ros::serialization::StreamOverrunException&) {
    throw std::invalid_argument("the request of " + service + " is cut off");
  }
}

}  // namespace

std::vector<std::uint8_t> bytes_of(const DriveChanges& changes) {
  DriveChanges copy = changes;
  ros::serialization::LStream length;
  visit_drive(length, copy);
  std::vector<std::uint8_t> bytes(length.getLength());
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  visit_drive(stream, copy);
  return bytes;
}

void apply_recorded(World& world, const std::string& service,
                    const std::vector<std::uint8_t>& request) {
  if (service == kDriveRecord) {
    DriveChanges changes;
    read_request(service, request, [&](auto& stream) { visit_drive(stream, changes); });
    return Driver(&world).repeat(changes);
  }
  if (service == "reset_world") return reset_world(world);
  if (service == "reset_simulation") return reset_simulation(world);
  bool is_known = false;
  visit_edits([&](const char* name, auto* type) {
    if (service != name) return;
    is_known = true;
    using Service = std::remove_pointer_t<decltype(type)>;
    typename Service::Request read;
    typename Service::Response response;
    read_request(service, request, [&](auto& stream) { stream.next(read); });
    change(world, read, &response);
  });
  if (!is_known) throw std::invalid_argument("there is no edit '" + shortened(service) + "'");
}

}  // namespace constraint_sim
