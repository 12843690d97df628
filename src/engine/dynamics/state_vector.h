#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/island_model.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Copies a few numbers without the function call of std::copy.
inline void copy_few(const double* from, std::size_t n, double* to) {
  const auto size = static_cast<Eigen::Index>(n);
  Eigen::VectorXd::Map(to, size) = Eigen::VectorXd::Map(from, size);
}

/// Linear and angular vectors per body of an island: velocity changes, accelerations or impulses.
struct Motions {
  List<Eigen::Vector3d> linear, angular;  ///< angular: 0 for bodies that do not rotate
};

/// Writes the bodies of an island to a state vector y, laid out as IslandModel::layout() says.
void gather_state(const IslandModel& island, const List<BodyState>& states, double* y);
/// Writes a state vector to the bodies of an island.
void scatter_state(const IslandModel& island, const double* y, List<BodyState>* states);
/// Copies the states of bodies, by index in `states`, to lists of positions, orientations,
/// velocities and angular velocities. Only the first bodies, as many as there are orientations,
/// rotate.
void gather_state(const List<int>& bodies, const List<BodyState>& states, List<Eigen::Vector3d>* x,
                  List<Eigen::Quaterniond>* q, List<Eigen::Vector3d>* v, List<Eigen::Vector3d>* w);
/// Copies such lists to the states of bodies.
void scatter_state(const List<int>& bodies, const List<Eigen::Vector3d>& x,
                   const List<Eigen::Quaterniond>& q, const List<Eigen::Vector3d>& v,
                   const List<Eigen::Vector3d>& w, List<BodyState>* states);
/// Returns the kinetic energy of a state vector [J].
double kinetic_energy(const IslandModel& island, const double* y);
/// Extracts the accelerations from the derivative dydt at y.
void find_accelerations(const IslandModel& island, const double* y, const double* dydt,
                        Motions* rates);

}  // namespace constraint_sim::engine
