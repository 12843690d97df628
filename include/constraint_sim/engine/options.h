#pragma once

#include <Eigen/Core>
#include <limits>
#include <string>

#include "constraint_sim/engine/report.h"

namespace constraint_sim::engine {

/// Options of a world with their defaults; visit_options() describes each option.
struct WorldOptions {
  Eigen::Vector3d gravity{0.0, 0.0, -9.81};
  double time_step = 0.01;
  Method method = Method::kAuto;
  int order = 8;
  double tolerance = 1e-8;
  int stiff_order = 4;
  bool dissipation = false;
  double stiffness_limit = 40.0;
  int iterations = 10;
  bool warm_starting = true;
  double contact_tolerance = 0.0;
  double event_work = 2e4;
  double baumgarte = 0.1;
  double closing_time = 0.5;
  double sleep_after = 0.5;
  double sleep_speed = 1e-8;
  int threads = 1;
};

/// Description of an option for users. The name is the key in scenes and the keyword in Python.
struct OptionInfo {
  const char* name;
  const char* unit;     ///< SI unit; empty: a pure number, a word or a truth value
  Method read_by;       ///< the only method that reads the option; kAuto: any
  const char* meaning;  ///< one sentence without its full stop, as in docs/scenes.md
};

// Ranges of options, one type each.
struct AnyValue {};            ///< any finite value of the type
struct PositiveOrInfinity {};  ///< > 0 or infinity
struct NotNegative {};         ///< finite, ≥ 0
struct Positive {              ///< finite, > 0, from `least` to `most`
  double least = 0.0, most = std::numeric_limits<double>::infinity();
};
struct Share {};  ///< 0 to 1
struct Count {    ///< 1 to `most`
  int most;
};
struct EitherOf {
  int first, second;
};

/// The single list of options: calls visit(OptionInfo, member of `options`, range) for each, in the
/// order of saved scenes. `Options` is WorldOptions, const or not. Parsing, saving, checking,
/// hashing, the plan, the runner's command line and Python's keywords go through this list;
/// test/engine/test_options.cpp compares it with the manual and with WorldOptions.
template <class Options, class Visit>
void visit_options(Options& options, Visit visit) {
  constexpr Method kAny = Method::kAuto;
  visit(OptionInfo{"gravity", "m/s²", kAny, "acceleration, world axes"}, options.gravity,
        AnyValue{});
  visit(OptionInfo{"time_step", "s", kAny, "one tick"}, options.time_step, Positive{1e-12, 1e6});
  visit(OptionInfo{"method", "", kAny, "of all islands; auto: chosen for each"}, options.method,
        AnyValue{});
  visit(OptionInfo{"order", "", Method::kRungeKutta, "order of the pair"}, options.order,
        EitherOf{8, 5});
  visit(OptionInfo{"tolerance", "m/s", Method::kRungeKutta,
                   "local error per simulated second that substeps are refined to, rotation times "
                   "radius of gyration; 0: one substep a tick"},
        options.tolerance, NotNegative{});
  visit(OptionInfo{"stiff_order", "", Method::kEnergyMomentum, "order of the method"},
        options.stiff_order, EitherOf{4, 2});
  visit(OptionInfo{"dissipation", "", Method::kEnergyMomentum,
                   "takes the energy out of motions that are too fast for the tick; of order 2, "
                   "whatever stiff_order is"},
        options.dissipation, AnyValue{});
  visit(OptionInfo{"stiffness_limit", "", Method::kEnergyMomentum,
                   "h·ω of bodies beyond which auto takes this method, if substeps cost more; "
                   ".inf: never"},
        options.stiffness_limit, PositiveOrInfinity{});
  visit(OptionInfo{"iterations", "", kAny,
                   "sweeps of sequential_impulses, and over groups of more than 500 bodies"},
        options.iterations, Count{10000});
  visit(OptionInfo{"warm_starting", "", kAny, "impulses start from those of the step before"},
        options.warm_starting, AnyValue{});
  visit(OptionInfo{"contact_tolerance", "m/s", Method::kTimeStepping,
                   "estimated error per simulated second that steps of contacts are divided to, "
                   "rotation times radius of gyration; 0: one step a tick"},
        options.contact_tolerance, NotNegative{});
  visit(
      OptionInfo{
          "event_work", "", Method::kEventDriven,
          "most substeps and events of an island in a tick, contacts by their cost; beyond it "
          "impulses take over, and of all groups of auto beyond 7.5 %; .inf: never"},
      options.event_work, PositiveOrInfinity{});
  visit(OptionInfo{"baumgarte", "", kAny, "share of each error that impulses remove in a step"},
        options.baumgarte, Share{});
  visit(OptionInfo{"closing_time", "s", kAny,
                   "in which the error of a constraint that does not fit when added, or when its "
                   "body is set, is closed; sequential_impulses removes baumgarte of it per step "
                   "instead"},
        options.closing_time, Positive{});
  visit(OptionInfo{"sleep_after", "s", kAny,
                   "an island that stood still for so long is left out until something touches "
                   "it; .inf: never"},
        options.sleep_after, PositiveOrInfinity{});
  visit(OptionInfo{"sleep_speed", "m/s", kAny,
                   "up to which bodies held by contacts, limits or limited motors stand still, "
                   "rotation times radius of gyration; islands that are integrated have to stand "
                   "still to the bit"},
        options.sleep_speed, NotNegative{});
  visit(OptionInfo{"threads", "", kAny,
                   "that advance smooth and stiff islands at the same time, with the same result "
                   "to the bit; fewer where the system has no more"},
        options.threads, Count{256});
}

/// Throws std::invalid_argument naming the invalid option and its value.
void validate(const WorldOptions& options);

/// Sets the option of this name from a text in the syntax of scenes: a number, `.inf`, `true`, a
/// word or `[0, 0, -9.81]`. Throws std::invalid_argument for an unknown name and for a text of
/// another type; validate() checks the range.
void set_option(const std::string& name, const std::string& text, WorldOptions* options);

}  // namespace constraint_sim::engine
