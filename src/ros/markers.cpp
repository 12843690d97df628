#include "ros/markers.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "ros/conversions.h"
#include "sim/grip.h"
#include "urdf/contact_exceptions.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using visualization_msgs::Marker;

constexpr double kWidthOfLength = 0.1;  // largest width of a constraint over its length
constexpr double kGap = 0.3;            // gap in a broken constraint over its length
constexpr float kDarkStripe = 0.6F;     // brightness of a rope's dark stripes over its colour
constexpr double kLeastArrow = 0.2;     // shortest arrow of a contact force over the longest
constexpr double kBend = 0.5;           // slope at which both parts of a broken constraint hang
constexpr double kHead = 0.2;           // head of a force's arrow over its length
constexpr double kLeastHead = 0.1;      // shortest head of a friction arrow over the longest arrow
constexpr double kSlender = 0.025;      // width of an arrow over its length

std::int32_t type_of(Look look) {
  if (look == Look::kRod) return Marker::CYLINDER;
  return look == Look::kStrut ? Marker::TRIANGLE_LIST : Marker::LINE_LIST;
}

// Places a marker that points along z: from `from`, along `direction` (unit).
void place_along(const Vector3d& from, const Vector3d& direction, Marker* marker) {
  marker->pose.position = point_at(from);
  marker->pose.orientation = quaternion_of(turn_of_z(direction));
}

inline Vector3d anchor_of(const engine::World& world, engine::BodyId body, const Vector3d& anchor) {
  if (body == engine::kWorldBody) return anchor;
  const engine::BodyState& state = world.state(body);
  if (anchor.x() == 0.0 && anchor.y() == 0.0 && anchor.z() == 0.0) return state.position;
  return state.position + state.orientation * anchor;
}

void place_in_world(Marker* marker) {
  marker->pose = geometry_msgs::Pose();
  marker->pose.orientation.w = 1.0;
}

// Draws a stretchable shape, or only stretches it where it is drawn already.
template <class Draw>
void draw_along(Look look, double length, double radius, ShownMarker* marker, Draw draw) {
  if (!marker->is_drawn_for({1.0 + static_cast<double>(look), radius, 0.0}) ||
      !(marker->drawn_length > 0.0)) {
    marker->points.clear();
    draw(length, radius, &marker->points);
  } else if (length != marker->drawn_length) {
    stretch(length / marker->drawn_length, &marker->points);
  }
  marker->drawn_length = length;
}

std_msgs::ColorRGBA darker(std_msgs::ColorRGBA of) {
  for (float* part : {&of.r, &of.g, &of.b}) *part *= kDarkStripe;
  return of;
}

// Shades a strut by facets of two colours: rviz does not shade markers with own colours.
void shade_strut(ShownMarker* marker) {
  if (marker->colors.size() == marker->points.size() && marker->colors[0] == marker->color) return;
  marker->colors.resize(marker->points.size());
  const std_msgs::ColorRGBA dark = darker(marker->color);
  for (std::size_t i = 0; i < marker->colors.size(); ++i)
    marker->colors[i] = i / 6 % 2 == 1 ? dark : marker->color;
}

// Colours the first lines in stripes, like a rope.
void stripe(std::size_t lines, const std_msgs::ColorRGBA& dark, ShownMarker* marker) {
  marker->colors.resize(marker->points.size(), marker->color);
  for (std::size_t i = 0; i < marker->colors.size(); ++i)
    marker->colors[i] = i / 2 % 2 == 1 && i / 2 < lines ? dark : marker->color;
}

// Adds the circle of a sheave at the point where a rope turns from `down` to `over`.
void add_sheave(const Vector3d& at, const Vector3d& down, const Vector3d& over, double radius,
                Lines* lines) {
  const Vector3d u = radius * (down - at).normalized();
  const Vector3d along = radius * (over - at).normalized();
  const Vector3d v = along - along.dot(u) / std::max(u.squaredNorm(), 1e-300) * u;
  if (!(v.squaredNorm() > 0.0) || !(u.squaredNorm() > 0.0)) return;
  add_circle(at + u + along, u, radius * v.normalized(), lines);
}

// Returns the pose of a convex shape of a body, by the number of the part.
engine::BodyState shape_state(const engine::World& world, engine::BodyId id, std::size_t part) {
  const engine::BodyState& state = world.state(id);
  const engine::ShapePose shape_pose = pose_of_part(world.body(id), part);
  engine::BodyState placed;
  placed.position = state.position + state.orientation * shape_pose.position;
  placed.orientation = state.orientation * shape_pose.orientation;
  return placed;
}

