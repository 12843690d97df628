#pragma once

#include <optional>

#include "engine/collision/broadphase.h"
#include "engine/model/mass_properties.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

class Rollback;
struct StepContext;

// Hits of two shapes within a step, by conservative advancement (Mirtich 1996).

/// Gap at which a hit happens, as a share of the thinner body.
constexpr double kNearShare = 1e-9;
/// Largest rotation of a body for which time_of_hit() bounds its speed [rad].
constexpr double kMostSweptTurn = 0.5;

/// Returns the state after a step of impulses of duration t [s] under gravity alone.
BodyState moved(const BodyState& state, const MassProperties& mass, const Eigen::Vector3d& gravity,
                double t);

/// First time at which a pair that is apart touches by its velocities [s]. The plane between two
/// shapes keeps them apart as long as they do not close the gap along its normal. Empty where the
/// pair does not touch, and in a step that is to stop. Adds the poses tried to `advances`.
std::optional<double> time_of_hit(const StepContext& step, const State& state,
                                  const Broadphase::Pair& pair, double duration,
                                  int* advances = nullptr);

/// Whether two bodies that have taken their step met within the step, where they were apart; false
/// once a stop flag is set.
bool passes(const StepContext& step, const State& state, const Rollback& rollback,
            const Broadphase::Pair& pair);

}  // namespace constraint_sim::engine
