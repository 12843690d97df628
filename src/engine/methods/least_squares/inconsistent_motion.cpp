#include "engine/methods/least_squares/inconsistent_motion.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/math/cross_matrix.h"
#include "engine/math/larger.h"
#include "engine/math/numbers.h"
#include "engine/methods/least_squares/shares.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kMostAngle = 0.1;             // [rad] rotation of a joint in one step
constexpr double kMostMotionParts = 32.0;      // parts of a step
constexpr int kMostMidpointSteps = 16;         // iterations of the midpoint rule
constexpr int kMostFitIterations = 60;         // iterations of Newton's method for a rotation
constexpr int kMostDisplacementHalvings = 50;  // halvings of a displacement, until nothing is left
constexpr double kMidpointFound = 1e-14;       // share of the scene's size
// Share of energy that the impulses of a midpoint step may add before they are left out: without
// and with driven joints, of which the work is known no better.
constexpr double kMostAdded = 1e-3;
constexpr double kMostAddedDriven = 0.5;

// Orientation halfway along the shorter rotation from a to b.
Quaterniond halfway(const Quaterniond& a, const Quaterniond& b) {
  const double side = a.dot(b) < 0.0 ? -1.0 : 1.0;
  return Quaterniond(a.coeffs() + side * b.coeffs()).normalized();
}

// Solves r_w = 0 of ImplicitStep for w by Newton's method, with the midpoint rule: a = ½h ω₀,
// `torque` is ½h² times the mean torque.
Vector3d turn(const Matrix3d& J, const Vector3d& a, const Vector3d& torque) {
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
  return w;
}

// Adds the impulses of all rows to `equations`.
void add_impulses(const RegularizedRows& rows, const List<double>& impulses,
                  EquationsOfMotion* equations) {
  for (std::size_t i = 0; i < impulses.size(); ++i) {
    const RegularizedRows::Row& row = rows.rows()[i];
    const double impulse = row.metres * impulses[i];
    if (row.soft >= 0)
      equations->forces().add_soft(*equations, to_index(row.soft), impulse);
    else if (row.coupled >= 0)
      equations->forces().add_coupled(*equations, to_index(row.coupled), impulse);
    else
      equations->forces().add(*equations, row.joint, impulse * RowVector::Unit(row.index));
  }
}

void add(const List<double>& list, List<double>* sums) {
  for (std::size_t i = 0; i < list.size(); ++i) (*sums)[i] += list[i];
}

}  // namespace

InconsistentMotion::InconsistentMotion(const InconsistentMotion& other) = default;
InconsistentMotion::InconsistentMotion(InconsistentMotion&& other) noexcept = default;
InconsistentMotion& InconsistentMotion::operator=(const InconsistentMotion& other) = default;
InconsistentMotion& InconsistentMotion::operator=(InconsistentMotion&& other) noexcept = default;
InconsistentMotion::~InconsistentMotion() = default;

InconsistentMotion::InconsistentMotion(const EquationsOfMotion& equations)
    : bodies_(equations),
      rows_(equations),
      targets_(rows_, bodies_.zeros()),
      springs_(equations, rows_),
      pose_fit_(rows_.rows().size(), bodies_.zeros()),
      rate_fit_(rows_.rows().size(), bodies_.zeros()) {
  start_ = end_ = met_ = bodies_.configuration();
  velocity_ = velocity_before_ = displacement_ = change_ = bodies_.zeros();
  for (Numbers* list :
       {&values_, &b_, &lambda_, &compliance_, &step_impulses_, &impulses_, &q_, &drive_before_})
    list->assign(rows_.rows().size(), 0.0);
}

// ---- an interval

