#include "ros/actuator_efforts.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/constraints/coupling.h"

namespace constraint_sim {
namespace {

// Returns the mean effort of spring, damper and friction over a step at a constant rate, which a
// rigid motor prescribes. The split between a motor at rest and friction is not determined; all of
// the effort is the motor's then.
double passive_effort(const engine::CoordinateLaw& law, const engine::CoordinateState& now,
                      double time_step) {
  const double rate = now.bias;
  const double middle = now.position - 0.5 * time_step * rate;
  const double friction = rate == 0.0 ? 0.0 : std::copysign(law.friction, rate);
  return -law.stiffness * (middle - law.rest) - law.damping * rate - friction;
}

double effort_of(const engine::Motor& motor, const engine::CoordinateLaw& law,
                 const engine::CoordinateState& now, bool is_saturated, double coupled,
                 double time_step) {
  const double most =
      motor.max_force > 0.0 ? motor.max_force : std::numeric_limits<double>::infinity();
  if (motor.force) return std::clamp(*motor.force, -most, most);
  if (motor.is_servo())
    return std::clamp(-motor.servo_stiffness * (now.position - *motor.position) -
                          motor.servo_damping * now.velocity,
                      -most, most);
  const double own = now.effort - coupled - passive_effort(law, now, time_step);
  if (is_saturated && motor.max_force > 0.0) {
    const double lag = now.bias - now.velocity;
    return std::copysign(most, lag == 0.0 ? own : lag);
  }
  return std::clamp(own, -most, most);
}

}  // namespace

ActuatorEfforts::ActuatorEfforts(const engine::World& world) : world_(world) {
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    const double effort = world.joint_state(id).coupling.effort;
    if (joint.kind == engine::JointKind::kGear) {
      coupled_[{joint.coupling.first.value, 0}] += effort;
      coupled_[{joint.coupling.second.value, 0}] += joint.coupling.ratio * effort;
    } else if (joint.kind == engine::JointKind::kScrew) {
      coupled_[{id.value, 0}] += effort;
      coupled_[{id.value, 1}] -= engine::lead(joint) * effort;
    }
  }
}

double ActuatorEfforts::coupled(engine::JointId joint, std::size_t coordinate) const {
  const auto found = coupled_.find({joint.value, coordinate});
  return found == coupled_.end() ? 0.0 : found->second;
}

std::array<double, engine::kMaxCoordinates> ActuatorEfforts::of(engine::JointId id) const {
  const engine::Joint& joint = world_.joint(id);
  const engine::JointState& state = world_.joint_state(id);
  std::array<double, engine::kMaxCoordinates> efforts{};
  if (!joint.enabled || state.broken) return efforts;
  for (std::size_t i = 0; i < efforts.size(); ++i) {
    const engine::CoordinateLaw& law = joint.coordinates[i];
    if (law.motor)
      efforts[i] = effort_of(*law.motor, law, state.coordinates[i], state.saturated, coupled(id, i),
                             world_.options().time_step);
  }
  return efforts;
}

}  // namespace constraint_sim
