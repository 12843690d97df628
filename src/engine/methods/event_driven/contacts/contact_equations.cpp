#include "engine/methods/event_driven/contacts/contact_equations.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint_load.h"
#include "engine/math/larger.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kMostProjections = 12;
// Share of the scale; a row with a larger error is not met.
constexpr double kContactsProjected = 1e-12;
// Multiple of the rounding of one row up to which errors of a chain of joints are left alone:
// corrections would only replace the last bits, and bodies at rest keep theirs.
constexpr double kLeftAlone = 16.0;
// Size below which an error of x rad of a row between axes counts like an error of x times the size
// divided by kSmallSize [m]: rounding of angles is no share of the size.
constexpr double kSmallSize = 0.01;
// Slower slips have the direction at the start of the substep [m/s].
constexpr double kSlowSlip = 0.5e-9;

// Error of a row between axes [rad] or points [m], in a group with the scale `size` [m].
double error_of(const ContactRow& row, double size) {
  const bool is_angle = row.J.j1.isZero(0.0) && row.J.j3.isZero(0.0);
  return std::abs(row.value) * (is_angle ? std::min(size / kSmallSize, 1.0) : 1.0);
}

}  // namespace

void ContactEquations::prepare_stages() {
  for (const Contact& contact : contacts_) {
    bodies_.enlarge_scale(std::max(contact.feature.on_a.norm(), contact.feature.radius_a));
    if (contact.feature.kind == ContactFeature::Kind::kPlaneOfA ||
        contact.feature.kind == ContactFeature::Kind::kEdges)
      bodies_.enlarge_scale(contact.feature.on_b.norm());
  }
  for (Stage& stage : stages_) {
    stage.contact.resize(contacts_.size());
    stage.normal.resize(contacts_.size());
    stage.coordinate.resize(joints_.coordinates().size());
    stage.joint.resize(joints_.list().size());
  }
  stages_[0].clear();  // derivative() clears the others
}

void ContactEquations::Stage::clear() {
  std::fill(contact.begin(), contact.end(), Vector3d::Zero());
  std::fill(normal.begin(), normal.end(), 0.0);
  std::fill(coordinate.begin(), coordinate.end(), 0.0);
  std::fill(joint.begin(), joint.end(), GroupForces{});
  driven_power = 0.0;
}

// ---- rows

// Lists the rows that act. `with_slip`: forces of slipping contacts include friction.
void ContactEquations::set_rows(bool with_slip, bool with_tangents) {
  rows_.clear();
  joints_.add_rows(bodies_, &rows_);
  joints_.add_held_rows(bodies_, &rows_);
  for (std::size_t c = 0; c < contacts_.size(); ++c)
    if (contacts_[c].acts != Acts::kOpen) add_contact_rows(c, with_slip, with_tangents);
}

// Adds the rows of an acting contact: normal, and tangents of a sticking contact.
void ContactEquations::add_contact_rows(std::size_t c, bool with_slip, bool with_tangents) {
  const Contact& contact = contacts_[c];
  const ContactMotion now = motion(contact);
  const auto add = [&](const Vector3d& d) -> ContactRow& {
    ContactRow& row = rows_.add(bodies_, contact.a, contact.b, now.along(d));
    row.along = d;
    row.rate = d.dot(now.w);
    row.gamma = d.dot(now.w_bias);
    row.contact = static_cast<int>(c);
    row.reference = contact.reference.dot(d);
    row.share = contact.tangent_share;
    return row;
  };
  ContactRow& normal = add(now.n);
  normal.is_normal = true;
  normal.share = contact.normal_share;
  normal.value = now.gap;
  normal.gamma += now.n_dot.dot(now.w);
  const bool has_direction = contact.acts == Acts::kSlips && contact.friction > 0.0;
  Vector3d direction = contact.direction;
  if (is_straight_ && has_direction && !direction.isZero(0.0))
    direction = (direction - direction.dot(now.n) * now.n).normalized();
  if (with_slip && has_direction) {
    const Vector3d slip = now.slip();
    const double speed = slip.norm();
    if ((speed > kSlowSlip && !is_straight_) || direction.isZero(0.0)) {
      direction = speed > 0.0 ? Vector3d(slip / speed) : Vector3d(Vector3d::Zero());
      if (direction.dot(contact.direction) < 0.0) direction = -direction;
    }
    normal.along -= contact.friction * direction;
    normal.inv_M_F = bodies_.accelerations(contact.a, contact.b, now.along(normal.along));
    normal.is_symmetric = false;
  }
  if (!with_tangents) return;
  if (is_straight_ && has_direction && !contact.direction.isZero(0.0)) add(now.n.cross(direction));
  if (contact.acts != Acts::kSticks) return;
  const Vector3d t = tangent_to(now.n);
  add(t);
  add(now.n.cross(t));
}