bool is_at(const geometry_msgs::Pose& pose, const engine::BodyState& state) {
  return pose.position.x == state.position.x() && pose.position.y == state.position.y() &&
         pose.position.z == state.position.z() && pose.orientation.x == state.orientation.x() &&
         pose.orientation.y == state.orientation.y() &&
         pose.orientation.z == state.orientation.z() && pose.orientation.w == state.orientation.w();
}

// Returns whether two contacts have the same bodies and normal.
bool is_of_manifold(const engine::Contact& one, const engine::Contact& other) {
  return one.body_a == other.body_a && one.body_b == other.body_b && one.normal == other.normal;
}

// Returns the middle of the sticking contacts, moved against `way` to the last of them.
Vector3d behind_all(const ShownFriction& friction, const Vector3d& way) {
  Vector3d middle = Vector3d::Zero();
  double count = 0.0, last = std::numeric_limits<double>::infinity();
  for (const engine::Contact* each = friction.first; each != friction.end; ++each) {
    if (friction.sticks && each->state != engine::ContactState::kSticking) continue;
    middle += each->position;
    count += 1.0;
    last = std::min(last, way.dot(each->position));
  }
  middle /= count;
  return middle + (last - way.dot(middle)) * way;
}

}  // namespace

const MarkerMessage& Markers::update(const engine::World& world, const ForceScale& forces,
                                     const ros::Time& stamp, bool for_newcomer, bool is_edited) {
  forces_ = &forces;
  set_.begin(stamp, for_newcomer);
  is_edited_ = is_edited || set_.is_full();
  if (is_edited_) find_looks(world);
  for (std::size_t i = 0; i < moving_; ++i) add_body(world, body_looks_[i]);
  for (const JointLook& look : joint_looks_)
    if (look.is_grip)
      add_grip(world, look.id);
    else if (look.is_drawn)
      add_constraint(world, look, stamp);
  add_contacts(world);
  add_fixed(world);
  robots_.add_markers(world, is_edited_, &visuals_);
  for (std::size_t i = moving_; i < body_looks_.size(); ++i) add_body(world, body_looks_[i]);
  forces_ = nullptr;
  return set_.finish();
}

void Markers::find_looks(const engine::World& world) {
  world.body_ids(&body_ids_);
  find_extent(world);
  body_looks_.clear();
  std::int32_t further = 0;
  for (const bool are_static : {false, true}) {
    for (const engine::BodyId id : body_ids_) {
      const engine::Body& body = world.body(id);
      if ((body.type == engine::BodyType::kStatic) != are_static) continue;
      const bool has_pose = body.shape_pose || std::holds_alternative<engine::Compound>(body.shape);
      body_looks_.push_back({id, has_pose, 0, marker_id(id)});
      for (std::size_t part = 1; part < engine::part_count(body.shape); ++part)
        body_looks_.push_back({id, true, part, further++});
    }
    if (!are_static) moving_ = body_looks_.size();
  }
  joint_looks_.clear();
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    JointLook& look = joint_looks_.emplace_back();
    look.id = id;
    look.look = look_of(joint);
    look.is_grip = is_grip(joint);
    look.is_drawn = joint.enabled && !is_contact_exception(joint);
    look.has_motor = shown_motor(joint, world.joint_state(id)).has_value() ||
                     joint.motor.is_moving() ||
                     std::any_of(joint.coordinates.begin(), joint.coordinates.end(),
                                 [](const auto& law) { return law.motor.has_value(); });
    look.size = size_of(world, joint);
    look.has_arm = is_length(look.look) && has_arm_outside(world, joint);
    for (const auto& [body, anchor] :
         {std::pair{joint.body_a, joint.anchor_a}, std::pair{joint.body_b, joint.anchor_b}})
      if (body != engine::kWorldBody) look.arm = std::max(look.arm, anchor.norm());
    if (joint.kind == engine::JointKind::kGear)
      look.touches = find_wheels(world, joint, &coupled_look(joint.coupling.first).size,
                                 &coupled_look(joint.coupling.second).size);
    if (joint.kind != engine::JointKind::kPulley) continue;
    coupled_look(joint.coupling.first).pulley = id;
    JointLook& second = coupled_look(joint.coupling.second);
    second.pulley = id;
    second.tackle = joint.coupling.ratio;
  }
}

