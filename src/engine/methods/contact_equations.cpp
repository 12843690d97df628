#include "engine/methods/contact_equations.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/linear/larger.h"
#include "engine/methods/law_events.h"
#include "engine/methods/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kDependent = 1e-10;  // pivots below, of rows scaled to a diagonal of one
constexpr double kTiny = 0.5e-9;      // [m/s] a slip below has the direction of the substep's start
constexpr int kMostNewton = 12;
constexpr double kStill = 1e-13;      // of gravity: less is rounding of forces that balance
constexpr double kStillFor = 1.0;     // [s] and a speed that it has after so long
constexpr double kProjected = 1e-12;  // of the scale: rows that are off by more are not met
constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

}  // namespace

// ---- where things are

void ContactEquations::gather_state(const std::vector<BodyState>& states) {
  states_.resize(bodies.size());
  inverse_inertia_.assign(bodies.size(), Matrix3d::Zero());
  y_.assign(size(), 0.0);
  scale_ = 0.0;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const BodyState& state = states_[i] = states[static_cast<std::size_t>(bodies[i].index)];
    scale_ = std::max(scale_, state.position.norm());
    if (i >= movable) continue;
    double* const y = y_.data() + kNumbers * i;
    Vector(y + 0) = state.position;
    Vector(y + kV) = state.linear_velocity;
    Eigen::Map<Eigen::Vector4d>(y + kQ) = state.orientation.coeffs();
    Vector(y + kL) =
        apply_inertia(bodies[i].mass.inertia, state.orientation, state.angular_velocity);
  }
  for (const Contact& contact : contacts)
    scale_ = std::max({scale_, contact.feature.on_a.norm(), contact.feature.radius_a});
  for (const Contact& contact : contacts)
    if (contact.feature.kind == ContactFeature::Kind::kPlaneOfA ||
        contact.feature.kind == ContactFeature::Kind::kEdges)
      scale_ = std::max(scale_, contact.feature.on_b.norm());
  for (Stage& stage : stages_) {
    stage.contact.assign(contacts.size(), Vector3d::Zero());
    stage.normal.assign(contacts.size(), 0.0);
    stage.coordinate.assign(coordinates.size(), 0.0);
    stage.joint.assign(joints.size(), RowVector::Zero());
  }
  place(y_.data());
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
  }
}

void ContactEquations::scatter_state(std::vector<BodyState>* states) const {
  for (std::size_t i = 0; i < movable; ++i)
    (*states)[static_cast<std::size_t>(bodies[i].index)] = states_[i];
}

// ---- rows

double ContactEquations::along(const Row& row, const Jacobian& J,
                               const std::vector<Vector3d>& linear,
                               const std::vector<Vector3d>& angular) const {
  double sum = 0.0;
  if (row.a < movable) sum += J.j1.dot(linear[row.a]) + J.j2.dot(angular[row.a]);
  if (row.b < movable) sum += J.j3.dot(linear[row.b]) + J.j4.dot(angular[row.b]);
  return sum;
}

// adds M⁻¹ F amount
void ContactEquations::push(const Row& row, const Jacobian& F, double amount,
                            std::vector<Vector3d>* linear, std::vector<Vector3d>* angular) const {
  if (row.a < movable) {
    (*linear)[row.a] += amount * bodies[row.a].mass.inverse_mass * F.j1;
    (*angular)[row.a] += amount * (inverse_inertia_[row.a] * F.j2);
  }
  if (row.b < movable) {
    (*linear)[row.b] += amount * bodies[row.b].mass.inverse_mass * F.j3;
    (*angular)[row.b] += amount * (inverse_inertia_[row.b] * F.j4);
  }
}

// what joints hold both ways with any force
void ContactEquations::add_joint_rows() {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const BodyJoint& joint = joints[j];
    if (!joint.has_rows) continue;
    const BodyState& a = states_[joint.a];
    const BodyState& b = states_[joint.b];
    const JointVectors vectors(joint.joint, a, b);
    const JointMotion motion(vectors, a, b);
    const JointKindInfo& kind = info(joint.joint.kind);
    const bool is_distance = has_length(joint.joint.kind);
    for (int k = 0; k < kind.rows; ++k) {
      const ScalarForm form =
          is_distance ? ScalarForm(LengthForm{}) : kind.function[static_cast<std::size_t>(k)];
      const Prescribed target = is_distance ? joint.course.length(clock()) : Prescribed{};
      Row& row = rows_.emplace_back();
      row.a = joint.a;
      row.b = joint.b;
      row.J = row.F = jacobian(form, vectors);
      row.value = value(form, vectors) - target.value;
      row.rate = rate(form, vectors, motion) - target.rate;
      row.gamma = gamma(form, vectors, motion) - target.acceleration;
      row.joint = static_cast<int>(j);
      row.function = k;
    }
  }
  for (std::size_t c = 0; c < coordinates.size(); ++c)
    if (coordinates[c].is_prescribed) add_coordinate_row(c, target(coordinates[c]));
}

