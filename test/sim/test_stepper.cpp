#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "sim/stepper.h"

namespace constraint_sim {
namespace {

constexpr double kTick = 0.01;

World ball_in_flight() {
  World world;
  engine::Body body;
  body.name = "ball";
  body.mass = 1.0;
  body.state.linear_velocity = {1.0, 0.0, 0.0};
  world.add_body(body);
  return world;
}

/// A stepper on a clock that the test sets, stepped by the test's own thread.
class StepperTest : public ::testing::Test {
 protected:
  void make(const StepperOptions& options) {
    stepper_ = std::make_unique<Stepper>(
        ball_in_flight(), options, [this] { return now_; },
        StepperEvents{[this](const World&, double) { ++stepped_; },
                      [this](const World&) { ++edited_; },
                      [this](const World&) {
                        ++passed_;
                        return 1.0;
                      }});
  }
  /// Advances the clock and lets the stepper do all due work.
  void pass(double seconds) {
    now_ += seconds;
    while (stepper_->advance() == 0.0) {
    }
  }
  /// Runs `work`, which waits for the stepper, on its own thread, and steps until it ends.
  template <class Work>
  void with_stepper(Work work) {
    std::atomic<bool> done{false};
    std::thread thread([&] {
      work();
      done = true;
    });
    while (!done) stepper_->advance();
    thread.join();
  }

