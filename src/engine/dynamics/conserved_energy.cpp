#include "engine/dynamics/conserved_energy.h"

#include <algorithm>
#include <cmath>

#include "engine/dynamics/state_vector.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Distance, as a share of the scene's size, within which a momentary row gets a force again. The
// work of all forces over that distance bounds the energy change by the projection; more is an
// impact.
constexpr double kMostWay = 1e-4;
constexpr double kMostLonger = 2.0;        // bound on the scaling of velocities
constexpr double kEnergyRounding = 1e-14;  // share of the sum of energies

// Potential energy of loads and springs [J].
double potential_energy(const IslandModel& island, const IntervalInputs& inputs,
                        const Kinematics& kinematics) {
  double energy = 0.0;
  for (std::size_t i = 0; i < island.bodies().size(); ++i)
    energy -= inputs.acceleration()[i].dot(kinematics.position()[i]) / island.inverse_mass(i);
  for (std::size_t l = island.first().spring; l < island.links().size(); ++l) {
    const double stretch = kinematics.separation()[l].norm() - inputs.length()[l].value;
    energy += 0.5 * island.links()[l].stiffness * stretch * stretch;
  }
  return energy;
}

// Sum of the magnitudes of loads and spring forces [N].
double size_of_forces(const IslandModel& island, const IntervalInputs& inputs,
                      const Kinematics& kinematics) {
  double sum = 0.0;
  for (std::size_t i = 0; i < island.bodies().size(); ++i)
    sum += inputs.acceleration()[i].norm() / island.inverse_mass(i);
  for (std::size_t l = island.first().spring; l < island.links().size(); ++l)
    sum += island.links()[l].stiffness *
           std::abs(kinematics.separation()[l].norm() - inputs.length()[l].value);
  return sum;
}

}  // namespace

bool conserves_energy(const IslandModel& island, const IntervalInputs& inputs) {
  if (inputs.is_time_dependent() || island.has_custom_forces() ||
      island.points() == island.bodies().size() || !island.soft_coordinates().empty())
    return false;
  const auto is_zero = [](const Vector3d& torque) { return torque.isZero(0.0); };
  if (!std::all_of(inputs.torque().begin(), inputs.torque().end(), is_zero)) return false;
  return std::all_of(island.links().begin() + static_cast<std::ptrdiff_t>(island.first().spring),
                     island.links().end(),
                     [](const IslandModel::Link& link) { return link.damping == 0.0; });
}

void ConservedEnergy::note(const IslandModel& island, const IntervalInputs& inputs,
                           const Kinematics& kinematics, const double* y) {
  is_known_ = true;
  energy_ = potential_energy(island, inputs, kinematics) + kinetic_energy(island, y);
}

bool ConservedEnergy::restore(const IslandModel& island, const IntervalInputs& inputs,
                              const Kinematics& kinematics, double size, double* y) const {
  const double kinetic = kinetic_energy(island, y);
  const double gained = potential_energy(island, inputs, kinematics) + kinetic - energy_;
  const double forces = size_of_forces(island, inputs, kinematics);
  const double rounding = kEnergyRounding * (kinetic + std::abs(energy_) + forces * size);
  if (std::abs(gained) <= rounding) return true;
  if (!(kinetic > 0.0) || std::abs(gained) > kMostWay * size * forces) return false;
  const double share = std::min(std::sqrt(std::max(1.0 - gained / kinetic, 0.0)), kMostLonger);
  const auto scale = [&](double* numbers, std::size_t n) {
    Eigen::VectorXd::Map(numbers, static_cast<Eigen::Index>(n)) *= share;
  };
  scale(y + island.layout().v_at, 3 * island.bodies().size());
  scale(y + island.layout().L_at, 3 * island.rotating());
  return true;
}

}  // namespace constraint_sim::engine
