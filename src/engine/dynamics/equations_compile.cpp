// Storage of EquationsOfMotion for an island, and the entries of A that its rows have.

#include <algorithm>
#include <iterator>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::size_t kMostStages = DormandPrince8::kStages + 1;

/// Lists the angles of general joints that neither a soft coordinate nor a coupling reads.
TurnedAngles unread_angles(const IslandModel& island) {
  TurnedAngles angles;
  for (std::size_t l = 0; l < island.links().size(); ++l) {
    const IslandModel::Link& link = island.links()[l];
    const JointKindInfo& kind = info(link.kind);
    for (int i = 0; island.is_general(l) && i < kind.coordinates; ++i) {
      const auto is_read_by = [&](const IslandModel::CoupledRow& coupled) {
        return std::any_of(coupled.terms.begin(), coupled.terms.end(), [&](const auto& term) {
          return term.link == l && term.coordinate == i;
        });
      };
      bool is_read =
          std::any_of(island.coupled_rows().begin(), island.coupled_rows().end(), is_read_by);
      for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
        is_read = is_read || island.soft_coordinates()[s].function == kind.rows + i;
      if (kind.coordinate[to_index(i)].is_angle && !is_read)
        angles.add(l, link.kind, i, link.a, link.b);
    }
  }
  return angles;
}

}  // namespace

EquationsOfMotion::EquationsOfMotion(List<int> joints, const List<Joint>& all_joints,
                                     const Ends& ends, const List<MassProperties>& masses,
                                     const List<CoupledTerms>& couplings, const List<int>& idle,
                                     const List<char>& open)
    : IslandModel(std::move(joints), all_joints, ends, masses, couplings, idle, open),
      inputs_(*this) {
  direction_.assign(parts(), Vector3d::Zero());
  for (std::size_t l = first_.ball; l < first_.general; ++l)
    for (std::size_t k = 0; k < 3; ++k)
      direction_[first_row(l) + k] = Vector3d::Unit(static_cast<Eigen::Index>(k));
  for (auto* list : {&is_redundant_, &is_needed_, &is_verified_}) list->assign(rows_.size(), 0);
  for (auto* list : {&imbalance_, &redundant_off_}) list->assign(rows_.size(), 0.0);
  couple_rows();
  find_branches();

  if (is_chain_) {
    tridiagonal_.resize(rows_.size());
    falls_.resize(rows_.size());
  }
  if (is_chain_of_bodies_) pairs_ = pairs_of_chain(*this);
  tree_ = tree_of(*this);
  angles_ = unread_angles(*this);

  const std::size_t points = inverse_mass_.size();
  for (auto* list :
       {&position_, &velocity_, &acceleration_, &constraint_force_})
    list->assign(points, Vector3d::Zero());
  orientation_.resize(rotating_);
  inverse_inertia_.resize(rotating_);
  for (auto* list : {&angular_velocity_, &angular_acceleration_, &torque_, &constraint_torque_})
    list->assign(rotating_, Vector3d::Zero());
  for (auto* list : {&d_, &arm_a_, &arm_b_}) list->assign(links_.size(), Vector3d::Zero());
  vectors_.resize(first_.spring - first_.general);
  motions_.resize(first_.spring - first_.general);
  for (auto* list : {&value_, &rate_, &solution_, &residual_, &stress_})
    list->assign(rows_.size(), 0.0);
  J_angular_.assign(angular_blocks_.size(), Vector3d::Zero());
  M_inv_Jt_ = J_angular_;
  impulses_.assign(soft_force(softs_.size()), 0.0);
  squares_.assign(bodies_.size(), 0.0);
  stage_forces_.assign(impulses_.size() * kMostStages, 0.0);
  kept_positions_.reserve(2 * softs_.size() + 4 * coupled_.size());
}

