// Results of EquationsOfMotion for reports and for other methods, and impulses that other methods
// add.

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/elementary.h"
#include "engine/math/list.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

}  // namespace

RowVector EquationsOfMotion::of_rows(std::size_t l, const double* of_unknowns) const {
  RowVector rows = RowVector::Zero();
  if (!is_by_offset(l)) {
    rows[0] = of_unknowns[is_rod(l) ? rows_[l].unknown : rows_.size() + l - first_.spring];
    return rows;
  }
  const std::size_t first = first_row(l);
  for (std::size_t k = 0; k < rows_of(l); ++k)
    rows[static_cast<Eigen::Index>(k)] = of_unknowns[rows_[first + k].unknown];
  return rows;
}

RowVector EquationsOfMotion::row_impulse(std::size_t l) const {
  return of_rows(l, impulses_.data());
}

RowVector EquationsOfMotion::by_function(std::size_t l, const RowVector& of_rows,
                                         const double* of_unknowns) const {
  if (!is_general(l)) return of_rows;
  RowVector sorted = RowVector::Zero();
  const Link& link = links_[l];
  for (int k = 0; k < link.rows; ++k) sorted[link.function[k]] = of_rows[k];
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    sorted[softs_[s].function] += of_unknowns[soft_force(s)];
  return sorted;
}

RowVector EquationsOfMotion::by_joint(std::size_t l, const double* of_unknowns) const {
  if (!is_general(l)) return of_rows(l, of_unknowns);
  return by_function(l, of_rows(l, of_unknowns), of_unknowns);
}

RowVector EquationsOfMotion::stage_force(std::size_t l, std::size_t stage) const {
  const double* const forces = stage_forces_.data() + stage * impulses_.size();
  RowVector force = by_joint(l, forces);
  if (!couples_joints(links_[l].kind)) return force;
  for (const CoupledRow& coupled : coupled_)
    if (coupled.link == l) force[0] = forces[rows_[coupled.row].unknown];
  return force;
}

RowVector EquationsOfMotion::impulse(std::size_t l) const { return by_joint(l, impulses_.data()); }

// ---- access for methods with their own time stepping

void EquationsOfMotion::read_pose(const List<Vector3d>& positions,
                                  const List<Quaterniond>& orientations) {
  pose_.resize(size());
  for (std::size_t i = 0; i < bodies_.size(); ++i) Vector(pose_.data() + 3 * i) = positions[i];
  for (std::size_t i = 0; i < rotating_; ++i)
    Eigen::Map<Eigen::Vector4d>(pose_.data() + layout().q_at + 4 * i) = orientations[i].coeffs();
}

bool EquationsOfMotion::find_dependent(double t, const List<Vector3d>& positions,
                                       const List<Quaterniond>& orientations, double least,
                                       List<char>* rows) {
  read_pose(positions, orientations);
  inputs_.update(*this, t);
  update_kinematics(t, pose_.data());
  factor(least);
  factors_are_there_ = false;
  if (is_choice_due()) {
    find_values();
    if (redundant_rows_are_off()) return false;  // the choice needs a pose where rows are met
    choose_again(t, pose_.data());
    factor(least);
    factors_are_there_ = false;
  }
  rows->assign(rows_.size(), 0);
  for (std::size_t i = 0; i < rows_.size(); ++i)
    (*rows)[i] =
        is_redundant_[i] ? kRedundant : (ldlt_.is_left_out(rows_[i].unknown) ? kMomentary : '\0');
  dependent_rows_ = std::max(dependent_rows_, left_out_);
  return true;
}

void EquationsOfMotion::add_impulse(std::size_t l, const RowVector& impulse) {
  if (is_by_offset(l)) {
    for (std::size_t k = 0; k < rows_of(l); ++k)
      impulses_[rows_[first_row(l) + k].unknown] += impulse[static_cast<Eigen::Index>(k)];
  } else {
    impulses_[is_rod(l) ? rows_[l].unknown : rows_.size() + l - first_.spring] += impulse[0];
  }
}

