#pragma once

#include <cstdint>

namespace constraint_sim::engine {

/// Identifies a body or joint of a World for the lifetime of that World. Values are issued in
/// ascending order and never reused, so an id survives edits of other bodies and joints.
template <class Tag>
struct Id {
  std::uint32_t value = 0;

  friend bool operator==(Id l, Id r) { return l.value == r.value; }
  friend bool operator!=(Id l, Id r) { return l.value != r.value; }
  friend bool operator<(Id l, Id r) { return l.value < r.value; }
};

using BodyId = Id<struct BodyTag>;
using JointId = Id<struct JointTag>;

/// The world itself as a body: static, at the origin, present in every World. Anchors on it are
/// in world coordinates.
inline constexpr BodyId kWorldBody{0};

}  // namespace constraint_sim::engine
