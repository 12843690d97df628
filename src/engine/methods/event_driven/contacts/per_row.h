#pragma once

#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"

namespace constraint_sim::engine {

/// Values per contact and per coordinate of a contact group, such as impulses.
template <class Number>
struct PerRow {
  List<Number> contacts, coordinates;

  void reset(const ContactEquations& equations, Number value = {}) {
    contacts.assign(equations.contacts().size(), value);
    coordinates.assign(equations.joints().coordinates().size(), value);
  }
};

}  // namespace constraint_sim::engine
