// Steps of InconsistentMotion, by impulses that lead to positions where the rows are met, or
// without such impulses.

#include "engine/methods/least_squares/inconsistent_motion.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/math/cross_matrix.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kMostAngle = 0.1;  // [rad] rotation of a joint in one step
constexpr double kMostMotionParts = 32.0;
constexpr int kMostMidpointSteps = 16;
constexpr int kMostFitIterations = 60;
constexpr int kMostHalvings = 50;         // halvings of a displacement, until nothing is left
constexpr double kMidpointFound = 1e-14;  // share of the scene's size
// Share of energy that the impulses of a midpoint step may add before they are left out.
constexpr double kMostAdded = 1e-3;
constexpr double kMostAddedDriven = 0.5;
// Assumed lower bound of the inverse compliance of a constant force, as a share of the mass that it
// moves.
constexpr double kLeastGiven = 1e-9;

// Orientation halfway along the shorter rotation from a to b.
Quaterniond halfway(const Quaterniond& a, const Quaterniond& b) {
  const double side = a.dot(b) < 0.0 ? -1.0 : 1.0;
  return Quaterniond(a.coeffs() + side * b.coeffs()).normalized();
}

}  // namespace

// ---- compilation

InconsistentMotion::InconsistentMotion(const InconsistentMotion& other) = default;
InconsistentMotion::InconsistentMotion(InconsistentMotion&& other) noexcept = default;
InconsistentMotion& InconsistentMotion::operator=(const InconsistentMotion& other) = default;
InconsistentMotion& InconsistentMotion::operator=(InconsistentMotion&& other) noexcept = default;
InconsistentMotion::~InconsistentMotion() = default;

InconsistentMotion::InconsistentMotion(const EquationsOfMotion& equations)
    : body_indices_(equations.bodies()),
      bodies_(equations.bodies().size()),
      rotating_(equations.rotating()),
      points_(equations.points()),
      is_free_(points_ == bodies_),
      rows_(equations) {
  for (std::size_t i = 0; i < bodies_; ++i) mass_.push_back(1.0 / equations.inverse_mass(i));
  for (std::size_t i = 0; i < rotating_; ++i) {
    inertia_.push_back(equations.inertia(i));
    radius_.push_back(equations.radius_of_gyration(i));
  }
  for (const RegularizedRows::Row& row : rows_.rows()) {
    const EquationsOfMotion::Link& joint = equations.links()[row.joint];
    SoftLaw law{joint.stiffness, 0.0, joint.damping, 0.0};
    if (row.soft >= 0) law = equations.soft_coordinates()[row.soft].law;
    stiffness_.push_back(law.K / (row.metres * row.metres));
    damping_.push_back(law.C / (row.metres * row.metres));
    force_.push_back(law.F / row.metres);
    const double inverse_mass = equations.inverse_mass(joint.a) + equations.inverse_mass(joint.b);
    least_given_.push_back(row.soft >= 0 ? kLeastGiven / inverse_mass : 0.0);
  }
  for (Configuration* c : {&start_, &end_, &met_}) {
    c->position.assign(points_, Vector3d::Zero());
    c->orientation.assign(rotating_, Quaterniond::Identity());
    c->fixed_axes.assign(points_ - bodies_, Matrix3d::Identity());
  }
  for (BodyVectors* u :
       {&velocity_, &velocity_before_, &displacement_, &change_, &drive_, &target_.fixed}) {
    u->linear.assign(points_, Vector3d::Zero());
    u->angular.assign(rotating_, Vector3d::Zero());
  }
  for (Numbers* list : {&values_, &b_, &lambda_, &compliance_, &step_impulses_, &impulses_, &q_,
                        &drive_rates_, &drive_before_, &target_.length, &target_.rate})
    list->assign(rows_.rows().size(), 0.0);
}

void InconsistentMotion::gather_state(const List<BodyState>& states) {
  for (std::size_t i = 0; i < bodies_; ++i) {
    const BodyState& state = states[body_indices_[i]];
    end_.position[i] = state.position;
    velocity_.linear[i] = state.linear_velocity;
    if (i >= rotating_) continue;
    end_.orientation[i] = state.orientation;
    velocity_.angular[i] = state.angular_velocity;
  }
}

