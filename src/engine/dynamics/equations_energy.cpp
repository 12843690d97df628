// Energy of EquationsOfMotion, and its conservation where momentary rows get a force again.

#include <algorithm>
#include <cmath>

#include "engine/dynamics/equations_of_motion.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Distance, as a share of the scene's size, within which a momentary row gets a force again. The
// work of all forces over that distance bounds the energy change by the projection; more is an
// impact.
constexpr double kMostWay = 1e-4;
constexpr double kMostLonger = 2.0;        // bound on the scaling of velocities
constexpr double kEnergyRounding = 1e-14;  // share of the sum of energies

}  // namespace

// Potential energy of loads and springs [J].
double EquationsOfMotion::potential_energy() const {
  double energy = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    energy -= inputs_.acceleration()[i].dot(position_[i]) / inverse_mass_[i];
  for (std::size_t l = first_.spring; l < links_.size(); ++l) {
    const double stretch = d_[l].norm() - inputs_.length()[l].value;
    energy += 0.5 * links_[l].stiffness * stretch * stretch;
  }
  return energy;
}

// Sum of the magnitudes of loads and spring forces [N].
double EquationsOfMotion::size_of_forces() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    sum += inputs_.acceleration()[i].norm() / inverse_mass_[i];
  for (std::size_t l = first_.spring; l < links_.size(); ++l)
    sum += links_[l].stiffness * std::abs(d_[l].norm() - inputs_.length()[l].value);
  return sum;
}

// Whether only joints, loads and springs act on an island held by the world. Drives, motors and
// dampers do work; torques and laws of coordinates have no potential here; a free island has
// momenta to conserve.
bool EquationsOfMotion::is_conservative() const {
  if (inputs_.is_time_dependent() || has_custom_forces_ || inverse_mass_.size() == bodies_.size() ||
      !softs_.empty())
    return false;
  const auto is_zero = [](const Vector3d& torque) { return torque.isZero(0.0); };
  if (!std::all_of(inputs_.torque().begin(), inputs_.torque().end(), is_zero)) return false;
  return std::all_of(links_.begin() + static_cast<std::ptrdiff_t>(first_.spring), links_.end(),
                     [](const Link& link) { return link.damping == 0.0; });
}

// Stores the energy where a row is left out, and where a row gets a force again before velocities
// are projected. Bodies then move across the row, whose force does work, and projections move
// bodies against loads and springs.
void EquationsOfMotion::note_energy(double t, const double* y) {
  knows_energy_ = is_conservative();
  if (!knows_energy_) return;
  inputs_.update(*this, t);
  update_kinematics(t, y);
  energy_ = potential_energy() + kinetic_energy(y);
}

// Scales velocities after both projections to restore the energy that note_energy() stored. Returns
// false where the change exceeds the work of forces over kMostWay, and changes nothing.
bool EquationsOfMotion::keep_energy(double* y) {
  const double kinetic = kinetic_energy(y);
  const double gained = potential_energy() + kinetic - energy_;
  const double forces = size_of_forces();
  const double rounding = kEnergyRounding * (kinetic + std::abs(energy_) + forces * scale_);
  if (std::abs(gained) <= rounding) return true;
  if (!(kinetic > 0.0) || std::abs(gained) > kMostWay * scale_ * forces) return false;
  const double share = std::min(std::sqrt(std::max(1.0 - gained / kinetic, 0.0)), kMostLonger);
  const auto scale = [&](double* numbers, std::size_t n) {
    Eigen::VectorXd::Map(numbers, static_cast<Eigen::Index>(n)) *= share;
  };
  scale(y + layout().v_at, 3 * bodies_.size());
  scale(y + layout().L_at, 3 * rotating_);
  set_velocities(y);
  return true;
}

}  // namespace constraint_sim::engine
