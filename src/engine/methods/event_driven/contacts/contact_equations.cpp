#include "engine/methods/event_driven/contacts/contact_equations.h"

#include <algorithm>
#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kMostProjections = 12;
constexpr double kStill = 1e-13;   // share of gravity; less is rounding of balanced forces
constexpr double kStillFor = 1.0;  // [s] in which kStill gives the speed that counts as rest
// Share of the scale; a row with a larger error is not met.
constexpr double kContactsProjected = 1e-12;

}  // namespace

// ---- kinematics

void ContactEquations::gather_state(const List<BodyState>& states, double since_tick) {
  t_ = 0.0;
  angles.set_time(0.0);
  since_tick_ = since_tick;
  movers_.clear();
  states_.resize(bodies.size());
  shapes_.resize(bodies.size());
  inverse_inertia_.assign(bodies.size(), Matrix3d::Zero());
  y_.assign(size(), 0.0);
  scale_ = 0.0;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const BodyState& state = states_[i] = states[static_cast<std::size_t>(bodies[i].index)];
    scale_ = std::max(scale_, state.position.norm());
    if (bodies[i].shape_pose) scale_ = std::max(scale_, bodies[i].shape_pose->position.norm());
    place_shape(i);
    if (i >= movable && !(state.linear_velocity.isZero(0.0) && state.angular_velocity.isZero(0.0)))
      movers_.push_back({i, state});
    if (i >= movable) continue;
    double* const y = y_.data() + kNumbers * i;
    Vector(y + 0) = state.position;
    Vector(y + kV) = state.linear_velocity;
    Eigen::Map<Eigen::Vector4d>(y + kQ) = state.orientation.coeffs();
    Vector(y + kL) =
        apply_inertia(bodies[i].mass.inertia, state.orientation, state.angular_velocity);
  }
  place(y_.data());
}

void ContactEquations::prepare_stages() {
  for (const Contact& contact : contacts) {
    scale_ = std::max({scale_, contact.feature.on_a.norm(), contact.feature.radius_a});
    if (contact.feature.kind == ContactFeature::Kind::kPlaneOfA ||
        contact.feature.kind == ContactFeature::Kind::kEdges)
      scale_ = std::max(scale_, contact.feature.on_b.norm());
  }
  for (Stage& stage : stages_) {
    stage.contact.resize(contacts.size());
    stage.normal.resize(contacts.size());
    stage.coordinate.resize(coordinates.size());
    stage.joint.resize(joints.size());
    stage.clear();
  }
}

void ContactEquations::Stage::clear() {
  std::fill(contact.begin(), contact.end(), Vector3d::Zero());
  std::fill(normal.begin(), normal.end(), 0.0);
  std::fill(coordinate.begin(), coordinate.end(), 0.0);
  std::fill(joint.begin(), joint.end(), RowVector::Zero());
  driven_power = 0.0;
}

void ContactEquations::place(const double* numbers) {
  for (std::size_t i = 0; i < movable; ++i) {
    const double* const y = numbers + kNumbers * i;
    BodyState& state = states_[i];
    state.position = ConstVector(y);
    state.linear_velocity = ConstVector(y + kV);
    state.orientation.coeffs() = Eigen::Map<const Eigen::Vector4d>(y + kQ).normalized();
    const Matrix3d R = rotation_matrix(y + kQ);
    inverse_inertia_[i] = R * bodies[i].mass.inverse_inertia.asDiagonal() * R.transpose();
    state.angular_velocity = inverse_inertia_[i] * ConstVector(y + kL);
    place_shape(i);
  }
  if (!movers_.empty()) place_movers();
}

void ContactEquations::place_movers() {
  const double t = since_tick_ + t_;
  for (const auto& [i, start] : movers_) {
    states_[i].position = start.position + t * start.linear_velocity;
    states_[i].orientation =
        (rotation(t * start.angular_velocity) * start.orientation).normalized();
    place_shape(i);
  }
}

// Power of a kinematic body on the other bodies, by force and torque on the kinematic body.
double ContactEquations::driven_power(std::size_t body, const Vector3d& force,
                                      const Vector3d& torque) const {
  if (body < movable) return 0.0;
  return -force.dot(states_[body].linear_velocity) - torque.dot(states_[body].angular_velocity);
}

double ContactEquations::driven_power(std::size_t a, std::size_t b, const Jacobian& F) const {
  return driven_power(a, F.j1, F.j2) + driven_power(b, F.j3, F.j4);
}

// Power of kinematic bodies by a unit force of a row.
double ContactEquations::driven_power(const Row& row) const {
  if (row.contact < 0) return driven_power(row.a, row.b, row.J);
  return driven_power(row.a, row.b,
                      motion(contacts[static_cast<std::size_t>(row.contact)]).along(row.along));
}

void ContactEquations::place_shape(std::size_t i) {
  if (bodies[i].shape_pose) shapes_[i] = beside(states_[i], *bodies[i].shape_pose);
}

