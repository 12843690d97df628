#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Describes the methods, bodies and features that a world uses, those it leaves out, and why, as
/// YAML text.
std::string explain(const World& world);

/// Lists the features that a world leaves out, one line each, `feature: why`.
std::vector<std::string> left_out(const World& world);

/// Lists settings of a world that may be mistakes, one line each, beginning with the name of the
/// body: a dynamic body whose inertia no distribution of mass has.
std::vector<std::string> warnings(const World& world);

/// A warning of the last step: an error that does not close, energy that rose without a cause, fast
/// bodies with too many hits, or contacts by impulses that overlap or creep.
struct StepWarning {
  enum class Kind { kUnclosed, kEnergyRise, kHitsLeft, kOverlap, kCreep, kUnsolved };
  Kind kind;
  std::string whose;    ///< name of a joint, or of the first body of an island or group
  double amount = 0.0;  ///< |error| [m], energy rise [J], number of hits, overlap or distance [m]
};

/// Lists warnings of the last step: joints in the order of adding, then island and group. Empty
/// between an edit and the next step.
std::vector<StepWarning> step_warnings(const World& world);

/// Describes the warning in one line, beginning with the name of its joint or body.
std::string to_string(const StepWarning& warning);

/// Describes the present error of a joint and how it closes, in words; empty where the joint fits.
std::string text_of_opening(const World& world, JointId id);

}  // namespace constraint_sim::engine