void InconsistentMotion::scatter_state(List<BodyState>* states) const {
  for (std::size_t i = 0; i < bodies_; ++i) {
    BodyState& state = (*states)[body_indices_[i]];
    state.position = end_.position[i];
    state.linear_velocity = velocity_.linear[i];
    if (i >= rotating_) continue;
    state.orientation = end_.orientation[i];
    state.angular_velocity = velocity_.angular[i];
  }
}

// Reads lengths, offsets, rates of motors and immovable points at time t. Closing an error demands
// no rate: position corrections follow the target, and do work only on weights and springs.
void InconsistentMotion::ask(double t, EquationsOfMotion* equations, Configuration* configuration) {
  equations->move_with_time(t);
  target_.is_driven = equations->inputs().is_time_dependent();
  for (std::size_t p = bodies_; p < points_; ++p) {
    configuration->position[p] = equations->kinematics().position()[p];
    target_.fixed.linear[p] =
        equations->inputs().body_velocity(p, t, equations->kinematics().position()[p]);
    configuration->fixed_axes[p - bodies_] = equations->inputs().fixed_axes(p);
  }
  configuration->frames_b.clear();
  for (std::size_t l = 0; l < equations->links().size(); ++l) {
    const std::size_t i = rows_.first_row(l);
    if (equations->is_general(l) && equations->inputs().frame_b(l).moves &&
        configuration->frames_b.empty())
      for (std::size_t k = 0; k < equations->links().size(); ++k)
        configuration->frames_b.push_back(
            equations->is_general(k)
                ? equations->inputs().frame_b(k)
                : MovingFrame(equations->links()[k].anchor_b, Matrix3d::Identity()));
    if (!equations->is_ball(l) && !equations->is_general(l)) {
      target_.length[i] = equations->inputs().length()[l].value;
      target_.rate[i] = equations->is_rod(l) ? equations->inputs().driven_rate(*equations, l, t)[0]
                                             : equations->inputs().length()[l].rate;
      continue;
    }
    const EquationsOfMotion::Link& link = equations->links()[l];
    RowVector offset = equations->inputs().offset(*equations, l);
    if (info(link.kind).form == RowsForm::kPoint)
      offset.head<3>() += ball_offset(l, *configuration);
    const RowVector rate = equations->inputs().driven_rate(*equations, l, t);
    for (std::size_t k = 0; k < equations->rows_of(l); ++k) {
      const double metres = rows_.rows()[i + k].metres;
      target_.length[i + k] = metres * offset[static_cast<Eigen::Index>(k)];
      target_.rate[i + k] = metres * rate[static_cast<Eigen::Index>(k)];
    }
    for (std::size_t s = 0; s < link.softs; ++s) {
      const std::size_t k = i + equations->rows_of(l) + s;
      target_.length[k] =
          rows_.rows()[k].metres * equations->soft_coordinates()[link.first_soft + s].law.R;
    }
  }
  for (std::size_t i = rows_.rows().size() - equations->coupled_rows().size();
       i < rows_.rows().size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    const auto c = to_index(row.coupled);
    target_.length[i] = row.metres * (equations->coordinates().constant(c) +
                                      equations->inputs().coupling_offset(c).value);
    target_.rate[i] = 0.0;
  }
  scale_ = largest(target_.length);
  for (const Vector3d& x : configuration->position)
    scale_ = std::max(scale_, x.cwiseAbs().maxCoeff());
  if (scale_ == 0.0) scale_ = 1.0;
}

// Offset of d of a ball joint that is closed by its frame on B, in world axes at the pose of B.
Vector3d InconsistentMotion::ball_offset(std::size_t joint,
                                         const Configuration& configuration) const {
  if (!equations_->is_general(joint) || !equations_->inputs().frame_b(joint).moves)
    return Vector3d::Zero();
  const EquationsOfMotion::Link& link = equations_->links()[joint];
  const Vector3d shift = equations_->inputs().frame_b(joint).anchor - link.anchor_b;
  return link.b < rotating_ ? -(configuration.orientation[link.b] * shift) : Vector3d(-shift);
}

