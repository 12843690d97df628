#pragma once

#include <Eigen/Core>
#include <optional>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Equations of the proximal steps of ProximalNewton. They have a motion, from which rates z and
/// impulses follow, with the cone K, the normal n and friction μ of each contact,
///   x = P_K(x_k − σ (z + s n)),  s = μ ‖z_t‖,
/// and a step is solved where the impulses x cause that motion. With the shift s held at its value
/// at the start of the step the solution is the minimum of a convex potential φ, whose gradient is
/// the motion less the one that x causes: Newton's method finds it, while s may converge slowly
/// from step to step.
class ProximalEquations {
 public:
  struct Merit {
    double square;     ///< square of the gradient of φ, as an energy
    double potential;  ///< φ; NaN where shifts are not held
  };

  virtual ~ProximalEquations() = default;
  /// Holds shifts from now on, or not; returns false where the equations cannot.
  virtual bool hold_shifts(bool is_held) = 0;
  /// Sets the motion that impulses p cause, x_k and s.
  virtual void begin(const List<double>& p) = 0;
  /// Keeps the motion as the start of a step, or returns to that start.
  virtual void keep_start() = 0;
  virtual void return_to_start() = 0;
  /// Sets x at the motion plus `share` of the change.
  virtual Merit evaluate(double sigma, double share) = 0;
  /// Takes the motion that was evaluated last.
  virtual void move() = 0;
  /// Sets the change of the motion by a step of Newton's method, from the motion evaluated last;
  /// returns false where its matrix is singular.
  virtual bool find_change(double sigma) = 0;
  /// Returns the derivative of φ along the change, before the next evaluation.
  virtual double slope() const = 0;
  /// ‖x − x_k‖².
  virtual double squared_distance() const = 0;
  /// Sets x_k = x, and s from the motion.
  virtual void take() = 0;
  /// Returns the residual of the impulses x, see BodyConeBlocks::residual().
  virtual double residual() = 0;
  /// Keeps the impulses whose residual was asked for last.
  virtual void keep() = 0;
  /// Sets p to the impulses that were kept.
  virtual void get(List<double>* p) const = 0;
};

/// Law of a block in a proximal step, with rows scaled by D.
struct ProximalBlock {
  bool is_contact;
  double friction;               ///< μ of a contact
  std::optional<double> shift;   ///< s where it is held
  double softness, least, most;  ///< law of a single row
};

/// Impulses of a block, their derivative by −z, and their part of φ, the maximum over x in K of −zᵀ
/// x − ½ S x² − ‖x − x_k‖²/(2σ).
struct ProximalImpulse {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();
  double potential = 0.0;
};

/// Returns the impulses of a block at rates z without softness; `with_slope`: also their
/// derivative.
ProximalImpulse proximal_impulse(const ProximalBlock& block, const Eigen::Vector3d& x_k,
                                 Eigen::Vector3d z, double sigma, bool with_slope);

}  // namespace constraint_sim::engine
