// New targets for position motors that move. Oracle: the polynomial of degree 5 through position,
// rate and acceleration at the time of the new target, and rest at the target after closing_time,
// from a linear system unlike the closed form in the engine.

#include <Eigen/Dense>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/math/list.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kMassMoved = 2.0;

/// Position, rate and acceleration.
using PlannedMotion = Vector3d;

/// Motion from a state at time `from` to rest at a target.
struct Quintic {
  double from = 0.0, duration = 0.5;
  Eigen::Matrix<double, 6, 1> coefficients = Eigen::Matrix<double, 6, 1>::Zero();

  Quintic(double t, double T, const PlannedMotion& start, double target) : from(t), duration(T) {
    Eigen::Matrix<double, 6, 6> conditions;
    for (int k = 0; k < 3; ++k) {
      conditions.row(k) = derivatives(0.0).row(k);
      conditions.row(3 + k) = derivatives(T).row(k);
    }
    Eigen::Matrix<double, 6, 1> values;
    values << start, target, 0.0, 0.0;
    coefficients = conditions.fullPivLu().solve(values);
  }
  static Eigen::Matrix<double, 3, 6> derivatives(double s) {
    Eigen::Matrix<double, 3, 6> rows;
    for (int n = 0; n < 6; ++n) {
      rows(0, n) = std::pow(s, n);
      rows(1, n) = n < 1 ? 0.0 : n * std::pow(s, n - 1);
      rows(2, n) = n < 2 ? 0.0 : n * (n - 1) * std::pow(s, n - 2);
    }
    return rows;
  }
  PlannedMotion at(double t) const {
    return derivatives(std::clamp(t - from, 0.0, duration)) * coefficients;
  }
};

/// A body on a slider along z, or a bar on a hinge about y, with a position motor.
struct Moved {
  World world;
  BodyId body;
  JointId joint;

  /// `by_impulses`: a weak spring with both limits and a force limit leaves the island to impulses.
  Moved(const WorldOptions& options, JointKind kind, const CoordinateLaw& law,
        bool by_impulses = false)
      : world(options) {
    const bool turns = kind == JointKind::kHinge;
    Body bar = make_body("bar", Box{{0.6, 0.1, 0.1}}, kMassMoved, {turns ? 0.3 : 0.0, 0.0, 0.0});
    bar.no_collision = true;
    body = world.add_body(bar);
    Joint made = make_joint("joint", kWorldBody, Vector3d::Zero(), body,
                            {turns ? -0.3 : 0.0, 0.0, 0.0}, kind);
    if (turns) made.frame_a = frame_along(Vector3d::UnitY());
    made.coordinates[0] = law;
    made.coordinates[0].position = 0.0;
    joint = world.add_joint(made);
    if (!by_impulses) return;
    Joint spring = make_joint("spring", kWorldBody, {0.0, 3.0, 0.0}, body, Vector3d::Zero());
    spring.distance.length = 3.0;
    spring.distance.stiffness = 1e-9;
    spring.distance.min_length = 0.1;
    spring.distance.max_length = 10.0;
    spring.motor.max_force = 1.0;
    world.add_joint(spring);
  }
  void send(double position) {
    Motor motor = world.joint(joint).coordinates[0].motor.value_or(Motor{});
    motor.bias = 0.0;
    motor.position = position;
    world.set_motor(joint, 0, motor);
  }
  const CoordinateState& now() const { return world.joint_state(joint).coordinates[0]; }
};

CoordinateLaw position_law(double max_force, double friction = 0.0, double limits = 0.0) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->position = 0.0;
  law.motor->max_force = max_force;
  law.friction = friction;
  if (limits > 0.0) {
    law.lower = -limits;
    law.upper = limits;
  }
  return law;
}

struct Followed {
  const char* name;
  Method method;
  CoordinateLaw law;
  double position_error, rate_error;  // rounding and the tolerance, or order 1 of impulses per step
  bool by_impulses = false;
};