  double now_ = 1000.0;
  int stepped_ = 0;
  int edited_ = 0;
  int passed_ = 0;
  std::unique_ptr<Stepper> stepper_;
};

TEST_F(StepperTest, TakesTheStepsThatTheClockAsksFor) {
  make({});
  pass(0.0);
  EXPECT_EQ(stepped_, 0);
  pass(0.0551);
  EXPECT_EQ(stepped_, 5);
  pass(0.0051);  // 0.0602 s in total: the rest of the last pass was kept
  EXPECT_EQ(stepped_, 6);
}

TEST_F(StepperTest, RealTimeFactorScalesTheClock) {
  make({0.1, false, 0.1});
  for (int i = 0; i < 100; ++i) pass(0.0101);
  EXPECT_EQ(stepped_, 10);  // 1.01 s · 0.1 = 10.1 ticks
}

TEST_F(StepperTest, SaysWhenTheNextPassHasWork) {
  make({0.5, false, 0.1});
  now_ += 0.004;
  EXPECT_NEAR(stepper_->advance(), 0.016, 1e-9);  // a tick takes 0.02 s; rounding of now_ ~ 1000
}

TEST_F(StepperTest, AsFastAsItCanStepsInBatchesWithoutTheClock) {
  make({0.0, false, 0.1});
  EXPECT_EQ(stepper_->advance(), 0.0);
  EXPECT_GT(stepped_, 10);
}

TEST_F(StepperTest, DropsAndCountsWhatItCannotCatchUp) {
  make({});
  pass(3.0);
  EXPECT_EQ(stepped_, 10);  // max_catch_up 0.1 s
  EXPECT_EQ(stepper_->dropped_ticks(), 290u);
}

TEST_F(StepperTest, AClockSetBackPassesNoTime) {
  make({});
  pass(0.0101);
  pass(-500.0);
  EXPECT_EQ(stepped_, 1);
  pass(0.0101);
  EXPECT_EQ(stepped_, 2);
  EXPECT_EQ(stepper_->dropped_ticks(), 0u);
}

/// Follows a clock that the test sets, and catches up with a second of it.
class FollowingStepper : public StepperTest {
 protected:
  void follow(double real_time_factor) {
    StepperOptions options;
    options.real_time_factor = real_time_factor;
    options.max_catch_up = 1.0;
    options.follows_clock = true;
    StepperEvents events{[this](const World&, double) { ++stepped_; },
                         [this](const World&) { ++edited_; }, nullptr};
    events.time_moved = [](World& world, double time) { world.set_time(time, world.step_count()); };
    stepper_ = std::make_unique<Stepper>(
        ball_in_flight(), options, [this] { return now_; }, std::move(events));
  }
  double time() {
    double time = 0.0;
    with_stepper([&] { time = stepper_->inspect([](const World&) {}).time; });
    return time;
  }
  /// Steps until simulated time reaches the clock, except for a tick that is not due. The stepper
  /// moves time only once in kMovesTimeAgain of run time.
  void expect_clock(double clock) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    constexpr double kRounding = 1e-6;  // rounding at 5000 s is 1e-12 s
    const auto is_there = [&] {
      return time() > clock - kTick - kRounding && time() < clock + kRounding;
    };
    while (!is_there() && std::chrono::steady_clock::now() < end) pass(0.0);
    EXPECT_TRUE(is_there()) << time() << " is not " << clock;
  }
};

TEST_F(FollowingStepper, TimeBeginsWithTheClock) {
  now_ = 0.0;
  follow(1.0);
  pass(0.0);
  EXPECT_EQ(time(), 0.0);
  pass(1000.0);
  EXPECT_EQ(time(), 1000.0);
  pass(0.0551);
  EXPECT_EQ(stepped_, 5);
  expect_clock(1000.0551);
  EXPECT_EQ(edited_, 1);
}

TEST_F(FollowingStepper, TimeGoesForwardAndBackWithAClockThatJumps) {
  follow(1.0);
  pass(0.0551);
  pass(4000.0);
  expect_clock(now_);
  EXPECT_LE(stepped_, 105);  // five, and a second of catching up
  const int stepped = stepped_;
  now_ = 100.0;
  pass(0.0);
  EXPECT_EQ(time(), 100.0);
  EXPECT_EQ(stepped_, stepped);  // ticks owed at the earlier time are dropped
  pass(1.5);                     // longer than the catch-up limit, and less than twice that
  expect_clock(101.5);
}

TEST_F(FollowingStepper, TimeGoesOnWithTheClockAfterAPause) {
  follow(1.0);
  pass(0.0);
  with_stepper([&] { stepper_->pause(); });
  pass(20.0);
  EXPECT_EQ(time(), 1000.0);
  with_stepper([&] { stepper_->unpause(); });
  expect_clock(1020.0);
  EXPECT_LE(stepped_, 1);
}

TEST_F(FollowingStepper, AWorldThatIsAheadWaitsForTheClock) {
  follow(1.0);
  pass(0.0);
  with_stepper([&] { stepper_->pause(); });
  with_stepper([&] { stepper_->step(20, nullptr); });
  with_stepper([&] { stepper_->unpause(); });
  EXPECT_NEAR(time(), 1000.2, 1e-9);
  pass(0.15);
  EXPECT_NEAR(time(), 1000.2, 1e-9);
  pass(0.1051);
  expect_clock(1000.2551);
  EXPECT_EQ(edited_, 1);
}

TEST_F(FollowingStepper, TimeThatPassesSlowlyJumpsBySoMuchLess) {
  follow(0.5);
  pass(0.0);
  pass(100.0);
  expect_clock(1050.0);
}

TEST_F(FollowingStepper, WhatEndsAfterATimeEndsAfterItInSpiteOfAJump) {
  follow(1.0);
  pass(0.0);
  with_stepper([&] {
    stepper_->edit([](World& world) {
      engine::Wrench wrench;
      wrench.body = world.find_body("ball");
      wrench.force = {0.0, 2.0, 0.0};
      wrench.start = world.time();
      wrench.end = world.time() + 10.0;
      world.add_wrench(wrench);
    });
  });
  for (const double seconds : {5.0, 0.5}) pass(seconds);
  expect_clock(1005.5);
  double end = 0.0;
  with_stepper([&] {
    stepper_->inspect([&](const World& world) { end = world.wrenches().at(0).end - world.time(); });
  });
  EXPECT_NEAR(end, 10.0 - 0.01 * stepped_, 1e-9);  // 1e-13 of rounding at times of 1000 s
}

TEST_F(StepperTest, PausedItStandsAndTimePausedIsNotMadeUpFor) {
  make({1.0, true, 0.1});
  pass(1.0);
  EXPECT_EQ(stepped_, 0);
  with_stepper([&] { stepper_->unpause(); });
  pass(0.0101);
  EXPECT_EQ(stepped_, 1);
  with_stepper([&] { stepper_->pause(); });
  pass(1.0);
  EXPECT_EQ(stepped_, 1);
  EXPECT_EQ(stepper_->dropped_ticks(), 0u);
}

TEST_F(StepperTest, EditsTakeEffectWhilePausedAndTellWhen) {
  make({1.0, true, 0.1});
  Boundary boundary;
  with_stepper([&] {
    stepper_->step(7, nullptr);
    boundary = stepper_->edit([](World& world) { world.remove_body(world.find_body("ball")); });
  });
  EXPECT_EQ(boundary.step, 7u);
  EXPECT_NEAR(boundary.time, 7 * kTick, 1e-15);
  EXPECT_EQ(edited_, 1);
}

TEST_F(StepperTest, WhatAnEditThrowsReachesItsCallerAndNobodyElse) {
  make({1.0, true, 0.1});
  std::string text;
  with_stepper([&] {
    try {
      stepper_->edit([](World& world) { world.find_body("nobody"); });
    } catch (const std::invalid_argument& error) {
      text = error.what();
    }
    stepper_->edit([](World&) {});
  });
  EXPECT_NE(text.find("nobody"), std::string::npos) << text;
  EXPECT_EQ(edited_, 1);
}

TEST_F(StepperTest, APostedEditTakesEffectWithoutAnybodyWaiting) {
  make({1.0, true, 0.1});
  stepper_->post([](World& world) { world.remove_body(world.find_body("ball")); });
  stepper_->advance();
  EXPECT_EQ(edited_, 1);
  with_stepper([&] {
    stepper_->inspect([](const World& world) { EXPECT_TRUE(world.body_ids().empty()); });
  });
}

TEST_F(StepperTest, AClockThatHasNotBegunPassesNoTime) {
  now_ = 0.0;
  make({});
  pass(0.0);
  pass(1e9);  // the clock's first reading
  EXPECT_EQ(stepped_, 0);
  EXPECT_EQ(stepper_->dropped_ticks(), 0u);
  pass(0.0101);
  EXPECT_EQ(stepped_, 1);
}

TEST_F(StepperTest, StepsOnRequestAndShowsTheWorldRightAfter) {
  make({1.0, true, 0.1});
  double x = 0.0;
  std::uint64_t hash = 0;
  with_stepper([&] {
    stepper_->step(12345, [&](const World& world) {
      x = world.state(world.find_body("ball")).position.x();
      hash = world.state_hash();
    });
  });
  EXPECT_EQ(stepped_, 12345);
  World alone = ball_in_flight();
  for (int i = 0; i < 12345; ++i) alone.step();
  EXPECT_EQ(hash, alone.state_hash());
  EXPECT_EQ(x, alone.state(alone.find_body("ball")).position.x());
}

TEST_F(StepperTest, StepsOnRequestOnlyWhilePaused) {
  make({});
  with_stepper([&] { EXPECT_THROW(stepper_->step(1, nullptr), NotNow); });
  EXPECT_EQ(stepped_, 0);
}

TEST_F(StepperTest, EditsTakeEffectInBetweenManyRequestedSteps) {
  make({1.0, true, 0.1});
  std::uint64_t at = 0;
  std::atomic<bool> started{false};
  std::thread asker([&] {
    started = true;
    stepper_->step(2000000, nullptr);
  });
  while (!started || stepped_ == 0) stepper_->advance();
  with_stepper([&] { at = stepper_->edit([](World&) {}).step; });
  EXPECT_GT(at, 0u);
  EXPECT_LT(at, 2000000u);
  while (stepper_->advance() == 0.0) {
  }
  asker.join();
  EXPECT_EQ(stepped_, 2000000);
}

TEST_F(StepperTest, AFailedWorldStandsUntilItIsEdited) {
  make({});
  with_stepper([&] {
    stepper_->edit([](World& world) {
      engine::BodyState state;
      state.position.x() = state.linear_velocity.x() = engine::kMostMagnitude;
      world.set_state(world.find_body("ball"), state);
    });
  });
  pass(0.0501);
  EXPECT_TRUE(stepper_->has_failed());
  EXPECT_EQ(stepped_, 1);
  pass(0.0501);
  EXPECT_EQ(stepped_, 1);
  with_stepper(
      [&] { stepper_->edit([](World& world) { world.set_state(world.find_body("ball"), {}); }); });
  EXPECT_FALSE(stepper_->has_failed());
  pass(0.0101);
  EXPECT_GT(stepped_, 1);
}

TEST_F(StepperTest, WhatAnEventThrowsMakesItFailAndStand) {
  bool throws = true;
  stepper_ = std::make_unique<Stepper>(
      ball_in_flight(), StepperOptions{}, [this] { return now_; },
      StepperEvents{[&](const World&, double) {
                      ++stepped_;
                      if (throws) throw std::runtime_error("no room");
                    },
                    nullptr, nullptr});
  now_ += 0.0501;
  stepper_->advance();
  EXPECT_TRUE(stepper_->has_failed());
  EXPECT_EQ(stepper_->failure(), "no room");
  now_ += 0.0501;
  stepper_->advance();
  EXPECT_EQ(stepped_, 1);
  throws = false;
  with_stepper([&] { stepper_->edit([](World&) {}); });
  EXPECT_FALSE(stepper_->has_failed());
  EXPECT_EQ(stepper_->failure(), "");
}

TEST_F(StepperTest, AFailureSaysWhy) {
  make({1.0, true, 0.1});
  std::string text;
  with_stepper([&] {
    stepper_->edit([](World& world) {
      engine::BodyState state;
      state.position.x() = state.linear_velocity.x() = engine::kMostMagnitude;
      world.set_state(world.find_body("ball"), state);
    });
    try {
      stepper_->step(5, nullptr);
    } catch (const NotNow& error) {
      text = error.what();
    }
  });
  EXPECT_NE(text.find("step: 0 of 5 steps done"), std::string::npos) << text;
  EXPECT_NE(text.find(stepper_->failure()), std::string::npos) << text;
  EXPECT_EQ(stepper_->failure(), "a body is beyond 1e20 m, m/s or rad/s: 'ball'");
}

TEST_F(StepperTest, MoreStepsThanCouldEverBeTakenAreDroppedAndTimeGoesOn) {
  make({1e300, false, 0.1});
  pass(0.0);
  now_ += 1e10;
  stepper_->advance();
  EXPECT_GT(stepper_->dropped_ticks(), 0u);
  EXPECT_GT(stepped_, 0);
}

TEST_F(StepperTest, PauseAndInterruptCancelWaitingStepsAndShowHowFarTheyCame) {
  for (const bool by_pause : {true, false}) {
    make({1.0, true, 0.1});
    stepped_ = 0;
    std::uint64_t steps_seen = 0, hash_seen = 0;
    std::string text;
    std::thread asker([&] {
      try {
        stepper_->step(4294967295, [&](const World& world) {
          steps_seen = world.step_count();
          hash_seen = world.state_hash();
        });
      } catch (const NotNow& error) {
        text = error.what();
      }
    });
    while (stepped_ == 0) stepper_->advance();
    std::uint64_t hash = 0;
    with_stepper([&] {
      if (by_pause)
        stepper_->pause();
      else
        stepper_->interrupt("reset_world", [&](World& world) {
          hash = world.state_hash();
          world.reset();
        });
      if (by_pause) stepper_->inspect([&](const World& world) { hash = world.state_hash(); });
    });
    asker.join();
    EXPECT_GT(steps_seen, 0u);
    EXPECT_EQ(hash_seen, hash);  // hash after the last step
    EXPECT_NE(text.find(by_pause ? "pause_physics" : "reset_world"), std::string::npos) << text;
    EXPECT_NE(text.find(std::to_string(steps_seen) + " of 4294967295"), std::string::npos) << text;
  }
}

TEST_F(StepperTest, MoreCallsOfStepThanCanWaitAreRefused) {
  make({1.0, true, 0.1});
  std::atomic<int> cancelled{0};
  std::vector<std::thread> askers;
  for (std::size_t i = 0; i < Stepper::kMostWaiting + 1; ++i)
    askers.emplace_back([&] {
      try {
        stepper_->step(1000000000, nullptr);
      } catch (const NotNow&) {
        ++cancelled;
      }
    });
  while (cancelled == 0) stepper_->advance();
  EXPECT_EQ(cancelled, 1);
  with_stepper([&] { stepper_->pause(); });
  for (std::thread& asker : askers) asker.join();
  EXPECT_EQ(cancelled, static_cast<int>(Stepper::kMostWaiting) + 1);
}

/// The stepper on its own thread and the steady clock, as in the node.
class RunningStepper : public ::testing::Test {
 protected:
  explicit RunningStepper(const StepperOptions& options = {})
      : stepper_(
            ball_in_flight(), options,
            [] {
              return std::chrono::duration<double>(
                         std::chrono::steady_clock::now().time_since_epoch())
                  .count();
            },
            events()),
        thread_(&Stepper::run, &stepper_) {}
  ~RunningStepper() override {
    stepper_.stop();
    if (thread_.joinable()) thread_.join();
  }

