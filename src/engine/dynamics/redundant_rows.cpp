#include "engine/dynamics/redundant_rows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "engine/dynamics/closing_joints.h"
#include "engine/math/independent_rows.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Rounding of a pivot in the order of SparseLdlt, as a share of its diagonal entry.
constexpr double kRoundOffPivot = 1e-13;
// Imbalance of the forces of a self-stress, as a share of the largest force, up to which a row is
// redundant: in general; of rows that depend to rounding; of rows that factor() leaves out in a
// singular pose alone; and at most while joints are being closed.
constexpr double kSelfStress = 1e-6;
constexpr double kExactSelfStress = 1e-9;
constexpr double kMomentarySelfStress = 1e-3;
constexpr double kMostSelfStress = 0.1;
constexpr int kRefinements = 3;  // iterative refinements of a self-stress

// Tolerances of redundant rows. Lengths that are rounded in a scene make rows only nearly
// dependent, so tolerances grow with the imbalance of the forces.
constexpr double kRowSolved = 1e-11;  // share of the island's size
constexpr double kDrift = 1e3;        // share of the island's size, per imbalance
constexpr double kMostDrift = 1e-3;   // largest imbalance and share of a speed by drift
constexpr double kMostOff = 1e-5;     // [m]
constexpr double kConsistent = 1e-6;  // [m]; a row with a larger error contradicts the others
// Share of the island's size where kept rows are independent.
constexpr double kIndependentRounding = 1e-13;
// Least pivot, as a share of its diagonal entry, by which a tolerance grows: rounding makes smaller
// pivots zero or negative.
constexpr double kLeastWeakPivot = 1e-20;

// Rows are chosen again when the smallest pivot of the kept rows falls by this factor. Early, since
// a pivot that passes through zero takes the projection to another solution.
constexpr double kChooseAgain = 0.1;
// Pivots below rounding count as equal; otherwise the choice would repeat without end.
bool has_fallen(double pivot, double at_choice) {
  return std::max(pivot, kRoundOffPivot) < kChooseAgain * std::max(at_choice, kRoundOffPivot);
}
constexpr double kRatesKnown = 1e-6;  // smallest pivot for which rates are conclusive
constexpr double kRatesAgree = 1e-6;  // share of the largest speed
constexpr double kOpenRates = 3.0;    // share of the largest speed, per opening angle
constexpr double kRateDrift = 1e4;    // share of the largest speed, per imbalance
constexpr int kMostRejections = 10;  // consecutive steps rejected, as kept rows are near dependence
constexpr int kLeftOutUntilChoice = 8;  // restarts with momentary rows before the first new choice

}  // namespace

RedundantRows::RedundantRows(const IslandModel& island) {
  const std::size_t n = island.rows();
  for (auto* list : {&is_redundant_, &is_required_, &is_needed_, &is_verified_}) list->assign(n, 0);
  for (auto* list : {&imbalance_, &tolerance_, &stress_, &residual_}) list->assign(n, 0.0);
  find_branches(island);
}

void RedundantRows::forget(const IslandModel& island, DelassusMatrix* delassus,
                           JointForces* forces) {
  set(island, List<char>(island.rows(), 0), delassus, forces);
  std::fill(is_needed_.begin(), is_needed_.end(), 0);
  std::fill(imbalance_.begin(), imbalance_.end(), 0.0);
  delassus->keep_none();
  delassus->leave_out_none();
  has_chosen_ = is_inconsistent_ = came_back_ = false;
  pivot_at_choice_ = 1.0;
  rejections_ = left_out_for_ = choose_after_ = 0;
}

// ---- choice of redundant rows

// Finds the rows of branches, through which no loop of joints passes. Nothing else holds what they
// hold, so they are never redundant. All immovable bodies count as one body.
void RedundantRows::find_branches(const IslandModel& island) {
  const std::size_t ground = island.bodies().size();
  List<std::size_t> degree(ground + 1, 0), of_links(ground + 1, 0);  // xor of the link indices
  const auto ends = [&](std::size_t l) {
    const IslandModel::Link& link = island.links()[l];
    return std::array<std::size_t, 2>{std::min(link.a, ground), std::min(link.b, ground)};
  };
  for (std::size_t l = 0; l < island.first().spring; ++l) {
    for (const std::size_t end : ends(l)) {
      ++degree[end];
      of_links[end] ^= l;
    }
  }
  for (std::size_t leaf = 0; leaf <= ground; ++leaf) {
    for (std::size_t node = leaf; degree[node] == 1;) {
      const std::size_t l = of_links[node];
      const auto [a, b] = ends(l);
      require(island, l);
      for (const std::size_t end : {a, b}) {
        --degree[end];
        of_links[end] ^= l;
      }
      node = node == a ? b : a;
    }
  }
}

