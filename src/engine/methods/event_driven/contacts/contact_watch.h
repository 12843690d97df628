#pragma once

#include <cstddef>

#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_pairs.h"
#include "engine/methods/event_driven/event_watch.h"
#include "engine/methods/event_driven/staged_substep.h"

namespace constraint_sim::engine {

/// Watched value of a contact group, with the contact, coordinate or joint that an event changes.
struct ContactWatched : WatchedValue {
  enum class Kind : char {
    kNothing,
    kGap,     ///< gap of an open contact
    kForce,   ///< normal force of an acting contact
    kCone,    ///< margin of a sticking contact to its friction cone
    kSlip,    ///< slip speed of a contact along its initial direction
    kMargin,  ///< margin of the feature of a contact
    kLimit,   ///< gap of a coordinate to a limit
    kHeld,    ///< margin of the holding force of a coordinate to a bound
    /// Rate of a slipping coordinate, a saturated or braking motor or a yielding limit; servo
    /// force
    kRate,
    kBreak,  ///< margin of the load of a joint to its breaking load
  };
  Kind kind = Kind::kNothing;
  std::size_t contact = 0;
  std::size_t coordinate = 0;  ///< index, for kLimit, kHeld and kRate
  std::size_t joint = 0;       ///< index, for kBreak
  signed char side = 0;        ///< bound of a holding force: -1 lower, +1 upper
};

// Margins of forces to their bounds. Stages of the `last` substep show a force that leaves its
// bounds and returns.

/// Adds the normal force of an acting contact, and the margin of a sticking contact to its cone.
void watch_contact_forces(const ContactEquations& equations, std::size_t contact,
                          const StagedSubstep& last, List<ContactWatched>* list);
/// Adds the margins of the force that holds a coordinate against its bounds.
void watch_held(const ContactEquations& equations, std::size_t coordinate,
                const StagedSubstep& last, List<ContactWatched>* list);
/// Adds the margins of the force and torque of a joint to its breaking loads.
void watch_breaking(const ContactEquations& equations, std::size_t joint, const StagedSubstep& last,
                    List<ContactWatched>* list);

/// Lists all watched values of a contact group in a substep: gaps, margins of forces, slips, and
/// gaps and rates of coordinates. An event is where a value falls below zero.
class ContactWatch {
 public:
  /// Lists the values at the current pose, in an order that depends only on the states of contacts
  /// and coordinates. `dydt`: current derivative.
  void list(const ContactEquations& equations, const ContactPairs& pairs, const double* dydt,
            const StagedSubstep& last, List<ContactWatched>* list);

 private:
  void add_contact(const ContactEquations& equations, const ContactPairs& pairs,
                   std::size_t contact, const StagedSubstep& last,
                   List<ContactWatched>* list) const;
  void add_coordinate(const ContactEquations& equations, std::size_t coordinate,
                      const StagedSubstep& last, List<ContactWatched>* list) const;

  GroupMotions rates_;
};

}  // namespace constraint_sim::engine
