// Redundant rows of EquationsOfMotion. A redundant row follows from the kept rows at all reachable
// poses: it has no force and holds because the kept rows do. A momentary row depends on others only
// in a singular pose that the motion passes, and is left out of the factors there.
// Both have a self-stress n: forces of the rows, 1 on the row itself, that balance at every body,
// Gᵀn = 0. Rows are chosen by pivots (Jacobian in the metric M⁻¹), verified by their self-stress
// and watched as the bodies move. Masses do not enter the self-stress, so a pivot that is small by
// a mass ratio is not taken for dependence.

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/elementary.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/independent_rows.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kRoundOffPivot = 1e-13;   // pivot in SparseLdlt's fill-reducing order
constexpr double kSelfStress = 1e-6;       // imbalance of forces, as a share of the largest force
constexpr double kExactSelfStress = 1e-9;  // imbalance of rows that depend to rounding
constexpr double kMomentarySelfStress = 1e-3;
constexpr double kMostSelfStress = 0.1;  // while joints are being closed
constexpr double kOpenShare = 30.0;      // times the opening angle
constexpr int kRefinements = 3;

// Tolerances of redundant rows. Where lengths have few digits, forces balance to as few digits.
constexpr double kRowSolved = 1e-11;  // share of the scene's size
constexpr double kDrift = 1e3;        // share of the scene's size, per imbalance
constexpr double kMostDrift = 1e-3;
constexpr double kMostOff = 1e-5;     // [m]
constexpr double kConsistent = 1e-6;  // [m]; a row with a larger error contradicts the others
// Share of the scene's size, where kept rows are independent.
constexpr double kIndependentRounding = 1e-13;

// Rows are chosen again when the smallest pivot of the kept rows falls by this factor. Early, since
// a pivot that passes through zero takes the projection to another solution.
constexpr double kChooseAgain = 0.1;
// Pivots below rounding count as equal; otherwise the choice would repeat without end.
bool has_fallen(double pivot, double at_choice) {
  return std::max(pivot, kRoundOffPivot) < kChooseAgain * std::max(at_choice, kRoundOffPivot);
}
constexpr double kRatesKnown = 1e-6;    // smallest pivot for which rates are conclusive
constexpr double kRatesAgree = 1e-6;    // share of the largest speed
constexpr double kOpenRates = 3.0;      // share of the largest speed, per opening angle
constexpr double kRateDrift = 1e4;      // share of the largest speed, per imbalance
constexpr int kMostTooFar = 10;         // consecutive steps rejected for dependent kept rows
constexpr int kLeftOutUntilChoice = 8;  // restarts with momentary rows before the first new choice

}  // namespace

void EquationsOfMotion::forget_redundant_rows() {
  set_redundant(List<char>(rows_.size(), 0));
  std::fill(is_needed_.begin(), is_needed_.end(), 0);
  std::fill(imbalance_.begin(), imbalance_.end(), 0.0);
  inputs_.forget();
  ldlt_.keep_none();
  has_chosen_ = is_inconsistent_ = came_back_ = false;
  pivot_at_choice_ = 1.0;
  scale_ = 0.0;
  too_far_ = left_out_for_ = choose_after_ = left_out_ = 0;
}

// ---- choice of redundant rows

// Finds the rows of branches, through which no loop of joints passes. Nothing else holds what they
// hold, so they are never redundant. All immovable bodies count as one body.
void EquationsOfMotion::find_branches() {
  const std::size_t ground = bodies_.size();
  List<std::size_t> degree(ground + 1, 0), of_links(ground + 1, 0);  // xor of the link indices
  const auto ends = [&](std::size_t l) {
    return std::array<std::size_t, 2>{std::min(links_[l].a, ground), std::min(links_[l].b, ground)};
  };
  for (std::size_t l = 0; l < first_.spring; ++l) {
    for (const std::size_t end : ends(l)) {
      ++degree[end];
      of_links[end] ^= l;
    }
  }
  is_of_branch_.assign(rows_.size(), 0);
  for (std::size_t leaf = 0; leaf <= ground; ++leaf) {
    for (std::size_t node = leaf; degree[node] == 1;) {
      const std::size_t l = of_links[node];
      const auto [a, b] = ends(l);
      const std::size_t first = is_rod(l) ? l : first_row(l);
      for (std::size_t k = 0; k < rows_of(l); ++k) is_of_branch_[first + k] = 1;
      for (const std::size_t end : {a, b}) {
        --degree[end];
        of_links[end] ^= l;
      }
      node = node == a ? b : a;
    }
  }
}

