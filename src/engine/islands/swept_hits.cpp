#include "engine/islands/swept_hits.h"

#include <algorithm>
#include <cmath>

#include "engine/impulses/free_turn.h"
#include "engine/islands/motion_bounds.h"
#include "engine/islands/rollback.h"
#include "engine/islands/step.h"
#include "engine/model/impulse_method.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kMostAdvances = 100;  // conservative advances towards a hit
constexpr int kMostPlaces = 2000;   // poses tried along the paths of a pair
// Relative rounding of inertias that are typed or computed.
constexpr double kEqualMoments = 1e-9;

/// Returns a bound of the angular speed of a body without torque [rad/s], and a tenth of it for the
/// error of a rotation by a step of up to kMostSweptTurn. The kinetic energy 2T = Σ I ω² stays, so
/// |ω| ≤ √(2T / I_min). A body with two equal moments precesses at its |ω|.
double fastest_turn(const BodyState& state, const MassProperties& mass) {
  const double w = state.angular_velocity.norm();
  if (!mass.can_turn() || mass.is_isotropic()) return w;
  const Vector3d& I = mass.inertia;
  const auto are_equal = [](double a, double b) { return std::abs(a - b) <= kEqualMoments * a; };
  if (are_equal(I.x(), I.y()) || are_equal(I.y(), I.z()) || are_equal(I.z(), I.x())) return 1.1 * w;
  const Vector3d w_B = state.orientation.conjugate() * state.angular_velocity;
  return 1.1 * std::sqrt(w_B.cwiseAbs2().dot(I) / I.minCoeff());
}

/// Path of a body within a step, at the share s in [0, 1] of the step. Positions lie on the cubic
/// with the positions and velocities of both ends; the body turns evenly.
struct Path {
  Vector3d x0, x1, m0, m1;
  Quaterniond q0;
  Vector3d turn, rest;  // rotation by the mean angular velocity, and from there to the end [rad]

  Path(const BodyState& from, const BodyState& to, double h)
      : x0(from.position),
        x1(to.position),
        m0(h * from.linear_velocity),
        m1(h * to.linear_velocity),
        q0(from.orientation),
        turn(0.5 * h * (from.angular_velocity + to.angular_velocity)) {
    rest = rotation_vector(to.orientation * (rotation(turn) * q0).conjugate());
  }
  BodyState at(double s) const {
    const double t = 1.0 - s;
    BodyState state;
    state.position = t * t * (1.0 + 2.0 * s) * x0 + s * t * t * m0 + s * s * (3.0 - 2.0 * s) * x1 -
                     s * s * t * m1;
    state.orientation = rotation(s * rest) * (rotation(s * turn) * q0);
    return state;
  }
  // Bounds of the derivatives by s: of the centre [m] and, as angle(), of the orientation [rad].
  double displacement() const {
    return std::max({m0.norm(), m1.norm(), (3.0 * (x1 - x0) - m0 - m1).norm()});
  }
  double angle() const { return turn.norm() + rest.norm(); }
};

}  // namespace

BodyState moved(const BodyState& state, const MassProperties& mass, const Vector3d& gravity,
                double t) {
  BodyState later = state;
  later.position += t * (state.linear_velocity + t * gravity);
  advance_orientation(mass, t, &later);
  return later;
}

std::optional<double> time_of_hit(const StepContext& step, const State& state,
                                  const Broadphase::Pair& pair, double duration, int* advances) {
  const Model& model = step.model;
  const std::size_t i = to_index(pair.first);
  const std::size_t j = to_index(pair.second);
  const Vector3d none = Vector3d::Zero();
  const Vector3d g_i = model.is_movable(i) ? model.gravity_on(i) : none;
  const Vector3d g_j = model.is_movable(j) ? model.gravity_on(j) : none;
  const Vector3d v = state.states[i].linear_velocity - state.states[j].linear_velocity;
  const double far = (state.states[i].position - state.states[j].position).norm() +
                     max_point_displacement(step, state.states[i], pair.first, duration) +
                     max_point_displacement(step, state.states[j], pair.second, duration);
  const double spin =
      fastest_turn(state.states[i], model.masses[i]) * swing_radius(model.bodies[i], far) +
      fastest_turn(state.states[j], model.masses[j]) * swing_radius(model.bodies[j], far);
  const double near = kNearShare * thinner_of(model, pair);
  double t = 0.0;
  for (int k = 0; k < kMostAdvances; ++k) {
    if (is_set(step.stop)) return std::nullopt;
    if (advances != nullptr) ++*advances;
    const BodyState later_i = moved(state.states[i], model.masses[i], g_i, t);
    const BodyState later_j = moved(state.states[j], model.masses[j], g_j, t);
    const Separation apart = separation_of(model, pair, later_i, later_j);
    const double left = duration - t;
    const double falling = std::max(0.0, -apart.normal.dot(g_i - g_j));
    const double closing = spin - apart.normal.dot(v + 2.0 * t * (g_i - g_j)) + left * falling;
    if (apart.gap <= near && closing > 0.0) return t;
    if (!(closing * left > apart.gap - near)) return std::nullopt;
    t += std::max(apart.gap, near) / closing;
    if (t >= duration) return std::nullopt;
  }
  return t;  // The pair is apart until t; the next part of the step searches on.
}

bool passes(const StepContext& step, const State& state, const Rollback& rollback,
            const Broadphase::Pair& pair) {
  const Model& model = step.model;
  const double h = model.options.time_step;
  const std::size_t i = to_index(pair.first), j = to_index(pair.second);
  const auto path_of = [&](std::size_t body) {
    if (model.is_movable(body) && !state.asleep[body])
      return Path(rollback.states()[body], state.states[body], h);
    BodyState later = state.states[body];  // kinematic and sleeping bodies have not moved
    later.position += h * later.linear_velocity;
    later.orientation = rotation(h * later.angular_velocity) * later.orientation;
    return Path(state.states[body], later, h);
  };
  const Path of_i = path_of(i), of_j = path_of(j);
  const double far = (of_i.x0 - of_j.x0).norm() + of_i.displacement() + of_j.displacement();
  const double bound = of_i.displacement() + of_j.displacement() +
                       of_i.angle() * swing_radius(model.bodies[i], far) +
                       of_j.angle() * swing_radius(model.bodies[j], far);
  const double least = fast_share(model.options) * thinner_of(model, pair);
  const auto gap_at = [&](double s) {
    return separation_of(model, pair, of_i.at(s), of_j.at(s)).gap;
  };
  double s = 0.0;
  for (int k = 0; k < kMostPlaces && s < 1.0; ++k) {
    if (is_set(step.stop)) return false;
    const double gap = gap_at(s);
    if (gap <= 0.0 && s > 0.0) return true;
    if (gap > (1.0 - s) * bound) return false;
    s += std::max(gap, least) / bound;
  }
  // After kMostPlaces poses a pair counts as passing.
  return s < 1.0 || (controls_contacts(model.options) && gap_at(1.0) <= 0.0);
}

}  // namespace constraint_sim::engine
