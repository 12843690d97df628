#include "engine/dynamics/held_response.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Calls `act` with the place in the island of each body of an impulse, and its place there.
template <class Act>
void for_each_body(const IslandModel& island, const BodyImpulse& impulse, const Act& act) {
  const List<int>& bodies = island.bodies();
  for (std::size_t k = 0; k < impulse.body.size() && impulse.body[k] != 0; ++k) {
    const auto found = std::find(bodies.begin(), bodies.end(), impulse.body[k]);
    if (found != bodies.end()) act(to_index(found - bodies.begin()), k);
  }
}

}  // namespace

Motions held_response(const IslandModel& island, const IntervalInputs& inputs,
                      const Kinematics& kinematics, const BodyImpulse& impulse,
                      DelassusMatrix* delassus, List<double>* impulses) {
  const std::size_t bodies = island.bodies().size();
  Motions f{List<Vector3d>(island.points(), Vector3d::Zero()),
            List<Vector3d>(bodies, Vector3d::Zero())};
  for_each_body(island, impulse, [&](std::size_t i, std::size_t k) {
    f.linear[i] += impulse.linear[k];
    if (island.rotates(i)) f.angular[i] += impulse.angular[k];
  });
  impulses->assign(island.rows(), 0.0);
  double* const lambda = impulses->data();
  delassus->subtract_accelerations(island, kinematics, f.linear, f.angular, lambda);
  if (island.rows() > 0) delassus->solve(lambda);
  delassus->apply_transpose(island, kinematics, lambda);
  f.linear.resize(bodies);
  for (std::size_t i = 0; i < bodies; ++i)
    f.linear[i] = island.inverse_mass(i) * (f.linear[i] + delassus->force()[i]);
  for (std::size_t i = 0; i < island.rotating(); ++i)
    f.angular[i] = kinematics.inverse_inertia()[i] * (f.angular[i] + delassus->torque()[i]);
  delassus->multipliers_to_forces(island, inputs, lambda);
  return f;
}

double free_response(const IslandModel& island, const Kinematics& kinematics,
                     const BodyImpulse& impulse) {
  double response = 0.0;
  for_each_body(island, impulse, [&](std::size_t i, std::size_t k) {
    const Vector3d& turn = impulse.angular[k];
    response += island.inverse_mass(i) * impulse.linear[k].squaredNorm();
    if (island.rotates(i)) response += turn.dot(kinematics.inverse_inertia()[i] * turn);
  });
  return response;
}

}  // namespace constraint_sim::engine
