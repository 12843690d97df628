#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "engine/dynamics/kernel_view.h"
#include "engine/math/larger.h"

namespace constraint_sim::engine {

/// Kernel for a chain of rods between centres (is_chain()), the most common swinging shape. Bodies
/// and rods lie in chain order: nothing is looked up, A is tridiagonal, and one pass fills it.
/// Dependent rows are left to the equations. Valid for one interval: points into the equations.
class ChainOfRods : public EquationsKernel {
 public:
  explicit ChainOfRods(EquationsOfMotion& equations)
      : ChainOfRods(equations, equations.kernel_view()) {}

  void derivative(std::size_t stage, double t, const double* y, double* dydt) {
    if (equations_.inputs().is_time_dependent()) {
      equations_.move_with_time(t);
      find_falls();
    }
    const double* const target = acceleration_target_;
    const Vector3d* const falls = falls_;
    set_up(y, [=](std::size_t l, const Vector3d& d, const Vector3d& d_dot) {
      return target[l] - d.dot(falls[l]) - d_dot.squaredNorm();
    });
    if (factor_and_solve()) {
      write_rates(stage, y, dydt);
    } else {
      equations_.derivative(stage, t, y, dydt);
      depends_ = true;
    }
  }

  /// Projects by Newton steps with the factors of the last stage, as EquationsOfMotion does.
  bool project(double t, double* y) {
    if (depends_) return equations_.project(t, y);
    return equations_.project_by(
        t, y, [&] { return find_values(y); },
        [&] {
          tridiagonal_.solve(solution_);
          add_response(y);
        });
  }

  bool restart(double* y, double* dydt) {
    depends_ = false;
    const double* const rate = rate_target_;
    set_up(y, [=](std::size_t l, const Vector3d& d, const Vector3d& d_dot) {
      return rate[l] - d.dot(d_dot);
    });
    if (!factor_and_solve()) return equations_.restart(y, dydt);
    add_response(y + v_at_);
    for (std::size_t l = 0; l < rods_; ++l)
      impulses_[unknown_[l]] += solution_[l] * lengths_[l].value;

    const double* const target = acceleration_target_;
    Along v = velocities(y);
    for (std::size_t l = 0; l < rods_; ++l) {
      const double centripetal = v.step(l + 1 == rods_).squaredNorm();
      solution_[l] = target[l] - direction_[l].dot(falls_[l]) - centripetal;
    }
    tridiagonal_.solve(solution_);
    write_rates(0, y, dydt);
    return true;
  }

 private:
  ChainOfRods(EquationsOfMotion& equations, const KernelView& view)
      : EquationsKernel(equations),
        rods_(equations.links().size()),
        bodies_(equations.bodies().size()),
        v_at_(view.v_at),
        first_(equations.links().front().a),
        last_(equations.links().back().b),
        starts_with_body_(first_ < bodies_),
        ends_with_body_(last_ < bodies_),
        rows_(view.rows),
        unknown_(view.unknown),
        lengths_(view.lengths),
        position_(view.position),
        velocity_(view.velocity),
        free_(view.applied_acceleration),
        inverse_mass_(view.inverse_mass),
        direction_(view.rod_direction),
        solution_(view.solution),
        rate_target_(view.rate_target),
        acceleration_target_(view.acceleration_target),
        impulses_(view.impulses),
        stage_forces_(view.stage_forces),
        unknowns_(view.unknowns),
        tridiagonal_(*view.tridiagonal),
        falls_(view.falls) {
    find_falls();
  }

  using Vector3d = Eigen::Vector3d;
  using ConstVector = Eigen::Map<const Vector3d>;
  using Vector = Eigen::Map<Vector3d>;

  /// Cursor over vectors at the points of the chain, from one point to the next.
  class Along {
   public:
    /// Reads bodies from `of_bodies`, three numbers each, and other points from `of_points`.
    Along(const ChainOfRods& chain, const double* of_bodies, const Vector3d* of_points)
        : here_(chain.starts_with_body_ ? of_bodies : of_points[chain.first_].data()),
          next_(chain.starts_with_body_ ? of_bodies + 3 : of_bodies),
          last_(chain.ends_with_body_ ? of_bodies + 3 * chain.last_
                                      : of_points[chain.last_].data()) {}

    /// Moves to the next point. Returns the vector there minus the vector here.
    Vector3d step(bool is_last) {
      const double* const before = here_;
      here_ = is_last ? last_ : next_;
      next_ += 3;
      return ConstVector(here_) - ConstVector(before);
    }

