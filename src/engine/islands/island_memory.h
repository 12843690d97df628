#pragma once

#include <cstdint>

#include "constraint_sim/engine/island.h"

namespace constraint_sim::engine {

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
  bool is_in_group = false;         ///< whether event_driven advanced its contacts in the last step
  std::uint64_t touched_until = 0;  ///< step until which its last contact counts as recent
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
    return !is_stiff && !is_in_group &&
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

}  // namespace constraint_sim::engine
