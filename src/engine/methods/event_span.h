#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/methods/event_driven.h"

namespace constraint_sim::engine {

/// What EventDriven::advance() goes through.
struct EventDriven::Span {
  const SmoothSpan& all;
  const IntegratorOptions& accuracy;
  const Surroundings& around;
  RungeKutta* motion;
  std::vector<BodyState>* states;  ///< of the world; those of the island at `left.t`
  SubstepSpan left;
  IntegrationResult progress;
  bool begins = true;  ///< nothing has moved since it did
};

/// A complementarity problem of all laws at an event, with the rigid joints held.
struct EventDriven::Rows {
  std::vector<double> y, dydt;                       ///< of the bare equations
  std::vector<Reading> reading;                      ///< of laws, without one-sided forces
  std::vector<EquationsOfMotion::Motions> response;  ///< to a unit impulse along each law
  std::vector<std::vector<double>> joint_impulses;   ///< the same
  Eigen::MatrixXd A;                                 ///< rates of laws by impulses along laws
  Eigen::VectorXd acceleration;  ///< of laws with their forces, once these are decided
  std::vector<char> is_free;     ///< laws whose coordinate the rigid joints leave free
  std::vector<double> hit;       ///< impulses that laws had in impacts
  std::vector<double> rests_in;  ///< [s] after which bounces that are not followed are over
};

}  // namespace constraint_sim::engine
