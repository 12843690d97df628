// End of a step of InconsistentMotion: positions of least error, velocities that fit the rates, and
// bounded energy.

#include <algorithm>
#include <cmath>

#include "engine/math/larger.h"
#include "engine/math/numbers.h"
#include "engine/methods/least_squares/inconsistent_motion.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Shares of the weights on the diagonal where a right-hand side cannot be met. Rates then cause
// velocities of up to 1/(2 sqrt(share)) times the rates.
constexpr double kInconsistentShare = 1e-8;
constexpr double kInconsistentRates = 1e-6;
constexpr int kMostMarquardtSteps = 60;
constexpr double kMostShare = 1e4;
constexpr double kRejectedShare = 1e-6;  // minimum after a rejected step

constexpr double kMet = 1e-6;            // [m]
constexpr double kReachable = 1e-10;     // share of the scene's size that runge_kutta can project
constexpr double kRateMet = 1e-6;        // share of the largest speed
constexpr double kRateRounding = 1e-12;  // [1/s] share of the scene's size

void clear(BodyVectors* u) {
  for (auto* list : {&u->linear, &u->angular})
    std::fill(list->begin(), list->end(), Vector3d::Zero());
}

}  // namespace

double InconsistentMotion::largest(const Numbers& list) {
  double most = 0.0;
  for (const double x : list) most = larger(most, std::abs(x));
  return most;
}

// ---- positions

// Components of a vector in the rows of a ball joint.
Vector3d InconsistentMotion::components(const Numbers& list, std::size_t row) const {
  return Eigen::Map<const Vector3d>(list.data() + rows_.first_row(rows_.rows()[row].joint));
}

// Share of d of a ball joint between two bodies that is off its target. The length of d has to
// follow the length of the offset, but d may rotate with the bodies.
double InconsistentMotion::share_off(std::size_t row, const Vector3d& d) const {
  const double distance = d.norm(), offset = components(target_.length, row).norm();
  return distance > offset ? 1.0 - offset / distance : 0.0;
}

// Position of the coordinate of term k of coupled row c.
double InconsistentMotion::reading_of(std::size_t c, std::size_t k, const Rows& geometry) const {
  const EquationsOfMotion::CoupledRow::Term& term = equations_->coupled_rows()[c].terms[k];
  return reading(term.form, value(term.form, geometry[term.link].vectors()), term.zero,
                 equations_->coordinates().term(c, k));
}

// Error of a row of a general joint [m]; whole turns of an angle do not count.
double InconsistentMotion::general_error(std::size_t i, const Rows& geometry) const {
  const RegularizedRows::Row& row = rows_.rows()[i];
  if (row.coupled >= 0) {
    double sum = 0.0;
    const auto c = to_index(row.coupled);
    for (std::size_t k = 0; k < 2; ++k)
      sum += equations_->coupled_rows()[c].terms[k].ratio * reading_of(c, k, geometry);
    return row.metres * sum - target_.length[i];
  }
  const double there = value(row.form, geometry[row.joint].vectors());
  if (!row.form.is_angle) return row.metres * there - target_.length[i];
  return row.metres * unwound(there - target_.length[i] / row.metres, 0.0);
}

// Computes C of rigid rows [m], and 0 for springs. Returns Σ C²/a.
double InconsistentMotion::errors(const Rows& geometry, Numbers* values) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < values->size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    const Vector3d& d = geometry[row.joint].d;
    (*values)[i] = row.axis < 0 ? d.norm() - target_.length[i] : d[row.axis] * share_off(i, d);
    if (row.axis >= 0 && !rows_.is_between_bodies(row.joint))
      (*values)[i] = d[row.axis] - target_.length[i];
    if (row.is_general) (*values)[i] = general_error(i, geometry);
    if (row.is_spring) (*values)[i] = 0.0;
    sum += (*values)[i] * (*values)[i] / weights_[i];
  }
  return sum;
}

// Displaces bodies by change_. Returns the largest displacement [m].
double InconsistentMotion::displace(Configuration* configuration) const {
  double most = 0.0;
  for (std::size_t i = 0; i < bodies_; ++i) {
    const Vector3d& dx = change_.linear[i];
    configuration->position[i] += dx;
    if (!(dx.norm() <= most)) most = dx.norm();
  }
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Vector3d& w = change_.angular[i];
    Quaterniond& q = configuration->orientation[i];
    q = (rotation(w) * q).normalized();
    if (!(w.norm() * radius_[i] <= most)) most = w.norm() * radius_[i];
  }
  return most;
}

