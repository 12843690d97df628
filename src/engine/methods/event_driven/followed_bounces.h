#pragma once

#include <algorithm>
#include <optional>

#include "engine/model/zero_tolerances.h"

namespace constraint_sim::engine {

/// Bounces that are followed: those higher than `lowest`, or beyond the rest of the interval. The
/// error of a bounce that is not followed is a small share of what the tolerance allows in the
/// interval, or does not exceed a distance that counts as zero.
struct FollowedBounces {
  /// In the last `rest` of an interval of length h [s], with a tolerance [m/s].
  FollowedBounces(double rest, double h, double tolerance, double touching = kTouching)
      : left(rest),
        lowest(std::max(touching, kBounceShare * tolerance * h)),
        error(lowest > touching ? lowest : 0.0) {}

  static constexpr double kBounceShare = 0.01;
  /// Fall beyond which bounces are followed, 1e5 times that of gravity [m/s²].
  static constexpr double kMostFall = 1e6;
  /// Whether a bounce at this speed [m/s or rad/s] is not followed under some fall.
  bool may_leave_out(double speed) const { return speed * speed <= 2.0 * kMostFall * lowest; }

  double left;    ///< rest of the interval [s]
  double lowest;  ///< [m or rad]
  /// Error by bounces that are not followed [m or rad]; 0 where their height counts as zero.
  double error;
};

/// Time until a body that bounces back at `speed` and falls with `fall` [m/s²] comes to rest: the
/// sum of all its bounces. Nothing where these bounces are followed; but with very many bounces in
/// the rest of the interval it comes to rest at the end.
inline std::optional<double> time_to_rest(double speed, double fall, double restitution,
                                          const FollowedBounces& followed) {
  constexpr double kMostBounces = 128.0;  // bounces to follow within the interval
  const double left = followed.left;
  if (!(speed > 0.0 && fall > 0.0 && speed * speed <= 2.0 * fall * followed.lowest))
    return std::nullopt;
  const double first = 2.0 * speed / fall;
  if (first <= (1.0 - restitution) * left) return first / (1.0 - restitution);
  if (kMostBounces * first <= left) return left;
  return std::nullopt;
}

}  // namespace constraint_sim::engine
