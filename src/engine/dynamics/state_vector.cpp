#include "engine/dynamics/state_vector.h"

#include "engine/math/quaternion_state.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

}  // namespace

void gather_state(const IslandModel& island, const List<BodyState>& states, double* y) {
  const auto [v_at, q_at, L_at, size] = island.layout();
  for (std::size_t i = 0; i < island.bodies().size(); ++i) {
    const BodyState& state = states[island.bodies()[i]];
    Vector(y + 3 * i) = state.position;
    Vector(y + v_at + 3 * i) = state.linear_velocity;
    if (!island.rotates(i)) continue;
    Eigen::Map<Eigen::Vector4d>(y + q_at + 4 * i) = state.orientation.coeffs();
    Vector(y + L_at + 3 * i) =
        apply_inertia(island.inertia(i), state.orientation, state.angular_velocity);
  }
}

void scatter_state(const IslandModel& island, const double* y, List<BodyState>* states) {
  const auto [v_at, q_at, L_at, size] = island.layout();
  for (std::size_t i = 0; i < island.bodies().size(); ++i) {
    BodyState& state = (*states)[island.bodies()[i]];
    state.position = ConstVector(y + 3 * i);
    state.linear_velocity = ConstVector(y + v_at + 3 * i);
    if (!island.rotates(i)) continue;
    state.orientation.coeffs() = Eigen::Map<const Eigen::Vector4d>(y + q_at + 4 * i);
    state.angular_velocity = apply_inertia(island.inertia(i).cwiseInverse(), state.orientation,
                                           ConstVector(y + L_at + 3 * i));
  }
}

void gather_state(const List<int>& bodies, const List<BodyState>& states, List<Vector3d>* x,
                  List<Eigen::Quaterniond>* q, List<Vector3d>* v, List<Vector3d>* w) {
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const BodyState& state = states[bodies[i]];
    (*x)[i] = state.position;
    (*v)[i] = state.linear_velocity;
    if (i >= q->size()) continue;
    (*q)[i] = state.orientation;
    (*w)[i] = state.angular_velocity;
  }
}

void scatter_state(const List<int>& bodies, const List<Vector3d>& x,
                   const List<Eigen::Quaterniond>& q, const List<Vector3d>& v,
                   const List<Vector3d>& w, List<BodyState>* states) {
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    BodyState& state = (*states)[bodies[i]];
    state.position = x[i];
    state.linear_velocity = v[i];
    if (i >= q.size()) continue;
    state.orientation = q[i];
    state.angular_velocity = w[i];
  }
}

double kinetic_energy(const IslandModel& island, const double* y) {
  const double* const v = y + island.layout().v_at;
  const double* const q = y + island.layout().q_at;
  const double* const L = y + island.layout().L_at;
  double energy = 0.0;
  for (std::size_t i = 0; i < island.bodies().size(); ++i)
    energy += 0.5 / island.inverse_mass(i) * ConstVector(v + 3 * i).squaredNorm();
  for (std::size_t i = 0; i < island.rotating(); ++i) {
    const Vector3d in_body = rotation_matrix(q + 4 * i).transpose() * ConstVector(L + 3 * i);
    energy += 0.5 * in_body.dot(in_body.cwiseQuotient(island.inertia(i)));
  }
  return energy;
}

void find_accelerations(const IslandModel& island, const double* y, const double* dydt,
                        Motions* rates) {
  const auto [v_at, q_at, L_at, size] = island.layout();
  rates->linear.resize(island.bodies().size());
  rates->angular.assign(island.bodies().size(), Vector3d::Zero());
  for (std::size_t i = 0; i < island.bodies().size(); ++i)
    rates->linear[i] = ConstVector(dydt + v_at + 3 * i);
  for (std::size_t i = 0; i < island.rotating(); ++i) {
    const Eigen::Quaterniond q(Eigen::Map<const Eigen::Quaterniond>(y + q_at + 4 * i));
    const Vector3d inverse = island.inertia(i).cwiseInverse();
    const ConstVector L(y + L_at + 3 * i);
    const Vector3d w = apply_inertia(inverse, q, L);
    rates->angular[i] =
        apply_inertia(inverse, q, ConstVector(dydt + L_at + 3 * i) - Vector3d(w.cross(L)));
  }
}

}  // namespace constraint_sim::engine
