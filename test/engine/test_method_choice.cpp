// Choice of the method of an island with its reason, as a table, and updates of an island's memory.

#include <limits>

#include "engine/islands/method_choice.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

constexpr std::uint64_t kNow = 1000;  // [steps]
constexpr Method kAutomatic = Method::kAuto, kRungeKutta = Method::kRungeKutta,
                 kEnergyMomentum = Method::kEnergyMomentum, kImpulses = Method::kTimeStepping,
                 kEvents = Method::kEventDriven;

WorldOptions options_with(Method method) {
  WorldOptions options;
  options.method = method;
  return options;
}

TEST(MethodChoice, NatureOfAnIslandByOptionsJointsAndSprings) {
  struct Case {
    Method asked;
    IslandTraits traits;
    MethodReason nature;
  };
  constexpr double kCalm = 3999.0, kFast = 4001.0;  // h ω of 40 is the limit at a tick of 0.01 s
  const Case cases[] = {
      {kAutomatic, {false, MethodReason::kSmooth, 0.0}, MethodReason::kSmooth},
      {kAutomatic, {true, MethodReason::kSmooth, kCalm}, MethodReason::kSmooth},
      {kAutomatic, {true, MethodReason::kSmooth, kFast}, MethodReason::kStiff},
      {kAutomatic, {true, MethodReason::kLimit, 0.0}, MethodReason::kLimit},
      {kAutomatic, {true, MethodReason::kLimit, kFast}, MethodReason::kLimit},
      {kAutomatic, {true, MethodReason::kForceLimit, 0.0}, MethodReason::kForceLimit},
      {kRungeKutta, {true, MethodReason::kSmooth, kFast}, MethodReason::kSmooth},
      {kRungeKutta, {true, MethodReason::kLimit, 0.0}, MethodReason::kLimit},
      {kEnergyMomentum, {true, MethodReason::kSmooth, 0.0}, MethodReason::kAskedFor},
      {kEnergyMomentum, {false, MethodReason::kSmooth, 0.0}, MethodReason::kSmooth},
      {kEnergyMomentum, {true, MethodReason::kForceLimit, 0.0}, MethodReason::kForceLimit},
      {kEvents, {true, MethodReason::kLimit, kFast}, MethodReason::kLimit},
      {kEvents, {true, MethodReason::kSmooth, kFast}, MethodReason::kSmooth},
      {Method::kSequentialImpulses, {true, MethodReason::kLimit, kFast}, MethodReason::kAskedFor},
      {Method::kSequentialImpulses, {false, MethodReason::kSmooth, 0.0}, MethodReason::kAskedFor},
  };
  for (const Case& c : cases)
    EXPECT_EQ(classify(c.traits, options_with(c.asked)), c.nature)
        << name(c.asked) << ", jumps: " << to_string(c.traits.jumps) << ", "
        << c.traits.fastest_spring;
}

TEST(MethodChoice, EveryReasonHasOneMethod) {
  const std::pair<MethodReason, Method> cases[] = {{MethodReason::kSmooth, kRungeKutta},
                                                   {MethodReason::kStiff, kEnergyMomentum},
                                                   {MethodReason::kInconsistent, kEnergyMomentum},
                                                   {MethodReason::kContact, kImpulses},
                                                   {MethodReason::kLimit, kEvents},
                                                   {MethodReason::kForceLimit, kEvents},
                                                   {MethodReason::kFriction, kEvents},
                                                   {MethodReason::kBreaks, kEvents},
                                                   {MethodReason::kLimitedSpring, kImpulses},
                                                   {MethodReason::kManyRows, kImpulses},
                                                   {MethodReason::kRefused, kImpulses},
                                                   {MethodReason::kAskedFor, kEnergyMomentum},
                                                   {MethodReason::kFewContacts, kEvents},
                                                   {MethodReason::kContactsGivenUp, kImpulses},
                                                   {MethodReason::kManyContacts, kImpulses},
                                                   {MethodReason::kOverlap, kImpulses}};
  for (const auto& [why, method] : cases)
    EXPECT_EQ(method_for(why, options_with(kEnergyMomentum)), method) << to_string(why);
  EXPECT_EQ(method_for(MethodReason::kAskedFor, options_with(Method::kSequentialImpulses)),
            Method::kSequentialImpulses);
}

