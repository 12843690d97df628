#pragma once

// Scenes with references that are independent of the engine: closed forms, published values, and
// minimal coordinates in long double.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine::problems {

inline constexpr double kGravity = 9.81;

// ---- scenes

inline BodyId add_mass(World* world, const std::string& name, const Eigen::Vector3d& position,
                       double mass = 1.0) {
  Body body;
  body.name = name;
  body.mass = mass;
  body.state.position = position;
  return world->add_body(body);
}

/// Adds a rod between centres of mass at their present distance.
inline void add_rod(World* world, BodyId a, BodyId b) {
  Joint joint;
  joint.name = "rod_" + std::to_string(world->joint_ids().size());
  joint.body_a = a;
  joint.body_b = b;
  world->add_joint(joint);
}

/// Unit point masses on rods of 1 m, from the origin along x, at rest. One link is the pendulum of
/// IFToMM's benchmark A01, two are the double pendulum.
inline World chain(int links, double end_mass = 1.0, double mass = 1.0) {
  World world;
  BodyId last = kWorldBody;
  for (int i = 1; i <= links; ++i) {
    const BodyId id = add_mass(&world, "mass_" + std::to_string(i),
                               {static_cast<double>(i), 0.0, 0.0}, i == links ? end_mass : mass);
    add_rod(&world, last, id);
    last = id;
  }
  return world;
}

/// Bars of 1 kg and 1 m on ball joints, end to end from the origin along x, at rest.
inline World chain_of_bars(int links) {
  World world;
  BodyId last = kWorldBody;
  for (int i = 1; i <= links; ++i) {
    Body bar;
    bar.name = "bar_" + std::to_string(i);
    bar.mass = 1.0;
    bar.shape = Box{{1.0, 0.1, 0.1}};
    bar.no_collision = true;
    bar.state.position = {i - 0.5, 0.0, 0.0};
    const BodyId id = world.add_body(bar);
    Joint joint;
    joint.name = "joint_" + std::to_string(i);
    joint.body_a = last;
    joint.anchor_a = {i == 1 ? 0.0 : 0.5, 0.0, 0.0};
    joint.body_b = id;
    joint.anchor_b = {-0.5, 0.0, 0.0};
    joint.kind = JointKind::kBall;
    world.add_joint(joint);
    last = id;
  }
  return world;
}

/// Ten links of 1 m with 0.1 kg each, straight down from the origin, and a heavy mass on one more
/// link. The mass starts with 1 m/s along x; the others are in line with it or at rest.
inline World heavy_chain(double end_mass, bool moves_in_line) {
  constexpr int kLinks = 11;
  World world;
  BodyId last = kWorldBody;
  for (int i = 1; i <= kLinks; ++i) {
    Body body;
    body.name = "mass_" + std::to_string(i);
    body.mass = i == kLinks ? end_mass : 0.1;
    body.state.position = {0.0, 0.0, -static_cast<double>(i)};
    const bool moves = moves_in_line || i == kLinks;
    body.state.linear_velocity = {moves ? static_cast<double>(i) / kLinks : 0.0, 0.0, 0.0};
    const BodyId id = world.add_body(body);
    add_rod(&world, last, id);
    last = id;
  }
  return world;
}

/// The box of OSRF's benchmark 'boxes', complex case: it tumbles in free fall.
inline World free_box() {
  WorldOptions options;
  options.gravity = {0.0, 0.0, -9.8};
  World world(options);
  Body box;
  box.name = "box";
  box.shape = Box{{0.1, 0.4, 0.9}};
  box.mass = 10.0;
  box.state.linear_velocity = {-2.0, 2.0, 8.0};
  box.state.angular_velocity = {0.1, 5.0, 0.1};
  world.add_body(box);
  return world;
}