void RedundantRows::require(const IslandModel& island, std::size_t link) {
  const std::size_t first = island.row_of(link);
  for (std::size_t k = 0; k < island.rows_of(link); ++k) is_required_[first + k] = 1;
}

int RedundantRows::choose(const PlacedRows& rows, DelassusMatrix* delassus, JointForces* forces) {
  const std::size_t n = is_redundant_.size();
  has_chosen_ = true;
  left_out_for_ = 0;
  delassus->forget_factors();
  delassus->keep_none();
  if (n == 0) return 0;
  // Joints being closed depend on each other only up to their opening angle; lengths with few
  // digits only to as few digits, in some poses less well.
  double tolerance = std::clamp(kOpenShare * opening(rows, false), kSelfStress, kMostSelfStress);
  if (delassus->redundant() > 0) tolerance = std::max(tolerance, redundant_self_stress());
  const double least = std::max(DelassusMatrix::kLeastPivot, tolerance * tolerance);
  const auto factor = [&](double least_pivot) {
    delassus->evaluate(rows.kinematics);
    delassus->factor(least_pivot);
    delassus->forget_factors();  // they belong to other tolerances than those of a step
  };
  if (delassus->redundant() == 0) {
    factor(least);
    if (delassus->left_out() == 0) return 0;
  }

  List<char> redundant = independent_rows(rows, least, delassus);
  for (std::size_t i = 0; i < n; ++i)
    redundant[i] = !redundant[i] && !is_needed_[i] && !is_required_[i] ? 1 : 0;
  set(rows.island, redundant, delassus, forces);
  factor(kRoundOffPivot);
  int momentary = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!redundant[i]) continue;
    imbalance_[i] = self_stress_imbalance(rows, i, delassus);
    if (imbalance_[i] <= tolerance) continue;
    redundant[i] = 0;
    ++momentary;
  }
  if (momentary > 0) {
    set(rows.island, redundant, delassus, forces);
    factor(kRoundOffPivot);
  }
  pivot_at_choice_ = std::max(delassus->smallest_pivot(), 0.0);
  return momentary;
}

// Imbalance up to which rows stay redundant in a new choice.
double RedundantRows::redundant_self_stress() const {
  double worst = 0.0;
  for (std::size_t i = 0; i < is_redundant_.size(); ++i)
    if (is_redundant_[i]) worst = std::max(worst, imbalance_[i]);
  return std::min(kDrift * worst, kMostDrift);
}

// Computes A of all rows, redundant rows included.
Eigen::MatrixXd RedundantRows::dense_matrix(const PlacedRows& rows, DelassusMatrix* delassus) {
  const List<std::size_t>& unknown = delassus->unknown();
  const std::size_t n = unknown.size();
  const List<double> zero(n, 0.0);
  Eigen::MatrixXd A(n, n);
  for (std::size_t i = 0; i < n; ++i) {
    std::fill(stress_.begin(), stress_.end(), 0.0);
    stress_[unknown[i]] = 1.0;
    delassus->find_residual(rows.island, rows.kinematics, zero.data(), stress_.data(),
                            residual_.data());
    for (std::size_t j = 0; j < n; ++j)
      A(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(i)) = -residual_[unknown[j]];
  }
  return A;
}

List<char> RedundantRows::independent_rows(const PlacedRows& rows, double least,
                                           DelassusMatrix* delassus) {
  const std::size_t n = is_redundant_.size();
  List<char> was_kept(n), is_needed = is_required_;
  for (std::size_t i = 0; i < n; ++i) {
    was_kept[i] = is_redundant_[i] ? 0 : 1;
    is_needed[i] = is_needed[i] || is_needed_[i] ? 1 : 0;
  }
  return choose_independent_rows(dense_matrix(rows, delassus), was_kept, is_needed, least).is_kept;
}

