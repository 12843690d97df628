#include "engine/dynamics/fit_velocities.h"

#include <algorithm>
#include <cmath>

#include "engine/dynamics/rigid_motion.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

// Share of the kinetic energy that a second order error explains. A larger change is an impact, as
// when the length of a pulley passes zero, and its energy is lost.
constexpr double kMostKept = 1e-3;

bool is_free(const EquationsOfMotion& equations) {
  return equations.points() == equations.bodies().size();
}

RigidMotion as_one_body(const EquationsOfMotion& equations, const List<BodyState>& bodies) {
  List<double> mass;
  List<Eigen::Vector3d> inertia, position;
  List<Eigen::Quaterniond> orientation;
  BodyVectors velocity;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    mass.push_back(1.0 / equations.inverse_mass(i));
    position.push_back(bodies[i].position);
    velocity.linear.push_back(bodies[i].linear_velocity);
    if (i >= equations.rotating()) continue;
    inertia.push_back(equations.inertia(i));
    orientation.push_back(bodies[i].orientation);
    velocity.angular.push_back(bodies[i].angular_velocity);
  }
  return as_one_body(mass, inertia, position, orientation, velocity);
}

}  // namespace

void fit_velocities(const Interval& interval, double most_moved, EquationsOfMotion* equations,
                    List<BodyState>* states) {
  equations->begin(interval.t, *states, interval.gravity, interval.loads, interval.prescribed,
                   interval.since_tick);
  if (equations->inputs().is_time_dependent() || equations->inputs().has_jumped()) return;
  List<double> numbers(2 * equations->size());
  double* const y = numbers.data();
  gather_state(*equations, *states, y);
  const double energy = kinetic_energy(*equations, y);
  equations->keep_impulses();
  const bool is_met = equations->start(interval.t, y, y + equations->size());
  equations->restore_impulses();  // later steps start again
  if (!is_met) return;
  const double left = kinetic_energy(*equations, y);
  const double moved = energy - left;
  if (!(moved > 0.0) || moved > std::min(most_moved, kMostKept) * energy) return;

  const List<BodyState> before = states_of(*equations, *states);
  equations->scatter_state(y, states);
  RigidMotion whole;
  if (is_free(*equations)) whole = as_one_body(*equations, states_of(*equations, *states));
  const double inner = left - whole.kinetic_energy();
  const double longer = std::sqrt(1.0 + moved / inner);
  for (std::size_t i = 0; i < before.size(); ++i) {
    BodyState& state = (*states)[static_cast<std::size_t>(equations->bodies()[i])];
    if (!(inner > 0.0)) {  // no motion is left to take the energy
      state = before[i];
      continue;
    }
    const Eigen::Vector3d v = whole.velocity_at(state.position);
    state.linear_velocity = v + longer * (state.linear_velocity - v);
    if (i >= equations->rotating()) continue;
    const Eigen::Vector3d w = whole.angular_velocity();
    state.angular_velocity = w + longer * (state.angular_velocity - w);
  }
}

}  // namespace constraint_sim::engine