// Returns the look of a joint that a later joint couples.
Markers::JointLook& Markers::coupled_look(engine::JointId id) {
  return *std::lower_bound(
      joint_looks_.begin(), joint_looks_.end(), id,
      [](const JointLook& look, engine::JointId of) { return look.id.value < of.value; });
}

// Draws the three springs of a hand as one arrow.
void Markers::add_grip(const engine::World& world, engine::JointId id) {
  const engine::BodyId held = world.joint(id).body_b;
  if (hands_.is_added(marker_id(held))) return;
  Marker& marker = hands_.add(marker_id(held), Marker::LINE_LIST);
  marker.scale.x = 0.4 * extent_.width;
  marker.color = colour(1.0, 1.0, 0.6);
  const Vector3d& from = world.state(held).position;
  const Vector3d way = gripped_target(world, world.body(held).name) - from;
  const double length = way.norm();
  marker.points.clear();
  if (length > 0.0)
    add_arrow(from, way / length, length, std::min(0.3 * extent_.sign, 0.5 * length),
              &marker.points);
}

// Finds the extent of the scene with the first message and when bodies come or go; signs keep their
// size while bodies move.
void Markers::find_extent(const engine::World& world) {
  const std::pair now(body_ids_.size(), body_ids_.empty() ? 0 : marker_id(body_ids_.back()));
  if (extent_.sign > 0.0 && now == extent_of_) return;
  extent_of_ = now;
  extent_ = extent_of(world);
}

// Adds a body; skips one at the pose that subscribers have.
void Markers::add_body(const engine::World& world, const BodyLook& look) {
  std::optional<engine::BodyState> placed;
  if (look.has_shape_pose) placed = shape_state(world, look.id, look.part);
  const engine::BodyState& at = placed ? *placed : world.state(look.id);
  MarkerSet::Namespace& markers = look.part == 0 ? bodies_ : parts_;
  ShownMarker* shown = markers.shown(look.marker);
  if (!is_edited_ && shown != nullptr && is_at(shown->pose, at)) return markers.keep(shown);
  const bool is_new = is_edited_ || shown == nullptr;
  Marker& marker = is_new ? markers.add(look.marker, Marker::CUBE) : markers.send(shown);
  marker.pose.position = point_at(at.position);
  marker.pose.orientation = quaternion_of(at.orientation);
  if (!is_new) return;
  const engine::Body& body = world.body(look.id);
  marker.color = body_colour(body);
  set_shape(&marker, engine::part_of(body.shape, static_cast<int>(look.part)));
  if (std::holds_alternative<engine::Plane>(body.shape))
    marker.scale.x = marker.scale.y = width_around(extent_, at.position);
}

// Returns whether a constraint is drawn. One that breaks while a viewer is connected stays for
// kBrokenShown.
bool Markers::is_drawn(const JointLook& look, bool is_broken, const ros::Time& stamp) {
  const std::int32_t id = marker_id(look.id);
  if (!is_broken) {
    if (!broken_since_.empty()) broken_since_.erase(id);
    return true;
  }
  const bool was_whole = constraints_.shown(id) != nullptr && broken_since_.count(id) == 0;
  if (was_whole) broken_since_[id] = stamp.toSec();
  const auto broke = broken_since_.find(id);
  if (broke == broken_since_.end()) return false;
  if (std::abs(stamp.toSec() - broke->second) < kBrokenShown) return true;
  broken_since_.erase(broke);
  return false;
}

void Markers::add_constraint(const engine::World& world, const JointLook& look,
                             const ros::Time& stamp) {
  const engine::JointState& state = world.joint_state(look.id);
  if ((state.broken || !broken_since_.empty()) && !is_drawn(look, state.broken, stamp)) return;
  const engine::Joint& joint = world.joint(look.id);
  if (look.touches && !(shown_error(look.look, joint, state) > kToldError)) return;
  const double force = look.pulley ? look.tackle * world.joint_state(*look.pulley).force
                                   : axial_force(joint, state).value_or(0.0);
  const Seen seen{marker_id(look.id),
                  look,
                  joint,
                  state,
                  anchor_of(world, joint.body_a, joint.anchor_a),
                  anchor_of(world, joint.body_b, joint.anchor_b),
                  forces_->share(force)};
  const std::optional<ShownMotor> motor =
      look.has_motor && !state.broken ? shown_motor(joint, state) : std::nullopt;
  const bool drives = motor && motor->direction() != 0.0;
  const bool is_in_parts =
      state.broken && look.look != Look::kJoint && look.look != Look::kCoupling;
  ShownMarker& marker =
      constraints_.add(seen.number, is_in_parts ? Marker::LINE_LIST : type_of(look.look));
  marker.scale.x = extent_.width;
  marker.color = state.broken ? broken_colour()
                              : constraint_colour(seen.load, shown_error(look.look, joint, state));
  if (is_in_parts) return draw_parts(seen, &marker);
  switch (look.look) {
    case Look::kCoupling:
      draw_coupling(world, seen, &marker);
      break;
    case Look::kJoint:
      draw_arms(world, seen, &marker);
      if (!state.broken) {
        ShownMarker& sign = joints_.add(seen.number, type_of_sign(joint, look.size));
        draw_joint(world, joint, look.size, seen.p_a, seen.p_b, extent_.width, &sign);
        if (drives && !look.size.wheel_is_on_a) sign.color = motor_colour(state.saturated);
      }
      break;
    default:
      draw_length(world, seen, &marker);
      if (look.has_arm) add_arms_of_length(world, seen);
  }
  if (drives) add_motor(world, seen, *motor);
}