// Imbalance at the bodies of the self-stress of a row without a force in the current factors, as a
// share of its largest force. Independent of masses.
double RedundantRows::self_stress_imbalance(const PlacedRows& rows, std::size_t row,
                                            DelassusMatrix* delassus) {
  const auto& [island, inputs, kinematics, scale, time] = rows;
  const List<std::size_t>& unknown = delassus->unknown();
  const List<double> zero(unknown.size(), 0.0);
  std::fill(stress_.begin(), stress_.end(), 0.0);
  stress_[unknown[row]] = 1.0;
  for (int k = 0; k < kRefinements; ++k) {
    delassus->find_residual(island, kinematics, zero.data(), stress_.data(), residual_.data());
    delassus->refine(residual_.data(), stress_.data());
  }
  delassus->apply_transpose(island, kinematics, stress_.data());
  const auto stress_of = [&](std::size_t i) { return std::abs(stress_[unknown[i]]); };
  double force = 0.0, torque = 0.0;  // largest of any row
  for (std::size_t i = 0; i < unknown.size(); ++i)
    force = std::max(force, stress_of(i) * kinematics.J_linear()[i].norm());
  for (const IslandModel::GeneralRow& general : island.general_rows())
    if (!general.form.has_separation())  // rows between axes: torque over an arm
      force = std::max(force, stress_of(general.row) / general.metres);
  for (const IslandModel::CoupledRow& coupled : island.coupled_rows())
    force = std::max(force, stress_of(coupled.row) / coupled.metres);
  for (std::size_t p = 0; p < island.angular_blocks().size(); ++p) {
    const IslandModel::AngularBlock& block = island.angular_blocks()[p];
    const double arm =
        island.radius_of_gyration(block.body) * kinematics.J_linear()[block.row].norm();
    torque = std::max(torque, stress_of(island.row_of_part(block.row)) *
                                  std::max(kinematics.J_angular()[p].norm(), arm));
  }
  double imbalance = 0.0;
  for (std::size_t i = 0; i < island.bodies().size(); ++i)
    imbalance = std::max(imbalance, delassus->force()[i].norm() / force);
  // Torques that the self-stress does not load hold only rounding, so forces bound their scale.
  for (std::size_t i = 0; i < island.rotating(); ++i)
    imbalance = std::max(imbalance, delassus->torque()[i].norm() /
                                        std::max(torque, force * island.radius_of_gyration(i)));
  return imbalance;
}

void RedundantRows::set(const IslandModel& island, const List<char>& redundant,
                        DelassusMatrix* delassus, JointForces* forces) {
  std::fill(is_verified_.begin(), is_verified_.end(), 0);
  std::fill(tolerance_.begin(), tolerance_.end(), kInfinity);
  delassus->forget_factors();
  if (redundant.size() != is_redundant_.size())
    throw std::invalid_argument("redundant rows: must be flags of all rows");
  if (redundant == is_redundant_) return;
  is_redundant_ = redundant;
  delassus->compile(island, is_redundant_);
  forces->sort(delassus->unknown());
}

// ---- watch over redundant rows

bool RedundantRows::limit(const PlacedRows& rows, const DelassusMatrix& delassus) {
  if (delassus.redundant() == 0) return true;
  const double closing = closing_curvature(rows);
  for (std::size_t i = 0; i < is_redundant_.size(); ++i) {
    if (!is_redundant_[i]) continue;
    const double off =
        std::abs(rows.kinematics.value()[i]) / rows.inputs.row_length(rows.island, i);
    if (off > kConsistent + closing) is_inconsistent_ = true;
    const double drift = std::min(kDrift * imbalance_[i] * rows.scale, kMostOff);
    tolerance_[i] = closing > 0.0 ? kConsistent + closing
                                  : std::max({kRowSolved * rows.scale, drift, 4.0 * off});
  }
  has_chosen_ = has_chosen_ && !is_inconsistent_;
  return !is_inconsistent_;
}

// Tolerance of a redundant row [m]. Near dependence the kept rows determine the others less well,
// and the tolerance grows.
double RedundantRows::tolerance(const PlacedRows& rows, std::size_t row,
                                const DelassusMatrix& delassus) const {
  const double share = std::sqrt(std::max(delassus.smallest_pivot(), kLeastWeakPivot));
  const double weakness = std::max(std::sqrt(pivot_at_choice_) / share, 1.0);
  const double grown = std::min(weakness * tolerance_[row], kMostOff);
  return std::max({grown, tolerance_[row], kIndependentRounding * rows.scale / share});
}

// Flags of the redundant rows whose errors are within their tolerances.
List<char> RedundantRows::met_rows(const PlacedRows& rows, const DelassusMatrix& delassus) const {
  List<char> met = is_redundant_;
  for (std::size_t i = 0; i < met.size(); ++i) {
    if (!met[i]) continue;
    const double error = std::abs(rows.kinematics.value()[i]);
    if (error / rows.inputs.row_length(rows.island, i) > tolerance(rows, i, delassus)) met[i] = 0;
  }
  return met;
}

bool RedundantRows::are_off(const PlacedRows& rows, const DelassusMatrix& delassus) const {
  if (!(worst_ > 1.0) || is_closing(rows.inputs)) return false;
  return met_rows(rows, delassus) != is_redundant_;
}