// ---- an interval

IntegrationResult InconsistentMotion::advance(const Interval& span, EquationsOfMotion* equations,
                                              List<BodyState>* states) {
  IntegrationResult progress;
  progress.local_error = std::numeric_limits<double>::quiet_NaN();  // the method has no estimate
  equations_ = equations;
  equations->begin(span.t, *states, span.gravity, span.loads, span.courses, span.since_tick);
  equations->add_custom_loads(span.t, *states);
  gather_state(*states);
  ask(span.t, equations, &end_);
  rows_.measure(end_, &at_end_);
  std::fill(impulses_.begin(), impulses_.end(), 0.0);
  std::fill(step_impulses_.begin(), step_impulses_.end(), 0.0);
  work_ = 0.0;
  spring_energy_ = spring_energy();
  const double before = kinetic_energy(velocity_);
  fit_velocities();
  progress.projected = before + work_ - kinetic_energy(velocity_);
  for (std::size_t i = 0; i < impulses_.size(); ++i) impulses_[i] += step_impulses_[i];

  const int parts = number_of_parts(span.h);
  const double h = span.h / parts;
  for (int k = 0; k < parts; ++k) {
    const double energy = kinetic_energy(velocity_) + spring_energy_;
    start_ = end_;  // end_ stays valid: the scale depends on positions of bodies
    at_start_ = at_end_;
    ask(span.t + (k + 1) * h, equations, &end_);
    step(h, energy, &progress);
    ++progress.substeps;
    equations->coordinates().add_turns(
        *equations, equations->inputs(), span.t + (k + 1) * h, h,
        [&](std::size_t body) { return displacement_.angular[body]; },
        [&](std::size_t l, std::size_t end) { return at_start_[l].axes[end].col(2); });
    for (std::size_t i = 0; i < rows_.rows().size(); ++i)
      if (rows_.rows()[i].soft >= 0)
        equations->coordinates().set_soft(to_index(rows_.rows()[i].soft),
                                          extent(i, at_end_) / rows_.rows()[i].metres);
    for (std::size_t c = 0; c < equations->coupled_rows().size(); ++c)
      for (std::size_t term = 0; term < 2; ++term)
        equations->coordinates().set_term(c, term, reading_of(c, term, at_end_));
  }
  progress.projected = std::max(progress.projected, 0.0);
  find_whether_met();
  progress.done =
      std::isfinite(kinetic_energy(velocity_)) && std::isfinite(errors(at_end_, &values_));
  if (!progress.done) return progress;
  for (std::size_t i = 0; i < impulses_.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    const double impulse = row.metres * impulses_[i];
    if (row.soft >= 0)
      equations->forces().add_soft(*equations, to_index(row.soft), impulse);
    else if (row.coupled >= 0)
      equations->forces().add_coupled(*equations, to_index(row.coupled), impulse);
    else
      equations->forces().add(*equations, row.joint, impulse * RowVector::Unit(row.index));
  }
  scatter_state(states);
  return progress;
}

// Number of steps in an interval, so that no rod and no body rotates by more than kMostAngle per
// step.
int InconsistentMotion::number_of_parts(double h) const {
  double rate = 0.0;
  for (const Vector3d& w : velocity_.angular) rate = std::max(rate, w.norm());
  for (const RegularizedRows::Row& row : rows_.rows()) {
    if (row.axis >= 0 || row.is_spring || row.is_general) continue;
    const EquationsOfMotion::Link& joint = equations_->links()[row.joint];
    const RegularizedRows::JointGeometry& g = at_end_[row.joint];
    Vector3d d_dot = velocity_.linear[joint.b] - velocity_.linear[joint.a] +
                     target_.fixed.linear[joint.b] - target_.fixed.linear[joint.a];
    if (joint.a < rotating_) d_dot -= velocity_.angular[joint.a].cross(g.arm[0]);
    if (joint.b < rotating_) d_dot += velocity_.angular[joint.b].cross(g.arm[1]);
    rate = std::max(rate, row.direction.cross(d_dot).norm() / std::max(g.d.norm(), 1e-9 * scale_));
  }
  const double parts = std::ceil(h * rate / kMostAngle);
  return parts < kMostMotionParts ? std::max(static_cast<int>(parts), 1)
                                  : static_cast<int>(kMostMotionParts);
}

