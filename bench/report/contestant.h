#pragma once

// What a program of the report has to know of an engine: one file of peers/ each.

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "problem.h"

namespace constraint_sim::report {

/// The engine cannot express the problem in these coordinates or with this method: no result.
struct Unsupported : std::runtime_error {
  using std::runtime_error::runtime_error;
};
/// For adapters that couple no coordinates.
inline void check_without_couplings(const Problem& problem) {
  if (!problem.couplings.empty()) throw Unsupported("gears, racks, screws and pulleys");
}
/// For adapters whose joints act both ways, with any force.
inline void check_without_laws(const Problem& problem) {
  for (const Joint& joint : problem.joints)
    if (joint.has_law()) throw Unsupported("limits, ropes, friction, breaking and limited motors");
}
/// For adapters that build no joints with axes, nor what couples these.
inline void check_without_axes(const Problem& problem) {
  check_without_couplings(problem);
  for (const Joint& joint : problem.joints)
    if (has_axes(joint.kind)) throw Unsupported(name(joint.kind));
}

/// The engine can, and says that it will not; so does std::invalid_argument.
struct Refused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// What makes a run more exact and dearer.
enum class Knob { kTick, kTolerance };

/// One way to use an engine. Its name is that of a curve in the report.
struct Variant {
  std::string name;
  bool has_joint_coordinates = false;  ///< else all bodies have their own, and joints are rows
  Knob knob = Knob::kTick;
  std::vector<double> values{};  ///< of a tolerance, from the coarsest; ticks are the report's
};

struct Setting {
  double tick = 0.01;      ///< [s]
  double tolerance = 0.0;  ///< in the engine's own terms; 0: its default
  bool is_swept = true;    ///< in a diagram: what the knob does not set is made not to matter
};

/// One scene in one engine. Building it is not timed.
class Simulation {
 public:
  Simulation() = default;
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;
  virtual ~Simulation() = default;
  /// Takes so many ticks, which end at `time` [s].
  virtual void advance(long ticks, double time) = 0;
  virtual void read(States* states) const = 0;
  /// As YAML that this package loads; empty where the engine is another.
  virtual std::string scene() const { return {}; }
};

/// Defined by the one file of peers/ that a program is built with.
struct Contestant {
  static std::string name();
  static std::string version();
  static std::vector<Variant> variants();
  /// The problem outlives the simulation. Throws Unsupported, Refused or std::invalid_argument.
  static std::unique_ptr<Simulation> make(const Problem& problem, const Variant& variant,
                                          const Setting& setting);
};

}  // namespace constraint_sim::report
