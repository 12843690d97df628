#include "ros/marker_style.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <variant>

#include "engine/math/numbers.h"
#include "engine/model/shape_properties.h"
#include "ros/conversions.h"
#include "sim/grip.h"

namespace constraint_sim {
namespace {

using visualization_msgs::Marker;

constexpr double kPointDiameter = 0.06;  // diameter of a point mass [m]
constexpr double kPlaneWidth = 20.0;     // width of the shown part of a plane [m]
constexpr double kForcesPeriod = 0.1;    // [s]
constexpr double kForgets = 5.0;         // time in which the largest force falls to 1/e [s]
constexpr double kMostSign = 0.3;        // [m]
constexpr double kMostWidth = 0.05;      // [m]
constexpr double kSignOfScene = 0.1;     // over the diagonal
constexpr double kWidthOfScene = 0.01;   // over the diagonal

void set_size(Marker* marker, std::int32_t type, const Eigen::Vector3d& size) {
  marker->type = type;
  marker->scale = to_vector(size);
}

/// Shows each face of a hull as a fan of triangles.
void set_surface(Marker* marker, const engine::ConvexHull& surface) {
  set_size(marker, Marker::TRIANGLE_LIST, Eigen::Vector3d::Ones());
  marker->points.clear();
  for (const engine::ConvexHull::Face& face : surface.faces()) {
    const auto corner = [&](int k) {
      const int vertex = surface.corners()[static_cast<std::size_t>(face.first + k)].vertex;
      return to_point(surface.vertices()[static_cast<std::size_t>(vertex)]);
    };
    for (int k = 1; k + 1 < face.count; ++k)
      for (const int at : {0, k, k + 1}) marker->points.push_back(corner(at));
  }
}

/// Shows a capsule as circles from pole to pole, joined by triangles.
void set_capsule(Marker* marker, const engine::Capsule& capsule) {
  constexpr int kSides = 12, kCirclesOfEnd = 3;
  set_size(marker, Marker::TRIANGLE_LIST, Eigen::Vector3d::Ones());
  marker->points.clear();
  // Circles 0 to kCirclesOfEnd are of the lower end, and the others of the upper end.
  const auto corner = [&](int circle, int side) {
    const bool is_upper = circle > kCirclesOfEnd;
    const double latitude =
        0.5 * engine::kPi * (circle - kCirclesOfEnd - (is_upper ? 1 : 0)) / kCirclesOfEnd;
    const double longitude = 2.0 * engine::kPi * side / kSides;
    const double across = capsule.radius * std::cos(latitude);
    return to_point(
        {across * std::cos(longitude), across * std::sin(longitude),
         capsule.radius * std::sin(latitude) + (is_upper ? 0.5 : -0.5) * capsule.length});
  };
  constexpr int kLast = 2 * kCirclesOfEnd + 1;
  for (int circle = 0; circle < kLast; ++circle)
    for (int side = 0; side < kSides; ++side) {
      const auto add = [&](int up, int on) {
        marker->points.push_back(corner(circle + up, (side + on) % kSides));
      };
      if (circle > 0) add(0, 0), add(0, 1), add(1, 1);
      if (circle + 1 < kLast) add(0, 0), add(1, 1), add(1, 0);
    }
}

/// Radius of a shape in markers [m]: the bounding radius; 0 for planes, which have no size of their
/// own.
struct ShownRadius : engine::BoundingRadius {
  using engine::BoundingRadius::operator();
  double operator()(const engine::Plane&) const { return 0.0; }
};

/// Distance from the centre of a shape to its farthest point along a direction [m]; 0 for points
/// and planes.
struct HalfWidth {
  const Eigen::Vector3d& along;  // in the frame of the shape

  double operator()(const engine::Point&) const { return 0.0; }
  double operator()(const engine::Sphere& sphere) const { return sphere.radius; }
  double operator()(const engine::Box& box) const { return 0.5 * box.size.dot(along.cwiseAbs()); }
  double operator()(const engine::Plane&) const { return 0.0; }
  double operator()(const engine::Cylinder& cylinder) const {
    return cylinder.radius * std::hypot(along.x(), along.y()) +
           0.5 * cylinder.length * std::abs(along.z());
  }
  double operator()(const engine::Hull& hull) const {
    const auto& vertices = hull.surface->vertices();
    return along.dot(vertices[static_cast<std::size_t>(hull.surface->farthest(along))]);
  }
  double operator()(const engine::Capsule& capsule) const {
    return capsule.radius + 0.5 * capsule.length * std::abs(along.z());
  }
  double operator()(const engine::Compound& compound) const {
    double most = 0.0;
    for (const engine::ShapePart& part : *compound.parts)
      most = std::max(most, std::abs(along.dot(part.pose.position)) +
                                half_width(part.shape, part.pose.orientation.conjugate() * along));
    return most;
  }
};

/// Gives a marker the type and size of a shape.
struct ShapeMarker {
  Marker* marker;

