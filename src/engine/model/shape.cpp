#include "constraint_sim/engine/shape.h"

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
};

}  // namespace

Eigen::Vector3d unit_inertia(const Shape& shape) { return std::visit(UnitInertia{}, shape); }

}  // namespace constraint_sim::engine
