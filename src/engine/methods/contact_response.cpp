// What events ask of ContactEquations: accelerations, energies, and what impulses of contacts do
// while the rigid joints hold.

#include <algorithm>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/methods/contact_equations.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kHeld = 1e-12;  // of what a coordinate would do without the joints

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
    energy += elastic_energy(of.law.servo.K, q - rest(of).value, of.law.servo_most);
  }
  return energy;
}

double ContactEquations::largest_force() const {
  double largest = 0.0;
  for (std::size_t i = 0; i < movable; ++i)
    largest =
        std::max(largest, gravity.norm() / bodies[i].mass.inverse_mass + bodies[i].force.norm());
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

ContactEquations::Responses ContactEquations::responses(
    const std::vector<std::size_t>& of, const std::vector<std::size_t>& of_coordinates) {
  Responses result;
  result.contacts = of;
  result.coordinates = of_coordinates;
  const Index n = 3 * index(of.size()) + index(of_coordinates.size());
  result.velocity.setZero(6 * index(movable), n);
  rows_.clear();
  add_joint_rows();
  const Index held = index(rows_.size());
  if (held > 0) factor_rows(true);
  for (const Row& row : rows_)
    result.rows.emplace_back(static_cast<std::size_t>(row.joint), row.function);
  result.joints.setZero(held, n);
  result.A.resize(n, n);
  std::vector<Row> directions;
  for (const std::size_t c : of) {
    const ContactMotion now = motion(contacts[c]);
    Matrix3d frame;
    frame.col(0) = now.n;
    frame.col(1) = tangent_to(now.n);
    frame.col(2) = now.n.cross(Vector3d(frame.col(1)));
    result.frames.push_back(frame);
    for (int k = 0; k < 3; ++k) {
      Row& row = directions.emplace_back();
      row.a = contacts[c].a;
      row.b = contacts[c].b;
      row.J = row.F = now.along(frame.col(k));
    }
  }
  for (const std::size_t c : of_coordinates) {
    Row& row = directions.emplace_back();
    row.a = joints[coordinates[c].joint].a;
    row.b = joints[coordinates[c].joint].b;
    row.J = row.F = read(coordinates[c], nullptr).J;
  }
  VectorXd right(held), lambda;
  for (Index j = 0; j < n; ++j) {
    std::vector<Vector3d> linear(movable, Vector3d::Zero()), angular = linear;
    const Row& row = directions[static_cast<std::size_t>(j)];
    push(row, row.F, 1.0, &linear, &angular);
    const double free = along(row, row.J, linear, angular);
    if (held > 0) {
      for (Index i = 0; i < held; ++i) {
        Row& joint = rows_[static_cast<std::size_t>(i)];
        right[i] = -along(joint, joint.J, linear, angular);
      }
      solve_rows(right, &lambda);
      for (Index i = 0; i < held; ++i) {
        const Row& joint = rows_[static_cast<std::size_t>(i)];
        push(joint, joint.F, lambda[i], &linear, &angular);
      }
      result.joints.col(j) = lambda;
    }
    for (std::size_t i = 0; i < movable; ++i) {
      result.velocity.block<3, 1>(6 * index(i), j) = linear[i];
      result.velocity.block<3, 1>(6 * index(i) + 3, j) = angular[i];
    }
    for (Index i = 0; i < n; ++i) {
      const Row& other = directions[static_cast<std::size_t>(i)];
      result.A(i, j) = along(other, other.J, linear, angular);
    }
    if (j >= 3 * index(of.size())) result.is_free.push_back(result.A(j, j) > kHeld * free ? 1 : 0);
  }
  result.A = (0.5 * (result.A + result.A.transpose())).eval();
  return result;
}

void ContactEquations::apply(const Responses& responses, const VectorXd& p, double* y) {
  const VectorXd change = responses.velocity * p;
  for (std::size_t i = 0; i < movable; ++i) {
    double* const body = y + kNumbers * i;
    Vector(body + kV) += change.segment<3>(6 * index(i));
    if (bodies[i].mass.can_turn())
      Vector(body + kL) += apply_inertia(bodies[i].mass.inertia, states_[i].orientation,
                                         change.segment<3>(6 * index(i) + 3));
  }
  const VectorXd held = responses.joints * p;
  for (std::size_t i = 0; i < responses.rows.size(); ++i)
    joints[responses.rows[i].first].impulse[responses.rows[i].second] += held[index(i)];
  const Index first = 3 * index(responses.contacts.size());
  for (std::size_t k = 0; k < responses.coordinates.size(); ++k) {
    const Coordinate& of = coordinates[responses.coordinates[k]];
    joints[of.joint].impulse[of.law.function] += p[first + index(k)];
  }
  for (std::size_t c = 0; c < responses.contacts.size(); ++c) {
    Contact& contact = contacts[responses.contacts[c]];
    contact.impulse += responses.frames[c] * p.segment<3>(3 * index(c));
    contact.touched = contact.feature;
  }
  place(y);
}

}  // namespace constraint_sim::engine