std::vector<Followed> followed(double h) {
  // Impulses have the mean rate of the step, and energy_momentum's rates are of order 2: with a
  // largest acceleration of 60 m/s² and a largest third derivative of 2000 m/s³.
  const double first = 0.5 * 60.0 * h, second = 2000.0 * h * h / 12.0;
  return {{"runge_kutta", Method::kRungeKutta, position_law(0.0), 1e-9, 1e-8},
          {"energy_momentum", Method::kEnergyMomentum, position_law(0.0), 1e-9, second},
          {"event_driven", Method::kAuto, position_law(1e4), 1e-9, 1e-8},
          {"friction", Method::kAuto, position_law(0.0, 1.0), 1e-9, 1e-8},
          {"limits", Method::kAuto, position_law(0.0, 0.0, 2.0), 1e-9, 1e-8},
          {"limits and friction", Method::kAuto, position_law(1e4, 1.0, 2.0), 1e-9, 1e-8},
          {"impulses", Method::kAuto, position_law(0.0), 1e-5, first, true}};
}

// Three targets, each while the coordinate moves to the one before: further, back, and beyond.
TEST(NewTargets, AreReachedFromTheMotionThatIs) {
  for (const JointKind kind : {JointKind::kSlider, JointKind::kHinge})
    for (const double h : {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0})
      for (const Followed& by : followed(h)) {
        SCOPED_TRACE(testing::Message() << by.name << ' ' << name(kind) << " at 1/" << 1.0 / h);
        WorldOptions options;
        options.time_step = h;
        options.method = by.method;
        options.iterations = 100;
        Moved moved(options, kind, by.law, by.by_impulses);
        const double T = options.closing_time;
        Quintic prescribed(0.0, T, PlannedMotion::Zero(), 0.0);
        const std::vector<std::pair<double, double>> sent{
            {0.1, 0.6}, {0.1 + 0.4 * T, 1.1}, {0.1 + 0.9 * T, -0.4}, {0.1 + 1.2 * T, 0.9}};
        std::size_t next = 0;
        for (int i = 0; i < static_cast<int>(std::lround(1.5 / h)); ++i) {
          const double t = moved.world.time();
          if (next < sent.size() && t >= sent[next].first) {
            prescribed = Quintic(t, T, prescribed.at(t), sent[next].second);
            moved.send(sent[next++].second);
          }
          ASSERT_FALSE(moved.world.step().outcome.failed);
          const PlannedMotion now = prescribed.at(moved.world.time());
          ASSERT_NEAR(moved.now().position, now[0], by.position_error) << moved.world.time();
          ASSERT_NEAR(moved.now().velocity, now[1], by.rate_error) << moved.world.time();
          ASSERT_EQ(moved.world.report().joints.unclosed, 0u);
        }
        ASSERT_EQ(next, sent.size());
        EXPECT_NEAR(moved.now().position, sent.back().second, by.position_error);
        const Method method = moved.world.islands().front().method;
        EXPECT_EQ(uses_impulses(method), by.by_impulses) << name(method);
      }
}

// A velocity motor or a free coordinate goes to a position from the rate that it has.
TEST(NewTargets, StartFromTheRateOfACoordinateWithoutTarget) {
  for (const bool is_driven : {true, false})
    for (const double h : {1.0 / 60.0, 1.0 / 1000.0}) {
      SCOPED_TRACE(testing::Message() << is_driven << " at 1/" << 1.0 / h);
      WorldOptions options;
      options.time_step = h;
      options.gravity.setZero();
      Moved moved(options, JointKind::kSlider, CoordinateLaw{});
      if (is_driven) {
        Motor motor;
        motor.bias = 0.8;
        moved.world.set_motor(moved.joint, 0, motor);
      } else {
        BodyState pushed = moved.world.state(moved.body);
        pushed.linear_velocity.z() = 0.8;
        moved.world.set_state(moved.body, pushed);
      }
      run(moved.world, static_cast<int>(std::lround(0.2 / h)));
      ASSERT_NEAR(moved.now().velocity, 0.8, 1e-9);
      const Quintic prescribed(moved.world.time(), options.closing_time,
                               {moved.now().position, 0.8, 0.0}, 0.9);
      moved.send(0.9);
      while (moved.world.time() < 1.0) {
        ASSERT_FALSE(moved.world.step().outcome.failed);
        ASSERT_NEAR(moved.now().position, prescribed.at(moved.world.time())[0], 1e-9);
        ASSERT_NEAR(moved.now().velocity, prescribed.at(moved.world.time())[1], 1e-8);
      }
    }
}

