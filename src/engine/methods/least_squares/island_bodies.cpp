#include "engine/methods/least_squares/island_bodies.h"

#include <algorithm>

#include "engine/dynamics/state_vector.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

}  // namespace

IslandBodies::IslandBodies(const EquationsOfMotion& equations)
    : indices_(equations.bodies()), points_(equations.points()) {
  for (std::size_t i = 0; i < indices_.size(); ++i)
    mass_.push_back(1.0 / equations.inverse_mass(i));
  for (std::size_t i = 0; i < equations.rotating(); ++i) {
    inertia_.push_back(equations.inertia(i));
    radius_.push_back(equations.radius_of_gyration(i));
  }
}

BodyVectors IslandBodies::zeros() const {
  BodyVectors u;
  u.linear.assign(points_, Vector3d::Zero());
  u.angular.assign(rotating(), Vector3d::Zero());
  return u;
}

Configuration IslandBodies::configuration() const {
  Configuration configuration;
  configuration.position.assign(points_, Vector3d::Zero());
  configuration.orientation.assign(rotating(), Quaterniond::Identity());
  configuration.fixed_axes.assign(points_ - size(), Matrix3d::Identity());
  return configuration;
}

void IslandBodies::gather_state(const List<BodyState>& states, Configuration* configuration,
                                BodyVectors* velocity) const {
  engine::gather_state(indices_, states, &configuration->position, &configuration->orientation,
                       &velocity->linear, &velocity->angular);
}

void IslandBodies::scatter_state(const Configuration& configuration, const BodyVectors& velocity,
                                 List<BodyState>* states) const {
  engine::scatter_state(indices_, configuration.position, configuration.orientation,
                        velocity.linear, velocity.angular, states);
}

double IslandBodies::displace(const BodyVectors& change, Configuration* configuration) const {
  double most = 0.0;
  for (std::size_t i = 0; i < size(); ++i) {
    const Vector3d& dx = change.linear[i];
    configuration->position[i] += dx;
    if (!(dx.norm() <= most)) most = dx.norm();
  }
  for (std::size_t i = 0; i < rotating(); ++i) {
    const Vector3d& w = change.angular[i];
    Quaterniond& q = configuration->orientation[i];
    q = (rotation(w) * q).normalized();
    if (!(w.norm() * radius_[i] <= most)) most = w.norm() * radius_[i];
  }
  return most;
}

double IslandBodies::kinetic_energy(const Configuration& configuration,
                                    const BodyVectors& velocity) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < size(); ++i)
    sum += mass_[i] * velocity.linear[i].dot(velocity.linear[i]);
  for (std::size_t i = 0; i < rotating(); ++i) {
    const Vector3d& w = velocity.angular[i];
    sum += w.dot(apply_inertia(inertia_[i], configuration.orientation[i], w));
  }
  return 0.5 * sum;
}

void IslandBodies::find_rigid_motion(const Configuration& configuration,
                                     const BodyVectors& velocity, BodyVectors* centre,
                                     BodyVectors* turning) const {
  const RigidMotion body = as_one_body(configuration, velocity);
  centre->linear.assign(points_, body.velocity);
  centre->angular.assign(rotating(), Vector3d::Zero());
  const Vector3d w = body.angular_velocity();
  turning->linear.assign(points_, Vector3d::Zero());
  turning->angular.assign(rotating(), w);
  for (std::size_t i = 0; i < size(); ++i)
    turning->linear[i] = w.cross(configuration.position[i] - body.centre);
}

double IslandBodies::largest_speed(const BodyVectors& velocity) const {
  double speed = 0.0;
  for (const Vector3d& v : velocity.linear) speed = std::max(speed, v.norm());
  for (std::size_t i = 0; i < rotating(); ++i)
    speed = std::max(speed, radius_[i] * velocity.angular[i].norm());
  return speed;
}

double IslandBodies::work_of_loads(const EquationsOfMotion& equations, const Configuration& start,
                                   const Configuration& end) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < size(); ++i)
    sum += mass_[i] * equations.inputs().acceleration()[i].dot(end.position[i] - start.position[i]);
  for (std::size_t i = 0; i < rotating(); ++i) {
    const Vector3d turn = rotation_vector(end.orientation[i] * start.orientation[i].conjugate());
    sum += equations.inputs().torque()[i].dot(turn);
  }
  return sum;
}

void IslandBodies::add(double factor, const BodyVectors& other, BodyVectors* velocity) const {
  for (std::size_t i = 0; i < size(); ++i) velocity->linear[i] += factor * other.linear[i];
  for (std::size_t i = 0; i < rotating(); ++i) velocity->angular[i] += factor * other.angular[i];
}

}  // namespace constraint_sim::engine
