#include "engine/impulses/impulse_positions.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/impulses/free_turn.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Share of the trace of an inertia that makes it invertible. Moments of bodies exceed it by far.
constexpr double kAddedMoment = 1e-12;

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

// Inverse of an inertia with kAddedMoment of its trace added to the diagonal. Points in a line have
// neither a moment of inertia nor an angular momentum about the line, a single point about no axis.
// A power of two keeps the determinant within the range of numbers.
Matrix3d regularized_inverse(const Matrix3d& inertia) {
  const double trace = inertia.trace();
  if (!(trace > 0.0)) return Matrix3d::Zero();
  const double scale = std::ldexp(1.0, -std::ilogb(trace));
  const Matrix3d scaled = scale * (inertia + kAddedMoment * trace * Matrix3d::Identity());
  return scale * scaled.inverse();
}

// Angular momentum of a body about its centre.
Vector3d spin(const MassProperties& mass, const BodyState& body, const Vector3d& w) {
  if (!mass.can_turn()) return Vector3d::Zero();
  return apply_inertia(mass.inertia, body.orientation, w);
}

}  // namespace

double ImpulsePositions::move(const MassProperties& mass, double h, const Twist& v, const Twist& w,
                              BodyState* body) {
  double gained = 0.0;
  body->linear_velocity = v.head<3>();
  body->angular_velocity = v.tail<3>();
  if (!w.isZero(0.0)) {
    body->position += h * w.head<3>();
    if (mass.can_turn()) gained = turn_at_rest(mass, h * w.tail<3>(), body);
  }
  body->position += h * body->linear_velocity;
  advance_orientation(mass, h, body);
  return gained;
}

double ImpulsePositions::advance(const List<int>& moved, const Masses& masses,
                                 const Vector3d& gravity, RowSystem* system, Bodies* all_bodies) {
  Bodies& bodies = *all_bodies;
  const double h = system->h();
  List<Twist>& velocities = system->velocities();
  List<Twist>& corrections = system->corrections();
  double work = 0.0;
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    BodyState& body = bodies[i];
    const bool is_corrected = !corrections[i].isZero(0.0);
    Vector3d L_correction = Vector3d::Zero();
    if (is_corrected) {
      work -= h * masses[i].weight_share * corrections[i].head<3>().dot(gravity) /
              masses[i].inverse_mass;
      if (masses[i].can_turn())
        L_correction = apply_inertia(masses[i].inertia, body.orientation, corrections[i].tail<3>());
    }
    work += move(masses[i], h, velocities[i], corrections[i], &body);
    velocities[i].tail<3>() = body.angular_velocity;
    if (!is_corrected) continue;
    if (masses[i].can_turn())
      corrections[i].tail<3>() =
          apply_inertia(masses[i].inverse_inertia, body.orientation, L_correction);
    body.linear_velocity += corrections[i].head<3>();
    body.angular_velocity += corrections[i].tail<3>();
  }
  return work;
}

// ---- removal of correction velocities

void ImpulsePositions::finish_row(std::size_t i, const Row& row, const Jacobian& J, double C,
                                  RowSystem* system, EnergyAccount* energy) {
  List<Twist>& effects = system->effects();
  const double b = row.correction_impulse;
  if (b != 0.0) {
    effects[row.body_a] += b * twist(row.J.j1 - J.j1, row.J.j2 - J.j2);
    effects[row.body_b] += b * twist(row.J.j3 - J.j3, row.J.j4 - J.j4);
  }
  if (row.stiffness != 0.0) energy->finish_spring(row, i, C, *system);
}

