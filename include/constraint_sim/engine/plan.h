#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// What a world uses, what it leaves out, and why, as YAML text.
std::string explain(const World& world);

/// What a world leaves out, and why: one line each, `what: why`.
std::vector<std::string> left_out(const World& world);

/// What a world has that may not be meant, one line each, beginning with whose it is: a dynamic
/// body whose inertia no distribution of mass has.
std::vector<std::string> warnings(const World& world);

/// A warning of the last step: an error that is not being closed, energy that rose without a cause,
/// fast bodies that hit more often than a step looks for, or contacts by impulses that overlap or
/// creep.
struct StepWarning {
  enum class Kind { kUnclosed, kEnergyRise, kHitsLeft, kOverlap, kCreep };
  Kind kind;
  std::string whose;    ///< a joint, or the first body of an island or group
  double amount = 0.0;  ///< |error| [m], the rise [J], how many hits there were, or an overlap or
                        ///< a distance [m]
};

/// Warnings of the last step: joints in the order of adding, then the island and
/// the group. None between an edit
/// and the next step.
std::vector<StepWarning> step_warnings(const World& world);

/// One line, beginning with whose it is.
std::string to_string(const StepWarning& warning);

/// How far a joint is open now, and how that closes, in words; empty where it fits.
std::string text_of_opening(const World& world, JointId id);

}  // namespace constraint_sim::engine
