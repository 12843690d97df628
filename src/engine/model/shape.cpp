#include "constraint_sim/engine/shape.h"

#include <string>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

struct UnitInertia {
  Eigen::Vector3d operator()(const Point&) const { return Eigen::Vector3d::Zero(); }
  Eigen::Vector3d operator()(const Sphere& sphere) const {
    return Eigen::Vector3d::Constant(0.4 * sphere.radius * sphere.radius);
  }
  Eigen::Vector3d operator()(const Box& box) const {
    const Eigen::Vector3d squares = box.size.cwiseAbs2();
    return Eigen::Vector3d(squares.y() + squares.z(), squares.z() + squares.x(),
                           squares.x() + squares.y()) /
           12.0;
  }
  Eigen::Vector3d operator()(const Plane&) const { return Eigen::Vector3d::Zero(); }
  Eigen::Vector3d operator()(const Cylinder& cylinder) const {
    const double radius_squared = cylinder.radius * cylinder.radius;
    const double across = radius_squared / 4.0 + cylinder.length * cylinder.length / 12.0;
    return {across, across, radius_squared / 2.0};
  }
  // The volumes of the cylinder and of both half spheres are as their lengths, L and 4 r / 3. The
  // centre of a half sphere is 3 r / 8 from its flat face.
  Eigen::Vector3d operator()(const Capsule& capsule) const {
    const double r = capsule.radius, L = capsule.length, of_ends = 4.0 * r / 3.0;
    const double share = L / (L + of_ends);
    const double across = share * (r * r / 4.0 + L * L / 12.0) +
                          (1.0 - share) * (0.4 * r * r + L * L / 4.0 + 3.0 * L * r / 8.0);
    return {across, across, share * r * r / 2.0 + (1.0 - share) * 0.4 * r * r};
  }
  Eigen::Vector3d operator()(const Hull& hull) const { return hull.surface->unit_inertia(); }
  Eigen::Vector3d operator()(const Compound& compound) const {
    return mass_of(compound).unit_inertia.diagonal();
  }
};

struct Volume {
  double operator()(const Point&) const { return 0.0; }
  double operator()(const Sphere& sphere) const {
    return 4.0 / 3.0 * kPi * sphere.radius * sphere.radius * sphere.radius;
  }
  double operator()(const Box& box) const { return box.size.prod(); }
  double operator()(const Plane&) const { return 0.0; }
  double operator()(const Cylinder& cylinder) const {
    return kPi * cylinder.radius * cylinder.radius * cylinder.length;
  }
  double operator()(const Hull& hull) const { return hull.surface->volume(); }
  double operator()(const Capsule& capsule) const {
    return kPi * capsule.radius * capsule.radius * (capsule.length + 4.0 / 3.0 * capsule.radius);
  }
  double operator()(const Compound& compound) const {
    double sum = 0.0;
    for (const ShapePart& part : *compound.parts) sum += volume(part.shape);
    return sum;
  }
};

}  // namespace

Compound::Compound(Parts given) : parts(std::make_shared<const Parts>(std::move(given))) {
  validate(Shape(*this));
}

double volume(const Shape& shape) { return std::visit(Volume{}, shape); }

// Sums moments about the first part, whose distance from the body may be large against the parts
// (parallel axes).
CompoundMass mass_of(const Compound& compound) {
  const Compound::Parts& parts = *compound.parts;
  const Eigen::Vector3d origin = parts.front().pose.position;
  const double all = volume(Shape(compound));
  Eigen::Vector3d arm = Eigen::Vector3d::Zero();
  for (const ShapePart& part : parts)
    arm += volume(part.shape) / all * (part.pose.position - origin);
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
  for (const ShapePart& part : parts) {
    const Eigen::Matrix3d R = part.pose.orientation.toRotationMatrix();
    const Eigen::Vector3d r = part.pose.position - origin - arm;
    inertia += volume(part.shape) / all *
               (R * unit_inertia(part.shape).asDiagonal() * R.transpose() +
                r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose());
  }
  return {origin + arm, inertia};
}

Eigen::Vector3d unit_inertia(const Shape& shape) { return std::visit(UnitInertia{}, shape); }

}  // namespace constraint_sim::engine
