#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/stop_flag.h"
#include "constraint_sim/engine/warning.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Options of verify(): length of the run, thresholds, commands and callbacks.
struct VerifyOptions {
  std::uint64_t ticks = 0;      ///< number of ticks to run
  double perturbation = 1e-10;  ///< motion of each body in the first tick of the twin [m] > 0
  double least = 1e-6;          ///< difference below which no body exceeds [m] ≥ 0
  double margin = 100.0;    ///< factor on estimate times growth that a difference may reach, ≥ 1
  StopFlag stop = nullptr;  ///< ends the runs early; nullptr: none
  /// Called with each world before each tick of the verified one, at equal simulated times, to give
  /// commands. Left out: no commands but those in the world.
  std::function<void(World&)> before_tick = nullptr;
  /// Called after each tick with the number of ticks done.
  std::function<void(std::uint64_t)> progress = nullptr;
};

/// Figures of a body at a time. A distance is the larger of the distance of the centres of mass,
/// and the angle between the orientations times the radius of gyration.
struct VerifiedFigures {
  static constexpr double kLeftOut = std::numeric_limits<double>::quiet_NaN();

  double time = 0.0;            ///< simulated time [s]
  double estimate = kLeftOut;   ///< sum of the local error estimates [m]; NaN: the method has none
  double growth = 1.0;          ///< largest distance to the twin over its perturbation, ≥ 1 [1]
  double half_step = kLeftOut;  ///< distance to the run with half the time step [m]; NaN: left out
  /// Distance to the run by the other method with half the time step and 1/16 of the tolerance [m];
  /// NaN: left out.
  double other_method = kLeftOut;
  /// Error of the other method: its largest distance so far between whole and half time step [m].
  double other_error = kLeftOut;

  /// Estimated global error at this time [m]; NaN: the method has no estimate.
  double global_error() const { return estimate * growth; }
};

/// Differences and error estimate of one dynamic body.
struct VerifiedBody {
  std::string name;
  VerifiedFigures figures;                  ///< figures at the end, or at `chaotic_from`
  std::optional<VerifiedFigures> exceeded;  ///< figures where a difference first exceeded its bound
  /// Time from which the twin is too far away for a comparison [s].
  std::optional<double> chaotic_from;
  bool is_unresolved = false;  ///< whether World::unresolved_bodies() of a step listed the body
  std::string no_estimate;     ///< reason for a missing estimate; empty: there is an estimate
  /// Reason for leaving out the run with half the time step; empty: it was run.
  std::string no_half_step;
  /// Reason for leaving out the run by the other method; empty: it was run.
  std::string no_other_method;

  /// Returns `exceeds`, `chaotic` or `holds`.
  const char* verdict() const;
};

/// Result of verify().
struct VerifyReport {
  std::uint64_t ticks = 0;              ///< ticks done by all runs
  double time_step = 0.0;               ///< time step of the verified run [s]
  double perturbation = 0.0;            ///< actual perturbation of the twin [m]
  Method method = Method::kAuto;        ///< method in the options of the verified run
  Method other_method = Method::kAuto;  ///< method in the options of the other run
  std::vector<VerifiedBody> bodies;     ///< dynamic bodies, in the order of adding
  /// Warnings of the verified run without notices, each once, at its largest value.
  std::vector<StepWarning> warnings;
  bool stopped = false;  ///< the stop flag was set
  std::string failure;   ///< reason for an early end; empty: none

  /// Whether a difference of any body exceeds the bound from its estimate and growth.
  bool exceeds() const;
};

/// Runs copies of `world` for `options.ticks` ticks: as it is; with half its time step; by another
/// method that shares no kernel with the first, with the whole and half the time step; and as a
/// twin, each body of which is displaced by `perturbation` in the first tick. After each tick,
/// distances to the first run are compared with the sum of the local error estimates times the
/// growth of the perturbation, which tells chaos from faults. `world` does not change. Throws for
/// options out of range, and whatever `before_tick` throws.
VerifyReport verify(const World& world, const VerifyOptions& options);

/// Formats the report as a table for people, a line for each body.
std::string to_table(const VerifyReport& report);

}  // namespace constraint_sim::engine
