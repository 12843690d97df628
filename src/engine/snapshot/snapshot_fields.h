#pragma once

#include <array>
#include <optional>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>

#include "engine/constraints/one_sided_law.h"
#include "engine/islands/island_memory.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

// The fields of structs in snapshots that have no list in model/fields.h. Structured bindings need
// exactly as many names as a struct has fields: a struct with another number of fields does not
// compile.

template <class T>
struct Of {};

/// Ties the fields of a struct. Only the number of the names matters.
#define CONSTRAINT_SIM_FIELDS(Struct, ...) \
  template <class T>                       \
  auto fields(T& value, Of<Struct>) {      \
    auto& [__VA_ARGS__] = value;           \
    return std::tie(__VA_ARGS__);          \
  }

CONSTRAINT_SIM_FIELDS(MassProperties, a, b, c, d)
CONSTRAINT_SIM_FIELDS(Coupling, a, b, c, d, e)
CONSTRAINT_SIM_FIELDS(Joint, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t)
CONSTRAINT_SIM_FIELDS(CustomParameter, a, b)
template <class T>
auto fields(T& value, Of<CustomElement>) {
  auto& [a, b, c] = value;  // a reader makes the code (c) from type and parameters
  static_cast<void>(c);
  return std::tie(a, b);
}
CONSTRAINT_SIM_FIELDS(CoordinateState, a, b, c, d, e, f, g)
CONSTRAINT_SIM_FIELDS(CouplingState, a, b, c, d)
CONSTRAINT_SIM_FIELDS(MovingStart, a, b, c, d, e)
CONSTRAINT_SIM_FIELDS(ErrorsToClose, a, b, c, d, e, f)
// In the order of the format of snapshots, with the memory between the fields of the state.
template <class T>
auto fields(T& value, Of<JointData>) {
  using State = std::conditional_t<std::is_const_v<T>, const JointState, JointState>;
  using Memory = std::conditional_t<std::is_const_v<T>, const JointMemory, JointMemory>;
  auto& [error, error_rate, angle_error, radius, force, bias, reached_rate, saturated, broken,
         closing, coordinates, coupling, travel, expires_at] = static_cast<State&>(value);
  auto& [impulse, coupling_impulse, to_close, closing_share, initial_error] =
      static_cast<Memory&>(value);
  return std::tie(error, error_rate, angle_error, radius, force, bias, reached_rate, saturated,
                  broken, closing, coordinates, coupling, coupling_impulse, travel, to_close,
                  closing_share, expires_at, initial_error, impulse);
}
CONSTRAINT_SIM_FIELDS(MotorRate, a, b, c, d)
CONSTRAINT_SIM_FIELDS(JointStart, a, b, c, d, e, f)
CONSTRAINT_SIM_FIELDS(Wrench, a, b, c, d, e)
CONSTRAINT_SIM_FIELDS(Manifold::Point, a, b, c)
CONSTRAINT_SIM_FIELDS(Contact, a, b, c, d, e, f, g, h, i, j)
CONSTRAINT_SIM_FIELDS(SelfStress, a, b)
CONSTRAINT_SIM_FIELDS(AppliedWrench, a, b, c)
CONSTRAINT_SIM_FIELDS(OneSidedState, a, b, c, d, e)
CONSTRAINT_SIM_FIELDS(IslandMemory, a, b, c, d, e, f, g, h, i, j, k, l)
CONSTRAINT_SIM_FIELDS(Island, a, b, c, d, e, f, g, h, i, j, k, l, m)
CONSTRAINT_SIM_FIELDS(WatchedEnergy, a, b, c, d, e, f, g)
CONSTRAINT_SIM_FIELDS(Monitors::UnclosedJoint, a, b, c, d)
CONSTRAINT_SIM_FIELDS(Monitors::HeldPair, a, b, c, d, e, f)
CONSTRAINT_SIM_FIELDS(StepReport::Joints, a, b, c, d, e, f, g, h)
CONSTRAINT_SIM_FIELDS(StepReport::Energy, a, b, c, d, e, f, g)
CONSTRAINT_SIM_FIELDS(StepReport::Contacts, a, b, c, d, e, f, g, h, i, j, k, l)
CONSTRAINT_SIM_FIELDS(StepReport::Outcome, a, b, c, d)
CONSTRAINT_SIM_FIELDS(StepReport::Costs, a, b, c, d, e, f, g, h, i, j, k)
CONSTRAINT_SIM_FIELDS(StepReport, a, b, c, d, e, f, g, h, i)
CONSTRAINT_SIM_FIELDS(State, a, b, c, d, e, f, g, h, i, j, k, l)
// Leaves out the options, which snapshots visit before, and the maps by name, which a reader makes.
template <class T>
auto fields(T& value, Of<Model>) {
  auto& [options, bodies, masses, body_ids, joints, joint_starts, joint_ids, next_body_id,
         next_joint_id, body_by_name, joint_by_name] = value;
  return std::tie(bodies, masses, body_ids, joints, joint_starts, joint_ids, next_body_id.value,
                  next_joint_id.value);
}

#undef CONSTRAINT_SIM_FIELDS

}  // namespace constraint_sim::engine
