#include "ros/labels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <variant>
#include <vector>

#include "engine/model/shape_properties.h"
#include "ros/conversions.h"
#include "ros/joint_signs.h"
#include "sim/grip.h"
#include "urdf/contact_exceptions.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using visualization_msgs::Marker;

constexpr const char* kNames = "constraint_names";
// Smallest and largest letter height, as a share of the length of arrows.
constexpr double kHeightOfSign = 0.3, kMostHeightOfSign = 0.5;
constexpr double kHeightOfScene = 0.015;  // letter height over the diagonal of the scene
constexpr double kHeightOfLegend =
    0.02;  // letter height of the legend over the diagonal of the scene
constexpr double kShares[] = {
    0.5, 0.7, 0.3};  // places of labels along a line, varied so that neighbours do not overlap
constexpr double kOfLegs[] = {0.2, 0.4};  // places of labels along standing lines, from their feet
constexpr double kLineSpacing = 1.4;
constexpr double kAhead = 0.3;       // time for which the motion is extrapolated [s]
constexpr double kMostGrowth = 2.0;  // largest growth of letters with the motion
// Lengths in heights of a letter.
constexpr double kAbove = 0.9;  // distance of a part from the middle of the text above
// Lengths in widths of a space, which rviz draws as wide as an A.
constexpr double kLetter = 0.8;
constexpr double kBeside = 1.6;         // distance of a line from the text beside it
constexpr double kWidthOfLetter = 0.7;  // width of a space over the height of a letter

const std_msgs::ColorRGBA kOffColour = colour(1.0, 0.5, 0.45);  // light, since letters are thin

std::string shown(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Formats a value with its sign, and zero without one.
std::string signed_value(double value) { return shown(value == 0.0 ? "%.3g" : "%+.3g", value); }

std::string newtons(double force) {
  return force < 1e3 ? shown("%.3g N", force) : shown("%.3g kN", 1e-3 * force);
}

// Pads a text with spaces so that it stands beside a line. rviz centres texts about their place, so
// as many spaces as the text is wide, put before it, move it to the right in every view.
std::string beside(const std::string& text, bool is_left = false) {
  const auto spaces = static_cast<double>(std::count(text.begin(), text.end(), ' '));
  const double width = kLetter * (static_cast<double>(text.size()) - spaces) + spaces;
  const std::string space(static_cast<std::size_t>(std::lround(width + 2.0 * kBeside)), ' ');
  return is_left ? text + space : space + text;
}

bool is_fixed(const engine::World& world, engine::BodyId id) {
  return id == engine::kWorldBody || world.body(id).type == engine::BodyType::kStatic;
}

// Returns the fixed end of a length between a fixed and a moving body.
std::optional<Vector3d> fixed_end(const engine::World& world, engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  const bool is_a = is_fixed(world, joint.body_a);
  if (!is_length(look_of(joint)) || is_a == is_fixed(world, joint.body_b)) return std::nullopt;
  return is_a ? world.anchors(id).p_a : world.anchors(id).p_b;
}

// Returns whether a line stands on that end rather than lies.
bool stands(const engine::World::Anchors& anchors, const Vector3d& end) {
  const double rise = anchors.p_a.z() + anchors.p_b.z() - 2.0 * end.z();
  return rise > 0.5 * (anchors.p_b - anchors.p_a).norm();
}

Vector3d place_of(const engine::World& world, engine::JointId id, bool is_broken) {
  const engine::Joint& joint = world.joint(id);
  if (engine::info(joint.kind).couples_joints) {
    const auto& first = world.anchors(joint.coupling.first);
    const auto& second = world.anchors(joint.coupling.second);
    const bool is_pulley = joint.kind == engine::JointKind::kPulley;  // drawn between upper ends
    return is_pulley ? 0.5 * (first.p_a + second.p_a) : 0.5 * (first.p_b + second.p_b);
  }
  const auto& anchors = world.anchors(id);
  double share = kShares[id.value % 3];  // parallel lines are often added one after the other
  if (is_broken)
    share = 0.5;  // a broken line has its gap in the middle
  else if (const auto foot =
               fixed_end(world, id))  // feet of standing lines are farther apart than their tops
    share = *foot == anchors.p_a ? kOfLegs[id.value % 2] : 1.0 - kOfLegs[id.value % 2];
  return (1.0 - share) * anchors.p_a + share * anchors.p_b;
}

// Returns the reason why a motor is saturated.
std::string limit_of_motor(const engine::Joint& joint, const engine::JointState& state,
                           const ShownMotor& motor) {
  if (engine::if_distance(joint) != nullptr) {
    const double most = joint.motor.max_force;
    if (most > 0.0 && std::abs(state.force) > 0.99 * most)
      return ", at its limit of " + newtons(most);
    return ", at its end";  // no length is left
  }
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i) {
    const auto& own = joint.coordinates[static_cast<std::size_t>(i)].motor;
    if (!own || own->max_force == 0.0 || engine::info(joint.kind).is_angle[i] != motor.is_angle)
      continue;
    return ", at its limit of " +
           (motor.is_angle ? shown("%.3g N m", own->max_force) : newtons(own->max_force));
  }
  return ", at its limit";
}

