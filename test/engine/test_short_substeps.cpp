// Short substeps between events of joints. Oracle: the same scene with a tolerance of 1e-13 m/s.

#include "make_scene.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Makes three bars that tumble together, in the rows of their joints: a hinge and a point on a
/// line, both with stops 0.02 rad and 0.01 m away that give back nine tenths of the speed.
World tumbling_bars(double spin, double tolerance, double time_step) {
  WorldOptions options;
  options.gravity.setZero();
  options.tolerance = tolerance;
  options.time_step = time_step;
  World world(options);
  const auto add = [&](const char* name, double mass, const Vector3d& half, double x) {
    Body body = make_body(name, Box{half}, mass, x * Vector3d::UnitX());
    body.no_collision = true;
    body.state.angular_velocity = spin * Vector3d(0.2, 1.0, 0.3);
    body.state.linear_velocity = body.state.angular_velocity.cross(body.state.position);
    return world.add_body(body);
  };
  const BodyId a = add("a", 1.0, {0.3, 0.1, 0.05}, 0.0);
  const BodyId b = add("b", 0.5, {0.2, 0.05, 0.1}, 0.5);
  const BodyId c = add("c", 0.3, {0.1, 0.05, 0.1}, 0.8);
  const auto join = [&](JointKind kind, BodyId from, BodyId to, double at, double far) {
    Joint joint = make_joint(std::string("to_") + world.body(to).name, from,
                             0.3 * Vector3d::UnitX(), to, at * Vector3d::UnitX(), kind);
    joint.coordinates[0].lower = -far;
    joint.coordinates[0].upper = far;
    joint.coordinates[0].limit_restitution = 0.9;
    world.add_joint(joint);
  };
  join(JointKind::kHinge, a, b, -0.2, 0.02);
  join(JointKind::kPointOnLine, b, c, 0.0, 0.01);
  return world;
}

/// Makes a bar that tumbles between stops 0.01 mm away, on a line near its centre: between hits
/// neither its velocity nor its angular momentum changes.
World bar_between_stops(double tolerance) {
  WorldOptions options;
  options.gravity.setZero();
  options.tolerance = tolerance;
  options.time_step = 0.01;
  World world(options);
  Body bar = make_body("bar", Box{Vector3d(0.3, 0.1, 0.05)}, 1.0, Vector3d::Zero());
  bar.state.linear_velocity = Vector3d::UnitZ();
  bar.state.angular_velocity = 300.0 * Vector3d(0.2, 1.0, 0.3);
  const BodyId id = world.add_body(bar);
  const Vector3d anchor = 1e-6 * Vector3d::UnitX();  // on the centre no joint would turn the bar
  Joint joint = make_joint("line", kWorldBody, anchor, id, anchor, JointKind::kPointOnLine);
  joint.coordinates[0].lower = -1e-5;
  joint.coordinates[0].upper = 1e-5;
  joint.coordinates[0].limit_restitution = 1.0;
  world.add_joint(joint);
  return world;
}

// By order 3 the orientation errs by h ω times the change of its rate, and nothing else does.
TEST(ShortSubsteps, OfABarBetweenStopsTurnWithinTheTolerance) {
  constexpr double kDuration = 0.05, kTolerance = 1e-8;
  World world = bar_between_stops(kTolerance), exact = bar_between_stops(1e-13);
  unsigned events = 0;
  while (world.time() < kDuration - 0.005) {
    events += world.step().costs.events;
    exact.step();
    ASSERT_EQ(world.islands().front().method, Method::kEventDriven);
  }
  EXPECT_GT(events, 2000u);
  const BodyId id = world.body_ids().front();
  const double gyration = std::sqrt((0.3 * 0.3 + 0.1 * 0.1) / 3.0);  // largest of the box [m]
  const double turned = world.state(id).orientation.angularDistance(exact.state(id).orientation);
  EXPECT_LT(gyration * turned, kTolerance * kDuration);
}

// Between hits some substeps are of order 3 or 1. The 99 hits at 300 rad/s enlarge errors by up to
// 2.
TEST(ShortSubsteps, OfTumblingBarsAreWithinTheTolerance) {
  constexpr double kDuration = 0.2, kTolerance = 1e-8;
  for (const double spin : {100.0, 300.0})
    for (const double time_step : {0.02, 0.002}) {
      SCOPED_TRACE(testing::Message() << spin << " rad/s in steps of " << time_step << " s");
      World world = tumbling_bars(spin, kTolerance, time_step);
      World exact = tumbling_bars(spin, 1e-13, time_step);
      unsigned events = 0;
      while (world.time() < kDuration - 0.5 * time_step) {
        events += world.step().costs.events;
        exact.step();
        ASSERT_EQ(world.islands().front().method, Method::kEventDriven);
      }
      EXPECT_GT(events, 50u);
      for (const BodyId id : world.body_ids())
        EXPECT_LT((world.state(id).position - exact.state(id).position).norm(),
                  2.0 * kTolerance * kDuration)
            << world.body(id).name;
    }
}

}  // namespace
}  // namespace constraint_sim::engine