// Computes change_ = −M⁻¹Gᵀ (A + µD)⁻¹ C, with D the weights. The part of C that no motion can
// remove is taken out first, by D t = C − µD (A + µD)⁻¹ C with t = (A + µD)⁻¹ A D⁻¹C; rounding then
// falls with the gradient Gᵀ D⁻¹ C instead of C. Springs resist as in a step.
void InconsistentMotion::find_correction(double share) {
  clear(&change_);
  rows_.factor(share, weights_, &compliance_);
  for (std::size_t i = 0; i < b_.size(); ++i) b_[i] = values_[i] / weights_[i];
  rows_.add_response(b_, &change_);
  for (std::size_t i = 0; i < b_.size(); ++i) b_[i] = rows_.apply(rows_.rows()[i], change_);
  rows_.solve(&b_);
  for (std::size_t i = 0; i < b_.size(); ++i)
    b_[i] = rows_.rows()[i].is_spring ? 0.0 : -weights_[i] * b_[i];
  rows_.solve(&b_);
  clear(&change_);
  rows_.add_response(b_, &change_);
}

// Minimizes Σ C²/a by Levenberg & Marquardt, with the weights 1/a of the start.
void InconsistentMotion::meet(Configuration* configuration, Rows* geometry,
                              IntegrationResult* progress) {
  rows_.linearize(*geometry, *geometry, *configuration);
  rows_.find_weights(&weights_);
  double sum = errors(*geometry, &values_);
  double share = 0.0, before = kInfinity;
  Configuration moved;
  Rows there;
  for (int k = 0; k < kMostMarquardtSteps && share <= kMostShare; ++k) {
    const double least = kInconsistentShare * std::sqrt(largest(values_) / scale_);
    share = std::max(share, std::clamp(least, kLeastShare, kInconsistentShare));
    ++progress->iterations;
    find_correction(share);
    moved = *configuration;
    const double most = displace(&moved);
    const bool is_rounding = most < kRounding * scale_ && most > 0.5 * before;
    if (!(most > 16.0 * kEpsilon * scale_) || is_rounding) return;
    rows_.measure(moved, &there);
    const double next = errors(there, &values_);
    if (!(next <= sum * (1.0 + 1e-14))) {
      share = std::max(10.0 * share, kRejectedShare);
      before = kInfinity;
      errors(*geometry, &values_);
      continue;
    }
    sum = next;
    before = most;
    std::swap(*configuration, moved);
    std::swap(*geometry, there);
    share *= 0.2;
    rows_.linearize(*geometry, *geometry, *configuration);
  }
}

// ---- velocities

// Projects velocity_ onto the target rates at end_.
void InconsistentMotion::fit_velocities() {
  rows_.linearize(at_end_, at_end_, end_);
  rows_.find_weights(&weights_);
  find_drive();
  rows_.factor(kLeastShare, weights_, nullptr);
  for (int pass = 0; pass < 2; ++pass) {
    for (std::size_t i = 0; i < b_.size(); ++i) {
      const RegularizedRows::Row& row = rows_.rows()[i];
      b_[i] = row.is_spring ? 0.0 : drive_rates_[i] - rows_.apply(row, velocity_);
    }
    rows_.solve(&b_);
    rows_.add_response(b_, &velocity_);
    for (std::size_t i = 0; i < b_.size(); ++i) {
      step_impulses_[i] += b_[i];
      work_ += b_[i] * drive_rates_[i];
    }
  }
}

// Computes the velocity of least kinetic energy that meets the target rates as far as possible.
void InconsistentMotion::find_drive() {
  clear(&drive_);
  std::fill(drive_rates_.begin(), drive_rates_.end(), 0.0);
  if (!target_.is_driven) return;
  Numbers rates(b_.size(), 0.0);
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    if (!row.is_spring) rates[i] = target_.rate[i] - rows_.apply(row, target_.fixed);
  }
  solve_drive(kLeastShare, rates);
  double off = 0.0;
  for (std::size_t i = 0; i < rates.size(); ++i)
    off = std::max(off, std::abs(drive_rates_[i] - rates[i]));
  if (!(off <= kReachable * largest(rates))) solve_drive(kInconsistentRates, rates);
}