// Draws a gear as a dashed line between its joints, a pulley as a rope between the upper ends of
// its joints with sheaves below.
void Markers::draw_coupling(const engine::World& world, const Seen& seen,
                            ShownMarker* marker) const {
  const engine::Coupling& coupling = seen.joint.coupling;
  marker->scale.x *= 0.5;
  marker->points.clear();
  const auto first = world.anchors(coupling.first), second = world.anchors(coupling.second);
  if (seen.joint.kind != engine::JointKind::kPulley)
    return add_dashes(first.p_b, second.p_b, &marker->points);
  for (int i = 0; i < kRopeParts; ++i) {
    const Vector3d part = (second.p_a - first.p_a) / kRopeParts;
    add_line(first.p_a + i * part, first.p_a + (i + 1) * part, &marker->points);
  }
  add_sheave(first.p_a, first.p_b, second.p_a, 0.3 * extent_.sign, &marker->points);
  add_sheave(second.p_a, second.p_b, first.p_a, 0.3 * extent_.sign, &marker->points);
  stripe(kRopeParts, darker(marker->color), marker);
}

// Adds arms from the centres of the bodies to the ends of a line that lies beside them.
void Markers::add_arms_of_length(const engine::World& world, const Seen& seen) {
  ShownMarker& marker = joints_.add(seen.number, Marker::LINE_LIST);
  marker.scale.x = std::min(extent_.width, kWidthOfLength * seen.look.arm);
  marker.color = constraint_colour(0.0, 0.0);
  marker.points.clear();
  for (const auto& [body, end] :
       {std::pair<engine::BodyId, const Vector3d&>{seen.joint.body_a, seen.p_a},
        std::pair<engine::BodyId, const Vector3d&>{seen.joint.body_b, seen.p_b}})
    if (body != engine::kWorldBody) add_line(world.state(body).position, end, &marker.points);
}

// Adds a cube where each length ends at the world. The cubes stay until an edit.
void Markers::add_fixed(const engine::World& world) {
  if (!is_edited_) {
    if (cubes_ != nullptr) fixed_.keep(cubes_);
    return;
  }
  cubes_ = nullptr;
  const auto is_gone = [&](engine::JointId id) {
    return world.joint_state(id).broken && broken_since_.count(marker_id(id)) == 0;
  };
  for (const JointLook& look : joint_looks_) {
    if (!look.is_drawn || look.is_grip || look.pulley || is_gone(look.id)) continue;
    const engine::Joint& joint = world.joint(look.id);
    if (!is_on_world(joint)) continue;
    if (cubes_ == nullptr) {
      cubes_ = &fixed_.add(0, Marker::CUBE_LIST);
      cubes_->points.clear();
    }
    cubes_->points.push_back(
        point_at(joint.body_a == engine::kWorldBody ? joint.anchor_a : joint.anchor_b));
  }
  if (cubes_ == nullptr) return;
  cubes_->color = fixed_colour();
  const double width = kFixedCube * extent_.width;
  cubes_->scale = to_vector({width, width, width});
}

