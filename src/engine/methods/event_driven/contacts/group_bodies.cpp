#include "engine/methods/event_driven/contacts/group_bodies.h"

#include <algorithm>
#include <cmath>

#include "engine/math/larger.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector = Eigen::Map<Vector3d>;
using ConstVector = Eigen::Map<const Vector3d>;

constexpr double kStill = 1e-13;   // share of gravity; less is rounding of balanced forces
constexpr double kStillFor = 1.0;  // [s] in which kStill gives the speed that counts as rest

}  // namespace

void GroupBodies::begin_interval(double start, const Vector3d& gravity,
                                 const List<AppliedWrench>& loads) {
  start_ = start;
  gravity_ = gravity;
  for (GroupBody& body : list_) {
    body.force.setZero();
    body.torque.setZero();
    for (const AppliedWrench& load : loads) {
      if (load.body != body.index) continue;
      body.force += load.force;
      body.torque += load.torque;
    }
  }
}

// ---- state

void GroupBodies::gather(const List<BodyState>& states, double since_tick) {
  t_ = 0.0;
  since_tick_ = since_tick;
  movers_.clear();
  states_.resize(list_.size());
  rotations_.resize(movable_);
  inverse_inertia_.assign(list_.size(), Matrix3d::Zero());
  y_.assign(size(), 0.0);
  scale_ = shapes_.farthest();
  for (std::size_t i = 0; i < list_.size(); ++i) {
    const BodyState& state = states_[i] = states[static_cast<std::size_t>(list_[i].index)];
    scale_ = std::max(scale_, state.position.norm());
    if (i >= movable_ && !(state.linear_velocity.isZero(0.0) && state.angular_velocity.isZero(0.0)))
      movers_.push_back({i, state});
    if (i >= movable_) continue;
    double* const y = y_.data() + kNumbers * i;
    Vector(y + 0) = state.position;
    Vector(y + kV) = state.linear_velocity;
    Eigen::Map<Eigen::Vector4d>(y + kQ) = state.orientation.coeffs();
    Vector(y + kL) =
        apply_inertia(list_[i].mass.inertia, state.orientation, state.angular_velocity);
  }
  place(y_.data());
}

void GroupBodies::scatter(List<BodyState>* states) const {
  for (std::size_t i = 0; i < movable_; ++i)
    (*states)[static_cast<std::size_t>(list_[i].index)] = states_[i];
}

void GroupBodies::place(const double* numbers) {
  for (std::size_t i = 0; i < movable_; ++i) {
    const double* const y = numbers + kNumbers * i;
    BodyState& state = states_[i];
    state.position = ConstVector(y);
    state.linear_velocity = ConstVector(y + kV);
    state.orientation.coeffs() = Eigen::Map<const Eigen::Vector4d>(y + kQ).normalized();
    const Matrix3d& R = rotations_[i] = rotation_matrix(y + kQ);
    inverse_inertia_[i] = R * list_[i].mass.inverse_inertia.asDiagonal() * R.transpose();
    state.angular_velocity = inverse_inertia_[i] * ConstVector(y + kL);
  }
  if (has_movers()) place_movers();
  shapes_.place(states_);
}

void GroupBodies::place_movers() {
  const double t = since_tick_ + t_;
  for (const auto& [i, start] : movers_) {
    states_[i].position = start.position + t * start.linear_velocity;
    states_[i].orientation =
        (rotation(t * start.angular_velocity) * start.orientation).normalized();
  }
}

void GroupBodies::set_states(const List<BodyState>& states) {
  states_ = states;
  shapes_.place(states_);
}

double GroupBodies::kinetic_energy() const {
  double energy = 0.0;
  for (std::size_t i = 0; i < movable_; ++i) {
    const BodyState& state = states_[i];
    energy += 0.5 * state.linear_velocity.squaredNorm() / list_[i].mass.inverse_mass +
              0.5 * state.angular_velocity.dot(apply_inertia(
                        list_[i].mass.inertia, state.orientation, state.angular_velocity));
  }
  return energy;
}

void GroupBodies::enlarge_scale(double length) { scale_ = std::max(scale_, length); }

// ---- dynamics

void GroupBodies::find_free_accelerations(const double* y, GroupMotions* accelerations) const {
  accelerations->linear.resize(movable_);
  accelerations->angular.resize(movable_);
  for (std::size_t i = 0; i < movable_; ++i) {
    const Vector3d& w = states_[i].angular_velocity;
    const Vector3d L = ConstVector(y + kNumbers * i + kL);
    accelerations->linear[i] =
        list_[i].mass.weight_share * gravity_ + list_[i].mass.inverse_mass * list_[i].force;
    accelerations->angular[i] = inverse_inertia_[i] * (list_[i].torque - w.cross(L));
  }
}