// Gives rows that are not redundant a force again, and marks them as needed. Remaining redundant
// rows keep their tolerances.
void RedundantRows::make_rows_again(const IslandModel& island, const List<char>& redundant,
                                    DelassusMatrix* delassus, JointForces* forces) {
  for (std::size_t i = 0; i < redundant.size(); ++i)
    if (is_redundant_[i] && !redundant[i]) is_needed_[i] = 1;
  const List<double> tolerances = tolerance_;
  set(island, redundant, delassus, forces);
  tolerance_ = tolerances;
}

bool RedundantRows::restore_if_off(const PlacedRows& rows, DelassusMatrix* delassus,
                                   JointForces* forces) {
  if (!(worst_ > 1.0)) return false;
  if (is_closing(rows.inputs)) {
    is_inconsistent_ = true;
    return true;
  }
  const List<char> redundant = met_rows(rows, *delassus);
  if (redundant == is_redundant_) return false;
  const bool is_far = has_fallen(delassus->smallest_pivot(), pivot_at_choice_);
  if (is_far && ++rejections_ <= kMostRejections) return true;
  make_rows_again(rows.island, redundant, delassus, forces);
  came_back_ = true;
  return true;
}

bool RedundantRows::are_rates_known(const DelassusMatrix& delassus) const {
  return delassus.left_out() == 0 && !(delassus.smallest_pivot() < kRatesKnown);
}

bool RedundantRows::rates_are_met(const PlacedRows& rows, DelassusMatrix* delassus,
                                  JointForces* forces) {
  const auto& [island, inputs, kinematics, scale, time] = rows;
  const bool closes = is_closing(inputs);
  const double open = kOpenRates * opening(rows, true);
  const double speed = kinematics.largest_speed(island);
  const double rounding = 16.0 * kEpsilon * scale;
  List<char> redundant;  // empty until a rate is off
  for (std::size_t i = 0; i < is_redundant_.size(); ++i) {
    if (!is_redundant_[i] || (closes && imbalance_[i] > kExactSelfStress)) continue;
    const double share = std::clamp(kRateDrift * imbalance_[i], kRatesAgree, kMostDrift) + open;
    const double off = std::abs(kinematics.rate()[i] - inputs.rate_target()[i]);
    if (off <= (share * speed + rounding) * inputs.row_length(island, i)) continue;
    if (redundant.empty()) redundant = is_redundant_;
    redundant[i] = 0;
  }
  if (redundant.empty()) return true;
  if (inputs.is_time_dependent()) {
    is_inconsistent_ = true;
    return false;
  }
  make_rows_again(island, redundant, delassus, forces);
  return false;
}

bool RedundantRows::is_choice_due(const PlacedRows& rows, const DelassusMatrix& delassus) const {
  return delassus.redundant() > 0 && !is_closing(rows.inputs) &&
         has_fallen(delassus.smallest_pivot(), pivot_at_choice_);
}

// ---- momentary rows

// Not inlined, since few stages call it.
[[gnu::noinline]] void RedundantRows::verify_left_out(const PlacedRows& rows, double least,
                                                      DelassusMatrix* delassus) {
  for (bool any_kept = true; any_kept && delassus->left_out() > 0;) {
    any_kept = false;
    for (std::size_t i = 0; i < is_redundant_.size(); ++i) {
      if (is_redundant_[i]) continue;
      if (!delassus->is_left_out(i)) {
        is_verified_[i] = 0;
      } else if (!is_verified_[i] && !delassus->is_kept(i)) {
        const double imbalance = self_stress_imbalance(rows, i, delassus);
        is_verified_[i] = imbalance <= kMomentarySelfStress ? 1 : 0;
        if (is_verified_[i]) continue;
        delassus->keep(i);
        any_kept = true;
      }
    }
    if (!any_kept) return;
    delassus->evaluate(rows.kinematics);
    delassus->factor(least);
  }
}

void RedundantRows::note_left_out(const PlacedRows& rows, const DelassusMatrix& delassus,
                                  double substep) {
  double worst = 0.0;
  for (std::size_t i = 0; i < is_redundant_.size(); ++i) {
    if (is_redundant_[i] || !delassus.is_left_out(i)) continue;
    const double off = std::abs(rows.kinematics.rate()[i] - rows.inputs.rate_target()[i]);
    worst = std::max(worst, off / rows.inputs.row_length(rows.island, i));
  }
  momentary_error_ += substep * worst;
  if (choose_after_ == 0) choose_after_ = kLeftOutUntilChoice;
  if (++left_out_for_ < choose_after_) return;
  has_chosen_ = false;
  choose_after_ *= 2;
}

}  // namespace constraint_sim::engine
