#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>

#include "engine/dynamics/kernel_view.h"

namespace constraint_sim::engine {

/// Kernel for a chain of rotating bodies on ball joints (is_chain_of_bodies()). Both ends are
/// eliminated towards the middle side by side, each in a SIMD lane: one pass places the bodies and
/// eliminates the rows of their joints while they are in registers; a pass back from the middle
/// finds the forces. Dependent rows are left to the equations. Valid for one interval: points into
/// the equations.
class ChainOfBodies : public EquationsKernel {
 public:
  explicit ChainOfBodies(EquationsOfMotion& equations);

  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  /// Projects by Newton steps with the factors of the last stage, as EquationsOfMotion does.
  bool project(double t, double* y);
  bool restart(double* y, double* dydt);

 private:
  using Vector3d = Eigen::Vector3d;
  using Quaternions = Eigen::Quaternion<Lanes>;
  template <class Number>
  using Addresses = std::array<Number*, 2>;

  // Addresses of the numbers of pair e, which is e joints from either end; the first lane counts
  // up.
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
  void add_response(double* y);

  template <class FindMotion>
  bool factor(const double* y, const FindMotion& find_motion);
  void reduce();
  template <class Act>
  void substitute(const Act& act);
  // Whether a lane waits: with an even number of joints the lanes meet at a body, which the first
  // lane takes.
  bool is_idle(std::size_t e) const { return e == middle_ && joints_ % 2 == 0; }

  KernelView view_;
  ChainPair* pairs_;
  std::size_t joints_;
  std::size_t middle_;           // pair in the middle
  std::size_t before_, behind_;  // number of points at the ends that are no bodies: 0 or 1
  const Vector3d *position_, *velocity_,
      *free_;                 // per point; free_: acceleration without the joints
  std::size_t first_, last_;  // points at the ends
  bool depends_ = false;      // whether rows depended on others since the last restart
};

}  // namespace constraint_sim::engine
