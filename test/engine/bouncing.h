#pragma once

#include <cmath>
#include <vector>

#include "support.h"

namespace constraint_sim::engine {

// ---- a fall from h onto a floor or a stop, and bounces

struct Flight {
  double speed, since;  ///< initial speed upwards, and time since then; 0 once at rest
  double height() const { return speed * since - 0.5 * kGravity * since * since; }
  double top() const { return 0.5 * speed * speed / kGravity; }
};

inline Flight flight_at(double h, double e, double t) {
  const double fall = std::sqrt(2.0 * h / kGravity);
  Flight flight{kGravity * fall, t + fall};  // the fall is the second half of a flight
  while (flight.since >= 2.0 * flight.speed / kGravity) {
    flight.since -= 2.0 * flight.speed / kGravity;
    flight.speed *= e;
    if (flight.speed < 1e-7) return {0.0, 0.0};
  }
  return flight;
}

inline double bouncing(double h, double e, double t) { return flight_at(h, e, t).height(); }

/// Expects a height to rounding, except during bounces below 1e-10 m, which the engine does not
/// follow.
inline void expect_bouncing(double height, double h, double e, double t) {
  const Flight flight = flight_at(h, e, t);
  const bool is_followed = flight.top() == 0.0 || flight.top() > 1.01e-10;
  EXPECT_NEAR(height, flight.height(), is_followed ? 1e-12 : 1e-10) << e << " at " << t;
}

// ---- a row of balls

/// Equal balls on a line. Two that meet are thrown apart with e of their approach speed; of several
/// collisions at a time the fastest is first.
struct BallsOnALine {
  std::vector<long double> x, v;
  long double e, apart;  // distance of the centres of touching balls

  void advance(long double seconds) {
    for (long double left = seconds;;) {
      long double soonest = left, fastest = 0;
      std::size_t which = x.size();
      for (std::size_t i = 0; i + 1 < x.size(); ++i) {
        const long double speed = v[i] - v[i + 1];
        if (speed < 1e-12L) continue;
        long double meet = (x[i + 1] - x[i] - apart) / speed;
        if (meet < 1e-12L) meet = 0;  // rounding of the positions of touching balls
        if (meet > soonest || (meet == soonest && speed <= fastest)) continue;
        soonest = meet;
        fastest = speed;
        which = i;
      }
      for (std::size_t i = 0; i < x.size(); ++i) x[i] += soonest * v[i];
      left -= soonest;
      if (which == x.size()) return;
      const long double mean = (v[which] + v[which + 1]) / 2;
      v[which] = mean - e * fastest / 2;
      v[which + 1] = mean + e * fastest / 2;
    }
  }
};

}  // namespace constraint_sim::engine