void ContactEquations::add_coordinate_row(std::size_t c, const Prescribed& target) {
  const Coordinate& of = coordinates[c];
  const Reading now = read(of, nullptr);
  Row& row = rows_.emplace_back();
  row.a = joints[of.joint].a;
  row.b = joints[of.joint].b;
  row.J = row.F = now.J;
  row.value = of.law.form.is_angle ? unwound(now.q - target.value, 0.0) : now.q - target.value;
  row.rate = now.rate - target.rate;
  row.gamma = now.acceleration - target.acceleration;
  row.joint = static_cast<int>(of.joint);
  row.function = of.law.function;
  row.coordinate = static_cast<int>(c);
  row.reference = of.reference;
}

// what holds coordinates up to a force, or one way
void ContactEquations::add_held_rows() {
  for (std::size_t c = 0; c < coordinates.size(); ++c)
    if (coordinates[c].state.hold != Hold::kNone) add_coordinate_row(c, target(coordinates[c]));
}

// ---- coordinates

ContactEquations::Reading ContactEquations::read(const Coordinate& of,
                                                 const Accelerations* rates) const {
  const BodyJoint& joint = joints[of.joint];
  const BodyState &a = states_[joint.a], &b = states_[joint.b];
  const JointVectors vectors(joint.joint, a, b);
  const JointMotion motion(vectors, a, b);
  Reading now;
  now.q = reading(of.law.form, value(of.law.form, vectors), of.law.zero, of.position);
  now.rate = rate(of.law.form, vectors, motion);
  now.J = jacobian(of.law.form, vectors);
  now.acceleration = gamma(of.law.form, vectors, motion);
  if (rates != nullptr)
    now.acceleration += now.J.times(rates->linear[joint.a], rates->angular[joint.a],
                                    rates->linear[joint.b], rates->angular[joint.b]);
  return now;
}

// a motor moves that of a length
Prescribed ContactEquations::limit(const Coordinate& of, bool upper_one) const {
  if (!of.law.is_distance) return {of.law.limit(upper_one), 0.0, 0.0};
  const BodyJoint& joint = joints[of.joint];
  Prescribed at_limit = joint.course.length(clock());
  at_limit.value +=
      of.law.limit(upper_one) - joint.joint.distance.length.value_or(0.0) + of.given_way;
  return at_limit;
}

Prescribed ContactEquations::zeta(const Coordinate& of) const {
  if (of.law.is_distance) return joints[of.joint].course.length(clock());
  return of.law.drive > 0.0 ? motor_course(of.motor, clock(), 0.0) : Prescribed{};
}

Prescribed ContactEquations::target(const Coordinate& of) const {
  const BodyJoint& joint = joints[of.joint];
  if (of.is_prescribed) {
    Prescribed at = joint.course.target(of.law.function, clock());
    at.value += of.law.zero;
    return at;
  }
  Prescribed at = rate_held_at(
      of.state.hold, [&](bool upper_one) { return limit(of, upper_one); },
      [&] { return zeta(of); });
  if (of.state.hold == Hold::kStill) at.value = of.held;
  if (of.state.hold != Hold::kDrive) return at;
  at.value =
      of.held + (of.law.is_distance ? at.value - joint.course.length(of.held_at).value
                                    : motor_travel(of.motor, of.held_at, clock() - of.held_at));
  return at;
}

bool ContactEquations::is_moved_by_motors() const {
  return std::any_of(joints.begin(), joints.end(),
                     [](const BodyJoint& joint) { return joint.course.is_driven(); }) ||
         std::any_of(coordinates.begin(), coordinates.end(),
                     [](const Coordinate& of) { return of.motor.is_moving(); });
}

// of springs and dampers, and of what is at its bound
double ContactEquations::free_force(const Coordinate& of, const Reading& now) const {
  return of.law.soft.force(now.q, now.rate) + constant_force(of.law, of.state);
}