// Returns the limits that hold a strut or coordinates; a taut rope shows by its line.
std::vector<std::string> limits_reached(const engine::Joint& joint, const engine::JointState& state,
                                        Look look) {
  std::vector<std::string> reached;
  const auto add = [&](bool is_upper, double limit, const char* format) {
    reached.push_back((is_upper ? "at upper limit " : "at lower limit ") + shown(format, limit));
  };
  if (const engine::DistanceJoint* distance = engine::if_distance(joint)) {
    if (look != Look::kStrut || state.force == 0.0) return reached;
    const bool is_upper = state.force < 0.0;
    add(is_upper, (is_upper ? distance->max_length : distance->min_length) + state.travel,
        "%.3g m");
    return reached;
  }
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const engine::CoordinateLaw& law = joint.coordinates[at];
    const char* const format = engine::info(joint.kind).is_angle[i] ? "%.3g rad" : "%.3g m";
    const double q = state.coordinates[at].position;
    if (q < law.lower + kToldError) add(false, law.lower, format);
    if (q > law.upper - kToldError) add(true, law.upper, format);
  }
  return reached;
}

/// Height of the label of a body above the centre of its shape [m]; depends on the orientation for
/// compounds only.
struct HeightOfLabel {
  const engine::Body& body;
  const engine::BodyState& state;

  double operator()(const engine::Point&) const { return 0.0; }
  double operator()(const engine::Sphere& sphere) const { return sphere.radius; }
  double operator()(const engine::Box& box) const { return 0.5 * box.size.maxCoeff(); }
  double operator()(const engine::Plane&) const { return 0.0; }
  double operator()(const engine::Cylinder& cylinder) const {
    return std::max(cylinder.radius, 0.5 * cylinder.length);
  }
  double operator()(const engine::Hull& hull) const { return hull.surface->radius(); }
  double operator()(const engine::Capsule& capsule) const {
    return capsule.radius + 0.5 * capsule.length;
  }
  double operator()(const engine::Compound&) const {
    return half_width(body, state, Vector3d::UnitZ());
  }
};

// Returns the top of bodies and joints [m]; an extent would include the spheres around bodies.
double top_of(const engine::World& world) {
  double top = -std::numeric_limits<double>::infinity();
  for (const engine::BodyId id : world.body_ids()) {
    const engine::Body& body = world.body(id);
    if (engine::is_half_space(body.shape)) continue;
    const engine::BodyState& state = world.state(id);
    top = std::max(top, middle_of(body, state).z() + half_width(body, state, Vector3d::UnitZ()));
  }
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (engine::info(joint.kind).couples_joints || is_grip(joint)) continue;
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
  cube_ = 0.5 * kFixedCube * extent.width;
  height_ = larger * std::clamp(kHeightOfScene * extent.diagonal(), kHeightOfSign * extent.sign,
                                kMostHeightOfSign * extent.sign);
  height_of_legend_ = std::max(height_, larger * kHeightOfLegend * extent.diagonal());
  std::vector<engine::BodyId> bodies = world.body_ids();
  bodies.resize(std::min(bodies.size(), kMost));
  for (const engine::BodyId id : bodies) {
    const engine::Body& body = world.body(id);
    Vector3d place = middle_of(body, world.state(id));
    place.z() += std::visit(HeightOfLabel{body, world.state(id)}, body.shape);
    place.z() += height_;
    add_text("body_names", marker_id(id), place, colour(0.9, 0.9, 0.9), body.name);
  }
  find_all_wheels(world);
  find_broken(world, stamp.toSec());
  blocks_.clear();
  top_ = -std::numeric_limits<double>::infinity();
  const std::vector<engine::JointId>& joints = world.joint_ids();
  for (std::size_t i = 0; i < std::min(joints.size(), kMost); ++i)
    if (world.joint(joints[i]).enabled && !is_grip(world.joint(joints[i])) &&
        !is_contact_exception(world.joint(joints[i])) &&
        (!world.joint_state(joints[i]).broken || shows_broken(joints[i])))
      add_labels_of(world, forces, joints[i]);
  add_legend(world, forces);
  return set_.finish();
}

