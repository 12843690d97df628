#pragma once

// Helpers shared by the tests of the engine's physics.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "draw.h"
#include "engine/math/numbers.h"
#include "inertia_of.h"
#include "make_scene.h"
#include "sanitized.h"

namespace constraint_sim::engine {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class Random : public Draw {
 public:
  Random() : Draw(2024) {}
  Eigen::Quaterniond orientation() { return turn(); }
  BodyState state() {
    const Eigen::Vector3d position = 2.0 * vector();
    const Eigen::Quaterniond q = orientation();
    const Eigen::Vector3d v = vector();
    return {position, q, v, vector()};
  }
};

/// Returns the message of a rejection; empty where the attempt succeeds.
inline std::string refusal(const std::function<void()>& attempt) {
  try {
    attempt();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// Returns the warnings of the last step without notices.
inline std::vector<StepWarning> faults_of(const World& world) {
  std::vector<StepWarning> list = world.warnings();
  list.erase(
      std::remove_if(list.begin(), list.end(),
                     [](const StepWarning& warning) { return info(warning.kind).is_notice; }),
      list.end());
  return list;
}

// ---- worlds

/// Returns number i of several boxes that tumble onto a floor and each other.
inline Body make_tumbling_box(int i, Random* random) {
  Body body = make_body("box_" + std::to_string(i), Box{{0.4, 0.3, 0.5}}, 1.0 + 0.1 * i,
                        {0.3 * i, 0.1 * (*random)(), 0.5 + 0.4 * (i % 3)});
  body.state.orientation = random->orientation();
  body.state.angular_velocity = random->vector();
  body.friction = 0.5;
  return body;
}

inline double distance(const World& world, JointId id) {
  const World::Anchors anchors = world.anchors(id);
  return (anchors.p_b - anchors.p_a).norm();
}

inline void run(World& world, int steps) {
  for (int i = 0; i < steps; ++i)
    ASSERT_FALSE(world.step().outcome.failed) << "at t = " << world.time();
}

// ---- methods and motors

inline constexpr std::array<Method, 2> kSmoothMethods{Method::kRungeKutta, Method::kEnergyMomentum};

/// Returns the index of a method in lists with an entry per method.
inline std::size_t index_of(Method method) { return static_cast<std::size_t>(method); }

/// Returns a motor of constant rate; 0 is no limit of force, and no timeout.
inline Motor rate_motor(double bias, double max_force = 0.0, double timeout = 0.0) {
  Motor motor;
  motor.bias = bias;
  motor.max_force = max_force;
  motor.timeout = timeout;
  return motor;
}

// ---- poses

/// States of the two bodies of a joint.
struct PairPose {
  BodyState a, b;
};

/// Returns a body after moving for `time` with velocity v and angular velocity w.
inline BodyState moved(BodyState body, const Eigen::Vector3d& v, const Eigen::Vector3d& w,
                       double time) {
  body.position += time * v;
  if (w.norm() > 0.0)
    body.orientation = Eigen::AngleAxisd(time * w.norm(), w.normalized()) * body.orientation;
  return body;
}

// ---- figures

/// Returns the overlap allowed for contacts at rest: the fall of one step [m].
inline double slop(const World& world) {
  const double h = world.options().time_step;
  return world.options().gravity.norm() * h * h;
}

/// Returns the rounding error allowed for a rod, by the project's definition [m].
inline double round_off(const World& world) {
  double coordinate = 0.0;
  for (const BodyId id : world.body_ids())
    coordinate = std::max(coordinate, world.state(id).position.cwiseAbs().maxCoeff());
  return 1e-12 + 4.0 * kEpsilon * coordinate;
}

/// Returns the momentum of all dynamic bodies [kg m/s].
inline Eigen::Vector3d momentum(const World& world) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const BodyId id : world.body_ids())
    if (world.body(id).type == BodyType::kDynamic)
      sum += world.body(id).mass * world.state(id).linear_velocity;
  return sum;
}

/// Returns the angular momentum of all dynamic bodies about the world's origin [kg m²/s].
inline Eigen::Vector3d angular_momentum(const World& world) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const BodyId id : world.body_ids()) {
    const Body& body = world.body(id);
    if (body.type != BodyType::kDynamic) continue;
    const BodyState& state = world.state(id);
    const Eigen::Quaterniond& q = state.orientation;
    const Eigen::Vector3d w_B = q.conjugate() * state.angular_velocity;
    sum += body.mass * state.position.cross(state.linear_velocity) +
           q * inertia_of(body).cwiseProduct(w_B);
  }
  return sum;
}

/// Returns the order p of errors that fall as step^p, by least squares.
inline double order(const std::vector<double>& steps, const std::vector<double>& errors) {
  const auto n = static_cast<double>(steps.size());
  double x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const double log_step = std::log(steps[i]);
    const double log_error = std::log(errors[i]);
    x += log_step;
    y += log_error;
    xx += log_step * log_step;
    xy += log_step * log_error;
  }
  return (n * xy - x * y) / (n * xx - x * x);
}

/// Returns the sum of all contact forces on a body [N].
inline Eigen::Vector3d contact_force_on(const World& world, BodyId body) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Contact& contact : world.contacts()) {
    if (contact.body_a == body) sum += contact.force;
    if (contact.body_b == body) sum -= contact.force;
  }
  return sum;
}

}  // namespace constraint_sim::engine
