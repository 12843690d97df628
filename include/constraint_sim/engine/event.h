#pragma once

#include <optional>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// What happens at one moment within a step.
enum class EventKind {
  kBroken,        ///< a joint, or what couples one that broke
  kRopeTaut,      ///< the upper limit of a distance joint
  kRopeSlack,     ///< the same, no longer
  kLimitReached,  ///< of a coordinate, or the least length of a distance joint
  kLimitLeft,     ///< the same, no longer
  kSaturated,     ///< a motor at its force limit
  kReleased,      ///< the same, no longer
  kSlips,         ///< what friction held; of a contact or a coordinate
  kSticks,        ///< what slipped
  kContactBegan,  ///< also a bounce, which then ends at the same time
  kContactEnded,
  kHit,         ///< an impact in a contact that was there
  kHandedOver,  ///< an island's contacts, from events to impulses; as its step begins
  kTakenBack,   ///< the same, by events again
};

/// As in messages and logs: `broken`, `rope_taut`, `rope_slack`, `limit_reached`, `limit_left`,
/// `saturated`, `released`, `slips`, `sticks`, `contact_began`, `contact_ended`, `hit`,
/// `handed_over`, `taken_back`.
const char* name(EventKind kind);

/// One of these. Of a joint, of the contact of two bodies, or of an island.
struct Event {
  EventKind kind;
  double time;  ///< simulated [s]
  /// That touch, or that the joint connects; of an island its first two, and of a body alone that
  /// one twice.
  BodyId body_a, body_b;
  std::optional<JointId> joint{};  ///< whose it is; none of a contact or an island
  int coordinate = -1;             ///< of the joint; -1 of a distance joint, and of all else
  double impulse = 0.0;            ///< of the impact that it came with [N s or N m s] ≥ 0
};

}  // namespace constraint_sim::engine
