#pragma once

// References of mechanisms in minimal coordinates, without an engine: closed-form poses of all
// bodies as functions of one coordinate, Lagrange's equation with their derivatives by jets, and
// extrapolation in long double (problems.h).

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "problems.h"

namespace constraint_sim::engine::minimal {

using problems::Real;
using problems::Reals;

inline const Real kPi = std::acos(Real{-1});

/// A number with its first and second derivative by the coordinate q.
struct Jet {
  Real v = 0, d = 0, dd = 0;
  Jet() = default;
  Jet(Real value) : v(value) {}  // NOLINT: constants convert
  Jet(Real value, Real first, Real second) : v(value), d(first), dd(second) {}

  Jet& operator+=(const Jet& o) { return *this = {v + o.v, d + o.d, dd + o.dd}; }
  Jet& operator-=(const Jet& o) { return *this = {v - o.v, d - o.d, dd - o.dd}; }
  Jet& operator*=(const Jet& o) {
    return *this = {v * o.v, d * o.v + v * o.d, dd * o.v + 2 * d * o.d + v * o.dd};
  }
};

inline Jet operator-(const Jet& x) { return {-x.v, -x.d, -x.dd}; }
inline Jet operator+(Jet x, const Jet& y) { return x += y; }
inline Jet operator-(Jet x, const Jet& y) { return x -= y; }
inline Jet operator*(Jet x, const Jet& y) { return x *= y; }

/// Returns f(x), given the derivatives of f at x.
inline Jet compose(const Jet& x, Real f, Real df, Real ddf) {
  return {f, df * x.d, ddf * x.d * x.d + df * x.dd};
}
inline Jet inverse(const Jet& x) {
  const Real i = 1 / x.v;
  return compose(x, i, -i * i, 2 * i * i * i);
}
inline Jet operator/(const Jet& x, const Jet& y) { return x * inverse(y); }
inline Jet sin(const Jet& x) {
  const Real s = std::sin(x.v);
  return compose(x, s, std::cos(x.v), -s);
}
inline Jet cos(const Jet& x) {
  const Real c = std::cos(x.v);
  return compose(x, c, -std::sin(x.v), -c);
}
inline Jet sqrt(const Jet& x) {
  const Real root = std::sqrt(x.v);
  return compose(x, root, Real{0.5L} / root, Real{-0.25L} / (root * x.v));
}

}  // namespace constraint_sim::engine::minimal

template <>
struct Eigen::NumTraits<constraint_sim::engine::minimal::Jet> : Eigen::NumTraits<long double> {
  using Real = constraint_sim::engine::minimal::Jet;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 3,
    AddCost = 3,
    MulCost = 8
  };
};

namespace constraint_sim::engine::minimal {

using Vector = Eigen::Matrix<Jet, 3, 1>;
using Matrix = Eigen::Matrix<Jet, 3, 3>;

/// A plane angle by its cosine and sine, sufficient for poses.
struct Angle {
  Jet c = 1, s = 0;
};
inline Angle angle(const Jet& phi) { return {cos(phi), sin(phi)}; }
/// Returns the angle of the vector (x, z).
inline Angle direction(const Jet& x, const Jet& z) {
  const Jet length = sqrt(x * x + z * z);
  return {x / length, z / length};
}

/// Returns the rotation about a constant unit vector.
inline Matrix rotation(const Eigen::Vector3d& axis, const Angle& phi) {
  Matrix R;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const Jet x = axis[i], y = axis[j], z = axis[k];
    R(i, i) = phi.c + (Jet(1) - phi.c) * x * x;
    R(i, j) = (Jet(1) - phi.c) * x * y - phi.s * z;
    R(i, k) = (Jet(1) - phi.c) * x * z + phi.s * y;
  }
  return R;
}

/// Pose of a body: its centre of mass, and its axes as columns.
struct Pose {
  Vector x = Vector::Zero();
  Matrix R = Matrix::Identity();
};
using Poses = std::vector<Pose>;

/// Returns the pose of a body in the x-z plane with its x axis along `along`.
inline Pose planar(const Jet& x, const Jet& z, const Angle& along) {
  Pose pose;
  pose.x = {x, Jet(0), z};
  pose.R = rotation(-Eigen::Vector3d::UnitY(), along);
  return pose;
}

/// A point in a plane. meet() returns the intersection of circles about a and b: left of the line
/// from a to b for `side` = 1, right for −1.
struct Point {
  Jet x, y;
};
inline Point meet(const Point& a, Real radius_a, const Point& b, Real radius_b, int side) {
  const Jet dx = b.x - a.x, dy = b.y - a.y, square = dx * dx + dy * dy;
  const Jet along = (square + Jet(radius_a * radius_a - radius_b * radius_b)) / (Jet(2) * square);
  const Jet across = Jet(side) * sqrt(Jet(radius_a * radius_a) / square - along * along);
  return {a.x + along * dx - across * dy, a.y + along * dy + across * dx};
}

