// Last stage of RowSolver: positions, and removal of correction velocities.

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/impulses/row_solver.h"
#include "engine/math/elementary.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Rotates a body for h without torque. With L' = L_B × ω in the body frame, a rotation about I⁻¹
// (L₀ + L₁) from L₀ to L₁ conserves the energy and L in the world exactly; the angle is that of a
// uniform rotation. Newton's method finds L₁. A body that rotates too far in one step for that
// rotates about L.
void turn(const MassProperties& mass, double h, BodyState* body) {
  const Quaterniond q_0 = body->orientation;
  const Vector3d w = q_0.conjugate() * body->angular_velocity;
  const Vector3d L_0 = mass.inertia.cwiseProduct(w);
  const Vector3d L_W = q_0 * L_0;
  const double speed = w.norm();
  const double half_angle = 0.5 * h * speed;
  bool is_found = false;
  Vector3d half_turn;  // axis of the step in the body frame, with length tan of half the angle
  if (half_angle < 1.0) {
    const auto [sine, cosine] = math::sin_cos(half_angle);
    const double scale = half_angle > 1e-4 ? sine / (cosine * speed)
                                           : 0.5 * h * (1.0 + half_angle * half_angle / 3.0);
    const auto cross = [](const Vector3d& x) {
      Matrix3d m;
      m << 0.0, -x.z(), x.y(), x.z(), 0.0, -x.x(), -x.y(), x.x(), 0.0;
      return m;
    };
    Vector3d mean = L_0;  // ½ (L₀ + L₁)
    for (int step = 0; step < 8 && !is_found; ++step) {
      const Vector3d w_mean = mass.inverse_inertia.cwiseProduct(mean);
      const Vector3d error = mean - L_0 - scale * mean.cross(w_mean);
      const Matrix3d derivative =
          Matrix3d::Identity() +
          scale * (cross(w_mean) - cross(mean) * mass.inverse_inertia.asDiagonal());
      const Vector3d change = derivative.inverse() * error;
      mean -= change;
      is_found = change.squaredNorm() <= 1e-30 * L_0.squaredNorm();
    }
    half_turn = scale * mass.inverse_inertia.cwiseProduct(mean);
  }
  if (is_found) {
    const Quaterniond turned(1.0, half_turn.x(), half_turn.y(), half_turn.z());
    body->orientation = (q_0 * turned).normalized();
  } else {
    const Vector3d axis = L_W.normalized();
    body->orientation = (rotation(h * body->angular_velocity.dot(axis) * axis) * q_0).normalized();
  }
  body->angular_velocity = apply_inertia(mass.inverse_inertia, body->orientation, L_W);
}

// Rotates a body by the vector `angle` at constant angular momentum. Returns the energy gained [J].
double turn_at_rest(const MassProperties& mass, const Vector3d& angle, BodyState* body) {
  const Quaterniond q_0 = body->orientation;
  body->orientation = (rotation(angle) * q_0).normalized();
  if (!mass.can_turn() || mass.is_isotropic()) return 0.0;
  const Vector3d L = apply_inertia(mass.inertia, q_0, body->angular_velocity);
  const double before = 0.5 * L.dot(body->angular_velocity);
  body->angular_velocity = apply_inertia(mass.inverse_inertia, body->orientation, L);
  return 0.5 * L.dot(body->angular_velocity) - before;
}

// Inverse of an inertia with 1e-12 of its trace added to the diagonal. Points in a line have
// neither a moment of inertia nor an angular momentum about the line, a single point about no axis.
// A power of two keeps the determinant within the range of numbers.
Matrix3d regularized_inverse(const Matrix3d& inertia) {
  const double trace = inertia.trace();
  if (!(trace > 0.0)) return Matrix3d::Zero();
  const double scale = std::ldexp(1.0, -std::ilogb(trace));
  const Matrix3d scaled = scale * (inertia + 1e-12 * trace * Matrix3d::Identity());
  return scale * scaled.inverse();
}

