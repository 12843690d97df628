#include "ros/joint_signs.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "engine/math/numbers.h"
#include "ros/conversions.h"
#include "ros/marker_lines.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using engine::JointKind;
using visualization_msgs::Marker;

constexpr double kAxisLength = 0.3;         // largest length of a joint's axis [m]
constexpr double kSignWidthOfLength = 0.1;  // largest width of a sign's lines over its length
constexpr double kOut =
    0.2;  // part of the axis that stands out of the body at each end, over the axis
constexpr double kRing = 0.7;         // radius of a motor's ring around the body, over the axis
constexpr double kAroundWheel = 1.2;  // radius of a motor's ring around a wheel, over the wheel
constexpr double kSmallWheel = 0.5;   // radius of a wheel that touches no other, over the axis
constexpr double kHeadOfRing = 1.2;   // end of the ring's arrow head, over the ring's radius
constexpr double kSlant = 0.45;       // sine of the angle at which scenes are seen from above
constexpr double kLevel = 0.1;        // sine of the slope of an axis that counts as level
constexpr double kNearer = 0.1;       // difference that counts as nearer, over the axis
constexpr double kWeld = 0.4;    // half edge of the cube whose diagonals show a weld, over the axis
constexpr double kThread = 2.4;  // diameter of a screw's thread over the lines' width
using engine::kPi;
constexpr int kTeethOfSmaller = 12;
constexpr int kMostTeeth = 60;
constexpr double kMostWheel = 3.0;  // largest radius of a wheel over the axis
constexpr double kParallel = 0.99;  // cosine between the axes of wheels that touch

/// Length of an axis through a shape [m]: as long as a box, and standing out of a ball. 0 for
/// points and planes.
struct LengthOfAxis {
  double operator()(const engine::Point&) const { return 0.0; }
  double operator()(const engine::Sphere& sphere) const { return 3.0 * sphere.radius; }
  double operator()(const engine::Box& box) const { return box.size.maxCoeff(); }
  double operator()(const engine::Plane&) const { return 0.0; }
  double operator()(const engine::Cylinder& cylinder) const {
    return std::max(3.0 * cylinder.radius, cylinder.length);
  }
  double operator()(const engine::Hull& hull) const { return 2.0 * hull.surface->radius(); }
  double operator()(const engine::Capsule& capsule) const {
    return capsule.length + 3.0 * capsule.radius;
  }
  double operator()(const engine::Compound& compound) const { return 2.0 * radius_of(compound); }
};

bool slides_along_axis(JointKind kind) {
  return kind == JointKind::kSlider || kind == JointKind::kCylindrical ||
         kind == JointKind::kPointOnLine || kind == JointKind::kScrew;
}

bool is_on_sheet(JointKind kind) {
  return kind == JointKind::kPlanar || kind == JointKind::kPointOnPlane;
}

bool has_rack(const JointSize& size) { return size.tooth > 0.0 && !(size.wheel > 0.0); }

// Finds how far the smaller body reaches along the axis: the larger one does not hide the sign.
void find_reach(const engine::World& world, const engine::Joint& joint, JointSize* size) {
  const Vector3d z = orientation_of(world, joint) * Vector3d::UnitZ();
  double least = -1.0;
  for (const auto& [id, anchor] :
       {std::pair{joint.body_b, joint.anchor_b}, std::pair{joint.body_a, joint.anchor_a}}) {
    // The sign of a sliding joint moves with one body, so only that body limits its size.
    if (id == engine::kWorldBody || (least >= 0.0 && slides_along_axis(joint.kind))) continue;
    const engine::Body& body = world.body(id);
    const engine::BodyState& state = world.state(id);
    const Vector3d middle = middle_of(body, state) - (state.position + state.orientation * anchor);
    const double half = half_width(body, state, z);
    if (least >= 0.0 && half >= least) continue;
    least = half;
    size->before = std::max(half - middle.dot(z), 0.0);
    size->behind = std::max(half + middle.dot(z), 0.0);
  }
}

