#include "engine/dynamics/endpoint_estimate.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

namespace {

// Error of Simpson's rule from the ends and the middle of an interval 2 h (order 4), or second
// difference of the velocities (order 2).
double endpoint_error(const Vector3d& moved, const Vector3d& v_a, const Vector3d& v_b,
                      const Vector3d& v_c, double h, bool is_order_4) {
  const Vector3d ends = v_a + v_c;
  return is_order_4 ? (moved - h / 3.0 * (ends + 4.0 * v_b)).norm() : (ends - 2.0 * v_b).norm();
}

// Angular velocity of a body from the velocities of three points at equal arms along its axes.
Vector3d spin_of(const Vector3d* arms, const Vector3d* velocities) {
  Vector3d sum = Vector3d::Zero();
  for (int k = 0; k < 3; ++k) sum += arms[k].cross(velocities[k]);
  return sum / (2.0 * arms[0].squaredNorm());
}

}  // namespace

double EndpointEstimate::first(double h, bool is_order_4, int parts, std::size_t bodies) {
  // each half is off by as much
  return keep(
      h, 2.0 * largest(last_, middle_, end_, 0.5 * h, is_order_4, std::max(parts / 2, 1), bodies));
}

double EndpointEstimate::next(double h, bool is_order_4, int parts, std::size_t bodies) {
  return keep(h, are_equal_steps(h, tick_)
                     ? largest(before_, last_, end_, h, is_order_4, parts, bodies)
                     : estimate_);
}

double EndpointEstimate::largest(const Points& a, const Points& b, const Points& c, double h,
                                 bool is_order_4, int parts, std::size_t bodies) const {
  const double share =
      is_order_4 ? 1.0 / (1.0 * parts * parts * parts * parts) : h / (6.0 * parts * parts);
  const std::size_t size = c.position.size();
  for (const Points* points : {&a, &b, &c})
    if (points->position.size() != size || points->velocity.size() != size)
      return estimate_;  // a snapshot edited by hand
  double error = 0.0;
  for (std::size_t i = 0; i < std::min(bodies, size); ++i)
    error = std::max(error, endpoint_error(c.position[i] - a.position[i], a.velocity[i],
                                           b.velocity[i], c.velocity[i], h, is_order_4));
  error *= share;
  // Rotating bodies come first.
  for (std::size_t body = 0, first = bodies; first + 2 < size; ++body, first += 3) {
    std::array<Vector3d, 3> arms[3], velocities[3];  // times a, b and c
    for (std::size_t k = 0; k < 3; ++k) {
      for (const auto& [points, time] :
           {std::pair{&a, std::size_t{0}}, {&b, std::size_t{1}}, {&c, std::size_t{2}}}) {
        arms[time][k] = points->position[first + k] - points->position[body];
        velocities[time][k] = points->velocity[first + k] - points->velocity[body];
      }
    }
    const Vector3d spin = spin_of(arms[1].data(), velocities[1].data());
    const double speed = spin.norm();
    const double radius = arms[1][0].norm();
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    if (speed > 0.0) turn = rotation(h * spin).toRotationMatrix();
    double square = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d at_a = turn * arms[0][k], at_c = turn.transpose() * arms[2][k];
      const Vector3d v_a = turn * (velocities[0][k] - spin.cross(arms[0][k]));
      const Vector3d v_b = velocities[1][k] - spin.cross(arms[1][k]);
      const Vector3d v_c = turn.transpose() * (velocities[2][k] - spin.cross(arms[2][k]));
      const double of = endpoint_error(at_c - at_a, v_a, v_b, v_c, h, is_order_4);
      square = std::max(square, of * of);
    }
    const double angle = h * speed / parts;
    const double left = is_order_4 ? angle * angle * angle * angle / 1075.0 : angle * angle / 12.0;
    error = std::max(error, share * std::sqrt(square) + std::min(left, 1.0) * radius * h * speed);
  }
  return error;
}

double EndpointEstimate::keep(double h, double estimate) {
  std::swap(before_, last_);
  std::swap(last_, end_);
  tick_ = h;
  return estimate_ = estimate;
}

}  // namespace constraint_sim::engine
