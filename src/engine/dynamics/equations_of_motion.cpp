#include "engine/dynamics/equations_of_motion.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "engine/math/embedded_pairs.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

// Copies a few numbers without the function call of std::copy.
void copy(const double* from, std::size_t n, double* to) {
  const auto size = static_cast<Eigen::Index>(n);
  Eigen::VectorXd::Map(to, size) = Eigen::VectorXd::Map(from, size);
}

}  // namespace

// ---- one evaluation

EquationsOfMotion::EquationsOfMotion(const EquationsOfMotion& other) = default;
EquationsOfMotion::EquationsOfMotion(EquationsOfMotion&& other) noexcept = default;
EquationsOfMotion& EquationsOfMotion::operator=(const EquationsOfMotion& other) = default;
EquationsOfMotion& EquationsOfMotion::operator=(EquationsOfMotion&& other) noexcept = default;
EquationsOfMotion::~EquationsOfMotion() = default;

// Updates everything that depends on time but not on the state.
void EquationsOfMotion::move_with_time(double t) {
  inputs_.update(*this, t);
  if (inputs_.fixed_points_move()) inputs_.place_fixed_points(*this, t, &position_, &velocity_);
}

void EquationsOfMotion::update_kinematics(double t, const double* y) {
  placed_at_ = t;
  update_bodies(y);
  if (inputs_.fixed_points_move()) inputs_.place_fixed_points(*this, t, &position_, &velocity_);
  update_separations();
  if (rotating_ > 0) update_arms();
  if (first_.general < first_.spring) update_general();
}

void EquationsOfMotion::update_bodies(const double* y) {
  copy(y, 3 * bodies_.size(), position_.front().data());
  const double* q = y + layout().q_at;
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Matrix3d R = rotation_matrix(q + 4 * i);
    orientation_[i] = R;
    inverse_inertia_[i].noalias() = R * inertia_[i].cwiseInverse().asDiagonal() * R.transpose();
  }
}

// Sets d of rods and other links from centre to centre; update_arms() adds the arms of rotating
// bodies.
void EquationsOfMotion::update_separations() {
  for (std::size_t l = 0; l < first_.ball; ++l)
    direction_[l] = position_[links_[l].b] - position_[links_[l].a];
  for (std::size_t l = first_.ball; l < links_.size(); ++l)
    d_[l] = position_[links_[l].b] - position_[links_[l].a];
}

void EquationsOfMotion::update_arms() {
  const auto place_arm = [&](std::size_t l, const Vector3d& anchor_b) {
    const Link& link = links_[l];
    Vector3d& d = is_rod(l) ? direction_[l] : d_[l];
    if (rotates(link.a)) d -= arm_a_[l] = orientation_[link.a] * link.anchor_a;
    if (rotates(link.b)) d += arm_b_[l] = orientation_[link.b] * anchor_b;
  };
  for (std::size_t l = first_.general; l < first_.spring; ++l) place_arm(l, inputs_.frame_b(l).anchor);
  for (std::size_t l = first_.spring; l < links_.size(); ++l) place_arm(l, links_[l].anchor_b);
  for (std::size_t l = first_.armed; l < first_.general; ++l) {
    if (!links_[l].has_arms) continue;
    place_arm(l, links_[l].anchor_b);
    const std::size_t begin = is_rod(l) ? l : first_row(l);
    const std::size_t end = is_rod(l) ? l + 1 : begin + 3;
    for (std::size_t i = begin; i < end; ++i) {
      const Row& row = rows_[i];
      if (row.block_a >= 0) J_angular_[row.block_a] = direction_[i].cross(arm_a_[l]);
      if (row.block_b >= 0) J_angular_[row.block_b] = arm_b_[l].cross(direction_[i]);
    }
  }
  for (std::size_t p = 0; p < angular_blocks_.size(); ++p)
    M_inv_Jt_[p].noalias() = inverse_inertia_[angular_blocks_[p].body] * J_angular_[p];
}