void ContactEquations::pull_coordinates(Stage* told, std::vector<Vector3d>* linear,
                                        std::vector<Vector3d>* angular) const {
  for (const Coordinate& of : coordinates) {
    if (of.is_prescribed) continue;
    const Reading now = read(of, nullptr);
    const double force = free_force(of, now);
    if (force == 0.0) continue;
    Row row;
    row.a = joints[of.joint].a;
    row.b = joints[of.joint].b;
    push(row, now.J, force, linear, angular);
    told->joint[of.joint][of.law.function] += force;
  }
}

// Of contacts that act: normals, and of those that stick tangents. With slip, forces have the
// friction of what slips.
void ContactEquations::add_contact_rows(bool with_slip, bool with_tangents) {
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    const Contact& contact = contacts[c];
    if (contact.acts == Acts::kOpen) continue;
    const ContactMotion now = motion(contact);
    const auto add = [&](const Vector3d& d, const Vector3d& f) -> Row& {
      Row& row = rows_.emplace_back();
      row.a = contact.a;
      row.b = contact.b;
      row.J = now.along(d);
      row.F = now.along(f);
      row.along = f;
      row.rate = d.dot(now.w);
      row.gamma = d.dot(now.w_bias);
      row.contact = static_cast<int>(c);
      row.reference = contact.reference.dot(d);
      return row;
    };
    Vector3d force = now.n;
    if (with_slip && contact.acts == Acts::kSlips && contact.friction > 0.0) {
      const Vector3d slip = now.slip();
      const double speed = slip.norm();
      Vector3d direction = contact.direction;
      if (speed > kTiny || direction.isZero(0.0)) {
        direction = speed > 0.0 ? Vector3d(slip / speed) : Vector3d(Vector3d::Zero());
        if (direction.dot(contact.direction) < 0.0) direction = -direction;
      }
      force -= contact.friction * direction;
    }
    Row& normal = add(now.n, force);
    normal.is_normal = true;
    normal.value = now.gap;
    normal.gamma += now.n_dot.dot(now.w);
    if (!with_tangents || contact.acts != Acts::kSticks) continue;
    const Vector3d t = tangent_to(now.n);
    add(t, t);
    const Vector3d other = now.n.cross(t);
    add(other, other);
  }
}

void ContactEquations::clear_motion(std::vector<Vector3d>* linear,
                                    std::vector<Vector3d>* angular) const {
  linear->assign(movable, Vector3d::Zero());
  angular->assign(movable, Vector3d::Zero());
}

// Whether rows are independent is asked where a substep starts, and holds for its stages.
void ContactEquations::factor_rows(bool asks_rank) {
  const std::size_t m = rows_.size();
  A_.resize(index(m), index(m));
  weight_.resize(index(m));
  clear_motion(&linear_, &angular_);
  const auto clear = [&](const Row& row) {
    for (const std::size_t body : {row.a, row.b}) {
      if (body >= movable) continue;
      linear_[body].setZero();
      angular_[body].setZero();
    }
  };
  for (std::size_t i = 0; i < m; ++i) {
    push(rows_[i], rows_[i].J, 1.0, &linear_, &angular_);
    const double response = along(rows_[i], rows_[i].J, linear_, angular_);
    weight_[index(i)] = response > 0.0 ? 1.0 / std::sqrt(response) : 0.0;
    clear(rows_[i]);
  }
  for (std::size_t j = 0; j < m; ++j) {
    push(rows_[j], rows_[j].F, 1.0, &linear_, &angular_);
    for (std::size_t i = 0; i < m; ++i)
      A_(index(i), index(j)) =
          weight_[index(i)] * along(rows_[i], rows_[i].J, linear_, angular_) * weight_[index(j)];
    clear(rows_[j]);
  }
  if (!asks_rank && are_independent_) {
    lu_.compute(A_);
    return;
  }
  factors_.setThreshold(kDependent);
  factors_.compute(A_);
  are_independent_ = factors_.rank() == A_.rows();
  if (are_independent_) lu_.compute(A_);
}

// least norm beside the reference
bool ContactEquations::solve_rows(const VectorXd& right, VectorXd* lambda) {
  if (are_independent_) {
    *lambda = weight_.cwiseProduct(lu_.solve(weight_.cwiseProduct(right)));
    return lambda->allFinite();
  }
  VectorXd reference(right.size());
  for (Index i = 0; i < right.size(); ++i)
    reference[i] =
        weight_[i] > 0.0 ? rows_[static_cast<std::size_t>(i)].reference / weight_[i] : 0.0;
  *lambda = reference + factors_.solve(weight_.cwiseProduct(right) - A_ * reference);
  *lambda = weight_.cwiseProduct(*lambda);
  return lambda->allFinite();
}