IntegrationResult InconsistentMotion::advance(const Interval& interval, const IntegratorOptions&,
                                              EquationsOfMotion* equations,
                                              List<BodyState>* states) {
  IntegrationResult progress;
  equations->begin(interval.t, *states, interval.gravity, interval.loads, interval.prescribed,
                   interval.since_tick);
  equations->add_custom_loads(interval.t, *states);
  bodies_.gather_state(*states, &end_, &velocity_);
  targets_.set(interval.t, rows_, equations, &end_);
  rows_.measure(end_, &at_end_);
  std::fill(impulses_.begin(), impulses_.end(), 0.0);
  spring_energy_ = springs_.energy(rows_, targets_, at_end_);
  const double before = kinetic_energy();
  work_ = rate_fit_.fit(targets_, end_, at_end_, &rows_, &velocity_, &impulses_);
  progress.projected = before + work_ - kinetic_energy();

  const int parts = number_of_parts(*equations, interval.h);
  const double h = interval.h / parts;
  for (int k = 0; k < parts; ++k) {
    const double energy = kinetic_energy() + spring_energy_;
    start_ = end_;  // end_ stays valid: the scale depends on positions of bodies
    at_start_ = at_end_;
    targets_.set(interval.t + (k + 1) * h, rows_, equations, &end_);
    step(*equations, h, energy, &progress);
    ++progress.substeps;
    equations->coordinates().add_turns(
        *equations, equations->inputs(), interval.t + (k + 1) * h, h,
        [&](std::size_t body) { return displacement_.angular[body]; },
        [&](std::size_t l, std::size_t end) { return at_start_[l].axes[end].col(2); });
    targets_.write_positions(rows_, at_end_, equations);
  }
  progress.projected = std::max(progress.projected, 0.0);
  const double error = targets_.errors(rows_, at_end_, rate_fit_.weights(), &values_);
  can_be_met_ =
      rate_fit_.can_be_met(targets_, values_, bodies_.largest_speed(velocity_), velocity_, &rows_);
  progress.done = std::isfinite(kinetic_energy()) && std::isfinite(error);
  if (!progress.done) return progress;
  add_impulses(rows_, impulses_, equations);
  bodies_.scatter_state(end_, velocity_, states);
  return progress;
}

// Number of steps in an interval, so that no rod and no body rotates by more than kMostAngle per
// step.
int InconsistentMotion::number_of_parts(const EquationsOfMotion& equations, double h) const {
  double rate = 0.0;
  for (const Vector3d& w : velocity_.angular) rate = std::max(rate, w.norm());
  for (const RegularizedRows::Row& row : rows_.rows()) {
    if (row.axis >= 0 || row.is_spring || row.is_general) continue;
    const EquationsOfMotion::Link& joint = equations.links()[row.joint];
    const RegularizedRows::JointGeometry& g = at_end_[row.joint];
    Vector3d d_dot = velocity_.linear[joint.b] - velocity_.linear[joint.a] +
                     targets_.fixed().linear[joint.b] - targets_.fixed().linear[joint.a];
    if (joint.a < bodies_.rotating()) d_dot -= velocity_.angular[joint.a].cross(g.arm[0]);
    if (joint.b < bodies_.rotating()) d_dot += velocity_.angular[joint.b].cross(g.arm[1]);
    rate = std::max(rate, row.direction.cross(d_dot).norm() /
                              std::max(g.d.norm(), kCoincidentPoints * targets_.scale()));
  }
  const double parts = std::ceil(h * rate / kMostAngle);
  return parts < kMostMotionParts ? std::max(static_cast<int>(parts), 1)
                                  : static_cast<int>(kMostMotionParts);
}

void InconsistentMotion::step(const EquationsOfMotion& equations, double h, double energy_before,
                              IntegrationResult* progress) {
  velocity_before_ = velocity_;
  drive_before_ = rate_fit_.drive_rates();
  double allowed = 0.0;
  for (const bool has_impulses : {true, false}) {
    velocity_ = velocity_before_;
    std::fill(step_impulses_.begin(), step_impulses_.end(), 0.0);
    if (has_impulses) {
      if (!midpoint(equations, h, progress)) continue;
    } else {
      ++progress->rejected;
      explicit_step(equations, h, progress);
    }
    lambda_ = step_impulses_;
    work_ = rate_fit_.fit(targets_, end_, at_end_, &rows_, &velocity_, &step_impulses_);
    if (bodies_.are_free() && !has_impulses) restore_angular_momentum(equations, h);
    work_ += work_of_drives();
    spring_energy_ = springs_.energy(rows_, targets_, at_end_);
    allowed = allowed_energy(equations, energy_before);
    if (kinetic_energy() <= allowed + most_added(equations, h)) break;
  }
  cap_energy(hold_back(equations, energy_before, allowed), progress);
  progress->projected -= springs_.damped_energy(rows_, targets_, h, at_start_, at_end_);
  add(step_impulses_, &impulses_);
}

// ---- step by the midpoint rule

