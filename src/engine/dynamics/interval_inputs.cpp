#include "engine/dynamics/interval_inputs.h"

#include <cassert>
#include <cmath>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

}  // namespace

IntervalInputs::IntervalInputs(const IslandModel& island, const List<MassProperties>& masses)
    : bodies_(island.bodies().size()), first_general_(island.first().general) {
  for (std::size_t i = 0; i < bodies_; ++i) {
    const double share = masses[island.bodies()[i]].weight_share;
    if (share != 1.0) compensated_.emplace_back(i, share);
  }
  acceleration_.assign(island.points(), Vector3d::Zero());
  torque_.assign(island.rotating(), Vector3d::Zero());
  length_.resize(island.links().size());
  is_changing_.assign(island.links().size(), false);
  motions_.reserve(island.links().size());
  for (std::size_t l = first_general_; l < island.first().spring; ++l)
    frames_.emplace_back(island.links()[l].anchor_b, island.links()[l].frame_b);
  for (const IslandModel::FixedPoint& point : island.fixed_points()) {
    FixedPointMotion& motion = fixed_points_.emplace_back();
    motion.anchor = point.anchor;
  }
  for (auto* targets : {&value_target_, &rate_target_, &acceleration_target_})
    targets->assign(island.rows(), 0.0);
  coupling_offset_.resize(island.coupled_rows().size());
}

bool IntervalInputs::begin(const IslandModel& island, double t, const List<BodyState>& states,
                           const Vector3d& gravity, const List<AppliedWrench>& loads,
                           const List<PrescribedMotion>& motions, double since_tick) {
  set_loads(island, gravity, loads);
  tick_start_ = t - since_tick;
  fixed_points_move_ = false;
  for (std::size_t i = 0; i < fixed_points_.size(); ++i) {
    const BodyState& start = fixed_points_[i].start = states[island.fixed_points()[i].body];
    fixed_points_move_ = fixed_points_move_ || !start.linear_velocity.isZero(0.0) ||
                         !start.angular_velocity.isZero(0.0);
  }
  scale_ = 0.0;

  has_jumped_ = rates_jump(island, motions);
  motions_.clear();
  updated_at_ = std::numeric_limits<double>::quiet_NaN();
  std::fill(rate_target_.begin(), rate_target_.end(), 0.0);
  std::fill(acceleration_target_.begin(), acceleration_target_.end(), 0.0);
  bool others_change = false;
  for (std::size_t l = 0; l < length_.size(); ++l) {
    const IslandModel::Link& link = island.links()[l];
    const PrescribedMotion& motion = motions[island.joints()[l]];
    others_change = others_change || is_changing_[l] == motion.is_constant();
    is_changing_[l] = !motion.is_constant();
    assert(!island.is_ball(l) || motion.is_constant());  // other ball joints are compiled as open
    if (is_changing_[l]) motions_.emplace_back(l, motion);
    length_[l] = island.is_by_offset(l) ? Prescribed{} : motion.length(t);
    scale_ = std::max(scale_, length_[l].value);
    if (island.is_general(l)) begin_general(island, l, motion, t);
    if (island.rotates(link.a)) scale_ = std::max(scale_, link.anchor_a.norm());
    if (island.rotates(link.b)) scale_ = std::max(scale_, link.anchor_b.norm());
  }
  has_jumped_ = has_jumped_ || others_change;
  return others_change;
}

void IntervalInputs::set_loads(const IslandModel& island, const Vector3d& gravity,
                               const List<AppliedWrench>& loads) {
  std::fill_n(acceleration_.begin(), bodies_, gravity);
  for (const auto& [body, share] : compensated_) acceleration_[body] = share * gravity;
  for (Vector3d& torque : torque_) torque.setZero();
  loads_.clear();
  for (const AppliedWrench& load : loads) {
    const auto found = std::find(island.bodies().begin(), island.bodies().end(), load.body);
    if (found == island.bodies().end()) continue;
    loads_.push_back(load);
    add_load(island, to_index(found - island.bodies().begin()), load.force, load.torque);
  }
}

bool IntervalInputs::has_loads(const IslandModel& island, const List<AppliedWrench>& loads) const {
  std::size_t known = 0;
  for (const AppliedWrench& load : loads) {
    if (std::find(island.bodies().begin(), island.bodies().end(), load.body) ==
        island.bodies().end())
      continue;
    if (known == loads_.size() || !(load == loads_[known])) return false;
    ++known;
  }
  return known == loads_.size();
}

void IntervalInputs::begin_general(const IslandModel& island, std::size_t l,
                                   const PrescribedMotion& motion, double t) {
  const IslandModel::Link& link = island.links()[l];
  if (motion.moves_frame())
    set_frame(island, l, motion.frame(t, link.anchor_b, link.frame_b));
  else if (frame_b(l).moves)
    set_frame(island, l, {link.anchor_b, link.frame_b});
  scale_ = std::max(scale_, link.radius);
  if (info(link.kind).couples) update_coupling(island, l, motion, t);
  for (std::size_t k = 0; k < island.rows_of(l); ++k) {
    const std::size_t row = island.row_of(l) + k;
    value_target_[row] = motion.target(link.function[k], t).value;
    if (link.function[k] >= forms(link.kind).rows)
      scale_ = std::max(scale_, std::abs(value_target_[row]) / row_length(island, row));
  }
}

void IntervalInputs::add_load(const IslandModel& island, std::size_t body, const Vector3d& force,
                              const Vector3d& torque) {
  acceleration_[body] += island.inverse_mass(body) * force;
  if (island.rotates(body)) torque_[body] += torque;
}

