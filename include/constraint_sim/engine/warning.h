#pragma once

#include <cstddef>
#include <string>

#include "constraint_sim/engine/report.h"

namespace constraint_sim::engine {

/// A warning of the last step, which names a joint or a body; see World::warnings().
struct StepWarning {
  enum class Kind {
    kUnclosed,    ///< a joint has an error that is not being closed
    kEnergyRise,  ///< energy of an island rose without a cause
    kHitsLeft,    ///< hits of a fast body were left out
    kOverlap,     ///< contacts by impulses overlap
    kCreep,       ///< contacts by impulses creep while friction holds them
    kUnsolved,    ///< impulses of contacts were not solved
    kUnresolved,  ///< bodies move too fast for the time step
    kHandedOver,  ///< contacts change from event-driven to impulses
  };
  Kind kind;
  std::string name;    ///< name of the joint for kUnclosed, else of the first or worst body
  double value = 0.0;  ///< figure of the warning, with the unit of WarningInfo

  /// Remedy, as WarningInfo::advice.
  const char* advice() const;
};
inline constexpr std::size_t kWarningKindCount =
    static_cast<std::size_t>(StepWarning::Kind::kHandedOver) + 1;

/// Properties of a kind of warning.
struct WarningInfo {
  const char* name;    ///< name in Python, as `energy_rise`
  const char* unit;    ///< unit of StepWarning::value; empty for numbers of hits, bodies or islands
  const char* advice;  ///< remedy, in the imperative
  /// Whether the result is still trustworthy: a run with notices alone counts as good.
  bool is_notice;
  /// Whether the report of a step has a warning of this kind.
  bool (*is_in)(const StepReport& report);
};
const WarningInfo& info(StepWarning::Kind kind);

/// Describes the warning in one line without its advice, beginning with the name of its joint or
/// body.
std::string to_string(const StepWarning& warning);

/// Returns to_string(), a colon and the advice.
std::string with_advice(const StepWarning& warning);

}  // namespace constraint_sim::engine