void EquationsOfMotion::keep_impulses() {
  kept_impulses_ = impulses_;
  angles_.keep();
  kept_positions_.clear();
  const auto keep = [this](const auto& coordinate) {
    kept_positions_.push_back(coordinate.position);
    kept_positions_.push_back(coordinate.rate);
  };
  for (const SoftCoordinate& soft : softs_) keep(soft);
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms) keep(term);
}

void EquationsOfMotion::restore_impulses() {
  impulses_ = kept_impulses_;
  angles_.restore();
  const double* kept = kept_positions_.data();
  const auto restore = [&kept](auto& coordinate) {
    coordinate.position = *kept++;
    coordinate.rate = *kept++;
  };
  for (SoftCoordinate& soft : softs_) restore(soft);
  for (CoupledRow& coupled : coupled_)
    for (CoupledRow::Term& term : coupled.terms) restore(term);
}

bool EquationsOfMotion::count_turns(std::size_t l,
                                    std::array<double, kMaxCoordinates>* positions) const {
  const Link& link = links_[l];
  if (!is_general(l) || (link.softs == 0 && coupled_.empty() && angles_.empty())) return false;
  positions->fill(std::numeric_limits<double>::quiet_NaN());
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    (*positions)[softs_[s].function - info(link.kind).rows] = softs_[s].position;
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms)
      if (term.link == l) (*positions)[term.coordinate] = term.position;
  angles_.read(l, positions);
  return true;
}

double EquationsOfMotion::frequency() {
  if (is_tree()) update_general_rows();
  const double* const forces = stage_forces_.data();
  std::fill(squares_.begin(), squares_.end(), 0.0);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link& link = links_[l];
    double force = 0.0, across = 0.0;
    if (is_general(l)) continue;
    if (is_ball(l)) {
      for (std::size_t k = 0; k < 3; ++k)
        force = math::hypot(force, forces[rows_[first_row(l) + k].unknown]);
    } else {
      force = std::abs(forces[is_rod(l) ? rows_[l].unknown : rows_.size() + l - first_.spring]);
      const double distance = is_rod(l) ? inputs_.length()[l].value : d_[l].norm();
      across = force / std::max(distance, 1e-9 * scale_);
    }
    for (const auto& [point, anchor] :
         {std::pair(link.a, link.anchor_a), {link.b, link.anchor_b}}) {
      if (point >= bodies_.size()) continue;
      squares_[point] += 2.0 * across * inverse_mass_[point];
      if (rotates(point)) squares_[point] += force * anchor.norm() / inertia_[point].minCoeff();
    }
  }
  for (std::size_t s = 0; s < softs_.size(); ++s) {
    const Link& link = links_[softs_[s].link];
    const Jacobian J = jacobian(softs_[s].form, vectors_[softs_[s].link - first_.general]);
    const double force = std::abs(forces[soft_force(s)]);
    for (const auto& [point, torque] : {std::pair(link.a, J.j2), {link.b, J.j4}})
      if (rotates(point)) squares_[point] += force * torque.norm() / inertia_[point].minCoeff();
  }
  for (std::size_t i = first_general_row(); i < parts(); ++i) {
    const double force = std::abs(forces[rows_[row_of_part(i)].unknown]);
    for (const int turn : {part(i).block_a, part(i).block_b}) {
      if (turn < 0) continue;
      const std::size_t body = angular_blocks_[turn].body;
      squares_[body] += force * J_angular_[turn].norm() / inertia_[body].minCoeff();
    }
  }
  return std::sqrt(*std::max_element(squares_.begin(), squares_.end()));
}

double EquationsOfMotion::kinetic_energy(const double* y) const {
  const double* const v = y + layout().v_at;
  const double* const q = y + layout().q_at;
  const double* const L = y + layout().L_at;
  double energy = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    energy += 0.5 / inverse_mass_[i] * ConstVector(v + 3 * i).squaredNorm();
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Vector3d in_body = rotation_matrix(q + 4 * i).transpose() * ConstVector(L + 3 * i);
    energy += 0.5 * in_body.dot(in_body.cwiseQuotient(inertia_[i]));
  }
  return energy;
}

}  // namespace constraint_sim::engine
