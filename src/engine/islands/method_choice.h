#pragma once

#include <cstddef>
#include <cstdint>

#include "constraint_sim/engine/island.h"
#include "constraint_sim/engine/world.h"
#include "engine/math/integrate.h"

namespace constraint_sim::engine {

// The choice of the method of an island, as pure functions of its traits, its memory and contacts.
// The plan (`explain`) and the reports show the choice with its reason. In names, "substeps" are
// runge_kutta, "gradients" energy_momentum and "jumps" laws that need event_driven.

/// Memory of an island that decides its method, beside its bodies and joints. An edit clears all
/// but the fields that after_edit() keeps.
struct IslandMemory {
  std::uint64_t quiet_for = 0;    ///< steps in a row in which nothing moved noticeably
  bool is_stiff = false;          ///< as measured in the last interval
  int stiff_ticks = 0;            ///< stiff intervals in a row; expensive ones count several times
  std::uint64_t stiff_until = 0;  ///< step before which a stiff island stays stiff
  std::uint64_t refused_until = 0;  ///< step before which impulses advance the island
  /// Step before which impulses advance the contacts of the island, and event_driven does not.
  std::uint64_t contacts_refused_until = 0;
  /// Reason why impulses took the contacts of the island over from event_driven; kSmooth: they did
  /// not, or event_driven advances the contacts again.
  MethodReason left_for = MethodReason::kSmooth;
  std::uint64_t touched_until = 0;        ///< step until which its last contact counts as recent
  std::uint64_t inconsistent_until = 0;   ///< step before which its joints count as inconsistent
  std::uint32_t gradient_iterations = 0;  ///< Newton iterations of energy_momentum, last step; or 0
  /// Evaluations of runge_kutta per radian of h ω, measured while stiff; 0: never measured.
  double substep_cost = 0.0;

  /// Returns the memory that an edit leaves.
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
  /// Changes all steps for a world whose current step becomes `to` instead of `from`.
  void move(std::uint64_t from, std::uint64_t to) {
    for (std::uint64_t* until : {&stiff_until, &refused_until, &contacts_refused_until,
                                 &touched_until, &inconsistent_until})
      *until = *until > from ? *until - from + to : 0;
  }
};

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
