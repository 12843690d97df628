#pragma once

#include <vector>

#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/world.h"
#include "engine/islands/contact_groups.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/touching_pair.h"

namespace constraint_sim::engine {

/// Adds the events of an event-driven group in a step that ends at `end` [s].
void add_group_events(const Model& model, const ContactGroup& group, double end,
                      std::vector<Event>* events);

/// Adds contacts of an event-driven group that hold, or had an impulse within the step.
void add_group_contacts(const Model& model, const List<BodyState>& states,
                        const ContactGroup& group, List<TouchingPair>* touching);

}  // namespace constraint_sim::engine
