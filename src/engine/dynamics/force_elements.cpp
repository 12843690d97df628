#include "engine/dynamics/force_elements.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

void add_spring_forces(const IslandModel& island, const IntervalInputs& inputs,
                       const Kinematics& kinematics, double* forces, List<Vector3d>* acceleration,
                       List<Vector3d>* torque) {
  for (std::size_t l = island.first().spring; l < island.links().size(); ++l) {
    const IslandModel::Link& link = island.links()[l];
    const Vector3d& d = kinematics.separation()[l];
    const double distance = d.norm();
    const Vector3d n = distance > 0.0 ? Vector3d(d / distance) : Vector3d(Vector3d::UnitX());
    const double stretch = distance - inputs.length()[l].value;
    const double rate = n.dot(kinematics.separation_rate(island, l)) - inputs.length()[l].rate;
    const double force = -link.stiffness * stretch - link.damping * rate;
    forces[l - island.first().spring] = force;
    const Vector3d f = force * n;
    (*acceleration)[link.a] -= island.inverse_mass(link.a) * f;
    (*acceleration)[link.b] += island.inverse_mass(link.b) * f;
    if (island.rotates(link.a)) (*torque)[link.a] -= kinematics.arm_a()[l].cross(f);
    if (island.rotates(link.b)) (*torque)[link.b] += kinematics.arm_b()[l].cross(f);
  }
}

void add_soft_forces(const IslandModel& island, const Kinematics& kinematics,
                     const CoordinatePositions& coordinates, double* forces,
                     List<Vector3d>* acceleration, List<Vector3d>* torque) {
  for (std::size_t s = 0; s < island.soft_coordinates().size(); ++s) {
    const IslandModel::SoftCoordinate& soft = island.soft_coordinates()[s];
    const IslandModel::Link& link = island.links()[soft.link];
    const double rate = kinematics.rate_of(soft.link, soft.form);
    const double force = forces[s] =
        soft.law.force(coordinates.soft_at(island, kinematics, s, rate), rate);
    const Jacobian J = jacobian(soft.form, kinematics.vectors(soft.link));
    (*acceleration)[link.a] += island.inverse_mass(link.a) * force * J.j1;
    (*acceleration)[link.b] += island.inverse_mass(link.b) * force * J.j3;
    if (island.rotates(link.a)) (*torque)[link.a] += force * J.j2;
    if (island.rotates(link.b)) (*torque)[link.b] += force * J.j4;
  }
}

}  // namespace constraint_sim::engine
