#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>

#include "engine/constraints/forms.h"
#include "engine/constraints/rows.h"
#include "engine/dynamics/coordinate_positions.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Distance of two points, as a share of an island's size, below which they coincide: rounding of
/// positions leaves them without a direction. Frequencies of a link divide by no shorter distance.
inline constexpr double kCoincidentPoints = 1e-9;

struct KernelView;

/// Pose and velocities of an island as of the last evaluation, and the Jacobian G of its rows with
/// their values C and rates Ċ. A state y is laid out as StateLayout says.
class Kinematics {
 public:
  explicit Kinematics(const IslandModel& island);

  /// Moves fixed points to time t [s].
  void place_fixed_points(const IslandModel& island, double t, IntervalInputs* inputs) {
    inputs->place_fixed_points(island, t, &position_, &velocity_);
  }
  /// Evaluates pose and Jacobian at state y and time t [s], with inputs at that time. Moves fixed
  /// points.
  void place(const IslandModel& island, double t, const double* y, IntervalInputs* inputs);
  /// Evaluates velocities at state y, after place().
  void move(const IslandModel& island, const IntervalInputs& inputs, const double* y);
  /// Evaluates the Jacobian of the rows of general joints. Kernels leave it out.
  void place_general_rows(const IslandModel& island);
  /// Evaluates C of all rows, after place(). Calls `consider(row, error)` with the error [m].
  template <class Consider>
  void find_values(const IslandModel& island, const IntervalInputs& inputs,
                   const CoordinatePositions& coordinates, const Consider& consider);
  /// Evaluates Ċ of all rows, after move().
  void find_rates(const IslandModel& island);
  /// Lends the arrays of the last evaluation to a kernel, which evaluates poses by itself.
  void lend(KernelView* view);

  /// Time of the last place() [s].
  double time() const { return time_; }
  /// Per point, in world axes.
  const List<Eigen::Vector3d>& position() const { return position_; }
  const List<Eigen::Vector3d>& velocity() const { return velocity_; }
  /// Per rotating body, in world axes.
  const List<Eigen::Matrix3d>& orientation() const { return orientation_; }
  const List<Eigen::Matrix3d>& inverse_inertia() const { return inverse_inertia_; }
  const List<Eigen::Vector3d>& angular_velocity() const { return angular_velocity_; }
  /// Angular velocity of a point [rad/s]; zero for bodies that do not rotate.
  Eigen::Vector3d spin(const IslandModel& island, const IntervalInputs& inputs,
                       std::size_t point) const;
  /// Vector d between the anchors of a ball joint, general joint or spring [m], per link.
  const List<Eigen::Vector3d>& separation() const { return separation_; }
  /// Arms from the centres of rotating ends A and B to their anchors [m], per link.
  const List<Eigen::Vector3d>& arm_a() const { return arm_a_; }
  const List<Eigen::Vector3d>& arm_b() const { return arm_b_; }
  /// Rate of d of a link [m/s].
  Eigen::Vector3d separation_rate(const IslandModel& island, std::size_t l) const;
  /// Second derivative of d of a link without accelerations [m/s²].
  Eigen::Vector3d separation_bias(const IslandModel& island, std::size_t l) const;
  /// Vectors of general joint l, and their rates.
  const JointVectors& vectors(std::size_t l) const { return vectors_[l - first_general_]; }
  const JointMotion& motion(std::size_t l) const { return motions_[l - first_general_]; }
  /// Rate of a row or coordinate of general joint l.
  double rate_of(std::size_t l, const ScalarForm& form) const {
    return engine::rate(form, vectors(l), motion(l));
  }
  /// C of a general row; whole turns of an angle do not count.
  double value_of(const IntervalInputs& inputs, const IslandModel::GeneralRow& row) const {
    const double off = engine::value(row.form, vectors(row.link)) - inputs.value_target()[row.row];
    return row.form.is_angle ? unwound(off, 0.0) : off;
  }
  /// Jacobian by the velocity of B, per part; −J by the velocity of A.
  const List<Eigen::Vector3d>& J_linear() const { return J_linear_; }
  /// Jacobian by the angular velocity, and I⁻¹ Jᵀ, per angular block.
  const List<Eigen::Vector3d>& J_angular() const { return J_angular_; }
  const List<Eigen::Vector3d>& M_inv_Jt() const { return M_inv_Jt_; }
  /// C and Ċ per row, as of find_values() and find_rates().
  const List<double>& value() const { return value_; }
  const List<double>& rate() const { return rate_; }
  /// Largest speed of a point that a joint holds [m/s].
  double largest_speed(const IslandModel& island) const;

 private:
  void place_bodies(const IslandModel& island, const double* y);
  void place_separations(const IslandModel& island);
  void place_arms(const IslandModel& island, const IntervalInputs& inputs);
  void place_general(const IslandModel& island, const IntervalInputs& inputs);
  void place_coupled(const IslandModel& island);
  void set_block(const IslandModel& island, int block, const Eigen::Vector3d& J);
  JointMotion motion_of(const IslandModel& island, const IntervalInputs& inputs,
                        std::size_t l) const;

  std::size_t first_general_;                            // as in the island
  double time_ = 0.0;                                    // [s]
  List<Eigen::Vector3d> position_, velocity_;            // per point
  List<Eigen::Matrix3d> orientation_, inverse_inertia_;  // per rotating body
  List<Eigen::Vector3d> angular_velocity_;               // per rotating body
  List<Eigen::Vector3d> separation_;                     // per link; unused for rods
  List<Eigen::Vector3d> arm_a_, arm_b_;                  // per link
  List<JointVectors> vectors_;                           // per general joint
  List<JointMotion> motions_;                            // per general joint
  List<Eigen::Vector3d> J_linear_;                       // per part; d of rods, axes of ball joints
  List<Eigen::Vector3d> J_angular_, M_inv_Jt_;           // per angular block
  List<double> value_, rate_;                            // per row
};

template <class Consider>
void Kinematics::find_values(const IslandModel& island, const IntervalInputs& inputs,
                             const CoordinatePositions& coordinates, const Consider& consider) {
  const IslandModel::FirstLinks& first = island.first();
  for (std::size_t l = 0; l < first.ball; ++l) {
    const double length = inputs.length()[l].value;
    value_[l] = 0.5 * (J_linear_[l].squaredNorm() - length * length);
    consider(l, std::abs(value_[l] / length));
  }
  for (std::size_t l = first.ball; l < first.general; ++l)
    Eigen::Map<Eigen::Vector3d>(value_.data() + island.row_of(l)) = separation_[l];
  for (const IslandModel::GeneralRow& row : island.general_rows())
    value_[row.row] = value_of(inputs, row);
  const std::size_t first_general = island.first_general_row();
  for (std::size_t i = first.ball; i < first_general; ++i) consider(i, std::abs(value_[i]));
  for (std::size_t c = 0; c < island.coupled_rows().size(); ++c) {
    const IslandModel::CoupledRow& coupled = island.coupled_rows()[c];
    value_[coupled.row] = coordinates.coupling_error(island, *this, inputs, c);
    consider(coupled.row, coupled.metres * std::abs(value_[coupled.row]));
  }
  for (const IslandModel::GeneralRow& row : island.general_rows())
    consider(row.row, row.metres * std::abs(value_[row.row]));
}

}  // namespace constraint_sim::engine
