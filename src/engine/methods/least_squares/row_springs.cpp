#include "engine/methods/least_squares/row_springs.h"

namespace constraint_sim::engine {
namespace {

// Assumed lower bound of the inverse compliance of a constant force, as a share of the mass that it
// moves.
constexpr double kLeastGiven = 1e-9;

}  // namespace

RowSprings::RowSprings(const EquationsOfMotion& equations, const RegularizedRows& rows) {
  for (const RegularizedRows::Row& row : rows.rows()) {
    const EquationsOfMotion::Link& joint = equations.links()[row.joint];
    SoftLaw law{joint.stiffness, 0.0, joint.damping, 0.0};
    if (row.soft >= 0) law = equations.soft_coordinates()[row.soft].law;
    stiffness_.push_back(law.K / (row.metres * row.metres));
    damping_.push_back(law.C / (row.metres * row.metres));
    force_.push_back(law.F / row.metres);
    const double inverse_mass = equations.inverse_mass(joint.a) + equations.inverse_mass(joint.b);
    least_given_.push_back(row.soft >= 0 ? kLeastGiven / inverse_mass : 0.0);
  }
}

double RowSprings::energy(const RegularizedRows& rows, const RowTargets& targets,
                          const RegularizedRows::Geometry& geometry) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < stiffness_.size(); ++i) {
    if (!rows.rows()[i].is_spring) continue;
    const double stretch = targets.extent(rows, i, geometry) - targets.length(i);
    sum += 0.5 * stiffness_[i] * stretch * stretch - force_[i] * stretch;
  }
  return sum;
}

double RowSprings::damped_energy(const RegularizedRows& rows, const RowTargets& targets, double h,
                                 const RegularizedRows::Geometry& start,
                                 const RegularizedRows::Geometry& end) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < damping_.size(); ++i) {
    if (damping_[i] == 0.0) continue;
    const double change = targets.extent(rows, i, end) - targets.extent(rows, i, start);
    const double rate = change / h - targets.rate(i);
    sum += h * damping_[i] * rate * rate;
  }
  return sum;
}

}  // namespace constraint_sim::engine
