#include "engine/dynamics/kinematics.h"

#include <algorithm>

#include "engine/dynamics/state_vector.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

}  // namespace

Kinematics::Kinematics(const IslandModel& island) : first_general_(island.first().general) {
  const IslandModel::FirstLinks& first = island.first();
  for (auto* list : {&position_, &velocity_}) list->assign(island.points(), Vector3d::Zero());
  orientation_.resize(island.rotating());
  inverse_inertia_.resize(island.rotating());
  angular_velocity_.assign(island.rotating(), Vector3d::Zero());
  for (auto* list : {&separation_, &arm_a_, &arm_b_})
    list->assign(island.links().size(), Vector3d::Zero());
  vectors_.resize(first.spring - first.general);
  motions_.resize(first.spring - first.general);
  J_linear_.assign(island.parts(), Vector3d::Zero());
  for (std::size_t l = first.ball; l < first.general; ++l)
    for (std::size_t k = 0; k < 3; ++k)
      J_linear_[island.row_of(l) + k] = Vector3d::Unit(static_cast<Eigen::Index>(k));
  J_angular_.assign(island.angular_blocks().size(), Vector3d::Zero());
  M_inv_Jt_ = J_angular_;
  for (auto* list : {&value_, &rate_}) list->assign(island.rows(), 0.0);
}

void Kinematics::place(const IslandModel& island, double t, const double* y,
                       IntervalInputs* inputs) {
  time_ = t;
  place_bodies(island, y);
  if (inputs->fixed_points_move()) place_fixed_points(island, t, inputs);
  place_separations(island);
  if (island.rotating() > 0) place_arms(island, *inputs);
  if (!vectors_.empty()) place_general(island, *inputs);
}

void Kinematics::place_bodies(const IslandModel& island, const double* y) {
  copy_few(y, 3 * island.bodies().size(), position_.front().data());
  const double* q = y + island.layout().q_at;
  for (std::size_t i = 0; i < orientation_.size(); ++i) {
    const Matrix3d R = rotation_matrix(q + 4 * i);
    orientation_[i] = R;
    inverse_inertia_[i].noalias() =
        R * island.inertia(i).cwiseInverse().asDiagonal() * R.transpose();
  }
}

// Sets d of rods and other links from centre to centre; place_arms() adds the arms of rotating
// bodies.
void Kinematics::place_separations(const IslandModel& island) {
  const List<IslandModel::Link>& links = island.links();
  for (std::size_t l = 0; l < island.first().ball; ++l)
    J_linear_[l] = position_[links[l].b] - position_[links[l].a];
  for (std::size_t l = island.first().ball; l < links.size(); ++l)
    separation_[l] = position_[links[l].b] - position_[links[l].a];
}

void Kinematics::place_arms(const IslandModel& island, const IntervalInputs& inputs) {
  const List<IslandModel::Link>& links = island.links();
  const IslandModel::FirstLinks& first = island.first();
  const auto place_arm = [&](std::size_t l, const Vector3d& anchor_b) {
    const IslandModel::Link& link = links[l];
    Vector3d& d = island.is_rod(l) ? J_linear_[l] : separation_[l];
    if (island.rotates(link.a)) d -= arm_a_[l] = orientation_[link.a] * link.anchor_a;
    if (island.rotates(link.b)) d += arm_b_[l] = orientation_[link.b] * anchor_b;
  };
  for (std::size_t l = first.general; l < first.spring; ++l) place_arm(l, inputs.frame_b(l).anchor);
  for (std::size_t l = first.spring; l < links.size(); ++l) place_arm(l, links[l].anchor_b);
  for (std::size_t l = first.armed; l < first.general; ++l) {
    if (!links[l].has_arms) continue;
    place_arm(l, links[l].anchor_b);
    const std::size_t begin = island.row_of(l), end = begin + (island.is_rod(l) ? 1 : 3);
    for (std::size_t i = begin; i < end; ++i) {
      const IslandModel::Row& row = island.part(i);
      if (row.block_a >= 0) J_angular_[row.block_a] = J_linear_[i].cross(arm_a_[l]);
      if (row.block_b >= 0) J_angular_[row.block_b] = arm_b_[l].cross(J_linear_[i]);
    }
  }
  for (std::size_t p = 0; p < M_inv_Jt_.size(); ++p)
    M_inv_Jt_[p].noalias() = inverse_inertia_[island.angular_blocks()[p].body] * J_angular_[p];
}

// Computes the vectors of general joints, and the Jacobians of their rows.
void Kinematics::place_general(const IslandModel& island, const IntervalInputs& inputs) {
  for (std::size_t l = island.first().general; l < island.first().spring; ++l) {
    const IslandModel::Link& link = island.links()[l];
    JointVectors& vectors = vectors_[l - first_general_];
    vectors.custom = link.custom;
    vectors.r_A = arm_a_[l];
    vectors.r_B = arm_b_[l];
    vectors.d = separation_[l];
    const auto axes = [&](std::size_t point, const Matrix3d& frame) -> Matrix3d {
      if (island.rotates(point)) return orientation_[point] * frame;
      return point < island.bodies().size() ? frame : Matrix3d(inputs.fixed_axes(point) * frame);
    };
    if (!info(link.kind).has_frames) continue;
    vectors.axes_A = axes(link.a, link.frame_a);
    vectors.axes_B = axes(link.b, inputs.frame_b(l).axes);
  }
  place_general_rows(island);
  if (!island.coupled_rows().empty()) place_coupled(island);
}