  StepperEvents events() {
    StepperEvents events;
    events.stepped = [this](const World& world, double) {
      if (!world.joint_ids().empty()) ++ticks_with_joints_;
    };
    return events;
  }

  std::atomic<int> ticks_with_joints_{0};
  Stepper stepper_;
  std::thread thread_;
};

TEST_F(RunningStepper, ManyThreadsEditAtOnce) {
  constexpr int kThreads = 4;
  constexpr int kEdits = 100;
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t)
    threads.emplace_back([this, t] {
      for (int i = 0; i < kEdits; ++i) {
        engine::Body body;
        body.name = "b" + std::to_string(t) + "_" + std::to_string(i);
        body.mass = 1.0;
        stepper_.edit([&](World& world) { world.add_body(body); });
        if (i % 2 == 0)
          stepper_.edit([&](World& world) { world.remove_body(world.find_body(body.name)); });
      }
    });
  for (std::thread& thread : threads) thread.join();
  std::size_t bodies = 0;
  stepper_.inspect([&](const World& world) { bodies = world.body_ids().size(); });
  EXPECT_EQ(bodies, 1u + kThreads * kEdits / 2);
}

/// A stepper in a tick of many seconds: the largest number of sweeps over many rods.
class EndlessTick : public RunningStepper {
 protected:
  EndlessTick() {
    stepper_.pause();
    stepper_.edit([](World& world) { world = endless(); });
    stepper_.inspect([&](const World& world) { hash_ = world.state_hash(); });
    stepper_.unpause();
    // the first call that has to wait for the tick is rejected
    EXPECT_THROW(for (;;) stepper_.edit([](World&) {}), LongTick);
  }