TEST(MethodChoice, OfNatureContactAndWhatIsRemembered) {
  struct Case {
    const char* what;
    MethodReason nature;
    bool in_contact, is_refused, is_inconsistent, is_stiff;
    MethodReason why;
    Method method;
  };
  const Case cases[] = {
      {"nothing special", MethodReason::kSmooth, false, false, false, false, MethodReason::kSmooth,
       kRungeKutta},
      {"touched", MethodReason::kSmooth, true, false, false, false, MethodReason::kContact,
       kImpulses},
      {"touched and stiff", MethodReason::kStiff, true, false, false, true, MethodReason::kContact,
       kImpulses},
      {"a rope, touched", MethodReason::kLimit, true, false, false, false, MethodReason::kContact,
       kImpulses},
      {"a rope, refused", MethodReason::kLimit, false, true, false, false, MethodReason::kRefused,
       kImpulses},
      {"measured stiff", MethodReason::kSmooth, false, false, false, true, MethodReason::kStiff,
       kEnergyMomentum},
      {"a rope, measured stiff", MethodReason::kLimit, false, false, false, true,
       MethodReason::kLimit, kEvents},
      {"stiff springs", MethodReason::kStiff, false, false, false, false, MethodReason::kStiff,
       kEnergyMomentum},
      {"refused", MethodReason::kSmooth, false, true, false, true, MethodReason::kRefused,
       kImpulses},
      {"refused and touched", MethodReason::kSmooth, true, true, false, false,
       MethodReason::kRefused, kImpulses},
      {"inconsistent", MethodReason::kSmooth, false, false, true, false,
       MethodReason::kInconsistent, kEnergyMomentum},
      {"inconsistent, stiff", MethodReason::kStiff, false, false, true, true,
       MethodReason::kInconsistent, kEnergyMomentum},
      {"inconsistent, touched", MethodReason::kSmooth, true, false, true, false,
       MethodReason::kContact, kImpulses},
  };
  for (const Case& c : cases) {
    IslandMemory memory;
    memory.refused_until = c.is_refused ? kNow + 1 : kNow;  // refused until this step only
    memory.inconsistent_until = c.is_inconsistent ? kNow + 1 : kNow;
    memory.is_stiff = c.is_stiff;
    const MethodChoice choice =
        choose(c.nature, c.in_contact, memory, kNow, options_with(kAutomatic));
    EXPECT_EQ(choice.why, c.why) << c.what << ": " << to_string(choice.why);
    EXPECT_EQ(choice.method, c.method) << c.what << ": " << name(choice.method);
    EXPECT_EQ(choice.method, method_for(choice.why, options_with(kAutomatic))) << c.what;
    remember_choice(choice, c.in_contact, kNow, &memory);
    EXPECT_EQ(memory.touched_until > kNow, c.in_contact) << c.what;
    if (choice.method == kImpulses) {
      EXPECT_EQ(memory.inconsistent_until, 0u) << c.what;
    }
  }
}

// Islands that event-driven contacts gave up use impulses for half a second, whatever the tick;
// islands that were too large only while they touch anything.
TEST(MethodChoice, WhatEventsHaveLeftStaysAwayForHalfASecond) {
  for (const double h : {0.1, 0.01, 0.001}) {
    WorldOptions options = options_with(kAutomatic);
    options.time_step = h;
    const auto steps = static_cast<std::uint64_t>(std::lround(0.5 / h));
    for (const MethodReason why : {MethodReason::kContactsGivenUp, MethodReason::kManyContacts}) {
      IslandMemory memory;
      learn_from_handover(why, kNow, options, &memory);
      EXPECT_EQ(memory.contacts_refused_until, kNow + steps) << h;
      const auto is_told = [&](bool in_contact, std::uint64_t step) {
        return choose(MethodReason::kSmooth, in_contact, memory, step, options).why;
      };
      EXPECT_EQ(is_told(true, kNow + steps - 1), why) << h;
      EXPECT_EQ(is_told(true, kNow + steps), MethodReason::kContact) << h;
      const bool is_given_up = why == MethodReason::kContactsGivenUp;
      EXPECT_EQ(is_told(false, kNow + 1), is_given_up ? why : MethodReason::kSmooth) << h;
      IslandMemory moved = memory;
      moved.move(kNow + steps, 0);  // the switch to impulses is remembered
      EXPECT_EQ(moved.left_for, why);
    }
  }
}