// Computes the Delassus matrix A = G M⁻¹ Gᵀ at the current pose.
void EquationsOfMotion::find_matrix() {
  List<double>& A = ldlt_.values();
  std::fill(A.begin(), A.end(), 0.0);
  for (const LinearCoupling& c : linear_couplings_)
    A[c.slot] += c.inverse_mass * direction_[c.i].dot(direction_[c.j]);
  for (const AngularCoupling& c : angular_couplings_)
    A[c.slot] += J_angular_[c.p].dot(M_inv_Jt_[c.q]);
}

void EquationsOfMotion::factor(double least) {
  if (rows_.empty()) return;
  find_matrix();
  left_out_ = ldlt_.factor(least);
  if (left_out_ > 0 && has_chosen_) verify_left_out(least);
  factors_are_there_ = true;
}

void EquationsOfMotion::set_velocities(const double* y) {
  copy(y + layout().v_at, 3 * bodies_.size(), velocity_.front().data());
  const double* L = y + layout().L_at;
  for (std::size_t i = 0; i < rotating_; ++i) {
    const ConstVector momentum(L + 3 * i);
    angular_velocity_[i].noalias() = inverse_inertia_[i] * momentum;
    angular_acceleration_[i] =
        momentum.cross(angular_velocity_[i]);  // without torque; I⁻¹ follows in accelerate()
  }
  if (!motions_.empty()) move_general();
}

Vector3d EquationsOfMotion::d_dot(std::size_t l) const {
  const Link& link = links_[l];
  Vector3d rate = velocity_[link.b] - velocity_[link.a];
  if (!link.has_arms) return rate;
  if (rotates(link.a)) rate -= angular_velocity_[link.a].cross(arm_a_[l]);
  if (rotates(link.b)) rate += angular_velocity_[link.b].cross(arm_b_[l]);
  return rate;
}

Vector3d EquationsOfMotion::gamma_d(std::size_t l) const {
  const Link& link = links_[l];
  Vector3d gamma = Vector3d::Zero();
  if (rotates(link.a))
    gamma -= angular_velocity_[link.a].cross(angular_velocity_[link.a].cross(arm_a_[l]));
  if (rotates(link.b))
    gamma += angular_velocity_[link.b].cross(angular_velocity_[link.b].cross(arm_b_[l]));
  return gamma;
}

// Adds the forces of springs to loads, in acceleration_ and torque_.
void EquationsOfMotion::pull_springs(double* forces) {
  std::copy(inputs_.acceleration().begin(), inputs_.acceleration().end(), acceleration_.begin());
  for (std::size_t l = first_.spring; l < links_.size(); ++l) {
    const Link& link = links_[l];
    const double distance = d_[l].norm();
    const Vector3d n = distance > 0.0 ? Vector3d(d_[l] / distance) : Vector3d(Vector3d::UnitX());
    const double stretch = distance - inputs_.length()[l].value;
    const double rate = n.dot(d_dot(l)) - inputs_.length()[l].rate;
    const double force = -link.stiffness * stretch - link.damping * rate;
    forces[rows_.size() + l - first_.spring] = force;
    const Vector3d f = force * n;
    acceleration_[link.a] -= inverse_mass_[link.a] * f;
    acceleration_[link.b] += inverse_mass_[link.b] * f;
    if (rotates(link.a)) torque_[link.a] -= arm_a_[l].cross(f);
    if (rotates(link.b)) torque_[link.b] += arm_b_[l].cross(f);
  }
}

// Adds the forces along soft coordinates to loads, in acceleration_ and torque_.
void EquationsOfMotion::pull_softs(double* forces) {
  if (first_.spring == links_.size())
    std::copy(inputs_.acceleration().begin(), inputs_.acceleration().end(), acceleration_.begin());
  for (std::size_t s = 0; s < softs_.size(); ++s) {
    const SoftCoordinate& soft = softs_[s];
    const Link& link = links_[soft.link];
    const JointVectors& vectors = vectors_[soft.link - first_.general];
    const double rate = rate_of(soft.link, soft.form);
    const double force = forces[soft_force(s)] = soft.law.force(reading_of(soft, rate), rate);
    const Jacobian J = jacobian(soft.form, vectors);
    acceleration_[link.a] += inverse_mass_[link.a] * force * J.j1;
    acceleration_[link.b] += inverse_mass_[link.b] * force * J.j3;
    if (rotates(link.a)) torque_[link.a] += force * J.j2;
    if (rotates(link.b)) torque_[link.b] += force * J.j4;
  }
}

