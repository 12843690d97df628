#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/world.h"
#include "engine/math/list.h"
#include "engine/model/touching_pair.h"

namespace constraint_sim::engine {

/// Everything that a step reports.
struct StepOutput {
  StepReport report;
  std::vector<Contact> contacts;          ///< contacts of sleeping islands first
  std::size_t resting_contact_count = 0;  ///< number of contacts of sleeping islands
  std::vector<Event> events;
  std::optional<JointId> failed_joint;  ///< joint whose plugin failed the step (Failure::kCustom)
  std::string failed_why;               ///< message of the plugin that failed the step

  /// Reports the contacts of sleeping islands, and no others.
  void set_resting_contacts(const List<TouchingPair>& resting, double time_step);
  /// Reports the contacts of awake islands behind the contacts of sleeping islands.
  void set_contacts(const List<TouchingPair>& touching, double time_step);
  void sort_events();

 private:
  void add_contacts(const TouchingPair& pair, double time_step);
};

}  // namespace constraint_sim::engine