/// N + 1 upright rods with unit masses on top, joined in a row, all moving at 1 m/s along x. All
/// rods are in line twice a turn. With `is_loaded` the last mass is 3 kg and 5 N along x push the
/// first, so that the rods between carry a force in these poses.
inline World four_bar(int windows, bool is_loaded = false) {
  World world;
  std::vector<BodyId> tops;
  for (int k = 0; k <= windows; ++k) {
    Body body;
    body.name = "top_" + std::to_string(k);
    body.mass = is_loaded && k == windows ? 3.0 : 1.0;
    body.state.position = {static_cast<double>(k), 0.0, 1.0};
    body.state.linear_velocity = {1.0, 0.0, 0.0};
    tops.push_back(world.add_body(body));
    Joint upright;
    upright.name = "upright_" + std::to_string(k);
    upright.anchor_a = {static_cast<double>(k), 0.0, 0.0};
    upright.body_b = tops.back();
    world.add_joint(upright);
    if (k > 0) add_rod(&world, tops[static_cast<std::size_t>(k) - 1], tops.back());
  }
  if (is_loaded) {
    Wrench push;
    push.body = tops.front();
    push.force = {5.0, 0.0, 0.0};
    push.end = 1e9;
    world.add_wrench(push);
  }
  return world;
}

/// n × n unit masses 1 m apart, joined to their neighbours by rods, with two corners held by rods
/// to the world; the middle sags by about `sag` times n/2.
inline World net(int n, double sag) {
  World world;
  std::vector<BodyId> ids;
  const auto at = [&](int i, int k) { return ids[static_cast<std::size_t>(i * n + k)]; };
  const auto depth = [&](int i) { return static_cast<double>(i * (n - 1 - i)) / n; };
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k)
      ids.push_back(
          add_mass(&world, "mass_" + std::to_string(i) + "_" + std::to_string(k),
                   {static_cast<double>(i), static_cast<double>(k), -sag * (depth(i) + depth(k))}));
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < n; ++k) {
      if (i + 1 < n) add_rod(&world, at(i, k), at(i + 1, k));
      if (k + 1 < n) add_rod(&world, at(i, k), at(i, k + 1));
    }
  }
  for (const int k : {0, n - 1}) {
    Joint corner;
    corner.name = "corner_" + std::to_string(k);
    corner.body_b = at(0, k);
    corner.anchor_a = world.state(at(0, k)).position + Eigen::Vector3d(-1.0, 0.0, 0.0);
    world.add_joint(corner);
  }
  return world;
}

// ---- references

using Real = long double;
using Reals = std::vector<Real>;

/// Takes one step H of y' = f(y) by extrapolation of the modified midpoint rule: Gragg, Bulirsch &
/// Stoer; Hairer, Nørsett & Wanner I, section II.9.
template <class Derivative>
void extrapolate(const Derivative& f, Real H, Reals* y, int columns) {
  std::vector<Reals> table;
  for (int j = 1; j <= columns; ++j) {
    const int n = 2 * j;
    const Real h = H / static_cast<Real>(n);
    Reals before = *y;
    Reals now = *y;
    Reals slope = f(now);
    for (std::size_t i = 0; i < now.size(); ++i) now[i] += h * slope[i];
    for (int k = 1; k < n; ++k) {
      slope = f(now);
      for (std::size_t i = 0; i < now.size(); ++i) {
        before[i] += 2 * h * slope[i];
        std::swap(before[i], now[i]);
      }
    }
    slope = f(now);
    for (std::size_t i = 0; i < now.size(); ++i) now[i] = (now[i] + before[i] + h * slope[i]) / 2;
    table.push_back(now);
    for (int k = j - 2; k >= 0; --k) {
      const Real ratio = static_cast<Real>(j) / static_cast<Real>(k + 1);
      Reals& coarse = table[static_cast<std::size_t>(k)];
      const Reals& fine = table[static_cast<std::size_t>(k) + 1];
      for (std::size_t i = 0; i < coarse.size(); ++i)
        coarse[i] = fine[i] + (fine[i] - coarse[i]) / (ratio * ratio - 1);
    }
  }
  *y = table.front();
}

template <class Derivative>
Reals integrate(const Derivative& f, Reals y, Real duration, int steps, int columns = 10) {
  for (int k = 0; k < steps; ++k) extrapolate(f, duration / static_cast<Real>(steps), &y, columns);
  return y;
}