void Labels::forget() {
  set_.forget();
  seen_.reset();
  broke_.reset();
}

// Notes when constraints broke, since markers show those for a while.
void Labels::find_broken(const engine::World& world, double now) {
  now_ = now;
  const double since = broke_ ? now : -std::numeric_limits<double>::infinity();
  if (!broke_) broke_.emplace();
  for (const engine::JointId id : world.joint_ids())
    if (world.joint_state(id).broken)
      broke_->try_emplace(id.value, since);
    else
      broke_->erase(id.value);
}

bool Labels::shows_broken(engine::JointId id) const {
  const auto found = broke_->find(id.value);
  return found != broke_->end() && std::abs(now_ - found->second) < kBrokenShown;
}

// Returns the growth of letters: a viewer stands far enough away to see all of the motion.
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

// Returns the size of the sign, with its wheel where a gear couples the joint.
JointSize Labels::size_in_gear(const engine::World& world, engine::JointId id) const {
  const auto found = wheels_.find(id.value);
  return found != wheels_.end() ? found->second : size_of(world, world.joint(id));
}

void Labels::find_all_wheels(const engine::World& world) {
  wheels_.clear();
  touch_.clear();
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (joint.kind != engine::JointKind::kGear) continue;
    const auto size = [&](engine::JointId of) -> JointSize& {
      return wheels_.try_emplace(of.value, size_of(world, world.joint(of))).first->second;
    };
    JointSize& first = size(joint.coupling.first);
    if (find_wheels(world, joint, &first, &size(joint.coupling.second))) touch_.insert(id.value);
  }
}

// Returns the lines of a label from top to bottom.
std::vector<Labels::Line> Labels::lines_of(const engine::World& world, const ForceScale& forces,
                                           engine::JointId id) const {
  const engine::Joint& joint = world.joint(id);
  const engine::JointState& state = world.joint_state(id);
  const Look look = look_of(joint);
  if (state.broken) {
    const std::string beyond =
        joint.break_force > 0.0 ? " beyond " + newtons(joint.break_force) : std::string();
    return {{"forces", colour(0.8, 0.8, 0.8), "broke" + beyond}};
  }
  std::vector<Line> lines;
  const std::string rope = look == Look::kRope || look == Look::kCoupling ? "rope " : "";
  if (is_slack(joint, state))
    lines.push_back({"forces", slack_colour(), "slack rope"});
  else if (const auto force = axial_force(joint, state))
    lines.push_back(
        {"forces", constraint_colour(forces.share(*force), 0.0), rope + newtons(std::abs(*force))});
  if (const auto motor = shown_motor(joint, state)) {
    std::string told = motor->force != 0.0
                           ? signed_value(motor->force) + (motor->is_angle ? " N m" : " N")
                           : signed_value(motor->rate) + (motor->is_angle ? " rad/s" : " m/s");
    if (look == Look::kJoint)
      told = world.body(joint.body_b).name + " " + told;
    else  // no force: it would be taken for that of the arrows
      told =
          (motor->rate < 0.0 ? "shortens " : "extends ") + shown("%.3g m/s", std::abs(motor->rate));
    if (state.saturated) told += limit_of_motor(joint, state, *motor);
    lines.push_back({"motor_rates", motor_colour(false), told});
  }
  for (const std::string& limit : limits_reached(joint, state, look))
    lines.push_back({"limits", colour(0.9, 0.9, 0.9), limit});
  if (const double error = shown_error(look, joint, state); error > kToldError)
    lines.push_back(
        {"errors", kOffColour, shown("off by %.2g m", error) + (state.closing ? ", closing" : "")});
  lines.insert(lines.begin(),
               {kNames, colour(0.8, 0.9, 0.8), joint.name});  // the shipped configuration hides it
  return lines;
}

