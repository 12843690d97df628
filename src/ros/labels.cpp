#include "ros/labels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <variant>
#include <vector>

#include "ros/conversions.h"
#include "ros/joint_signs.h"
#include "sim/grip.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using visualization_msgs::Marker;

constexpr double kHeightOfSign = 0.3;          // letters beside arrows
constexpr double kTellsError = 1e-4;           // [m]
constexpr double kHeightOfLegend = 0.02;       // of the scene's diagonal
constexpr double kTellsForce = 0.01;           // of the largest one: less has no line of the legend
constexpr double kShares[] = {0.5, 0.7, 0.3};  // of a length, where labels of neighbours are
constexpr double kLineSpacing = 1.4;
constexpr double kAhead = 0.3;       // [s]
constexpr double kMostGrowth = 2.0;  // of letters, by the motion
// heights of a letter
constexpr double kAbove = 0.9;  // from a part to the middle of the text above it
// widths of a space, which rviz draws as wide as an A
constexpr double kLetter = 0.8;
constexpr double kBeside = 2.8;  // from a line to the text beside it

std::int32_t number(engine::BodyId id) { return static_cast<std::int32_t>(id.value); }
std::int32_t number(engine::JointId id) { return static_cast<std::int32_t>(id.value); }

std::string shown(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Without a sign where there is nothing to tell it of.
std::string signed_value(double value) { return shown(value == 0.0 ? "%.3g" : "%+.3g", value); }

// rviz centres texts about their place: as many spaces before it as it is wide put it beside a
// line, on the right in every view; behind it on the left.
std::string beside(const std::string& text, bool is_left = false) {
  const auto spaces = static_cast<double>(std::count(text.begin(), text.end(), ' '));
  const double width = kLetter * (static_cast<double>(text.size()) - spaces) + spaces;
  const std::string space(static_cast<std::size_t>(std::lround(width + 2.0 * kBeside)), ' ');
  return is_left ? text + space : space + text;
}

Vector3d place_of(const engine::World& world, engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  if (engine::couples_joints(joint.kind)) {
    const auto& first = world.anchors(joint.coupling.first);
    const auto& second = world.anchors(joint.coupling.second);
    const bool is_pulley = joint.kind == engine::JointKind::kPulley;  // drawn between upper ends
    return is_pulley ? 0.5 * (first.p_a + second.p_a) : 0.5 * (first.p_b + second.p_b);
  }
  const double share = kShares[id.value % 3];  // parallel ones are often added one by one
  return (1.0 - share) * world.anchors(id).p_a + share * world.anchors(id).p_b;
}

// Of bodies and what joins them; extents have the spheres around bodies.
double top_of(const engine::World& world) {
  double top = -std::numeric_limits<double>::infinity();
  for (const engine::BodyId id : world.body_ids()) {
    const engine::Body& body = world.body(id);
    if (std::holds_alternative<engine::Plane>(body.shape)) continue;
    const engine::BodyState& state = world.state(id);
    top = std::max(top, middle_of(body, state).z() + half_width(body, state, Vector3d::UnitZ()));
  }
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (engine::couples_joints(joint.kind) || is_grip(joint)) continue;
    top = std::max(top, top_of_rail(world, joint, size_of(world, joint), world.anchors(id).p_a,
                                    world.anchors(id).p_b));
  }
  return std::isfinite(top) ? top : 0.0;
}

}  // namespace

const MarkerMessage& Labels::update(const engine::World& world, const ForceScale& forces,
                                    const ros::Time& stamp, bool for_newcomer) {
  set_.begin(stamp, for_newcomer);
  const Extent extent = extent_of(world);
  const double larger = growth(world, extent);
  height_ = larger * kHeightOfSign * extent.sign;
  height_of_legend_ =
      larger * std::max(kHeightOfSign * extent.sign, kHeightOfLegend * extent.diagonal());
  std::vector<engine::BodyId> bodies = world.body_ids();
  bodies.resize(std::min(bodies.size(), kMost));
  for (const engine::BodyId id : bodies) {
    Vector3d place = middle_of(world.body(id), world.state(id));
    if (const auto* sphere = std::get_if<engine::Sphere>(&world.body(id).shape))
      place.z() += sphere->radius;
    if (const auto* box = std::get_if<engine::Box>(&world.body(id).shape))
      place.z() += 0.5 * box->size.maxCoeff();
    if (const auto* cylinder = std::get_if<engine::Cylinder>(&world.body(id).shape))
      place.z() += std::max(cylinder->radius, 0.5 * cylinder->length);
    place.z() += height_;
    add_text("body_names", number(id), place, colour(0.9, 0.9, 0.9), world.body(id).name);
  }
  find_all_wheels(world);
  const std::vector<engine::JointId>& joints = world.joint_ids();
  for (std::size_t i = 0; i < std::min(joints.size(), kMost); ++i)
    if (!world.joint_state(joints[i]).broken && world.joint(joints[i]).enabled &&
        !is_grip(world.joint(joints[i])))
      add_labels_of(world, joints[i]);
  add_legend(world, forces, is_any_broken_shown(world, stamp.toSec()));
  return set_.finish();
}