  void operator()(const engine::Point&) const {
    set_size(marker, Marker::SPHERE, Eigen::Vector3d::Constant(kPointDiameter));
  }
  void operator()(const engine::Sphere& sphere) const {
    set_size(marker, Marker::SPHERE, Eigen::Vector3d::Constant(2.0 * sphere.radius));
  }
  void operator()(const engine::Box& box) const { set_size(marker, Marker::CUBE, box.size); }
  // Planes have almost no thickness, so that bodies on them are not cut, and are brighter than
  // bodies, since they are transparent.
  void operator()(const engine::Plane&) const {
    set_size(marker, Marker::CUBE, {kPlaneWidth, kPlaneWidth, 1e-3});
    for (float* part : {&marker->color.r, &marker->color.g, &marker->color.b})
      *part = std::min(1.5F * *part, 1.0F);
    marker->color.a *= 0.5F;
  }
  void operator()(const engine::Cylinder& cylinder) const {
    const double diameter = 2.0 * cylinder.radius;
    set_size(marker, Marker::CYLINDER, {diameter, diameter, cylinder.length});
  }
  void operator()(const engine::Hull& hull) const { set_surface(marker, *hull.surface); }
  void operator()(const engine::Capsule& capsule) const { set_capsule(marker, capsule); }
  // A compound has a marker for each part; its own marks the centre of mass.
  void operator()(const engine::Compound&) const { (*this)(engine::Point{}); }
};

}  // namespace

double radius_of(const engine::Shape& shape) { return std::visit(ShownRadius{}, shape); }

double half_width(const engine::Shape& shape, const Eigen::Vector3d& along) {
  return std::visit(HalfWidth{along}, shape);
}

engine::ShapePose pose_of_part(const engine::Body& body, std::size_t part) {
  if (const auto* compound = std::get_if<engine::Compound>(&body.shape))
    return (*compound->parts)[part].pose;
  return body.shape_pose.value_or(engine::ShapePose{});
}

Eigen::Vector3d middle_of(const engine::Body& body, const engine::BodyState& state) {
  if (!body.shape_pose) return state.position;
  return state.position + state.orientation * body.shape_pose->position;
}

double half_width(const engine::Body& body, const engine::BodyState& state,
                  const Eigen::Vector3d& along) {
  Eigen::Quaterniond turned = state.orientation;
  if (body.shape_pose) turned = turned * body.shape_pose->orientation;
  return half_width(body.shape, turned.conjugate() * along);
}

double radius_of_ball(const engine::Body& body) {
  const auto* sphere = std::get_if<engine::Sphere>(&body.shape);
  return sphere != nullptr ? sphere->radius : 0.0;
}

Look look_of(const engine::Joint& joint) {
  if (engine::info(joint.kind).couples_joints) return Look::kCoupling;
  const engine::DistanceJoint* distance = engine::if_distance(joint);
  if (distance == nullptr)
    return engine::info(joint.kind).is_free_length ? Look::kRope : Look::kJoint;
  if (distance->is_soft()) return distance->one_sided ? Look::kRope : Look::kSpring;
  if (distance->min_length > 0.0) return Look::kStrut;
  return distance->is_limited() ? Look::kRope : Look::kRod;
}

bool is_rope(const engine::Joint& joint) {
  if (joint.coupling.one_sided) return true;
  return engine::if_distance(joint) != nullptr && look_of(joint) == Look::kRope;
}

bool is_slack(const engine::Joint& joint, const engine::JointState& state) {
  return is_rope(joint) && state.force == 0.0;
}

double error_while_closing(const engine::Joint& joint, const engine::JointState& state) {
  const double error = std::abs(state.error);
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i) {
    const auto& motor = joint.coordinates[static_cast<std::size_t>(i)].motor;
    if (!motor || !motor->is_rigid() || !motor->position) continue;
    const engine::CoordinateState& coordinate = state.coordinates[static_cast<std::size_t>(i)];
    const double metres = engine::info(joint.kind).is_angle[i] ? state.radius : 1.0;
    if (std::abs(metres * (coordinate.position - coordinate.held)) == error) return 0.0;
  }
  return error;
}