// ---- a System

void ContactEquations::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  t_ = t;
  place(y);
  std::vector<Vector3d>&linear = free_linear_, &angular = free_angular_;
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
  std::fill(told.contact.begin(), told.contact.end(), Vector3d::Zero());
  std::fill(told.normal.begin(), told.normal.end(), 0.0);
  std::fill(told.joint.begin(), told.joint.end(), RowVector::Zero());
  std::fill(told.coordinate.begin(), told.coordinate.end(), 0.0);
  if (!rows_.empty()) factor_rows(stage == 0);
  std::vector<Vector3d>&push_linear = linear_, &push_angular = angular_;
  clear_motion(&push_linear, &push_angular);
  if (!coordinates.empty()) pull_coordinates(&told, &push_linear, &push_angular);
  if (!rows_.empty()) {
    VectorXd right(index(rows_.size())), lambda;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const Row& row = rows_[i];
      right[index(i)] = -row.gamma - along(row, row.J, linear, angular);
      if (!coordinates.empty()) right[index(i)] -= along(row, row.J, push_linear, push_angular);
    }
    if (!solve_rows(right, &lambda)) lambda.setConstant(right.size(), std::nan(""));
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const Row& row = rows_[i];
      push(row, row.F, lambda[index(i)], &push_linear, &push_angular);
      if (row.contact >= 0) {
        const auto c = static_cast<std::size_t>(row.contact);
        told.contact[c] += lambda[index(i)] * row.along;
        if (row.is_normal) told.normal[c] = lambda[index(i)];
      } else {
        told.joint[static_cast<std::size_t>(row.joint)][row.function] += lambda[index(i)];
        if (row.coordinate >= 0)
          told.coordinate[static_cast<std::size_t>(row.coordinate)] = lambda[index(i)];
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

// The least change M⁻¹ Jᵀ λ of positions or velocities that takes out what the rows are off by.
bool ContactEquations::find_change(double Row::*by, std::vector<Vector3d>* linear,
                                   std::vector<Vector3d>* angular) {
  factor_rows(true);
  VectorXd right(index(rows_.size())), lambda;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    right[index(i)] = -(rows_[i].*by);
    rows_[i].reference = 0.0;
  }
  if (!solve_rows(right, &lambda)) return false;
  linear->assign(movable, Vector3d::Zero());
  *angular = *linear;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    push(rows_[i], rows_[i].J, lambda[index(i)], linear, angular);
  return true;
}

bool ContactEquations::project(double t, double* y) {
  t_ = t;
  double before = std::numeric_limits<double>::infinity();
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
    if (!(error <= 0.5 * before) || k == kMostNewton) return error <= kProjected * scale_;
    before = error;
    std::vector<Vector3d> linear, angular;
    if (!find_change(&Row::value, &linear, &angular)) return false;
    for (std::size_t i = 0; i < movable; ++i) {
      double* const body = y + kNumbers * i;
      Vector(body) += linear[i];
      Eigen::Map<Eigen::Quaterniond> q(body + kQ);
      q = rotation(angular[i]) * Eigen::Quaterniond(q);
    }
  }
}

// Velocities onto the rows that act, and the derivative there.
bool ContactEquations::restart(double* y, double* dydt) {
  place(y);
  rows_.clear();
  add_joint_rows();
  add_held_rows();
  add_contact_rows(false, true);
  if (!rows_.empty()) {
    std::vector<Vector3d> linear, angular;
    if (!find_change(&Row::rate, &linear, &angular)) return false;
    for (std::size_t i = 0; i < movable; ++i) {
      double* const body = y + kNumbers * i;
      Vector(body + kV) += linear[i];
      if (bodies[i].mass.can_turn())
        Vector(body + kL) +=
            apply_inertia(bodies[i].mass.inertia, states_[i].orientation, angular[i]);
    }
  }
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
}

void ContactEquations::keep() {
  kept_ = stages_[0];
  kept_contacts_.clear();
  kept_joints_.clear();
  for (const Contact& contact : contacts) kept_contacts_.push_back(contact.impulse);
  for (const BodyJoint& joint : joints) kept_joints_.push_back(joint.impulse);
}

void ContactEquations::restore() {
  stages_[0] = kept_;
  for (std::size_t c = 0; c < contacts.size(); ++c) contacts[c].impulse = kept_contacts_[c];
  for (std::size_t j = 0; j < joints.size(); ++j) joints[j].impulse = kept_joints_[j];
}

// as EquationsOfMotion has it
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
