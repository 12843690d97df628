#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Whether two steps have the same length up to rounding [s]. Lengths are differences of times, and
/// times after some million steps are rounded to 1e-9 of a step.
inline bool are_equal_steps(double h, double before) { return std::abs(h - before) <= 1e-9 * h; }

/// Positions and velocities of points at one time: the centre of mass of each body, and three
/// points of each rotating body at the radius of gyration along its axes.
struct Points {
  List<Eigen::Vector3d> position, velocity;  ///< world [m], [m/s]
};

/// Estimates the local error of a method without an embedded formula, from points at the ends of
/// equal ticks. Order 4: Simpson's rule over two ticks is off by h⁵ x⁽⁵⁾/90, about the error of a
/// composition. Order 2: the second difference of velocities is h² x⁽³⁾; the midpoint rule is off
/// by a twelfth of that. Points of rotating bodies are compared in a frame that rotates with the
/// body at the middle tick, so that a spin counts only by its rotation error. Motion that the ticks
/// do not resolve gives an estimate of the size of the motion.
class EndpointEstimate {
 public:
  /// Points at the start; filled before a first tick of two halves.
  Points* start() { return &last_; }
  /// Points at the middle of the first tick, and at the end of each tick.
  Points* middle() { return &middle_; }
  Points* end() { return &end_; }

  /// Error estimate of the first tick, or of a further tick, of length h [s], in `parts` equal
  /// steps of order 4 or 2 [m]. The first `bodies` points are centres of mass.
  double first(double h, bool is_order_4, int parts, std::size_t bodies);
  double next(double h, bool is_order_4, int parts, std::size_t bodies);

  /// Visits the data that the next estimate uses, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    for (auto* points : {&self.before_, &self.last_, &self.middle_, &self.end_}) {
      visit.beside(points->position);
      visit.beside(points->velocity);
    }
    visit.beside(self.tick_);
    visit.beside(self.estimate_);
  }

 private:
  double largest(const Points& a, const Points& b, const Points& c, double h, bool is_order_4,
                 int parts, std::size_t bodies) const;
  double keep(double h, double estimate);

  // Points at the ends of the last two ticks, and in the current tick.
  Points before_, last_, middle_, end_;
  double tick_ = 0.0;      // length of the last tick [s]
  double estimate_ = 0.0;  // estimate of the last tick [m]
};

}  // namespace constraint_sim::engine