void InconsistentMotion::step(double h, double energy_before, IntegrationResult* progress) {
  velocity_before_ = velocity_;
  drive_before_ = drive_rates_;
  double allowed = 0.0;
  for (const bool has_impulses : {true, false}) {
    velocity_ = velocity_before_;
    work_ = 0.0;
    std::fill(step_impulses_.begin(), step_impulses_.end(), 0.0);
    if (has_impulses) {
      if (!midpoint(h, progress)) continue;
    } else {
      ++progress->rejected;
      explicit_step(h, progress);
    }
    lambda_ = step_impulses_;
    fit_velocities();
    if (is_free_ && !has_impulses) restore_angular_momentum(h);
    work_ += work_of_drives();
    spring_energy_ = spring_energy();
    allowed = energy_before + work_ + work_of_loads() - spring_energy_;
    if (kinetic_energy(velocity_) <= allowed + most_added(h)) break;
  }
  allowed = hold_back(energy_before, allowed);
  cap_energy(allowed, progress);
  progress->projected -= damped_energy(h);
  for (std::size_t i = 0; i < impulses_.size(); ++i) impulses_[i] += step_impulses_[i];
}

// Halves the displacement until bodies at rest at its end would have no more energy than before,
// apart from lifted weights. Otherwise position corrections would stretch springs without bound
// near singular rows. The centre of a free island keeps moving. Returns the kinetic energy allowed
// at the end [J].
double InconsistentMotion::hold_back(double energy_before, double allowed) {
  Vector3d along = Vector3d::Zero();
  double kept = 0.0;  // kinetic energy of the centre
  if (is_free_) {
    along = as_one_body(end_, velocity_).centre - as_one_body(start_, velocity_).centre;
    BodyVectors centre, turning;
    find_rigid_motion(&centre, &turning);
    kept = kinetic_energy(centre);
  }
  for (int k = 0; k < kMostHalvings; ++k) {
    const double lifted = is_free_ ? 0.0 : std::max(0.0, -work_of_loads());
    const double rounding = kEpsilon * (std::abs(energy_before) + kept + spring_energy_);
    if (allowed + lifted >= kept - 16.0 * rounding) break;
    for (std::size_t i = 0; i < bodies_; ++i)
      end_.position[i] = 0.5 * (start_.position[i] + along + end_.position[i]);
    for (std::size_t i = 0; i < rotating_; ++i)
      end_.orientation[i] = halfway(start_.orientation[i], end_.orientation[i]);
    rows_.measure(end_, &at_end_);
    spring_energy_ = spring_energy();
    allowed = energy_before + work_ + work_of_loads() - spring_energy_;
  }
  return allowed;
}

// Energy that the impulses of a midpoint step may add before they are left out [J]: a share of the
// kinetic energy plus the energy that loads alone would give to bodies at rest. The work of
// inconsistent driven joints is known no better.
double InconsistentMotion::most_added(double h) const {
  double energy = kinetic_energy(velocity_);
  for (std::size_t i = 0; i < bodies_; ++i)
    energy += 0.5 * mass_[i] * (h * equations_->inputs().acceleration()[i]).squaredNorm();
  return (target_.is_driven ? kMostAddedDriven : kMostAdded) * energy;
}

// ---- step with impulses that lead to met rows

