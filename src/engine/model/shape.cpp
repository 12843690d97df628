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
  Eigen::Vector3d operator()(const Hull& hull) const { return hull.surface->unit_inertia(); }
};

}  // namespace

Eigen::Vector3d unit_inertia(const Shape& shape) { return std::visit(UnitInertia{}, shape); }

}  // namespace constraint_sim::engine