/// Angles from the x axis and their rates, of a chain of masses. Lagrange's equations
///   Σ_j m_max(i,j) (cos(φ_i − φ_j) φ̈_j + sin(φ_i − φ_j) φ̇_j²) = −m_i g cos φ_i,
/// with m_i the mass from link i to the end, are solved by Cholesky factorisation.
class ChainInAngles {
 public:
  explicit ChainInAngles(std::size_t links, Real end_mass = 1, Real mass = 1)
      : n_(links), end_mass_(end_mass), mass_(mass) {}

  Reals operator()(const Reals& y) const {
    const auto mass_from = [&](std::size_t i) {
      return static_cast<Real>(n_ - 1 - i) * mass_ + end_mass_;
    };
    std::vector<Real> A(n_ * n_), b(n_), sine(n_), cosine(n_);
    for (std::size_t i = 0; i < n_; ++i) {
      sine[i] = std::sin(y[i]);
      cosine[i] = std::cos(y[i]);
    }
    for (std::size_t i = 0; i < n_; ++i) {
      b[i] = -mass_from(i) * static_cast<Real>(kGravity) * cosine[i];
      for (std::size_t j = 0; j < n_; ++j) {
        const Real m = mass_from(std::max(i, j));
        A[i * n_ + j] = m * (cosine[i] * cosine[j] + sine[i] * sine[j]);
        b[i] -= m * (sine[i] * cosine[j] - cosine[i] * sine[j]) * y[n_ + j] * y[n_ + j];
      }
    }
    solve(&A, &b);
    Reals rate(2 * n_);
    for (std::size_t i = 0; i < n_; ++i) {
      rate[i] = y[n_ + i];
      rate[n_ + i] = b[i];
    }
    return rate;
  }

 private:
  void solve(std::vector<Real>* A, std::vector<Real>* b) const {
    const auto a = [&](std::size_t i, std::size_t j) -> Real& { return (*A)[i * n_ + j]; };
    for (std::size_t j = 0; j < n_; ++j) {
      for (std::size_t k = 0; k < j; ++k) a(j, j) -= a(j, k) * a(j, k);
      a(j, j) = std::sqrt(a(j, j));
      for (std::size_t i = j + 1; i < n_; ++i) {
        for (std::size_t k = 0; k < j; ++k) a(i, j) -= a(i, k) * a(j, k);
        a(i, j) /= a(j, j);
      }
    }
    for (std::size_t i = 0; i < n_; ++i) {
      for (std::size_t k = 0; k < i; ++k) (*b)[i] -= a(i, k) * (*b)[k];
      (*b)[i] /= a(i, i);
    }
    for (std::size_t i = n_; i-- > 0;) {
      for (std::size_t k = i + 1; k < n_; ++k) (*b)[i] -= a(k, i) * (*b)[k];
      (*b)[i] /= a(i, i);
    }
  }

  std::size_t n_;
  Real end_mass_;
  Real mass_;
};

/// Returns the positions of a chain with these angles [m].
inline std::vector<Eigen::Vector3d> chain_positions(const Reals& angles) {
  std::vector<Eigen::Vector3d> positions;
  Real x = 0, z = 0;
  for (std::size_t i = 0; i < angles.size() / 2; ++i) {
    x += std::cos(angles[i]);
    z += std::sin(angles[i]);
    positions.emplace_back(static_cast<double>(x), 0.0, static_cast<double>(z));
  }
  return positions;
}

/// Returns the positions of chain(links) after `duration` [m]. Half the step changes nothing above
/// 1e-13 m.
inline std::vector<Eigen::Vector3d> chain_reference(int links, double duration,
                                                    double step = 1.0 / 16.0) {
  const auto n = static_cast<std::size_t>(links);
  const int steps = static_cast<int>(std::ceil(duration / step));
  const Reals y =
      integrate(ChainInAngles(n), Reals(2 * n, Real{0}), static_cast<Real>(duration), steps);
  return chain_positions(y);
}

