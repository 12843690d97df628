#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {
namespace {

std::string shape_refusal(const Shape& shape) {
  try {
    validate(shape);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// Returns the mean of (y² + z², z² + x², x² + y²) over the solid, by the midpoint rule on n³ cells
/// of its bounding box.
template <class IsInside>
Eigen::Vector3d integrated_unit_inertia(const Eigen::Vector3d& size, const IsInside& is_inside) {
  constexpr int n = 100;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double cells = 0.0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      for (int k = 0; k < n; ++k) {
        const Eigen::Vector3d share = Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5) / n;
        const Eigen::Vector3d p = size.cwiseProduct(share - Eigen::Vector3d::Constant(0.5));
        if (!is_inside(p)) continue;
        sum += Eigen::Vector3d(p.tail<2>().squaredNorm(), p.z() * p.z() + p.x() * p.x(),
                               p.head<2>().squaredNorm());
        cells += 1.0;
      }
    }
  }
  return sum / cells;
}

TEST(UnitInertia, IsTheIntegralOverTheSolid) {
  const Box box{{1.0, 2.0, 3.0}};
  const Eigen::Vector3d of_box =
      integrated_unit_inertia(box.size, [](const Eigen::Vector3d&) { return true; });
  const Sphere sphere{1.5};
  const Eigen::Vector3d of_sphere = integrated_unit_inertia(
      Eigen::Vector3d::Constant(3.0), [](const Eigen::Vector3d& p) { return p.norm() < 1.5; });

  const Cylinder cylinder{0.5, 3.0};
  const Eigen::Vector3d of_cylinder = integrated_unit_inertia(
      {1.0, 1.0, 3.0}, [](const Eigen::Vector3d& p) { return p.head<2>().norm() < 0.5; });

  const Capsule capsule{0.5, 2.0};
  const Eigen::Vector3d of_capsule =
      integrated_unit_inertia({1.0, 1.0, 3.0}, [](const Eigen::Vector3d& p) {
        const double beyond = std::max(std::abs(p.z()) - 1.0, 0.0);
        return p.head<2>().squaredNorm() + beyond * beyond < 0.25;
      });

  // the error of the midpoint rule is 1/n² = 1e-4, and slightly more at the sphere's ragged surface
  EXPECT_TRUE(unit_inertia(box).isApprox(of_box, 2e-4)) << of_box.transpose();
  EXPECT_TRUE(unit_inertia(sphere).isApprox(of_sphere, 1e-3)) << of_sphere.transpose();
  EXPECT_TRUE(unit_inertia(cylinder).isApprox(of_cylinder, 1e-3)) << of_cylinder.transpose();
  EXPECT_TRUE(unit_inertia(capsule).isApprox(of_capsule, 1e-3)) << of_capsule.transpose();
}

TEST(UnitInertia, OfWhatHasNoVolumeIsZero) {
  EXPECT_TRUE(unit_inertia(Point{}).isZero(0.0));
  EXPECT_TRUE(unit_inertia(Plane{}).isZero(0.0));
}

TEST(UnitInertia, OfALongRodKeepsItsSmallMoment) {
  // 1/12 (y² + z²) has no cancellation: two roundings
  EXPECT_DOUBLE_EQ(unit_inertia(Box{{1e9, 1.0, 2.0}}).x(), 5.0 / 12.0);
}

TEST(ValidateShape, AcceptsWhatCanBe) {
  EXPECT_EQ(shape_refusal(Point{}), "");
  EXPECT_EQ(shape_refusal(Plane{}), "");
  EXPECT_EQ(shape_refusal(Sphere{1e-20}), "");
  EXPECT_EQ(shape_refusal(Box{{1e-6, 1.0, 1e6}}), "");
  EXPECT_EQ(shape_refusal(Cylinder{1e-6, 1e6}), "");
}

TEST(ValidateShape, NamesTheDimensionAndItsValue) {
  const double inf = std::numeric_limits<double>::infinity();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(shape_refusal(Capsule{1e-6, 1e6}), "");
  EXPECT_EQ(shape_refusal(Capsule{1.0, 0.0}), "shape.length: must be a finite number > 0, got 0");
  EXPECT_EQ(shape_refusal(Cylinder{0.0, 1.0}), "shape.radius: must be a finite number > 0, got 0");
  EXPECT_EQ(shape_refusal(Cylinder{1.0, -1.0}),
            "shape.length: must be a finite number > 0, got -1");
  EXPECT_EQ(shape_refusal(Sphere{}), "shape.radius: must be a finite number > 0, got 0");
  EXPECT_EQ(shape_refusal(Sphere{-1.0}), "shape.radius: must be a finite number > 0, got -1");
  EXPECT_EQ(shape_refusal(Sphere{nan}), "shape.radius: must be a finite number > 0, got nan");
  EXPECT_EQ(shape_refusal(Sphere{inf}), "shape.radius: must be a finite number > 0, got inf");
  EXPECT_EQ(shape_refusal(Box{{0.0, 1.0, 1.0}}),
            "shape.size.x: must be a finite number > 0, got 0");
  EXPECT_EQ(shape_refusal(Box{{1.0, -0.1, 1.0}}),
            "shape.size.y: must be a finite number > 0, got -0.1");
  EXPECT_EQ(shape_refusal(Box{{1.0, 1.0, -inf}}),
            "shape.size.z: must be a finite number > 0, got -inf");
}

}  // namespace
}  // namespace constraint_sim::engine
