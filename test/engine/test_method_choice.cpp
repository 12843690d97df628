// Which method carries an island and why, as a table; and what spans teach an island.

#include <limits>

#include "engine/method_choice.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

constexpr std::uint64_t kNow = 1000;  // [steps]
constexpr Method kAuto = Method::kAuto, kRungeKutta = Method::kRungeKutta,
                 kGradients = Method::kEnergyMomentum, kImpulses = Method::kSequentialImpulses;

WorldOptions with(Method method) {
  WorldOptions options;
  options.method = method;
  return options;
}

TEST(MethodChoice, NatureOfAnIslandByOptionsJointsAndSprings) {
  struct Case {
    Method asked;
    IslandTraits traits;
    Why nature;
  };
  constexpr double kCalm = 3999.0, kFast = 4001.0;  // h ω of 40 is the limit at a tick of 0.01 s
  const Case cases[] = {
      {kAuto, {false, Why::kSmooth, 0.0}, Why::kSmooth},
      {kAuto, {true, Why::kSmooth, kCalm}, Why::kSmooth},
      {kAuto, {true, Why::kSmooth, kFast}, Why::kStiff},
      {kAuto, {true, Why::kLimit, 0.0}, Why::kLimit},
      {kAuto, {true, Why::kLimit, kFast}, Why::kLimit},
      {kAuto, {true, Why::kForceLimit, 0.0}, Why::kForceLimit},
      {kRungeKutta, {true, Why::kSmooth, kFast}, Why::kSmooth},
      {kRungeKutta, {true, Why::kLimit, 0.0}, Why::kLimit},
      {kGradients, {true, Why::kSmooth, 0.0}, Why::kAskedFor},
      {kGradients, {false, Why::kSmooth, 0.0}, Why::kSmooth},
      {kGradients, {true, Why::kForceLimit, 0.0}, Why::kForceLimit},
      {kImpulses, {true, Why::kLimit, kFast}, Why::kAskedFor},
      {kImpulses, {false, Why::kSmooth, 0.0}, Why::kAskedFor},
  };
  for (const Case& c : cases)
    EXPECT_EQ(classify(c.traits, with(c.asked)), c.nature)
        << name(c.asked) << ", jumps: " << text(c.traits.jumps) << ", " << c.traits.fastest_spring;
}

TEST(MethodChoice, EveryReasonHasOneMethod) {
  const std::pair<Why, Method> cases[] = {
      {Why::kSmooth, kRungeKutta}, {Why::kStiff, kGradients},   {Why::kConflict, kGradients},
      {Why::kContact, kImpulses},  {Why::kLimit, kImpulses},    {Why::kForceLimit, kImpulses},
      {Why::kRefused, kImpulses},  {Why::kAskedFor, kGradients}};
  for (const auto& [why, method] : cases)
    EXPECT_EQ(method_for(why, with(kGradients)), method) << text(why);
  EXPECT_EQ(method_for(Why::kAskedFor, with(kImpulses)), kImpulses);
}

