#include "constraint_sim/engine/shape.h"

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
};

struct Validate {
  void operator()(const Point&) const {}
  void operator()(const Sphere& sphere) const { check_positive("shape.radius", sphere.radius); }
  void operator()(const Box& box) const {
    check_positive("shape.size.x", box.size.x());
    check_positive("shape.size.y", box.size.y());
    check_positive("shape.size.z", box.size.z());
  }
  void operator()(const Plane&) const {}
  void operator()(const Cylinder& cylinder) const {
    check_positive("shape.radius", cylinder.radius);
    check_positive("shape.length", cylinder.length);
  }
};

}  // namespace

Eigen::Vector3d unit_inertia(const Shape& shape) { return std::visit(UnitInertia{}, shape); }

void validate(const Shape& shape) { std::visit(Validate{}, shape); }

}  // namespace constraint_sim::engine
