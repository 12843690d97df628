#include "engine/islands/island_motion.h"

#include "engine/dynamics/fit_velocities.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

IslandMotion::IslandMotion(const IslandMotion& other) = default;
IslandMotion::IslandMotion(IslandMotion&& other) noexcept = default;
IslandMotion& IslandMotion::operator=(const IslandMotion& other) = default;
IslandMotion& IslandMotion::operator=(IslandMotion&& other) noexcept = default;
IslandMotion::~IslandMotion() = default;

IntegrationResult IslandMotion::advance(Integration integration, const Interval& interval,
                                        const IntegratorOptions& options, List<BodyState>* states) {
  const EnergyMomentum* const energy_momentum = lent<EnergyMomentum>();
  const bool goes_on = integration == Integration::kEnergyMomentum && energy_momentum != nullptr &&
                       energy_momentum->has_started();
  if (follows_gradients_ && !goes_on && !interval.is_edited)
    fit_velocities(interval, options.most_projected, &substeps_.equations(), states);
  const IntegrationResult result = advance_by(integration, interval, options, states);
  if (result.done) follows_gradients_ = integration == Integration::kEnergyMomentum;
  return result;
}

IntegrationResult IslandMotion::advance_by(Integration integration, const Interval& interval,
                                           const IntegratorOptions& options,
                                           List<BodyState>* states) {
  if (integration == Integration::kRungeKutta) return substeps_.advance(interval, options, states);
  if (integration == Integration::kInconsistent) change_method();
  return borrowers_.advance(integration, interval, options, &substeps_.equations(), states);
}

bool IslandMotion::follow_laws(const List<Joint>& all_joints) {
  borrowers_ = {};
  least_forces_.reset();
  return events_ ? events_->follow_laws(all_joints, &substeps_) : substeps_.follow_laws(all_joints);
}

void IslandMotion::change_method() {
  substeps_.forget();
  if (events_) events_->forget();
  borrowers_.forget();
}

void IslandMotion::forget() {
  change_method();
  follows_gradients_ = false;
}

void IslandMotion::restart() {
  follows_gradients_ = false;
  if (events_) events_->restart(&substeps_);
  substeps_.restart();
  borrowers_.restart();
}

const LeastNormForces& IslandMotion::share_forces(const List<BodyState>& states) {
  if (!least_forces_) least_forces_.emplace(equations());
  least_forces_->share(equations(), states);
  return *least_forces_;
}

}  // namespace constraint_sim::engine
