#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/forms.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Angles of joints with whole turns. Two poses do not tell how many turns a body has made between
/// them, so a method adds up each angle from substep to substep, as the integral of its rate
///   φ̇ = z·(ω_B − ω_A),  z: axis of the joint on A, or on B for the second angle of a universal
/// joint. The sum has to be nearer than half a turn to the angle, which the pose then corrects.
class TurnedAngles {
 public:
  struct Angle {
    std::size_t joint;      ///< number of the joint in its method
    int coordinate;         ///< index of the coordinate in its joint
    std::size_t a, b;       ///< bodies or points A and B of the joint, by the method's numbers
    bool is_about_b;        ///< whether the axis is z_B
    double position, rate;  ///< as of time() [rad, rad/s]
    double kept_position, kept_rate;  ///< values that keep() saved
  };

  bool empty() const { return list_.empty(); }
  std::size_t size() const { return list_.size(); }
  const Angle& operator[](std::size_t i) const { return list_[i]; }
  void clear() {
    list_.clear();
    first_.clear();
  }
  /// Adds a coordinate that is an angle. Joints are added in ascending order.
  void add(std::size_t joint, JointKind kind, int coordinate, std::size_t a, std::size_t b) {
    const JointForms& of = forms(kind);
    bool is_about_b = false;
    for (int i = 0; i < coordinate; ++i)
      is_about_b = is_about_b || of.coordinate[static_cast<std::size_t>(i)].is_angle;
    first_.resize(joint + 1, list_.size());
    list_.push_back({joint, coordinate, a, b, is_about_b, 0.0, 0.0, 0.0, 0.0});
  }

  /// Takes positions and rates from `state_of(joint)`, a JointState.
  template <class StateOf>
  void begin(const StateOf& state_of) {
    for (Angle& angle : list_) {
      const CoordinateState& state =
          state_of(angle.joint).coordinates[static_cast<std::size_t>(angle.coordinate)];
      angle.position = state.position;
      angle.rate = state.velocity;
    }
  }
  /// Time of the positions [s].
  double time() const { return time_; }
  void set_time(double t) { time_ = t; }

  /// Integrates to time t [s]. `spin(end)`: angular velocity [rad/s]; `axis(angle)`: axis z. After
  /// a jump of the velocities, a call at the same time takes the new rates.
  template <class Spin, class Axis>
  void integrate(double t, const Spin& spin, const Axis& axis) {
    for (Angle& angle : list_) {
      const double now = axis(angle).dot(spin(angle.b) - spin(angle.a));
      angle.position = integrated(angle.position, t - time_, angle.rate, now);
      angle.rate = now;
    }
    time_ = t;
  }
  /// Returns angle i at time t [s], at which its rate is `rate` [rad/s].
  double expected(std::size_t i, double t, double rate) const {
    return integrated(list_[i].position, t - time_, list_[i].rate, rate);
  }
  /// Adds the rotation of a step that ends at time t [s]. `turn(end)`: rotation vector in the step
  /// [rad]; `axis(angle)`: axis z in the step.
  template <class Turn, class Axis>
  void add_turns(double t, const Turn& turn, const Axis& axis) {
    for (Angle& angle : list_) angle.position += axis(angle).dot(turn(angle.b) - turn(angle.a));
    time_ = t;
  }

  /// Adds to an angle [rad], and sets its rate [rad/s].
  void turn(std::size_t joint, int coordinate, double by, double rate) {
    for (auto angle = first_of(joint); angle != list_.end() && angle->joint == joint; ++angle) {
      if (angle->coordinate != coordinate) continue;
      angle->position += by;
      angle->rate = rate;
    }
  }

  /// Saves positions, rates and time, for a substep that is repeated.
  void keep() {
    for (Angle& angle : list_) {
      angle.kept_position = angle.position;
      angle.kept_rate = angle.rate;
    }
    kept_time_ = time_;
  }
  void restore() {
    for (Angle& angle : list_) {
      angle.position = angle.kept_position;
      angle.rate = angle.kept_rate;
    }
    time_ = kept_time_;
  }

  /// Writes the positions of the angles of a joint, by coordinate.
  void read(std::size_t joint, std::array<double, kMaxCoordinates>* positions) const {
    for (auto angle = first_of(joint); angle != list_.end() && angle->joint == joint; ++angle)
      (*positions)[static_cast<std::size_t>(angle->coordinate)] = angle->position;
  }

 private:
  List<Angle>::iterator first_of(std::size_t joint) {
    return joint < first_.size() ? list_.begin() + static_cast<std::ptrdiff_t>(first_[joint])
                                 : list_.end();
  }
  List<Angle>::const_iterator first_of(std::size_t joint) const {
    return joint < first_.size() ? list_.begin() + static_cast<std::ptrdiff_t>(first_[joint])
                                 : list_.end();
  }

  List<Angle> list_;         // ordered by joint
  List<std::size_t> first_;  // by joint: index of its first angle, or of the next joint's
  double time_ = 0.0, kept_time_ = 0.0;
};

}  // namespace constraint_sim::engine