std::optional<double> axial_force(const engine::Joint& joint, const engine::JointState& state) {
  if (engine::if_distance(joint) == nullptr && joint.kind != engine::JointKind::kPulley)
    return std::nullopt;
  return state.force;
}

std::optional<ShownMotor> shown_motor(const engine::Joint& joint, const engine::JointState& state) {
  ShownMotor shown;
  if (engine::if_distance(joint) != nullptr) {
    shown.rate = state.bias;
    return joint.motor.is_moving() || state.bias != 0.0 ? std::optional(shown) : std::nullopt;
  }
  // coordinates of planar and universal joints have other axes than the drawn one
  if (joint.kind == engine::JointKind::kPlanar || joint.kind == engine::JointKind::kUniversal)
    return std::nullopt;
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const std::optional<engine::Motor>& motor = joint.coordinates[at].motor;
    if (!motor) continue;
    shown.is_angle = engine::info(joint.kind).is_angle[i];
    shown.rate = state.coordinates[at].bias;
    shown.force = motor->force.value_or(0.0);
    if (shown.direction() != 0.0) return shown;
  }
  return std::nullopt;
}

bool has_arm_outside(const engine::World& world, const engine::Joint& joint) {
  for (const auto& [id, anchor] :
       {std::pair{joint.body_a, joint.anchor_a}, std::pair{joint.body_b, joint.anchor_b}}) {
    if (id == engine::kWorldBody || anchor.isZero(0.0)) continue;
    const engine::Body& body = world.body(id);
    Eigen::Vector3d place = anchor;
    if (body.shape_pose)
      place = body.shape_pose->orientation.conjugate() * (anchor - body.shape_pose->position);
    constexpr double kOut = 1.01;  // margin for an arm to be visible
    if (const auto* box = std::get_if<engine::Box>(&body.shape)) {
      if (((place.cwiseAbs() - kOut * 0.5 * box->size).array() > 0.0).any()) return true;
    } else if (place.norm() > kOut * radius_of(body.shape)) {
      return true;
    }
  }
  return false;
}

bool is_length(Look look) { return look != Look::kJoint && look != Look::kCoupling; }

bool is_on_world(const engine::Joint& joint) {
  return (joint.body_a == engine::kWorldBody) != (joint.body_b == engine::kWorldBody) &&
         is_length(look_of(joint)) && !engine::info(joint.kind).is_free_length;
}

void set_shape(Marker* marker, const engine::Shape& shape) {
  std::visit(ShapeMarker{marker}, shape);
}

std_msgs::ColorRGBA body_colour(const engine::Body& body) {
  if (body.color) {
    const auto& [r, g, b, a] = *body.color;
    return colour(r, g, b, a);
  }
  switch (body.type) {
    case engine::BodyType::kStatic:
      return colour(0.36, 0.36, 0.38);
    case engine::BodyType::kKinematic:
      return colour(0.5, 0.4, 0.33);
    default:
      return colour(0.27, 0.51, 0.71);
  }
}

std_msgs::ColorRGBA constraint_colour(double share, double error) {
  const double red =
      error > kToldError
          ? std::min(std::log(error / kToldError) / std::log(kRedError / kToldError), 1.0)
          : 0.0;
  Eigen::Vector3d rgb(0.2, 0.8, 0.2);
  if (share < -kLeastLoad) rgb = {0.1, 0.85, 1.0};
  if (share > kLeastLoad) rgb = {1.0, 0.9, 0.1};
  if (red > 0.0) rgb += red * (Eigen::Vector3d(1.0, 0.28, 0.25) - rgb);
  return colour(rgb.x(), rgb.y(), rgb.z());
}

std_msgs::ColorRGBA motor_colour(bool saturated) {
  return saturated ? colour(0.75, 0.2, 0.55) : colour(1.0, 0.4, 0.85);
}

std_msgs::ColorRGBA friction_colour(bool sticks) {
  return sticks ? colour(0.75, 0.6, 1.0) : colour(1.0, 0.6, 0.2);
}

std_msgs::ColorRGBA slack_colour() { return colour(0.75, 0.68, 0.55); }

std_msgs::ColorRGBA broken_colour() { return colour(0.65, 0.65, 0.65); }

std_msgs::ColorRGBA fixed_colour() { return colour(0.66, 0.6, 0.6); }

Eigen::Vector3d down(const engine::World& world) {
  const Eigen::Vector3d& gravity = world.options().gravity;
  return gravity.isZero(0.0) ? Eigen::Vector3d(-Eigen::Vector3d::UnitZ()) : gravity.normalized();
}

