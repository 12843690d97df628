#include "engine/collision/placed_shape.h"

namespace constraint_sim::engine {

BodyState beside(const BodyState& body, const ShapePose& pose) {
  const Eigen::Vector3d arm = body.orientation * pose.position;
  return {body.position + arm, body.orientation * pose.orientation,
          body.linear_velocity + body.angular_velocity.cross(arm), body.angular_velocity};
}

}  // namespace constraint_sim::engine
