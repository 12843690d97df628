#include "ros/markers.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <variant>
#include <vector>

#include "ros/conversions.h"
#include "sim/grip.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using visualization_msgs::Marker;

constexpr double kBrokenShown = 2.0;     // [s]
constexpr double kAxisLength = 0.3;      // [m] of the axis of a joint, at most
constexpr double kWidthOfLength = 0.1;   // of a constraint: its width, at most
constexpr double kLeastArrow = 0.2;      // of the longest one: that of a small contact force
constexpr double kLeastFriction = 0.02;  // of the longest arrow: less is not drawn

std::int32_t number(engine::BodyId id) { return static_cast<std::int32_t>(id.value); }
std::int32_t number(engine::JointId id) { return static_cast<std::int32_t>(id.value); }

// What is as long as a body, and comes out of a ball that it goes through [m]; 0 of a point or a
// plane.
double length_of_axis_through(const engine::Shape& shape) {
  if (const auto* box = std::get_if<engine::Box>(&shape)) return box->size.maxCoeff();
  if (const auto* sphere = std::get_if<engine::Sphere>(&shape)) return 3.0 * sphere->radius;
  if (const auto* cylinder = std::get_if<engine::Cylinder>(&shape))
    return std::max(3.0 * cylinder->radius, cylinder->length);
  return 0.0;
}

// The axis of a joint is drawn as long as the smaller of its bodies, arm included [m].
double axis_length(const engine::World& world, const engine::Joint& joint) {
  double length = kAxisLength;
  for (const auto& [body, anchor] :
       {std::pair{joint.body_a, joint.anchor_a}, std::pair{joint.body_b, joint.anchor_b}}) {
    if (body == engine::kWorldBody) continue;
    const double size =
        std::max(length_of_axis_through(world.body(body).shape), 2.0 * anchor.norm());
    if (size > 0.0) length = std::min(length, size);
  }
  return length;
}

Eigen::Quaterniond orientation_of(const engine::World& world, const engine::Joint& joint) {
  return world.state(joint.body_a).orientation * joint.frame_a;
}

bool slides_along_axis(engine::JointKind kind) {
  using Kind = engine::JointKind;
  return kind == Kind::kSlider || kind == Kind::kCylindrical || kind == Kind::kPointOnLine ||
         kind == Kind::kScrew;
}

// Along z from the origin to `to`, from `from`.
void place_along(const Vector3d& from, const Vector3d& direction, Marker* marker) {
  marker->pose.position = point_at(from);
  marker->pose.orientation = quaternion_of(turn_of_z(direction));
}

Vector3d anchor_of(const engine::World& world, engine::BodyId body, const Vector3d& anchor) {
  if (body == engine::kWorldBody) return anchor;
  const engine::BodyState& state = world.state(body);
  if (anchor.isZero(0.0)) return state.position;
  return state.position + state.orientation * anchor;
}

void place_in_world(Marker* marker) {
  marker->pose = geometry_msgs::Pose();
  marker->pose.orientation.w = 1.0;
}

// Draws what stretches; what was drawn already is only stretched.
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

Vector3d down(const engine::World& world) {
  const Vector3d& gravity = world.options().gravity;
  return gravity.isZero(0.0) ? Vector3d(-Vector3d::UnitZ()) : gravity.normalized();
}

bool is_at(const geometry_msgs::Pose& pose, const engine::BodyState& state) {
  return pose.position.x == state.position.x() && pose.position.y == state.position.y() &&
         pose.position.z == state.position.z() && pose.orientation.x == state.orientation.x() &&
         pose.orientation.y == state.orientation.y() &&
         pose.orientation.z == state.orientation.z() && pose.orientation.w == state.orientation.w();
}

// Of the force on A: that on the body that is held, which is the one that moves, else the upper
// one.
double sign_of_held(const engine::World& world, const engine::Contact& contact,
                    const Vector3d& down) {
  const bool a_moves = world.body(contact.body_a).type == engine::BodyType::kDynamic;
  const bool b_moves = world.body(contact.body_b).type == engine::BodyType::kDynamic;
  const bool holds_a = a_moves != b_moves ? a_moves : contact.normal.dot(down) <= 0.0;
  return holds_a ? 1.0 : -1.0;
}

}  // namespace

