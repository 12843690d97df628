#include "engine/collision/contact_feature.h"

#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>
#include <type_traits>
#include <variant>

#include "engine/collision/box_features.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Position and velocity of a material point of a body, with the arm from the body's centre.
Vector3d point_of(const BodyState& body, const Vector3d& arm) { return body.position + arm; }
Vector3d velocity_of(const BodyState& body, const Vector3d& arm) {
  return body.linear_velocity + body.angular_velocity.cross(arm);
}

// Returns the region of a box that is nearest to a point, -1, 0 or 1 per axis. A point on a border
// belongs to the side that it moves to.
Eigen::Vector3i region_of(const Box& box, const Vector3d& point, const Vector3d& velocity) {
  // Share of the size within which a point counts as on a border: rounding of its coordinates.
  constexpr double kOnBorder = 1e-12;
  Eigen::Vector3i region = Eigen::Vector3i::Zero();
  int inside = 0;
  for (int i = 0; i < 3; ++i) {
    const double half = 0.5 * box.size[i];
    const int side = point[i] < 0.0 ? -1 : 1;
    const double beyond = std::abs(point[i]) - half;
    const bool is_on_border = std::abs(beyond) <= kOnBorder * box.size[i];
    const bool is_out = is_on_border ? side * velocity[i] > 0.0 : beyond > 0.0;
    if (is_out)
      region[i] = side;
    else
      ++inside;
  }
  if (inside < 3) return region;
  // The centre is in the box.
  Eigen::Index nearest = 0;
  (point.cwiseAbs() - 0.5 * box.size).maxCoeff(&nearest);
  region[nearest] = point[nearest] < 0.0 ? -1 : 1;
  return region;
}

ContactFeature sphere_on_box(double radius, const BodyState& a, const Box& box,
                             const BodyState& b) {
  const Eigen::Quaterniond to_b = b.orientation.conjugate();
  const Vector3d arm = a.position - b.position;
  const Vector3d point = to_b * arm;
  const Vector3d velocity =
      to_b * (a.linear_velocity - b.linear_velocity - b.angular_velocity.cross(arm));
  const Eigen::Vector3i region = region_of(box, point, velocity);
  ContactFeature feature;
  feature.radius_a = radius;
  feature.on_b = 0.5 * box.size.cwiseProduct(region.cast<double>());
  const int sides = region.cwiseAbs().sum();
  if (sides == 1) {
    feature.axis = region.cast<double>();
  } else if (sides == 2) {
    feature.kind = ContactFeature::Kind::kLine;
    feature.axis = (Eigen::Vector3i::Ones() - region.cwiseAbs()).cast<double>();
  } else {
    feature.kind = ContactFeature::Kind::kPoint;
  }
  feature.id =
      static_cast<std::uint32_t>((region.x() + 1) + 3 * (region.y() + 1) + 9 * (region.z() + 1));
  return feature;
}

/// Distance and rate of the centre of a sphere from the nearest border of its feature of a box.
FeatureMargin margin_on_box(const ContactFeature& feature, const BodyState& a, const Box& box,
                            const BodyState& b) {
  FeatureMargin least{kInfinity, 0.0};
  const Eigen::Quaterniond to_b = b.orientation.conjugate();
  const Vector3d arm = a.position - b.position;
  const Vector3d point = to_b * arm;
  const Vector3d velocity =
      to_b * (a.linear_velocity - b.linear_velocity - b.angular_velocity.cross(arm));
  for (int i = 0; i < 3; ++i) {
    const double half = 0.5 * box.size[i];
    const double side = feature.on_b[i] == 0.0 ? 0.0 : (feature.on_b[i] < 0.0 ? -1.0 : 1.0);
    const bool is_face = feature.kind == ContactFeature::Kind::kPlane;
    FeatureMargin margin = least;
    if (side == 0.0)  // point beside the face
      margin = {half - std::abs(point[i]), point[i] < 0.0 ? velocity[i] : -velocity[i]};
    else if (!is_face)  // point beyond the face
      margin = {side * point[i] - half, side * velocity[i]};
    if (margin.value < least.value) least = margin;
  }
  return least;
}