// Finds the velocities that the next step removes: the corrections w, as impulses along the
// Jacobians after the step. What differs from w gives back kinetic energy that motion along
// straight lines lost, at most the loss of the component. Components whose springs gained energy
// are damped.
double ImpulsePositions::take_out_corrections(const List<int>& moved, const Masses& masses,
                                              const Bodies& bodies, const EnergyAccount& energy,
                                              RowSystem* system, List<Twist>* to_remove) {
  List<Twist>& effects = system->effects();
  parts_.resize(system->velocities().size());
  for (const int body : moved) {
    Part& part = parts_[body];
    part.linear = part.quadratic = part.damping = 0.0;
    part.scale = 1.0;
  }
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const Twist momentum = effects[i];
    Twist& change = effects[i];
    change.head<3>() *= masses[i].inverse_mass;
    if (masses[i].can_turn())
      change.tail<3>() =
          apply_inertia(masses[i].inverse_inertia, bodies[i].orientation, momentum.tail<3>());
    Part& part = parts_[system->component_of(index)];
    part.linear += momentum.dot(system->velocities()[i]);
    part.quadratic += 0.5 * momentum.dot(change);
  }
  bool any_limited = false;
  for (const int body : moved) {
    Part& part = parts_[body];
    if (!system->is_component(body)) continue;
    const double lost = -energy.gain(body);
    part.gains = energy.has_springs(body) && lost < 0.0;
    if (lost <= 0.0)
      part.scale = 0.0;
    else if (part.linear + part.quadratic > lost)
      part.scale = largest_scale(part.quadratic, part.linear, lost);
    any_limited = any_limited || part.gains || part.scale < 1.0;
  }
  double work = energy.spring_work();
  if (any_limited) work += limit_changes(moved, masses, bodies, energy, system);
  work += keep_angular_momentum(moved, masses, bodies, system);
  for (const int body : moved) (*to_remove)[body] = system->corrections()[body] - effects[body];
  return work;
}

// Sums up mass, centre, inertia, momenta and kinetic energy of each component as of one rigid body,
// and the angular momentum of the pending changes of velocity.
void ImpulsePositions::gather_rigid(const List<int>& moved, const Masses& masses,
                                    const Bodies& bodies, const RowSystem& system) {
  const List<Twist>& velocities = system.velocities();
  const List<Twist>& effects = system.effects();
  rigid_.resize(parts_.size());
  for (const int body : moved) rigid_[body] = Rigid{};
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    Rigid& rigid = rigid_[system.component_of(index)];
    const double mass = 1.0 / masses[i].inverse_mass;
    rigid.mass += mass;
    rigid.centre += mass * bodies[i].position;
    rigid.velocity += mass * velocities[i].head<3>();
  }
  for (const int index : moved) {
    if (!system.is_component(index)) continue;
    rigid_[index].centre /= rigid_[index].mass;
    rigid_[index].velocity /= rigid_[index].mass;
  }
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    Rigid& rigid = rigid_[system.component_of(index)];
    const double mass = 1.0 / masses[i].inverse_mass;
    const Vector3d r = bodies[i].position - rigid.centre;
    const Vector3d w = velocities[i].tail<3>();
    const Vector3d L = spin(masses[i], bodies[i], w);
    rigid.L += mass * r.cross(velocities[i].head<3>()) + L;
    rigid.L_of_changes +=
        mass * r.cross(effects[i].head<3>()) + spin(masses[i], bodies[i], effects[i].tail<3>());
    rigid.inertia += mass * (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose());
    rigid.energy += 0.5 * (mass * velocities[i].head<3>().squaredNorm() + L.dot(w));
    if (!masses[i].can_turn()) continue;
    const Matrix3d R = bodies[i].orientation.toRotationMatrix();
    rigid.inertia += R * masses[i].inertia.asDiagonal() * R.transpose();
  }
}