// Power of kinematic bodies by a unit force of a row.
double ContactEquations::driven_power(const ContactRow& row) const {
  if (row.contact < 0) return row.driven_power(bodies_);
  return bodies_.driven_power(row.a, row.b, motion(contacts_[row.contact]).along(row.along));
}

// ---- System

void ContactEquations::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  bodies_.set_time(t);
  bodies_.place(y);
  bodies_.find_free_accelerations(y, &free_);
  set_rows(true, true);
  Stage& forces = stages_[stage];
  forces.clear();
  if (!rows_.list().empty()) rows_.factor(bodies_, stage == 0);
  pushed_.set_zero(bodies_.movable());
  const bool are_pushed = joints_.has_free_forces() && add_soft_forces(&forces);
  if (!rows_.list().empty()) solve_forces(are_pushed, &forces);
  bodies_.write_derivative(y, free_, pushed_, dydt);
}

// Adds the forces of springs, dampers, laws at their bounds and other packages. Returns whether
// there are any.
bool ContactEquations::add_soft_forces(Stage* forces) {
  bool any = false;
  for (const GroupCoordinate& of : joints_.coordinates()) {
    if (of.is_prescribed || !of.has_free_force()) continue;
    const GroupJoints::Reading now = joints_.read(bodies_, of, nullptr);
    const double force = joints_.free_force(bodies_, of, now);
    if (force == 0.0) continue;
    any = true;
    const ContactRowPart row(bodies_, joints_[of.joint].a, joints_[of.joint].b, now.J);
    row.push(force, bodies_.movable(), &pushed_);
    if (bodies_.has_movers())
      forces->driven_power += force * bodies_.driven_power(row.a, row.b, now.J);
    forces->joint[of.joint].at(of.law) += force;
  }
  for (const GroupJoint& joint : joints_.list()) {
    if (!is_custom_force(joint.joint.kind)) continue;
    any = true;
    const Jacobian F =
        custom_wrench(joint.joint, bodies_.state(joint.a), bodies_.state(joint.b), bodies_.clock());
    ContactRowPart(bodies_, joint.a, joint.b, F).push(1.0, bodies_.movable(), &pushed_);
    if (bodies_.has_movers()) forces->driven_power += bodies_.driven_power(joint.a, joint.b, F);
  }
  return any;
}

// Solves for the forces of the rows, and adds them. `are_pushed`: whether other forces act.
void ContactEquations::solve_forces(bool are_pushed, Stage* forces) {
  const List<ContactRow>& rows = rows_.list();
  const std::size_t movable = bodies_.movable();
  lambda_.resize(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    lambda_[i] = -rows[i].gamma - rows[i].times(free_, movable);
    if (are_pushed) lambda_[i] -= rows[i].times(pushed_, movable);
  }
  if (!rows_.solve(movable, &lambda_)) std::fill(lambda_.begin(), lambda_.end(), std::nan(""));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const ContactRow& row = rows[i];
    row.push(lambda_[i], movable, &pushed_);
    if (bodies_.has_movers()) forces->driven_power += lambda_[i] * driven_power(row);
    if (row.contact >= 0) {
      forces->contact[row.contact] += lambda_[i] * row.along;
      if (row.is_normal) forces->normal[row.contact] = lambda_[i];
    } else {
      forces->joint[row.joint].at(row.function) += lambda_[i];
      if (row.coordinate >= 0) forces->coordinate[row.coordinate] = lambda_[i];
    }
  }
}

bool ContactEquations::project(double t, double* y) {
  bodies_.set_time(t);
  double before = kInfinity;
  for (int k = 0;; ++k) {
    for (std::size_t i = 0; i < bodies_.movable(); ++i)
      if (!GroupBodies::normalize(i, y)) return false;
    bodies_.place(y);
    set_rows(false, false);
    double error = 0.0;
    for (const ContactRow& row : rows_.list())
      error = larger(error, error_of(row, bodies_.scale()));
    const double left = k == 0 && !joints_.list().empty() ? kLeftAlone : 1.0;
    if (error <= left * kEpsilon * bodies_.scale()) return true;
    if (!(error <= 0.5 * before) || k == kMostProjections)
      return error <= kContactsProjected * bodies_.scale();
    before = error;
    if (!rows_.find_change(bodies_, &ContactRow::value, &pushed_)) return false;
    for (std::size_t i = 0; i < bodies_.movable(); ++i)
      GroupBodies::displace(i, pushed_.linear[i], pushed_.angular[i], y);
  }
}

std::optional<double> ContactEquations::fit_joints(double* y, double least) {
  bodies_.place(y);
  rows_.clear();
  joints_.add_rows(bodies_, &rows_);
  joints_.add_held_rows(bodies_, &rows_);
  double greatest = 0.0;
  for (const ContactRow& row : rows_.list()) greatest = larger(greatest, std::abs(row.rate));
  if (greatest <= least) return 0.0;
  const double before = bodies_.kinetic_energy();
  if (!rows_.find_change(bodies_, &ContactRow::rate, &pushed_)) return std::nullopt;
  bodies_.add_velocities(pushed_, y);
  bodies_.place(y);
  return before - bodies_.kinetic_energy();
}