// Draws both parts of a broken length, bent apart so that a rope along the line hides at most one
// of them.
void Markers::draw_parts(const Seen& seen, ShownMarker* marker) const {
  const Vector3d way = seen.p_b - seen.p_a;
  const Vector3d part = 0.5 * (1.0 - kGap) * way;
  const Vector3d u = kBend * part.norm() * way.unitOrthogonal();
  const Vector3d v = way.normalized().cross(u);
  place_in_world(marker);
  marker->is_drawn_for({-2.0, 0.0, 0.0});
  marker->points.clear();
  const double width = std::min(extent_.width, kWidthOfLength * part.norm());
  marker->scale = to_vector({width, 0.0, 0.0});
  add_line(seen.p_a, seen.p_a + part + u, &marker->points);
  add_line(seen.p_b - part + v, seen.p_b, &marker->points);
}

// Draws a length between the anchors; a larger force makes it thicker.
void Markers::draw_length(const engine::World& world, const Seen& seen, ShownMarker* marker) const {
  const Vector3d way = seen.p_b - seen.p_a;
  const double length = way.norm();
  const double widest = std::min(extent_.width, kWidthOfLength * length);
  const double width = widest * (0.6 + 0.4 * std::abs(seen.load));
  if (seen.look.look == Look::kRope) {
    marker->scale.x = 0.6 * width;
    return draw_rope(world, seen, length, marker);
  }
  if (!(length > 0.0)) {  // nothing visible
    marker->points.clear();
    marker->scale = to_vector(Vector3d::Zero());
    return;
  }
  const bool is_rod = seen.look.look == Look::kRod;  // the origin of a rod is in its middle
  place_along(is_rod ? Vector3d(seen.p_a + 0.5 * way) : seen.p_a, way / length, marker);
  switch (seen.look.look) {
    case Look::kSpring:
      marker->scale.x = 0.4 * width;
      return draw_along(seen.look.look, length, 1.5 * widest, marker, add_coil);
    case Look::kStrut:
      if (!marker->is_drawn_for({1.0, 0.0, 0.0})) add_strut(&marker->points);
      shade_strut(marker);
      marker->scale.x = marker->scale.y = 1.4 * width;
      marker->scale.z = length;
      return;
    default:
      marker->scale.x = marker->scale.y = width;
      marker->scale.z = length;
  }
}

void Markers::draw_rope(const engine::World& world, const Seen& seen, double length,
                        ShownMarker* marker) const {
  const engine::JointState& state = seen.state;
  const bool slack = is_slack(seen.joint, state);
  const engine::DistanceJoint& rope = seen.joint.distance;
  const double natural = rope.one_sided ? rope.length.value_or(0.0) : rope.max_length;
  const double longest = slack ? std::max(natural + state.travel, length) : length;
  const Vector3d way = seen.p_b - seen.p_a;
  if (slack || !(length > 0.0)) {
    if (slack) marker->color = slack_colour();
    place_in_world(marker);
    marker->pose.position = point_at(seen.p_a);
    marker->is_drawn_for({-1.0, 0.0, 0.0});
    set_rope(way, longest, down(world), &marker->points);
  } else {
    place_along(seen.p_a, way / length, marker);
    draw_along(Look::kRope, length, 0.0, marker,
               [](double l, double, Lines* lines) { add_straight(l, lines); });
  }
  stripe(kRopeParts, darker(marker->color), marker);
}

// Draws a joint without length as arms from the centres of the bodies, and its error as a line.
void Markers::draw_arms(const engine::World& world, const Seen& seen, ShownMarker* marker) const {
  Lines& lines = marker->points;
  const auto set = [&](std::size_t line, const Vector3d& from, const Vector3d& to) {
    if (lines.size() < 2 * line + 2) lines.resize(2 * line + 2);
    lines[2 * line] = point_at(from);
    lines[2 * line + 1] = point_at(to);
  };
  std::size_t line = 0;
  const bool is_open =
      !slides(seen.joint.kind) || shown_error(seen.look.look, seen.joint, seen.state) > kToldError;
  set(line++, is_open ? seen.p_a : seen.p_b, seen.p_b);
  if (seen.joint.body_a != engine::kWorldBody)
    set(line++, world.state(seen.joint.body_a).position, seen.p_a);
  if (seen.joint.body_b != engine::kWorldBody)
    set(line++, world.state(seen.joint.body_b).position, seen.p_b);
  if (seen.look.arm > 0.0)
    marker->scale.x = std::min(marker->scale.x, kWidthOfLength * seen.look.arm);
}

