#pragma once

#include <cstddef>
#include <optional>

#include "constraint_sim/engine/body.h"
#include "engine/collision/contact_feature.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Convex shape of a body of a contact group.
struct GroupShape {
  std::size_t body;               ///< index in GroupBodies::list()
  int part;                       ///< number of the shape in its body
  std::optional<ShapePose> pose;  ///< none: at the pose of the body
};

/// Keeps the shapes of a contact group that may touch another, and places them by their bodies.
class GroupShapes {
 public:
  void clear() {
    list_.clear();
    any_poses_ = false;
  }
  /// Returns the index of a part of a body, which is added where it is missing; `place`: index of
  /// the body in GroupBodies::list().
  std::size_t add(const Body& body, std::size_t place, int part);
  const List<GroupShape>& list() const { return list_; }
  const GroupShape& operator[](std::size_t shape) const { return list_[shape]; }

  /// Places the shapes by the states of the bodies of the group.
  void place(const List<BodyState>& bodies);
  /// State of a shape, from which contact features are computed.
  const BodyState& state(std::size_t shape, const List<BodyState>& bodies) const {
    return list_[shape].pose ? states_[shape] : bodies[list_[shape].body];
  }
  /// Relative motion at a feature of two shapes, the first of body A, the second of body B.
  ContactMotion motion(std::size_t shape_a, std::size_t shape_b, const ContactFeature& feature,
                       const List<BodyState>& bodies) const;

  /// Whether the centre of a shape is off the centre of mass of its body.
  bool is_beside(std::size_t shape) const;
  /// Largest distance of the centre of a shape from the centre of mass of its body [m].
  double farthest() const;

 private:
  List<GroupShape> list_;
  bool any_poses_ = false;  // whether any shape has a pose
  List<BodyState> states_;  // per shape, set where the shape has a pose
};

}  // namespace constraint_sim::engine