void Kinematics::set_block(const IslandModel& island, int block, const Vector3d& J) {
  if (block < 0) return;
  J_angular_[block] = J;
  M_inv_Jt_[block].noalias() = inverse_inertia_[island.angular_blocks()[block].body] * J;
}

void Kinematics::place_general_rows(const IslandModel& island) {
  for (const IslandModel::GeneralRow& general : island.general_rows()) {
    const IslandModel::Row& row = island.part(general.row);
    const Jacobian J = jacobian(general.form, vectors(general.link));
    J_linear_[general.row] = J.j3;
    set_block(island, row.block_a, J.j2);
    set_block(island, row.block_b, J.j4);
  }
}

void Kinematics::place_coupled(const IslandModel& island) {
  for (const IslandModel::CoupledRow& coupled : island.coupled_rows()) {
    for (const IslandModel::CoupledRow::Term& term : coupled.terms) {
      const IslandModel::Row& row = island.part(term.part);
      const Jacobian J = jacobian(term.form, vectors(term.link));
      J_linear_[term.part] = term.ratio * J.j3;
      set_block(island, row.block_a, term.ratio * J.j2);
      set_block(island, row.block_b, term.ratio * J.j4);
    }
  }
}

void Kinematics::move(const IslandModel& island, const IntervalInputs& inputs, const double* y) {
  copy_few(y + island.layout().v_at, 3 * island.bodies().size(), velocity_.front().data());
  const double* L = y + island.layout().L_at;
  for (std::size_t i = 0; i < angular_velocity_.size(); ++i)
    angular_velocity_[i].noalias() = inverse_inertia_[i] * ConstVector(L + 3 * i);
  for (std::size_t g = 0; g < motions_.size(); ++g)
    motions_[g] = motion_of(island, inputs, first_general_ + g);
}

Vector3d Kinematics::spin(const IslandModel& island, const IntervalInputs& inputs,
                          std::size_t point) const {
  if (island.rotates(point)) return angular_velocity_[point];
  if (point < island.bodies().size()) return Vector3d::Zero();
  return inputs.fixed_angular_velocity(point);
}

Vector3d Kinematics::separation_rate(const IslandModel& island, std::size_t l) const {
  const IslandModel::Link& link = island.links()[l];
  Vector3d rate = velocity_[link.b] - velocity_[link.a];
  if (!link.has_arms) return rate;
  if (island.rotates(link.a)) rate -= angular_velocity_[link.a].cross(arm_a_[l]);
  if (island.rotates(link.b)) rate += angular_velocity_[link.b].cross(arm_b_[l]);
  return rate;
}

Vector3d Kinematics::separation_bias(const IslandModel& island, std::size_t l) const {
  const IslandModel::Link& link = island.links()[l];
  Vector3d bias = Vector3d::Zero();
  if (island.rotates(link.a))
    bias -= angular_velocity_[link.a].cross(angular_velocity_[link.a].cross(arm_a_[l]));
  if (island.rotates(link.b))
    bias += angular_velocity_[link.b].cross(angular_velocity_[link.b].cross(arm_b_[l]));
  return bias;
}

// Rates of the vectors of a general joint.
JointMotion Kinematics::motion_of(const IslandModel& island, const IntervalInputs& inputs,
                                  std::size_t l) const {
  const IslandModel::Link& link = island.links()[l];
  JointMotion motion;
  motion.d_dot = separation_rate(island, l);
  motion.d_bias = separation_bias(island, l);
  motion.w_A = spin(island, inputs, link.a);
  motion.w_B = spin(island, inputs, link.b);
  if (inputs.frame_b(l).moves) {
    MovingFrame frame = inputs.frame_b(l);
    const bool rotates = island.rotates(link.b);
    if (!rotates)  // velocity_ of the fixed point contains the frame's rate
      frame.anchor_rate = frame.anchor_acceleration = Vector3d::Zero();
    motion.add(frame, rotates ? orientation_[link.b] : inputs.fixed_axes(link.b));
  }
  return motion;
}

void Kinematics::find_rates(const IslandModel& island) {
  const IslandModel::FirstLinks& first = island.first();
  for (std::size_t l = 0; l < first.ball; ++l)
    rate_[l] = J_linear_[l].dot(separation_rate(island, l));
  for (std::size_t l = first.ball; l < first.general; ++l)
    Vector(rate_.data() + island.row_of(l)) = separation_rate(island, l);
  for (const IslandModel::GeneralRow& row : island.general_rows())
    rate_[row.row] = rate_of(row.link, row.form);
  for (const IslandModel::CoupledRow& coupled : island.coupled_rows()) {
    rate_[coupled.row] = 0.0;
    for (const IslandModel::CoupledRow::Term& term : coupled.terms)
      rate_[coupled.row] += term.ratio * rate_of(term.link, term.form);
  }
}

double Kinematics::largest_speed(const IslandModel& island) const {
  double speed = 0.0;
  for (const Vector3d& velocity : velocity_) speed = std::max(speed, velocity.norm());
  for (std::size_t l = 0; l < island.links().size(); ++l) {
    const IslandModel::Link& link = island.links()[l];
    if (island.rotates(link.a))
      speed = std::max(speed, angular_velocity_[link.a].norm() * arm_a_[l].norm());
    if (island.rotates(link.b))
      speed = std::max(speed, angular_velocity_[link.b].norm() * arm_b_[l].norm());
  }
  return speed;
}

}  // namespace constraint_sim::engine
