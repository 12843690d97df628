#pragma once

#include <optional>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/least_norm_forces.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_joints.h"

namespace constraint_sim::engine {

/// Impulses of the joints of an event-driven island since the start of the step.
class EventImpulses {
 public:
  struct Sums {
    List<RowVector> joint;
    List<double> coupled;
  };

  explicit EventImpulses(std::size_t joints) { begin_step(joints); }
  void begin_step(std::size_t joints);

  /// Impulses per joint, laid out as JointForces::impulse().
  const Sums& sums() const { return sums_; }
  void restore(const Sums& sums) { sums_ = sums; }
  /// Adds an impulse along a law.
  void add(const OneSidedLaw& law, double impulse);
  /// Adds the impulses of `equations`, which act since the last call; redundant rows share them by
  /// least norm, at the states of the bodies.
  void collect(const EventJoints& joints, const EquationsOfMotion& equations,
               const List<BodyState>& states);
  /// Adds the impulses of the equations without one-sided rows.
  void collect_bare(const EventJoints& joints, const EquationsOfMotion& bare);
  /// Notes that other equations act from now on.
  void forget_equations() { least_forces_.reset(); }

 private:
  Sums sums_;
  std::optional<LeastNormForces> least_forces_;  // reported forces of the rows that act now
};

}  // namespace constraint_sim::engine