// Returns how far the smaller body reaches above a place [m].
double top_above(const engine::World& world, const engine::Joint& joint, const Vector3d& place,
                 const Vector3d& up) {
  double least = -1.0, top = 0.0;
  for (const engine::BodyId id : {joint.body_b, joint.body_a}) {
    if (id == engine::kWorldBody) continue;
    const engine::BodyState& state = world.state(id);
    const engine::Body& body = world.body(id);
    const double size = radius_of(body.shape);
    if (least >= 0.0 && size >= least) continue;
    least = size;
    top = half_width(body, state, up) + (middle_of(body, state) - place).dot(up);
  }
  return top;
}

// Makes a wheel of this radius [m].
void set_teeth(double radius, double tooth, JointSize* size) {
  size->wheel = radius;
  size->touches = true;
  size->tooth = tooth;
  size->teeth =
      std::clamp(static_cast<int>(std::lround(2.0 * kPi * radius / tooth)), 3, kMostTeeth);
}

struct Wheel {
  const engine::Joint& joint;
  JointSize* size;
  Vector3d place, axis;
  bool turns;
};

Wheel wheel_of(const engine::World& world, engine::JointId id, JointSize* size) {
  const engine::Joint& joint = world.joint(id);
  const Vector3d axis = engine::info(joint.kind).has_frames
                            ? Vector3d(orientation_of(world, joint) * Vector3d::UnitZ())
                            : Vector3d(Vector3d::Zero());
  return {joint, size, world.anchors(id).p_b, axis, joint.kind == JointKind::kHinge};
}

// Returns the radii of two wheels that touch and whose angles follow the ratio; none where there
// are no such wheels.
std::optional<std::pair<double, double>> radii(const Wheel& a, const Wheel& b, double ratio) {
  if (std::abs(a.axis.dot(b.axis)) < kParallel) return std::nullopt;
  const Vector3d way = b.place - a.place;
  const double distance = (way - way.dot(a.axis) * a.axis).norm();
  // One angle counts the carrier's rotation where the wheels are on opposite sides.
  const double sense = (a.size->wheel_is_on_a != b.size->wheel_is_on_a ? -1.0 : 1.0) *
                       (a.axis.dot(b.axis) > 0.0 ? 1.0 : -1.0);
  const double sum = std::abs(1.0 + sense * ratio);
  const double one = distance / sum, other = std::abs(ratio) * one;
  if (!(one > 0.0) || !std::isfinite(one) || one > kMostWheel * a.size->axis || !(other > 0.0) ||
      other > kMostWheel * b.size->axis)
    return std::nullopt;
  return std::pair(one, other);
}

// Makes a wheel whose radius `metres` is the rack's travel per radian, and the rack at its teeth.
// Returns false where they cannot touch.
bool find_rack(const engine::World& world, const Wheel& wheel, const Wheel& rack, double metres) {
  if (!(metres > 0.0) || metres > kMostWheel * wheel.size->axis) return false;
  const Vector3d way = wheel.place - rack.place;
  const Vector3d across = way - way.dot(rack.axis) * rack.axis;
  const double distance = across.norm();
  if (!(distance > 0.0)) return false;
  set_teeth(metres, 2.0 * kPi * metres / kTeethOfSmaller, wheel.size);
  rack.size->tooth = wheel.size->tooth;
  rack.size->rack =
      orientation_of(world, rack.joint).conjugate() * ((1.0 - metres / distance) * across);
  return true;
}

// Draws the axle and a toothed wheel. A wheel that touches another one is in the middle of the body
// and stands out of it; any other is a small wheel with a spoke on both sides.
void add_wheels(const JointSize& size, Lines* lines) {
  const double out = kOut * size.axis;
  add_line({0.0, 0.0, -size.before - out}, {0.0, 0.0, size.behind + out}, lines);
  const double depth = std::min(0.4 * size.tooth, 0.3 * size.wheel);
  if (size.touches)
    return add_toothed_wheel(size.wheel, depth, size.teeth, 0.5 * (size.behind - size.before),
                             lines);
  for (const double z : {-size.before - 0.1 * size.axis, size.behind + 0.1 * size.axis}) {
    add_toothed_wheel(size.wheel, depth, size.teeth, z, lines);
    add_line({0.0, 0.0, z}, {size.wheel - 0.5 * depth, 0.0, z}, lines);
  }
}

