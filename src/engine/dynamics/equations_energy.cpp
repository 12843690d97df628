// The energy of an EquationsOfMotion, and how it is kept where momentary rows come back.

#include <algorithm>
#include <cmath>

#include "engine/dynamics/equations_of_motion.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Within a ten-thousandth of the scene's size a momentary row has a force again: what forces do
// over that way is the most that its projection may change the energy by. More is an impact.
constexpr double kMostWay = 1e-4;
constexpr double kMostLonger = 2.0;        // what that does to velocities
constexpr double kEnergyRounding = 1e-14;  // of the energies that are added up

}  // namespace

// Of loads and springs [J].
double EquationsOfMotion::potential_energy() const {
  double energy = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    energy -= applied_acceleration_[i].dot(position_[i]) / inverse_mass_[i];
  for (std::size_t l = first_spring_; l < links_.size(); ++l) {
    const double stretch = d_[l].norm() - length_[l].value;
    energy += 0.5 * links_[l].stiffness * stretch * stretch;
  }
  return energy;
}

// Of these, without their signs [N].
double EquationsOfMotion::size_of_forces() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    sum += applied_acceleration_[i].norm() / inverse_mass_[i];
  for (std::size_t l = first_spring_; l < links_.size(); ++l)
    sum += links_[l].stiffness * std::abs(d_[l].norm() - length_[l].value);
  return sum;
}

// Whether nothing but joints, loads and springs acts. Drives, motors and dampers do work, torques
// and laws on coordinates have no potential here, and a free island has momenta to keep.
bool EquationsOfMotion::is_conservative() const {
  if (is_time_dependent() || has_custom_forces_ || inverse_mass_.size() == bodies_.size() ||
      !softs_.empty())
    return false;
  const auto is_zero = [](const Vector3d& torque) { return torque.isZero(0.0); };
  if (!std::all_of(applied_torque_.begin(), applied_torque_.end(), is_zero)) return false;
  return std::all_of(links_.begin() + static_cast<std::ptrdiff_t>(first_spring_), links_.end(),
                     [](const Link& link) { return link.damping == 0.0; });
}

// Where a row is left out, and where it has a force again before velocities are projected onto it,
// bodies move across it: then its force does work, and projections put bodies back against loads
// and springs.
void EquationsOfMotion::note_energy(double t, const double* y) {
  knows_energy_ = is_conservative();
  if (!knows_energy_) return;
  update_prescribed(t);
  update_kinematics(t, y);
  energy_ = potential_energy() + kinetic_energy(y);
}

// After both projections: velocities make up for what the energy has changed by since it was noted,
// unless that is more than such a way explains. True where the energy is as it was.
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
  scale(y + v_at_, 3 * bodies_.size());
  scale(y + L_at_, 3 * rotating_);
  set_velocities(y);
  return true;
}

}  // namespace constraint_sim::engine
