#pragma once

#include <cstddef>

#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"

namespace constraint_sim::engine {

// Motors of a contact group that have a position and a force limit, and follow a prescribed motion
// to the position until they lose it.

/// Finds the motors that do not follow their prescribed motions, before states are decided, and
/// their braking decelerations.
void find_lost(ContactEquations* equations);

/// Finds the motors that lose their prescribed motions in the decided states, as
/// EventMotions::note_lost().
bool note_lost(ContactEquations* equations);

/// Marks the motors that are too weak to leave a limit in the decided states, with the decided
/// accelerations of coordinates. Returns whether there are further ones.
bool find_pressed(const ContactEquations& equations, const List<double>& accelerations,
                  List<char>* presses);

}  // namespace constraint_sim::engine
