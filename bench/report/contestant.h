#pragma once

// Interface between a program of the report and an engine; each engine is one file of peers/.

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "problem.h"

namespace constraint_sim::report {

/// Thrown where the engine cannot express the problem in these coordinates or with this method.
struct Unsupported : std::runtime_error {
  using std::runtime_error::runtime_error;
};
/// Check of adapters that cannot couple coordinates.
inline void check_without_couplings(const Problem& problem) {
  if (!problem.couplings.empty()) throw Unsupported("gears, racks, screws and pulleys");
}
/// Check of adapters whose joints are bilateral, without force limits.
inline void check_without_laws(const Problem& problem) {
  for (const Joint& joint : problem.joints)
    if (joint.has_law()) throw Unsupported("limits, ropes, friction, breaking and limited motors");
}
/// Check of adapters without joints with axes and without couplings.
inline void check_without_axes(const Problem& problem) {
  check_without_couplings(problem);
  for (const Joint& joint : problem.joints)
    if (has_axes(joint.kind)) throw Unsupported(name(joint.kind));
}

/// Thrown where the engine could run the problem but rejects it; std::invalid_argument means that
/// too.
struct Refused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Setting that makes a run more exact and more expensive.
enum class Knob { kTick, kTolerance };

/// Way of using an engine. The name labels a curve of the report.
struct Variant {
  std::string name;
  bool has_joint_coordinates =
      false;  ///< false: each body has its own coordinates, and joints are rows
  Knob knob = Knob::kTick;
  std::vector<double> values{};  ///< tolerances, coarsest first; the report sets ticks
};

struct Setting {
  double tick = 0.01;      ///< [s]
  double tolerance = 0.0;  ///< engine-specific; 0: default of the engine
  bool is_swept = true;    ///< shown in diagrams, where only the knob is to matter
  bool is_heard = false;   ///< Simulation::said() is asked for; collecting it takes time
};

/// Errors that an engine itself reports, the largest since the start.
struct Said {
  std::string warning;       ///< first warning that a result is not trustworthy; empty: none
  double joint = 0.0;        ///< error of joints [m]
  double penetration = 0.0;  ///< [m]
  double motion = 0.0;       ///< sum of the estimates of the steps' errors [m]; NaN: unknown
};

/// One scene in one engine. Building the scene is not timed.
class Simulation {
 public:
  Simulation() = default;
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;
  virtual ~Simulation() = default;
  /// Takes `ticks` ticks, which end at `time` [s].
  virtual void advance(long ticks, double time) = 0;
  virtual void read(States* states) const = 0;
  /// Returns what the engine reports of its errors; nothing for engines that report none.
  virtual Said said() const { return {}; }
  /// Returns the scene as YAML of this package; empty for other engines.
  virtual std::string scene() const { return {}; }
};

/// Factory, defined by the one file of peers/ that a program is built with.
struct Contestant {
  static std::string name();
  static std::string version();
  static std::vector<Variant> variants();
  /// Builds a simulation; `problem` must outlive it. Throws Unsupported, Refused or
  /// std::invalid_argument.
  static std::unique_ptr<Simulation> make(const Problem& problem, const Variant& variant,
                                          const Setting& setting);
};

}  // namespace constraint_sim::report