// Places labels: above the standing end of a length, else beside its line; above the axis of a
// joint, or above the tip of its motor's arrow.
void Labels::add_labels_of(const engine::World& world, const ForceScale& forces,
                           engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  const Look look = look_of(joint);
  const std::vector<Line> lines = lines_of(world, forces, id);
  const double line = kLineSpacing * height_;
  const double rise = static_cast<double>(lines.size() - 1) * line;
  const auto motor = shown_motor(joint, world.joint_state(id));
  const bool is_broken = world.joint_state(id).broken;
  std::optional<Vector3d> end = fixed_end(world, id);
  const bool is_level =
      world.options().gravity.isZero(0.0);  // without gravity a scene may be seen from above
  if (is_broken || is_level || (end && stands(world.anchors(id), *end))) end.reset();
  const bool is_beside = is_broken || (is_length(look) && !end);
  const bool is_left = id.value % 2 == 1;  // neighbours are on both sides
  Vector3d place = place_of(world, id, is_broken);
  if (look == Look::kJoint)
    place = end_of_sign(world, joint, size_in_gear(world, id), motor, world.anchors(id).p_a,
                        world.anchors(id).p_b, Vector3d::UnitZ());
  if (joint.kind == engine::JointKind::kGear)  // below both joints, whose own labels are above them
    for (const engine::JointId of : {joint.coupling.first, joint.coupling.second}) {
      const Vector3d low =
          end_of_sign(world, world.joint(of), size_in_gear(world, of), std::nullopt,
                      world.anchors(of).p_a, world.anchors(of).p_b, -Vector3d::UnitZ());
      place.z() = std::min(place.z(), low.z() - 2.0 * kAbove * height_);
    }
  if (is_beside) {
    // The line of the joint passes between the name and the next line of text.
    place.z() += is_broken ? 0.0 : line;
  } else if (end) {
    place = free_place(lines, *end);
  } else {
    place.z() += kAbove * height_ + rise;
  }
  for (const Line& each : lines) {
    add_text(each.ns, marker_id(id), place, each.colour,
             is_beside ? beside(each.text, is_left) : each.text);
    top_ = std::max(top_, place.z());
    place.z() -= line;
  }
}

// Returns the place of the first line above an end, farther up where other labels are. The name is
// left out: the shipped configuration hides it, so it may overlap others.
Vector3d Labels::free_place(const std::vector<Line>& lines, const Vector3d& end) {
  const double line_height = kLineSpacing * height_;
  const double height = static_cast<double>(lines.size() - 1) * line_height;
  Block block{end, 0.0, 0.0, 0.0};
  for (const Line& line : lines)
    if (line.ns != kNames)
      block.half = std::max(block.half, 0.5 * kLetter * height_ * kWidthOfLetter *
                                            static_cast<double>(line.text.size()));
  block.low = end.z() + cube_ + kAbove * height_ - 0.5 * line_height;
  const auto hides = [&](const Block& other) {
    return (other.end - block.end).head<2>().norm() < block.half + other.half &&
           block.low < other.high - 1e-9 && other.low < block.low + height - 1e-9;
  };
  for (auto other = blocks_.begin(); other != blocks_.end();)
    if (hides(*other)) {
      block.low = other->high;
      other = blocks_.begin();
    } else {
      ++other;
    }
  block.high = block.low + height;
  blocks_.push_back(block);
  return {end.x(), end.y(), block.high + 0.5 * line_height};
}

void Labels::add_text(const char* ns, std::int32_t id, const Vector3d& place,
                      const std_msgs::ColorRGBA& colour, const std::string& text, double height) {
  Marker& marker = set_.in(ns).add(id, Marker::TEXT_VIEW_FACING);
  marker.pose.position = to_point(place);
  marker.scale.z = height > 0.0 ? height : height_;
  marker.color = colour;
  marker.text = text;
}

// Signs to be explained in the legend, and the largest present forces [N].
struct Labels::Told {
  bool is_unloaded = false, has_arms = false, has_gears = false, has_signs = false,
       has_motors = false, is_limited = false, has_fixed = false, is_off = false, is_broken = false;
  double tension = 0.0, compression = 0.0, normal = 0.0;
  double friction[2] = {0.0, 0.0};  // slipping, and sticking
};

