#include "engine/collision/narrowphase.h"

#include <algorithm>
#include <cmath>
#include <variant>

#include "engine/collision/manifold_points.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Vector3d normal(const BodyState& plane) { return plane.orientation * Vector3d::UnitZ(); }
double offset(const Vector3d& N, const BodyState& plane) { return N.dot(plane.position); }

/// Calls the narrowphase function of a pair of shapes, with the shapes in its order.
struct Collide {
  const BodyState& a;
  const BodyState& b;
  double margin;

  Manifold operator()(const Sphere& sphere_a, const Sphere& sphere_b) const {
    return collide_sphere_sphere(a.position, sphere_a.radius, b.position, sphere_b.radius, margin);
  }
  Manifold operator()(const Sphere& sphere, const Plane&) const {
    const Vector3d N = normal(b);
    return collide_sphere_plane(a.position, sphere.radius, N, offset(N, b), margin);
  }
  Manifold operator()(const Box& box, const Plane&) const {
    const Vector3d N = normal(b);
    return collide_box_plane(box.size, a, N, offset(N, b), margin);
  }
  Manifold operator()(const Box& box, const Sphere& sphere) const {
    return collide_box_sphere(box.size, a, b.position, sphere.radius, margin);
  }
  Manifold operator()(const Box& box_a, const Box& box_b) const {
    return collide_box_box(box_a.size, a, box_b.size, b, margin);
  }
  Manifold operator()(const Cylinder& cylinder, const Plane&) const {
    const Vector3d N = normal(b);
    return collide_cylinder_plane(cylinder, a, N, offset(N, b), margin);
  }
  Manifold operator()(const Cylinder& cylinder, const Sphere& sphere) const {
    return collide_cylinder_sphere(cylinder, a, b.position, sphere.radius, margin);
  }
  Manifold operator()(const Box& box, const Cylinder& cylinder) const {
    return collide_box_cylinder(box.size, a, cylinder, b, margin);
  }
  Manifold operator()(const Cylinder& cylinder_a, const Cylinder& cylinder_b) const {
    return collide_cylinder_cylinder(cylinder_a, a, cylinder_b, b, margin);
  }
  Manifold operator()(const Plane& plane, const Sphere& sphere) const {
    return swapped(Collide{b, a, margin}(sphere, plane));
  }
  Manifold operator()(const Plane& plane, const Box& box) const {
    return swapped(Collide{b, a, margin}(box, plane));
  }
  Manifold operator()(const Sphere& sphere, const Box& box) const {
    return swapped(Collide{b, a, margin}(box, sphere));
  }
  Manifold operator()(const Plane& plane, const Cylinder& cylinder) const {
    return swapped(Collide{b, a, margin}(cylinder, plane));
  }
  Manifold operator()(const Sphere& sphere, const Cylinder& cylinder) const {
    return swapped(Collide{b, a, margin}(cylinder, sphere));
  }
  Manifold operator()(const Cylinder& cylinder, const Box& box) const {
    return swapped(Collide{b, a, margin}(box, cylinder));
  }
  template <class ShapeA, class ShapeB>
  Manifold operator()(const ShapeA&, const ShapeB&) const {
    return {};
  }
};

}  // namespace

BodyState beside(const BodyState& body, const ShapePose& pose) {
  const Vector3d arm = body.orientation * pose.position;
  return {body.position + arm, body.orientation * pose.orientation,
          body.linear_velocity + body.angular_velocity.cross(arm), body.angular_velocity};
}

Manifold collide_sphere_sphere(const Vector3d& p_a, double radius_a, const Vector3d& p_b,
                               double radius_b, double margin) {
  const Vector3d p_BA = p_a - p_b;
  const double reach = radius_a + radius_b;
  const double distance_squared = p_BA.squaredNorm();
  if (distance_squared >= (reach + margin) * (reach + margin)) return {};

  // The default normal, z, serves where the centres coincide.
  Manifold manifold;
  const double distance = std::sqrt(distance_squared);
  if (distance_squared >= kSmallestSquare) manifold.normal = p_BA / distance;
  // The tutorial's S1 − N (r1 − p), without its cancellation.
  add_point(manifold, p_b + radius_b * manifold.normal, reach - distance, 0, margin);
  return manifold;
}

Manifold collide_sphere_plane(const Vector3d& p_a, double radius_a, const Vector3d& N, double d,
                              double margin) {
  const double height = N.dot(p_a) - d;
  Manifold manifold;
  manifold.normal = N;
  add_point(manifold, p_a - height * N, radius_a - height, 0, margin);
  return manifold;
}

Manifold collide(const Shape& shape_a, const BodyState& a, const Shape& shape_b, const BodyState& b,
                 double margin) {
  return std::visit(Collide{a, b, margin}, shape_a, shape_b);
}

Separation separation(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                      const BodyState& b) {
  const auto* box_a = std::get_if<Box>(&shape_a);
  const auto* box_b = std::get_if<Box>(&shape_b);
  if (box_a != nullptr && box_b != nullptr)
    return separation_of_boxes(box_a->size, a, box_b->size, b);
  const auto reversed = [](const Separation& of) { return Separation{-of.normal, of.gap}; };
  if (const auto* cylinder_a = std::get_if<Cylinder>(&shape_a)) {
    if (const auto* cylinder_b = std::get_if<Cylinder>(&shape_b))
      return separation_of_cylinders(*cylinder_a, a, *cylinder_b, b);
    if (box_b != nullptr)
      return reversed(separation_of_box_and_cylinder(box_b->size, b, *cylinder_a, a));
    if (std::holds_alternative<Plane>(shape_b))
      return separation_of_cylinder_and_plane(*cylinder_a, a, normal(b), offset(normal(b), b));
  } else if (const auto* cylinder_b = std::get_if<Cylinder>(&shape_b)) {
    if (box_a != nullptr) return separation_of_box_and_cylinder(box_a->size, a, *cylinder_b, b);
    if (std::holds_alternative<Plane>(shape_a))
      return reversed(
          separation_of_cylinder_and_plane(*cylinder_b, b, normal(a), offset(normal(a), a)));
  }
  const Manifold all = collide(shape_a, a, shape_b, b, kInfinity);
  double gap = kInfinity;
  for (int i = 0; i < all.count; ++i)
    gap = std::min(gap, -all.points[static_cast<std::size_t>(i)].depth);
  return {all.normal, gap};
}

}  // namespace constraint_sim::engine