// Angular momentum of a body about its centre.
Vector3d spin(const MassProperties& mass, const BodyState& body, const Vector3d& w) {
  if (!mass.can_turn()) return Vector3d::Zero();
  return apply_inertia(mass.inertia, body.orientation, w);
}

}  // namespace

void advance_orientation(const MassProperties& mass, double h, BodyState* body) {
  if (body->angular_velocity.isZero(0.0)) return;
  if (mass.can_turn() && !mass.is_isotropic())
    turn(mass, h, body);
  else
    body->orientation = (rotation(h * body->angular_velocity) * body->orientation).normalized();
}

double RowSolver::update_positions(const List<int>& moved, const Masses& masses,
                                   const Vector3d& gravity, double h, Bodies& bodies) {
  double work = 0.0;
  spring_work_ = 0.0;
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    BodyState& body = bodies[i];
    body.linear_velocity = velocities_[i].head<3>();
    body.angular_velocity = velocities_[i].tail<3>();
    // Without a correction a body moves as it does where no other body has one, to the last bit.
    const bool is_corrected = any_corrections_ && !corrections_[i].isZero(0.0);
    Vector3d L_correction = Vector3d::Zero();
    if (is_corrected) {
      const Vector3d w = corrections_[i].head<3>();
      body.position += h * w;
      work -= h * masses[i].weight_share * w.dot(gravity) / masses[i].inverse_mass;
      if (masses[i].can_turn()) {
        const Vector3d w_angular = corrections_[i].tail<3>();
        L_correction = apply_inertia(masses[i].inertia, body.orientation, w_angular);
        work += turn_at_rest(masses[i], h * w_angular, &body);
      }
    }
    body.position += h * body.linear_velocity;
    advance_orientation(masses[i], h, &body);
    velocities_[i].tail<3>() = body.angular_velocity;
    if (!is_corrected) continue;
    if (masses[i].can_turn())
      corrections_[i].tail<3>() =
          apply_inertia(masses[i].inverse_inertia, body.orientation, L_correction);
    body.linear_velocity += corrections_[i].head<3>();
    body.angular_velocity += corrections_[i].tail<3>();
  }
  return work;
}

// ---- removal of correction velocities

void RowSolver::finish_row(std::size_t i, const Row& row, const Jacobian& J, double C) {
  const double b = row.correction_impulse;
  if (b != 0.0) {
    effects_[row.body_a] += b * twist(row.J.j1 - J.j1, row.J.j2 - J.j2);
    effects_[row.body_b] += b * twist(row.J.j3 - J.j3, row.J.j4 - J.j4);
  }
  if (row.stiffness == 0.0) return;
  double by_v = row.C + h_ * responses_[i].rate;
  double by_all = by_v + h_ * responses_[i].correction_rate;
  if (row.upper == 0.0) {  // a spring that only pulls
    by_v = std::max(by_v, 0.0);
    by_all = std::max(by_all, 0.0);
  }
  Component& part = components_[responses_[i].component];
  part.work += 0.5 * row.stiffness * (C * C - by_all * by_all);
  spring_work_ += 0.5 * row.stiffness * (by_all * by_all - by_v * by_v);
}