bool InconsistentMotion::midpoint(double h, IntegrationResult* progress) {
  std::fill(q_.begin(), q_.end(), 0.0);
  for (std::size_t i = 0; i < q_.size(); ++i)
    compliance_[i] =
        1.0 / std::max(0.25 * h * h * stiffness_[i] + 0.5 * h * damping_[i], least_given_[i]);
  drift(h);
  int found = 0;  // consecutive converged iterations
  double before = kInfinity;
  for (int k = 0; k < kMostMidpointSteps; ++k) {
    met_ = end_;
    at_met_ = at_end_;
    meet(&met_, &at_met_, progress);
    rows_.linearize(at_start_, at_end_, end_);
    rows_.find_weights(&weights_);
    const double worst = find_missing(h);
    const bool is_rounding = worst < kRounding * scale_ && worst > 0.5 * before;
    found = worst <= kMidpointFound * scale_ || is_rounding ? found + 1 : 0;
    if (found == 2) break;
    if (!std::isfinite(worst) || (k > 3 && worst > before && found == 0)) return false;
    before = worst;
    rows_.factor(kLeastShare, weights_, &compliance_);
    rows_.solve(&b_);
    for (std::size_t i = 0; i < q_.size(); ++i) q_[i] += b_[i];
    drift(h);
  }
  if (found < 2) return false;
  for (std::size_t i = 0; i < bodies_; ++i)
    velocity_.linear[i] = 2.0 / h * displacement_.linear[i] - velocity_before_.linear[i];
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Vector3d& w = displacement_.angular[i];
    const Vector3d rate = 2.0 / h * w - velocity_before_.angular[i];
    const Matrix3d mean =
        (Matrix3d::Identity() + 0.5 * cross_matrix(w) + 0.25 * w * w.transpose()) /
        (1.0 + 0.25 * w.squaredNorm());
    velocity_.angular[i] = rate + w.cross(mean * rate);
  }
  for (std::size_t i = 0; i < q_.size(); ++i) step_impulses_[i] = 2.0 / h * q_[i];
  std::swap(end_, met_);
  std::swap(at_end_, at_met_);
  return true;
}

// Writes to b_ the differences of rows between end_ and met_, and of springs from their law.
// Returns the largest difference [m].
double InconsistentMotion::find_missing(double h) {
  double worst = 0.0;
  const auto consider = [&](double error) { worst = larger(worst, std::abs(error)); };
  for (std::size_t i = 0; i < bodies_; ++i) change_.linear[i] = met_.position[i] - end_.position[i];
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Quaterniond turned = met_.orientation[i] * end_.orientation[i].conjugate();
    change_.angular[i] = std::copysign(2.0, turned.w()) * turned.vec();
  }
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    if (!row.is_spring) {
      b_[i] = rows_.apply(row, change_);
      consider(b_[i]);
      continue;
    }
    // Law −k (s₀ + ½Δs) − c Δs/h with stretch s, divided by its factor of Δs.
    const double start = extent(i, at_start_), end = extent(i, at_end_);
    const double length = target_.length[i] - 0.5 * h * target_.rate[i];
    const double stretch = 0.5 * (start + end) - length;
    const double rate = (end - start) / h - target_.rate[i];
    const double force = force_[i] - stiffness_[i] * stretch - damping_[i] * rate;
    b_[i] = compliance_[i] * (0.5 * h * h * force - q_[i]);
    consider(b_[i] * weights_[i] / (weights_[i] + compliance_[i]));
  }
  return worst;
}

// Computes end_ by the midpoint rule, with the impulses q_ along the linearized rows.
void InconsistentMotion::drift(double h) {
  rows_.apply_transpose(q_, &displacement_);
  for (std::size_t i = 0; i < bodies_; ++i) {
    displacement_.linear[i] =
        displacement_.linear[i] / mass_[i] +
        h * (velocity_before_.linear[i] + 0.5 * h * equations_->inputs().acceleration()[i]);
    end_.position[i] = start_.position[i] + displacement_.linear[i];
  }
  for (std::size_t i = 0; i < rotating_; ++i)
    turn(i, h, displacement_.angular[i] + 0.5 * h * h * equations_->inputs().torque()[i]);
  rows_.measure(end_, &at_end_);
}

