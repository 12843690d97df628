#include "engine/islands/method_choice.h"

#include <algorithm>
#include <cmath>

#include "engine/model/impulse_method.h"

namespace constraint_sim::engine {
namespace {

// Largest h ω at which a substep of order 8 or 5 is stable, with a margin.
constexpr double kStable8 = 5.0, kStable5 = 0.9;
// Intervals in a row with expensive substeps after which an island is stiff. A jerk is over after
// one or two. An interval counts once more for each kOneMore times the cost of a step by
// energy_momentum.
constexpr int kStiffFor = 4;
constexpr double kOneMore = 6.0;
// An island stops being stiff when h ω stays below kCalmShare of the limit for kCalmFor steps.
constexpr double kCalmShare = 0.5;
constexpr std::uint64_t kCalmFor = 50;  // [steps]
// Duration for which an island that could not be integrated is left to impulses [steps].
constexpr std::uint64_t kRefusedFor = 100;
// Duration for which impulses keep contacts that they took over from events [s].
constexpr double kHandedOverFor = 0.5;
// Duration for which inconsistent joints have to be consistent before the method changes [steps].
constexpr std::uint64_t kInconsistentFor = 3;
// An island stops being stiff at once when substeps cost less than 1/kMuchCheaper of a step by
// energy_momentum.
constexpr double kMuchCheaper = 4.0;
// Usual Newton iterations of a step by energy_momentum, and the cost of an iteration in
// evaluations of the equations of motion: for points on a tree of rods, and for other islands.
constexpr double kUsualIterations = 15.0;
constexpr double kPointIteration = 6.0, kIteration = 20.0;

// Largest h ω of springs and servos with a force limit that event_driven advances, by some 350
// substeps a step with rejected substeps. No other method of this order advances them.
constexpr double kMostLimited = 5000.0;

double stable(const WorldOptions& options) { return options.order == 5 ? kStable5 : kStable8; }

double stages(const WorldOptions& options) {
  return static_cast<double>(options.order == 5 ? DormandPrince5::kStages
                                                : DormandPrince8::kStages);
}

}  // namespace

const char* to_string(MethodReason why) {
  switch (why) {
    case MethodReason::kSmooth:
      return "smooth";
    case MethodReason::kAskedFor:
      return "asked for";
    case MethodReason::kContact:
      return "in contact";
    case MethodReason::kLimit:
      return "has limits";
    case MethodReason::kForceLimit:
      return "has a motor with a force limit";
    case MethodReason::kFriction:
      return "has a joint with friction";
    case MethodReason::kStiff:
      return "stiff";
    case MethodReason::kRefused:
      return "could not be integrated to the tolerance";
    case MethodReason::kInconsistent:
      return "its joints cannot all be met";
    case MethodReason::kAtRest:
      return "at rest";
    case MethodReason::kBreaks:
      return "has a joint that can break";
    case MethodReason::kLimitedSpring:
      return "has a spring with a force limit that events do not follow";
    case MethodReason::kManyRows:
      return "has too much friction, too many motors, or a net of too many ropes, for events";
    case MethodReason::kFewContacts:
      return "near few others";
    case MethodReason::kContactsGivenUp:
      return "its contacts could not be followed by events";
    case MethodReason::kManyContacts:
      return "in contact, with too many for events";
    case MethodReason::kOverlap:
      return "in contact, too deep for events";
  }
  return "";
}

// ---- at the start of a step

MethodReason classify(const IslandTraits& traits, const WorldOptions& options) {
  if (options.method == Method::kSequentialImpulses) return MethodReason::kAskedFor;
  if (traits.jumps != MethodReason::kSmooth) {
    const bool is_too_stiff = options.method != Method::kEventDriven &&
                              options.time_step * traits.fastest_limited > kMostLimited;
    return is_too_stiff ? MethodReason::kLimitedSpring : traits.jumps;
  }
  if ((options.method == Method::kAuto || options.method == Method::kTimeStepping) &&
      options.time_step * traits.fastest_spring > options.stiffness_limit)
    return MethodReason::kStiff;
  const bool is_asked = options.method == Method::kEnergyMomentum && traits.has_joints;
  return is_asked ? MethodReason::kAskedFor : MethodReason::kSmooth;
}

Method method_for(MethodReason why, const WorldOptions& options) {
  switch (why) {
    case MethodReason::kAskedFor:
      return options.method;
    case MethodReason::kSmooth:
      return Method::kRungeKutta;
    case MethodReason::kStiff:
    case MethodReason::kInconsistent:
      return Method::kEnergyMomentum;
    case MethodReason::kLimit:
    case MethodReason::kFriction:
    case MethodReason::kForceLimit:
    case MethodReason::kBreaks:
    case MethodReason::kFewContacts:
      return Method::kEventDriven;
    case MethodReason::kContact:
    case MethodReason::kRefused:
    case MethodReason::kAtRest:
    case MethodReason::kLimitedSpring:
    case MethodReason::kManyRows:
    case MethodReason::kContactsGivenUp:
    case MethodReason::kManyContacts:
    case MethodReason::kOverlap:
      return impulses_of(options);
  }
  return impulses_of(options);
}

bool follows_contacts(const WorldOptions& options) {
  return options.method == Method::kAuto || options.method == Method::kEventDriven;
}

MethodChoice choose(MethodReason nature, bool in_contact, const IslandMemory& memory,
                    std::uint64_t step, const WorldOptions& options) {
  const auto is_by_impulses = [&](MethodReason why) {
    return uses_impulses(method_for(why, options));
  };
  MethodReason why = nature;
  if (in_contact && !is_by_impulses(why)) why = MethodReason::kContact;
  if (step < memory.refused_until) why = MethodReason::kRefused;
  if (step < memory.contacts_refused_until) {
    if (memory.left_for == MethodReason::kContactsGivenUp || why == MethodReason::kContact)
      why = memory.left_for;
  }
  if (!is_by_impulses(why)) {
    if (step < memory.inconsistent_until)
      why = MethodReason::kInconsistent;
    else if (memory.is_stiff && why == MethodReason::kSmooth)
      why = MethodReason::kStiff;
  }
  return {method_for(why, options), why};
}

void remember_choice(const MethodChoice& choice, bool in_contact, std::uint64_t step,
                     IslandMemory* memory) {
  if (in_contact) memory->touched_until = step + kRefusedFor;
  memory->is_in_group = choice.why == MethodReason::kFewContacts;
  if (uses_impulses(choice.method)) memory->inconsistent_until = 0;
}

// ---- within a step

double stiffness_limit(const WorldOptions& options) {
  if (options.tolerance > 0.0) return options.stiffness_limit;
  return std::min(options.stiffness_limit, stable(options));
}

double gradient_cost(bool is_simple, const IslandMemory& memory) {
  const double iterations =
      memory.gradient_iterations > 0 ? memory.gradient_iterations : kUsualIterations;
  return iterations * (is_simple ? kPointIteration : kIteration);
}

double most_frequency(double gradient_cost, const IslandMemory& memory,
                      const WorldOptions& options) {
  double limit = stiffness_limit(options);
  const double stable_cost = stages(options) / stable(options);
  const double cost = memory.substep_cost > 0.0 ? memory.substep_cost : stable_cost;
  if (options.tolerance > 0.0) limit = std::max(limit, gradient_cost / cost);
  return limit / options.time_step;
}

bool learn_from_substeps(double gradient_cost, std::uint64_t step, const WorldOptions& options,
                         IntegrationResult* progress, IslandMemory* memory) {
  int ticks = 1;
  if (progress->is_stiff && progress->done && options.tolerance > 0.0) {
    const double cost = stages(options) * (progress->substeps + progress->rejected);
    memory->substep_cost = cost / (options.time_step * progress->frequency);
    progress->is_stiff = cost > gradient_cost;
    ticks += static_cast<int>(std::min<double>(cost / (kOneMore * gradient_cost), kStiffFor));
  }
  memory->stiff_ticks = progress->is_stiff ? memory->stiff_ticks + ticks : 0;
  if (progress->done && memory->stiff_ticks < kStiffFor) return false;
  if (progress->done || progress->is_stiff) {
    memory->is_stiff = true;
    memory->stiff_until = step + kCalmFor;
  }
  return true;
}

void learn_from_gradients(int iterations, double frequency, bool is_simple, std::uint64_t step,
                          const WorldOptions& options, IslandMemory* memory) {
  memory->gradient_iterations = static_cast<std::uint32_t>(std::max(iterations, 1));
  const double most = most_frequency(gradient_cost(is_simple, *memory), *memory, options);
  if (frequency > kCalmShare * most)
    memory->stiff_until = std::max(memory->stiff_until, step + kCalmFor);
  else if (frequency * kMuchCheaper < most)
    memory->stiff_until = 0;
  memory->is_stiff = memory->is_stiff && step < memory->stiff_until;
}

void learn_from_refusal(std::uint64_t step, IslandMemory* memory) {
  memory->refused_until = step + kRefusedFor;
}

void learn_from_handover(MethodReason why, std::uint64_t step, const WorldOptions& options,
                         IslandMemory* memory) {
  memory->contacts_refused_until =
      step + static_cast<std::uint64_t>(std::ceil(kHandedOverFor / options.time_step));
  memory->left_for = why;
}

void learn_from_inconsistency(std::uint64_t step, IslandMemory* memory) {
  memory->inconsistent_until = step + kInconsistentFor;
}

}  // namespace constraint_sim::engine
