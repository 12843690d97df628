#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "engine/dynamics/kernels/spatial_inertia.h"

namespace constraint_sim::engine {

/// Symmetric matrix by its diagonal and the entries yz, xz, xy. Number: double, or Lanes.
template <class Number>
struct SymmetricMatrix {
  using Vector = Eigen::Matrix<Number, 3, 1>;

  Vector diagonal = Vector::Zero(), beside = Vector::Zero();

  Vector operator*(const Vector& v) const {
    return {diagonal.x() * v.x() + beside.z() * v.y() + beside.y() * v.z(),
            beside.z() * v.x() + diagonal.y() * v.y() + beside.x() * v.z(),
            beside.y() * v.x() + beside.x() * v.y() + diagonal.z() * v.z()};
  }
  Eigen::Matrix<Number, 3, 3> matrix() const {
    Eigen::Matrix<Number, 3, 3> full;
    full << diagonal.x(), beside.z(), beside.y(), beside.z(), diagonal.y(), beside.x(), beside.y(),
        beside.x(), diagonal.z();
    return full;
  }
};

/// Inertia of a body or a subtree about the origin.
struct CompositeInertia {
  double mass = 0.0;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  ///< mass times centre [kg m]
  SymmetricMatrix<double> inertia;                   ///< [kg m²]

  /// Returns the momentum at motion (v of the point at the origin, ω).
  SpatialVector operator*(const SpatialVector& motion) const {
    return {mass * motion.linear - moment.cross(motion.angular),
            inertia * motion.angular + moment.cross(motion.linear)};
  }
  CompositeInertia& operator+=(const CompositeInertia& other) {
    mass += other.mass;
    moment += other.moment;
    inertia.diagonal += other.inertia.diagonal;
    inertia.beside += other.inertia.beside;
    return *this;
  }
};

}  // namespace constraint_sim::engine