// Draws a rod with teeth towards the wheel, on the sliding body.
void draw_rack(const JointSize& size, const Vector3d& p_b, ShownMarker* marker) {
  marker->pose.position = point_at(p_b);
  marker->scale.x *= 0.5;
  if (marker->is_drawn_for({size.tooth, size.before, size.behind})) return;
  const double out = kOut * size.axis;
  add_line({0.0, 0.0, -size.before - out}, {0.0, 0.0, size.behind + out}, &marker->points);
  add_teeth(size.rack - size.before * Vector3d::UnitZ(),
            size.rack + size.behind * Vector3d::UnitZ(), -0.4 * size.tooth * size.rack.normalized(),
            size.tooth, &marker->points);
}

// Returns the ends of the rail along z [m], with the parts that stand out of the body.
std::pair<double, double> rail(const engine::Joint& joint, const JointSize& size, double q) {
  const auto& law = joint.coordinates[0];
  double low = std::min(q, 0.0), high = std::max(q, 0.0);
  if (law.is_limited() && engine::info(joint.kind).coordinates > 0) {
    if (std::isfinite(law.lower)) low = std::min(low, law.lower - law.zero);
    if (std::isfinite(law.upper)) high = std::max(high, law.upper - law.zero);
  }
  const double out = kOut * size.axis;
  return {low - std::max(0.5 * size.axis, size.before + out),
          high + std::max(0.5 * size.axis, size.behind + out)};
}

void set_scale(double x, double y, double z, Marker* marker) {
  marker->scale.x = x;
  marker->scale.y = y;
  marker->scale.z = z;
}

void draw_rail(const engine::Joint& joint, const JointSize& size, const Vector3d& p_a,
               const Vector3d& p_b, const Vector3d& z, double thickness, ShownMarker* marker) {
  const auto [low, high] = rail(joint, size, (p_b - p_a).dot(z));
  if (joint.kind == JointKind::kScrew) {
    marker->pose.position = point_at(p_a + low * z);
    set_scale(0.5 * kThread * thickness, 0.5 * kThread * thickness, high - low, marker);
    const bool is_right = joint.pitch > 0.0;
    if (!marker->is_drawn_for({1.0, is_right ? 1.0 : 0.0, 0.0}))
      add_thread(is_right, &marker->points);
    return;
  }
  marker->pose.position = point_at(p_a + 0.5 * (low + high) * z);
  set_scale(thickness, thickness, high - low, marker);
}

double radius_of_ring(const JointSize& size) {
  return std::max(kRing * size.axis, size.wheel_is_on_a ? 0.0 : kAroundWheel * size.wheel);
}

// Returns the place of a motor's ring along the axis: outside the body, at the end nearer to the
// joint, or else at the upper end.
double height_of_ring(const engine::World& world, const engine::Joint& joint,
                      const JointSize& size) {
  const double upright = (orientation_of(world, joint) * Vector3d::UnitZ()).z();
  bool is_before = upright < -kLevel;
  if (std::abs(upright) < kLevel && std::abs(size.before - size.behind) > kNearer * size.axis)
    is_before = size.before < size.behind;
  const double out = 0.75 * kOut * size.axis;
  return is_before ? -size.before - out : size.behind + out;
}

}  // namespace

bool slides(JointKind kind) { return slides_along_axis(kind) || is_on_sheet(kind); }

Eigen::Quaterniond orientation_of(const engine::World& world, const engine::Joint& joint) {
  return world.state(joint.body_a).orientation * joint.frame_a;
}

JointSize size_of(const engine::World& world, const engine::Joint& joint) {
  JointSize size;
  size.axis = kAxisLength;
  for (const auto& [body, anchor] :
       {std::pair{joint.body_a, joint.anchor_a}, std::pair{joint.body_b, joint.anchor_b}}) {
    if (body == engine::kWorldBody) continue;
    const double through =
        std::max(std::visit(LengthOfAxis{}, world.body(body).shape), 2.0 * anchor.norm());
    if (through > 0.0) size.axis = std::min(size.axis, through);
  }
  if (engine::info(joint.kind).has_frames) find_reach(world, joint, &size);
  return size;
}

