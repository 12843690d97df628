#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/stop_flag.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Options of verify(): length of the run, thresholds, commands and callbacks.
struct VerifyOptions {
  std::uint64_t ticks = 0;      ///< ticks of the world to run
  double perturbation = 1e-10;  ///< motion of each body in the first tick of the twin [m] > 0
  double least = 1e-6;          ///< differences up to this one never exceed [m] ≥ 0
  double margin = 100.0;        ///< times estimate and growth that a difference may reach, ≥ 1
  StopFlag stop = nullptr;      ///< ends the runs early; nullptr: none
  /// Commands: called with each of the worlds before each tick of the verified one, at the same
  /// simulated time. Left out: none but those that the world has.
  std::function<void(World&)> before_tick = nullptr;
  /// Called after each tick with the ticks done.
  std::function<void(std::uint64_t)> progress = nullptr;
};

/// Figures of one body at one time. Distances are the larger of that of the centres of mass and the
/// angle between the orientations times the radius of gyration.
struct VerifiedFigures {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  double time = 0.0;         ///< simulated [s]
  double estimate = kNone;   ///< sum of the local error estimates [m]; NaN: no method has one
  double growth = 1.0;       ///< largest distance to the twin over its perturbation, ≥ 1 [1]
  double half_step = kNone;  ///< distance to the run with half the time step [m]; NaN: left out
  /// Distance to the run by the other method with half the time step [m]; NaN: left out.
  double other_method = kNone;
  /// Error of that run: its largest distance so far to the other method with the whole step [m].
  double other_error = kNone;

  /// The error at this time that the estimate stands for [m]; NaN: no method has an estimate.
  double global_error() const { return estimate * growth; }
};

/// Differences and error estimate of one dynamic body.
struct VerifiedBody {
  std::string name;
  VerifiedFigures figures;                  ///< at the end, or where `chaotic_from` says
  std::optional<VerifiedFigures> exceeded;  ///< where a difference first exceeded what is allowed
  /// From when on the twin is farther away than figures can say anything [s].
  std::optional<double> chaotic_from;
  bool is_unresolved = false;   ///< World::unresolved_bodies() of a step had it
  std::string no_estimate;      ///< why there is none; empty: there is one
  std::string no_half_step;     ///< why this comparison was left out; empty: it was not
  std::string no_other_method;  ///< the same of the other method

  /// `exceeds`, `chaotic` or `holds`.
  const char* verdict() const;
};

/// Result of verify().
struct VerifyReport {
  std::uint64_t ticks = 0;              ///< done by all runs
  double time_step = 0.0;               ///< of the verified run [s]
  double perturbation = 0.0;            ///< of the twin, as it was [m]
  Method method = Method::kAuto;        ///< that the options of the verified run ask for
  Method other_method = Method::kAuto;  ///< that those of the other run ask for
  std::vector<VerifiedBody> bodies;     ///< dynamic ones, in the order of adding
  std::vector<StepWarning> warnings;    ///< of the verified run, each once, at its largest amount
  bool stopped = false;                 ///< the stop flag was set
  std::string failure;                  ///< why the runs ended early; empty: they did not

  /// Whether a difference of any body exceeds what its estimate and growth allow.
  bool exceeds() const;
};

/// Runs copies of `world` for so many ticks: as it is; with half its time step; by another method
/// that shares no kernel with the first, with the whole and half the time step; and as a twin, each
/// body of which is pushed within the first tick so that it is `perturbation` away at its end.
/// Distances to the first run are compared after each tick with the sum of the local error
/// estimates times the growth of the perturbation, so that chaos is told apart from faults. `world`
/// stays as it is. Throws for options out of range, and what `before_tick` throws.
VerifyReport verify(const World& world, const VerifyOptions& options);

/// The report as a table for people, a line each body.
std::string to_table(const VerifyReport& report);

}  // namespace constraint_sim::engine