// Finds the redundant rows at this pose. Returns the number of rows that depend on others and are
// not redundant.
int EquationsOfMotion::choose_rows(double t, const double* y) {
  has_chosen_ = true;
  left_out_for_ = 0;
  inputs_.update(*this, t);
  update_kinematics(t, y);
  factors_are_there_ = false;
  ldlt_.keep_none();
  if (rows_.empty()) return 0;
  // Joints being closed depend on each other only up to their opening angle; lengths with few
  // digits only to as few digits, in some poses less well.
  double tolerance = std::clamp(kOpenShare * opening(false), kSelfStress, kMostSelfStress);
  if (redundant_rows() > 0) tolerance = std::max(tolerance, redundant_self_stress());
  const double least = std::max(kLeastPivot, tolerance * tolerance);
  find_matrix();
  if (redundant_rows() == 0 && ldlt_.factor(least) == 0) return 0;

  List<char> redundant = independent_rows(least);
  for (std::size_t i = 0; i < rows_.size(); ++i)
    redundant[i] = !redundant[i] && !is_needed_[i] && !is_of_branch_[i] ? 1 : 0;
  set_redundant(redundant);
  find_matrix();
  ldlt_.factor(kRoundOffPivot);
  int momentary = 0;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (!redundant[i]) continue;
    imbalance_[i] = self_stress_imbalance(i);
    if (imbalance_[i] <= tolerance) continue;
    redundant[i] = 0;
    ++momentary;
  }
  if (momentary > 0) {
    set_redundant(redundant);
    find_matrix();
    ldlt_.factor(kRoundOffPivot);
  }
  pivot_at_choice_ = std::max(ldlt_.smallest_pivot(), 0.0);
  return momentary;
}

// Imbalance up to which rows stay redundant in a new choice.
double EquationsOfMotion::redundant_self_stress() const {
  double worst = 0.0;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (is_redundant_[i]) worst = std::max(worst, imbalance_[i]);
  return std::min(kDrift * worst, kMostDrift);
}

// Computes A of all rows, redundant rows included.
Eigen::MatrixXd EquationsOfMotion::dense_matrix() {
  const std::size_t n = rows_.size();
  const List<double> zero(n, 0.0);
  Eigen::MatrixXd A(n, n);
  for (std::size_t i = 0; i < n; ++i) {
    std::fill(stress_.begin(), stress_.end(), 0.0);
    stress_[rows_[i].unknown] = 1.0;
    find_residual(zero.data(), stress_.data(), residual_.data());
    for (std::size_t j = 0; j < n; ++j)
      A(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(i)) = -residual_[rows_[j].unknown];
  }
  return A;
}

List<char> EquationsOfMotion::independent_rows(double least) {
  List<char> was_kept(rows_.size());
  List<char> is_needed = is_of_branch_;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    was_kept[i] = is_redundant_[i] ? 0 : 1;
    is_needed[i] = is_needed[i] || is_needed_[i] ? 1 : 0;
  }
  return choose_independent_rows(dense_matrix(), was_kept, is_needed, least).is_kept;
}

