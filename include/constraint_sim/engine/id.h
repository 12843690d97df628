#pragma once

#include <cstdint>

namespace constraint_sim::engine {

/// Names one body or joint of a World for as long as that World lives. Values are handed out in
/// order and never again, so an id outlives edits of everything else and never means a newcomer.
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