// Notes positions and rates of coordinates, from which angles are unwrapped.
void EquationsOfMotion::note_positions() {
  for (SoftCoordinate& soft : softs_) {
    const double rate = rate_of(soft.link, soft.form);
    soft.position = reading_of(soft, rate);
    soft.rate = rate;
  }
  for (CoupledRow& coupled : coupled_) {
    for (CoupledRow::Term& term : coupled.terms) {
      const double rate = rate_of(term.link, term.form);
      term.position = reading_of(term, rate);
      term.rate = rate;
    }
  }
  const auto spin = [this](std::size_t point) -> Vector3d {
    if (rotates(point)) return angular_velocity_[point];
    return point < bodies_.size() ? Vector3d(Vector3d::Zero()) : inputs_.fixed_angular_velocity(point);
  };
  angles_.integrate(placed_at_, spin, [this](const TurnedAngles::Angle& angle) {
    const JointVectors& vectors = vectors_[angle.joint - first_.general];
    return (angle.is_about_b ? vectors.axes_B : vectors.axes_A).col(2);
  });
}

// Computes the right-hand side C̈_target − γ − G a_free.
void EquationsOfMotion::find_right_hand_side(const Vector3d* free, double* b) const {
  for (std::size_t l = 0; l < first_.armed; ++l) {
    const Row& row = rows_[l];
    const Vector3d d_dot = velocity_[row.b] - velocity_[row.a];
    b[row.unknown] = -d_dot.squaredNorm() - direction_[l].dot(free[row.b] - free[row.a]);
  }
  for (std::size_t l = first_.armed; l < first_.ball; ++l) {
    const Row& row = rows_[l];
    const Vector3d a = free[row.b] - free[row.a] + gamma_d(l);
    b[row.unknown] = -d_dot(l).squaredNorm() - direction_[l].dot(a);
  }
  for (std::size_t l = first_.ball; l < first_.general; ++l) {
    const Link& link = links_[l];
    Vector3d a = free[link.b] - free[link.a];
    if (link.has_arms) a += gamma_d(l);
    for (std::size_t k = 0; k < 3; ++k)
      b[rows_[first_row(l) + k].unknown] = -a[static_cast<Eigen::Index>(k)];
  }
  for (const GeneralRow& row : general_rows_) {
    const Row& of = rows_[row.row];
    const std::size_t g = row.link - first_.general;
    b[of.unknown] = -gamma(row.form, vectors_[g], motions_[g]) -
                    direction_[row.row].dot(free[of.b] - free[of.a]);
  }
  if (!coupled_.empty()) add_coupled_right_hand_side(free, b);
  for (std::size_t p = 0; p < angular_blocks_.size(); ++p)
    b[angular_blocks_[p].unknown] -=
        J_angular_[p].dot(angular_acceleration_[angular_blocks_[p].body]);
  if (inputs_.motions().empty()) return;
  for (std::size_t i = 0; i < rows_.size(); ++i) b[rows_[i].unknown] += inputs_.acceleration_target()[i];
}

void EquationsOfMotion::accelerate(std::size_t stage, const double* y, double* dydt) {
  double* const lambda = stage_forces_.data() + stage * impulses_.size();
  std::copy(inputs_.torque().begin(), inputs_.torque().end(), torque_.begin());
  const Vector3d* free = inputs_.acceleration().data();  // accelerations of bodies without the rows
  if (first_.spring < links_.size()) {
    pull_springs(lambda);
    free = acceleration_.data();
  }
  if (!softs_.empty()) {
    pull_softs(lambda);
    free = acceleration_.data();
  }
  if (has_custom_forces_) {
    pull_custom();
    free = acceleration_.data();
  }
  for (std::size_t i = 0; i < rotating_; ++i)
    angular_acceleration_[i] = inverse_inertia_[i] * (torque_[i] + angular_acceleration_[i]);
  find_right_hand_side(free, lambda);
  solve(lambda);
  apply_jacobian_transpose(lambda);
  multipliers_to_forces(lambda);

  const std::size_t bodies = bodies_.size();
  copy(y + layout().v_at, 3 * bodies, dydt);
  for (std::size_t i = 0; i < bodies; ++i)
    Vector(dydt + layout().v_at + 3 * i) = free[i] + inverse_mass_[i] * constraint_force_[i];
  const double* q = y + layout().q_at;
  for (std::size_t i = 0; i < rotating_; ++i) {
    write_quaternion_rate(angular_velocity_[i], q + 4 * i, dydt + layout().q_at + 4 * i);
    Vector(dydt + layout().L_at + 3 * i) = torque_[i] + constraint_torque_[i];
  }
}

