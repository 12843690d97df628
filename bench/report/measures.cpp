#include "measures.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "references.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Raises a maximum; keeps NaN, which std::max would drop.
void raise(double* largest, double value) {
  if (std::isnan(*largest) || std::isnan(value))
    *largest = kNaN;
  else
    *largest = std::max(*largest, value);
}

std::size_t index(int i) { return static_cast<std::size_t>(i); }

Vector3d anchor(const States& states, int body, const Vector3d& local) {
  if (body == kWorld) return local;
  const State& state = states[index(body)];
  return state.position + state.orientation * local;
}

double distance(const Joint& joint, const States& states) {
  return (anchor(states, joint.b, joint.anchor_b) - anchor(states, joint.a, joint.anchor_a)).norm();
}

double rest_length(const Problem& problem, const Joint& joint) {
  if (joint.kind == JointKind::kBall) return 0.0;
  if (joint.length >= 0.0) return joint.length;
  States start;
  start.reserve(problem.bodies.size());
  for (const Body& body : problem.bodies) start.push_back(body.start);
  return distance(joint, start);
}

Vector3d spin(const Body& body, const State& state) {
  return state.orientation *
         body.inertia.cwiseProduct(state.orientation.conjugate() * state.angular_velocity);
}

Vector3d linear_momentum(const Problem& problem, const States& states) {
  Vector3d sum = Vector3d::Zero();
  for (std::size_t i = 0; i < states.size(); ++i)
    if (!problem.bodies[i].is_static) sum += problem.bodies[i].mass * states[i].velocity;
  return sum;
}

Vector3d angular_momentum(const Problem& problem, const States& states) {
  Vector3d sum = Vector3d::Zero();
  for (std::size_t i = 0; i < states.size(); ++i) {
    const Body& body = problem.bodies[i];
    if (body.is_static) continue;
    sum += body.mass * states[i].position.cross(states[i].velocity) + spin(body, states[i]);
  }
  return sum;
}

double pair_penetration(const Body& a, const State& state_a, const Body& b, const State& state_b) {
  if (a.shape == Shape::kSphere && b.shape == Shape::kSphere)
    return a.size.x() + b.size.x() - (state_a.position - state_b.position).norm();
  if (b.shape != Shape::kPlane) return 0.0;
  const Vector3d normal = state_b.orientation * Vector3d::UnitZ();
  const double height = normal.dot(state_a.position - state_b.position);
  if (a.shape == Shape::kSphere) return a.size.x() - height;
  if (a.shape == Shape::kBox)
    return (state_a.orientation.conjugate() * normal).cwiseAbs().dot(a.size) / 2.0 - height;
  return 0.0;
}

double error_of_axes(const Problem& problem, const States& states) {
  const engine::reference::Mechanics mechanics(axes_of(problem, false));
  std::vector<engine::reference::Pose> poses;
  for (const State& state : states)
    poses.push_back(engine::reference::pose_of(
        {state.position, state.orientation, state.velocity, state.angular_velocity},
        mechanics.origin()));
  return mechanics.worst_joint(poses, 0.0).first;
}

}  // namespace

double kinetic_energy(const Problem& problem, const States& states) {
  double sum = 0.0;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const Body& body = problem.bodies[i];
    if (body.is_static) continue;
    sum += 0.5 * body.mass * states[i].velocity.squaredNorm() +
           0.5 * states[i].angular_velocity.dot(spin(body, states[i]));
  }
  return sum;
}

double energy(const Problem& problem, const States& states) {
  double sum = kinetic_energy(problem, states);
  for (std::size_t i = 0; i < states.size(); ++i) {
    const Body& body = problem.bodies[i];
    if (body.is_static) continue;
    sum -= (body.mass * problem.gravity + body.force).dot(states[i].position);
  }
  for (const Joint& joint : problem.joints) {
    if (joint.kind != JointKind::kSpring) continue;
    const double stretch = distance(joint, states) - rest_length(problem, joint);
    sum += 0.5 * joint.stiffness * stretch * stretch;
  }
  return sum;
}

double constraint_error(const Problem& problem, const States& states, double time) {
  double largest = 0.0;
  bool any_axes = false;
  for (const Joint& joint : problem.joints) {
    any_axes = any_axes || has_axes(joint.kind);
    const bool is_slack = joint.is_rope() && distance(joint, states) < joint.upper;
    if (joint.is_rope() && joint.max_force == 0.0 && !is_slack)
      raise(&largest, distance(joint, states) - joint.upper);
    if (joint.kind != JointKind::kSpring && joint.kind != JointKind::kFreeLength &&
        joint.break_force == 0.0 && !has_axes(joint.kind))
      raise(&largest,
            std::abs(distance(joint, states) - rest_length(problem, joint) - joint.rate * time));
  }
  if (any_axes) raise(&largest, error_of_axes(problem, states));
  return largest;
}

