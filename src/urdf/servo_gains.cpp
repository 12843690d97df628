#include "urdf/servo_gains.h"

#include "engine/math/numbers.h"

namespace constraint_sim {

using Eigen::Vector3d;

double inertia_behind(const Lumps& lumps, const std::vector<engine::Body>& bodies, std::size_t lump,
                      const JointAxis& axis) {
  std::vector<char> is_behind(lumps.list.size(), 0);  // parents come first
  double sum = 0.0;
  for (std::size_t i = lump; i < lumps.list.size(); ++i) {
    const Lump& next = lumps.list[i];
    const bool hangs_on_a_joint =
        next.joint && next.joint->type != urdf::Joint::FLOATING &&
        is_behind[lumps.places.at(next.joint->parent_link_name).lump] != 0;
    if (i != lump && !hangs_on_a_joint) continue;
    is_behind[i] = 1;
    const engine::Body& body = bodies[i];
    if (axis.is_slider) {
      sum += body.mass;
      continue;
    }
    const Vector3d along = body.state.orientation.conjugate() * axis.direction;
    const double arm = axis.direction.cross(body.state.position - axis.point).squaredNorm();
    sum += along.cwiseAbs2().dot(body.inertia) + body.mass * arm;
  }
  return sum;
}

void set_servo_gains(double inertia, engine::Motor* motor) {
  if (!(motor->servo_frequency > 0.0)) return;
  const double omega = 2.0 * engine::kPi * motor->servo_frequency;
  motor->servo_stiffness = omega * omega * inertia;
  motor->servo_damping = 2.0 * motor->servo_damping_ratio * omega * inertia;
  motor->servo_frequency = 0.0;
  motor->servo_damping_ratio = 1.0;
}

}  // namespace constraint_sim