// Finds the velocities that the next step removes: w as impulses along the Jacobians after the
// step. The difference to w returns kinetic energy that motion along straight lines lost, at most
// the loss of the component. A component whose springs gained energy along curved paths is damped.
double RowSolver::take_out_corrections(const List<int>& moved, const Masses& masses,
                                       const Bodies& bodies, List<Twist>* corrections) {
  for (const int body : moved) {
    Component& part = components_[body];
    part.linear = part.quadratic = part.damping = 0.0;
    part.scale = 1.0;
  }
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const Twist momentum = effects_[i];
    Twist& change = effects_[i];
    change.head<3>() *= masses[i].inverse_mass;
    if (masses[i].can_turn())
      change.tail<3>() =
          apply_inertia(masses[i].inverse_inertia, bodies[i].orientation, momentum.tail<3>());
    Component& part = components_[component_of(index)];
    part.linear += momentum.dot(velocities_[i]);
    part.quadratic += 0.5 * momentum.dot(change);
  }
  bool any_limited = false;
  for (const int body : moved) {
    Component& part = components_[body];
    if (parents_[body] != body) continue;
    const double lost = part.absorbed - part.work;
    part.gains = part.has_springs && lost < 0.0;
    if (lost <= 0.0)
      part.scale = 0.0;
    else if (part.linear + part.quadratic > lost)
      part.scale = largest_scale(part.quadratic, part.linear, lost);
    any_limited = any_limited || part.gains || part.scale < 1.0;
  }
  double work = spring_work_;
  if (any_limited) work += limit_changes(moved, masses, bodies);
  work += keep_angular_momentum(moved, masses, bodies);
  for (const int body : moved) (*corrections)[body] = corrections_[body] - effects_[body];
  return work;
}

// Sums up mass, centre, inertia, momenta and kinetic energy of each component as of one rigid body,
// and the angular momentum of the pending changes of velocity.
void RowSolver::gather_rigid(const List<int>& moved, const Masses& masses, const Bodies& bodies) {
  rigid_.resize(components_.size());
  for (const int body : moved) rigid_[body] = Rigid{};
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    Rigid& rigid = rigid_[component_of(index)];
    const double mass = 1.0 / masses[i].inverse_mass;
    rigid.mass += mass;
    rigid.centre += mass * bodies[i].position;
    rigid.velocity += mass * velocities_[i].head<3>();
  }
  for (const int index : moved) {
    if (parents_[index] != index) continue;
    rigid_[index].centre /= rigid_[index].mass;
    rigid_[index].velocity /= rigid_[index].mass;
  }
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    Rigid& rigid = rigid_[component_of(index)];
    const double mass = 1.0 / masses[i].inverse_mass;
    const Vector3d r = bodies[i].position - rigid.centre;
    const Vector3d w = velocities_[i].tail<3>();
    const Vector3d L = spin(masses[i], bodies[i], w);
    rigid.L += mass * r.cross(velocities_[i].head<3>()) + L;
    rigid.L_of_changes +=
        mass * r.cross(effects_[i].head<3>()) + spin(masses[i], bodies[i], effects_[i].tail<3>());
    rigid.inertia += mass * (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose());
    rigid.energy += 0.5 * (mass * velocities_[i].head<3>().squaredNorm() + L.dot(w));
    if (!masses[i].can_turn()) continue;
    const Matrix3d R = bodies[i].orientation.toRotationMatrix();
    rigid.inertia += R * masses[i].inertia.asDiagonal() * R.transpose();
  }
}

