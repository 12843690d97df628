#include "engine/dynamics/joint_forces.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "engine/math/elementary.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

constexpr std::size_t kMostStages = DormandPrince8::kStages + 1;

}  // namespace

JointForces::JointForces(const IslandModel& island) {
  unknown_.resize(island.rows());
  std::iota(unknown_.begin(), unknown_.end(), std::size_t{0});
  impulses_.assign(of_soft(island, island.soft_coordinates().size()), 0.0);
  stage_forces_.assign(impulses_.size() * kMostStages, 0.0);
  squares_.assign(island.bodies().size(), 0.0);
}

void JointForces::sort(const List<std::size_t>& unknown) {
  const std::size_t n = unknown.size();
  List<double> old(n);
  const auto reorder = [&](double* of_unknowns) {
    std::copy_n(of_unknowns, n, old.begin());
    for (std::size_t i = 0; i < n; ++i) of_unknowns[unknown[i]] = old[unknown_[i]];
  };
  reorder(impulses_.data());
  if (kept_impulses_.size() == impulses_.size()) reorder(kept_impulses_.data());
  for (std::size_t at = 0; at < stage_forces_.size(); at += impulses_.size())
    reorder(stage_forces_.data() + at);
  unknown_ = unknown;
}

void JointForces::add(const IslandModel& island, std::size_t l, const RowVector& impulse) {
  if (!island.is_by_offset(l)) {
    impulses_[of_single(island, l)] += impulse[0];
    return;
  }
  for (std::size_t k = 0; k < island.rows_of(l); ++k)
    impulses_[unknown_[island.row_of(l) + k]] += impulse[static_cast<Eigen::Index>(k)];
}

void JointForces::keep_first_stage() {
  keep();
  kept_forces_.assign(stage_forces_.begin(),
                      stage_forces_.begin() + static_cast<std::ptrdiff_t>(impulses_.size()));
}

void JointForces::restore_first_stage() {
  restore();
  std::copy(kept_forces_.begin(), kept_forces_.end(), stage_forces_.begin());
}

// ---- results

RowVector JointForces::of_rows(const IslandModel& island, std::size_t l,
                               const double* of_unknowns) const {
  RowVector rows = RowVector::Zero();
  if (!island.is_by_offset(l)) {
    rows[0] = of_unknowns[of_single(island, l)];
    return rows;
  }
  const std::size_t first = island.row_of(l);
  for (std::size_t k = 0; k < island.rows_of(l); ++k)
    rows[static_cast<Eigen::Index>(k)] = of_unknowns[unknown_[first + k]];
  return rows;
}

// Sorts forces of the rows of a general joint, `of_row(k)`, by function, and adds its springs.
template <class OfRow>
RowVector JointForces::sorted(const IslandModel& island, std::size_t l, const OfRow& of_row,
                              const double* of_unknowns) const {
  RowVector sorted = RowVector::Zero();
  const IslandModel::Link& link = island.links()[l];
  for (int k = 0; k < link.rows; ++k) sorted[link.function[to_index(k)]] = of_row(k);
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    sorted[island.soft_coordinates()[s].function] += of_unknowns[of_soft(island, s)];
  return sorted;
}

RowVector JointForces::by_function(const IslandModel& island, std::size_t l,
                                   const RowVector& of_rows, const double* of_unknowns) const {
  if (!island.is_general(l)) return of_rows;
  return sorted(
      island, l, [&](int k) { return of_rows[k]; }, of_unknowns);
}

RowVector JointForces::by_joint(const IslandModel& island, std::size_t l,
                                const double* of_unknowns) const {
  if (!island.is_general(l)) return of_rows(island, l, of_unknowns);
  const std::size_t* const unknown = unknown_.data() + island.row_of(l);
  return sorted(
      island, l, [&](int k) { return of_unknowns[unknown[k]]; }, of_unknowns);
}

double JointForces::coupled(const IslandModel& island, std::size_t l,
                            const double* of_unknowns) const {
  for (const IslandModel::CoupledRow& coupled : island.coupled_rows())
    if (coupled.link == l) return of_unknowns[unknown_[coupled.row]];
  return 0.0;
}

RowVector JointForces::force(const IslandModel& island, std::size_t l, std::size_t stage) const {
  const double* const forces = stage_forces_.data() + stage * impulses_.size();
  RowVector force = by_joint(island, l, forces);
  if (info(island.links()[l].kind).couples_joints) force[0] = coupled(island, l, forces);
  return force;
}

double JointForces::largest() const {
  double largest = 0.0;
  for (std::size_t i = 0; i < impulses_.size(); ++i)
    largest = std::max(largest, std::abs(stage_forces_[i]));
  return largest;
}

double JointForces::frequency(const IslandModel& island, const IntervalInputs& inputs,
                              const Kinematics& kinematics, double scale) {
  const double* const forces = stage_forces_.data();
  std::fill(squares_.begin(), squares_.end(), 0.0);
  const auto add_torque = [&](std::size_t point, double torque) {
    if (island.rotates(point)) squares_[point] += torque / island.inertia(point).minCoeff();
  };
  for (std::size_t l = 0; l < island.links().size(); ++l) {
    const IslandModel::Link& link = island.links()[l];
    double force = 0.0, across = 0.0;
    if (island.is_general(l)) continue;
    if (island.is_ball(l)) {
      for (std::size_t k = 0; k < 3; ++k)
        force = math::hypot(force, forces[unknown_[island.row_of(l) + k]]);
    } else {
      force = std::abs(forces[of_single(island, l)]);
      const double distance =
          island.is_rod(l) ? inputs.length()[l].value : kinematics.separation()[l].norm();
      across = force / std::max(distance, kCoincidentPoints * scale);
    }
    for (const auto& [point, anchor] :
         {std::pair(link.a, link.anchor_a), {link.b, link.anchor_b}}) {
      if (point >= squares_.size()) continue;
      squares_[point] += 2.0 * across * island.inverse_mass(point);
      add_torque(point, force * anchor.norm());
    }
  }
  for (std::size_t s = 0; s < island.soft_coordinates().size(); ++s) {
    const IslandModel::SoftCoordinate& soft = island.soft_coordinates()[s];
    const IslandModel::Link& link = island.links()[soft.link];
    const Jacobian J = jacobian(soft.form, kinematics.vectors(soft.link));
    const double force = std::abs(forces[of_soft(island, s)]);
    add_torque(link.a, force * J.j2.norm());
    add_torque(link.b, force * J.j4.norm());
  }
  for (std::size_t i = island.first_general_row(); i < island.parts(); ++i) {
    const double force = std::abs(forces[unknown_[island.row_of_part(i)]]);
    for (const int block : {island.part(i).block_a, island.part(i).block_b})
      if (block >= 0)
        add_torque(island.angular_blocks()[block].body,
                   force * kinematics.J_angular()[block].norm());
  }
  return std::sqrt(*std::max_element(squares_.begin(), squares_.end()));
}

}  // namespace constraint_sim::engine
