#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Positions and velocities of points at one time: centres of mass, and of bodies that turn three
/// points at the radius of gyration, along their axes.
struct Points {
  List<Eigen::Vector3d> position, velocity;  ///< world [m], [m/s]
};

/// Estimates the local error of a method without an embedded formula from what points do at the
/// ends of equal ticks. Simpson's rule over two of them is off by h⁵ x⁽⁵⁾/90, which is of the size
/// of the error of a composition of order 4; the second difference of velocities is h² x⁽³⁾, of
/// which the midpoint rule is off by a twelfth. Points that turn are compared in a frame that turns
/// as their body does in the middle, so that a spin counts by what the method turns it by too
/// little, however far a tick turns it. Of motion that the ticks do not resolve the estimate is of
/// the size of that motion.
class EndpointEstimate {
 public:
  /// Where the points at the start are put, before a first tick made of two halves.
  Points* start() { return &last_; }
  /// The same at the middle of that tick, and at the end of each tick.
  Points* middle() { return &middle_; }
  Points* end() { return &end_; }

  /// Of the first tick, or of one more, of length h [s]: made by steps of order 4, or of order 2,
  /// `parts` equal ones [m]. Points begin with the centres of so many bodies.
  double first(double h, bool is_order_4, int parts, std::size_t bodies);
  double next(double h, bool is_order_4, int parts, std::size_t bodies);

  /// Visits what the next estimate goes by, as engine/memory.h says.
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

  Points before_, last_, middle_, end_;  // at the ends of two ticks, and in the one that is made
  double tick_ = 0.0;                    // length of the last one [s]
  double estimate_ = 0.0;                // for it [m]
};

}  // namespace constraint_sim::engine
