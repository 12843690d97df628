// Motors to a position with a force limit that are too weak for their prescribed motion, with and
// without contacts. Oracles: closed forms of the piecewise constant accelerations. Errors are
// rounding and the location of events.

#include "by_events.h"
#include "engine/constraints/prescribed.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

struct Sent {
  double load;                ///< force along the coordinate [N]
  double max_force;           ///< force limit of the motor [N]
  double goal;                ///< [m]
  bool has_floor;             ///< the box touches a smooth floor
  double start = 0.0;         ///< [m]
  double lower = -kInfinity;  ///< limit [m]
};

/// Sends a box of 1 kg on a guide along x and z to a position, against or with a load.
World sent(const Carried& by, const Sent& of, JointId* guide = nullptr) {
  World world(by_events(by));
  if (of.has_floor) world.add_body(make_floor(0.0));
  const BodyId box = world.add_body(
      with_surface(make_body("box", Box{{0.2, 0.2, 0.1}}, 1.0, {of.start, 0, 0.05}), 0.0, 0.0));
  Joint joint;
  joint.name = "guide";
  joint.kind = of.has_floor ? JointKind::kPlanar : JointKind::kSlider;
  joint.body_b = box;
  joint.anchor_a = {0, 0, 0.05};
  joint.frame_a =
      rotation_between(Vector3d::UnitZ(), of.has_floor ? Vector3d::UnitY() : Vector3d::UnitX());
  joint.anchor_b = Vector3d::Zero();
  joint.frame_b = joint.frame_a;
  joint.coordinates[0].lower = of.lower;
  auto& motor = joint.coordinates[0].motor.emplace();
  motor.position = of.goal;
  motor.max_force = of.max_force;
  const JointId id = world.add_joint(joint);
  if (guide != nullptr) *guide = id;
  Wrench wrench;
  wrench.body = box;
  wrench.force = {of.load, 0.0, 0.0};
  world.add_wrench(wrench);
  return world;
}

class LostMotionsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, LostMotionsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

// A load pulls a box to its goal faster than the motor's prescribed motion. The motor, which has
// lost this motion, pushes to the goal at once, too, until it has to brake, for which it is too
// weak.
TEST_P(LostMotionsAt, ALoadPullsAheadOfTheMotor) {
  const double load = -10.0, most = 5.0, goal = -0.3;
  const double b = 0.5 * most;                                   // m = 1 kg
  const double s = -goal * 2.0 * b / (2.0 * (most - load + b));  // v² = 2 a s = 2 b (|goal| - s)
  const double v = std::sqrt(2.0 * (most - load) * s), t = v / (most - load);
  for (const bool has_floor : {false, true}) {
    JointId guide;
    World world = sent(GetParam(), {load, most, goal, has_floor}, &guide);
    while (world.time() < 0.1 - 1e-9) {
      world.step();
      EXPECT_FALSE(is_by_impulses(world));
      EXPECT_TRUE(world.joint_state(guide).saturated);
    }
    const double since = world.time() - t;
    EXPECT_NEAR(world.joint_state(guide).reached_rate, -v - (-load - most) * since, 1e-8)
        << has_floor;
    EXPECT_NEAR(world.joint_state(guide).coordinates[0].position,
                -s - v * since - 0.5 * (-load - most) * since * since, 1e-9)
        << has_floor;
  }
}

/// A box that starts beyond its limit, and where it is then.
struct Outside {
  double goal, load, max_force;
  std::function<double(double)> position;  ///< by the share that is left of an error
  bool saturates;
};

// A coordinate beyond its limit is not moved onto the limit at once: its motor takes it to its
// position by the prescribed motion; where the motor has no position within the limit, or is too
// weak, the limit closes its error.
TEST_P(LostMotionsAt, ACoordinateBeyondItsLimitIsMovedInTime) {
  const double start = -0.1, lower = 0.0;
  const auto by_limit = [&](double left) { return start * left; };
  for (const Outside& of :
       {Outside{0.3, 0.0, 500.0, [](double left) { return 0.3 - 0.4 * left; }, false},
        Outside{0.3, -2.0, 500.0, [](double left) { return 0.3 - 0.4 * left; }, false},
        Outside{0.3, -10.0, 0.5, by_limit, true}, Outside{-0.3, 0.0, 5.0, by_limit, true},
        Outside{start, 0.0, 5.0, by_limit, true}})
    for (const bool has_floor : {false, true}) {
      JointId guide;
      World world =
          sent(GetParam(), {of.load, of.max_force, of.goal, has_floor, start, lower}, &guide);
      EXPECT_TRUE(world.joint_state(guide).closing);
      const double closing = world.options().closing_time;
      while (world.time() < closing + 0.1) {
        world.step();
        EXPECT_FALSE(is_by_impulses(world));
        const double left = closing_motion(world.time(), closing).value;
        EXPECT_NEAR(world.joint_state(guide).coordinates[0].position, of.position(left), 1e-9)
            << of.goal << ' ' << has_floor << ' ' << world.time();
      }
      EXPECT_EQ(world.joint_state(guide).saturated, of.saturates) << of.goal << ' ' << has_floor;
    }
}

// Two motors with force limits on one screw, for its translation and its rotation. Where both
// positions agree, they share the motion; where not, the stronger one has it, and the other one is
// saturated.
TEST_P(LostMotionsAt, TwoMotorsOnAScrew) {
  const double pitch = 0.3, lead = pitch / (2.0 * kPi), goal = 0.05;
  for (const double other : {goal, 0.4 * goal})
    for (const double torque : {100.0, 0.05})
      for (const bool has_floor : {false, true}) {
        World world(by_events(GetParam()));
        if (has_floor) world.add_body(make_floor(0.0));
        Body nut = with_surface(make_body("nut", Sphere{0.1}, 1.0, {0, 0, 0.1}), 0.0, 0.0);
        nut.inertia = 2e-3 * Vector3d::Ones();
        Joint screw;
        screw.name = "screw";
        screw.kind = JointKind::kScrew;
        screw.anchor_a = nut.state.position;
        screw.body_b = world.add_body(nut);
        screw.pitch = pitch;
        for (int i = 0; i < 2; ++i) {
          auto& motor = screw.coordinates[i].motor.emplace();
          motor.position = i == 0 ? goal : other / lead;
          motor.max_force = i == 0 ? 100.0 : torque;
        }
        const JointId joint = world.add_joint(screw);
        const double reached =
            torque > 1.0 ? other : goal;  // a torque of 100 N m is 2094 N along the axis
        while (world.time() < 0.5) {
          world.step();
          EXPECT_FALSE(is_by_impulses(world));
          const double left = closing_motion(world.time(), world.options().closing_time).value;
          EXPECT_NEAR(world.joint_state(joint).coordinates[0].position, reached * (1.0 - left),
                      1e-9)
              << other << ' ' << torque << ' ' << has_floor << ' ' << world.time();
        }
        EXPECT_EQ(world.joint_state(joint).saturated, other != goal) << torque << ' ' << has_floor;
      }
}

}  // namespace
}  // namespace constraint_sim::engine
