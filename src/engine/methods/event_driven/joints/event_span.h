#pragma once

#include <Eigen/Core>

#include "engine/dynamics/state_vector.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_driven.h"

namespace constraint_sim::engine {

/// State of EventDriven::advance().
struct EventDriven::Span {
  const Interval& all;
  const IntegratorOptions& accuracy;
  const Surroundings& around;
  RungeKutta* motion;
  List<BodyState>* states;  ///< all bodies of the world; bodies of the island are at `left.t`
  SubstepSpan left;
  IntegrationResult progress;
  bool begins = true;  ///< true until bodies move in the interval
};

/// Complementarity problem of all laws at an event, while the rigid joints hold.
struct EventDriven::Rows {
  List<double> y, dydt;               ///< state and derivative of the bare equations
  List<Reading> reading;              ///< per law, without one-sided forces
  List<Motions> response;             ///< per law, to a unit impulse
  List<List<double>> joint_impulses;  ///< per law, by a unit impulse
  Eigen::MatrixXd A;                  ///< rates of laws per impulse along laws
  Eigen::VectorXd acceleration;       ///< per law, with the chosen forces
  List<char> is_free;                 ///< per law: left free by the rigid joints
  List<double> hit;                   ///< per law: impulse in impacts
  List<double> rests_in;              ///< times until bounces that are not followed are over [s]
};

}  // namespace constraint_sim::engine
