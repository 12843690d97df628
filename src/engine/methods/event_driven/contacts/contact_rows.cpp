// Rows of ContactEquations for joints, held coordinates and acting contacts, and the factors of the
// rows.

#include <algorithm>
#include <cmath>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kDependentRow = 1e-10;  // pivot of dependent rows, scaled to a unit diagonal
constexpr double kTiny = 0.5e-9;  // [m/s] slower slips have the direction at the substep's start

}  // namespace

double ContactEquations::along(const Row& row, const List<Vector3d>& linear,
                               const List<Vector3d>& angular) const {
  double sum = 0.0;
  if (row.a < movable) sum += row.J.j1.dot(linear[row.a]) + row.J.j2.dot(angular[row.a]);
  if (row.b < movable) sum += row.J.j3.dot(linear[row.b]) + row.J.j4.dot(angular[row.b]);
  return sum;
}

// Computes M⁻¹ F of the two bodies of a row; zero for immovable bodies.
Jacobian ContactEquations::accelerations(const Row& row, const Jacobian& F) const {
  Jacobian by;
  if (row.a < movable) {
    by.j1 = bodies[row.a].mass.inverse_mass * F.j1;
    by.j2 = inverse_inertia_[row.a] * F.j2;
  }
  if (row.b < movable) {
    by.j3 = bodies[row.b].mass.inverse_mass * F.j3;
    by.j4 = inverse_inertia_[row.b] * F.j4;
  }
  return by;
}

// Adds a row with forces along its gradient.
ContactEquations::Row& ContactEquations::add_row(std::size_t a, std::size_t b, const Jacobian& J) {
  Row& row = rows_.emplace_back();
  row.a = a;
  row.b = b;
  row.J = J;
  row.inv_M_F = accelerations(row, J);
  return row;
}

// Computes J M⁻¹ F, the change of one row by a unit force of another row.
double ContactEquations::response(const Row& of, const Row& to) const {
  double sum = 0.0;
  if (of.a < movable) {
    if (of.a == to.a) sum += of.J.j1.dot(to.inv_M_F.j1) + of.J.j2.dot(to.inv_M_F.j2);
    if (of.a == to.b) sum += of.J.j1.dot(to.inv_M_F.j3) + of.J.j2.dot(to.inv_M_F.j4);
  }
  if (of.b < movable) {
    if (of.b == to.a) sum += of.J.j3.dot(to.inv_M_F.j1) + of.J.j4.dot(to.inv_M_F.j2);
    if (of.b == to.b) sum += of.J.j3.dot(to.inv_M_F.j3) + of.J.j4.dot(to.inv_M_F.j4);
  }
  return sum;
}

void ContactEquations::push(const Row& row, double amount, List<Vector3d>* linear,
                            List<Vector3d>* angular) const {
  if (row.a < movable) {
    (*linear)[row.a] += amount * row.inv_M_F.j1;
    (*angular)[row.a] += amount * row.inv_M_F.j2;
  }
  if (row.b < movable) {
    (*linear)[row.b] += amount * row.inv_M_F.j3;
    (*angular)[row.b] += amount * row.inv_M_F.j4;
  }
}

// Adds the rows of joints that hold both ways without force limit.
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
      Row& row = add_row(joint.a, joint.b, jacobian(form, vectors));
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
  Row& row = add_row(joints[of.joint].a, joints[of.joint].b, now.J);
  row.value = of.law.form.is_angle ? unwound(now.q - target.value, 0.0) : now.q - target.value;
  row.rate = now.rate - target.rate;
  row.gamma = now.acceleration - target.acceleration;
  row.joint = static_cast<int>(of.joint);
  row.function = of.law.function;
  row.coordinate = static_cast<int>(c);
  row.reference = of.reference;
}

// Adds the rows that hold coordinates one way or up to a force.
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
  now.rate = rate(of.law.form, vectors, motion);
  const double turned =
      of.angle < 0 ? 0.0 : angles.expected(static_cast<std::size_t>(of.angle), t_, now.rate);
  now.q = reading(of.law.form, value(of.law.form, vectors), of.law.zero, turned);
  now.J = jacobian(of.law.form, vectors);
  now.acceleration = gamma(of.law.form, vectors, motion);
  if (rates != nullptr)
    now.acceleration += now.J.times(rates->linear[joint.a], rates->angular[joint.a],
                                    rates->linear[joint.b], rates->angular[joint.b]);
  return now;
}

// Position and motion of a limit. A motor moves the limit of a length.
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
  if (of.law.drive == 0.0) return {};
  if (!of.law.goal) return motor_course(of.motor, motor_phase(of.motor, clock()), 0.0);
  if (of.braking == 0.0) return {*of.law.goal, 0.0, 0.0};
  const double q = read(of, nullptr).q;
  if (of.state.hold == Hold::kBrake)
    return rate_until(*of.law.goal, std::copysign(of.braking, q - *of.law.goal),
                      of.until - clock());
  return rate_to_goal(*of.law.goal, of.braking, q);
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
  if (of.state.hold == Hold::kBrake) at.value += 0.5 * at.rate * at.rate / at.acceleration;
  if (of.law.goal) return at;
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

// Force of springs and dampers, and of laws at their bounds.
double ContactEquations::free_force(const Coordinate& of, const Reading& now) const {
  double force = of.law.soft.force(now.q, now.rate) + constant_force(of.law, of.state);
  switch (of.state.servo) {
    case Servo::kNone:  // undecided
      if (of.law.has_servo()) force += clamped_servo_force(of.law, now, rest(of));
      break;
    case Servo::kFollows:
      force += servo_force(of.law, now, rest(of));
      break;
    case Servo::kSlack:
    case Servo::kRetracts:
      break;
    case Servo::kMost:
    case Servo::kLeast:
      force += of.state.servo == Servo::kMost ? of.law.servo_most : -of.law.servo_most;
      break;
  }
  return force;
}