bool InconsistentMotion::midpoint(const EquationsOfMotion& equations, double h,
                                  IntegrationResult* progress) {
  std::fill(q_.begin(), q_.end(), 0.0);
  for (std::size_t i = 0; i < q_.size(); ++i)
    compliance_[i] = springs_.compliance(
        i, 0.25 * h * h * springs_.stiffness(i) + 0.5 * h * springs_.damping(i));
  drift(equations, h);
  int found = 0;  // consecutive converged iterations
  double before = kInfinity;
  for (int k = 0; k < kMostMidpointSteps; ++k) {
    met_ = end_;
    at_met_ = at_end_;
    progress->iterations += pose_fit_.fit(bodies_, targets_, compliance_, &rows_, &met_, &at_met_);
    rows_.linearize(at_start_, at_end_, end_);
    rows_.find_weights(&weights_);
    const double worst = find_missing(h);
    const bool is_rounding = worst < kChangeRounding * targets_.scale() && worst > 0.5 * before;
    found = worst <= kMidpointFound * targets_.scale() || is_rounding ? found + 1 : 0;
    if (found == 2) break;
    if (!std::isfinite(worst) || (k > 3 && worst > before && found == 0)) return false;
    before = worst;
    rows_.factor(kLeastShare, weights_, &compliance_);
    rows_.solve(&b_);
    add(b_, &q_);
    drift(equations, h);
  }
  if (found < 2) return false;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    velocity_.linear[i] = 2.0 / h * displacement_.linear[i] - velocity_before_.linear[i];
  for (std::size_t i = 0; i < bodies_.rotating(); ++i) {
    const Vector3d& w = displacement_.angular[i];
    const Vector3d rate = 2.0 / h * w - velocity_before_.angular[i];
    velocity_.angular[i] = rate + w.cross(mean_rotation(w) * rate);
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
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    change_.linear[i] = met_.position[i] - end_.position[i];
  for (std::size_t i = 0; i < bodies_.rotating(); ++i) {
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
    const double start = targets_.extent(rows_, i, at_start_);
    const double end = targets_.extent(rows_, i, at_end_);
    const double length = targets_.length(i) - 0.5 * h * targets_.rate(i);
    const double stretch = 0.5 * (start + end) - length;
    const double rate = (end - start) / h - targets_.rate(i);
    b_[i] = compliance_[i] * (0.5 * h * h * springs_.force(i, stretch, rate) - q_[i]);
    consider(b_[i] * weights_[i] / (weights_[i] + compliance_[i]));
  }
  return worst;
}

// Computes end_ by the midpoint rule, with the impulses q_ along the linearized rows.
void InconsistentMotion::drift(const EquationsOfMotion& equations, double h) {
  rows_.apply_transpose(q_, &displacement_);
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    displacement_.linear[i] =
        displacement_.linear[i] / bodies_.mass(i) +
        h * (velocity_before_.linear[i] + 0.5 * h * equations.inputs().acceleration()[i]);
    end_.position[i] = start_.position[i] + displacement_.linear[i];
  }
  for (std::size_t i = 0; i < bodies_.rotating(); ++i) {
    const Quaterniond& q = start_.orientation[i];
    const Matrix3d R = q.toRotationMatrix();
    const Matrix3d J = R * bodies_.inertia(i).asDiagonal() * R.transpose();
    const Vector3d w =
        turn(J, 0.5 * h * velocity_before_.angular[i],
             displacement_.angular[i] + 0.5 * h * h * equations.inputs().torque()[i]);
    displacement_.angular[i] = w;
    const Vector3d half = 0.5 * w;
    end_.orientation[i] = (Quaterniond(1.0, half.x(), half.y(), half.z()) * q).normalized();
  }
  rows_.measure(end_, &at_end_);
}

// ---- step without impulses that lead to met rows

