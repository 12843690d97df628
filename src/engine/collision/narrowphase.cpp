#include "engine/collision/narrowphase.h"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <variant>

#include "engine/collision/convex.h"
#include "engine/collision/manifold_points.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Vector3d normal(const BodyState& plane) { return plane.orientation * Vector3d::UnitZ(); }
double offset(const Vector3d& N, const BodyState& plane) { return N.dot(plane.position); }

/// The contacts of each pair of shapes, in one of the two orders.
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
  Manifold operator()(const Hull& hull, const Plane&) const {
    const Vector3d N = normal(b);
    return collide_hull_plane(hull, a, N, offset(N, b), margin);
  }
  Manifold operator()(const Hull& hull, const Sphere& sphere) const {
    return collide_hull_sphere(hull, a, b.position, sphere.radius, margin);
  }
  Manifold operator()(const Box& box, const Hull& hull) const {
    return collide_box_hull(box.size, a, hull, b, margin);
  }
  Manifold operator()(const Hull& hull, const Cylinder& cylinder) const {
    return collide_hull_cylinder(hull, a, cylinder, b, margin);
  }
  Manifold operator()(const Hull& hull_a, const Hull& hull_b) const {
    return collide_hull_hull(hull_a, a, hull_b, b, margin);
  }
  Manifold operator()(const Capsule& capsule, const Plane&) const {
    const Vector3d N = normal(b);
    return collide_capsule_plane(capsule, a, N, offset(N, b), margin);
  }
  Manifold operator()(const Capsule& capsule, const Sphere& sphere) const {
    return collide_capsule_sphere(capsule, a, b.position, sphere.radius, margin);
  }
  Manifold operator()(const Capsule& capsule, const Box& box) const {
    return collide_capsule_box(capsule, a, box.size, b, margin);
  }
  Manifold operator()(const Capsule& capsule, const Cylinder& cylinder) const {
    return collide_capsule_cylinder(capsule, a, cylinder, b, margin);
  }
  Manifold operator()(const Capsule& capsule, const Hull& hull) const {
    return collide_capsule_hull(capsule, a, hull, b, margin);
  }
  Manifold operator()(const Capsule& capsule_a, const Capsule& capsule_b) const {
    return collide_capsule_capsule(capsule_a, a, capsule_b, b, margin);
  }
};

/// The separation of each pair of shapes whose contacts do not have the smallest gap.
struct Separate {
  const BodyState& a;
  const BodyState& b;

  Separation operator()(const Box& box_a, const Box& box_b) const {
    return separation_of_boxes(box_a.size, a, box_b.size, b);
  }
  Separation operator()(const Box& box, const Cylinder& cylinder) const {
    return separation_of_box_and_cylinder(box.size, a, cylinder, b);
  }
  Separation operator()(const Cylinder& cylinder_a, const Cylinder& cylinder_b) const {
    return separation_of_cylinders(cylinder_a, a, cylinder_b, b);
  }
  Separation operator()(const Cylinder& cylinder, const Plane&) const {
    const Vector3d N = normal(b);
    return separation_of_cylinder_and_plane(cylinder, a, N, offset(N, b));
  }
  Separation operator()(const Hull& hull_a, const Hull& hull_b) const {
    return separation_of_hulls(hull_a, a, hull_b, b);
  }
  Separation operator()(const Box& box, const Hull& hull) const {
    return separation_of_box_and_hull(box.size, a, hull, b);
  }
  Separation operator()(const Hull& hull, const Cylinder& cylinder) const {
    return separation_of_hull_and_cylinder(hull, a, cylinder, b);
  }
  Separation operator()(const Hull& hull, const Plane&) const {
    const Vector3d N = normal(b);
    return separation_of_hull_and_plane(hull, a, N, offset(N, b));
  }
  Separation operator()(const Capsule& capsule_a, const Capsule& capsule_b) const {
    return separation_of_capsules(capsule_a, a, capsule_b, b);
  }
  Separation operator()(const Capsule& capsule, const Box& box) const {
    return separation_of_capsule_and_box(capsule, a, box.size, b);
  }
  Separation operator()(const Capsule& capsule, const Cylinder& cylinder) const {
    return separation_of_capsule_and_cylinder(capsule, a, cylinder, b);
  }
  Separation operator()(const Capsule& capsule, const Hull& hull) const {
    return separation_of_capsule_and_hull(capsule, a, hull, b);
  }
};

template <class A, class B>
inline constexpr bool kNeverCollide = std::is_same_v<A, Point> || std::is_same_v<B, Point> ||
                                      (std::is_same_v<A, Plane> && std::is_same_v<B, Plane>);

}  // namespace

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
  const auto collide_pair = [&](const auto& of_a, const auto& of_b) -> Manifold {
    using A = std::decay_t<decltype(of_a)>;
    using B = std::decay_t<decltype(of_b)>;
    if constexpr (kIsCompound<A> || kIsCompound<B>) {
      fail_compound();
    } else if constexpr (std::is_invocable_v<Collide, const A&, const B&>) {
      return Collide{a, b, margin}(of_a, of_b);
    } else if constexpr (std::is_invocable_v<Collide, const B&, const A&>) {
      Manifold manifold = Collide{b, a, margin}(of_b, of_a);
      exchange_shapes(&manifold);
      return manifold;
    } else {
      static_assert(kNeverCollide<A, B>, "Collide has no function for this pair of shapes");
      return {};
    }
  };
  return std::visit(collide_pair, shape_a, shape_b);
}

Separation separation(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                      const BodyState& b) {
  const auto separate_pair = [&](const auto& of_a, const auto& of_b) -> Separation {
    using A = std::decay_t<decltype(of_a)>;
    using B = std::decay_t<decltype(of_b)>;
    if constexpr (kIsCompound<A> || kIsCompound<B>) {
      fail_compound();
    } else if constexpr (std::is_invocable_v<Separate, const A&, const B&>) {
      return Separate{a, b}(of_a, of_b);
    } else if constexpr (std::is_invocable_v<Separate, const B&, const A&>) {
      const Separation reversed = Separate{b, a}(of_b, of_a);
      return {-reversed.normal, reversed.gap};
    } else {
      const Manifold all = collide(shape_a, a, shape_b, b, kInfinity);
      double gap = kInfinity;
      for (int i = 0; i < all.count; ++i)
        gap = std::min(gap, -all.points[static_cast<std::size_t>(i)].depth);
      return {all.normal, gap};
    }
  };
  return std::visit(separate_pair, shape_a, shape_b);
}

}  // namespace constraint_sim::engine
