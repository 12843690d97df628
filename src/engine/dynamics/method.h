#pragma once

#include <type_traits>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/integrator_options.h"
#include "engine/dynamics/interval.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

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