// Scales the changes of velocities, and damps components that gained energy. A component that no
// row connects with an immovable body gets the lost momenta back as a rigid motion of the
// component. Returns the work of the angular momentum that corrections left [J].
double ImpulsePositions::limit_changes(const List<int>& moved, const Masses& masses,
                                       const Bodies& bodies, const EnergyAccount& energy,
                                       RowSystem* system) {
  const List<Twist>& velocities = system->velocities();
  List<Twist>& effects = system->effects();
  gather_rigid(moved, masses, bodies, *system);
  for (const int body : moved) {
    Part& part = parts_[body];
    Rigid& rigid = rigid_[body];
    if (!system->is_component(body)) continue;
    const Matrix3d inverse = regularized_inverse(rigid.inertia);
    if (part.gains) {
      if (!system->is_attached(body))
        rigid.energy -=
            0.5 * (rigid.mass * rigid.velocity.squaredNorm() + rigid.L.dot(inverse * rigid.L));
      const double share = rigid.energy > 0.0 ? energy.gain(body) / rigid.energy : 1.0;
      part.damping = 1.0 - std::sqrt(std::max(0.0, 1.0 - share));
    }
    rigid.velocity *= system->is_attached(body) ? 0.0 : part.damping;
    rigid.turning = inverse * (part.damping * rigid.L);
    rigid.turning_of_changes = (1.0 - part.scale) * (inverse * rigid.L_of_changes);
    if (system->is_attached(body)) rigid.turning = rigid.turning_of_changes = Vector3d::Zero();
  }
  double work = 0.0;
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const Part& part = parts_[system->component_of(index)];
    const Rigid& rigid = rigid_[system->component_of(index)];
    const Vector3d r = bodies[i].position - rigid.centre;
    effects[i] = part.scale * effects[i] - part.damping * velocities[i] +
                 twist(rigid.velocity + rigid.turning.cross(r), rigid.turning);
    const Vector3d w = rigid.turning_of_changes;
    if (w.isZero(0.0)) continue;
    const Twist change = twist(w.cross(r), w);
    const Twist mean = velocities[i] + effects[i] + 0.5 * change;
    work += change.head<3>().dot(mean.head<3>()) / masses[i].inverse_mass;
    work += w.dot(spin(masses[i], bodies[i], mean.tail<3>()));
    effects[i] += change;
  }
  for (const int index : moved)
    if (!masses[index].can_turn()) effects[index].tail<3>().setZero();
  return work;
}

// Finds the angular momentum that correction velocities w add to components that no row connects
// with an immovable body, and removes it by a rigid rotation of the component. A displacement h w
// at a velocity v changes x × m v. finish_row() takes back the share of joints, by their Jacobians
// after the step; contacts may have ended and have none. Returns the work [J].
double ImpulsePositions::keep_angular_momentum(const List<int>& moved, const Masses& masses,
                                               const Bodies& bodies, RowSystem* system) {
  const List<Twist>& velocities = system->velocities();
  const List<Twist>& corrections = system->corrections();
  List<Twist>& effects = system->effects();
  constexpr double kKept = 1e-9;  // share of Σ m h ‖w‖ ‖v‖ that is rounding
  bool any = false;
  for (const int body : moved) parts_[body].lost = {};
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const int root = system->component_of(index);
    Part& part = parts_[root];
    if (system->is_attached(root) || !system->corrects(root)) continue;
    const double mass = 1.0 / masses[i].inverse_mass;
    const Vector3d moment = mass * system->h() * velocities[i].head<3>();
    const Vector3d r = bodies[i].position - bodies[to_index(root)].position;
    part.lost.L += moment.cross(corrections[i].head<3>()) - mass * r.cross(effects[i].head<3>()) -
                   spin(masses[i], bodies[i], effects[i].tail<3>());
    part.lost.most += moment.norm() * corrections[i].head<3>().norm();
    any = true;
  }
  if (!any) return 0.0;
  any = false;
  for (const int body : moved) {
    LostMomentum& lost = parts_[body].lost;
    lost.is_given_back = lost.L.norm() > kKept * lost.most;
    any = any || lost.is_given_back;
  }
  if (!any) return 0.0;
  gather_rigid(moved, masses, bodies, *system);
  for (const int body : moved)
    if (parts_[body].lost.is_given_back)
      rigid_[body].turning = regularized_inverse(rigid_[body].inertia) * parts_[body].lost.L;
  double work = 0.0;
  for (const int index : moved) {
    const std::size_t i = to_index(index);
    const int root = system->component_of(index);
    if (!parts_[root].lost.is_given_back) continue;
    const Vector3d w = rigid_[root].turning;
    const Twist change = twist(w.cross(Vector3d(bodies[i].position - rigid_[root].centre)),
                               masses[i].can_turn() ? w : Vector3d(Vector3d::Zero()));
    const Twist mean = velocities[i] + effects[i] + 0.5 * change;
    work += change.head<3>().dot(mean.head<3>()) / masses[i].inverse_mass +
            change.tail<3>().dot(spin(masses[i], bodies[i], mean.tail<3>()));
    effects[i] += change;
  }
  return work;
}

}  // namespace constraint_sim::engine
