#pragma once

#include <ros/time.h>

#include <cstdint>

#include "sim/stamps.h"

namespace constraint_sim {

// ros::Time throws beyond 2³² s, and simulated time may be there: these stay at the last moment
// that it can tell. Nothing else in the node makes one of seconds.

inline ros::Time time_from_nanoseconds(std::int64_t nanoseconds) {
  return ros::Time().fromNSec(static_cast<std::uint64_t>(nanoseconds));
}

inline ros::Time time_from_seconds(double seconds) {
  return time_from_nanoseconds(Stamps::nanoseconds(seconds));
}

/// Time of the wall that only grows [s].
inline double steady_now() { return ros::SteadyTime::now().toSec(); }

}  // namespace constraint_sim
