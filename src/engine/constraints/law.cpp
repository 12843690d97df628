#include "engine/constraints/law.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/target.h"

namespace constraint_sim::engine {
namespace {

// Time in which a motor to a position, which a force limit or a contact kept from following its
// prescribed motion, covers 63 % of the distance back by impulses [s]. Half the closing time would
// be faster than most such motors can brake.
constexpr double kReturnTime = 1.0;

Row row_at(const CoordinateMotion& motion, double C) {
  Row row;
  row.J = motion.J;
  row.C = C;
  return row;
}

// Writes p = h (F − K (q + h q̇) − C q̇) by implicit Euler, or a constant impulse.
Row soft_row(const SoftLaw& law, const CoordinateMotion& motion, double h) {
  Row row = row_at(motion, motion.q - law.R);
  if (law.K == 0.0 && law.C == 0.0) {
    row.lower = row.upper = row.impulse = h * law.F;
    return row;
  }
  set_bias_soft(row, law.K, law.C, h);
  row.target += row.softness * h * law.F;
  return row;
}

Row limit_row(const CoordinateLaw& law, const CoordinateMotion& motion,
              const CoordinateStep& step) {
  const bool is_upper = law.upper - motion.q < motion.q - law.lower;
  Row row = row_at(motion, motion.q - (is_upper ? law.upper : law.lower));
  (is_upper ? row.upper : row.lower) = 0.0;
  const double approach = is_upper ? motion.rate : -motion.rate;
  const double gap = is_upper ? -row.C : row.C;
  if (law.limit_restitution > 0.0 && approach > 0.0 && gap < step.h * approach) {
    // Bounces in this step, since a limit row would slow the coordinate down before it arrives.
    row.target = -law.limit_restitution * motion.rate;
    return row;
  }
  set_bias_limit(row, step.beta, step.h);
  return row;
}

}  // namespace

SoftLaw length_spring(const Joint& joint) {
  const DistanceJoint& distance = joint.distance;
  if (!has_length(joint.kind) || !distance.is_soft()) return {};
  return {distance.stiffness, distance.length.value_or(0.0), distance.damping, 0.0};
}

bool has_limits(const Joint& joint) {
  return (has_length(joint.kind) && (joint.distance.is_limited() || joint.distance.one_sided)) ||
         joint.coupling.one_sided ||
         any_coordinate(joint, [](const CoordinateLaw& law) { return law.is_limited(); });
}

SoftLaw soft_law(const CoordinateLaw& law) {
  if (is_held(law)) return {};
  SoftLaw soft{law.stiffness, law.rest, law.damping, 0.0};
  if (!law.motor || law.motor->max_force > 0.0) return soft;
  if (law.motor->is_servo()) {
    const double K = law.stiffness + law.motor->servo_stiffness;
    if (K > 0.0)
      soft.R = (law.stiffness * law.rest + law.motor->servo_stiffness * *law.motor->position) / K;
    soft.K = K;
    soft.C += law.motor->servo_damping;
  }
  soft.F = law.motor->force.value_or(0.0);
  return soft;
}

SoftLaw limited_servo(const CoordinateLaw& law) {
  if (!law.motor || !law.motor->is_servo() || law.motor->max_force == 0.0) return {};
  return {law.motor->servo_stiffness, *law.motor->position, law.motor->servo_damping, 0.0};
}

SoftLaw together(const SoftLaw& a, const SoftLaw& b) {
  SoftLaw sum{a.K + b.K, a.R, a.C + b.C, a.F + b.F};
  if (sum.K > 0.0) sum.R = (a.K * a.R + b.K * b.R) / sum.K;
  return sum;
}

bool has_moving_motor(const Joint& joint) {
  return joint.motor.is_moving() || any_coordinate(joint, [](const CoordinateLaw& law) {
           return law.motor && law.motor->is_moving();
         });
}

double elastic_energy(double stiffness, double stretch, double most) {
  const double x = std::abs(stretch);
  if (most == 0.0 || stiffness * x <= most) return 0.5 * stiffness * x * x;
  return most * (x - 0.5 * most / stiffness);
}

double elastic_energy(const CoordinateLaw& law, double q) {
  double energy = elastic_energy(law.stiffness, q - law.rest, 0.0);
  if (law.motor && law.motor->is_servo())
    energy +=
        elastic_energy(law.motor->servo_stiffness, q - *law.motor->position, law.motor->max_force);
  return energy;
}

int write_law_rows(const CoordinateLaw& law, const CoordinateMotion& motion,
                   const CoordinateStep& step, int component, Row* rows) {
  int count = 0;
  if (law.motor) {
    const Motor& motor = *law.motor;
    if (motor.is_rigid()) {
      Row& row = rows[count++] = row_at(motion, motion.q - step.target);
      row.target = row.drive = step.bias;
      set_bias_rigid(row, step.beta, step.h);
      row.component = component;
      if (motor.max_force > 0.0) {
        // A contact that stops the motor bears its force in the velocities, where friction counts.
        if (motor.position) row.target = row.drive = step.bias - row.C / (kReturnTime + step.h);
        limit_force(row, motor.max_force, step.h);
      }
    } else if (motor.max_force > 0.0) {  // a servo or force with a force limit
      SoftLaw own = limited_servo(law);
      own.F = std::clamp(motor.force.value_or(0.0), -motor.max_force, motor.max_force);
      Row& row = rows[count++] = soft_row(own, motion, step.h);
      limit_force(row, motor.max_force, step.h);
    }
  }
  const SoftLaw soft = soft_law(law);
  if (!soft.is_none()) rows[count++] = soft_row(soft, motion, step.h);
  if (law.is_limited()) rows[count++] = limit_row(law, motion, step);
  if (law.friction > 0.0) {
    Row& row = rows[count++] = row_at(motion, 0.0);
    limit_force(row, law.friction, step.h);
  }
  return count;
}

double beyond_limits(const CoordinateLaw& law, double q) {
  return std::max(q - law.upper, 0.0) + std::min(q - law.lower, 0.0);
}

}  // namespace constraint_sim::engine
