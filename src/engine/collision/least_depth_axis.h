#pragma once

#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// A face within 2.56° of the normal is one that touches.
constexpr double kFlatSine = 0.0447;

/// A box, or a cylinder along its z axis, in world axes.
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

  Eigen::Vector3d axis() const { return axes.col(2); }
  double radius() const { return half.x(); }

  /// How far it goes along n from its centre [m].
  double reach(const Eigen::Vector3d& n) const {
    const Eigen::Vector3d c = axes.transpose() * n;
    return is_round ? half.x() * math::hypot(c.x(), c.y()) + half.z() * std::abs(c.z())
                    : half.dot(c.cwiseAbs());
  }
  /// A point that is farthest along n, from the centre [m].
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

  Eigen::Vector3d centre;  ///< from the origin of the pair [m]
  Eigen::Matrix3d axes;    ///< in columns
  Eigen::Vector3d half;    ///< of the edges; of a cylinder radius, radius, half its length [m]
  bool is_round;
};

/// Two solids, B's centre being the origin, and the axis of least depth that was tried. A is a box
/// or a cylinder, B a cylinder.
class LeastDepthAxis {
 public:
  LeastDepthAxis(const Solid& a, const Solid& b)
      : a_(a), b_(b), t_(a.centre - b.centre), size_(a.half.sum() + b.half.sum()) {}

  const Eigen::Vector3d& normal() const { return normal_; }  ///< from B to A
  double depth() const { return depth_; }
  double depth_along(const Eigen::Vector3d& n) const {
    return a_.reach(n) + b_.reach(n) - n.dot(t_);
  }

  /// Tries all; ends at the first axis of depth ≤ −margin.
  void find(double margin);

  /// Takes the normal of a face or cap that is nearly the one of least depth: their points hold a
  /// shape more firmly.
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
