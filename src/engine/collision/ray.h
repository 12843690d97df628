#pragma once

#include <Eigen/Core>
#include <optional>

#include "constraint_sim/engine/body.h"

namespace constraint_sim::engine {

/// Part of a line in a convex solid: the solid holds origin + t·direction for enter < t < exit.
struct LinePart {
  double enter, exit;      ///< [m]; infinite where a plane's half-space has no end
  Eigen::Vector3d normal;  ///< outward unit normal of the surface at `enter`, world
};

/// Returns the part of a line in a convex shape, none where the line does not enter the inside. The
/// direction is unit.
std::optional<LinePart> line_part_in(const Shape& shape, const BodyState& pose,
                                     const Eigen::Vector3d& origin,
                                     const Eigen::Vector3d& direction);

}  // namespace constraint_sim::engine