// Targets that come nearer to a limit and end on it, at each tick: the coordinate never passes the
// limit, its acceleration has no jump, and it arrives within closing_time of the last target.
TEST(NewTargets, OfADraggedSliderEndOnItsLimit) {
  constexpr double kStop = 0.8, kDrag = 0.7;
  for (const double force : {0.0, 1000.0})
    for (const double h : {1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0}) {
      SCOPED_TRACE(testing::Message() << force << " N at 1/" << 1.0 / h);
      WorldOptions options;
      options.time_step = h;
      Moved moved(options, JointKind::kSlider, position_law(force, 0.0, kStop));
      const double T = options.closing_time;
      const Quintic hand(0.1, kDrag, PlannedMotion::Zero(), kStop);
      double before = 0.0, largest = 0.0, jump = 0.0, last = 0.0;
      while (moved.world.time() < 0.1 + kDrag + T + 2.0 * h) {
        moved.send(std::min(hand.at(moved.world.time())[0], kStop));
        ASSERT_FALSE(moved.world.step().outcome.failed);
        ASSERT_LE(moved.now().position, kStop + 1e-9) << moved.world.time();
        ASSERT_LE(moved.world.report().joints.max_error, 1e-9);
        const double rate = moved.now().velocity, acceleration = (rate - before) / h;
        largest = std::max(largest, std::abs(acceleration));
        jump = std::max(jump, std::abs(acceleration - last));
        before = rate;
        last = acceleration;
      }
      EXPECT_NEAR(moved.now().position, kStop, 1e-8);
      EXPECT_NEAR(moved.now().velocity, 0.0, 1e-8);
      // A motion from rest over the way has 5.8 d/T² at most, and a third derivative of 60 d/T³.
      EXPECT_LE(largest, 5.8 * kStop / (T * T));
      EXPECT_LE(jump, 60.0 * kStop / (T * T * T) * h);
    }
}

// Targets that jump back and forth at each tick keep the coordinate between them, with bounded
// rates, and the last target is reached in closing_time.
TEST(NewTargets, ThatChangeAtEachTickEndAtTheLast) {
  Random random;
  for (const double h : {1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0}) {
    SCOPED_TRACE(1.0 / h);
    WorldOptions options;
    options.time_step = h;
    Moved moved(options, JointKind::kHinge, position_law(0.0));
    const double T = options.closing_time;
    while (moved.world.time() < 3.0) {
      moved.send(0.5 + 0.5 * random());
      ASSERT_FALSE(moved.world.step().outcome.failed);
      ASSERT_LE(std::abs(moved.now().position - 0.5), 0.75) << moved.world.time();
      ASSERT_LE(std::abs(moved.now().velocity), 2.0 * 1.875 / T);
    }
    moved.send(0.25);
    while (moved.world.time() < 3.0 + T + 2.0 * h) moved.world.step();
    EXPECT_NEAR(moved.now().position, 0.25, 1e-9);
    EXPECT_NEAR(moved.now().velocity, 0.0, 1e-9);
  }
}

// A new target of a coordinate leaves the motion of the joint's other coordinate as it is.
TEST(NewTargets, LeaveOtherCoordinatesOnTheirWay) {
  WorldOptions options;
  options.time_step = 0.01;
  World world(options);
  Body bar = make_body("bar", Box{{0.6, 0.1, 0.1}}, kMassMoved, Vector3d::Zero());
  bar.no_collision = true;
  Joint made = make_joint("joint", kWorldBody, Vector3d::Zero(), world.add_body(bar),
                          Vector3d::Zero(), JointKind::kCylindrical);
  for (std::size_t i = 0; i < 2; ++i) {
    made.coordinates[i].motor.emplace();
    made.coordinates[i].motor->position = 0.0;
  }
  const JointId joint = world.add_joint(made);
  const auto send = [&](int coordinate, double position) {
    Motor motor = *world.joint(joint).coordinates[to_index(coordinate)].motor;
    motor.position = position;
    world.set_motor(joint, coordinate, motor);
  };
  const auto at = [&](std::size_t i) { return world.joint_state(joint).coordinates[i].position; };
  const double T = options.closing_time;
  const Quintic second(0.1, T, PlannedMotion::Zero(), 0.7);
  const Quintic first(0.1, T, PlannedMotion::Zero(), 0.5);
  Quintic anew = first;
  for (int i = 0; i < 100; ++i) {
    if (i == 10) {
      send(0, 0.5);
      send(1, 0.7);
    }
    if (i == 30) {
      anew = Quintic(0.3, T, first.at(0.3), 0.8);
      send(0, 0.8);
    }
    ASSERT_FALSE(world.step().outcome.failed);
    if (i < 10) continue;
    ASSERT_NEAR(at(0), anew.at(world.time())[0], 1e-9) << i;
    ASSERT_NEAR(at(1), second.at(world.time())[0], 1e-9) << i;
  }
}

