#pragma once

#include <array>

#include "engine/constraints/forms.h"
#include "engine/dynamics/implicit/joint_slopes.h"

namespace constraint_sim::engine {

/// Displacement of an end by which derivatives of custom code are taken: [rad], and as a share of
/// the length of d plus 1 m.
inline constexpr double kCustomDifference = 1e-6;

/// Row or coordinate of a joint in a step: J where forces are taken, with the slopes of λJ; value
/// at the end of the step (of an angle its change over the step), and gradient of the value. The
/// midpoint rule has J as the discrete gradient, whose product with the displacement is the
/// change of the value.
struct FormInStep {
  Jacobian J;
  double value = 0.0;
  std::array<JacobianSlopes, 2> slopes;  ///< without the factor `share`
  std::array<Gradient, 2> gradient{Gradient::Zero(), Gradient::Zero()};

  FormInStep(const ScalarForm& form, const JointInStep& joint, double lambda);

  /// Position at the end of the step of a coordinate that starts at `start`, with whole turns.
  double end_of(const ScalarForm& form, const JointInStep& joint, double start) const;

 private:
  void set_length(const RowForm& square, const JointInStep& joint, double lambda);
  void set_product(const RowForm& form, const JointInStep& joint, double lambda);
  void set_angle(const AngleForm& form, const JointInStep& joint, double lambda);
  void set_custom(const JointInStep& joint, double lambda);
};

}  // namespace constraint_sim::engine