void InconsistentMotion::solve_drive(double share, const Numbers& rates) {
  clear(&drive_);
  std::fill(drive_rates_.begin(), drive_rates_.end(), 0.0);
  rows_.factor(share, weights_, nullptr);
  for (int pass = 0; pass < 2; ++pass) {
    for (std::size_t i = 0; i < b_.size(); ++i) b_[i] = rates[i] - drive_rates_[i];
    rows_.solve(&b_);
    rows_.add_response(b_, &drive_);
    for (std::size_t i = 0; i < b_.size(); ++i)
      if (!rows_.rows()[i].is_spring) drive_rates_[i] = rows_.apply(rows_.rows()[i], drive_);
  }
}

// ---- energy

double InconsistentMotion::momentum_product(const BodyVectors& u, const BodyVectors& v) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < bodies_; ++i) sum += mass_[i] * u.linear[i].dot(v.linear[i]);
  for (std::size_t i = 0; i < rotating_; ++i)
    sum += u.angular[i].dot(apply_inertia(inertia_[i], end_.orientation[i], v.angular[i]));
  return sum;
}

double InconsistentMotion::kinetic_energy(const BodyVectors& velocity) const {
  return 0.5 * momentum_product(velocity, velocity);
}

// Length of a spring, or position of the coordinate of a spring [m].
double InconsistentMotion::extent(std::size_t i, const Rows& geometry) const {
  const RegularizedRows::Row& row = rows_.rows()[i];
  if (row.soft < 0) return geometry[row.joint].d.norm();
  const EquationsOfMotion::SoftCoordinate& soft =
      equations_->soft_coordinates()[static_cast<std::size_t>(row.soft)];
  const double there = value(soft.form, geometry[row.joint].vectors());
  return row.metres *
         reading(soft.form, there, soft.zero, equations_->coordinates().soft(to_index(row.soft)));
}

// Energy of springs at end_ [J]; energy of constant forces counts from the rest position.
double InconsistentMotion::spring_energy() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < stiffness_.size(); ++i) {
    if (!rows_.rows()[i].is_spring) continue;
    const double stretch = extent(i, at_end_) - target_.length[i];
    sum += 0.5 * stiffness_[i] * stretch * stretch - force_[i] * stretch;
  }
  return sum;
}

// Work along the target rates by lambda_, the impulses that moved the bodies [J].
double InconsistentMotion::work_of_drives() const {
  if (!target_.is_driven) return 0.0;
  double sum = 0.0;
  for (std::size_t i = 0; i < lambda_.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    const double rate = row.is_spring ? target_.rate[i] - rows_.apply(row, target_.fixed)
                                      : 0.5 * (drive_before_[i] + drive_rates_[i]);
    sum += lambda_[i] * rate;
  }
  return sum;
}

// Energy that dampers dissipate from start_ to end_ [J].
double InconsistentMotion::damped_energy(double h) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < damping_.size(); ++i) {
    if (damping_[i] == 0.0) continue;
    const double rate = (extent(i, at_end_) - extent(i, at_start_)) / h - target_.rate[i];
    sum += h * damping_[i] * rate * rate;
  }
  return sum;
}

// Work of gravity and wrenches from start_ to end_ [J].
double InconsistentMotion::work_of_loads() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < bodies_; ++i)
    sum += mass_[i] *
           equations_->inputs().acceleration()[i].dot(end_.position[i] - start_.position[i]);
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Vector3d turn = rotation_vector(end_.orientation[i] * start_.orientation[i].conjugate());
    sum += equations_->inputs().torque()[i].dot(turn);
  }
  return sum;
}

void InconsistentMotion::scale(const BodyVectors& part, double factor) {
  for (std::size_t i = 0; i < bodies_; ++i) velocity_.linear[i] -= (1.0 - factor) * part.linear[i];
  for (std::size_t i = 0; i < rotating_; ++i)
    velocity_.angular[i] -= (1.0 - factor) * part.angular[i];
}

