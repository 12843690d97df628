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

template <class A, class B>
inline constexpr bool kNeverCollide = std::is_same_v<A, Point> || std::is_same_v<B, Point> ||
                                      (std::is_same_v<A, Plane> && std::is_same_v<B, Plane>);

}  // namespace

Manifold Collide::operator()(const Sphere& sphere_a, const Sphere& sphere_b) const {
  const Vector3d p_BA = a.position - b.position;
  const double radii = sphere_a.radius + sphere_b.radius;
  const double distance_squared = p_BA.squaredNorm();
  if (distance_squared >= (radii + margin) * (radii + margin)) return {};

  // The default normal, z, serves where the centres coincide.
  Manifold manifold;
  const double distance = std::sqrt(distance_squared);
  if (distance_squared >= kSmallestSquare) manifold.normal = p_BA / distance;
  // The tutorial's S1 − N (r1 − p), without its cancellation.
  add_point(manifold, b.position + sphere_b.radius * manifold.normal, radii - distance, 0, margin);
  return manifold;
}

Manifold Collide::operator()(const Sphere& sphere_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  const double height = N.dot(a.position) - d;
  Manifold manifold;
  manifold.normal = N;
  add_point(manifold, a.position - height * N, sphere_a.radius - height, 0, margin);
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