/// Adds the features of each pair of shapes that has any, with A first.
struct AddFeatures {
  const BodyState& a;
  const BodyState& b;
  const ContactTolerances& within;
  List<ContactFeature>* features;

  void operator()(const Sphere& sphere_a, const Sphere& sphere_b) const {
    ContactFeature feature;
    feature.kind = ContactFeature::Kind::kPoint;
    feature.radius_a = sphere_a.radius;
    feature.radius_b = sphere_b.radius;
    features->push_back(feature);
  }
  void operator()(const Sphere& sphere, const Box& box) const {
    features->push_back(sphere_on_box(sphere.radius, a, box, b));
  }
  void operator()(const Sphere& sphere, const Plane&) const {
    ContactFeature feature;
    feature.radius_a = sphere.radius;
    features->push_back(feature);
  }
  void operator()(const Box& box_a, const Box& box_b) const {
    add_box_features(box_a, a, box_b, b, within, features);
  }
  void operator()(const Box& box, const Plane&) const {
    ContactFeature feature;
    for (std::uint32_t corner = 0; corner < 8; ++corner) {
      feature.on_a = 0.5 * box.size;
      for (int i = 0; i < 3; ++i)
        if ((corner >> i & 1U) == 0U) feature.on_a[i] = -feature.on_a[i];
      feature.id = corner;
      features->push_back(feature);
    }
  }
  // The features are the centres of the half spheres.
  void operator()(const Capsule& capsule, const Plane&) const {
    ContactFeature feature;
    feature.radius_a = capsule.radius;
    for (const double side : {-0.5, 0.5}) {
      feature.on_a = {0.0, 0.0, side * capsule.length};
      feature.id = side < 0.0 ? 0 : 1;
      features->push_back(feature);
    }
  }
};

/// Margin of a feature of each pair of shapes that has features.
struct MarginOfFeature {
  static constexpr FeatureMargin kNoBorder{kInfinity, 0.0};
  const ContactFeature& feature;
  const BodyState& a;
  const BodyState& b;

  FeatureMargin operator()(const Sphere&, const Sphere&) const { return kNoBorder; }
  FeatureMargin operator()(const Sphere&, const Box& box) const {
    return margin_on_box(feature, a, box, b);
  }
  FeatureMargin operator()(const Sphere&, const Plane&) const { return kNoBorder; }
  FeatureMargin operator()(const Box& box_a, const Box& box_b) const {
    return margin_of_boxes(feature, box_a, a, box_b, b);
  }
  FeatureMargin operator()(const Box&, const Plane&) const { return kNoBorder; }
  FeatureMargin operator()(const Capsule&, const Plane&) const { return kNoBorder; }
};

template <class A, class B>
inline constexpr bool kHaveFeatures = std::is_invocable_v<AddFeatures, const A&, const B&>;

/// Whether a shape has no features with any other shape: its contacts are not event-driven.
template <class Kind>
inline constexpr bool kIsWithoutFeatures =
    std::is_same_v<Kind, Point> || std::is_same_v<Kind, Cylinder> || std::is_same_v<Kind, Hull> ||
    std::is_same_v<Kind, Compound>;

/// Whether each shape has features with some other shape, or is listed as a shape without.
template <class... Kinds>
constexpr bool are_all_considered(const std::variant<Kinds...>*) {
  return (... && (kIsWithoutFeatures<Kinds> !=
                  (kHaveFeatures<Kinds, Plane> || kHaveFeatures<Sphere, Kinds>)));
}
static_assert(are_all_considered(static_cast<const Shape*>(nullptr)),
              "write the features of the new shape in AddFeatures, or list it as without features");

/// Calls a visitor with two shapes that have features in this order. Throws std::logic_error for
/// others.
template <class Visitor>
auto visit_pair_with_features(const Visitor& visitor, const Shape& shape_a, const Shape& shape_b) {
  using Result = std::invoke_result_t<Visitor, const Sphere&, const Sphere&>;
  const auto visit_kinds = [&](const auto& of_a, const auto& of_b) -> Result {
    if constexpr (kHaveFeatures<std::decay_t<decltype(of_a)>, std::decay_t<decltype(of_b)>>)
      return visitor(of_a, of_b);
    else
      throw std::logic_error("two shapes without features in this order");
  };
  return std::visit(visit_kinds, shape_a, shape_b);
}

}  // namespace

