#pragma once

namespace constraint_sim::engine {

/// Integration rule of a step, with its coefficients in the equations of ImplicitStep.
enum class ImplicitRule {
  /// Midpoint rule. Keeps rods, energy and momentum to rounding at any step size, even where the
  /// motion is too fast to be resolved: Simo & Wong, IJNME 31 (1991) 19; Gonzalez, J. Nonlinear
  /// Sci. 6 (1996) 449; Betsch & Steinmann, IJNME 53 (2002) 1775.
  ///   s = h²/2,  p = h v₀,  a = ½ h ω₀,  b = ½ h L₀
  kMidpoint,
  /// Backward differences of order 2, which dissipate the energy of unresolved motion: Hairer &
  /// Wanner II, section V.1. Minus marks the previous step.
  ///   s = 4h²/9,  p = Δx₋/3 + (8 v₀ − 2 v₋) h/9,  a = w₋/3,  b = (8 L₀ − 2 L₋) h/9
  kBdf2,
};

/// Time of a step, and the coefficients of its rule that all equations share.
struct ImplicitTime {
  double t = 0.0, h = 0.0;  ///< start and length, of either sign [s]
  ImplicitRule rule = ImplicitRule::kMidpoint;
  double s = 0.0;      ///< factor of forces [s²]
  double share = 0.5;  ///< share of the step at which forces are taken

  ImplicitTime() = default;
  ImplicitTime(double start, double length, ImplicitRule by)
      : t(start),
        h(length),
        rule(by),
        s((is_midpoint() ? 0.5 : 4.0 / 9.0) * length * length),
        share(is_midpoint() ? 0.5 : 1.0) {}

  bool is_midpoint() const { return rule == ImplicitRule::kMidpoint; }
};

}  // namespace constraint_sim::engine