/// Returns the positions of heavy_chain() at `samples` times until `duration` [m]. The step is 4/ω,
/// with ω the fastest motion of the links; half the step changes nothing above 1e-11 m.
inline std::vector<std::vector<Eigen::Vector3d>> heavy_chain_references(double end_mass,
                                                                        bool moves_in_line,
                                                                        double duration,
                                                                        int samples) {
  constexpr std::size_t kLinks = 11;
  Reals y(2 * kLinks, -std::acos(Real{-1}) / 2);
  for (std::size_t i = 0; i < kLinks; ++i) y[kLinks + i] = 0;
  if (moves_in_line)
    for (std::size_t i = 0; i < kLinks; ++i) y[kLinks + i] = Real{1} / kLinks;
  else
    y[2 * kLinks - 1] = 1;
  const double fastest = std::sqrt(4.0 * end_mass * kGravity / 0.1);
  const Real interval = static_cast<Real>(duration) / samples;
  const int steps = static_cast<int>(std::ceil(0.25 * fastest * duration / samples));
  const ChainInAngles chain(kLinks, static_cast<Real>(end_mass), 0.1L);
  std::vector<std::vector<Eigen::Vector3d>> positions;
  for (int i = 0; i < samples; ++i) {
    y = integrate(chain, y, interval, steps);
    positions.push_back(chain_positions(y));
  }
  return positions;
}

/// Returns the positions of heavy_chain() at the end [m].
inline std::vector<Eigen::Vector3d> heavy_chain_reference(double end_mass, bool moves_in_line,
                                                          double duration) {
  return heavy_chain_references(end_mass, moves_in_line, duration, 1).back();
}

/// Returns the position of top k of four_bar(windows, is_loaded) after `duration`, relative to its
/// foot [m]. All uprights have one angle θ from the x axis, with M θ̈ = −M g cos θ − F sin θ.
inline Eigen::Vector3d four_bar_reference(int windows, bool is_loaded, double duration) {
  const Real mass = static_cast<Real>(windows + 1) + (is_loaded ? 2 : 0);
  const Real force = is_loaded ? 5 : 0;
  const auto rate = [&](const Reals& y) {
    return Reals{y[1],
                 -static_cast<Real>(kGravity) * std::cos(y[0]) - force / mass * std::sin(y[0])};
  };
  const Real upright = std::acos(Real{-1}) / 2;
  const int steps = static_cast<int>(std::ceil(32.0 * duration));
  const Reals y = integrate(rate, {upright, Real{-1}}, static_cast<Real>(duration), steps);
  return {static_cast<double>(std::cos(y[0])), 0.0, static_cast<double>(std::sin(y[0]))};
}

/// The box of free_box() after 10 s, exactly: published with the benchmark.
inline Eigen::Quaterniond free_box_orientation() {
  return {0.2251645634139582, -0.6199275624994525, -0.2770291506871946, 0.6987457236403101};
}

/// Returns the angle between two orientations [rad].
inline double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return 2.0 * (a.conjugate() * b).vec().norm();
}

/// Returns the largest difference of two states of a world [m]: positions, and rotations times the
/// radius of gyration.
inline double largest_difference(const World& a, const World& b) {
  double largest = 0.0;
  for (const BodyId id : a.body_ids()) {
    const Body& body = a.body(id);
    const Eigen::Vector3d inertia = body.inertia.isZero(0.0)
                                        ? Eigen::Vector3d(body.mass * unit_inertia(body.shape))
                                        : body.inertia;
    const double radius = std::sqrt(inertia.maxCoeff() / body.mass);
    largest = std::max(largest, (a.state(id).position - b.state(id).position).norm());
    largest =
        std::max(largest, radius * angle_between(a.state(id).orientation, b.state(id).orientation));
  }
  return largest;
}

inline double largest_distance(const World& world, const std::vector<Eigen::Vector3d>& positions) {
  double largest = 0.0;
  const std::vector<BodyId> ids = world.body_ids();
  for (std::size_t i = 0; i < positions.size(); ++i)
    largest = std::max(largest, (world.state(ids[i]).position - positions[i]).norm());
  return largest;
}

}  // namespace constraint_sim::engine::problems
