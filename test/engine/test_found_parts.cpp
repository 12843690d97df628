// Steps that events begin and impulses end, since they take more than `event_work`. Oracles: closed
// forms of a ball between two walls, on which no other force acts.

#include "by_events.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kHitSpeed = 10.0, kHalfRoom = 0.05, kBallRadius = 0.1, kTenHits = 0.1;

/// Makes a ball that moves along x between walls, or stops of a slider, that give all its speed
/// back, and hits one every 0.01 s, first after 0.005 s. A step has ten hits.
World between_walls(bool has_slider, double work, double contact_tolerance) {
  WorldOptions options = by_events(kTenHits);
  options.gravity.setZero();
  options.event_work = work;
  options.contact_tolerance = contact_tolerance;
  World world(options);
  Body ball = with_surface(make_body("ball", Sphere{kBallRadius}, 1.0, Vector3d::Zero()), 0.1, 1.0);
  ball.state.linear_velocity = kHitSpeed * Vector3d::UnitX();
  const BodyId id = world.add_body(ball);
  if (has_slider) {
    Joint slider;
    slider.name = "slider";
    slider.kind = JointKind::kSlider;
    slider.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
    slider.body_b = id;
    slider.coordinates[0].lower = -kHalfRoom;
    slider.coordinates[0].upper = kHalfRoom;
    slider.coordinates[0].limit_restitution = 1.0;
    world.add_joint(slider);
    return world;
  }
  for (const double side : {-1.0, 1.0})
    world.add_body(plane(side < 0.0 ? "left" : "right",
                         side * (kHalfRoom + kBallRadius) * Vector3d::UnitX(),
                         -side * Vector3d::UnitX(), 0.0, 1.0));
  return world;
}

// The hits found before the work was used up are those of the closed form, and are reported. The
// handover is at the last of them or after it. Impulses take the rest of the step alone: the ball
// stays as fast as it was, and within the room by what impulses move in this rest.
TEST(FoundParts, AreKept) {
  for (const bool has_slider : {false, true}) {
    for (const double contact_tolerance : {0.0, 1e-4}) {
      World world = between_walls(has_slider, 12.0, contact_tolerance);
      const StepReport& report = world.step();
      ASSERT_TRUE(uses_impulses(world.islands()[0].method)) << has_slider << contact_tolerance;
      std::vector<double> hits;
      double handover = kTenHits;
      for (const Event& event : world.events()) {
        if (event.impulse > 0.0) hits.push_back(event.time);
        if (event.kind == EventKind::kHandedOver) handover = event.time;
      }
      ASSERT_GE(hits.size(), 2u) << has_slider << contact_tolerance;
      ASSERT_LT(hits.size(), 10u);
      EXPECT_GE(report.costs.events, hits.size());
      for (std::size_t k = 0; k < hits.size(); ++k)
        EXPECT_NEAR(hits[k], 0.005 + 0.01 * static_cast<double>(k), 1e-9) << has_slider << k;
      EXPECT_GE(handover, hits.back());
      const BodyState& ball = world.body(world.body_ids().front()).state;
      EXPECT_NEAR(std::abs(ball.linear_velocity.x()), kHitSpeed, 1e-9);
      EXPECT_LT(std::abs(ball.position.x()), kHalfRoom + (kTenHits - hits.back()) * kHitSpeed);
      if (has_slider) continue;
      // Impulses locate the hits of fast bodies, so the rest is exact but for the gap of a hit.
      EXPECT_NEAR(ball.position.x(), 0.0, 1e-6);
      ASSERT_EQ(world.contacts().size(), 2u);
      for (const Contact& contact :
           world.contacts())  // five hits in each step, each turns m v round
        EXPECT_NEAR(contact.force.norm(), 5.0 * 2.0 * kHitSpeed / kTenHits, 1e-6)
            << contact_tolerance;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
