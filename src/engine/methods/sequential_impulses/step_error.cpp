#include "engine/methods/sequential_impulses/step_error.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Change of the angular velocity of a body within h at constant angular momentum [rad/s].
double change_of_free_turn(double h, const MassProperties& mass, const BodyState& state) {
  const Vector3d w = state.orientation.conjugate() * state.angular_velocity;
  const Vector3d torque = mass.inertia.cwiseProduct(w).cross(w);
  return std::min(h * mass.inverse_inertia.cwiseProduct(torque).norm(), 2.0 * w.norm());
}

}  // namespace

void StepError::Parts::take_larger(const Parts& other) {
  by_motion = std::max(by_motion, other.by_motion);
  by_correction = std::max(by_correction, other.by_correction);
  bound = std::max(bound, other.bound);
}

double StepError::Parts::sum() const { return std::min(by_motion, bound) + by_correction; }

void StepError::note_guesses(const List<Row>& rows) {
  guesses_.clear();
  for (const Row& row : rows) guesses_.push_back(row.impulse);
}

void StepError::note_impulses(const List<Row>& rows) {
  momenta_.assign(errors_.size(), Twist::Zero());
  parts_.resize(errors_.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const double change = row.impulse - guesses_[i];
    if (change == 0.0) continue;
    momenta_[row.body_a] += change * twist(row.J.j1, row.J.j2);
    momenta_[row.body_b] += change * twist(row.J.j3, row.J.j4);
  }
}

void StepError::measure(std::size_t body, double h, const MassProperties& mass,
                        const BodyState& state, const Vector3d& off_mean, const RowSolver& solver) {
  const Twist change = solver.velocity_change(body), correction = solver.correction(body);
  const Twist after = solver.final_velocity(body) - correction, before = after - change;
  const Twist momentum = momenta_[body];
  const double linear = off_mean.norm() + 0.5 * mass.inverse_mass * momentum.head<3>().norm();
  Parts& parts = parts_[body];
  parts.by_motion = h * linear;
  parts.by_correction = h * correction.head<3>().norm();
  parts.bound = 2.0 * h * std::max(before.head<3>().norm(), after.head<3>().norm());
  if (!mass.can_turn()) return;
  const double radius = mass.radius_of_gyration();
  const Vector3d by_impulses =
      apply_inertia(mass.inverse_inertia, state.orientation, momentum.tail<3>());
  double angular = 0.5 * (change.tail<3>().norm() + by_impulses.norm());
  const double fastest = std::max(before.tail<3>().norm(), after.tail<3>().norm());
  if (!mass.is_isotropic()) angular += h * fastest * change_of_free_turn(h, mass, state);
  parts.by_motion = std::max(parts.by_motion, h * radius * angular);
  parts.by_correction = std::max(parts.by_correction, h * radius * correction.tail<3>().norm());
  parts.bound = std::max(parts.bound, 2.0 * h * radius * fastest);
}

void StepError::add(const List<int>& bodies, bool has_rows, RowSolver* solver) {
  if (has_rows)
    for (const int body : bodies) parts_[solver->component_of(body)].take_larger(parts_[body]);
  for (const int body : bodies)
    errors_[body] += parts_[has_rows ? solver->component_of(body) : body].sum();
}

}  // namespace constraint_sim::engine
