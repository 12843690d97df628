#include "engine/islands/island_attempts.h"

#include <algorithm>
#include <utility>

#include "engine/islands/method_choice.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

// Largest loss by projection when substeps take over within a step, as a share of the kinetic
// energy.
constexpr double kMostProjected = 1e-9;
// Limit on attempted substeps of an island in an interval: kMostAttemptsOfAll over the number of
// awake bodies, within [kLeastAttempts, kMostAttempts]. A step of any number of bodies thus ends.
constexpr int kMostAttempts = 50000, kLeastAttempts = 100;
constexpr std::size_t kMostAttemptsOfAll = 300000;

/// Advances an island with joints by one method, and lets the island learn from the result.
IntegrationResult advance_joints(const IntegrationStep& in, std::size_t i, Integration integration,
                                 const Interval& interval, const IntegratorOptions& options) {
  IslandParts& parts = in.lists->island_parts[i];
  IslandMotion& motion = in.lists->motions[parts.motion];
  IntegrationResult progress = motion.advance(integration, interval, options, &in.state->states);
  switch (integration) {
    case Integration::kRungeKutta: {
      const double cost = progress.is_stiff ? gradient_cost(motion.is_simple(), parts) : 0.0;
      if (!learn_from_substeps(cost, in.state->step_count, in.model.options, &progress, &parts))
        break;
      parts.needs_method_choice = true;
      break;
    }
    case Integration::kEnergyMomentum: {
      const EnergyMomentum& method = *motion.lent<EnergyMomentum>();
      const int intervals = method.was_first() ? 2 : 1;
      learn_from_gradients(progress.iterations / intervals, method.frequency(), motion.is_simple(),
                           in.state->step_count, in.model.options, &parts);
      break;
    }
    case Integration::kInconsistent:
      if (!motion.lent<InconsistentMotion>()->can_be_met())
        learn_from_inconsistency(in.state->step_count, &parts);
      break;
  }
  return progress;
}

/// Switches the method of an island within a step.
void switch_method(IslandLists* lists, std::size_t i, Method method, MethodReason why) {
  ++lists->island_parts[i].changes;
  lists->islands[i].method = method;
  lists->islands[i].why = why;
  lists->motions[lists->island_parts[i].motion].change_method();
  lists->island_parts[i].needs_method_choice = true;
}

}  // namespace

bool add_result(IslandLists* lists, std::size_t i, const IntegrationResult& progress) {
  Island& island = lists->islands[i];
  island.local_error += progress.local_error;
  island.substeps += static_cast<std::uint32_t>(progress.substeps + progress.repeated);
  island.rejected += static_cast<std::uint32_t>(progress.rejected);
  island.evaluations += static_cast<std::uint32_t>(progress.evaluations);
  island.iterations += static_cast<std::uint32_t>(progress.iterations);
  lists->island_parts[i].found.time = progress.found;
  if (!progress.done && progress.found == 0.0) return false;
  lists->island_parts[i].projected_energy += progress.projected;
  lists->island_parts[i].correction_work += progress.corrected;
  return progress.done;
}

IntegratorOptions integrator_options(const IntegrationStep& in, double most_frequency) {
  ImplicitMode mode =
      in.model.options.stiff_order == 4 ? ImplicitMode::kOrder4 : ImplicitMode::kOrder2;
  if (in.model.options.dissipation) mode = ImplicitMode::kDissipate;
  IntegratorOptions options{in.model.options.order, in.model.options.tolerance, mode,
                            most_frequency};
  const std::size_t share = kMostAttemptsOfAll / std::max<std::size_t>(1, in.awake.bodies.size());
  options.most_attempts =
      static_cast<int>(std::clamp<std::size_t>(share, kLeastAttempts, kMostAttempts));
  options.most_work = in.model.options.event_work;
  return options;
}

bool integrate_joints(const IntegrationStep& in, std::size_t i, const Interval& interval) {
  IslandParts& parts = in.lists->island_parts[i];
  Island& island = in.lists->islands[i];
  if (island.method == Method::kEventDriven) {
    const EventDriven::Surroundings around{joint_step(in.model.options, interval.t, interval.h),
                                           in.state->joint_states, in.rollback.joint_states(),
                                           in.model.masses};
    return add_result(in.lists, i,
                      in.lists->motions[parts.motion].advance(
                          interval, integrator_options(in, kInfinity), around, &in.state->states));
  }
  bool is_met = island.why != MethodReason::kInconsistent;
  const auto by = [&](Integration integration, const IntegratorOptions& options) {
    const IntegrationResult progress = advance_joints(in, i, integration, interval, options);
    is_met = !progress.is_inconsistent;
    return add_result(in.lists, i, progress);
  };
  if (is_met && island.method == Method::kRungeKutta) {
    const bool chooses = in.model.options.method == Method::kAuto;
    const double limit =
        chooses ? stiffness_limit(in.model.options) / in.model.options.time_step : kInfinity;
    if (by(Integration::kRungeKutta, integrator_options(in, limit))) return true;
    const MethodReason why =
        chooses && parts.is_stiff ? MethodReason::kStiff : MethodReason::kRefused;
    if (is_met) switch_method(in.lists, i, Method::kEnergyMomentum, why);
  }
  // A jerk that no step of ordinary length gets across: substeps begin with velocities that fit the
  // joints, and the energy that this takes is bounded. Steps as short as needed take no such
  // velocities. Only where these fail, too, an unbounded energy is taken, and reported.
  const IntegratorOptions ordinary = integrator_options(in, kInfinity);
  IntegratorOptions substeps = ordinary, longer = ordinary;
  // tolerance 0 asks runge_kutta for one substep a step, and no method that it stands in for
  if (substeps.tolerance == 0.0 && in.model.options.method != Method::kRungeKutta)
    substeps.tolerance = WorldOptions{}.tolerance;
  IntegratorOptions bounded = substeps;
  bounded.most_projected = longer.most_projected = kMostProjected;
  longer.most_halvings *= 2;
  const MethodReason why = island.why;
  for (const auto& [integration, options] : {std::pair{Integration::kEnergyMomentum, ordinary},
                                             std::pair{Integration::kRungeKutta, bounded},
                                             std::pair{Integration::kEnergyMomentum, longer},
                                             std::pair{Integration::kRungeKutta, substeps}}) {
    if (!is_met) break;
    const Method method =
        integration == Integration::kRungeKutta ? Method::kRungeKutta : Method::kEnergyMomentum;
    if (method != island.method) switch_method(in.lists, i, method, why);
    if (by(integration, options)) return true;
  }
  // Soon after a contact, joints may be off by errors that impulses left. The island returns to
  // impulses then, which close these errors.
  if (is_met || in.state->step_count < parts.touched_until) return false;
  if (island.why != MethodReason::kInconsistent)
    switch_method(in.lists, i, Method::kEnergyMomentum, MethodReason::kInconsistent);
  return by(Integration::kInconsistent, ordinary);
}

}  // namespace constraint_sim::engine