// Whether a motor demands another rate from t on: the time of its motion is over, or the motor was
// set anew while another motor or a sinusoid continues.
bool IntervalInputs::rates_jump(const IslandModel& island,
                                const List<PrescribedMotion>& motions) const {
  for (const auto& [l, before] : motions_)
    if (!motions[island.joints()[l]].is_driven_as(before)) return true;
  return false;
}

void IntervalInputs::update(const IslandModel& island, double t) {
  if (t == updated_at_) return;  // last stage and projection share t
  updated_at_ = t;
  for (const auto& [l, motion] : motions_) {
    if (island.is_rod(l)) {
      Prescribed& length = length_[l];
      length = motion.length(t);
      rate_target_[l] = length.value * length.rate;
      acceleration_target_[l] = length.rate * length.rate + length.value * length.acceleration;
      continue;
    }
    if (l >= island.first().spring) {
      length_[l] = motion.length(t);
      continue;
    }
    const IslandModel::Link& link = island.links()[l];
    length_[l] = motion.closing(t).share();
    if (info(link.kind).couples) update_coupling(island, l, motion, t);
    if (motion.moves_frame()) set_frame(island, l, motion.frame(t, link.anchor_b, link.frame_b));
    for (std::size_t k = 0; k < island.rows_of(l); ++k) {
      const Prescribed target = motion.target(link.function[k], t);
      value_target_[island.row_of(l) + k] = target.value;
      rate_target_[island.row_of(l) + k] = target.rate;
      acceleration_target_[island.row_of(l) + k] = target.acceleration;
    }
  }
}

void IntervalInputs::set_frame(const IslandModel& island, std::size_t l, const MovingFrame& frame) {
  frames_[l - first_general_] = frame;
  const std::size_t b = island.links()[l].b;
  if (b < bodies_) return;
  FixedPointMotion& point = fixed_points_[b - bodies_];
  point.anchor = frame.anchor;
  point.anchor_rate = frame.anchor_rate;
  point.anchor_acceleration = frame.anchor_acceleration;
  fixed_points_move_ = fixed_points_move_ || frame.moves;
}

void IntervalInputs::update_coupling(const IslandModel& island, std::size_t l,
                                     const PrescribedMotion& motion, double t) {
  for (std::size_t c = 0; c < coupling_offset_.size(); ++c) {
    const IslandModel::CoupledRow& coupled = island.coupled_rows()[c];
    if (coupled.link != l) continue;
    coupling_offset_[c] = motion.closing(t).coupling();
    rate_target_[coupled.row] = coupling_offset_[c].rate;
    acceleration_target_[coupled.row] = coupling_offset_[c].acceleration;
  }
}

void IntervalInputs::place_fixed_points(const IslandModel& island, double t,
                                        List<Vector3d>* position, List<Vector3d>* velocity) {
  for (std::size_t i = 0; i < fixed_points_.size(); ++i) {
    FixedPointMotion& point = fixed_points_[i];
    const std::size_t p = bodies_ + i;
    const double since = t - tick_start_;
    const Vector3d& w = point.start.angular_velocity;
    const Quaterniond turned = rotation(since * w) * point.start.orientation;
    const Vector3d arm = turned * point.anchor;
    const Vector3d around = w.cross(arm);
    (*position)[p] = point.start.position + since * point.start.linear_velocity + arm;
    (*velocity)[p] = point.start.linear_velocity + around;
    acceleration_[p] = w.cross(around);
    if (!point.anchor_rate.isZero(0.0) || !point.anchor_acceleration.isZero(0.0)) {
      const Vector3d rate = turned * point.anchor_rate;
      (*velocity)[p] += rate;
      acceleration_[p] += 2.0 * w.cross(rate) + turned * point.anchor_acceleration;
    }
    if (island.fixed_points()[i].has_axes)
      point.axes = (rotation(since * w) * point.start.orientation).toRotationMatrix();
  }
}

Vector3d IntervalInputs::body_velocity(std::size_t point, double t,
                                       const Vector3d& position) const {
  const BodyState& body = fixed_points_[point - bodies_].start;
  const Vector3d centre = body.position + (t - tick_start_) * body.linear_velocity;
  return body.linear_velocity + body.angular_velocity.cross(position - centre);
}

RowVector IntervalInputs::offset(const IslandModel& island, std::size_t l) const {
  RowVector targets = RowVector::Zero();
  for (std::size_t k = 0; island.is_general(l) && k < island.rows_of(l); ++k)
    targets[static_cast<Eigen::Index>(k)] = value_target_[island.row_of(l) + k];
  return targets;
}

RowVector IntervalInputs::driven_rate(const IslandModel& island, std::size_t of, double t) const {
  RowVector rates = RowVector::Zero();
  for (const auto& [l, motion] : motions_)
    for (std::size_t k = 0; l == of && k < island.rows_of(l); ++k)
      rates[static_cast<Eigen::Index>(k)] = motion.driven_rate(island.links()[l].function[k], t);
  return rates;
}

double IntervalInputs::row_length(const IslandModel& island, std::size_t row) const {
  if (row < island.first().ball) return length_[row].value;
  if (row >= island.first_coupled_row())
    return 1.0 / island.coupled_rows()[row - island.first_coupled_row()].metres;
  const std::size_t first = island.first_general_row();
  return row < first ? 1.0 : 1.0 / island.general_rows()[row - first].metres;
}

}  // namespace constraint_sim::engine
