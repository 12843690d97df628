#include "engine/methods/sequential_impulses.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

double velocity_along(const Row& row, const std::vector<BodyState>& bodies) {
  const BodyState& a = bodies[static_cast<std::size_t>(row.body_a)];
  const BodyState& b = bodies[static_cast<std::size_t>(row.body_b)];
  return row.J.times(a.linear_velocity, a.angular_velocity, b.linear_velocity, b.angular_velocity);
}

// the impulse, so far and in all, that meets J V = target − softness·p
double wanted_impulse(const Row& row, double inverse_mass, const std::vector<BodyState>& bodies) {
  const double J_V = velocity_along(row, bodies);
  return row.impulse + (row.target - row.softness * row.impulse - J_V) * inverse_mass;
}

}  // namespace

void SequentialImpulses::update_velocities(const std::vector<int>& moved, Bodies& bodies,
                                           const Masses& masses, const Vector3d& gravity, double h,
                                           const std::vector<Row>& rows) {
  for (const int i : moved) bodies[static_cast<std::size_t>(i)].linear_velocity += h * gravity;

  respond(moved, rows, bodies, masses);
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i].impulse != 0.0) push(i, rows[i].impulse, rows, bodies);
}

void SequentialImpulses::solve(Bodies& bodies, std::vector<Row>& rows, int iterations,
                               StopFlag stop) const {
  const auto change_to = [&](std::size_t i, double impulse) {
    push(i, impulse - rows[i].impulse, rows, bodies);
    rows[i].impulse = impulse;
  };
  for (int sweep = 0; sweep < iterations && !is_set(stop); ++sweep) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Row& row = rows[i];
      const double inverse_mass = responses_[i].inverse_mass;
      if (row.normal_row < 0) {
        const double p = wanted_impulse(row, inverse_mass, bodies);
        change_to(i, std::clamp(p, row.lower, row.upper));
        continue;
      }
      // friction: both tangents by one mass, or sliding would not be braked straight against its
      // direction; then back onto Coulomb's disk
      const double limit = row.friction * rows[static_cast<std::size_t>(row.normal_row)].impulse;
      const double smaller = std::min(inverse_mass, responses_[i + 1].inverse_mass);
      const double p_1 = wanted_impulse(row, smaller, bodies);
      const double p_2 = wanted_impulse(rows[i + 1], smaller, bodies);
      const double length = std::hypot(p_1, p_2);
      const double share = length > limit ? limit / length : 1.0;
      change_to(i, share * p_1);
      change_to(i + 1, share * p_2);
      ++i;
    }
  }
}

void SequentialImpulses::update_positions(const std::vector<int>& moved, Bodies& bodies,
                                          const Masses& masses, double h) {
  for (const int index : moved) {
    const auto i = static_cast<std::size_t>(index);
    BodyState& body = bodies[i];
    body.position += h * body.linear_velocity;
    if (body.angular_velocity.isZero(0.0)) continue;

    const Quaterniond q0 = body.orientation;
    body.orientation = (rotation(h * body.angular_velocity) * q0).normalized();
    if (!masses[i].can_turn() || masses[i].is_isotropic()) continue;
    const Vector3d L = apply_inertia(masses[i].inertia, q0, body.angular_velocity);
    body.angular_velocity = apply_inertia(masses[i].inverse_inertia, body.orientation, L);
  }
}

// M⁻¹ Jᵀ and the constraint mass of each row at the positions before the step
void SequentialImpulses::respond(const std::vector<int>& moved, const std::vector<Row>& rows,
                                 const Bodies& bodies, const Masses& masses) {
  inverse_inertia_W_.assign(bodies.size(), Matrix3d::Zero());
  for (const int index : moved) {
    const auto i = static_cast<std::size_t>(index);
    if (!masses[i].can_turn()) continue;
    const Matrix3d R = bodies[i].orientation.toRotationMatrix();
    inverse_inertia_W_[i] = R * masses[i].inverse_inertia.asDiagonal() * R.transpose();
  }
  responses_.resize(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const auto a = static_cast<std::size_t>(row.body_a);
    const auto b = static_cast<std::size_t>(row.body_b);
    Response& r = responses_[i];
    r.v_A = masses[a].inverse_mass * row.J.j1;
    r.w_A = inverse_inertia_W_[a] * row.J.j2;
    r.v_B = masses[b].inverse_mass * row.J.j3;
    r.w_B = inverse_inertia_W_[b] * row.J.j4;
    const double constraint_mass = row.J.times(r.v_A, r.w_A, r.v_B, r.w_B) + row.softness;
    r.inverse_mass = constraint_mass > 0.0 ? 1.0 / constraint_mass : 0.0;
  }
}

void SequentialImpulses::push(std::size_t i, double impulse, const std::vector<Row>& rows,
                              Bodies& bodies) const {
  BodyState& a = bodies[static_cast<std::size_t>(rows[i].body_a)];
  BodyState& b = bodies[static_cast<std::size_t>(rows[i].body_b)];
  const Response& r = responses_[i];
  a.linear_velocity += impulse * r.v_A;
  a.angular_velocity += impulse * r.w_A;
  b.linear_velocity += impulse * r.v_B;
  b.angular_velocity += impulse * r.w_B;
}

}  // namespace constraint_sim::engine
