// Accelerations, energies and responses to impulses while the rigid joints hold, by
// ContactEquations.

#include <algorithm>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

double ContactEquations::kinetic_energy() const {
  double energy = 0.0;
  for (std::size_t i = 0; i < movable; ++i) {
    const BodyState& state = states_[i];
    energy += 0.5 * state.linear_velocity.squaredNorm() / bodies[i].mass.inverse_mass +
              0.5 * state.angular_velocity.dot(apply_inertia(
                        bodies[i].mass.inertia, state.orientation, state.angular_velocity));
  }
  return energy;
}

double ContactEquations::potential_energy() const {
  double energy = 0.0;
  for (std::size_t i = 0; i < movable; ++i)
    energy -= states_[i].position.dot(gravity / bodies[i].mass.inverse_mass + bodies[i].force);
  for (const Coordinate& of : coordinates) {
    const SoftLaw& soft = of.law.soft;
    if (of.is_prescribed || (soft.K == 0.0 && soft.F == 0.0 && of.law.servo.K == 0.0)) continue;
    const double q = read(of, nullptr).q;
    energy += 0.5 * soft.K * (q - soft.R) * (q - soft.R) - soft.F * q;
    const double stretch = q - rest(of).value;
    energy += elastic_energy(of.law.servo.K, of.law.only_pulls ? std::max(stretch, 0.0) : stretch,
                             of.law.servo_most);
  }
  return energy;
}

// Largest force of the group [N], with kLeast as the least acceleration: the share kForceShare of
// it counts as rounding.
double ContactEquations::largest_force() const {
  constexpr double kLeast = 0.1;  // [m/s²]
  double largest = 0.0;
  for (std::size_t i = 0; i < movable; ++i)
    largest = std::max(largest, std::max(gravity.norm(), kLeast) / bodies[i].mass.inverse_mass +
                                    bodies[i].force.norm());
  for (const Vector3d& force : stages_[0].contact) largest = std::max(largest, force.norm());
  for (std::size_t c = 0; c < coordinates.size(); ++c)
    if (!coordinates[c].law.form.is_angle)
      largest = std::max(largest, std::abs(stages_[0].coordinate[c]));
  return largest;
}

void ContactEquations::find_accelerations(const double* dydt, Accelerations* rates) const {
  rates->linear.assign(bodies.size(), Vector3d::Zero());
  rates->angular.assign(bodies.size(), Vector3d::Zero());
  for (std::size_t i = 0; i < movable; ++i) {
    const double* const body = dydt + kNumbers * i;
    rates->linear[i] = ConstVector(body + kV);
    const Vector3d& w = states_[i].angular_velocity;
    const Vector3d L = apply_inertia(bodies[i].mass.inertia, states_[i].orientation, w);
    rates->angular[i] = inverse_inertia_[i] * (ConstVector(body + kL) - Vector3d(w.cross(L)));
  }
}

Vector3d ContactEquations::slip_acceleration(const ContactMotion& motion, const Contact& contact,
                                             const Accelerations& rates) {
  return rates.linear[contact.a] + rates.angular[contact.a].cross(motion.r_a) -
         rates.linear[contact.b] - rates.angular[contact.b].cross(motion.r_b) + motion.w_bias;
}

// Numbers the columns, and adds a unit impulse for each column to directions_.
void ContactEquations::add_directions(Responses* responses) {
  directions_.clear();
  const auto add = [&](std::size_t a, std::size_t b, const Jacobian& J) {
    Row& row = directions_.emplace_back();
    row.a = a;
    row.b = b;
    row.J = J;
    row.inv_M_F = accelerations(row, J);
  };
  for (const bool is_rough : {true, false}) {
    for (Touching& touching : responses->contacts) {
      const Contact& contact = contacts[touching.contact];
      if ((contact.friction > 0.0) != is_rough) continue;
      const Vector3d& n = touching.motion.n;
      touching.is_rough = is_rough;
      touching.column = directions_.size();
      touching.frame.col(0) = n;
      add(contact.a, contact.b, touching.motion.along(n));
      if (!is_rough) continue;
      touching.frame.col(1) = tangent_to(n);
      touching.frame.col(2) = n.cross(Vector3d(touching.frame.col(1)));
      for (int k = 1; k < 3; ++k)
        add(contact.a, contact.b, touching.motion.along(touching.frame.col(k)));
    }
  }
  responses->of_contacts = directions_.size();
  for (const std::size_t c : responses->coordinates) {
    const BodyJoint& joint = joints[coordinates[c].joint];
    add(joint.a, joint.b, read(coordinates[c], nullptr).J);
  }
  responses->columns = directions_.size();
}

