#pragma once

#include <optional>

#include "constraint_sim/engine/body.h"

namespace constraint_sim::engine {

/// Returns pose and twist of a shape in its body.
BodyState beside(const BodyState& body, const ShapePose& pose);

/// Returns the pose of a shape in its body; null where the shape lies at the body's pose. `part`:
/// number of the shape in a compound; 0 for a body of one shape.
inline const ShapePose* pose_in_body(const Body& body, int part) {
  if (const ShapePart* found = find_part(body.shape, part)) return &found->pose;
  return body.shape_pose ? &*body.shape_pose : nullptr;
}

/// A convex shape of a body with its pose: the pose of its body, or the shape's own pose in the
/// body. Refers to `body` and `state`.
class PlacedShape {
 public:
  /// `part`: as in pose_in_body().
  PlacedShape(const Body& body, int part, const BodyState& state)
      : shape_(&part_of(body.shape, part)), state_(&state) {
    const ShapePose* pose = pose_in_body(body, part);
    if (pose != nullptr) state_ = &beside_.emplace(beside(state, *pose));
  }
  PlacedShape(const PlacedShape&) = delete;
  PlacedShape& operator=(const PlacedShape&) = delete;

  const Shape& shape() const { return *shape_; }
  const BodyState& state() const { return *state_; }

 private:
  const Shape* shape_;
  const BodyState* state_;
  std::optional<BodyState> beside_;
};

}  // namespace constraint_sim::engine