// Removes kinetic energy beyond `allowed` [J] from velocity_: first from the motion within the
// island, then from the rotation of a free island without drives, never from the motion of its
// centre. These parts and the driven velocity are orthogonal in kinetic energy.
void InconsistentMotion::cap_energy(double allowed, IntegrationResult* progress) {
  double excess = kinetic_energy(velocity_) - allowed;
  if (excess > 0.0) {
    BodyVectors rest = velocity_;
    BodyVectors centre, turning;
    const auto take_off = [&](const BodyVectors& part) {
      for (std::size_t i = 0; i < bodies_; ++i) rest.linear[i] -= part.linear[i];
      for (std::size_t i = 0; i < rotating_; ++i) rest.angular[i] -= part.angular[i];
    };
    const auto lower = [&](const BodyVectors& part) {
      const double energy = kinetic_energy(part);
      if (!(energy > 0.0) || !(excess > 0.0)) return;
      scale(part, std::sqrt(std::max(0.0, 1.0 - excess / energy)));
      excess -= std::min(excess, energy);
    };
    take_off(drive_);
    if (is_free_) {
      find_rigid_motion(&centre, &turning);
      take_off(centre);
      take_off(turning);
    }
    lower(rest);
    if (is_free_ && !target_.is_driven) lower(turning);
    excess = kinetic_energy(velocity_) - allowed;
  }
  if (excess > 0.0)
    progress->corrected += excess;
  else
    progress->projected -= excess;
}

// ---- rigid motion

// Rigid motion of a free island with the momenta of velocity_.
void InconsistentMotion::find_rigid_motion(BodyVectors* centre, BodyVectors* turning) const {
  const RigidMotion body = as_one_body(end_, velocity_);
  centre->linear.assign(points_, body.velocity);
  centre->angular.assign(rotating_, Vector3d::Zero());
  const Vector3d w = body.angular_velocity();
  turning->linear.assign(points_, Vector3d::Zero());
  turning->angular.assign(rotating_, w);
  for (std::size_t i = 0; i < bodies_; ++i)
    turning->linear[i] = w.cross(end_.position[i] - body.centre);
}

// Restores the angular momentum of a free island after an explicit step, whose position corrections
// change it.
void InconsistentMotion::restore_angular_momentum(double h) {
  const RigidMotion before = as_one_body(start_, velocity_before_);
  const RigidMotion now = as_one_body(end_, velocity_);
  Vector3d missing = before.momentum - now.momentum;
  for (std::size_t i = 0; i < bodies_; ++i) {
    const Vector3d arm = 0.5 * (start_.position[i] - before.centre + end_.position[i] - now.centre);
    missing += h * mass_[i] * arm.cross(equations_->inputs().acceleration()[i]);
  }
  for (std::size_t i = 0; i < rotating_; ++i) missing += h * equations_->inputs().torque()[i];
  const Vector3d w = now.inverse_inertia * missing;
  for (std::size_t i = 0; i < bodies_; ++i)
    velocity_.linear[i] += w.cross(end_.position[i] - now.centre);
  for (Vector3d& spin : velocity_.angular) spin += w;
}

// ---- whether all rows can be met

void InconsistentMotion::find_whether_met() {
  errors(at_end_, &values_);
  can_be_met_ = largest(values_) <= kMet;
  double speed = 0.0, off = 0.0;
  for (const Vector3d& v : velocity_.linear) speed = std::max(speed, v.norm());
  for (std::size_t i = 0; i < values_.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    if (row.is_spring) continue;
    const double rate = target_.rate[i] - rows_.apply(row, target_.fixed);
    speed = std::max(speed, std::abs(rate));
    off = std::max(off, std::abs(rate - rows_.apply(row, velocity_)));
  }
  for (std::size_t i = 0; i < rotating_; ++i)
    speed = std::max(speed, radius_[i] * velocity_.angular[i].norm());
  if (off > kRateMet * speed + kRateRounding * scale_) can_be_met_ = false;
  if (!can_be_met_) return;
  // Tests the part of C that no displacement can remove.
  rows_.factor(kLeastShare, weights_, nullptr);
  b_ = values_;
  rows_.solve(&b_);
  for (std::size_t i = 0; i < b_.size(); ++i)
    if (std::abs(kLeastShare * weights_[i] * b_[i]) > kReachable * scale_) can_be_met_ = false;
}

}  // namespace constraint_sim::engine
