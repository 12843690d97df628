#pragma once

#include <string>
#include <vector>

#include "urdf/robot.h"

namespace constraint_sim {

/// Angle or length by which gravity may move a servo without a report [rad or m]. Users take a
/// robot that stays within it for one that holds its pose.
constexpr double kMostServoSag = 1e-3;

/// Returns a sentence for each servo of a robot in a world that the weight of the links behind it
/// turns or moves by more than kMostServoSag, with the stiffness that it would need. Statics at the
/// present pose; where links are in loops or geared, the effort of rigid motors in place of all
/// servos.
std::vector<std::string> sagging_servos(const Robot& robot, const engine::World& world);

}  // namespace constraint_sim