// Edits of a joint that keep its motor keep its motion.
TEST(NewTargets, AreNotMadeByEditsThatKeepTheMotor) {
  for (const double force : {0.0, 1000.0}) {
    WorldOptions options;
    options.time_step = 0.01;
    Moved moved(options, JointKind::kSlider, position_law(force));
    moved.send(0.6);
    const Quintic prescribed(0.0, options.closing_time, PlannedMotion::Zero(), 0.6);
    for (int i = 0; i < 80; ++i) {
      if (i == 20) {
        CoordinateLaw law = moved.world.joint(moved.joint).coordinates[0];
        law.friction = 0.5;
        moved.world.set_law(moved.joint, 0, law);
      }
      if (i == 30) {
        Joint changed = moved.world.joint(moved.joint);
        changed.coordinates[0].damping = 0.5;
        changed.break_force = 1e6;
        moved.world.set_joint(moved.joint, changed);
      }
      ASSERT_FALSE(moved.world.step().outcome.failed);
      ASSERT_NEAR(moved.now().position, prescribed.at(moved.world.time())[0], 1e-9)
          << force << ' ' << i;
    }
  }
}

// Copies, snapshots and saved scenes continue within a motion to a new target. A loaded scene has
// the bits where impulses advance it, and else the tolerance, as of any scene.
TEST(NewTargets, ContinueInCopiesSnapshotsAndSavedScenes) {
  for (const bool by_impulses : {false, true})
    for (const double force : {0.0, 1000.0}) {
      SCOPED_TRACE(testing::Message() << by_impulses << ' ' << force);
      WorldOptions options;
      options.time_step = 0.01;
      Moved moved(options, JointKind::kHinge, position_law(force), by_impulses);
      moved.send(0.6);
      run(moved.world, 20);
      moved.send(1.1);
      run(moved.world, 10);
      const std::string saved = save_scene(moved.world);
      EXPECT_NE(saved.find("moving: [["), std::string::npos);
      World copy = moved.world, loaded = load_scene(saved, "saved");
      World snapshot = read_snapshot(write_snapshot(moved.world));
      EXPECT_EQ(save_scene(loaded), saved);
      const auto numbers = [](const World& world) {
        const CoordinateState& now = world.joint_state(world.find_joint("joint")).coordinates[0];
        return std::pair(now.position, now.velocity);
      };
      for (int i = 0; i < 60; ++i) {
        EXPECT_EQ(copy.state_hash(), moved.world.state_hash());
        EXPECT_EQ(snapshot.state_hash(), moved.world.state_hash());
        for (World* world : {&moved.world, &copy, &loaded, &snapshot}) world->step();
        const double most = by_impulses ? 0.0 : 1e-9;
        EXPECT_EQ(numbers(copy), numbers(moved.world)) << i;
        EXPECT_EQ(numbers(snapshot), numbers(moved.world)) << i;
        EXPECT_NEAR(numbers(loaded).first, numbers(moved.world).first, most) << i;
      }
      EXPECT_NEAR(moved.now().position, 1.1, by_impulses ? 1e-3 : 1e-9);
      const std::size_t start = saved.find("moving: [[");
      const std::string text = saved.substr(0, start) + "moving: [[0, 0.5, .nan, 0, 0]]" +
                               saved.substr(saved.find("]]", start) + 2);
      EXPECT_THROW(load_scene(text, "saved"), std::exception);
    }
}

}  // namespace
}  // namespace constraint_sim::engine