bool find_wheels(const engine::World& world, const engine::Joint& gear, JointSize* first,
                 JointSize* second) {
  const engine::Coupling& coupling = gear.coupling;
  const Wheel a = wheel_of(world, coupling.first, first);
  const Wheel b = wheel_of(world, coupling.second, second);
  // The wheel of a joint is on its body B, or on A where B is the common carrier.
  first->wheel_is_on_a = a.joint.body_b == b.joint.body_a || a.joint.body_b == b.joint.body_b;
  second->wheel_is_on_a = b.joint.body_b == a.joint.body_a || a.joint.body_b == b.joint.body_b;
  if (a.turns && b.turns)
    if (const auto found = radii(a, b, coupling.ratio)) {
      const double tooth = 2.0 * kPi * std::min(found->first, found->second) / kTeethOfSmaller;
      set_teeth(found->first, tooth, first);
      set_teeth(found->second, tooth, second);
      return true;
    }
  // A gear holds q₁ + ratio q₂ constant; with one slider the ratio is in rad/m or m/rad.
  if (a.turns && b.joint.kind == JointKind::kSlider &&
      find_rack(world, a, b, 1.0 / std::abs(coupling.ratio)))
    return true;
  if (b.turns && a.joint.kind == JointKind::kSlider &&
      find_rack(world, b, a, std::abs(coupling.ratio)))
    return true;
  for (const Wheel* wheel : {&a, &b}) {
    const double radius = kSmallWheel * wheel->size->axis;
    if (!wheel->turns || wheel->size->wheel > 0.0) continue;
    set_teeth(radius, 2.0 * kPi * radius / kTeethOfSmaller, wheel->size);
    wheel->size->touches = false;
  }
  return false;
}

std::int32_t type_of_sign(const engine::Joint& joint, const JointSize& size) {
  if (!engine::info(joint.kind).has_frames) return Marker::SPHERE;
  switch (joint.kind) {
    case JointKind::kSlider:
      return has_rack(size) ? Marker::LINE_LIST : Marker::CUBE;
    case JointKind::kHinge:
      return size.wheel > 0.0 ? Marker::LINE_LIST : Marker::CYLINDER;
    case JointKind::kPlanar:
    case JointKind::kPointOnPlane:
    case JointKind::kUniversal:
    case JointKind::kWeld:
      return Marker::LINE_LIST;
    case JointKind::kScrew:
      return Marker::TRIANGLE_LIST;
    default:
      return Marker::CYLINDER;
  }
}

void draw_joint(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                const Vector3d& p_a, const Vector3d& p_b, double most_width, ShownMarker* marker) {
  const double thickness = std::min(most_width, kSignWidthOfLength * size.axis);
  marker->pose.position = point_at(p_a);
  marker->color = colour(0.8, 0.8, 0.85);
  set_scale(thickness, 0.0, 0.0, marker);
  if (!engine::info(joint.kind).has_frames)
    return set_scale(2.0 * thickness, 2.0 * thickness, 2.0 * thickness, marker);
  const Eigen::Quaterniond orientation = orientation_of(world, joint);
  marker->pose.orientation = quaternion_of(orientation);
  if (has_rack(size)) return draw_rack(size, p_b, marker);
  if (slides_along_axis(joint.kind))
    return draw_rail(joint, size, p_a, p_b, orientation * Vector3d::UnitZ(), thickness, marker);
  if (size.wheel > 0.0) {
    marker->scale.x = 0.5 * thickness;
    if (!size.wheel_is_on_a && joint.frame_b)
      marker->pose.orientation =
          quaternion_of(world.state(joint.body_b).orientation * *joint.frame_b);
    if (!marker->is_drawn_for({size.wheel, size.before, size.behind}))
      add_wheels(size, &marker->points);
  } else if (joint.kind == JointKind::kWeld) {
    if (!marker->is_drawn_for({1.0, size.axis, 0.0})) add_cross(kWeld * size.axis, &marker->points);
  } else if (is_on_sheet(joint.kind)) {
    marker->scale.x = 0.3 * thickness;
    const bool turns_only_about_it = joint.kind == JointKind::kPlanar;
    if (!marker->is_drawn_for({2.0, size.axis, turns_only_about_it ? 1.0 : 0.0}))
      add_sheet(size.axis, turns_only_about_it, &marker->points);
  } else if (joint.kind == JointKind::kUniversal) {
    const Vector3d z_b =
        joint.frame_b ? Vector3d(orientation.conjugate() * (world.state(joint.body_b).orientation *
                                                            (*joint.frame_b * Vector3d::UnitZ())))
                      : Vector3d(Vector3d::UnitX());
    marker->points.clear();
    for (const Vector3d& axis : {Vector3d(Vector3d::UnitZ()), z_b})
      add_line(-0.5 * size.axis * axis, 0.5 * size.axis * axis, &marker->points);
  } else {
    const double out = kOut * size.axis;
    const double low = -std::max(0.5 * size.axis, size.before + out);
    const double high = std::max(0.5 * size.axis, size.behind + out);
    marker->pose.position = point_at(p_a + 0.5 * (low + high) * (orientation * Vector3d::UnitZ()));
    set_scale(1.5 * thickness, 1.5 * thickness, high - low, marker);
  }
}