void set_velocities(const Vector3d& p_dot, const BodyState& a, const BodyState& b,
                    ContactMotion* motion) {
  motion->w = velocity_of(a, motion->r_a) - velocity_of(b, motion->r_b);
  motion->w_bias = a.angular_velocity.cross(p_dot - a.linear_velocity) -
                   b.angular_velocity.cross(p_dot - b.linear_velocity);
}

namespace {

// Motion of a corner of B against a plane of A.
ContactMotion motion_on_a(const ContactFeature& feature, const BodyState& a, const BodyState& b) {
  ContactMotion motion;
  motion.n = -(a.orientation * feature.axis_a);
  motion.n_dot = a.angular_velocity.cross(motion.n);
  motion.r_b = b.orientation * feature.on_b;
  motion.p = point_of(b, motion.r_b);
  motion.r_a = motion.p - a.position;
  motion.gap = motion.n.dot(a.orientation * feature.on_a - motion.r_a);
  set_velocities(velocity_of(b, motion.r_b), a, b, &motion);
  return motion;
}

}  // namespace

ContactMotion motion_of(const ContactFeature& feature, const BodyState& a, const BodyState& b) {
  if (feature.kind == ContactFeature::Kind::kNothing) {
    ContactMotion nothing;
    nothing.gap = kInfinity;
    return nothing;
  }
  if (feature.kind == ContactFeature::Kind::kPlaneOfA) return motion_on_a(feature, a, b);
  if (feature.kind == ContactFeature::Kind::kEdges) return motion_of_edges(feature, a, b);
  const Vector3d to_c = a.orientation * feature.on_a, to_o = b.orientation * feature.on_b;
  const Vector3d c = point_of(a, to_c), c_dot = velocity_of(a, to_c);
  const Vector3d axis = b.orientation * feature.axis;
  const Vector3d d = c - point_of(b, to_o), d_dot = c_dot - velocity_of(b, to_o);
  ContactMotion motion;
  if (feature.kind == ContactFeature::Kind::kPlane) {
    motion.n = axis;
    motion.n_dot = b.angular_velocity.cross(axis);
    motion.gap = axis.dot(d) - feature.radius_a;
  } else {
    Vector3d e = d, e_dot = d_dot;
    if (feature.kind == ContactFeature::Kind::kLine) {
      const Vector3d axis_dot = b.angular_velocity.cross(axis);
      e -= axis * axis.dot(d);
      e_dot -= axis_dot * axis.dot(d) + axis * (axis_dot.dot(d) + axis.dot(d_dot));
    }
    const double distance = e.norm();
    if (distance > 0.0) {  // coincident points separate along z
      motion.n = e / distance;
      motion.n_dot = (e_dot - motion.n * motion.n.dot(e_dot)) / distance;
    }
    motion.gap = distance - feature.radius_a - feature.radius_b;
  }
  // The arm is no difference of positions, so it has the same bits wherever the body is.
  motion.r_a = to_c - feature.radius_a * motion.n;
  motion.p = point_of(a, motion.r_a);
  const Vector3d p_dot = c_dot - feature.radius_a * motion.n_dot;
  motion.r_b = motion.p - b.position;
  set_velocities(p_dot, a, b, &motion);
  return motion;
}

bool has_features(const Shape& a, const Shape& b) {
  const auto have_features = [](const auto& of_a, const auto& of_b) {
    return kHaveFeatures<std::decay_t<decltype(of_a)>, std::decay_t<decltype(of_b)>>;
  };
  return std::visit(have_features, a, b);
}

void add_features(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                  const BodyState& b, const ContactTolerances& within,
                  List<ContactFeature>* features) {
  const AddFeatures add{a, b, within, features};
  visit_pair_with_features(add, shape_a, shape_b);
}

FeatureMargin margin_of(const ContactFeature& feature, const Shape& shape_a, const BodyState& a,
                        const Shape& shape_b, const BodyState& b) {
  return visit_pair_with_features(MarginOfFeature{feature, a, b}, shape_a, shape_b);
}

}  // namespace constraint_sim::engine
