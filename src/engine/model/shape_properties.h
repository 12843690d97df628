#pragma once

#include <algorithm>
#include <variant>

#include "constraint_sim/engine/shape.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Properties of shapes that several modules need. Each visitor has one overload per shape, and no
// default: a new shape does not compile until its properties are written here.

/// Role of a shape, which decides where a body may have it.
enum class ShapeForm : char {
  kPoint,      ///< touches nothing
  kHalfSpace,  ///< unbounded: static or kinematic bodies only, without a pose in its body
  kSolid,      ///< bounded and convex: may have a pose in its body, or be a part of a compound
  kCompound,   ///< several solids, each with its own pose
};

struct FormOfShape {
  ShapeForm operator()(const Point&) const { return ShapeForm::kPoint; }
  ShapeForm operator()(const Sphere&) const { return ShapeForm::kSolid; }
  ShapeForm operator()(const Box&) const { return ShapeForm::kSolid; }
  ShapeForm operator()(const Plane&) const { return ShapeForm::kHalfSpace; }
  ShapeForm operator()(const Cylinder&) const { return ShapeForm::kSolid; }
  ShapeForm operator()(const Hull&) const { return ShapeForm::kSolid; }
  ShapeForm operator()(const Capsule&) const { return ShapeForm::kSolid; }
  ShapeForm operator()(const Compound&) const { return ShapeForm::kCompound; }
};
inline ShapeForm form_of(const Shape& shape) { return std::visit(FormOfShape{}, shape); }

inline bool is_half_space(const Shape& shape) { return form_of(shape) == ShapeForm::kHalfSpace; }
/// Whether a shape touches other shapes.
inline bool has_surface(const Shape& shape) { return form_of(shape) != ShapeForm::kPoint; }

double bounding_radius(const Shape& shape);

/// Radius of the sphere about the centre of a shape that holds the shape [m].
struct BoundingRadius {
  double operator()(const Point&) const { return 0.0; }
  double operator()(const Sphere& sphere) const { return sphere.radius; }
  double operator()(const Box& box) const { return 0.5 * box.size.norm(); }
  double operator()(const Plane&) const { return kInfinity; }
  double operator()(const Cylinder& cylinder) const {
    return math::hypot(cylinder.radius, 0.5 * cylinder.length);
  }
  double operator()(const Hull& hull) const { return hull.surface->radius(); }
  double operator()(const Capsule& capsule) const { return 0.5 * capsule.length + capsule.radius; }
  double operator()(const Compound& compound) const {
    double most = 0.0;
    for (const ShapePart& part : *compound.parts)
      most = std::max(most, part.pose.position.norm() + bounding_radius(part.shape));
    return most;
  }
};
/// Returns the radius of the sphere about the centre of a shape that holds the shape [m]: 0 for
/// points, infinite for planes; about the origin of the body for compounds.
inline double bounding_radius(const Shape& shape) { return std::visit(BoundingRadius{}, shape); }

}  // namespace constraint_sim::engine
