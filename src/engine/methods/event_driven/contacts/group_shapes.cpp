#include "engine/methods/event_driven/contacts/group_shapes.h"

#include <algorithm>

#include "engine/collision/placed_shape.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

std::size_t GroupShapes::add(const Body& body, std::size_t place, int part) {
  const auto found = std::find_if(list_.begin(), list_.end(), [&](const GroupShape& shape) {
    return shape.body == place && shape.part == part;
  });
  if (found != list_.end()) return to_index(found - list_.begin());
  const ShapePose* pose = pose_in_body(body, part);
  list_.push_back({place, part, pose == nullptr ? std::nullopt : std::optional(*pose)});
  any_poses_ = any_poses_ || pose != nullptr;
  return list_.size() - 1;
}

void GroupShapes::place(const List<BodyState>& bodies) {
  if (!any_poses_) return;
  states_.resize(list_.size());
  for (std::size_t k = 0; k < list_.size(); ++k)
    if (list_[k].pose) states_[k] = beside(bodies[list_[k].body], *list_[k].pose);
}

// Features are in frames of shapes; arms and accelerations refer to centres of mass.
ContactMotion GroupShapes::motion(std::size_t shape_a, std::size_t shape_b,
                                  const ContactFeature& feature,
                                  const List<BodyState>& bodies) const {
  ContactMotion motion = motion_of(feature, state(shape_a, bodies), state(shape_b, bodies));
  if (!any_poses_) return motion;
  const auto move = [&](std::size_t shape, double sign, Vector3d* arm, Vector3d* w_bias) {
    if (!list_[shape].pose) return;
    const BodyState& body = bodies[list_[shape].body];
    const Vector3d offset = states_[shape].position - body.position;
    const Vector3d& w = body.angular_velocity;
    *arm += offset;
    *w_bias += sign * w.cross(w.cross(offset));
  };
  move(shape_a, 1.0, &motion.r_a, &motion.w_bias);
  move(shape_b, -1.0, &motion.r_b, &motion.w_bias);
  return motion;
}

bool GroupShapes::is_beside(std::size_t shape) const {
  const std::optional<ShapePose>& pose = list_[shape].pose;
  return pose && !pose->position.isZero(0.0);
}

double GroupShapes::farthest() const {
  double distance = 0.0;
  for (const GroupShape& shape : list_)
    if (shape.pose) distance = std::max(distance, shape.pose->position.norm());
  return distance;
}

}  // namespace constraint_sim::engine