void GroupBodies::write_derivative(const double* y, const GroupMotions& free,
                                   const GroupMotions& pushed, double* dydt) const {
  std::fill(dydt, dydt + size(), 0.0);
  for (std::size_t i = 0; i < movable_; ++i) {
    const double* const from = y + kNumbers * i;
    double* const to = dydt + kNumbers * i;
    Vector(to + 0) = ConstVector(from + kV);
    Vector(to + kV) = free.linear[i] + pushed.linear[i];
    write_quaternion_rate(states_[i].angular_velocity, from + kQ, to + kQ);
    if (!list_[i].mass.can_turn()) continue;
    const Matrix3d& R = rotations_[i];
    Vector(to + kL) =
        list_[i].torque + R * list_[i].mass.inertia.cwiseProduct(R.transpose() * pushed.angular[i]);
  }
}

void GroupBodies::find_accelerations(const double* dydt, GroupMotions* rates) const {
  rates->set_zero(list_.size());
  for (std::size_t i = 0; i < movable_; ++i) {
    const double* const body = dydt + kNumbers * i;
    rates->linear[i] = ConstVector(body + kV);
    const Vector3d& w = states_[i].angular_velocity;
    const Vector3d L = apply_inertia(list_[i].mass.inertia, states_[i].orientation, w);
    rates->angular[i] = inverse_inertia_[i] * (ConstVector(body + kL) - Vector3d(w.cross(L)));
  }
}

Jacobian GroupBodies::accelerations(std::size_t a, std::size_t b, const Jacobian& F) const {
  Jacobian by;
  if (a < movable_) {
    by.j1 = list_[a].mass.inverse_mass * F.j1;
    by.j2 = inverse_inertia_[a] * F.j2;
  }
  if (b < movable_) {
    by.j3 = list_[b].mass.inverse_mass * F.j3;
    by.j4 = inverse_inertia_[b] * F.j4;
  }
  return by;
}

// Power of a kinematic body on the other bodies, by force and torque on the kinematic body.
double GroupBodies::driven_power(std::size_t body, const Vector3d& force,
                                 const Vector3d& torque) const {
  if (body < movable_) return 0.0;
  return -force.dot(states_[body].linear_velocity) - torque.dot(states_[body].angular_velocity);
}

void GroupBodies::add_velocities(const GroupMotions& change, double* y) const {
  for (std::size_t i = 0; i < movable_; ++i) {
    double* const body = y + kNumbers * i;
    Vector(body + kV) += change.linear[i];
    if (list_[i].mass.can_turn())
      Vector(body + kL) +=
          apply_inertia(list_[i].mass.inertia, states_[i].orientation, change.angular[i]);
  }
}

void GroupBodies::displace(std::size_t i, const Vector3d& moved, const Vector3d& turned,
                           double* y) {
  double* const body = y + kNumbers * i;
  Vector(body) += moved;
  Eigen::Map<Eigen::Quaterniond> q(body + kQ);
  q = rotation(turned) * Eigen::Quaterniond(q);
}

bool GroupBodies::normalize(std::size_t i, double* y) {
  return normalize_quaternions(y + kNumbers * i + kQ, 1);
}

bool GroupBodies::is_still(const double* dydt) const {
  const double least = kStill * gravity_.norm();
  for (std::size_t i = 0; i < movable_; ++i) {
    const double radius = list_[i].mass.radius_of_gyration();
    const double* const body = dydt + kNumbers * i;
    if (!(ConstVector(body).norm() <= least * kStillFor &&
          radius * states_[i].angular_velocity.norm() <= least * kStillFor &&
          ConstVector(body + kV).norm() <= least &&
          radius * (inverse_inertia_[i] * ConstVector(body + kL)).norm() <= least))
      return false;
  }
  return true;
}

double GroupBodies::squared_size_of(const double* dy, double h) const {
  double largest = 0.0;
  const auto consider = [&](double square) { largest = larger(largest, square); };
  for (std::size_t i = 0; i < movable_; ++i) {
    const double* const body = dy + kNumbers * i;
    consider(ConstVector(body).squaredNorm());
    consider(h * h * ConstVector(body + kV).squaredNorm());
    const double turned = 2.0 * list_[i].mass.radius_of_gyration();
    consider(turned * turned * Eigen::Map<const Eigen::Vector4d>(body + kQ).squaredNorm());
    const Vector3d spin = inverse_inertia_[i] * ConstVector(body + kL);
    consider(0.25 * h * h * turned * turned * spin.squaredNorm());
  }
  return largest;
}

}  // namespace constraint_sim::engine