// Computes v⁺ by Euler's method, implicit in springs, so that v⁺ meets the rates; then x⁺ = x + h
// v⁺ and the positions of least error from there.
void InconsistentMotion::explicit_step(const EquationsOfMotion& equations, double h,
                                       IntegrationResult* progress) {
  rows_.linearize(at_start_, at_start_, start_);
  rows_.find_weights(&weights_);
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    displacement_.linear[i] =
        h * (velocity_before_.linear[i] + h * equations.inputs().acceleration()[i]);
  for (std::size_t i = 0; i < bodies_.rotating(); ++i) {
    const Quaterniond& q = start_.orientation[i];
    const Vector3d response =
        q * (q.conjugate() * equations.inputs().torque()[i]).cwiseQuotient(bodies_.inertia(i));
    displacement_.angular[i] = h * (velocity_before_.angular[i] + h * response);
  }
  std::fill(displacement_.linear.begin() + static_cast<std::ptrdiff_t>(bodies_.size()),
            displacement_.linear.end(), Vector3d::Zero());
  find_explicit_impulses(h);
  rows_.add_response(q_, &displacement_);

  for (std::size_t i = 0; i < q_.size(); ++i) step_impulses_[i] = q_[i] / h;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    velocity_.linear[i] = displacement_.linear[i] / h;
    end_.position[i] = start_.position[i] + displacement_.linear[i];
  }
  List<Vector3d> momentum(bodies_.rotating());
  for (std::size_t i = 0; i < bodies_.rotating(); ++i) {
    const Quaterniond& q = start_.orientation[i];
    momentum[i] = apply_inertia(bodies_.inertia(i), q, displacement_.angular[i] / h);
    end_.orientation[i] = (rotation(displacement_.angular[i]) * q).normalized();
  }
  rows_.measure(end_, &at_end_);
  progress->iterations += pose_fit_.fit(bodies_, targets_, compliance_, &rows_, &end_, &at_end_);
  stop_against_correction();
  for (std::size_t i = 0; i < bodies_.rotating(); ++i)
    velocity_.angular[i] =
        apply_inertia(bodies_.inertia(i).cwiseInverse(), end_.orientation[i], momentum[i]);
}

// Computes in q_ h times the impulses that change displacement_, h times the velocity under loads,
// to h times a velocity that meets the rates.
void InconsistentMotion::find_explicit_impulses(double h) {
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const RegularizedRows::Row& row = rows_.rows()[i];
    const double moved = rows_.apply(row, displacement_);
    q_[i] = h * drive_before_[i] - moved;
    if (!row.is_spring) continue;
    const double stretch = targets_.extent(rows_, i, at_start_) - targets_.length(i);
    const double ahead = rows_.apply(row, targets_.fixed()) - targets_.rate(i);
    compliance_[i] = springs_.compliance(i, h * (h * springs_.stiffness(i) + springs_.damping(i)));
    q_[i] = compliance_[i] * h * h * springs_.force(i, stretch, ahead) - moved;
  }
  rows_.factor(kLeastShare, weights_, &compliance_);
  rows_.solve(&q_);
}

// Removes the velocity against the position correction, since that motion would undo the
// correction.
void InconsistentMotion::stop_against_correction() {
  double against = 0.0, square = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    change_.linear[i] = end_.position[i] - start_.position[i] - displacement_.linear[i];
    against += bodies_.mass(i) * change_.linear[i].dot(velocity_.linear[i]);
    square += bodies_.mass(i) * change_.linear[i].squaredNorm();
  }
  if (!(against < 0.0)) return;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    velocity_.linear[i] -= against / square * change_.linear[i];
}

// Restores the angular momentum of a free island after an explicit step, whose position corrections
// change it.
void InconsistentMotion::restore_angular_momentum(const EquationsOfMotion& equations, double h) {
  const RigidMotion before = bodies_.as_one_body(start_, velocity_before_);
  const RigidMotion now = bodies_.as_one_body(end_, velocity_);
  Vector3d missing = before.momentum - now.momentum;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const Vector3d arm = 0.5 * (start_.position[i] - before.centre + end_.position[i] - now.centre);
    missing += h * bodies_.mass(i) * arm.cross(equations.inputs().acceleration()[i]);
  }
  for (std::size_t i = 0; i < bodies_.rotating(); ++i)
    missing += h * equations.inputs().torque()[i];
  const Vector3d w = now.inverse_inertia * missing;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    velocity_.linear[i] += w.cross(end_.position[i] - now.centre);
  for (Vector3d& spin : velocity_.angular) spin += w;
}

// ---- energy at the end of a step

// Kinetic energy that conserves energy [J].
double InconsistentMotion::allowed_energy(const EquationsOfMotion& equations,
                                          double energy_before) const {
  return energy_before + work_ + bodies_.work_of_loads(equations, start_, end_) - spring_energy_;
}

