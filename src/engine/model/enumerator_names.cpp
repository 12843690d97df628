// Names of enumerators of reports, events and contacts, as scenes, messages and Python have them.

#include <array>
#include <cstddef>

#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/event.h"
#include "constraint_sim/engine/report.h"

namespace constraint_sim::engine {

const char* name(Method method) {
  constexpr std::array<const char*, kMethodCount> kMethodNames = {
      "auto",         "runge_kutta",  "energy_momentum", "sequential_impulses",
      "event_driven", "time_stepping"};
  return kMethodNames[static_cast<std::size_t>(method)];
}

const char* to_string(Failure failure) {
  switch (failure) {
    case Failure::kNone:
      break;
    case Failure::kNotFinite:
      return "a number was not finite, or beyond 1e20";
    case Failure::kOutOfRange:
      return "a body is beyond 1e20 m, m/s or rad/s";
    case Failure::kTooManyPairs:
      return "more than 1000000 pairs of bodies are near each other";
    case Failure::kTooManyContacts:
      return "bodies touch in more than 300000 points";
    case Failure::kNoNextTick:
      return "a tick is lost beside so long a time, or leads beyond 1e20 s";
    case Failure::kCustom:
      return "functions of a plugin failed";
  }
  return "";
}

const char* name(EventKind kind) {
  constexpr std::array kEventNames = {
      "broken",        "rope_taut", "rope_slack",  "limit_reached", "limit_left",
      "saturated",     "released",  "slips",       "sticks",        "contact_began",
      "contact_ended", "hit",       "handed_over", "taken_back"};
  static_assert(kEventNames.size() == kEventKindCount, "a name for each kind of event");
  return kEventNames[static_cast<std::size_t>(kind)];
}

const char* name(ContactState state) {
  constexpr std::array kContactStateNames = {"closed", "sticking", "slipping"};
  static_assert(kContactStateNames.size() == kContactStateCount, "a name for each state");
  return kContactStateNames[static_cast<std::size_t>(state)];
}

const char* name(Stage stage) {
  constexpr std::array<const char*, kStageCount> kStageNames = {
      "broadphase", "narrowphase", "integration", "rows", "velocities", "solve", "positions"};
  return kStageNames[static_cast<std::size_t>(stage)];
}

}  // namespace constraint_sim::engine
