#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>

#include "engine/dynamics/kernel_view.h"

namespace constraint_sim::engine {

/// An EquationsOfMotion of which is_chain_of_bodies() holds, as a System: bodies that turn, joined
/// one after the other by ball joints. Both ends are eliminated towards the middle side by side,
/// each in a lane: a pass places the bodies, finds the rows of their joints and eliminates them
/// while they are in registers; a pass back from the middle finds the forces. Where rows depend on
/// each other the equations take over. For one span: points into the equations.
class ChainOfBodies {
 public:
  explicit ChainOfBodies(EquationsOfMotion& equations);

  std::size_t size() const { return equations_.size(); }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  /// Newton's steps with the factors of the last stage, as the equations make them.
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    equations_.accept<Pair>(h);
  }
  bool restart(double* y, double* dydt);
  double rounding() const { return equations_.rounding(); }
  double squared_size_of(const double* dy, double h) const {
    return equations_.squared_size_of(dy, h);
  }

 private:
  using Vector3d = Eigen::Vector3d;
  using Quaternions = Eigen::Quaternion<Lanes>;
  template <class Number>
  using Addresses = std::array<Number*, 2>;

  // of the pair e joints from either end, the first lane counting up
  template <class Number>
  Addresses<Number> locate(std::size_t e, Number* of_bodies, std::size_t stride, Number* of_first,
                           Number* of_last) const;
  Lanes3 read(std::size_t e, const double* of_bodies, const Vector3d* of_points) const;
  Lanes3 read_turning(std::size_t e, const double* of_bodies) const;
  Quaternions read_rotation(std::size_t e, const double* y) const;
  template <class Vector>
  void write(std::size_t e, const Vector& value, double* of_bodies) const;
  void write_forces(double* by_unknown) const;

  bool accelerate(std::size_t stage, const double* y, double* dydt);
  double find_values(double* y);
  void push(double* y);

  template <class FindMotion>
  bool factor(const double* y, const FindMotion& find_motion);
  void reduce();
  template <class Act>
  void substitute(const Act& act);
  // With an even number of joints the lanes meet at a body: the first takes it, the second waits.
  bool is_idle(std::size_t e) const { return e == middle_ && joints_ % 2 == 0; }

  EquationsOfMotion& equations_;
  KernelView view_;
  ChainPair* pairs_;
  std::size_t joints_;
  std::size_t middle_;                            // the last pair
  std::size_t before_, behind_;                   // points at the ends that are no bodies: 0 or 1
  const Vector3d *position_, *velocity_, *free_;  // of points; the last without the joints
  std::size_t first_, last_;                      // points
  bool depends_ = false;                          // some rows did, since the last restart
};

}  // namespace constraint_sim::engine