double penetration(const Problem& problem, const States& states) {
  double deepest = 0.0;
  const auto add_pair = [&](std::size_t i, std::size_t j) {
    raise(&deepest, pair_penetration(problem.bodies[i], states[i], problem.bodies[j], states[j]));
  };
  std::vector<std::size_t> spheres;
  double radius = 0.0;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const Body& body = problem.bodies[i];
    if (body.shape == Shape::kPlane)
      for (std::size_t j = 0; j < states.size(); ++j)
        if (i != j) add_pair(j, i);
    if (body.shape != Shape::kSphere) continue;
    if (!states[i].position.allFinite()) return kNaN;  // NaN cannot be sorted
    spheres.push_back(i);
    radius = std::max(radius, body.size.x());
  }
  // Spheres are sorted along x, so that only near pairs are tested.
  const auto x = [&](std::size_t i) { return states[i].position.x(); };
  std::sort(spheres.begin(), spheres.end(),
            [&](std::size_t i, std::size_t j) { return x(i) < x(j); });
  for (std::size_t k = 0; k < spheres.size(); ++k)
    for (std::size_t l = k + 1; l < spheres.size(); ++l) {
      if (x(spheres[l]) - x(spheres[k]) > 2.0 * radius) break;
      add_pair(spheres[k], spheres[l]);
    }
  return deepest;
}

double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  const Eigen::Quaterniond turn = a.normalized().conjugate() * b.normalized();
  return 2.0 * std::atan2(turn.vec().norm(), std::abs(turn.w()));
}

bool is_finite(const States& states) {
  return std::all_of(states.begin(), states.end(), [](const State& state) {
    return state.position.allFinite() && state.velocity.allFinite() &&
           state.orientation.coeffs().allFinite() && state.angular_velocity.allFinite();
  });
}

Errors errors(const Problem& problem, const Motion& motion, const Trajectory& reference) {
  const bool is_known = !reference.empty();
  const bool has_joints =
      std::any_of(problem.joints.begin(), problem.joints.end(),
                  [](const Joint& joint) { return joint.kind != JointKind::kSpring; });
  std::vector<int> measured = problem.measured;
  if (measured.empty())
    for (std::size_t i = 0; i < problem.bodies.size(); ++i)
      if (!problem.bodies[i].is_static) measured.push_back(static_cast<int>(i));
  const bool turns = std::any_of(measured.begin(), measured.end(), [&](int i) {
    return !problem.bodies[index(i)].inertia.isZero(0.0);
  });

  // Scale of energy: the largest kinetic energy, of the reference where there is one.
  double kinetic = 0.0, linear = 0.0, angular = 0.0;
  for (const States& states : is_known ? reference : motion.states) {
    kinetic = std::max(kinetic, kinetic_energy(problem, states));
    linear = std::max(linear, linear_momentum(problem, states).norm());
    angular = std::max(angular, angular_momentum(problem, states).norm());
  }
  // For a scene at rest the scale is its weight times its size.
  double weight = 0.0;
  for (const Body& body : problem.bodies)
    if (!body.is_static) weight += body.mass * problem.gravity.norm();
  if (!(kinetic > 1e-6 * weight * problem.length)) kinetic = weight * problem.length;

  Errors worst{is_known ? 0.0 : kNaN,
               is_known && turns ? 0.0 : kNaN,
               problem.is_conservative && kinetic > 0.0 ? 0.0 : kNaN,
               is_known && problem.measured.empty() && (linear > 0.0 || angular > 0.0) ? 0.0 : kNaN,
               has_joints ? 0.0 : kNaN,
               problem.has_shapes() ? 0.0 : kNaN};
  const double start = energy(problem, motion.states.front());
  for (std::size_t k = 1; k < motion.states.size(); ++k) {
    const States& states = motion.states[k];
    if (problem.is_conservative && kinetic > 0.0)
      raise(&worst.energy, std::abs(energy(problem, states) - start) / kinetic);
    if (has_joints)
      raise(&worst.constraint,
            constraint_error(problem, states, motion.sample[k] * problem.sample));
    if (problem.has_shapes()) raise(&worst.penetration, penetration(problem, states));
    if (!is_known) continue;
    const States& exact = reference[index(motion.sample[k])];
    for (const int i : measured) {
      const State& is = states[index(i)];
      const State& should = exact[index(i)];
      raise(&worst.position, (is.position - should.position).norm());
      if (!problem.bodies[index(i)].inertia.isZero(0.0))
        raise(&worst.orientation, angle_between(is.orientation, should.orientation));
    }
    if (std::isnan(worst.momentum)) continue;
    if (linear > 0.0)
      raise(&worst.momentum,
            (linear_momentum(problem, states) - linear_momentum(problem, exact)).norm() / linear);
    if (angular > 0.0)
      raise(
          &worst.momentum,
          (angular_momentum(problem, states) - angular_momentum(problem, exact)).norm() / angular);
  }
  return worst;
}

double largest_difference(const Problem& problem, const Trajectory& a, const Trajectory& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k)
    for (std::size_t i = 0; i < a[k].size(); ++i) {
      raise(&largest, (a[k][i].position - b[k][i].position).norm());
      raise(&largest, problem.length * angle_between(a[k][i].orientation, b[k][i].orientation));
    }
  return largest;
}

}  // namespace constraint_sim::report