const MarkerMessage& Markers::update(const engine::World& world, const ForceScale& forces,
                                     const ros::Time& stamp, bool for_newcomer, bool is_edited) {
  forces_ = &forces;
  set_.begin(stamp, for_newcomer);
  is_edited_ = is_edited || set_.is_full();
  if (is_edited_) find_looks(world);
  add_bodies(world, false);
  for (const JointLook& look : joint_looks_)
    if (look.is_grip)
      add_grip(world, look.id);
    else if (look.is_drawn)
      add_constraint(world, look, stamp);
  add_contacts(world);
  robots_.add_markers(world, is_edited_, &visuals_);
  add_bodies(world, true);
  forces_ = nullptr;
  return set_.finish();
}

void Markers::find_looks(const engine::World& world) {
  world.body_ids(&body_ids_);
  find_extent(world);
  body_looks_.clear();
  for (const engine::BodyId id : body_ids_) {
    const engine::Body& body = world.body(id);
    body_looks_.push_back(
        {id, body.type == engine::BodyType::kStatic, body.shape_pose.has_value()});
  }
  joint_looks_.clear();
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    JointLook& look = joint_looks_.emplace_back();
    look.id = id;
    look.look = look_of(joint);
    look.is_grip = is_grip(joint);
    look.is_drawn = joint.enabled;
    look.has_motor = shown_motor(joint, world.joint_state(id)).has_value() ||
                     joint.motor.is_moving() ||
                     std::any_of(joint.coordinates.begin(), joint.coordinates.end(),
                                 [](const auto& law) { return law.motor.has_value(); });
    look.axis = axis_length(world, joint);
    for (const auto& [body, anchor] :
         {std::pair{joint.body_a, joint.anchor_a}, std::pair{joint.body_b, joint.anchor_b}})
      if (body != engine::kWorldBody) look.arm = std::max(look.arm, anchor.norm());
  }
}