double sign_of_held(const engine::World& world, const engine::Contact& contact,
                    const Eigen::Vector3d& down) {
  const bool a_moves = world.body(contact.body_a).type == engine::BodyType::kDynamic;
  const bool b_moves = world.body(contact.body_b).type == engine::BodyType::kDynamic;
  const bool holds_a = a_moves != b_moves ? a_moves : contact.normal.dot(down) <= 0.0;
  return holds_a ? 1.0 : -1.0;
}

namespace {

engine::BodyId held_by(const engine::World& world, const engine::Contact& contact) {
  return sign_of_held(world, contact, down(world)) > 0.0 ? contact.body_a : contact.body_b;
}

}  // namespace

void ForceScale::update(const engine::World& world, const ros::Time& stamp) {
  const double passed = stamp.toSec() - stamp_.toSec();  // cheaper than a ros::Duration
  // The first forces show at once, also those of a single step.
  const auto has_force = [&](const engine::Contact& contact) {
    return contact.normal_force > kNoForce * reference();
  };
  const bool awaits_some = (!world.joint_ids().empty() && !(reference() > 0.0)) ||
                           (!(contact_ > 0.0) && std::any_of(world.contacts().begin(),
                                                             world.contacts().end(), has_force));
  if (passed >= 0.0 && passed < kForcesPeriod && !awaits_some) return;
  stamp_ = stamp;
  const double kept = std::exp(-std::max(passed, 0.0) / kForgets);
  axial_ = world.joint_ids().empty() ? 0.0 : kept * axial_;
  contact_ *= kept;
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    const double force = std::abs(axial_force(joint, world.joint_state(id)).value_or(0.0));
    if (force > axial_ && std::isfinite(force) && !is_grip(joint)) axial_ = force;
  }
  const engine::Contact* largest_contact = nullptr;
  for (const engine::Contact& contact : world.contacts()) {
    const double least = std::max(contact_, kNoForce * reference());
    if (!std::isfinite(contact.normal_force) || contact.normal_force <= least) continue;
    contact_ = contact.normal_force;
    largest_contact = &contact;
  }
  if (largest_contact != nullptr) {
    const engine::BodyId held = held_by(world, *largest_contact);
    thickness_ = 2.0 * half_width(world.body(held), world.state(held), largest_contact->normal);
    is_on_ball_ = radius_of_ball(world.body(held)) > 0.0;
  }
  for_each_friction(world.contacts(), [&](const ShownFriction& friction) {
    const double force = friction.force.norm();
    if (std::isfinite(force) && force > kNoForce * reference())
      contact_ = std::max(contact_, force);
  });
}

double ForceScale::share(double force) const {
  const double most = reference();
  if (!(most > 0.0) || std::isnan(force)) return 0.0;
  return std::clamp(force / most, -1.0, 1.0);
}

double width_around(const Extent& extent, const Eigen::Vector3d& place) {
  const Eigen::Vector3d way =
      (extent.low - place).cwiseAbs().cwiseMax((extent.high - place).cwiseAbs());
  return extent.low == extent.high ? kPlaneWidth : 4.0 * way.norm();
}

Extent extent_of(const engine::World& world) {
  Extent extent;
  extent.low.setConstant(std::numeric_limits<double>::infinity());
  extent.high = -extent.low;
  const auto include = [&](const Eigen::Vector3d& point, double radius) {
    extent.low = extent.low.cwiseMin(point - Eigen::Vector3d::Constant(radius));
    extent.high = extent.high.cwiseMax(point + Eigen::Vector3d::Constant(radius));
  };
  for (const engine::BodyId id : world.body_ids()) {
    const engine::Shape& shape = world.body(id).shape;
    if (!engine::is_half_space(shape))
      include(middle_of(world.body(id), world.state(id)), radius_of(shape));
  }
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (engine::info(joint.kind).couples_joints || is_grip(joint)) continue;
    const auto anchors = world.anchors(id);
    include(anchors.p_a, 0.0);
    include(anchors.p_b, 0.0);
  }
  if (!(extent.low.array() <= extent.high.array()).all()) extent.low = extent.high.setZero();
  const double diagonal = extent.diagonal();
  extent.sign = diagonal > 0.0 ? std::min(kMostSign, kSignOfScene * diagonal) : kMostSign;
  extent.width = diagonal > 0.0 ? std::min(kMostWidth, kWidthOfScene * diagonal) : kMostWidth;
  return extent;
}

}  // namespace constraint_sim