void ContactEquations::find_responses(Responses* responses) {
  add_directions(responses);
  rows_.clear();
  add_joint_rows();
  const std::size_t n = responses->columns, held = rows_.size();
  for (Row& row : rows_) row.reference = 0.0;
  if (held > 0) factor_rows(true);
  responses->is_free.clear();
  responses->velocity.assign(6 * movable * n, 0.0);
  responses->joints.assign(held * n, 0.0);
  responses->A.resize(n * n);
  for (std::size_t j = 0; j < n; ++j) {
    clear_motion(&linear_, &angular_);
    push(directions_[j], 1.0, &linear_, &angular_);
    const double free = along(directions_[j], linear_, angular_);
    if (held > 0) {
      lambda_.resize(held);
      for (std::size_t i = 0; i < held; ++i) lambda_[i] = -along(rows_[i], linear_, angular_);
      solve_rows(&lambda_);
      for (std::size_t i = 0; i < held; ++i) push(rows_[i], lambda_[i], &linear_, &angular_);
      std::copy(lambda_.begin(), lambda_.end(),
                responses->joints.begin() + static_cast<std::ptrdiff_t>(held * j));
    }
    double* const velocity = responses->velocity.data() + 6 * movable * j;
    for (std::size_t i = 0; i < movable; ++i) {
      Vector(velocity + 6 * i) = linear_[i];
      Vector(velocity + 6 * i + 3) = angular_[i];
    }
    for (std::size_t i = 0; i < n; ++i)
      responses->A[n * j + i] = along(directions_[i], linear_, angular_);
    if (j >= responses->of_contacts)
      responses->is_free.push_back(responses->A[n * j + j] > kHeld * free ? 1 : 0);
  }
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < j; ++i)
      responses->A[n * j + i] = responses->A[n * i + j] =
          0.5 * (responses->A[n * j + i] + responses->A[n * i + j]);
}

void ContactEquations::displace(const Responses& responses, const double* p, double* y) {
  for (std::size_t i = 0; i < movable; ++i) {
    Vector3d moved = Vector3d::Zero(), turned = Vector3d::Zero();
    for (std::size_t j = 0; j < responses.columns; ++j) {
      const double* const velocity = responses.velocity.data() + 6 * (movable * j + i);
      moved += p[j] * ConstVector(velocity);
      turned += p[j] * ConstVector(velocity + 3);
    }
    double* const body = y + kNumbers * i;
    Vector(body) += moved;
    Eigen::Map<Eigen::Quaterniond> q(body + kQ);
    q = rotation(turned) * Eigen::Quaterniond(q);
  }
  place(y);
}

void ContactEquations::apply(const Responses& responses, const double* p, double* y) {
  clear_motion(&linear_, &angular_);
  const std::size_t n = responses.columns, held = n > 0 ? responses.joints.size() / n : 0;
  for (std::size_t j = 0; j < n; ++j) {
    const double* const velocity = responses.velocity.data() + 6 * movable * j;
    for (std::size_t i = 0; i < movable; ++i) {
      linear_[i] += p[j] * ConstVector(velocity + 6 * i);
      angular_[i] += p[j] * ConstVector(velocity + 6 * i + 3);
    }
    for (std::size_t i = 0; i < held; ++i)
      joints[static_cast<std::size_t>(rows_[i].joint)].impulse[rows_[i].function] +=
          p[j] * responses.joints[held * j + i];
    if (!has_movers()) continue;
    driven_work += p[j] * driven_power(directions_[j].a, directions_[j].b, directions_[j].J);
    for (std::size_t i = 0; i < held; ++i)
      driven_work += p[j] * responses.joints[held * j + i] * driven_power(rows_[i]);
  }
  for (std::size_t i = 0; i < movable; ++i) {
    double* const body = y + kNumbers * i;
    Vector(body + kV) += linear_[i];
    if (bodies[i].mass.can_turn())
      Vector(body + kL) +=
          apply_inertia(bodies[i].mass.inertia, states_[i].orientation, angular_[i]);
  }
  for (std::size_t k = 0; k < responses.coordinates.size(); ++k) {
    const Coordinate& of = coordinates[responses.coordinates[k]];
    joints[of.joint].impulse[of.law.function] += p[responses.of_contacts + k];
  }
  for (const Touching& touching : responses.contacts) {
    Contact& contact = contacts[touching.contact];
    contact.impulse += touching.frame * touching.of(p);
    contact.touched = contact.feature;
  }
  place(y);
}

}  // namespace constraint_sim::engine
