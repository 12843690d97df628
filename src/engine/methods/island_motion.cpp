#include "engine/methods/island_motion.h"

namespace constraint_sim::engine {

IntegrationResult IslandMotion::advance(Integration way, const SmoothSpan& span,
                                        const IntegratorOptions& accuracy,
                                        std::vector<BodyState>* states) {
  EquationsOfMotion& equations = substeps_.equations();
  switch (way) {
    case Integration::kSubsteps:
      return substeps_.advance(span, accuracy, states);
    case Integration::kGradients:
      if (!gradients_) gradients_.emplace(equations);
      return gradients_->advance(span, accuracy, &equations, states);
    case Integration::kInconsistent:
      if (!inconsistent_) inconsistent_.emplace(equations);
      forget();
      return inconsistent_->advance(span, &equations, states);
  }
  return {};
}

void IslandMotion::forget() {
  substeps_.forget();
  if (gradients_) gradients_->forget();
}

void IslandMotion::restart() {
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
