#pragma once

#include <Eigen/Core>

#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_driven.h"

namespace constraint_sim::engine {

/// What EventDriven::advance() goes through.
struct EventDriven::Span {
  const SmoothSpan& all;
  const IntegratorOptions& accuracy;
  const Surroundings& around;
  RungeKutta* motion;
  List<BodyState>* states;  ///< of the world; those of the island at `left.t`
  SubstepSpan left;
  IntegrationResult progress;
  bool begins = true;  ///< nothing has moved since it did
};

/// A complementarity problem of all laws at an event, with the rigid joints held.
struct EventDriven::Rows {
  List<double> y, dydt;                       ///< of the bare equations
  List<Reading> reading;                      ///< of laws, without one-sided forces
  List<EquationsOfMotion::Motions> response;  ///< to a unit impulse along each law
  List<List<double>> joint_impulses;          ///< the same
  Eigen::MatrixXd A;                          ///< rates of laws by impulses along laws
  Eigen::VectorXd acceleration;               ///< of laws with their forces, once these are decided
  List<char> is_free;                         ///< laws whose coordinate the rigid joints leave free
  List<double> hit;                           ///< impulses that laws had in impacts
  List<double> rests_in;  ///< [s] after which bounces that are not followed are over
};

}  // namespace constraint_sim::engine
