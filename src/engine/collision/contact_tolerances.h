#pragma once

#include <algorithm>
#include <cmath>
#include <variant>

#include "constraint_sim/engine/shape.h"
#include "engine/math/numbers.h"
#include "engine/model/shape_properties.h"
#include "engine/model/zero_tolerances.h"

namespace constraint_sim::engine {

/// Range of sizes of shapes in which tolerances of contacts are constant [m].
inline constexpr double kSmallShape = 0.01, kLargeShape = 10.0;
/// Least size that tolerances assume, as a share of the distance of a shape from the origin:
/// positions there are rounded to 1e-16 of the distance.
inline constexpr double kFarShare = 1e-3;

/// Size of a shape that tolerances depend on [m]: its bounding radius; infinite for points, which
/// have no size to compare with.
struct ToleranceSize : BoundingRadius {
  using BoundingRadius::operator();
  double operator()(const Point&) const { return kInfinity; }
};
/// Returns the size of a shape that tolerances of its contacts depend on [m]: the bounding radius;
/// infinite for points and planes.
inline double size_of(const Shape& shape) { return std::visit(ToleranceSize{}, shape); }
/// Size that tolerances of contacts between two shapes assume [m], at most `distance` from the
/// origin [m].
inline double size_of_contact(const Shape& a, const Shape& b, double distance) {
  return std::max(std::min(size_of(a), size_of(b)), kFarShare * distance);
}

/// Tolerances of contacts. Lengths are constant within [kSmallShape, kLargeShape], and proportional
/// to the size of the shapes beyond: the rounding of positions and the accuracy that a motion needs
/// are shares of the size. Speeds are proportional to the root of lengths, since motions under one
/// gravity are similar where times are proportional to the root of lengths.
struct ContactTolerances {
  ContactTolerances() = default;
  /// Tolerances of contacts between shapes of a size [m].
  explicit ContactTolerances(double size) {
    const double share = size < kSmallShape   ? size / kSmallShape
                         : size > kLargeShape ? size / kLargeShape
                                              : 1.0;
    const double root = std::sqrt(share);
    for (double* length : {&touching, &border, &missed, &overlap}) *length *= share;
    for (double* speed : {&resting, &slipping, &end_of_slip, &rattling}) *speed *= root;
  }

  /// Counts speeds up to `least` [m/s] as zero. Returns false, and changes nothing, where that is
  /// beyond `rattling`.
  bool coarsen(double least) {
    if (!(least <= rattling)) return false;
    for (double* speed : {&resting, &slipping, &end_of_slip}) *speed = std::max(*speed, least);
    return true;
  }

  /// Whether speeds that count as zero cannot grow any more.
  bool is_coarsest() const { return resting >= rattling; }

  double touching = kTouching;  ///< closed gap, and height of bounces not followed [m]
  double border = 1e-10;        ///< distance to a border of a feature that counts as zero [m]
  double missed = 1e-9;         ///< overlap that was missed [m]
  double overlap = 1e-7;  ///< overlap that is accepted and closed: rounding, or other methods [m]
  double resting = kResting;  ///< speed that counts as zero [m/s]
  double slipping = 1e-9;     ///< a slower slip has no direction of its own [m/s]
  double end_of_slip = 1e-7;  ///< speed below which a slip ends, an error by rounding [m/s]
  double rattling = 1e-6;     ///< speed of events that need not be followed [m/s]
};

}  // namespace constraint_sim::engine