  static World endless() {
    engine::WorldOptions options;
    options.method = engine::Method::kSequentialImpulses;
    options.iterations = 10000;
    World world(options);
    engine::Body ball;
    ball.name = "ball";
    ball.mass = 1.0;
    ball.state.position = {1.0, 0.0, 0.0};
    engine::Joint rod;
    rod.name = "rod";
    rod.body_b = world.add_body(ball);
    for (int i = 0; i < 10000; ++i) {
      rod.name = "rod_" + std::to_string(i);
      world.add_joint(rod);
    }
    return world;
  }

  template <class Work>
  static double seconds(Work work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  std::uint64_t hash_ = 0;
};

/// Time for calls that take kPatience each, and much more on a busy machine [s].
constexpr double kQuick = 10.0;

TEST_F(EndlessTick, QueriesSeeTheWorldBeforeIt) {
  for (int i = 0; i < 10; ++i) {
    EXPECT_LT(seconds([&] {
                stepper_.inspect([&](const World& world) { EXPECT_EQ(world.state_hash(), hash_); });
              }),
              kQuick);
  }
}

TEST_F(EndlessTick, EditsAreRefusedAndChangeNothing) {
  EXPECT_LT(seconds([&] {
              for (int i = 0; i < 100; ++i) {
                EXPECT_THROW(stepper_.edit([](World& world) { world.reset(); }), LongTick);
                EXPECT_THROW(stepper_.post([](World& world) { world.reset(); }), LongTick);
              }
            }),
            kQuick);
  stepper_.pause();
  stepper_.inspect([&](const World& world) { EXPECT_EQ(world.state_hash(), hash_); });
}

TEST_F(EndlessTick, PauseAbandonsItAndTheWorldIsWhatItWas) {
  EXPECT_LT(seconds([&] { stepper_.pause(); }), kQuick);
  stepper_.inspect([&](const World& world) { EXPECT_EQ(world.state_hash(), hash_); });
  EXPECT_TRUE(stepper_.is_paused());
  EXPECT_FALSE(stepper_.has_failed());
  stepper_.edit([](World& world) {
    engine::WorldOptions options = world.options();
    options.iterations = 10;
    world.set_options(options);
  });
  stepper_.step(3, nullptr);
  stepper_.inspect([&](const World& world) { EXPECT_EQ(world.step_count(), 3u); });
}

TEST_F(EndlessTick, AnotherSceneAbandonsIt) {
  EXPECT_LT(seconds([&] {
              stepper_.interrupt("load_scene", [](World& world) { world = ball_in_flight(); });
            }),
            kQuick);
  EXPECT_EQ(ticks_with_joints_, 0);  // none was completed
  std::uint64_t steps = 0;
  while (steps == 0) stepper_.inspect([&](const World& world) { steps = world.step_count(); });
}

TEST_F(EndlessTick, StopAbandonsIt) {
  EXPECT_LT(seconds([&] {
              stepper_.stop();
              thread_.join();
            }),
            kQuick);
  EXPECT_EQ(ticks_with_joints_, 0);
}

// An edit that never ends: other calls are served, and a pause cancels the edit.
TEST_F(RunningStepper, ALongEditKeepsNobodyWaitingAndIsCancelled) {
  std::atomic<bool> has_begun{false}, was_cancelled{false};
  std::thread thread([&] {
    try {
      stepper_.edit(
          [&](World& world) {
            World changed = world;
            changed.remove({}, changed.body_ids());
            has_begun = true;
            while (!world.is_asked_to_stop()) std::this_thread::yield();
            throw NotNow("cancelled");
          },
          Stepper::Duration::kMayBeLong);
    } catch (const NotNow&) {
      was_cancelled = true;
    }
  });
  while (!has_begun) std::this_thread::yield();
  stepper_.inspect([](const World& world) { EXPECT_TRUE(world.has_body("ball")); });
  EXPECT_THROW(stepper_.edit([](World& world) { world.reset(); }), LongTick);
  EXPECT_FALSE(was_cancelled);
  stepper_.pause();
  thread.join();
  EXPECT_TRUE(was_cancelled);
  stepper_.edit([](World& world) { world.remove({}, world.body_ids()); });
}

// Foreign code called after a tick, as in plugins, cannot be stopped; queries are served.
TEST(StepperOfSleepingCode, AnswersQueriesMeanwhile) {
  std::atomic<bool> sleeps{false}, may_wake{false};
  StepperEvents events;
  events.stepped = [&](const World&, double) {
    sleeps = true;
    while (!may_wake) std::this_thread::yield();
  };
  StepperOptions options;
  options.real_time_factor = 0.0;
  options.keeps_world_before_ticks = true;
  Stepper stepper(
      ball_in_flight(), options, [] { return 0.0; }, events);
  std::thread thread(&Stepper::run, &stepper);
  while (!sleeps) std::this_thread::yield();
  stepper.inspect([](const World& world) { EXPECT_EQ(world.step_count(), 0u); });
  may_wake = true;
  stepper.stop();
  thread.join();
}

TEST_F(RunningStepper, StopCancelsAllWhoWait) {
  stepper_.pause();
  std::atomic<int> cancelled{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t)
    threads.emplace_back([&] {
      try {
        stepper_.step(1000000000, nullptr);
      } catch (const Cancelled&) {
        ++cancelled;
      }
    });
  std::uint64_t steps = 0;
  while (steps == 0) stepper_.inspect([&](const World& world) { steps = world.step_count(); });
  stepper_.stop();
  thread_.join();
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(cancelled, 3);
  EXPECT_THROW(stepper_.edit([](World&) {}), Cancelled);
}

}  // namespace
}  // namespace constraint_sim
