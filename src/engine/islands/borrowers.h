#pragma once

#include <cstddef>
#include <optional>
#include <tuple>
#include <type_traits>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/energy_momentum/energy_momentum.h"
#include "engine/methods/least_squares/inconsistent_motion.h"

namespace constraint_sim::engine {

/// A method that advances an island with joints over an interval.
enum class Integration {
  kRungeKutta,
  kEnergyMomentum,
  kInconsistent,  ///< energy_momentum where the joints cannot all be met
};
inline constexpr std::size_t kIntegrationCount = 3;

/// A method that borrows the equations of an island; constructed when it is first used.
template <Integration integration, class Class>
struct Borrower {
  using Method = Class;
  static_assert(IslandMethod<Method, EquationsOfMotion*>::kIsHeld);
  static constexpr Integration kIntegration = integration;
  std::optional<Method> method;
};

/// All methods of one island that borrow its equations. RungeKutta owns the equations.
class Borrowers {
 public:
  /// A method, or nullptr where it is not constructed.
  template <class Method>
  const Method* find() const {
    const Method* found = nullptr;
    for_each_line([&](const auto& line) {
      if constexpr (std::is_same_v<decltype(line.method), std::optional<Method>>)
        if (line.method) found = &*line.method;
    });
    return found;
  }
  /// Advances the island as IslandMethod describes, by any method but kRungeKutta.
  IntegrationResult advance(Integration integration, const Interval& interval,
                            const IntegratorOptions& options, EquationsOfMotion* equations,
                            List<BodyState>* states);
  /// Whether any method is constructed.
  bool any() const {
    bool is_any = false;
    for_each_line([&](const auto& line) { is_any = is_any || line.method; });
    return is_any;
  }
  /// Whether a method continues in the next interval.
  bool have_started() const;
  void forget();
  void restart();

  /// Visits the memory of methods that have it between steps (engine/support/memory.h).
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit, const EquationsOfMotion& equations) {
    auto& energy_momentum = std::get<0>(self.lines_).method;
    bool has_memory = energy_momentum && energy_momentum->has_memory();
    visit.beside(has_memory);
    if constexpr (Visit::kReads)
      if (has_memory) energy_momentum.emplace(equations);
    if (has_memory) EnergyMomentum::visit_memory(*energy_momentum, visit);
  }

 private:
  /// A line for each method.
  using Lines = std::tuple<Borrower<Integration::kEnergyMomentum, EnergyMomentum>,
                           Borrower<Integration::kInconsistent, InconsistentMotion>>;
  static_assert(std::tuple_size_v<Lines> + 1 == kIntegrationCount);

  template <class Act>
  void for_each_line(const Act& act) const {
    std::apply([&](const auto&... line) { (act(line), ...); }, lines_);
  }
  template <class Act>
  void for_each_line(const Act& act) {
    std::apply([&](auto&... line) { (act(line), ...); }, lines_);
  }

  Lines lines_;
};

}  // namespace constraint_sim::engine