// Imbalance at the bodies of the self-stress of a row without a force in the current factors, as a
// share of its largest force. Independent of masses.
double EquationsOfMotion::self_stress_imbalance(std::size_t row) {
  const std::size_t own = rows_[row].unknown;
  const List<double> zero(rows_.size(), 0.0);
  std::fill(stress_.begin(), stress_.end(), 0.0);
  stress_[own] = 1.0;
  for (int k = 0; k < kRefinements; ++k) {
    find_residual(zero.data(), stress_.data(), residual_.data());
    ldlt_.solve(residual_.data());
    for (std::size_t u = 0; u < kept_; ++u)
      if (!ldlt_.is_left_out(u)) stress_[u] += residual_[u];
  }
  apply_jacobian_transpose(stress_.data());
  double force = 0.0, torque = 0.0;  // largest of any row
  for (std::size_t i = 0; i < rows_.size(); ++i)
    force = std::max(force, std::abs(stress_[rows_[i].unknown]) * direction_[i].norm());
  for (const GeneralRow& row : general_rows_)  // rows between axes: torque over an arm
    if (!row.form.has_separation())
      force = std::max(force, std::abs(stress_[rows_[row.row].unknown]) / row.metres);
  for (const CoupledRow& coupled : coupled_)
    force = std::max(force, std::abs(stress_[rows_[coupled.row].unknown]) / coupled.metres);
  for (std::size_t p = 0; p < angular_blocks_.size(); ++p) {
    const AngularBlock& turn = angular_blocks_[p];
    const double arm = radius_of_gyration_[turn.body] * direction_[turn.row].norm();
    torque =
        std::max(torque, std::abs(stress_[turn.unknown]) * std::max(J_angular_[p].norm(), arm));
  }
  double imbalance = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    imbalance = std::max(imbalance, constraint_force_[i].norm() / force);
  // Torques that the self-stress does not load hold only rounding, so forces bound their scale.
  for (std::size_t i = 0; i < rotating_; ++i)
    imbalance = std::max(
        imbalance, constraint_torque_[i].norm() / std::max(torque, force * radius_of_gyration_[i]));
  return imbalance;
}

void EquationsOfMotion::set_redundant(const List<char>& redundant) {
  std::fill(is_verified_.begin(), is_verified_.end(), 0);
  std::fill(redundant_off_.begin(), redundant_off_.end(), kInfinity);
  factors_are_there_ = false;
  if (redundant.size() != rows_.size())
    throw std::invalid_argument("redundant rows: must be flags of all rows");
  if (redundant == is_redundant_) return;
  const std::size_t n = rows_.size(), forces = impulses_.size();
  List<std::size_t> before;
  for (const Row& row : rows_) before.push_back(row.unknown);
  is_redundant_ = redundant;
  couple_rows();
  List<double> old(n);
  const auto reorder = [&](double* of_unknowns) {
    std::copy_n(of_unknowns, n, old.begin());
    for (std::size_t i = 0; i < n; ++i) of_unknowns[rows_[i].unknown] = old[before[i]];
  };
  reorder(impulses_.data());
  if (kept_impulses_.size() == forces) reorder(kept_impulses_.data());
  for (std::size_t at = 0; at < stage_forces_.size(); at += forces)
    reorder(stage_forces_.data() + at);
}

// ---- watch over redundant rows

// Opening of a joint when it began to be closed [m], with or without the offsets of its motors.
double EquationsOfMotion::offset_of(std::size_t l, const PrescribedMotion& motion,
                                    bool with_motors) const {
  if (!is_general(l)) return motion.offset().norm();
  RowVector offset = RowVector::Zero();
  const auto [shift, turn] = motion.opening();
  const double by_frame = motion.moves_frame() ? math::hypot(shift, links_[l].radius * turn) : 0.0;
  for (std::size_t k = 0; k < rows_of(l); ++k)
    if (with_motors || links_[l].function[k] < info(links_[l].kind).rows)
      offset[static_cast<Eigen::Index>(k)] =
          motion.offset()[links_[l].function[k]] / inputs_.row_length(*this, first_row(l) + k);
  double by_coupling = 0.0;
  if (couples(links_[l].kind))
    for (const CoupledRow& coupled : coupled_)
      if (coupled.link == l) by_coupling = coupled.metres * motion.coupling_offset();
  return math::hypot(offset.norm(), by_frame, by_coupling);
}

// Arm that converts the opening of a joint to an angle [m].
double EquationsOfMotion::closing_arm(std::size_t l) const {
  if (is_rod(l)) return inputs_.length()[l].value;
  return std::max({arm_a_[l].norm(), arm_b_[l].norm(), links_[l].radius});
}

