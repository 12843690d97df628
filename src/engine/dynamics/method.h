#pragma once

#include <Eigen/Core>
#include <type_traits>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Time interval without jumps, and the loads and prescribed motions in it.
struct Interval {
  double t;  ///< start, simulated time [s]
  double h;  ///< length [s]
  const Eigen::Vector3d& gravity;
  const List<AppliedWrench>& loads;
  const List<PrescribedMotion>& prescribed;  ///< one per joint of the world
  bool is_disturbed;  ///< loads or motions may have jumped since the last interval
  bool is_edited;     ///< motions, positions or velocities may have jumped as well
  StopFlag stop = nullptr;
  /// Time since the start of the tick, at which kinematic bodies are given [s].
  double since_tick = 0.0;

  /// Returns a copy of this interval for an island that was edited since the last step.
  Interval after_edit() const {
    return {t, h, gravity, loads, prescribed, true, true, stop, since_tick};
  }
};

/// Integration rule of implicit steps.
enum class ImplicitMode {
  kOrder2,  ///< midpoint rule
  kOrder4,  ///< composition of midpoint steps; order 2 with dampers, which allow no negative steps
  kDissipate,  ///< BDF2
};

/// Settings of an integration, and limits beyond which it gives up.
struct IntegratorOptions {
  int order;         ///< 8 or 5, of explicit steps
  double tolerance;  ///< local error per second [m]; 0: one substep per interval
  ImplicitMode mode = ImplicitMode::kOrder4;
  /// Frequency of bodies under joint forces beyond which the island counts as stiff [rad/s].
  double most_frequency = kInfinity;
  /// Largest share of the kinetic energy that the start may remove.
  double most_projected = kInfinity;
  /// Substeps beyond which the method gives up, rejected substeps included.
  int most_attempts = 50000;
  /// Substeps and events of an interval beyond which event-driven integration gives up.
  double most_work = kInfinity;
  int most_halvings = 9;  ///< halvings of an interval by implicit steps
};

/// Interface of a class that advances bodies over an interval. `Lent`: types of the arguments that
/// the caller lends for the call, in this order. The function is
///   IntegrationResult advance(const Interval&, const IntegratorOptions&, Lent...,
///                             List<BodyState>* states);
/// `states` has all bodies of the world. The function changes the bodies of its island or group
/// alone and adds up the impulses of their joints. Without IntegrationResult::done, RungeKutta and
/// InconsistentMotion leave the bodies unchanged; other classes may have moved them.
///
/// `static_assert(IntervalMethod<Class, Lent...>::kIsHeld)` after a class names the function that
/// has another signature.
template <class Method, class... Lent>
struct IntervalMethod {
  static constexpr IntegrationResult (Method::*kAdvance)(const Interval&, const IntegratorOptions&,
                                                         Lent...,
                                                         List<BodyState>*) = &Method::advance;
  // Sanitizers take the address of a function for no constant, so it is not compared with nullptr.
  static constexpr bool kIsHeld = (static_cast<void>(kAdvance), true);
};

/// Interface of a method that advances one island with joints, interval after interval: the
/// function of IntervalMethod, and functions about the memory of the last interval:
///   bool has_started() const;  whether the next interval continues from the memory of the last one
///   void forget();             notes that something else moved the bodies
///   void restart();            returns to the state after construction, without freeing storage
template <class Method, class... Lent>
struct IslandMethod : IntervalMethod<Method, Lent...> {
  static constexpr bool (Method::*kHasStarted)() const = &Method::has_started;
  static constexpr void (Method::*kForget)() = &Method::forget;
  static constexpr void (Method::*kRestart)() = &Method::restart;
  static constexpr bool kIsHeld =
      (static_cast<void>(kHasStarted), static_cast<void>(kForget), static_cast<void>(kRestart),
       IntervalMethod<Method, Lent...>::kIsHeld&& std::is_copy_constructible_v<Method>&&
           std::is_nothrow_move_constructible_v<Method>);
};

}  // namespace constraint_sim::engine
