#pragma once

// Parts shared by the problems of events.

#include <algorithm>

#include "../phases.h"
#include "common.h"
#include "rotation_between.h"

namespace constraint_sim::report {

/// A dissipative problem whose motion is known in closed form or by phases.
inline Problem event(const std::string& name, double duration, double length = 1.0) {
  Problem made = problem(name, "event", duration, length);
  made.is_conservative = false;
  made.is_planar = true;
  made.source = "closed form";
  return made;
}

inline Problem in_phases(Problem made, const Phase& first, const Reals& start, double step) {
  made.reference = motion_in_phases(made, first, start, step);
  made.source = "phases in long double, by extrapolation, events by bisection";
  return made;
}

/// Position and velocity along a line.
struct OnLine {
  Real x = 0, v = 0;
};

/// Advances with a constant acceleration.
inline OnLine moved(OnLine from, Real a, Real time) {
  return {from.x + time * (from.v + a * time / 2), from.v + a * time};
}

/// Motion of a mass that falls from `height` with g and bounces at 0, with restitution e < 1 until
/// it rests, with e = 1 for ever.
inline OnLine bouncing_from(Real height, Real e, Real g, Real t) {
  const Real fall = std::sqrt(2 * height / g);
  if (t < fall) return moved({height, 0}, -g, t);
  t -= fall;
  for (Real v = e * g * fall; v > 1e-15L; v *= e) {
    const Real flight = 2 * v / g;
    if (t < flight) return moved({0, v}, -g, t);
    t -= flight;
  }
  return {};
}

/// Makes the reference of a problem in which the last body moves along a line from its start and
/// all others rest.
inline Problem along_line(Problem made, const Eigen::Vector3d& direction,
                          const std::function<OnLine(Real)>& motion) {
  States start;
  for (const Body& body : made.bodies) start.push_back(body.start);
  made.reference = closed_form(made, [=](long double t) {
    const OnLine now = motion(t);
    States states = start;
    states.back().position += static_cast<double>(now.x) * direction;
    states.back().velocity = static_cast<double>(now.v) * direction;
    return states;
  });
  return made;
}

/// A slider from the world to the centre of a body, along an axis.
inline Joint slider_to(const Problem& made, int body, const Eigen::Vector3d& axis) {
  const State& start = made.bodies[static_cast<std::size_t>(body)].start;
  Joint joint;
  joint.kind = JointKind::kSlider;
  joint.b = body;
  joint.anchor_a = start.position;
  joint.frame_a = rotation_between(Eigen::Vector3d::UnitZ(), axis);
  joint.frame_b = start.orientation.conjugate() * joint.frame_a;
  return joint;
}

inline Joint rope_to(int body, const Eigen::Vector3d& anchor, double length) {
  Joint joint;
  joint.kind = JointKind::kFreeLength;
  joint.b = body;
  joint.anchor_a = anchor;
  joint.upper = length;
  return joint;
}

}  // namespace constraint_sim::report