// Energy that the impulses of a midpoint step may add before they are left out [J]: a share of the
// kinetic energy plus the energy that loads alone would give to bodies at rest. The work of
// inconsistent driven joints is known no better.
double InconsistentMotion::most_added(const EquationsOfMotion& equations, double h) const {
  double energy = kinetic_energy();
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    energy += 0.5 * bodies_.mass(i) * (h * equations.inputs().acceleration()[i]).squaredNorm();
  return (targets_.is_driven() ? kMostAddedDriven : kMostAdded) * energy;
}

// Work along the target rates by the impulses that moved the bodies [J].
double InconsistentMotion::work_of_drives() const {
  if (!targets_.is_driven()) return 0.0;
  double sum = 0.0;
  for (std::size_t i = 0; i < lambda_.size(); ++i) {
    const double rate = rows_.rows()[i].is_spring
                            ? targets_.rate_of_bodies(rows_, i)
                            : 0.5 * (drive_before_[i] + rate_fit_.drive_rates()[i]);
    sum += lambda_[i] * rate;
  }
  return sum;
}

// Shortens the displacement of the step, by halves, until the bodies, stopped at its end, would
// have no more energy than before the step, lifted weights aside. Without this limit, position
// corrections near singular rows would stretch springs without bound. The centre of a free island
// keeps moving. Returns the kinetic energy that the bodies may have at the end [J].
double InconsistentMotion::hold_back(const EquationsOfMotion& equations, double energy_before,
                                     double allowed) {
  const bool is_free = bodies_.are_free();
  Vector3d along = Vector3d::Zero();
  double kept = 0.0;  // kinetic energy of the centre
  if (is_free) {
    along =
        bodies_.as_one_body(end_, velocity_).centre - bodies_.as_one_body(start_, velocity_).centre;
    BodyVectors centre, turning;
    bodies_.find_rigid_motion(end_, velocity_, &centre, &turning);
    kept = bodies_.kinetic_energy(end_, centre);
  }
  for (int k = 0; k < kMostDisplacementHalvings; ++k) {
    const double lifted =
        is_free ? 0.0 : std::max(0.0, -bodies_.work_of_loads(equations, start_, end_));
    const double rounding = kEpsilon * (std::abs(energy_before) + kept + spring_energy_);
    if (allowed + lifted >= kept - 16.0 * rounding) break;
    for (std::size_t i = 0; i < bodies_.size(); ++i)
      end_.position[i] = 0.5 * (start_.position[i] + along + end_.position[i]);
    for (std::size_t i = 0; i < bodies_.rotating(); ++i)
      end_.orientation[i] = halfway(start_.orientation[i], end_.orientation[i]);
    rows_.measure(end_, &at_end_);
    spring_energy_ = springs_.energy(rows_, targets_, at_end_);
    allowed = allowed_energy(equations, energy_before);
  }
  return allowed;
}

// Removes kinetic energy beyond `allowed` [J] from velocity_: first from the motion within the
// island, then from the rotation of a free island without drives, never from the motion of its
// centre. These parts and the driven velocity are orthogonal in kinetic energy.
void InconsistentMotion::cap_energy(double allowed, IntegrationResult* progress) {
  double excess = kinetic_energy() - allowed;
  if (excess > 0.0) {
    BodyVectors rest = velocity_;
    BodyVectors centre, turning;
    const auto lower = [&](const BodyVectors& part) {
      const double energy = bodies_.kinetic_energy(end_, part);
      if (!(energy > 0.0) || !(excess > 0.0)) return;
      bodies_.add(std::sqrt(std::max(0.0, 1.0 - excess / energy)) - 1.0, part, &velocity_);
      excess -= std::min(excess, energy);
    };
    bodies_.add(-1.0, rate_fit_.drive(), &rest);
    if (bodies_.are_free()) {
      bodies_.find_rigid_motion(end_, velocity_, &centre, &turning);
      bodies_.add(-1.0, centre, &rest);
      bodies_.add(-1.0, turning, &rest);
    }
    lower(rest);
    if (bodies_.are_free() && !targets_.is_driven()) lower(turning);
    excess = kinetic_energy() - allowed;
  }
  if (excess > 0.0)
    progress->corrected += excess;
  else
    progress->projected -= excess;
}

}  // namespace constraint_sim::engine