TEST(MethodChoice, OfNatureContactAndWhatIsRemembered) {
  struct Case {
    const char* what;
    Why nature;
    bool in_contact, is_refused, is_inconsistent, is_stiff;
    Why why;
    Method method;
  };
  const Case cases[] = {
      {"nothing special", Why::kSmooth, false, false, false, false, Why::kSmooth, kRungeKutta},
      {"touched", Why::kSmooth, true, false, false, false, Why::kContact, kImpulses},
      {"touched and stiff", Why::kStiff, true, false, false, true, Why::kContact, kImpulses},
      {"a rope, touched", Why::kLimit, true, false, false, false, Why::kLimit, kImpulses},
      {"measured stiff", Why::kSmooth, false, false, false, true, Why::kStiff, kGradients},
      {"a rope, measured stiff", Why::kLimit, false, false, false, true, Why::kLimit, kImpulses},
      {"stiff springs", Why::kStiff, false, false, false, false, Why::kStiff, kGradients},
      {"refused", Why::kSmooth, false, true, false, true, Why::kRefused, kImpulses},
      {"refused and touched", Why::kSmooth, true, true, false, false, Why::kRefused, kImpulses},
      {"inconsistent", Why::kSmooth, false, false, true, false, Why::kConflict, kGradients},
      {"inconsistent, stiff", Why::kStiff, false, false, true, true, Why::kConflict, kGradients},
      {"inconsistent, touched", Why::kSmooth, true, false, true, false, Why::kContact, kImpulses},
  };
  for (const Case& c : cases) {
    IslandMemory memory;
    memory.refused_until = c.is_refused ? kNow + 1 : kNow;  // until then, and no longer
    memory.inconsistent_until = c.is_inconsistent ? kNow + 1 : kNow;
    memory.is_stiff = c.is_stiff;
    const MethodChoice choice = choose(c.nature, c.in_contact, memory, kNow, with(kAuto));
    EXPECT_EQ(choice.why, c.why) << c.what << ": " << text(choice.why);
    EXPECT_EQ(choice.method, c.method) << c.what << ": " << name(choice.method);
    EXPECT_EQ(choice.method, method_for(choice.why, with(kAuto))) << c.what;
    remember_choice(choice, c.in_contact, kNow, &memory);
    EXPECT_EQ(memory.touched_until > kNow, c.in_contact) << c.what;
    if (choice.method == kImpulses) {
      EXPECT_EQ(memory.inconsistent_until, 0u) << c.what;
    }
  }
}

TEST(MethodChoice, AJerkDoesNotMakeAnIslandStiffButWhatGoesOnDoes) {
  const WorldOptions options = with(kAuto);
  IslandMemory memory;
  Progress progress;
  progress.is_stiff = true;
  progress.substeps = 1000;
  const double cost = gradient_cost(false, memory);
  for (int span = 1; span <= 4; ++span)
    EXPECT_EQ(learn_from_substeps(cost, kNow, options, &progress, &memory), span == 4) << span;
  EXPECT_TRUE(memory.is_stiff);
  EXPECT_GT(memory.stiff_until, kNow);

  IslandMemory jerked;
  learn_from_substeps(cost, kNow, options, &progress, &jerked);
  Progress calm;
  learn_from_substeps(cost, kNow, options, &calm, &jerked);
  EXPECT_EQ(jerked.stiff_ticks, 0);
  EXPECT_FALSE(jerked.is_stiff);
}

TEST(MethodChoice, SubstepsThatCostLessThanGradientsAreNotStiff) {
  IslandMemory memory;
  Progress progress;
  progress.is_stiff = true;
  progress.substeps = 1;  // 12 evaluations beside 300
  EXPECT_FALSE(
      learn_from_substeps(gradient_cost(false, memory), kNow, with(kAuto), &progress, &memory));
  EXPECT_FALSE(progress.is_stiff);
  EXPECT_EQ(memory.stiff_ticks, 0);
}

TEST(MethodChoice, AStiffIslandThatCalmsDownIsLetGo) {
  const WorldOptions options = with(kAuto);
  IslandMemory memory;
  memory.is_stiff = true;
  memory.stiff_until = kNow + 10;
  const double most = most_frequency(gradient_cost(true, memory), options);
  learn_from_gradients(15, most, true, kNow, options, &memory);  // as fast as ever
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
  WorldOptions options = with(kAuto);
  EXPECT_EQ(stiffness_limit(options), options.stiffness_limit);
  options.tolerance = 0.0;
  EXPECT_EQ(stiffness_limit(options), 5.0);  // one substep of order 8 a tick
  options.order = 5;
  EXPECT_EQ(stiffness_limit(options), 0.9);
  EXPECT_EQ(most_frequency(std::numeric_limits<double>::infinity(), options), 90.0);
}

}  // namespace
}  // namespace constraint_sim::engine
