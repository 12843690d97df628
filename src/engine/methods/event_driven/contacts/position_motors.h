#pragma once

#include <cstddef>

#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"

namespace constraint_sim::engine {

// Motors of a contact group that have a position and a force limit, and follow a prescribed motion
// to the position until they lose it.

/// Returns the deceleration of a coordinate by half of the force of its motor, while other motors
/// hold; zero where joints hold the coordinate.
double braking_of(std::size_t coordinate, const ContactEquations& equations);

/// Finds the motors that have lost their prescribed motions, and their braking decelerations.
void find_lost(ContactEquations* equations);

/// Marks the motors that are too weak to leave a limit in the decided states, with the decided
/// accelerations of coordinates. Returns whether there are further ones.
bool find_pressed(const ContactEquations& equations, const List<double>& accelerations,
                  List<char>* is_pressed);

}  // namespace constraint_sim::engine