void ContactEquations::pull_coordinates(Stage* told, List<Vector3d>* linear,
                                        List<Vector3d>* angular) const {
  for (const Coordinate& of : coordinates) {
    if (of.is_prescribed) continue;
    const Reading now = read(of, nullptr);
    const double force = free_force(of, now);
    if (force == 0.0) continue;
    Row row;
    row.a = joints[of.joint].a;
    row.b = joints[of.joint].b;
    row.inv_M_F = accelerations(row, now.J);
    push(row, force, linear, angular);
    if (has_movers()) told->driven_power += force * driven_power(row.a, row.b, now.J);
    told->joint[of.joint][of.law.function] += force;
  }
}

// Adds the rows of acting contacts: normals, and tangents of sticking contacts. `with_slip`: forces
// of slipping contacts include friction.
void ContactEquations::add_contact_rows(bool with_slip, bool with_tangents) {
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    const Contact& contact = contacts[c];
    if (contact.acts == Acts::kOpen) continue;
    const ContactMotion now = motion(contact);
    const auto add = [&](const Vector3d& d) -> Row& {
      Row& row = add_row(contact.a, contact.b, now.along(d));
      row.along = d;
      row.rate = d.dot(now.w);
      row.gamma = d.dot(now.w_bias);
      row.contact = static_cast<int>(c);
      row.reference = contact.reference.dot(d);
      row.share = contact.tangent_share;
      return row;
    };
    Row& normal = add(now.n);
    normal.is_normal = true;
    normal.share = contact.normal_share;
    normal.value = now.gap;
    normal.gamma += now.n_dot.dot(now.w);
    const bool has_direction = contact.acts == Acts::kSlips && contact.friction > 0.0;
    Vector3d direction = contact.direction;
    if (is_straight && has_direction && !direction.isZero(0.0))
      direction = (direction - direction.dot(now.n) * now.n).normalized();
    if (with_slip && has_direction) {
      const Vector3d slip = now.slip();
      const double speed = slip.norm();
      if ((speed > kTiny && !is_straight) || direction.isZero(0.0)) {
        direction = speed > 0.0 ? Vector3d(slip / speed) : Vector3d(Vector3d::Zero());
        if (direction.dot(contact.direction) < 0.0) direction = -direction;
      }
      normal.along -= contact.friction * direction;
      normal.inv_M_F = accelerations(normal, now.along(normal.along));
      normal.is_symmetric = false;
    }
    if (!with_tangents) continue;
    if (is_straight && has_direction && !contact.direction.isZero(0.0)) add(now.n.cross(direction));
    if (contact.acts != Acts::kSticks) continue;
    const Vector3d t = tangent_to(now.n);
    add(t);
    add(now.n.cross(t));
  }
}

void ContactEquations::clear_motion(List<Vector3d>* linear, List<Vector3d>* angular) const {
  linear->assign(movable, Vector3d::Zero());
  angular->assign(movable, Vector3d::Zero());
}

// Factors the rows. Independence is tested at the start of a substep and holds for all its stages.
void ContactEquations::factor_rows(bool asks_rank) {
  const std::size_t m = rows_.size();
  double* const A = factors_.resize(m);
  weight_.resize(m);
  for (std::size_t j = 0; j < m; ++j) {
    for (std::size_t i = 0; i < m; ++i)
      A[m * j + i] = i < j && rows_[i].is_symmetric && rows_[j].is_symmetric
                         ? A[m * i + j]
                         : response(rows_[i], rows_[j]);
    double own = A[m * j + j];
    if (!rows_[j].is_symmetric) {
      Row along_gradient = rows_[j];
      along_gradient.inv_M_F = accelerations(rows_[j], rows_[j].J);
      own = response(rows_[j], along_gradient);
    }
    weight_[j] = own > 0.0 ? rows_[j].share / std::sqrt(own) : 0.0;
  }
  for (std::size_t j = 0; j < m; ++j)
    for (std::size_t i = 0; i < m; ++i) A[m * j + i] *= weight_[i] * weight_[j];
  if (!asks_rank && are_independent_) {
    factors_.factor_regular();
    return;
  }
  factors_.factor(kDependentRow);
  are_independent_ = factors_.is_regular();
}

// Solves for row forces from the changes of rows: least norm relative to the reference forces.
bool ContactEquations::solve_rows(List<double>* lambda) {
  const bool has_reference =
      !are_independent_ &&
      std::any_of(rows_.begin(), rows_.end(), [](const Row& row) { return row.reference != 0.0; });
  if (has_reference) {
    clear_motion(&reference_linear_, &reference_angular_);
    for (const Row& row : rows_) push(row, row.reference, &reference_linear_, &reference_angular_);
    for (std::size_t i = 0; i < rows_.size(); ++i)
      (*lambda)[i] -= along(rows_[i], reference_linear_, reference_angular_);
  }
  for (std::size_t i = 0; i < rows_.size(); ++i) (*lambda)[i] *= weight_[i];
  factors_.solve(lambda->data());
  bool is_finite = true;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    (*lambda)[i] *= weight_[i];
    if (has_reference && weight_[i] > 0.0) (*lambda)[i] += rows_[i].reference;
    is_finite = is_finite && std::isfinite((*lambda)[i]);
  }
  return is_finite;
}

}  // namespace constraint_sim::engine