Labels::Told Labels::told(const engine::World& world, const ForceScale& forces) const {
  Told told;
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    const engine::JointState& state = world.joint_state(id);
    if (!joint.enabled || is_grip(joint) || is_contact_exception(joint)) continue;
    if (state.broken) {
      told.is_broken = told.is_broken || shows_broken(id);
      told.has_fixed = told.has_fixed || (shows_broken(id) && is_on_world(joint));
      continue;
    }
    const Look look = look_of(joint);
    const auto motor = shown_motor(joint, state);
    const bool drives = motor && motor->direction() != 0.0;
    told.has_motors = told.has_motors || drives;
    told.is_limited = told.is_limited || (drives && state.saturated);
    told.has_fixed = told.has_fixed || is_on_world(joint);
    told.is_off = told.is_off || shown_error(look, joint, state) > kToldError;
    told.has_signs = told.has_signs || (look == Look::kJoint && !drives);
    told.has_arms = told.has_arms || (look != Look::kCoupling && has_arm_outside(world, joint));
    told.has_gears =
        told.has_gears || (joint.kind == engine::JointKind::kGear && touch_.count(id.value) == 0);
    const auto force = axial_force(joint, state);
    if (!force || is_slack(joint, state)) continue;
    const double share = forces.share(*force);
    if (share < -kLeastLoad) told.tension = std::max(told.tension, -*force);
    if (share > kLeastLoad) told.compression = std::max(told.compression, *force);
    told.is_unloaded = told.is_unloaded || std::abs(share) <= kLeastLoad;
  }
  const double most = forces.contact_reference();
  if (!(most > 0.0)) return told;
  for (const engine::Contact& contact : world.contacts())
    if (contact.normal_force > kNoForce * most)
      told.normal = std::max(told.normal, contact.normal_force);
  for_each_friction(world.contacts(), [&](const ShownFriction& friction) {
    const double force = friction.force.norm();
    double& largest = told.friction[friction.sticks ? 1 : 0];
    if (force > kLeastFriction * most) largest = std::max(largest, force);
  });
  return told;
}

// Adds the legend above the scene: one line for each sign in use, in its colour.
void Labels::add_legend(const engine::World& world, const ForceScale& forces) {
  const Extent extent = extent_of(world);
  struct Entry {
    bool is_used;
    std_msgs::ColorRGBA colour;
    std::string text;
  };
  const Told now = told(world, forces);
  const auto at_most = [](double force) { return ", at most " + newtons(force); };
  std::string green;
  const auto add_green = [&](bool is_used, const char* what) {
    if (is_used) green += (green.empty() ? "green: " : "; ") + std::string(what);
  };
  add_green(now.is_unloaded, "no force");
  add_green(now.has_arms, "arms of bodies to joints");
  add_green(now.has_gears, "dashed: gears");
  const bool has_friction = now.friction[0] > 0.0 || now.friction[1] > 0.0;
  const bool is_long = world.body_ids().size() > kMost || world.joint_ids().size() > kMost;
  const Entry entries[] = {
      {now.is_off, kOffColour, "red: off by 0.1 to 10 mm or more"},
      {!green.empty(), constraint_colour(0.0, 0.0), green},
      {now.has_signs, colour(0.8, 0.8, 0.85), "light grey: joints, their axes and rails"},
      {now.has_fixed, fixed_colour(), "small cubes: fixed to the world"},
      {now.is_broken, broken_colour(), "grey, in two parts: broken"},
      {now.compression > 0.0, constraint_colour(1.0, 0.0),
       "yellow: compression" + at_most(now.compression)},
      {now.tension > 0.0, constraint_colour(-1.0, 0.0), "cyan: tension" + at_most(now.tension)},
      {now.has_motors, motor_colour(false),
       now.is_limited ? "pink: motors, which way they move; dark at their limit"
                      : "pink: motors, which way they move"},
      {now.normal > 0.0, colour(1.0, 1.0, 1.0),
       "white: contact forces" + at_most(now.normal) + (has_friction ? ", friction to scale" : "")},
      {now.friction[0] > 0.0, friction_colour(false),
       "orange: friction where it slides" + at_most(now.friction[0])},
      {now.friction[1] > 0.0, friction_colour(true),
       "violet: friction where it sticks, in sum" + at_most(now.friction[1]).substr(1)},
      {is_long, colour(0.9, 0.9, 0.9),
       "labels of the first " + std::to_string(kMost) + " bodies and constraints only"}};
  const double height = height_of_legend_;
  Vector3d place = 0.5 * (extent.low + extent.high);
  place.z() = top_of(world);
  for (const auto& [of, size] : wheels_)  // wheels may be larger than their bodies
    place.z() = std::max(place.z(), world.anchors(engine::JointId{of}).p_b.z() + size.wheel);
  if (now.normal > 0.0) place.z() += forces.contact_reach(extent);
  place.z() = std::max(place.z() + kLineSpacing * height_, top_) + kLineSpacing * height;
  std::int32_t id = 0;
  for (const Entry& entry : entries) {
    ++id;
    if (!entry.is_used) continue;
    add_text("legend", id, place, entry.colour, entry.text, height);
    place.z() += kLineSpacing * height;
  }
}

}  // namespace constraint_sim