void Labels::forget() {
  set_.forget();
  seen_.reset();
  broken_.reset();
  broke_.reset();
}

// Markers show for a while what broke before the eyes of a viewer.
bool Labels::is_any_broken_shown(const engine::World& world, double now) {
  const auto broken = static_cast<std::size_t>(
      std::count_if(world.joint_ids().begin(), world.joint_ids().end(),
                    [&](engine::JointId id) { return world.joint_state(id).broken; }));
  if (broken_ && broken > *broken_) broke_ = now;
  broken_ = broken;
  return broken > 0 && broke_ && std::abs(now - *broke_) < kBrokenShown;
}

// A scene is looked at from where all of its motion is seen: the farther it goes, the larger its
// letters.
double Labels::growth(const engine::World& world, const Extent& extent) {
  if (!seen_) seen_ = extent;
  seen_->low = seen_->low.cwiseMin(extent.low);
  seen_->high = seen_->high.cwiseMax(extent.high);
  for (const engine::BodyId id : world.body_ids()) {
    const engine::BodyState& state = world.state(id);
    const Vector3d then = state.position + kAhead * state.linear_velocity;
    seen_->low = seen_->low.cwiseMin(then);
    seen_->high = seen_->high.cwiseMax(then);
  }
  if (!(extent.diagonal() > 0.0)) return 1.0;
  return std::clamp(seen_->diagonal() / extent.diagonal(), 1.0, kMostGrowth);
}

// With its wheel, where a gear couples it.
JointSize Labels::size_in_gear(const engine::World& world, engine::JointId id) const {
  const auto found = wheels_.find(id.value);
  return found != wheels_.end() ? found->second : size_of(world, world.joint(id));
}

void Labels::find_all_wheels(const engine::World& world) {
  wheels_.clear();
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (joint.kind != engine::JointKind::kGear) continue;
    const auto size = [&](engine::JointId of) -> JointSize& {
      return wheels_.try_emplace(of.value, size_of(world, world.joint(of))).first->second;
    };
    JointSize& first = size(joint.coupling.first);
    find_wheels(world, joint, &first, &size(joint.coupling.second));
  }
}

// Beside the line of what has a length, one below the other so that each namespace can be left
// out; above the axis of a joint, or at the tip of its motor's arrow, one above the other.
void Labels::add_labels_of(const engine::World& world, engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  const engine::JointState& state = world.joint_state(id);
  const Look look = look_of(joint);
  const auto motor = shown_motor(joint, state);
  // in line with its arrow
  const bool is_at_tip = look == Look::kJoint && motor && !motor->is_angle;
  const bool is_left = !is_at_tip && id.value % 2 == 1;  // neighbours are on both sides
  const bool is_above = !is_at_tip && (look == Look::kJoint || look == Look::kCoupling);
  Vector3d place = place_of(world, id);
  if (look == Look::kJoint)
    place = end_of_sign(world, joint, size_in_gear(world, id), motor, world.anchors(id).p_a,
                        world.anchors(id).p_b, Vector3d::UnitZ());
  if (joint.kind == engine::JointKind::kGear)  // below both, whose own labels are above them
    for (const engine::JointId of : {joint.coupling.first, joint.coupling.second}) {
      const Vector3d low =
          end_of_sign(world, world.joint(of), size_in_gear(world, of), std::nullopt,
                      world.anchors(of).p_a, world.anchors(of).p_b, -Vector3d::UnitZ());
      place.z() = std::min(place.z(), low.z() - 2.0 * kAbove * height_);
    }
  place.z() += is_above ? kAbove * height_ : kLineSpacing * height_;
  const auto add = [&](const char* ns, const std_msgs::ColorRGBA& of, const std::string& text) {
    add_text(ns, number(id), place, of, is_above ? text : beside(text, is_left));
    place.z() += (is_above ? 1.0 : -1.0) * kLineSpacing * height_;
  };
  const auto add_motor = [&] {
    if (!motor) return;
    std::string text = motor->force != 0.0
                           ? signed_value(motor->force) + (motor->is_angle ? " N m" : " N")
                           : signed_value(motor->rate) + (motor->is_angle ? " rad/s" : " m/s");
    if (look == Look::kJoint) text = world.body(joint.body_b).name + " " + text;
    if (state.saturated) text += ", at its limit";
    add("motor_rates", motor_colour(state.saturated), text);
  };
  const auto add_error = [&] {
    if (const double error = shown_error(look, state); error > kTellsError)
      add("errors", colour(1.0, 0.5, 0.45),  // letters are thin
          shown("off by %.2g m", error) + (state.closing ? ", closing" : ""));
  };
  const auto add_name = [&] { add("constraint_names", colour(0.8, 0.9, 0.8), joint.name); };
  if (is_above) {
    add_motor();
    add_error();
    return add_name();
  }
  add_name();
  if (is_slack(joint, state))
    add("forces", colour(0.75, 0.68, 0.55), "slack");
  else if (const auto force = axial_force(joint, state); force && *force == 0.0)
    add("forces", constraint_colour(0.0, 0.0), "0 N");
  else if (force)
    add("forces", constraint_colour(*force < 0.0 ? -1.0 : 1.0, 0.0),
        shown("%.3g N", std::abs(*force)) + (*force < 0.0 ? " tension" : " compression"));
  add_motor();
  add_error();
}