// Converts λ of rods to forces [N].
void EquationsOfMotion::multipliers_to_forces(double* lambda) const {
  for (std::size_t l = 0; l < first_.ball; ++l) lambda[rows_[l].unknown] *= inputs_.length()[l].value;
}

void EquationsOfMotion::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  inputs_.update(*this, t);
  update_kinematics(t, y);
  factor(kLeastPivotOfForces);
  set_velocities(y);
  accelerate(stage, y, dydt);
}

double EquationsOfMotion::rounding() const { return 4.0 * kEpsilon * scale_; }

double EquationsOfMotion::squared_size_of(const double* dy, double h) const {
  const std::size_t bodies = bodies_.size();
  double largest = 0.0;
  const auto consider = [&](double square) { largest = larger(largest, square); };
  for (std::size_t i = 0; i < bodies; ++i) {
    consider(ConstVector(dy + 3 * i).squaredNorm());
    consider(h * h * ConstVector(dy + layout().v_at + 3 * i).squaredNorm());
  }
  const double* dq = dy + layout().q_at;
  for (std::size_t i = 0; i < rotating_; ++i) {
    const double turned = 2.0 * radius_of_gyration_[i];
    const double norm = Eigen::Map<const Eigen::Vector4d>(dq + 4 * i).squaredNorm();
    consider(turned * turned * norm);
  }
  return largest;
}

// ---- the linear system

// Computes Gᵀλ: forces on bodies and torques on rotating bodies.
void EquationsOfMotion::apply_jacobian_transpose(const double* lambda) {
  std::size_t pull = 0;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    Vector3d sum = Vector3d::Zero();
    for (; pull < pulls_end_[i]; ++pull)
      sum += pulls_[pull].sign * lambda[pulls_[pull].unknown] * direction_[pulls_[pull].row];
    constraint_force_[i] = sum;
  }
  for (Vector3d& twist : constraint_torque_) twist.setZero();
  for (std::size_t p = 0; p < angular_blocks_.size(); ++p)
    constraint_torque_[angular_blocks_[p].body] +=
        lambda[angular_blocks_[p].unknown] * J_angular_[p];
}

// Replaces b by λ; rows without a force get 0.
void EquationsOfMotion::solve(double* b) {
  if (left_out_ > dependent_rows_) dependent_rows_ = left_out_;
  if (kept_ < value_.size()) clear_redundant(b);
  ldlt_.solve(b);
}

// Computes b − A λ of all rows, redundant rows included.
void EquationsOfMotion::find_residual(const double* b, const double* lambda, double* residual) {
  apply_jacobian_transpose(lambda);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const Row& row = rows_[i];
    const Vector3d a = inverse_mass_[row.b] * constraint_force_[row.b] -
                       inverse_mass_[row.a] * constraint_force_[row.a];
    residual[row.unknown] = b[row.unknown] - direction_[i].dot(a);
  }
  for (std::size_t i = rows_.size(); i < parts(); ++i) {
    const Row& row = part(i);
    const Vector3d a = inverse_mass_[row.b] * constraint_force_[row.b] -
                       inverse_mass_[row.a] * constraint_force_[row.a];
    residual[rows_[row_of_part(i)].unknown] -= direction_[i].dot(a);
  }
  for (std::size_t p = 0; p < angular_blocks_.size(); ++p)
    residual[angular_blocks_[p].unknown] -=
        M_inv_Jt_[p].dot(constraint_torque_[angular_blocks_[p].body]);
}

}  // namespace constraint_sim::engine
