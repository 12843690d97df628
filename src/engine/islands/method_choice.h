#pragma once

#include <cstddef>
#include <cstdint>

#include "constraint_sim/engine/island.h"
#include "constraint_sim/engine/world.h"
#include "engine/math/integrate.h"

namespace constraint_sim::engine {

// Which method carries an island, and why: functions of what is known of the island, and nothing
// else. The plan and the report tell the choice with its reason.

/// What decides which method an island has, beside its bodies and joints. An edit clears it.
struct IslandMemory {
  std::uint64_t quiet_for = 0;      ///< steps in a row that moved nothing to speak of
  bool is_stiff = false;            ///< as measured when it was last carried
  int stiff_ticks = 0;              ///< in a row that substeps found so, dear ones more than once
  std::uint64_t stiff_until = 0;    ///< step before which it is not asked again
  std::uint64_t refused_until = 0;  ///< step
  std::uint64_t contacts_refused_until = 0;  ///< step before which its contacts are not by events
  /// Why they were handed over to impulses; kSmooth: they were not, or are back.
  MethodReason left_for = MethodReason::kSmooth;
  std::uint64_t touched_until = 0;        ///< step until which its last contact counts as near
  std::uint64_t inconsistent_until = 0;   ///< step
  std::uint32_t gradient_iterations = 0;  ///< Newton's, of the last tick by gradients; 0: none yet
  /// Evaluations that substeps took per radian of h ω, when they were last found stiff; 0: never.
  double substep_cost = 0.0;

  /// What an edit leaves of it.
  IslandMemory after_edit() const {
    IslandMemory left;
    left.quiet_for = quiet_for;
    left.touched_until = touched_until;
    return left;
  }
  bool is_none() const {
    return !is_stiff &&
           (quiet_for | stiff_until | refused_until | contacts_refused_until | touched_until |
            inconsistent_until | gradient_iterations) == 0 &&
           left_for == MethodReason::kSmooth && stiff_ticks == 0 && substep_cost == 0.0;
  }
  /// The steps are counted from another one.
  void move(std::uint64_t from, std::uint64_t to) {
    for (std::uint64_t* until : {&stiff_until, &refused_until, &contacts_refused_until,
                                 &touched_until, &inconsistent_until})
      *until = *until > from ? *until - from + to : 0;
  }
};

// ---- at the start of a step

/// What an island is made of, as far as it decides. Edits change it, steps do not.
struct IslandTraits {
  bool has_joints = false;
  /// kLimit, kFriction or kForceLimit, of the first joint that has such, or kBreaks; kLimitedSpring
  /// or kManyRows where there is what events are not for.
  MethodReason jumps = MethodReason::kSmooth;
  double fastest_spring = 0.0;   ///< largest ω that springs and dampers move a body with [1/s]
  double fastest_limited = 0.0;  ///< the same of springs and servos with a force limit
};

/// The reason for the method that an island has while nothing touches it, and it was never refused
/// nor measured.
MethodReason classify(const IslandTraits& traits, const WorldOptions& options);

/// The method that goes with a reason.
Method method_for(MethodReason why, const WorldOptions& options);

/// Whether contacts of few bodies are carried from event to event.
bool follows_contacts(const WorldOptions& options);

struct MethodChoice {
  Method method;
  MethodReason why;
};

/// `nature` is what classify() said. An island in contact has joints with jumps; one that was
/// refused is left to impulses for a while; what no impulses carry may be inconsistent or stiff as
/// `memory` knows.
MethodChoice choose(MethodReason nature, bool in_contact, const IslandMemory& memory,
                    std::uint64_t step, const WorldOptions& options);

/// What an island remembers of a contact, and of the choice.
void remember_choice(const MethodChoice& choice, bool in_contact, std::uint64_t step,
                     IslandMemory* memory);

// ---- within a step

/// What h ω joints may swing bodies with before an island counts as stiff, or is not allowed to be
/// integrated by substeps.
double stiffness_limit(const WorldOptions& options);

/// What a tick by gradients costs, in evaluations of the equations of motion: as the last one did,
/// or as such a tick usually does. Points on a tree of rods are simple.
double gradient_cost(bool is_simple, const IslandMemory& memory);

/// What joints may swing bodies with before substeps cost more than gradients [rad/s]: as they did
/// when they were last counted, or as many as stability asks for.
double most_frequency(double gradient_cost, const IslandMemory& memory,
                      const WorldOptions& options);

/// Takes over what a span by substeps showed; true where the island is to be asked again in the
/// next step. Counts what they cost, and clears `is_stiff` of the progress where substeps were
/// cheaper all the same.
bool learn_from_substeps(double gradient_cost, std::uint64_t step, const WorldOptions& options,
                         IntegrationResult* progress, IslandMemory* memory);

/// The same of a span by gradients that took so many iterations and moved bodies with ω up to
/// `frequency` [rad/s].
void learn_from_gradients(int iterations, double frequency, bool is_simple, std::uint64_t step,
                          const WorldOptions& options, IslandMemory* memory);

/// An island that was refused is left to impulses for a while.
void learn_from_refusal(std::uint64_t step, IslandMemory* memory);

/// The same of one whose contacts were by events until now, for a reason.
void learn_from_handover(MethodReason why, std::uint64_t step, const WorldOptions& options,
                         IslandMemory* memory);

/// An island with inconsistent constraints stays with their method until they can be met, and a
/// little longer, so that what comes and goes does not change the method in every step.
void learn_from_inconsistency(std::uint64_t step, IslandMemory* memory);

}  // namespace constraint_sim::engine