bool ContactEquations::restart(double* y, double* dydt, const double* known) {
  bodies_.place(y);
  set_rows(false, true);
  const List<ContactRow>& rows = rows_.list();
  const bool is_off =
      std::any_of(rows.begin(), rows.end(), [](const ContactRow& row) { return row.rate != 0.0; });
  if (is_off) {
    if (!rows_.find_change(bodies_, &ContactRow::rate, &pushed_)) return false;
    bodies_.add_velocities(pushed_, y);
  }
  if (known != nullptr && !is_off)
    std::copy_n(known, size(), dydt);
  else
    derivative(0, bodies_.time(), y, dydt);
  return true;
}

void ContactEquations::add_impulses(double weight, std::size_t stage) {
  for (std::size_t c = 0; c < contacts_.size(); ++c) {
    if (contacts_[c].acts == Acts::kOpen) continue;
    contacts_[c].impulse += weight * stages_[stage].contact[c];
    contacts_[c].touched = contacts_[c].feature;
  }
  List<GroupJoint>& joints = joints_.list();
  for (std::size_t j = 0; j < joints.size(); ++j)
    joints[j].impulse.add(weight, stages_[stage].joint[j]);
  driven_work_ += weight * stages_[stage].driven_power;
}

// ---- queries

Vector3d ContactEquations::slip_acceleration(const ContactMotion& motion, const Contact& contact,
                                             const GroupMotions& rates) {
  return rates.linear[contact.a] + rates.angular[contact.a].cross(motion.r_a) -
         rates.linear[contact.b] - rates.angular[contact.b].cross(motion.r_b) + motion.w_bias;
}

double ContactEquations::potential_energy() const {
  double energy = 0.0;
  for (std::size_t i = 0; i < bodies_.movable(); ++i)
    energy -= bodies_.state(i).position.dot(bodies_[i].mass.weight_share * bodies_.gravity() /
                                                bodies_[i].mass.inverse_mass +
                                            bodies_[i].force);
  for (const GroupCoordinate& of : joints_.coordinates()) {
    const SoftLaw& soft = of.law.soft;
    if (of.is_prescribed || (soft.K == 0.0 && soft.F == 0.0 && of.law.servo.K == 0.0)) continue;
    const double q = joints_.read(bodies_, of, nullptr).q;
    energy += 0.5 * soft.K * (q - soft.R) * (q - soft.R) - soft.F * q;
    const double stretch = q - joints_.rest(bodies_, of).value;
    energy += elastic_energy(of.law.servo.K, of.law.only_pulls ? std::max(stretch, 0.0) : stretch,
                             of.law.servo_most);
  }
  return energy;
}

bool ContactEquations::are_rows_straight() const {
  constexpr double kStraight = 1e-9;  // [m/s² or rad/s²]
  return std::none_of(rows_.list().begin(), rows_.list().end(),
                      [](const ContactRow& row) { return std::abs(row.gamma) > kStraight; });
}

double ContactEquations::largest_force() const {
  constexpr double kLeastAcceleration = 0.1;  // [m/s²] least acceleration that counts
  const double acceleration = std::max(bodies_.gravity().norm(), kLeastAcceleration);
  double largest = 0.0;
  for (std::size_t i = 0; i < bodies_.movable(); ++i)
    largest =
        std::max(largest, acceleration / bodies_[i].mass.inverse_mass + bodies_[i].force.norm());
  for (const Vector3d& force : stages_[0].contact) largest = std::max(largest, force.norm());
  const List<GroupCoordinate>& coordinates = joints_.coordinates();
  for (std::size_t c = 0; c < coordinates.size(); ++c)
    if (!coordinates[c].law.form.is_angle)
      largest = std::max(largest, std::abs(stages_[0].coordinate[c]));
  return largest;
}

// ---- repeated substeps

void ContactEquations::keep() {
  kept_.stage = stages_[0];
  kept_.work = driven_work_;
  kept_.contacts.clear();
  kept_.touched.clear();
  kept_.joints.clear();
  for (const Contact& contact : contacts_) {
    kept_.contacts.push_back(contact.impulse);
    kept_.touched.push_back(contact.touched);
  }
  for (const GroupJoint& joint : joints_.list()) kept_.joints.push_back(joint.impulse);
}

void ContactEquations::restore() {
  stages_[0] = kept_.stage;
  driven_work_ = kept_.work;
  for (std::size_t c = 0; c < contacts_.size(); ++c) {
    contacts_[c].impulse = kept_.contacts[c];
    contacts_[c].touched = kept_.touched[c];
  }
  for (std::size_t j = 0; j < joints_.list().size(); ++j)
    joints_.list()[j].impulse = kept_.joints[j];
}

}  // namespace constraint_sim::engine
