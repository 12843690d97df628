#pragma once

#include <cstddef>

#include "engine/constraints/row.h"
#include "engine/impulses/row_system.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Largest s in [0, 1] with quadratic s² + linear s ≤ most, for quadratic > 0 and most ≥ 0.
double largest_scale(double quadratic, double linear, double most);

/// Energy that the impulses of a step add to each component. With v₀ and v₁ the velocities at the
/// start of the step and after the solve, Δv = v₁ − v₀ and ζ the rates of motors, a step adds to
/// kinetic energy and that of gravity, beyond the work of wrenches, motors and kinematic bodies:
/// Σ pᵢ (Jᵢ v₁ − ζᵢ) − ½ Δvᵀ M Δv. Where unconverged sweeps or simultaneous bounces make the sum
/// positive, impulses are scaled down until it is zero.
class EnergyAccount {
 public:
  /// Begins a step.
  void begin(const List<int>& moved, const List<Row>& rows, const RowSystem& system);

  // ---- measurement: begin_sums(), add() for each row, finish_sums()
  void begin_sums(const List<int>& moved);
  /// Adds the work of row i, whose rate is `J_V`. Adds the work of motors and kinematic bodies to
  /// `driven_work` [J].
  void add(const Row& row, std::size_t i, double J_V, const RowSystem& system, double* driven_work);
  void finish_sums(const List<int>& moved, RowSystem* system);

  /// Scales the impulses of components that would gain energy. Returns whether there were any.
  bool limit(const List<int>& moved, RowSystem* system, List<Row>* rows);
  /// Makes bounces of components that gained energy by them lower, in proportion to the gain and in
  /// the end to 0. Returns whether there are any, which are to be solved again.
  bool lower_bounces(const List<int>& moved, bool to_zero, const RowSystem& system,
                     List<Row>* rows);
  /// Allows a component a gain by v₁ that positions give back [J].
  void allow(int component, double gain) { entries_[component].allowed = gain; }
  /// Energy beyond the work from outside that a component gained when it was last measured [J].
  double gain(int component) const {
    return entries_[component].work - entries_[component].absorbed;
  }

  // ---- springs
  bool has_springs() const { return any_springs_; }
  bool has_springs(int component) const { return entries_[component].has_springs; }
  /// Takes the value C of the spring of row i after the step.
  void finish_spring(const Row& row, std::size_t i, double C, const RowSystem& system);
  /// Work of corrections against the springs of rows that are finished [J].
  double spring_work() const { return spring_work_; }

 private:
  struct Entry {
    double work = 0.0;      // Σ pᵢ (Jᵢ v − ζᵢ)
    double absorbed = 0.0;  // ½ Δvᵀ M Δv
    double allowed = 0.0;   // gain beyond `absorbed` that positions give back
    bool has_springs = false;
    bool gains = false;
    double linear = 0.0, quadratic = 0.0, free = 0.0, scale = 1.0;
  };
  /// Rates of a spring relative to its motor: by v, and by corrections.
  struct SpringRates {
    double by_v = 0.0, by_corrections = 0.0;
  };

  bool mark_gains(const List<int>& moved, const RowSystem& system);
  void add_spring(const Row& row, std::size_t i, double rate, const RowSystem& system);

  List<Entry> entries_;             // per body; used at the body of a component
  List<SpringRates> spring_rates_;  // per row; set for springs
  double spring_work_ = 0.0;
  bool any_springs_ = false;
};

}  // namespace constraint_sim::engine
