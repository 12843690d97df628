#include <array>
#include <cmath>
#include <cstdio>

#include "constraint_sim/engine/warning.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

// In the order of StepWarning::Kind.
constexpr std::array<WarningInfo, kWarningKindCount> kWarningInfos = {{
    {"unclosed", "m",
     "remove constraints that contradict each other, or take a shorter time_step or more "
     "iterations",
     false, [](const StepReport& report) { return report.joints.unclosed > 0; }},
    {"energy_rise", "J", "take a shorter time_step or a smaller tolerance", false,
     [](const StepReport& report) { return report.energy.rise_body.has_value(); }},
    {"hits_left", "", "take a shorter time_step", false,
     [](const StepReport& report) { return report.contacts.hits_left_body.has_value(); }},
    {"overlap", "m", "move the shapes apart, or take a shorter time_step or more iterations", false,
     [](const StepReport& report) { return report.contacts.overlap_body.has_value(); }},
    {"creep", "m", "take a shorter time_step or more iterations", false,
     [](const StepReport& report) { return report.contacts.creep_body.has_value(); }},
    {"unsolved", "m/s", "take a shorter time_step or smaller ratios of masses", false,
     [](const StepReport& report) { return report.contacts.unsolved_body.has_value(); }},
    {"unresolved", "", "take a shorter time_step", true,
     [](const StepReport& report) { return report.unresolved_bodies > 0; }},
    {"handed_over", "",
     "take a shorter time_step; a larger event_work where contacts were given up", true,
     [](const StepReport& report) { return report.contacts.handed_over_body.has_value(); }},
}};

/// Returns ", and of N more THINGS", of which `thing` is one; empty where the value counts one.
std::string and_others(double value, const std::string& thing, const std::string& things) {
  if (value < 2.0) return {};
  const long others = std::lround(value) - 1;
  return ", and of " + std::to_string(others) + " more " + (others == 1 ? thing : things);
}

}  // namespace

const WarningInfo& info(StepWarning::Kind kind) {
  return kWarningInfos[static_cast<std::size_t>(kind)];
}

const char* StepWarning::advice() const { return info(kind).advice; }

std::string to_string(const StepWarning& warning) {
  using Kind = StepWarning::Kind;
  char value[32];
  std::snprintf(value, sizeof value, "%.3g", warning.value);
  const std::string body = "body " + in_quotes(warning.name) + ": ";
  switch (warning.kind) {
    case Kind::kUnclosed:
      return "constraint " + in_quotes(warning.name) + ": its error of " + value +
             " m is not being closed";
    case Kind::kEnergyRise:
      return body + "energy of its island rose by " + value + " J without a cause";
    case Kind::kHitsLeft:
      if (warning.value < kMostHits)
        return body +
               "it, or a body in contact with it, may pass through another body within a step";
      return body + "it and what it hits met " + value +
             " times in a step, and may pass through each other";
    case Kind::kOverlap:
      return body + "it and what it touches overlap by " + value +
             " m, which impulses do not push out";
    case Kind::kCreep:
      return body + "it has crept by " + value +
             " m where friction holds it, since impulses are not solved to the end";
    case Kind::kUnsolved:
      return body + "impulses on it and on what it touches were not solved, to a residual of " +
             value + " m/s";
    case Kind::kUnresolved:
      return body + "the time step is too long to show the motion of it" +
             and_others(warning.value, "body", "bodies");
    case Kind::kHandedOver:
      return body + "contacts of it and what it touches go from event_driven to time_stepping" +
             and_others(warning.value, "island", "islands");
  }
  return {};
}

std::string with_advice(const StepWarning& warning) {
  return to_string(warning) + ": " + warning.advice();
}

}  // namespace constraint_sim::engine
