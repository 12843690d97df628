#include "engine/dynamics/closing_joints.h"

#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"

namespace constraint_sim::engine {
namespace {

// Errors of moving coordinates [m], by `error_of(function, MovingStart)` in their own units.
template <class ErrorOf>
double moving_errors(const IslandModel& island, const IntervalInputs& inputs, std::size_t l,
                     const PrescribedMotion& motion, ErrorOf error_of) {
  if (!island.is_general(l)) return 0.0;
  const IslandModel::Link& link = island.links()[l];
  double square = 0.0;
  for (std::size_t k = 0; k < island.rows_of(l); ++k) {
    const int coordinate = link.function[k] - forms(link.kind).rows;
    if (coordinate < 0) continue;
    const MovingStart& moving = motion.to_close().moving[to_index(coordinate)];
    if (moving.duration == 0.0) continue;
    const double metres =
        error_of(link.function[k], moving) / inputs.row_length(island, island.row_of(l) + k);
    square += metres * metres;
  }
  return std::sqrt(square);
}

// Returns a bound of the error that a moving coordinate has while the error closes [m or rad].
double largest_error(int /*function*/, const MovingStart& moving) {
  // max u − 6u³ + 8u⁴ − 3u⁵ < 0.2, max ½ u² (1 − u)³ < 0.02
  return std::abs(moving.offset) +
         moving.duration *
             (0.2 * std::abs(moving.rate) + 0.02 * moving.duration * std::abs(moving.acceleration));
}

// Opening of a joint when it began to be closed [m], with or without the offsets of its motors.
// Leaves out moving coordinates.
double offset_of(const IslandModel& island, const IntervalInputs& inputs, std::size_t l,
                 const PrescribedMotion& motion, bool with_motors) {
  if (!island.is_general(l)) return motion.to_close().offset.norm();
  const IslandModel::Link& link = island.links()[l];
  RowVector offset = RowVector::Zero();
  const ErrorsToClose& start = motion.to_close();
  const double by_frame =
      motion.moves_frame() ? math::hypot(start.shift.norm(), link.radius * start.turn.norm()) : 0.0;
  for (std::size_t k = 0; k < island.rows_of(l); ++k)
    if (link.function[k] < forms(link.kind).rows ||
        (with_motors &&
         start.moving[to_index(link.function[k] - forms(link.kind).rows)].duration == 0.0))
      offset[static_cast<Eigen::Index>(k)] =
          start.offset[link.function[k]] / inputs.row_length(island, island.row_of(l) + k);
  double by_coupling = 0.0;
  if (info(link.kind).couples)
    for (const IslandModel::CoupledRow& coupled : island.coupled_rows())
      if (coupled.link == l) by_coupling = coupled.metres * start.coupling;
  return math::hypot(offset.norm(), by_frame, by_coupling);
}

// Arm that converts the opening of a joint to an angle [m].
double closing_arm(const PlacedRows& rows, std::size_t l) {
  if (rows.island.is_rod(l)) return rows.inputs.length()[l].value;
  return std::max({rows.kinematics.arm_a()[l].norm(), rows.kinematics.arm_b()[l].norm(),
                   rows.island.links()[l].radius});
}

}  // namespace

double opening(const PlacedRows& rows, bool with_motors) {
  double angle = 0.0;
  for (const auto& [l, motion] : rows.inputs.motions()) {
    if (!motion.is_closing()) continue;
    const ClosingErrors errors = motion.closing(rows.time);
    double open = std::abs(errors.share().value) *
                  offset_of(rows.island, rows.inputs, l, motion, with_motors);
    if (with_motors)
      open += moving_errors(
          rows.island, rows.inputs, l, motion,
          [&](int function, const MovingStart& /*moving*/) { return errors.of(function).value; });
    const double arm = closing_arm(rows, l);
    if (arm > 0.0) angle = std::max(angle, open / arm);
  }
  return angle;
}

double closing_curvature(const PlacedRows& rows) {
  double largest = 0.0;
  for (const auto& [l, motion] : rows.inputs.motions()) {
    if (!motion.is_closing()) continue;
    const double arm = closing_arm(rows, l);
    const double open = offset_of(rows.island, rows.inputs, l, motion, true) +
                        moving_errors(rows.island, rows.inputs, l, motion, largest_error);
    if (arm > 0.0) largest = std::max(largest, std::min(kOpenShare * open * open / arm, open));
  }
  return largest;
}

bool is_closing(const IntervalInputs& inputs) {
  return std::any_of(inputs.motions().begin(), inputs.motions().end(),
                     [](const auto& motion) { return motion.second.is_closing(); });
}

}  // namespace constraint_sim::engine
