#pragma once

#include <ros/time.h>

#include <cstdint>

#include "sim/stamps.h"

namespace constraint_sim {

// Conversions to ros::Time, used by all of the node. ros::Time throws beyond 2³² s, which simulated
// time may exceed; the conversions saturate at its last moment.

inline ros::Time time_from_nanoseconds(std::int64_t nanoseconds) {
  return ros::Time().fromNSec(static_cast<std::uint64_t>(nanoseconds));
}

inline ros::Time time_from_seconds(double seconds) {
  return time_from_nanoseconds(Stamps::nanoseconds(seconds));
}

/// Monotonic wall clock [s].
inline double steady_now() { return ros::SteadyTime::now().toSec(); }

}  // namespace constraint_sim