// Largest opening of a joint being closed, as an angle [rad]. Motors on their way to a position
// leave the other rows met, so the dependence among those is known to rounding.
double EquationsOfMotion::opening(bool with_motors) const {
  double angle = 0.0;
  for (const auto& [l, motion] : inputs_.motions()) {
    if (!motion.is_closing()) continue;
    const double open =
        std::abs(motion.share_to_close(time_).value) * offset_of(l, motion, with_motors);
    const double arm = closing_arm(l);
    if (arm > 0.0) angle = std::max(angle, open / arm);
  }
  return angle;
}

// Largest e²/L of the joints being closed, initially open by e with arm L [m]. Joints that can all
// be met at the end may contradict each other by part of that on the way.
double EquationsOfMotion::closing_curvature() const {
  double largest = 0.0;
  for (const auto& [l, motion] : inputs_.motions()) {
    if (!motion.is_closing()) continue;
    const double arm = closing_arm(l);
    const double open = offset_of(l, motion, true);
    if (arm > 0.0) largest = std::max(largest, std::min(kOpenShare * open * open / arm, open));
  }
  return largest;
}

bool EquationsOfMotion::is_closing() const {
  return std::any_of(inputs_.motions().begin(), inputs_.motions().end(),
                     [](const auto& motion) { return motion.second.is_closing(); });
}

// Sets the tolerances of redundant rows, after find_values() with the kept rows met. Returns false
// where a redundant row contradicts the others.
bool EquationsOfMotion::limit_redundant_rows() {
  if (redundant_rows() == 0) return true;
  const double closing = closing_curvature();
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (!is_redundant_[i]) continue;
    const double off = std::abs(value_[i]) / inputs_.row_length(*this, i);
    if (off > kConsistent + closing) is_inconsistent_ = true;
    const double drift = std::min(kDrift * imbalance_[i] * scale_, kMostOff);
    redundant_off_[i] =
        closing > 0.0 ? kConsistent + closing : std::max({kRowSolved * scale_, drift, 4.0 * off});
  }
  has_chosen_ = has_chosen_ && !is_inconsistent_;
  return !is_inconsistent_;
}

// Tolerance of a redundant row [m]. Near dependence the kept rows determine the others less well,
// and the tolerance grows.
double EquationsOfMotion::redundant_limit(std::size_t row) const {
  const double share = std::sqrt(std::max(ldlt_.smallest_pivot(), 1e-20));
  const double weakness = std::max(std::sqrt(pivot_at_choice_) / share, 1.0);
  const double limit = std::min(weakness * redundant_off_[row], kMostOff);
  return std::max({limit, redundant_off_[row], kIndependentRounding * scale_ / share});
}

bool EquationsOfMotion::redundant_rows_are_off() const {
  if (!(worst_redundant_ > 1.0) || is_closing()) return false;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (is_redundant_[i] && std::abs(value_[i]) / inputs_.row_length(*this, i) > redundant_limit(i)) return true;
  return false;
}

// Makes rows ordinary that are no longer redundant, and marks them as needed. Remaining redundant
// rows keep their tolerances.
void EquationsOfMotion::make_rows_again(const List<char>& redundant) {
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (is_redundant_[i] && !redundant[i]) is_needed_[i] = 1;
  const List<double> limits = redundant_off_;
  set_redundant(redundant);
  redundant_off_ = limits;
}

// Gives redundant rows that exceed their tolerance a force again, after find_values(); while joints
// are being closed the joints are inconsistent instead. Returns whether any row exceeds it. Where
// the kept rows came near dependence within one step, the step is first repeated with shorter ones.
bool EquationsOfMotion::restore_redundant_if_off() {
  if (!(worst_redundant_ > 1.0)) return false;
  if (is_closing()) {
    is_inconsistent_ = true;
    return true;
  }
  List<char> redundant = is_redundant_;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (redundant[i] && std::abs(value_[i]) / inputs_.row_length(*this, i) > redundant_limit(i)) redundant[i] = 0;
  if (redundant == is_redundant_) return false;
  const bool is_far = has_fallen(ldlt_.smallest_pivot(), pivot_at_choice_);
  if (is_far && ++too_far_ <= kMostTooFar) return true;
  make_rows_again(redundant);
  came_back_ = true;
  return true;
}