// The three springs of a hand as one arrow.
void Markers::add_grip(const engine::World& world, engine::JointId id) {
  const engine::BodyId held = world.joint(id).body_b;
  if (hands_.is_added(number(held))) return;
  Marker& marker = hands_.add(number(held), Marker::LINE_LIST);
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

// Signs keep their size while things move: it is found again with the first message and when bodies
// come or go.
void Markers::find_extent(const engine::World& world) {
  const std::pair now(body_ids_.size(), body_ids_.empty() ? 0 : number(body_ids_.back()));
  if (extent_.sign > 0.0 && now == extent_of_) return;
  extent_of_ = now;
  extent_ = extent_of(world);
}

void Markers::add_bodies(const engine::World& world, bool are_static) {
  for (const BodyLook& look : body_looks_)
    if (look.is_static == are_static) add_body(world, look);
}

// What stands where listeners have it is not sent.
void Markers::add_body(const engine::World& world, const BodyLook& look) {
  engine::BodyState placed;
  const engine::BodyState* at = &world.state(look.id);
  if (look.has_shape_pose) {
    const engine::ShapePose& shape_pose = *world.body(look.id).shape_pose;
    placed.position = at->position + at->orientation * shape_pose.position;
    placed.orientation = at->orientation * shape_pose.orientation;
    at = &placed;
  }
  const ShownMarker* shown = bodies_.shown(number(look.id));
  if (!is_edited_ && shown != nullptr && is_at(shown->pose, *at))
    return bodies_.keep(number(look.id));
  const bool is_new = is_edited_ || shown == nullptr;
  const std::int32_t type = is_new ? std::int32_t{Marker::CUBE} : shown->type;
  Marker& marker = bodies_.add(number(look.id), type);
  marker.pose.position = point_at(at->position);
  marker.pose.orientation = quaternion_of(at->orientation);
  if (!is_new) return;
  const engine::Body& body = world.body(look.id);
  marker.color = body_colour(body);
  set_shape(&marker, body.shape);
  if (std::holds_alternative<engine::Plane>(body.shape))
    marker.scale.x = marker.scale.y = width_around(extent_, at->position);
}

// What breaks while somebody looks is seen for kBrokenShown.
bool Markers::is_drawn(const JointLook& look, bool is_broken, const ros::Time& stamp) {
  const std::int32_t id = number(look.id);
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
  const Seen seen{number(look.id),
                  look,
                  joint,
                  state,
                  anchor_of(world, joint.body_a, joint.anchor_a),
                  anchor_of(world, joint.body_b, joint.anchor_b),
                  forces_->share(axial_force(joint, state).value_or(0.0))};
  const bool is_rod = look.look == Look::kRod;
  ShownMarker& marker =
      constraints_.add(seen.number, is_rod ? Marker::CYLINDER : Marker::LINE_LIST);
  marker.scale.x = extent_.width;
  marker.color = constraint_colour(seen.load, shown_error(look.look, state));
  if (state.broken) marker.color = colour(0.6, 0.6, 0.6, 0.6);
  switch (look.look) {
    case Look::kCoupling:
      draw_coupling(world, seen, &marker);
      break;
    case Look::kJoint:
      draw_arms(world, seen, &marker);
      if (!state.broken) add_solid(world, seen);
      break;
    default:
      draw_length(world, seen, &marker);
  }
  if (look.has_motor && !state.broken) add_motor(world, seen);
}

// Dashed, from one of the joints to the other; between the upper ends of ropes, as over a pulley.
void Markers::draw_coupling(const engine::World& world, const Seen& seen,
                            ShownMarker* marker) const {
  const engine::Coupling& coupling = seen.joint.coupling;
  const bool is_pulley = seen.joint.kind == engine::JointKind::kPulley;
  const auto end = [&](engine::JointId id) -> Vector3d {
    return is_pulley ? world.anchors(id).p_a : world.anchors(id).p_b;
  };
  marker->scale.x *= 0.5;
  marker->points.clear();
  add_dashes(end(coupling.first), end(coupling.second), &marker->points);
}

// Between the anchors: the thicker, the larger the force.
void Markers::draw_length(const engine::World& world, const Seen& seen, ShownMarker* marker) const {
  const Vector3d way = seen.p_b - seen.p_a;
  const double length = way.norm();
  const double widest = std::min(extent_.width, kWidthOfLength * length);
  const double width = widest * (0.7 + 0.3 * std::abs(seen.load));
  if (seen.look.look == Look::kRope) {
    marker->scale.x = 0.6 * width;
    return draw_rope(world, seen, length, marker);
  }
  if (!(length > 0.0)) {  // nothing to see
    marker->points.clear();
    marker->scale = to_vector(Vector3d::Zero());
    return;
  }
  place_along(seen.p_a, way / length, marker);
  switch (seen.look.look) {
    case Look::kSpring:
      marker->scale.x = 0.4 * width;
      return draw_along(seen.look.look, length, 1.5 * widest, marker, add_coil);
    case Look::kStrut:
      marker->scale.x = 0.5 * width;
      return draw_along(seen.look.look, length, 1.2 * widest, marker, add_strut);
    default:  // a rod, in its middle
      marker->pose.position = point_at(seen.p_a + 0.5 * way);
      marker->scale.x = marker->scale.y = width;
      marker->scale.z = length;
  }
}

void Markers::draw_rope(const engine::World& world, const Seen& seen, double length,
                        ShownMarker* marker) const {
  const engine::JointState& state = seen.state;
  const bool slack = is_slack(seen.joint, state) && !state.broken;
  const double longest =
      slack ? std::max(seen.joint.distance.max_length + state.travel, length) : length;
  const Vector3d way = seen.p_b - seen.p_a;
  if (slack || !(length > 0.0)) {
    if (slack) marker->color = colour(0.75, 0.68, 0.55);
    place_in_world(marker);
    marker->pose.position = point_at(seen.p_a);
    marker->is_drawn_for({-1.0, 0.0, 0.0});
    set_rope(way, longest, down(world), &marker->points);
  } else {
    place_along(seen.p_a, way / length, marker);
    draw_along(Look::kRope, length, 0.0, marker,
               [](double l, double, Lines* lines) { add_straight(l, lines); });
  }
  // lighter and darker by turns
  const std_msgs::ColorRGBA dark = state.broken ? marker->color : colour(0.35, 0.25, 0.15);
  marker->colors.resize(marker->points.size(), dark);
  for (std::size_t i = 0; i < marker->colors.size(); ++i)
    marker->colors[i] = i / 2 % 2 == 1 ? dark : marker->color;
}

// No length to see: arms from the centres of the bodies, and what the error leaves open.
void Markers::draw_arms(const engine::World& world, const Seen& seen, ShownMarker* marker) const {
  Lines& lines = marker->points;
  const auto set = [&](std::size_t line, const Vector3d& from, const Vector3d& to) {
    if (lines.size() < 2 * line + 2) lines.resize(2 * line + 2);
    lines[2 * line] = point_at(from);
    lines[2 * line + 1] = point_at(to);
  };
  std::size_t line = 0;
  set(line++, seen.p_a, seen.p_b);
  if (seen.joint.body_a != engine::kWorldBody)
    set(line++, world.state(seen.joint.body_a).position, seen.p_a);
  if (seen.joint.body_b != engine::kWorldBody)
    set(line++, world.state(seen.joint.body_b).position, seen.p_b);
  if (seen.look.arm > 0.0)
    marker->scale.x = std::min(marker->scale.x, kWidthOfLength * seen.look.arm);
}

// What turns or slides, where and along what.
void Markers::add_solid(const engine::World& world, const Seen& seen) {
  const engine::Joint& joint = seen.joint;
  const Vector3d &p_a = seen.p_a, &p_b = seen.p_b;
  const double axis = seen.look.axis;
  const double thickness = std::min(extent_.width, kWidthOfLength * axis);
  const auto add = [&](std::int32_t type, const Vector3d& at,
                       const Vector3d& size) -> ShownMarker& {
    ShownMarker& marker = joints_.add(seen.number, type);
    marker.pose.position = point_at(at);
    marker.color = colour(0.8, 0.8, 0.85);
    marker.scale.x = size.x();
    marker.scale.y = size.y();
    marker.scale.z = size.z();
    return marker;
  };
  if (!engine::has_frames(joint.kind)) {
    add(Marker::SPHERE, p_a, Vector3d::Constant(2.0 * thickness));
    return;
  }
  const Eigen::Quaterniond orientation = orientation_of(world, joint);
  ShownMarker* marker = nullptr;
  if (slides_along_axis(joint.kind)) {  // a rail as long as the way that it has been seen to go
    const Vector3d z = orientation * Vector3d::UnitZ();
    const double q = (p_b - p_a).dot(z);
    const auto& law = joint.coordinates[0];
    double low = std::min(q, 0.0), high = std::max(q, 0.0);
    if (law.is_limited() && engine::coordinates(joint.kind) > 0) {
      if (std::isfinite(law.lower)) low = std::min(low, law.lower - law.zero);
      if (std::isfinite(law.upper)) high = std::max(high, law.upper - law.zero);
    }
    const bool is_flat = joint.kind == engine::JointKind::kSlider;
    marker = &add(is_flat ? Marker::CUBE : Marker::CYLINDER, p_a + 0.5 * (low + high) * z,
                  {thickness, thickness, high - low + axis});
  } else if (joint.kind == engine::JointKind::kWeld) {
    marker = &add(Marker::CUBE, p_a, Vector3d::Constant(2.0 * thickness));
  } else if (joint.kind == engine::JointKind::kPlanar ||
             joint.kind == engine::JointKind::kPointOnPlane) {
    marker = &add(Marker::CUBE, p_a, {2.0 * axis, 2.0 * axis, 0.2 * thickness});
    marker->color.a = 0.4F;
  } else {
    marker = &add(Marker::CYLINDER, p_a, {1.5 * thickness, 1.5 * thickness, axis});
  }
  marker->pose.orientation = quaternion_of(orientation);
}

// The direction that a motor drives in: apart or together, along the axis or about it.
void Markers::add_motor(const engine::World& world, const Seen& seen) {
  const std::optional<ShownMotor> motor = shown_motor(seen.joint, seen.state);
  if (!motor || motor->direction() == 0.0) return;
  const Vector3d &p_a = seen.p_a, &p_b = seen.p_b;
  const bool is_of_joint = seen.look.look == Look::kJoint;
  if (!is_of_joint && p_a == p_b) return;  // no direction
  ShownMarker& marker = motors_.add(seen.number, Marker::LINE_LIST);
  marker.color = motor_colour(seen.state.saturated);
  const bool positive = motor->direction() > 0.0;
  const double sign = positive ? 1.0 : -1.0;
  if (is_of_joint) {
    const double axis = seen.look.axis;
    marker.scale.x = 0.5 * std::min(extent_.width, kWidthOfLength * axis);
    marker.pose.position = point_at(motor->is_angle ? p_a : p_b);
    marker.pose.orientation = quaternion_of(orientation_of(world, seen.joint));
    // out of the body that moves, which would hide it
    const double start = motor->is_angle ? 0.0 : radius_of(world.body(seen.joint.body_b).shape);
    if (marker.is_drawn_for({motor->is_angle ? 1.0 : 2.0, sign * axis, start})) return;
    if (motor->is_angle)
      add_turning_arrow(0.5 * axis, positive, &marker.points);
    else
      add_arrow(sign * start * Vector3d::UnitZ(), sign * Vector3d::UnitZ(), axis, 0.3 * axis,
                &marker.points);
    return;
  }
  const double distance = (p_b - p_a).norm();
  const Vector3d along = (p_b - p_a) / distance;
  const double length = std::min(extent_.sign, 0.3 * distance);
  marker.scale.x = 0.4 * std::min(extent_.width, kWidthOfLength * distance);
  // beside the line, which would hide it
  place_along(0.5 * (p_a + p_b) + 3.0 * extent_.width * along.unitOrthogonal(), along, &marker);
  if (marker.is_drawn_for({3.0, sign, length})) return;
  for (const double side : {-1.0, 1.0}) {
    const Vector3d from = (positive ? 0.15 : 1.0) * side * length * Vector3d::UnitZ();
    add_arrow(from, sign * side * Vector3d::UnitZ(), 0.85 * length, 0.35 * length, &marker.points);
  }
}

// On what is held. The longest arrow is the largest force of the last seconds.
void Markers::add_contacts(const engine::World& world) {
  if (world.contacts().empty()) return;
  const auto add = [&](MarkerSet::Namespace* where, const std_msgs::ColorRGBA& of) -> Lines* {
    ShownMarker& marker = where->add(0, Marker::LINE_LIST);
    marker.scale.x = 0.4 * extent_.width;
    marker.color = of;
    marker.points.clear();
    return &marker.points;
  };
  Lines* const normal = add(&contacts_, colour(1.0, 1.0, 1.0));
  Lines* friction = nullptr;
  const double most = forces_->contact_reference();
  const double scale = most > 0.0 ? extent_.sign / most : 0.0;
  const Vector3d down = constraint_sim::down(world);
  for (const engine::Contact& contact : world.contacts()) {
    const double sign = sign_of_held(world, contact, down);
    const double length =
        std::clamp(scale * contact.normal_force, kLeastArrow * extent_.sign, extent_.sign);
    add_arrow(contact.position, sign * contact.normal, length, 0.3 * length, normal);
    if (contact.state == engine::ContactState::kClosed) continue;
    const Vector3d along_surface = contact.force - contact.normal_force * contact.normal;
    const double force = along_surface.norm();
    if (!(scale * force > kLeastFriction * extent_.sign)) continue;
    if (friction == nullptr) friction = add(&friction_, friction_colour());
    const double reach = std::min(scale * force, extent_.sign);
    add_arrow(contact.position, sign / force * along_surface, reach, 0.3 * reach, friction);
  }
}

}  // namespace constraint_sim