/// Mass [kg] and principal inertia [kg m²].
struct MassOf {
  Real mass = 0;
  Eigen::Matrix<Real, 3, 1> inertia = Eigen::Matrix<Real, 3, 1>::Zero();
};
inline MassOf mass_of(const Body& body) {
  const Eigen::Vector3d inertia = body.inertia.isZero(0.0)
                                      ? Eigen::Vector3d(body.mass * unit_inertia(body.shape))
                                      : body.inertia;
  return {static_cast<Real>(body.mass), inertia.cast<Real>()};
}

/// A mechanism with one degree of freedom: poses(q), a further potential [J], and a generalized
/// force along q.
struct OneCoordinate {
  std::function<Poses(const Jet& q)> poses;
  std::vector<MassOf> bodies;
  Eigen::Vector3d gravity{0.0, 0.0, -problems::kGravity};
  std::function<Jet(const Jet& q)> potential;
  Real force = 0;

  /// Energies ½ m(q) q̇² and V, with their derivatives by q.
  struct Energies {
    Real m = 0, dm = 0;
    Real V = 0, dV = 0;
  };
  Energies energies(Real q) const {
    Energies sum;
    const Jet coordinate(q, 1, 0);
    const Poses all = poses(coordinate);
    for (std::size_t i = 0; i < all.size(); ++i) {
      const MassOf& body = bodies[i];
      for (int k = 0; k < 3; ++k) {
        const Jet& x = all[i].x[k];
        sum.m += body.mass * x.d * x.d;
        sum.dm += 2 * body.mass * x.d * x.dd;
        sum.V -= body.mass * static_cast<Real>(gravity[k]) * x.v;
        sum.dV -= body.mass * static_cast<Real>(gravity[k]) * x.d;
        // In the body's axes ω = w q̇; w and its derivative are the skew parts of RᵀR′ and RᵀR″.
        const int i1 = (k + 1) % 3, i2 = (k + 2) % 3;
        Real w = 0, dw = 0;
        for (int r = 0; r < 3; ++r) {
          const Jet &first = all[i].R(r, i1), &second = all[i].R(r, i2);
          w += (second.v * first.d - first.v * second.d) / 2;
          dw += (second.v * first.dd - first.v * second.dd) / 2;
        }
        sum.m += body.inertia[k] * w * w;
        sum.dm += 2 * body.inertia[k] * w * dw;
      }
    }
    if (potential) {
      const Jet V = potential(coordinate);
      sum.V += V.v;
      sum.dV += V.d;
    }
    return sum;
  }

  /// Returns (q̇, q̈) by m q̈ + ½ m′ q̇² + V′ = force.
  Reals operator()(const Reals& y) const {
    const Energies e = energies(y[0]);
    return {y[1], (force - e.dV - e.dm * y[1] * y[1] / 2) / e.m};
  }

  /// Returns kinetic and potential energy less the work of `force` [J], a constant.
  Real energy(const Reals& y) const {
    const Energies e = energies(y[0]);
    return e.m * y[1] * y[1] / 2 + e.V - force * y[0];
  }
};

/// Integrates by extrapolation of order 12; more columns amplify rounding in their differences.
template <class Derivative>
Reals integrate(const Derivative& f, const Reals& y, Real duration, int steps) {
  return problems::integrate(f, y, duration, steps, 6);
}

/// Returns the poses at q.
inline Poses at(const OneCoordinate& mechanism, Real q) { return mechanism.poses(Jet(q, 1, 0)); }

inline Eigen::Vector3d position(const Pose& pose) {
  return {static_cast<double>(pose.x[0].v), static_cast<double>(pose.x[1].v),
          static_cast<double>(pose.x[2].v)};
}
inline Eigen::Quaterniond orientation(const Pose& pose) {
  Eigen::Matrix<Real, 3, 3> R;
  for (int k = 0; k < 9; ++k) R(k / 3, k % 3) = pose.R(k / 3, k % 3).v;
  return Eigen::Quaternion<Real>(R).normalized().cast<double>();
}

/// Returns the state of a body with this pose, for a rate of the coordinate.
inline BodyState state(const Pose& pose, double rate) {
  BodyState state;
  state.position = position(pose);
  state.orientation = orientation(pose);
  for (int i = 0; i < 3; ++i) {
    state.linear_velocity[i] = static_cast<double>(pose.x[i].d) * rate;
    const int j = (i + 1) % 3, k = (i + 2) % 3;  // elements of R′Rᵀ
    Real w = 0;
    for (int c = 0; c < 3; ++c) w += pose.R(k, c).d * pose.R(j, c).v;
    state.angular_velocity[i] = static_cast<double>(w) * rate;
  }
  return state;
}

/// Returns the error of a body [m]: position, or rotation times the larger radius of gyration.
inline double error_of(const BodyState& state, const MassOf& body, const Pose& reference) {
  const double radius = std::sqrt(static_cast<double>(body.inertia.maxCoeff() / body.mass));
  return std::max((state.position - position(reference)).norm(),
                  radius * problems::angle_between(state.orientation, orientation(reference)));
}

}  // namespace constraint_sim::engine::minimal
