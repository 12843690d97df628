#pragma once

#include <cstddef>
#include <optional>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// Kind of a discrete change within a step.
enum class EventKind {
  kBroken,  ///< a joint broke, or a gear or pulley lost a joint that broke
  /// A distance joint or a one-sided pulley reached its upper limit, or a spring began to pull.
  kRopeTaut,
  kRopeSlack,     ///< a joint of kRopeTaut left its upper limit or ceased to pull
  kLimitReached,  ///< a coordinate reached a limit, or a distance joint its lower limit
  kLimitLeft,     ///< a coordinate left a limit, or a distance joint its lower limit
  kSaturated,     ///< a motor reached its force limit
  kReleased,      ///< a motor left its force limit
  kSlips,         ///< friction no longer holds a contact or a coordinate
  kSticks,        ///< friction begins to hold a contact or a coordinate
  kContactBegan,  ///< contact began; a bounce ends at the same time
  kContactEnded,
  kHit,  ///< impact in an existing contact
  /// Contacts of an island change from event-driven to impulses, at the start of its step.
  kHandedOver,
  kTakenBack,  ///< contacts of an island change from impulses to event-driven
};

inline constexpr auto kEventKindCount = static_cast<std::size_t>(EventKind::kTakenBack) + 1;

/// Name as in messages and logs: `broken`, `rope_taut`, `rope_slack`, `limit_reached`,
/// `limit_left`, `saturated`, `released`, `slips`, `sticks`, `contact_began`, `contact_ended`,
/// `hit`, `handed_over`, `taken_back`.
const char* name(EventKind kind);

/// An event of a joint, of the contact of two bodies, or of an island.
struct Event {
  EventKind kind;
  double time;  ///< simulated time [s]
  /// Bodies in contact, or connected by the joint, or the first two bodies of the island. An island
  /// with a single body has that body in both.
  BodyId body_a, body_b;
  std::optional<JointId> joint{};  ///< joint of the event; none for contacts and islands
  /// Coordinate of the joint; -1 for a distance joint, a contact or an island.
  int coordinate = -1;
  double impulse = 0.0;  ///< impulse of an impact at the event [N s or N m s] ≥ 0
};

}  // namespace constraint_sim::engine
