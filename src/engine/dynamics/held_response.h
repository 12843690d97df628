#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/dynamics/delassus_matrix.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kinematics.h"
#include "engine/dynamics/state_vector.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Impulse on up to four bodies, given by index. Bodies outside the island do not move. The list of
/// bodies ends at the first 0.
struct BodyImpulse {
  std::array<int, 4> body{};
  std::array<Eigen::Vector3d, 4> linear, angular;
};

/// Returns the velocity changes by an impulse while the rigid rows hold: Δv = M⁻¹(f + Gᵀλ) with
/// G Δv = 0. Writes the reactions of the rows to `impulses`, by unknown.
Motions held_response(const IslandModel& island, const IntervalInputs& inputs,
                      const Kinematics& kinematics, const BodyImpulse& impulse,
                      DelassusMatrix* delassus, List<double>* impulses);
/// Returns the impulse times the velocity change it causes on bodies without joints [J].
double free_response(const IslandModel& island, const Kinematics& kinematics,
                     const BodyImpulse& impulse);

}  // namespace constraint_sim::engine
