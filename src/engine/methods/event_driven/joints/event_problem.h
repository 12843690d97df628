#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/interval.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_motions.h"
#include "engine/methods/event_driven/joints/event_reading.h"

namespace constraint_sim::engine {

/// Index of an entry of an Eigen matrix or vector.
inline Eigen::Index eigen_index(std::size_t i) { return static_cast<Eigen::Index>(i); }

/// Complementarity problem of the laws that act at an event, while the rigid joints hold: with
/// u = J V the rates of coordinates and A = J W Jᵀ, W the response to impulses,
///   impacts    u⁺ = u + A p, and for touching limits  0 ≤ p ⊥ u⁺ + e u⁻ ≥ 0
///   afterwards q̈ − c̈ = b + A λ, and for coordinates that move at c  least ≤ λ ≤ most, with
///              q̈ = c̈, or q̈ > c̈ at the least λ, or q̈ < c̈ at the most λ
/// Limits that are not reached do not act, and cost only their readings.
/// event_impacts.h solves the impacts, event_decision.h the accelerations afterwards.
class EventProblem {
 public:
  /// Rates up to `resting` count as zero [m/s or rad/s].
  EventProblem(std::size_t laws, double resting)
      : resting_(resting), hit_(laws, 0.0), rests_in_(laws, 0.0) {}

  /// Loads the problem at time t of `interval`: projects the velocities of `states` onto the
  /// rigid joints, and finds readings and responses. Adds the removed energy to `progress`.
  /// Returns false where the equations have no solution.
  bool load(const EventMotions& motions, const Interval& interval, const EventBodies& bodies,
            double t, EquationsOfMotion* bare, List<BodyState>* states,
            IntegrationResult* progress);

  double resting() const { return resting_; }
  /// Coordinate of a law, without one-sided forces.
  const EventReading& reading(std::size_t law) const { return reading_[law]; }
  /// Laws that act, ascending.
  const List<std::size_t>& acting() const { return acting_; }
  bool acts(std::size_t law) const { return column_[law] >= 0; }
  /// Place of a law that acts in acting().
  Eigen::Index column(std::size_t law) const { return column_[law]; }
  /// Rates of the laws that act, per impulse along these laws.
  const Eigen::MatrixXd& A() const { return A_; }
  double A(std::size_t law, std::size_t along) const { return A_(column(law), column(along)); }
  /// Whether the rigid joints leave the coordinate of a law that acts free.
  bool is_free(std::size_t law) const { return is_free_[law] != 0; }
  /// State of the bare equations.
  const List<double>& state() const { return y_; }

  /// Adds an impulse along a law that acts to the state.
  void add_impulse(std::size_t law, double impulse, EquationsOfMotion* bare);
  /// Impulse of a law in impacts.
  double hit(std::size_t law) const { return hit_[law]; }
  void clear_hits() { hit_.assign(hit_.size(), 0.0); }
  /// Time until bounces that are not followed are over [s].
  double rests_in(std::size_t law) const { return rests_in_[law]; }
  void set_rests_in(std::size_t law, double duration) { rests_in_[law] = duration; }

 private:
  void find_acting(const EventMotions& motions, double t);
  void find_responses(const EventMotions& motions, EquationsOfMotion* bare);

  double resting_;
  List<double> y_, dydt_;       // state and derivative of the bare equations
  List<EventReading> reading_;  // per law
  List<std::size_t> acting_;
  List<Eigen::Index> column_;          // per law, in acting_; -1: does not act
  List<Motions> response_;             // per acting law, to a unit impulse
  List<List<double>> joint_impulses_;  // per acting law, by a unit impulse
  Eigen::MatrixXd A_;
  List<char> is_free_;
  List<double> hit_, rests_in_;
};

}  // namespace constraint_sim::engine