// Solves r_w = 0 of implicit_step.h by Newton's method; `torque` is ½h² times the mean torque.
void InconsistentMotion::turn(std::size_t body, double h, const Vector3d& torque) {
  const Quaterniond& q = start_.orientation[body];
  const Matrix3d R = q.toRotationMatrix();
  const Matrix3d J = R * inertia_[body].asDiagonal() * R.transpose();
  const Vector3d a = 0.5 * h * velocity_before_.angular[body];
  const Vector3d g = J * a + torque;
  Vector3d w = 2.0 * a;
  for (int k = 0; k < kMostFitIterations; ++k) {
    const Vector3d u = J * (w - a);
    const Vector3d residual = u + 0.5 * w.cross(u) - g + 0.5 * w.cross(g);
    const Matrix3d slope = (Matrix3d::Identity() + 0.5 * cross_matrix(w)) * J -
                           0.5 * cross_matrix(u) - 0.5 * cross_matrix(g);
    const Vector3d change = slope.partialPivLu().solve(residual);
    w -= change;
    if (!(change.norm() > 4.0 * kEpsilon * w.norm())) break;
  }
  displacement_.angular[body] = w;
  const Vector3d half = 0.5 * w;
  end_.orientation[body] = (Quaterniond(1.0, half.x(), half.y(), half.z()) * q).normalized();
}

// ---- step without impulses that lead to met rows

// Computes v⁺ by Euler's method, implicit in springs, so that v⁺ meets the rates; then x⁺ = x + h
// v⁺ and meet().
void InconsistentMotion::explicit_step(double h, IntegrationResult* progress) {
  rows_.linearize(at_start_, at_start_, start_);
  rows_.find_weights(&weights_);
  for (std::size_t i = 0; i < bodies_; ++i)
    displacement_.linear[i] =
        h * (velocity_before_.linear[i] + h * equations_->inputs().acceleration()[i]);
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Quaterniond& q = start_.orientation[i];
    const Vector3d response =
        q * (q.conjugate() * equations_->inputs().torque()[i]).cwiseQuotient(inertia_[i]);
    displacement_.angular[i] = h * (velocity_before_.angular[i] + h * response);
  }
  std::fill(displacement_.linear.begin() + static_cast<std::ptrdiff_t>(bodies_),
            displacement_.linear.end(), Vector3d::Zero());
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    const double moved = rows_.apply(row, displacement_);
    q_[i] = h * drive_before_[i] - moved;
    if (!row.is_spring) continue;
    const double given = h * (h * stiffness_[i] + damping_[i]);
    const double stretch = extent(i, at_start_) - target_.length[i];
    const double ahead = rows_.apply(row, target_.fixed) - target_.rate[i];
    compliance_[i] = 1.0 / std::max(given, least_given_[i]);
    q_[i] = compliance_[i] * h * h * (force_[i] - stiffness_[i] * stretch - damping_[i] * ahead) -
            moved;
  }
  rows_.factor(kLeastShare, weights_, &compliance_);
  rows_.solve(&q_);
  rows_.add_response(q_, &displacement_);

  for (std::size_t i = 0; i < q_.size(); ++i) step_impulses_[i] = q_[i] / h;
  for (std::size_t i = 0; i < bodies_; ++i) {
    velocity_.linear[i] = displacement_.linear[i] / h;
    end_.position[i] = start_.position[i] + displacement_.linear[i];
  }
  List<Vector3d> momentum(rotating_);
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Quaterniond& q = start_.orientation[i];
    momentum[i] = apply_inertia(inertia_[i], q, displacement_.angular[i] / h);
    end_.orientation[i] = (rotation(displacement_.angular[i]) * q).normalized();
  }
  rows_.measure(end_, &at_end_);
  meet(&end_, &at_end_, progress);
  stop_against_correction();
  for (std::size_t i = 0; i < rotating_; ++i)
    velocity_.angular[i] =
        apply_inertia(inertia_[i].cwiseInverse(), end_.orientation[i], momentum[i]);
}

// Removes the velocity against the position correction, since that motion would undo the
// correction.
void InconsistentMotion::stop_against_correction() {
  double against = 0.0, square = 0.0;
  for (std::size_t i = 0; i < bodies_; ++i) {
    change_.linear[i] = end_.position[i] - start_.position[i] - displacement_.linear[i];
    against += mass_[i] * change_.linear[i].dot(velocity_.linear[i]);
    square += mass_[i] * change_.linear[i].squaredNorm();
  }
  if (!(against < 0.0)) return;
  for (std::size_t i = 0; i < bodies_; ++i)
    velocity_.linear[i] -= against / square * change_.linear[i];
}

}  // namespace constraint_sim::engine