void ContactEquations::set_states(const List<BodyState>& states) {
  states_ = states;
  for (std::size_t i = 0; i < bodies.size(); ++i) place_shape(i);
}

// Relative motion at a contact. Features are in frames of shapes; arms and accelerations refer to
// centres of mass.
ContactMotion ContactEquations::motion(const Contact& contact,
                                       const ContactFeature& feature) const {
  ContactMotion motion = motion_of(feature, shape_state(contact.a), shape_state(contact.b));
  const auto move = [this](std::size_t body, double sign, Vector3d* arm, Vector3d* w_bias) {
    if (!bodies[body].shape_pose) return;
    const Vector3d offset = shapes_[body].position - states_[body].position;
    const Vector3d& w = states_[body].angular_velocity;
    *arm += offset;
    *w_bias += sign * w.cross(w.cross(offset));
  };
  move(contact.a, 1.0, &motion.r_a, &motion.w_bias);
  move(contact.b, -1.0, &motion.r_b, &motion.w_bias);
  return motion;
}

void ContactEquations::scatter_state(List<BodyState>* states) const {
  for (std::size_t i = 0; i < movable; ++i)
    (*states)[static_cast<std::size_t>(bodies[i].index)] = states_[i];
}

// ---- System

void ContactEquations::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  t_ = t;
  place(y);
  List<Vector3d>&linear = free_linear_, &angular = free_angular_;
  clear_motion(&linear, &angular);
  for (std::size_t i = 0; i < movable; ++i) {
    const Vector3d& w = states_[i].angular_velocity;
    const Vector3d L = ConstVector(y + kNumbers * i + kL);
    linear[i] = gravity + bodies[i].mass.inverse_mass * bodies[i].force;
    angular[i] = inverse_inertia_[i] * (bodies[i].torque - w.cross(L));
  }
  rows_.clear();
  add_joint_rows();
  add_held_rows();
  add_contact_rows(true, true);
  Stage& told = stages_[stage];
  told.clear();
  if (!rows_.empty()) factor_rows(stage == 0);
  List<Vector3d>&push_linear = linear_, &push_angular = angular_;
  clear_motion(&push_linear, &push_angular);
  if (!coordinates.empty()) pull_coordinates(&told, &push_linear, &push_angular);
  if (!rows_.empty()) {
    List<double>& lambda = lambda_;
    lambda.resize(rows_.size());
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      lambda[i] = -rows_[i].gamma - along(rows_[i], linear, angular);
      if (!coordinates.empty()) lambda[i] -= along(rows_[i], push_linear, push_angular);
    }
    if (!solve_rows(&lambda)) std::fill(lambda.begin(), lambda.end(), std::nan(""));
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const Row& row = rows_[i];
      push(row, lambda[i], &push_linear, &push_angular);
      if (!movers_.empty()) told.driven_power += lambda[i] * driven_power(row);
      if (row.contact >= 0) {
        const auto c = static_cast<std::size_t>(row.contact);
        told.contact[c] += lambda[i] * row.along;
        if (row.is_normal) told.normal[c] = lambda[i];
      } else {
        told.joint[static_cast<std::size_t>(row.joint)][row.function] += lambda[i];
        if (row.coordinate >= 0)
          told.coordinate[static_cast<std::size_t>(row.coordinate)] = lambda[i];
      }
    }
  }
  std::fill(dydt, dydt + size(), 0.0);
  for (std::size_t i = 0; i < movable; ++i) {
    const double* const from = y + kNumbers * i;
    double* const to = dydt + kNumbers * i;
    Vector(to + 0) = ConstVector(from + kV);
    Vector(to + kV) = linear[i] + push_linear[i];
    write_quaternion_rate(states_[i].angular_velocity, from + kQ, to + kQ);
    if (!bodies[i].mass.can_turn()) continue;
    const Matrix3d R = rotation_matrix(from + kQ);
    Vector(to + kL) =
        bodies[i].torque + R * bodies[i].mass.inertia.cwiseProduct(R.transpose() * push_angular[i]);
  }
}

// Computes the least change M⁻¹ Jᵀ λ of positions or velocities that removes the errors of the
// rows, in linear_ and angular_.
bool ContactEquations::find_change(double Row::*by) {
  factor_rows(true);
  lambda_.resize(rows_.size());
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    lambda_[i] = -(rows_[i].*by);
    rows_[i].reference = 0.0;
  }
  if (!solve_rows(&lambda_)) return false;
  clear_motion(&linear_, &angular_);
  for (std::size_t i = 0; i < rows_.size(); ++i) push(rows_[i], lambda_[i], &linear_, &angular_);
  return true;
}