// Draws the direction of a motor: apart or together, along the axis or about it.
void Markers::add_motor(const engine::World& world, const Seen& seen, const ShownMotor& motor) {
  const Vector3d &p_a = seen.p_a, &p_b = seen.p_b;
  const bool is_of_joint = seen.look.look == Look::kJoint;
  if (!is_of_joint && p_a == p_b) return;  // no direction
  ShownMarker& marker = motors_.add(seen.number, Marker::LINE_LIST);
  marker.color = motor_colour(seen.state.saturated);
  if (is_of_joint)
    return draw_motor(world, seen.joint, seen.look.size, motor, p_a, p_b, extent_.width, &marker);
  const bool positive = motor.direction() > 0.0;
  const double sign = positive ? 1.0 : -1.0;
  const double distance = (p_b - p_a).norm();
  const Vector3d along = (p_b - p_a) / distance;
  const double length = std::min(extent_.sign, 0.3 * distance);
  marker.scale.x = 0.4 * std::min(extent_.width, kWidthOfLength * distance);
  // beside the line, which would hide the arrows
  place_along(0.5 * (p_a + p_b) + 3.0 * extent_.width * along.unitOrthogonal(), along, &marker);
  if (marker.is_drawn_for({3.0, sign, length})) return;
  for (const double side : {-1.0, 1.0}) {
    const Vector3d from = (positive ? 0.15 : 1.0) * side * length * Vector3d::UnitZ();
    add_arrow(from, sign * side * Vector3d::UnitZ(), 0.85 * length, 0.35 * length, &marker.points);
  }
}

// Adds arrows of the normal forces on the held bodies. The longest arrow is the largest force of
// the last seconds.
void Markers::add_contacts(const engine::World& world) {
  const double most = forces_->contact_reference();
  const double least = kNoForce * most;
  const auto has_force = [least](const engine::Contact& contact) {
    return contact.normal_force > least;
  };
  const std::vector<engine::Contact>& contacts = world.contacts();
  if (!(most > 0.0)) return;
  const auto with_force = std::count_if(contacts.begin(), contacts.end(), has_force);
  if (with_force == 0) return;
  const double longest = forces_->contact_length(extent_);
  const auto add = [&](MarkerSet::Namespace* where, std::int32_t id,
                       const std_msgs::ColorRGBA& of) -> Lines* {
    ShownMarker& marker = where->add(id, Marker::LINE_LIST);
    marker.scale.x = std::max(0.4 * extent_.width, kSlender * longest);
    marker.color = of;
    return &marker.points;
  };
  const double scale = longest / most;
  const Vector3d down = constraint_sim::down(world);
  Lines* normals = add(&contacts_, 0, colour(1.0, 1.0, 1.0));
  normals->resize(kArrowPoints * static_cast<std::size_t>(with_force));
  geometry_msgs::Point* arrow = normals->data();
  const engine::Contact* last = nullptr;
  // Direction of the arrow, and its start from the contact.
  Vector3d way = Vector3d::Zero(), start = Vector3d::Zero();
  for (const engine::Contact& contact : contacts) {
    if (!has_force(contact)) continue;
    if (last == nullptr || !is_of_manifold(contact, *last)) {
      const double sign = sign_of_held(world, contact, down);
      const engine::BodyId held = sign > 0.0 ? contact.body_a : contact.body_b;
      way = sign * contact.normal;
      start = 2.0 * radius_of_ball(world.body(held)) * way;
    }
    last = &contact;
    const double length = std::clamp(scale * contact.normal_force, kLeastArrow * longest, longest);
    write_arrow(contact.position + start, way, length, kHead * length, arrow);
    arrow += kArrowPoints;
  }
  Lines* friction[] = {nullptr, nullptr};
  for_each_friction(contacts, [&](const ShownFriction& shown) {
    const double force = shown.force.norm();
    if (!(scale * force > kLeastFriction * longest)) return;
    Lines*& lines = friction[shown.sticks ? 1 : 0];
    if (lines == nullptr) {
      lines = add(&friction_, shown.sticks ? 1 : 0, friction_colour(shown.sticks));
      lines->clear();
    }
    const double reach = std::min(scale * force, longest);
    const double sign = sign_of_held(world, *shown.first, down);
    const Vector3d way = sign / force * shown.force;
    const engine::BodyId held = sign > 0.0 ? shown.first->body_a : shown.first->body_b;
    const double ball = radius_of_ball(world.body(held));
    const Vector3d place = behind_all(shown, way) + ball * way;
    // The arrow is outside of the held body, which would hide it: it starts or ends at the contact.
    const bool is_inwards = way.dot(world.state(held).position - place) > 0.0;
    add_arrow(is_inwards ? place - reach * way : place, way, reach,
              std::max(kHead * reach, kLeastHead * longest), lines);
  });
}

}  // namespace constraint_sim