void draw_motor(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                const ShownMotor& motor, const Vector3d& p_a, const Vector3d& p_b,
                double most_width, ShownMarker* marker) {
  const bool positive = motor.direction() > 0.0;
  const double sign = positive ? 1.0 : -1.0;
  marker->scale.x = 0.5 * std::min(most_width, kSignWidthOfLength * size.axis);
  marker->pose.position = point_at(slides_along_axis(joint.kind) ? p_b : p_a);
  marker->pose.orientation = quaternion_of(orientation_of(world, joint));
  if (motor.is_angle) {
    const double z = height_of_ring(world, joint, size);
    if (marker->is_drawn_for({sign * size.axis, z, radius_of_ring(size)})) return;
    return add_turning_arrow(radius_of_ring(size), z, positive, &marker->points);
  }
  // The arrow starts outside the moving body, which would hide it.
  const double start = positive ? size.behind : size.before;
  if (marker->is_drawn_for({sign * size.axis, start, -1.0})) return;
  add_arrow(sign * start * Vector3d::UnitZ(), sign * Vector3d::UnitZ(), size.axis, 0.3 * size.axis,
            &marker->points);
}

double top_of_rail(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                   const Vector3d& p_a, const Vector3d& p_b) {
  if (!slides_along_axis(joint.kind)) return std::max(p_a.z(), p_b.z());
  const Vector3d z = orientation_of(world, joint) * Vector3d::UnitZ();
  const auto [low, high] = rail(joint, size, (p_b - p_a).dot(z));
  return p_a.z() + std::max(low * z.z(), high * z.z());
}

Vector3d end_of_sign(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                     const std::optional<ShownMotor>& motor, const Vector3d& p_a,
                     const Vector3d& p_b, const Vector3d& up) {
  const Vector3d place = slides_along_axis(joint.kind) ? p_b : p_a;
  double top = 0.0;  // top of the smaller body, which would hide the label
  if (engine::info(joint.kind).has_frames) {
    const Vector3d z = orientation_of(world, joint) * Vector3d::UnitZ();
    if (motor && !motor->is_angle) {
      const bool positive = motor->direction() > 0.0;
      return place + (positive ? size.behind + size.axis : -size.before - size.axis) * z;
    }
    const double upright = z.dot(up);
    const double across_up = std::sqrt(std::max(1.0 - upright * upright, 0.0));
    if (motor)  // above the ring, and above its far side as seen by the viewer
      return place + height_of_ring(world, joint, size) * z +
             radius_of_ring(size) * (kHeadOfRing * across_up + kSlant * std::abs(upright)) * up;
    if (is_on_sheet(joint.kind)) {
      const Eigen::Matrix3d axes = orientation_of(world, joint).toRotationMatrix();
      const double x = axes.col(0).dot(up), y = axes.col(1).dot(up);
      const Vector3d edge = std::abs(x) > std::abs(y)
                                ? Vector3d(std::copysign(size.axis, x) * axes.col(0))
                                : Vector3d(std::copysign(size.axis, y) * axes.col(1));
      if (edge.dot(up) > top_above(world, joint, place, up)) return place + edge;
    } else {
      const double end =
          std::max(0.5 * size.axis, kOut * size.axis + (upright > 0.0 ? size.behind : size.before));
      if (std::abs(upright) > 0.7) return place + (upright > 0.0 ? end : -end) * z;
      const bool is_cross = joint.kind == JointKind::kUniversal;
      const double wheel = size.wheel_is_on_a ? 0.0 : size.wheel;
      top = across_up * (is_cross ? 0.5 * size.axis : wheel);
    }
  }
  return place + std::max(top, top_above(world, joint, place, up)) * up;
}

}  // namespace constraint_sim