bool ContactEquations::project(double t, double* y) {
  t_ = t;
  double before = kInfinity;
  for (int k = 0;; ++k) {
    for (std::size_t i = 0; i < movable; ++i)
      Eigen::Map<Eigen::Vector4d>(y + kNumbers * i + kQ).normalize();
    place(y);
    rows_.clear();
    add_joint_rows();
    add_held_rows();
    add_contact_rows(false, false);
    double error = 0.0;
    for (const Row& row : rows_) error = larger(error, std::abs(row.value));
    if (error <= kEpsilon * scale_) return true;
    if (!(error <= 0.5 * before) || k == kMostProjections)
      return error <= kContactsProjected * scale_;
    before = error;
    if (!find_change(&Row::value)) return false;
    for (std::size_t i = 0; i < movable; ++i) {
      double* const body = y + kNumbers * i;
      Vector(body) += linear_[i];
      Eigen::Map<Eigen::Quaterniond> q(body + kQ);
      q = rotation(angular_[i]) * Eigen::Quaterniond(q);
    }
  }
}

// Projects velocities onto the acting rows, and evaluates the derivative.
bool ContactEquations::restart(double* y, double* dydt, const double* known) {
  place(y);
  rows_.clear();
  add_joint_rows();
  add_held_rows();
  add_contact_rows(false, true);
  const bool is_off =
      std::any_of(rows_.begin(), rows_.end(), [](const Row& row) { return row.rate != 0.0; });
  if (is_off) {
    if (!find_change(&Row::rate)) return false;
    for (std::size_t i = 0; i < movable; ++i) {
      double* const body = y + kNumbers * i;
      Vector(body + kV) += linear_[i];
      if (bodies[i].mass.can_turn())
        Vector(body + kL) +=
            apply_inertia(bodies[i].mass.inertia, states_[i].orientation, angular_[i]);
    }
  }
  if (known != nullptr && !is_off)
    std::copy_n(known, size(), dydt);
  else
    derivative(0, t_, y, dydt);
  return true;
}

bool ContactEquations::is_still(const double* dydt) const {
  const double least = kStill * gravity.norm();
  for (std::size_t i = 0; i < movable; ++i) {
    const double radius = bodies[i].mass.radius_of_gyration();
    const double* const body = dydt + kNumbers * i;
    if (!(ConstVector(body).norm() <= least * kStillFor &&
          radius * states_[i].angular_velocity.norm() <= least * kStillFor &&
          ConstVector(body + kV).norm() <= least &&
          radius * (inverse_inertia_[i] * ConstVector(body + kL)).norm() <= least))
      return false;
  }
  return true;
}

void ContactEquations::add_impulses(double weight, std::size_t stage) {
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    if (contacts[c].acts == Acts::kOpen) continue;
    contacts[c].impulse += weight * stages_[stage].contact[c];
    contacts[c].touched = contacts[c].feature;
  }
  for (std::size_t j = 0; j < joints.size(); ++j)
    joints[j].impulse += weight * stages_[stage].joint[j];
  driven_work += weight * stages_[stage].driven_power;
}

void ContactEquations::break_joint(std::size_t j) {
  joints[j].is_broken = true;
  joints[j].has_rows = false;
  for (Coordinate& of : coordinates) {
    if (of.joint != j) continue;
    of.is_prescribed = of.is_one_sided = false;
    of.state = {};
    of.law.soft = of.law.servo = {};
    of.law.servo_most = 0.0;
    of.law.only_pulls = false;
    of.law.goal.reset();
  }
}

void ContactEquations::keep() {
  kept_.stage = stages_[0];
  kept_.work = driven_work;
  kept_.contacts.clear();
  kept_.touched.clear();
  kept_.joints.clear();
  for (const Contact& contact : contacts) {
    kept_.contacts.push_back(contact.impulse);
    kept_.touched.push_back(contact.touched);
  }
  for (const BodyJoint& joint : joints) kept_.joints.push_back(joint.impulse);
}

void ContactEquations::restore() {
  stages_[0] = kept_.stage;
  driven_work = kept_.work;
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    contacts[c].impulse = kept_.contacts[c];
    contacts[c].touched = kept_.touched[c];
  }
  for (std::size_t j = 0; j < joints.size(); ++j) joints[j].impulse = kept_.joints[j];
}

// Squared size of a change of the state, defined as in EquationsOfMotion.
double ContactEquations::squared_size_of(const double* dy, double h) const {
  double largest = 0.0;
  const auto consider = [&](double square) { largest = larger(largest, square); };
  for (std::size_t i = 0; i < movable; ++i) {
    const double* const body = dy + kNumbers * i;
    consider(ConstVector(body).squaredNorm());
    consider(h * h * ConstVector(body + kV).squaredNorm());
    const double turned = 2.0 * bodies[i].mass.radius_of_gyration();
    consider(turned * turned * Eigen::Map<const Eigen::Vector4d>(body + kQ).squaredNorm());
    const Vector3d spin = inverse_inertia_[i] * ConstVector(body + kL);
    consider(0.25 * h * h * turned * turned * spin.squaredNorm());
  }
  return largest;
}

double ContactEquations::rounding() const { return 4.0 * kEpsilon * scale_; }

}  // namespace constraint_sim::engine
