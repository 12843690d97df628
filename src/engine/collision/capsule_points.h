#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "engine/collision/least_depth_axis.h"
#include "engine/collision/manifold_points.h"
#include "engine/collision/narrowphase_tolerances.h"
#include "engine/collision/polytope.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// A capsule is the set of points within its radius of its middle line. Its gap from another shape
// is the gap of the line, less the radius.

/// Sine of the angle of two lines below which they touch with both ends.
inline constexpr double kAlongSine = 1e-3;
/// Features are of an end of the line (0, 1) or of its middle, and of a part of B.
inline constexpr std::uint32_t kEndCode = 0x10000U, kMiddle = 2;

/// Gap of a middle line A and a shape B.
struct LineGap {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, from B to A
  double gap = kInfinity;  ///< [m]; negative where the line crosses the shape
  Eigen::Vector3d on_b = Eigen::Vector3d::Zero();  ///< nearest or deepest point of B [m]
  std::uint32_t feature = 0;
};

/// Returns the middle line of a capsule.
inline Segment middle_line(const Capsule& capsule, const BodyState& state,
                           const Eigen::Vector3d& origin) {
  return {state.position - origin, state.orientation * Eigen::Vector3d::UnitZ(),
          0.5 * capsule.length};
}

/// Part of a middle line, between two places [m].
struct PlaceRange {
  double from, to;
};

/// Contact points of a capsule along a normal.
class CapsulePoints {
 public:
  CapsulePoints(const Segment& line, double radius, const Eigen::Vector3d& normal,
                const Eigen::Vector3d& origin, double margin)
      : line_(line), radius_(radius), origin_(origin), margin_(margin) {
    manifold_.normal = normal;
  }

  void add(const Eigen::Vector3d& on_b, double gap_of_line, std::uint32_t feature) {
    add_point(manifold_, origin_ + on_b, radius_ - gap_of_line, feature, margin_);
  }
  /// Adds both ends of a part of the line; surface(p) is the point of B that p touches.
  template <class Surface>
  void add_ends(const PlaceRange& part, std::uint32_t feature, Surface surface) {
    for (const std::uint32_t end : {0U, 1U}) {
      const Eigen::Vector3d p = line_.at(end == 0 ? part.from : part.to);
      const Eigen::Vector3d on_b = surface(p);
      add(on_b, manifold_.normal.dot(p - on_b), end * kEndCode + feature);
    }
  }
  double least_gap() const {
    double gap = kInfinity;
    for (int i = 0; i < manifold_.count; ++i)
      gap = std::min(gap, -manifold_.points[static_cast<std::size_t>(i)].depth);
    return gap;
  }
  const Manifold& manifold() const { return manifold_; }

 private:
  const Segment& line_;
  double radius_;
  Eigen::Vector3d origin_;
  double margin_;
  Manifold manifold_;
};

/// Returns the contact of a capsule: both ends of the part of its line along a feature of B, which
/// `add_feature` adds, unless another point is nearer; else the nearest point.
template <class AddFeature>
Manifold contact_of_capsule(const Segment& line, double radius, const LineGap& found,
                            const Eigen::Vector3d& origin, double margin, AddFeature add_feature) {
  const double gap = found.gap - radius;
  if (!(gap < margin)) return {};
  if (std::abs(found.normal.dot(line.axis)) <= kFlatSine) {
    const CapsulePoints both = add_feature(found.normal);
    if (both.manifold().count > 0 &&
        (gap <= 0.0 || both.least_gap() <= gap + kCloserShare * margin))
      return both.manifold();
  }
  CapsulePoints single(line, radius, found.normal, origin, margin);
  single.add(found.on_b, found.gap, found.feature);
  return single.manifold();
}

/// Returns the part of a line beside another line that is parallel to it.
inline std::optional<PlaceRange> line_beside(const Segment& line, const Eigen::Vector3d& from,
                                             const Eigen::Vector3d& to) {
  const double s_0 = line.axis.dot(from - line.centre), s_1 = line.axis.dot(to - line.centre);
  const PlaceRange part{std::max(-line.half, std::min(s_0, s_1)),
                        std::min(line.half, std::max(s_0, s_1))};
  if (part.from >= part.to) return std::nullopt;
  return part;
}

}  // namespace constraint_sim::engine