// Checks the rates of redundant rows after a projection of velocities. Where a rate is off, returns
// false and makes the row ordinary; under prescribed motions the joints are inconsistent instead.
bool EquationsOfMotion::redundant_rates_are_met() {
  if (left_out_ > 0 || ldlt_.smallest_pivot() < kRatesKnown) return true;
  const bool closes = is_closing();
  const double open = kOpenRates * opening(true);
  const double speed = largest_speed();
  const double rounding = 16.0 * kEpsilon * scale_;
  List<char> redundant;  // empty until a rate is off
  find_rates();
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (!is_redundant_[i] || (closes && imbalance_[i] > kExactSelfStress)) continue;
    const double share = std::clamp(kRateDrift * imbalance_[i], kRatesAgree, kMostDrift) + open;
    if (std::abs(rate_[i] - inputs_.rate_target()[i]) <= (share * speed + rounding) * inputs_.row_length(*this, i))
      continue;
    if (redundant.empty()) redundant = is_redundant_;
    redundant[i] = 0;
  }
  if (redundant.empty()) return true;
  if (inputs_.is_time_dependent()) {
    is_inconsistent_ = true;
    return false;
  }
  make_rows_again(redundant);
  return false;
}

// Whether the kept rows have come near dependence since the choice.
bool EquationsOfMotion::is_choice_due() const {
  return redundant_rows() > 0 && !is_closing() &&
         has_fallen(ldlt_.smallest_pivot(), pivot_at_choice_);
}

// Chooses the rows again where is_choice_due(). Returns whether it did.
bool EquationsOfMotion::choose_again(double t, const double* y) {
  too_far_ = 0;
  if (!is_choice_due()) return false;
  choose_rows(t, y);
  find_values();
  limit_redundant_rows();
  return true;
}

bool EquationsOfMotion::redundant_rows_are_met(double t, const List<Vector3d>& positions,
                                               const List<Eigen::Quaterniond>& orientations) {
  if (redundant_rows() == 0) return true;
  read_pose(positions, orientations);
  inputs_.update(*this, t);
  update_kinematics(t, pose_.data());
  find_values();
  return !restore_redundant_if_off();
}

// ---- momentary rows

// Keeps rows that factor() left out although their self-stress does not balance: their pivots are
// small because of a mass ratio.
void EquationsOfMotion::verify_left_out(double least) {
  for (bool any_kept = true; any_kept && left_out_ > 0;) {
    any_kept = false;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (is_redundant_[i]) continue;
      if (!ldlt_.is_left_out(rows_[i].unknown)) {
        is_verified_[i] = 0;
      } else if (!is_verified_[i] && !ldlt_.is_kept(rows_[i].unknown)) {
        is_verified_[i] = self_stress_imbalance(i) <= kMomentarySelfStress ? 1 : 0;
        if (is_verified_[i]) continue;
        ldlt_.keep(rows_[i].unknown);
        any_kept = true;
      }
    }
    if (!any_kept) return;
    find_matrix();
    left_out_ = ldlt_.factor(least);
  }
}

// Adds the error of momentary rows to momentary_error_. Rows that stay momentary may be redundant,
// so the next start chooses again after some restarts.
void EquationsOfMotion::note_left_out() {
  if (left_out_ == 0) {
    left_out_for_ = 0;
    return;
  }
  find_rates();
  double worst = 0.0;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (!is_redundant_[i] && ldlt_.is_left_out(rows_[i].unknown))
      worst = std::max(worst, std::abs(rate_[i] - inputs_.rate_target()[i]) / inputs_.row_length(*this, i));
  momentary_error_ += substep_ * worst;
  if (choose_after_ == 0) choose_after_ = kLeftOutUntilChoice;
  if (++left_out_for_ < choose_after_) return;
  has_chosen_ = false;
  choose_after_ *= 2;
}

}  // namespace constraint_sim::engine
