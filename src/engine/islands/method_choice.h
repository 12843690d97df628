#pragma once

#include <cstdint>

#include "constraint_sim/engine/island.h"
#include "constraint_sim/engine/world.h"
#include "engine/islands/island_memory.h"
#include "engine/math/integrate.h"

namespace constraint_sim::engine {

// The choice of the method of an island, as pure functions of its traits, its memory and contacts.
// The plan (`explain`) and the reports show the choice with its reason. In names, "substeps" are
// runge_kutta, "gradients" energy_momentum and "jumps" laws that need event_driven.

// ---- at the start of a step

/// Properties of an island's joints that decide its method. Edits change them, steps do not.
struct IslandTraits {
  bool has_joints = false;
  /// kLimit, kFriction or kForceLimit, by the first joint with one of these laws, or kBreaks.
  /// kLimitedSpring or kManyRows where event_driven cannot advance the laws. kSmooth: no such law.
  MethodReason jumps = MethodReason::kSmooth;
  double fastest_spring = 0.0;   ///< largest ω at which springs and dampers move a body [1/s]
  double fastest_limited = 0.0;  ///< largest ω of springs and servos with a force limit [1/s]
};

/// Returns the reason for an island's method without contacts and without memory (its nature).
MethodReason classify(const IslandTraits& traits, const WorldOptions& options);

/// The method that goes with a reason.
Method method_for(MethodReason why, const WorldOptions& options);

/// Whether contacts of few bodies are event-driven.
bool follows_contacts(const WorldOptions& options);

struct MethodChoice {
  Method method;
  MethodReason why;
};

/// Chooses the method of an island that is in no event-driven group. `nature`: result of
/// classify(). Impulses advance an island in contact, and for a while an island that could not be
/// integrated. Otherwise `memory` may make the island inconsistent or stiff.
MethodChoice choose(MethodReason nature, bool in_contact, const IslandMemory& memory,
                    std::uint64_t step, const WorldOptions& options);

/// Writes the contact and the choice to the memory of an island.
void remember_choice(const MethodChoice& choice, bool in_contact, std::uint64_t step,
                     IslandMemory* memory);

// ---- within a step

/// Largest h ω of joints at which an island is not stiff, or may still be integrated by substeps.
double stiffness_limit(const WorldOptions& options);

/// Cost of a step by energy_momentum, in evaluations of the equations of motion, by the
/// iterations of the last such step or by usual iterations. `is_simple`: points on a tree of rods.
double gradient_cost(bool is_simple, const IslandMemory& memory);

/// Largest ω of joints at which substeps cost no more than energy_momentum [rad/s], by the
/// substeps that were last counted, or else by the substeps that stability needs.
double most_frequency(double gradient_cost, const IslandMemory& memory,
                      const WorldOptions& options);

/// Writes the result of an interval by substeps to the memory. Returns whether the next step has to
/// choose the method again. Clears `progress->is_stiff` where substeps cost less than
/// `gradient_cost`.
bool learn_from_substeps(double gradient_cost, std::uint64_t step, const WorldOptions& options,
                         IntegrationResult* progress, IslandMemory* memory);

/// Writes the result of an interval by energy_momentum to the memory: its Newton iterations, and
/// the largest ω of bodies [rad/s].
void learn_from_gradients(int iterations, double frequency, bool is_simple, std::uint64_t step,
                          const WorldOptions& options, IslandMemory* memory);

/// Leaves an island that could not be integrated to impulses for a while.
void learn_from_refusal(std::uint64_t step, IslandMemory* memory);

/// Leaves contacts that were event-driven to impulses for a while, for the reason `why`.
void learn_from_handover(MethodReason why, std::uint64_t step, const WorldOptions& options,
                         IslandMemory* memory);

/// Keeps an island with inconsistent joints with least_squares for some more steps, so that
/// joints that are inconsistent now and then do not change the method in every step.
void learn_from_inconsistency(std::uint64_t step, IslandMemory* memory);

}  // namespace constraint_sim::engine
