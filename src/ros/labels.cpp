#include "ros/labels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <variant>
#include <vector>

#include "ros/conversions.h"
#include "sim/grip.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using visualization_msgs::Marker;

constexpr double kHeightOfSign = 0.3;  // letters beside arrows
constexpr double kTellsError = 1e-4;   // [m]
constexpr double kLineSpacing = 1.4;
// heights of a letter
constexpr double kBeside = 1.5;          // from a line to the text beside it
constexpr double kHalfLetter = 0.3;      // width of half a letter
constexpr double kMostOfBody = 4.0;      // that a text keeps off the body that a joint holds
const Vector3d kRight(-0.9, 0.44, 0.0);  // in the shipped view

std::int32_t number(engine::BodyId id) { return static_cast<std::int32_t>(id.value); }
std::int32_t number(engine::JointId id) { return static_cast<std::int32_t>(id.value); }

std::string shown(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Without a sign where there is nothing to tell it of.
std::string signed_value(double value) { return shown(value == 0.0 ? "%.3g" : "%+.3g", value); }

Vector3d middle_of(const engine::World& world, engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  if (engine::couples_joints(joint.kind)) {
    const auto& first = world.anchors(joint.coupling.first);
    const auto& second = world.anchors(joint.coupling.second);
    const bool is_pulley = joint.kind == engine::JointKind::kPulley;  // drawn between upper ends
    return is_pulley ? 0.5 * (first.p_a + second.p_a) : 0.5 * (first.p_b + second.p_b);
  }
  return 0.5 * (world.anchors(id).p_a + world.anchors(id).p_b);
}

}  // namespace

const MarkerMessage& Labels::update(const engine::World& world, const ForceScale& forces,
                                    const ros::Time& stamp, bool for_newcomer) {
  set_.begin(stamp, for_newcomer);
  height_ = kHeightOfSign * extent_of(world).sign;
  std::vector<engine::BodyId> bodies = world.body_ids();
  bodies.resize(std::min(bodies.size(), kMost));
  for (const engine::BodyId id : bodies) {
    Vector3d place = world.state(id).position;
    if (const auto* sphere = std::get_if<engine::Sphere>(&world.body(id).shape))
      place.z() += sphere->radius;
    if (const auto* box = std::get_if<engine::Box>(&world.body(id).shape))
      place.z() += 0.5 * box->size.maxCoeff();
    if (const auto* cylinder = std::get_if<engine::Cylinder>(&world.body(id).shape))
      place.z() += std::max(cylinder->radius, 0.5 * cylinder->length);
    place.z() += height_;
    add_text("body_names", number(id), place, colour(0.9, 0.9, 0.9), world.body(id).name);
  }
  const std::vector<engine::JointId>& joints = world.joint_ids();
  for (std::size_t i = 0; i < std::min(joints.size(), kMost); ++i)
    if (!world.joint_state(joints[i]).broken && world.joint(joints[i]).enabled &&
        !is_grip(world.joint(joints[i])))
      add_labels_of(world, joints[i]);
  add_legend(world, forces);
  return set_.finish();
}

// One below the other, so that each namespace can be left out, and all begin beside the line or the
// body.
void Labels::add_labels_of(const engine::World& world, engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  const engine::JointState& state = world.joint_state(id);
  const Look look = look_of(joint);
  double beside = kBeside * height_;
  if (look == Look::kJoint)
    beside += std::min(radius_of(world.body(joint.body_b).shape), kMostOfBody * height_);
  const Vector3d middle = middle_of(world, id) + beside * kRight;
  const auto add = [&](const char* ns, int row, const std_msgs::ColorRGBA& of,
                       const std::string& text) {
    const double half = kHalfLetter * height_ * static_cast<double>(text.size());
    add_text(ns, number(id),
             middle + half * kRight - row * kLineSpacing * height_ * Vector3d::UnitZ(), of, text);
  };
  add("constraint_names", -1, colour(0.8, 0.9, 0.8), joint.name);
  if (is_slack(joint, state))
    add("forces", 0, colour(0.75, 0.68, 0.55), "slack");
  else if (const auto force = axial_force(joint, state); force && *force == 0.0)
    add("forces", 0, constraint_colour(0.0, 0.0), "0 N");
  else if (force)
    add("forces", 0, constraint_colour(*force < 0.0 ? -1.0 : 1.0, 0.0),
        shown("%.3g N", std::abs(*force)) + (*force < 0.0 ? " tension" : " compression"));
  if (const auto motor = shown_motor(joint, state)) {
    std::string text = motor->force != 0.0
                           ? signed_value(motor->force) + (motor->is_angle ? " N m" : " N")
                           : signed_value(motor->rate) + (motor->is_angle ? " rad/s" : " m/s");
    if (state.saturated) text += ", at its limit";
    add("motor_rates", 1, motor_colour(state.saturated), text);
  }
  if (const double error = shown_error(look, state); error > kTellsError)
    add("errors", 2, constraint_colour(0.0, kRedError),
        shown("off by %.2g m", error) + (state.closing ? ", closing" : ""));
}

void Labels::add_text(const char* ns, std::int32_t id, const Vector3d& place,
                      const std_msgs::ColorRGBA& colour, const std::string& text) {
  Marker& marker = set_.in(ns).add(id, Marker::TEXT_VIEW_FACING);
  marker.pose.position = to_point(place);
  marker.scale.z = height_;
  marker.color = colour;
  marker.text = text;
}

// Above the scene, line by line in the colours that it tells of, as far as they are there.
void Labels::add_legend(const engine::World& world, const ForceScale& forces) {
  const Extent extent = extent_of(world);
  struct Line {
    bool is_used;
    std_msgs::ColorRGBA colour;
    std::string text;
  };
  bool has_motors = false;
  for (const engine::JointId id : world.joint_ids())
    has_motors = has_motors || shown_motor(world.joint(id), world.joint_state(id)).has_value();
  const bool has_forces = forces.reference() > 0.0;
  const bool has_friction = std::any_of(
      world.contacts().begin(), world.contacts().end(),
      [](const auto& contact) { return contact.state != engine::ContactState::kClosed; });
  const bool is_long = world.body_ids().size() > kMost || world.joint_ids().size() > kMost;
  const Line lines[] = {
      {!world.joint_ids().empty(), constraint_colour(0.0, kRedError), "red: off by 10 mm or more"},
      {has_forces, constraint_colour(1.0, 0.0), "yellow: compression"},
      {has_forces, constraint_colour(-1.0, 0.0),
       "cyan: tension, thickest at " + shown("%.3g N", forces.reference())},
      {has_motors, motor_colour(false), "pink: a motor drives this way"},
      {forces.contact_reference() > 0.0, colour(1.0, 1.0, 1.0),
       "white: contact, longest at " + shown("%.3g N", forces.contact_reference())},
      {has_friction, friction_colour(), "orange: its friction"},
      {is_long, colour(0.9, 0.9, 0.9),
       "labels of the first " + std::to_string(kMost) + " bodies and constraints only"}};
  Vector3d place = 0.5 * (extent.low + extent.high);
  place.z() = extent.high.z() + 2.0 * kLineSpacing * height_;
  std::int32_t id = 0;
  for (const Line& line : lines) {
    ++id;
    if (!line.is_used) continue;
    add_text("legend", id, place, line.colour, line.text);
    place.z() += kLineSpacing * height_;
  }
}

}  // namespace constraint_sim
