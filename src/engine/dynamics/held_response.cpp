// Response of the bodies of EquationsOfMotion to impulses while the rigid rows hold, for methods
// that decide which rows are rigid.

#include <algorithm>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Vector = Eigen::Map<Vector3d>;
using ConstVector = Eigen::Map<const Vector3d>;

}  // namespace

void EquationsOfMotion::keep_first_stage() {
  keep_impulses();
  kept_forces_.assign(stage_forces_.begin(),
                      stage_forces_.begin() + static_cast<std::ptrdiff_t>(impulses_.size()));
}

void EquationsOfMotion::restore_first_stage() {
  restore_impulses();
  std::copy(kept_forces_.begin(), kept_forces_.end(), stage_forces_.begin());
}

// Solves Δv = M⁻¹(f + Gᵀλ) with G Δv = 0.
EquationsOfMotion::Motions EquationsOfMotion::held_response(const BodyImpulse& impulse,
                                                            List<double>* impulses) {
  const std::size_t bodies = bodies_.size();
  Motions f{List<Vector3d>(inverse_mass_.size(), Vector3d::Zero()),
            List<Vector3d>(bodies, Vector3d::Zero())};
  for (std::size_t k = 0; k < impulse.body.size() && impulse.body[k] != 0; ++k) {
    const auto found = std::find(bodies_.begin(), bodies_.end(), impulse.body[k]);
    if (found == bodies_.end()) continue;
    const auto i = static_cast<std::size_t>(found - bodies_.begin());
    f.linear[i] += impulse.linear[k];
    if (rotates(i)) f.angular[i] += impulse.angular[k];
  }
  impulses->assign(rows_.size(), 0.0);
  double* const lambda = impulses->data();
  for (std::size_t i = 0; i < parts(); ++i) {
    const Row& row = part(i);
    lambda[rows_[row_of_part(i)].unknown] -= direction_[i].dot(
        inverse_mass_[row.b] * f.linear[row.b] - inverse_mass_[row.a] * f.linear[row.a]);
  }
  for (std::size_t p = 0; p < angular_blocks_.size(); ++p)
    lambda[angular_blocks_[p].unknown] -= M_inv_Jt_[p].dot(f.angular[angular_blocks_[p].body]);
  if (!rows_.empty()) solve(lambda);
  apply_jacobian_transpose(lambda);
  f.linear.resize(bodies);
  for (std::size_t i = 0; i < bodies; ++i)
    f.linear[i] = inverse_mass_[i] * (f.linear[i] + constraint_force_[i]);
  for (std::size_t i = 0; i < rotating_; ++i)
    f.angular[i] = inverse_inertia_[i] * (f.angular[i] + constraint_torque_[i]);
  multipliers_to_forces(lambda);
  return f;
}

double EquationsOfMotion::free_response(const BodyImpulse& impulse) const {
  double response = 0.0;
  for (std::size_t k = 0; k < impulse.body.size() && impulse.body[k] != 0; ++k) {
    const auto found = std::find(bodies_.begin(), bodies_.end(), impulse.body[k]);
    if (found == bodies_.end()) continue;
    const auto i = static_cast<std::size_t>(found - bodies_.begin());
    response += inverse_mass_[i] * impulse.linear[k].squaredNorm();
    if (rotates(i)) response += impulse.angular[k].dot(inverse_inertia_[i] * impulse.angular[k]);
  }
  return response;
}

void EquationsOfMotion::add_response(const Motions& change, const List<double>& impulses,
                                     double share, double* y) {
  knows_energy_ = false;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    Vector(y + layout().v_at + 3 * i) += share * change.linear[i];
  for (std::size_t i = 0; i < rotating_; ++i)
    Vector(y + layout().L_at + 3 * i) += share * inverse_inertia_[i].inverse() * change.angular[i];
  for (std::size_t i = 0; i < rows_.size(); ++i) impulses_[i] += share * impulses[i];
}

void EquationsOfMotion::find_accelerations(const double* y, const double* dydt,
                                           Motions* rates) const {
  rates->linear.resize(bodies_.size());
  rates->angular.assign(bodies_.size(), Vector3d::Zero());
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    rates->linear[i] = ConstVector(dydt + layout().v_at + 3 * i);
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Eigen::Quaterniond q(Eigen::Map<const Eigen::Quaterniond>(y + layout().q_at + 4 * i));
    const Vector3d inverse = inertia_[i].cwiseInverse();
    const ConstVector L(y + layout().L_at + 3 * i);
    const Vector3d w = apply_inertia(inverse, q, L);
    rates->angular[i] =
        apply_inertia(inverse, q, ConstVector(dydt + layout().L_at + 3 * i) - Vector3d(w.cross(L)));
  }
}

double EquationsOfMotion::largest_force() const {
  double largest = 0.0;
  for (std::size_t i = 0; i < impulses_.size(); ++i)
    largest = std::max(largest, std::abs(stage_forces_[i]));
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    largest = std::max(largest, inputs_.acceleration()[i].norm() / inverse_mass_[i]);
  return largest;
}

}  // namespace constraint_sim::engine