// Scales the changes of velocities, and damps components that gained energy. A component that no
// row connects with an immovable body gets the lost momenta back as a rigid motion of the
// component. Returns the work of the angular momentum that corrections left [J].
double RowSolver::limit_changes(const List<int>& moved, const Masses& masses,
                                const Bodies& bodies) {
  gather_rigid(moved, masses, bodies);
  for (const int body : moved) {
    Component& part = components_[body];
    Rigid& rigid = rigid_[body];
    if (parents_[body] != body) continue;
    const Matrix3d inverse = regularized_inverse(rigid.inertia);
    if (part.gains) {
      if (!part.is_attached)
        rigid.energy -=
            0.5 * (rigid.mass * rigid.velocity.squaredNorm() + rigid.L.dot(inverse * rigid.L));
      const double share = rigid.energy > 0.0 ? (part.work - part.absorbed) / rigid.energy : 1.0;
      part.damping = 1.0 - std::sqrt(std::max(0.0, 1.0 - share));
    }
    rigid.velocity *= part.is_attached ? 0.0 : part.damping;
    rigid.turning = inverse * (part.damping * rigid.L);
    rigid.turning_of_changes = (1.0 - part.scale) * (inverse * rigid.L_of_changes);
    if (part.is_attached) rigid.turning = rigid.turning_of_changes = Vector3d::Zero();
  }
  double work = 0.0;
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const Component& part = components_[component_of(index)];
    const Rigid& rigid = rigid_[component_of(index)];
    const Vector3d r = bodies[i].position - rigid.centre;
    effects_[i] = part.scale * effects_[i] - part.damping * velocities_[i] +
                  twist(rigid.velocity + rigid.turning.cross(r), rigid.turning);
    const Vector3d w = rigid.turning_of_changes;
    if (w.isZero(0.0)) continue;
    const Twist change = twist(w.cross(r), w);
    const Twist mean = velocities_[i] + effects_[i] + 0.5 * change;
    work += change.head<3>().dot(mean.head<3>()) / masses[i].inverse_mass;
    work += w.dot(spin(masses[i], bodies[i], mean.tail<3>()));
    effects_[i] += change;
  }
  for (const int index : moved)
    if (!masses[index].can_turn()) effects_[index].tail<3>().setZero();
  return work;
}

// Finds the angular momentum that correction velocities w add to components that no row connects
// with an immovable body, and removes it by a rigid rotation of the component. A displacement h w
// at a velocity v changes x × m v. finish_row() takes back the share of joints, by their Jacobians
// after the step; contacts may have ended and have none. Returns the work [J].
double RowSolver::keep_angular_momentum(const List<int>& moved, const Masses& masses,
                                        const Bodies& bodies) {
  constexpr double kKept = 1e-9;  // share of Σ m h ‖w‖ ‖v‖ that is rounding
  bool any = false;
  for (const int body : moved) components_[body].lost = {};
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const int root = component_of(index);
    Component& part = components_[root];
    if (part.is_attached || !part.corrects) continue;
    const double mass = 1.0 / masses[i].inverse_mass;
    const Vector3d moment = mass * h_ * velocities_[i].head<3>();
    const Vector3d r = bodies[i].position - bodies[to_index(root)].position;
    part.lost.L += moment.cross(corrections_[i].head<3>()) - mass * r.cross(effects_[i].head<3>()) -
                   spin(masses[i], bodies[i], effects_[i].tail<3>());
    part.lost.most += moment.norm() * corrections_[i].head<3>().norm();
    any = true;
  }
  if (!any) return 0.0;
  any = false;
  for (const int body : moved) {
    LostMomentum& lost = components_[body].lost;
    lost.is_given_back = lost.L.norm() > kKept * lost.most;
    any = any || lost.is_given_back;
  }
  if (!any) return 0.0;
  gather_rigid(moved, masses, bodies);
  for (const int body : moved)
    if (components_[body].lost.is_given_back)
      rigid_[body].turning = regularized_inverse(rigid_[body].inertia) * components_[body].lost.L;
  double work = 0.0;
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const int root = component_of(index);
    if (!components_[root].lost.is_given_back) continue;
    const Vector3d w = rigid_[root].turning;
    const Twist change = twist(w.cross(Vector3d(bodies[i].position - rigid_[root].centre)),
                               masses[i].can_turn() ? w : Vector3d(Vector3d::Zero()));
    const Twist mean = velocities_[i] + effects_[i] + 0.5 * change;
    work += change.head<3>().dot(mean.head<3>()) / masses[i].inverse_mass +
            change.tail<3>().dot(spin(masses[i], bodies[i], mean.tail<3>()));
    effects_[i] += change;
  }
  return work;
}

void advance_kinematic(const List<int>& moved, double h, List<BodyState>& bodies) {
  for (const int i : moved) {
    bodies[i].position += h * bodies[i].linear_velocity;
    advance_orientation(MassProperties{}, h, &bodies[i]);
  }
}

}  // namespace constraint_sim::engine
