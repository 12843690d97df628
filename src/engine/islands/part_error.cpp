#include "engine/islands/part_error.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

double size_of(const MassProperties& mass, const Vector3d& linear, const Vector3d& angular) {
  return std::max(linear.norm(), mass.radius_of_gyration() * angular.norm());
}

void copy_states(const List<int>& bodies, const State& state, List<BodyState>* copied) {
  copied->clear();
  for (const int body : bodies) copied->push_back(state.states[body]);
}

}  // namespace

void PartError::begin(const List<int>& bodies, const State& state) {
  is_second_ = false;
  copy_states(bodies, state, &whole_);
}

void PartError::begin_half(const List<int>& bodies, const State& state) {
  copy_states(bodies, state, &starts_);
}

void PartError::end_half(const Model& model, double h, const List<int>& bodies, const State& state,
                         const SequentialImpulses& method) {
  if (!is_second_) {
    changes_.assign(bodies.size(), Twist::Zero());
    by_changes_.assign(bodies.size(), 0.0);
  }
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const std::size_t body = to_index(bodies[i]);
    const MassProperties& mass = model.masses[body];
    Twist change = method.velocity_change(body);
    if (mass.can_turn() && !mass.is_isotropic()) {  // without the change at constant momentum
      const Vector3d after = method.velocity(body).tail<3>();
      const Vector3d L = apply_inertia(mass.inertia, state.states[body].orientation, after);
      change.tail<3>() += apply_inertia(mass.inverse_inertia, starts_[i].orientation, L) - after;
    }
    by_changes_[i] += h * size_of(mass, method.off_mean(body), 0.5 * change.tail<3>());
    const Twist other = change - changes_[i];
    if (is_second_)
      by_changes_[i] += 0.5 * h * size_of(mass, other.head<3>(), other.tail<3>());
    else
      changes_[i] = change;
  }
  is_second_ = true;
}

double PartError::largest(const Model& model, const List<int>& bodies, const State& state) const {
  double most = 0.0;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const BodyState& body = state.states[bodies[i]];
    const Vector3d turn = 2.0 * (whole_[i].orientation.conjugate() * body.orientation).vec();
    most = std::max({most, by_changes_[i],
                     size_of(model.masses[bodies[i]], whole_[i].position - body.position, turn)});
  }
  return most;
}

double PartError::bound_where_slow(const Model& model, double h, const List<int>& bodies,
                                   const List<BodyState>& starts, const State& state) {
  double fastest = 0.0;
  for (std::size_t i = 0; i < bodies.size(); ++i)
    for (const BodyState* body : {&starts[i], &state.states[bodies[i]]})
      fastest = std::max(
          fastest, size_of(model.masses[bodies[i]], body->linear_velocity, body->angular_velocity));
  return 2.0 * h * fastest;
}

}  // namespace constraint_sim::engine
