#pragma once

// Robots moved by a little along their coordinates, for differences of poses and dynamics.

#include <cmath>

#include "constraint_sim/engine/robot_dynamics.h"
#include "support.h"

namespace constraint_sim::engine {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Returns the robot of the body that was added last.
inline RobotDynamics last_robot(const World& world) {
  return RobotDynamics(world, world.body_ids().back());
}

/// Whether the world has a kinematic base.
inline bool is_on_base(const World& world) { return world.has_body("base"); }

/// Returns the world with the robot in the pose after a short time h [s], negative: backwards, in
/// which it moved without forces, starting at `rates`. Its bodies move with its base.
inline World displaced(const World& world, const RobotDynamics& robot, const Eigen::VectorXd& rates,
                       double h) {
  World flow = world;
  WorldOptions options = flow.options();
  options.gravity.setZero();
  options.time_step = std::abs(h);
  options.tolerance = 1e-13;
  flow.set_options(options);
  if (is_on_base(flow)) {
    BodyState still = flow.state(flow.find_body("base"));
    still.linear_velocity.setZero();
    still.angular_velocity.setZero();
    flow.set_state(flow.find_body("base"), still);
  }
  for (const JointId id : flow.joint_ids())
    for (int c = 0; c < info(flow.joint(id).kind).coordinates; ++c) flow.set_law(id, c, {});
  for (const BodyId body : robot.bodies()) {
    BodyState state = flow.state(body);
    const Vector6d twist = robot.motion_of(body).J * rates * (h < 0.0 ? -1.0 : 1.0);
    state.linear_velocity = twist.head<3>();
    state.angular_velocity = twist.tail<3>();
    flow.set_state(body, state);
  }
  EXPECT_FALSE(flow.step().outcome.failed);
  World moved = world;
  const BodyState base = is_on_base(world) ? world.state(world.find_body("base")) : BodyState{};
  for (const BodyId body : robot.bodies()) {
    BodyState state = flow.state(body);
    state.linear_velocity =
        base.linear_velocity + base.angular_velocity.cross(state.position - base.position);
    state.angular_velocity = base.angular_velocity;
    moved.set_state(body, state);
  }
  return moved;
}

/// Gives the bodies of the last robot of a world the coordinate rates `rates`.
inline RobotDynamics moving(World* world, const Eigen::VectorXd& rates) {
  const RobotDynamics resting = last_robot(*world);
  for (const BodyId body : resting.bodies()) {
    BodyState state = world->state(body);
    const RobotDynamics::PointMotion motion = resting.motion_of(body);
    const Vector6d twist = motion.velocity + motion.J * (rates - resting.velocity());
    state.linear_velocity = twist.head<3>();
    state.angular_velocity = twist.tail<3>();
    world->set_state(body, state);
  }
  return last_robot(*world);
}

/// Returns df/dh at 0 of a function of a displacement by central differences of two steps: an error
/// below 1e-11 for angles and lengths near 1, since it falls with h⁴. `speed`: how fast the fastest
/// body moves at dh/dt = 1.
template <class Function>
Eigen::VectorXd slope(const Function& f, double speed = 1.0) {
  const double step = 1e-3 / std::max(1.0, speed);
  const auto central = [&](double h) { return Eigen::VectorXd((f(h) - f(-h)) / (2.0 * h)); };
  return (4.0 * central(step) - central(2.0 * step)) / 3.0;
}

/// Returns the largest speed of a body at the unit rate of a coordinate: screws turn fast.
inline double speed_of(const RobotDynamics& robot, Eigen::Index k) {
  double speed = 0.0;
  for (const BodyId body : robot.bodies())
    speed = std::max(speed, robot.motion_of(body).J.col(k).norm());
  return speed;
}

}  // namespace constraint_sim::engine