// Lists the entries of A with their sources. Redundant rows have no entries; their unknowns come
// last.
void EquationsOfMotion::couple_rows() {
  struct End {
    std::size_t row;
    double sign;
    int turn;
  };
  List<List<End>> ends_on(bodies_.size());
  for (std::size_t i = 0; i < parts(); ++i) {
    const Row& row = part(i);
    if (row.a < bodies_.size()) ends_on[row.a].push_back({i, -1.0, row.block_a});
    if (row.b < bodies_.size()) ends_on[row.b].push_back({i, 1.0, row.block_b});
  }
  List<int> number(rows_.size(), -1);  // number of a row among the kept rows
  kept_ = 0;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (!is_redundant_[i]) number[i] = static_cast<int>(kept_++);
  const auto is_kept = [&](const End& end) { return !is_redundant_[row_of_part(end.row)]; };
  const auto number_of = [&](const End& end) { return number[row_of_part(end.row)]; };

  List<std::pair<int, int>> pattern;
  List<List<End>> kept_on(bodies_.size());
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    auto& ends = kept_on[body];
    std::copy_if(ends_on[body].begin(), ends_on[body].end(), std::back_inserter(ends), is_kept);
    for (std::size_t m = 0; m < ends.size(); ++m)
      for (std::size_t n = 0; n < m; ++n)
        pattern.emplace_back(number_of(ends[m]), number_of(ends[n]));
  }
  ldlt_.analyze(static_cast<int>(kept_), pattern);

  std::size_t last = kept_;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    rows_[i].unknown = is_redundant_[i] ? last++ : to_index(ldlt_.place(number[i]));
  for (AngularBlock& turn : angular_blocks_) turn.unknown = rows_[row_of_part(turn.row)].unknown;

  pulls_.clear();
  pulls_end_.clear();
  for (const auto& ends : ends_on) {
    for (const End& end : ends)
      pulls_.push_back({end.row, rows_[row_of_part(end.row)].unknown, end.sign});
    pulls_end_.push_back(pulls_.size());
  }

  const std::size_t first_general = first_general_row(), first_coupled = first_coupled_row();
  const auto are_two_axes = [&](std::size_t i, std::size_t j) {
    const auto is_general = [&](std::size_t row) { return row >= first_general; };
    const auto has_no_force = [&](std::size_t row) {
      return is_general(row) && row < first_coupled &&
             !general_rows_[row - first_general].form.has_separation();
    };
    if (has_no_force(i) || has_no_force(j)) return true;
    if (is_general(i) || is_general(j)) return false;
    return i >= first_.ball && j >= first_.ball && direction_[i] != direction_[j];
  };
  linear_couplings_.clear();
  for (std::size_t i = 0; i < parts(); ++i) {
    const int k = number[row_of_part(i)];
    if (k >= 0) linear_couplings_.push_back({i, i, part(i).inverse_mass, ldlt_.slot(k, k)});
  }
  angular_couplings_.clear();
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    const auto& ends = kept_on[body];
    for (std::size_t m = 0; m < ends.size(); ++m) {
      for (std::size_t n = 0; n < m; ++n) {
        if (are_two_axes(ends[m].row, ends[n].row)) continue;
        const double twice = number_of(ends[m]) == number_of(ends[n]) ? 2.0 : 1.0;
        linear_couplings_.push_back({ends[m].row, ends[n].row,
                                     twice * ends[m].sign * ends[n].sign * inverse_mass_[body],
                                     ldlt_.slot(number_of(ends[m]), number_of(ends[n]))});
      }
      if (!rotates(body)) continue;
      for (std::size_t n = 0; n <= m; ++n) {
        const AngularCoupling coupling{to_index(ends[m].turn), to_index(ends[n].turn),
                                       ldlt_.slot(number_of(ends[m]), number_of(ends[n]))};
        angular_couplings_.push_back(coupling);
        if (n < m && number_of(ends[m]) == number_of(ends[n]))  // both parts of one row
          angular_couplings_.push_back({coupling.q, coupling.p, coupling.slot});
      }
    }
  }
}

}  // namespace constraint_sim::engine