void Labels::add_text(const char* ns, std::int32_t id, const Vector3d& place,
                      const std_msgs::ColorRGBA& colour, const std::string& text, double height) {
  Marker& marker = set_.in(ns).add(id, Marker::TEXT_VIEW_FACING);
  marker.pose.position = to_point(place);
  marker.scale.z = height > 0.0 ? height : height_;
  marker.color = colour;
  marker.text = text;
}

// Above the scene, line by line in the colours that it tells of, as far as they are there.
void Labels::add_legend(const engine::World& world, const ForceScale& forces, bool has_broken) {
  const Extent extent = extent_of(world);
  struct Line {
    bool is_used;
    std_msgs::ColorRGBA colour;
    std::string text;
  };
  bool has_joints = false, has_motors = false, has_rings = false, has_axes = false,
       has_errors = false, has_lengths = false;
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    const engine::JointState& state = world.joint_state(id);
    if (state.broken || !joint.enabled) continue;
    has_joints = true;
    const Look look = look_of(joint);
    const auto motor = shown_motor(joint, state);
    has_motors = has_motors || motor;
    has_rings = has_rings || (motor && motor->is_angle);
    has_axes = has_axes || (look == Look::kJoint && engine::has_frames(joint.kind));
    has_lengths = has_lengths || axial_force(joint, state);
    has_errors = has_errors || shown_error(look, state) > kTellsError;
  }
  const auto has = [&](engine::ContactState state) {
    const double most = forces.friction(state == engine::ContactState::kSticking);
    if (!(most > kLeastFriction * forces.contact_reference())) return false;
    return std::any_of(world.contacts().begin(), world.contacts().end(),
                       [&](const auto& contact) { return contact.state == state; });
  };
  const auto at_most = [](double force) { return shown(", at most %.3g N", force); };
  const auto is_told = [&](double force) {
    return has_lengths && force > kTellsForce * forces.reference();
  };
  const bool is_long = world.body_ids().size() > kMost || world.joint_ids().size() > kMost;
  const Line lines[] = {
      {has_errors, colour(1.0, 0.5, 0.45), "red: off by 10 mm or more"},
      {has_joints, constraint_colour(0.0, 0.0), has_lengths ? "green: no force" : "green: holds"},
      {has_axes, colour(0.8, 0.8, 0.85), "light grey: axes and rails of joints"},
      {has_broken, colour(0.6, 0.6, 0.6), "grey: broken"},
      {is_told(forces.compression()), constraint_colour(1.0, 0.0),
       "yellow: compression" + at_most(forces.compression())},
      {is_told(forces.tension()), constraint_colour(-1.0, 0.0),
       "cyan: tension" + at_most(forces.tension())},
      {has_motors, motor_colour(false),
       std::string("pink: driven by a motor") +
           (has_rings ? ", rings by the right-hand rule" : "")},
      {!world.contacts().empty(), colour(1.0, 1.0, 1.0),
       "white: contact" + (forces.contact_reference() > 0.0
                               ? shown(", longest at %.3g N", forces.contact_reference())
                               : std::string())},
      {has(engine::ContactState::kSlipping), friction_colour(false),
       "orange: friction where it slides" + at_most(forces.friction(false))},
      {has(engine::ContactState::kSticking), friction_colour(true),
       "violet: friction where it sticks" + at_most(forces.friction(true))},
      {is_long, colour(0.9, 0.9, 0.9),
       "labels of the first " + std::to_string(kMost) + " bodies and constraints only"}};
  const double height = height_of_legend_;
  Vector3d place = 0.5 * (extent.low + extent.high);
  place.z() = top_of(world);
  for (const auto& [of, size] : wheels_)  // which may be larger than their bodies
    place.z() = std::max(place.z(), world.anchors(engine::JointId{of}).p_b.z() + size.wheel);
  if (!world.contacts().empty())
    place.z() += forces.contact_length(extent) - forces.contact_thickness();
  place.z() += 2.0 * kLineSpacing * height_ + kLineSpacing * height;
  std::int32_t id = 0;
  for (const Line& line : lines) {
    ++id;
    if (!line.is_used) continue;
    add_text("legend", id, place, line.colour, line.text, height);
    place.z() += kLineSpacing * height;
  }
}

}  // namespace constraint_sim