TEST(MethodChoice, AJerkDoesNotMakeAnIslandStiffButWhatGoesOnDoes) {
  const WorldOptions options = options_with(kAutomatic);
  IslandMemory memory;
  IntegrationResult progress;
  progress.is_stiff = true;
  progress.substeps = 100;
  const double cost = gradient_cost(false, memory);
  for (int span = 1; span <= 4; ++span) {  // 4 times the cost each
    progress.is_stiff = true;
    EXPECT_EQ(learn_from_substeps(cost, kNow, options, &progress, &memory), span == 4) << span;
  }
  EXPECT_TRUE(memory.is_stiff);
  EXPECT_GT(memory.stiff_until, kNow);

  IslandMemory dear;
  progress.substeps = 1000;  // 40 times the cost
  EXPECT_TRUE(learn_from_substeps(cost, kNow, options, &progress, &dear));
  EXPECT_TRUE(dear.is_stiff);

  IslandMemory jerked;
  progress.substeps = 100;
  learn_from_substeps(cost, kNow, options, &progress, &jerked);
  IntegrationResult calm;
  learn_from_substeps(cost, kNow, options, &calm, &jerked);
  EXPECT_EQ(jerked.stiff_ticks, 0);
  EXPECT_FALSE(jerked.is_stiff);
}

TEST(MethodChoice, SubstepsThatCostLessThanGradientsAreNotStiff) {
  IslandMemory memory;
  IntegrationResult progress;
  progress.is_stiff = true;
  progress.substeps = 1;  // 12 evaluations beside 300
  EXPECT_FALSE(learn_from_substeps(gradient_cost(false, memory), kNow, options_with(kAutomatic),
                                   &progress, &memory));
  EXPECT_FALSE(progress.is_stiff);
  EXPECT_EQ(memory.stiff_ticks, 0);
}

// With gradient_cost() of 300 and 2400 evaluations at h ω = 100 the costs are equal at h ω = 12.5;
// below stiffness_limit substeps are used nevertheless.
TEST(MethodChoice, SubstepsThatCostMoreThanStabilityAsksForAreRemembered) {
  WorldOptions options = options_with(kAutomatic);
  options.stiffness_limit = 5.0;
  const double ahead = most_frequency(300.0, {}, options);
  EXPECT_NEAR(ahead * options.time_step, 300.0 * 5.0 / 12.0, 1e-9);
  IslandMemory memory;
  IntegrationResult progress;
  progress.is_stiff = true;
  progress.substeps = 190;
  progress.rejected = 10;
  progress.frequency = 100.0 / options.time_step;
  learn_from_substeps(300.0, kNow, options, &progress, &memory);
  EXPECT_NEAR(memory.substep_cost, 24.0, 1e-12);
  EXPECT_NEAR(most_frequency(300.0, memory, options) * options.time_step, 12.5, 1e-12);
  options.stiffness_limit = 40.0;
  EXPECT_NEAR(most_frequency(300.0, memory, options) * options.time_step, 40.0, 1e-12);
  EXPECT_EQ(memory.after_edit().substep_cost, 0.0);
}

TEST(MethodChoice, AStiffIslandThatCalmsDownIsLetGo) {
  const WorldOptions options = options_with(kAutomatic);
  IslandMemory memory;
  memory.is_stiff = true;
  memory.stiff_until = kNow + 10;
  const double most = most_frequency(gradient_cost(true, memory), memory, options);
  learn_from_gradients(15, most, true, kNow, options, &memory);  // cost is unchanged
  EXPECT_TRUE(memory.is_stiff);
  EXPECT_GT(memory.stiff_until, kNow + 10);
  learn_from_gradients(15, 0.4 * most, true, kNow, options, &memory);  // waits
  EXPECT_TRUE(memory.is_stiff);
  learn_from_gradients(15, 0.4 * most, true, memory.stiff_until, options, &memory);
  EXPECT_FALSE(memory.is_stiff);
  memory.is_stiff = true;
  memory.stiff_until = kNow + 10;
  learn_from_gradients(15, 0.1 * most, true, kNow, options, &memory);  // at once
  EXPECT_FALSE(memory.is_stiff);
}

TEST(MethodChoice, WithoutAToleranceTheLimitIsThatOfStability) {
  WorldOptions options = options_with(kAutomatic);
  EXPECT_EQ(stiffness_limit(options), options.stiffness_limit);
  options.tolerance = 0.0;
  EXPECT_EQ(stiffness_limit(options), 5.0);  // limit for a single substep of order 8 per tick
  options.order = 5;
  EXPECT_EQ(stiffness_limit(options), 0.9);
  EXPECT_EQ(most_frequency(std::numeric_limits<double>::infinity(), {}, options), 90.0);
}

}  // namespace
}  // namespace constraint_sim::engine
