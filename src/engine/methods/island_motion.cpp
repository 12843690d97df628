#include "engine/methods/island_motion.h"

#include "engine/methods/fit_velocities.h"

namespace constraint_sim::engine {

IntegrationResult IslandMotion::advance(Integration way, const SmoothSpan& span,
                                        const IntegratorOptions& accuracy,
                                        std::vector<BodyState>* states) {
  EquationsOfMotion& equations = substeps_.equations();
  const bool goes_on = way == Integration::kGradients && gradients_ && gradients_->has_started();
  if (follows_gradients_ && !goes_on && !span.is_edited)
    fit_velocities(span, accuracy.most_projected, &equations, states);
  IntegrationResult result;
  switch (way) {
    case Integration::kSubsteps:
      result = substeps_.advance(span, accuracy, states);
      break;
    case Integration::kGradients:
      if (!gradients_) gradients_.emplace(equations);
      result = gradients_->advance(span, accuracy, &equations, states);
      break;
    case Integration::kInconsistent:
      if (!inconsistent_) inconsistent_.emplace(equations);
      change_way();
      result = inconsistent_->advance(span, &equations, states);
      break;
  }
  if (result.done) follows_gradients_ = way == Integration::kGradients;
  return result;
}

void IslandMotion::change_way() {
  substeps_.forget();
  if (gradients_) gradients_->forget();
}

void IslandMotion::forget() {
  change_way();
  follows_gradients_ = false;
}

void IslandMotion::restart() {
  follows_gradients_ = false;
  substeps_.restart();
  if (gradients_) gradients_->restart();
  inconsistent_.reset();
}

const LeastNormForces& IslandMotion::share_forces(const std::vector<BodyState>& states) {
  if (!least_forces_) least_forces_.emplace(equations());
  least_forces_->share(equations(), states);
  return *least_forces_;
}

}  // namespace constraint_sim::engine