   private:
    const double *here_, *next_, *last_;
  };

  Along positions(const double* y) const { return {*this, y, position_}; }
  Along velocities(const double* y) const { return {*this, y + v_at_, velocity_}; }
  // Computes the free acceleration of B minus A of each rod.
  void find_falls() {
    Along free{*this, free_->data(), free_};
    for (std::size_t l = 0; l < rods_; ++l) falls_[l] = free.step(l + 1 == rods_);
  }

  // Computes A, and the right-hand side from d and ḋ.
  template <class RightHandSide>
  void set_up(const double* y, const RightHandSide& right_hand_side) {
    Along x = positions(y);
    Along v = velocities(y);
    double* const diagonal = tridiagonal_.diagonal();
    double* const off_diagonal = tridiagonal_.off_diagonal();
    for (std::size_t l = 0; l < rods_; ++l) {
      const bool is_last = l + 1 == rods_;
      const Vector3d d = x.step(is_last);
      direction_[l] = d;
      diagonal[l] = rows_[l].inverse_mass * d.squaredNorm();
      solution_[l] = right_hand_side(l, d, v.step(is_last));
    }
    const double* const inverse_mass = inverse_mass_ + (starts_with_body_ ? 1 : 0);
    for (std::size_t l = 0; l + 1 < rods_; ++l)
      off_diagonal[l] = -inverse_mass[l] * direction_[l].dot(direction_[l + 1]);
  }

  bool factor_and_solve() {
    return tridiagonal_.factor_and_solve(DelassusMatrix::kLeastPivot, solution_);
  }

  // Writes −C to solution_, and d. Returns the largest error of a rod [m].
  double find_values(const double* y) {
    Along x = positions(y);
    double worst = 0.0;
    for (std::size_t l = 0; l < rods_; ++l) {
      const Vector3d d = direction_[l] = x.step(l + 1 == rods_);
      const double length = lengths_[l].value;
      solution_[l] = 0.5 * (length * length - d.squaredNorm());
      worst = larger(worst, std::abs(solution_[l] / length));
    }
    return worst;
  }

  // Adds M⁻¹ Gᵀ of the solution to the three numbers of each body.
  void add_response(double* of_bodies) const {
    visit_forces([&](std::size_t i, const Vector3d& force) {
      Vector(of_bodies + 3 * i) += inverse_mass_[i] * force;
    });
  }

  // Inlined like the elimination: the calls take a tenth of a pendulum's step.
  [[gnu::always_inline]] void write_rates(std::size_t stage, const double* y, double* dydt) {
    const double* const v = y + v_at_;
    double* const v_dot = dydt + v_at_;
    visit_forces([&](std::size_t i, const Vector3d& force) {
      Vector(dydt + 3 * i) = ConstVector(v + 3 * i);
      Vector(v_dot + 3 * i) = free_[i] + inverse_mass_[i] * force;
    });
    double* const forces = stage_forces_ + stage * unknowns_;
    for (std::size_t l = 0; l < rods_; ++l) forces[unknown_[l]] = solution_[l] * lengths_[l].value;
  }

  // Calls take(i, force) for each body i, with the force Gᵀ of the solution on it.
  template <class Take>
  void visit_forces(const Take& take) const {
    std::size_t i = 0;
    Vector3d before = Vector3d::Zero();
    for (std::size_t l = 0; l < rods_; ++l) {
      const Vector3d force = solution_[l] * direction_[l];
      if (l > 0 || starts_with_body_) take(i++, before - force);
      before = force;
    }
    if (ends_with_body_) take(i, before);
  }

  std::size_t rods_, bodies_;
  std::size_t v_at_;          // offset of v in a state
  std::size_t first_, last_;  // points at the ends of the chain
  bool starts_with_body_, ends_with_body_;
  const IslandModel::Row* rows_;
  const std::size_t* unknown_;  // per row
  const Prescribed* lengths_;
  const Vector3d *position_, *velocity_, *free_;  // per point; free_: acceleration without the rods
  const double* inverse_mass_;                    // per point
  Vector3d* direction_;                           // d per rod
  double* solution_;                              // per rod
  const double *rate_target_, *acceleration_target_;
  double *impulses_, *stage_forces_;  // by unknown
  std::size_t unknowns_;
  TridiagonalLdlt& tridiagonal_;
  Vector3d* falls_;       // per rod: free acceleration of B minus A
  bool depends_ = false;  // whether rows depended on others since the last restart
};

}  // namespace constraint_sim::engine
