#pragma once

#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"
#include "engine/collision/polytope.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// A box, or a cylinder along its z axis, with axes in the world.
struct Solid {
  Solid(const Eigen::Vector3d& size, const BodyState& state, const Eigen::Vector3d& origin)
      : centre(state.position - origin),
        axes(state.orientation.toRotationMatrix()),
        half(0.5 * size),
        is_round(false) {}
  Solid(const Cylinder& cylinder, const BodyState& state, const Eigen::Vector3d& origin)
      : centre(state.position - origin),
        axes(state.orientation.toRotationMatrix()),
        half(cylinder.radius, cylinder.radius, 0.5 * cylinder.length),
        is_round(true) {}

  /// A line, which is a cylinder without a radius.
  explicit Solid(const Segment& line)
      : centre(line.centre),
        axes(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), line.axis)),
        half(0.0, 0.0, line.half),
        is_round(true) {}

  Eigen::Vector3d axis() const { return axes.col(2); }
  double radius() const { return half.x(); }

  /// Returns the extent along n from the centre [m].
  double support_extent(const Eigen::Vector3d& n) const {
    const Eigen::Vector3d c = axes.transpose() * n;
    return is_round ? half.x() * math::hypot(c.x(), c.y()) + half.z() * std::abs(c.z())
                    : half.dot(c.cwiseAbs());
  }
  /// Returns a point farthest along n, relative to the centre [m].
  Eigen::Vector3d farthest(const Eigen::Vector3d& n) const {
    const Eigen::Vector3d c = axes.transpose() * n;
    Eigen::Vector3d p(std::copysign(half.x(), c.x()), std::copysign(half.y(), c.y()),
                      std::copysign(half.z(), c.z()));
    if (is_round) {
      const double across = math::hypot(c.x(), c.y());
      p.head<2>() =
          across > 0.0 ? Eigen::Vector2d(half.x() / across * c.head<2>()) : Eigen::Vector2d::Zero();
    }
    return axes * p;
  }
  Eigen::Vector3d cap_centre(int side) const { return centre + side * half.z() * axis(); }

  Eigen::Vector3d centre;  ///< centre relative to the origin of the pair [m]
  Eigen::Matrix3d axes;    ///< axes in columns
  Eigen::Vector3d half;    ///< half edge lengths; for a cylinder radius, radius, half length [m]
  bool is_round;
};

/// Search for the axis of least depth of two solids. A is a box, a cylinder or a line that crosses
/// B, and B a cylinder, whose centre is the origin.
class LeastDepthAxis {
 public:
  LeastDepthAxis(const Solid& a, const Solid& b)
      : a_(a), b_(b), t_(a.centre - b.centre), size_(a.half.sum() + b.half.sum()) {}

  const Eigen::Vector3d& normal() const { return normal_; }  ///< unit normal from B to A
  double depth() const { return depth_; }
  double depth_along(const Eigen::Vector3d& n) const {
    return a_.support_extent(n) + b_.support_extent(n) - n.dot(t_);
  }

  /// Tries all axes; ends at the first axis of depth ≤ −margin.
  void find(double margin);

  /// Replaces the axis by the normal of a face or cap that is nearly parallel, since several points
  /// of an area hold a shape more firmly.
  void take_face();

 private:
  void try_axis(const Eigen::Vector3d& direction, double least_length = 0.0);
  void find_flat();
  void find_corners();
  void find_circles();
  void find_across(const Eigen::Vector3d& axis, const Eigen::Vector3d& beside);
  void find_rims();
  void find_rims(int side_a, int side_b, double turn);

  const Solid& a_;
  const Solid& b_;
  Eigen::Vector3d t_;
  double size_;
  Eigen::Vector3d normal_ = Eigen::Vector3d::UnitZ();
  double depth_ = kInfinity;
};

}  // namespace constraint_sim::engine
