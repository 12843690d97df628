#include "engine/dynamics/implicit/implicit_motion.h"

#include "engine/dynamics/state_vector.h"
#include "engine/math/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;

}  // namespace

ImplicitMotion::ImplicitMotion(const ImplicitModel& model, std::size_t points) {
  for (auto* list : {&x_, &v_, &shift_}) list->assign(points, Vector3d::Zero());
  for (auto* list : {&force_, &torque_, &p_, &dx_before_, &v_before_, &w_before_, &L_before_})
    list->assign(model.bodies(), Vector3d::Zero());
  q_.assign(model.rotating(), Eigen::Quaterniond::Identity());
  angular_velocity_.assign(model.rotating(), Vector3d::Zero());
  turnings_.resize(model.rotating());
}

// ---- state at the start of the step

void ImplicitMotion::gather_state(const List<BodyState>& states,
                                  const EquationsOfMotion& equations) {
  engine::gather_state(equations.bodies(), states, &x_, &q_, &v_, &angular_velocity_);
}

void ImplicitMotion::scatter_state(const EquationsOfMotion& equations,
                                   List<BodyState>* states) const {
  engine::scatter_state(equations.bodies(), x_, q_, v_, angular_velocity_, states);
}

void ImplicitMotion::write_points(const ImplicitModel& model, Points* points) const {
  const auto bodies = static_cast<std::ptrdiff_t>(p_.size());
  points->position.assign(x_.begin(), x_.begin() + bodies);
  points->velocity.assign(v_.begin(), v_.begin() + bodies);
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const Matrix3d arms = model.radius_of_gyration(i) * q_[i].toRotationMatrix();
    for (int k = 0; k < 3; ++k) {
      points->position.push_back(x_[i] + arms.col(k));
      points->velocity.push_back(v_[i] + angular_velocity_[i].cross(arms.col(k)));
    }
  }
}

// ---- start of a step

void ImplicitMotion::predict(const ImplicitModel& model, const ImplicitTime& time) {
  time_ = time;
  const double h = time.h;
  for (std::size_t i = 0; i < p_.size(); ++i) {
    p_[i] = h * v_[i];
    if (!time.is_midpoint())
      p_[i] = dx_before_[i] / 3.0 + h / 9.0 * (8.0 * v_[i] - 2.0 * v_before_[i]);
    v_before_[i] = v_[i];
  }
  for (std::size_t i = 0; i < q_.size(); ++i) {
    Turning& turn = turnings_[i];
    turn.R0 = q_[i].toRotationMatrix();
    turn.J0 = turn.R0 * model.inertia(i).asDiagonal() * turn.R0.transpose();
    const Vector3d L = turn.J0 * angular_velocity_[i];
    if (time.is_midpoint()) {
      turn.a = 0.5 * h * angular_velocity_[i];
      turn.b = 0.5 * h * L;
    } else {
      turn.a = w_before_[i] / 3.0;
      turn.b = h / 9.0 * (8.0 * L - 2.0 * L_before_[i]);
    }
    L_before_[i] = L;
  }
}

void ImplicitMotion::place_fixed_points(const EquationsOfMotion& equations) {
  for (std::size_t p = p_.size(); p < x_.size(); ++p) x_[p] = equations.kinematics().position()[p];
}

void ImplicitMotion::set_end(const ImplicitModel& model, const EquationsOfMotion& equations) {
  for (std::size_t p = p_.size(); p < x_.size(); ++p)
    shift_[p] = equations.kinematics().position()[p] - x_[p];
  for (std::size_t i = 0; i < p_.size(); ++i) {
    force_[i] = model.mass(i) * equations.inputs().acceleration()[i];
    if (i < q_.size()) torque_[i] = equations.inputs().torque()[i];
  }
}

// ---- equations of the bodies

void ImplicitMotion::evaluate(const ImplicitModel& model, const List<double>& unknowns,
                              ImplicitSystem* system) {
  const double s = time_.s;
  ImplicitSystem::Entries entries = system->entries_of_bodies();
  for (std::size_t i = 0; i < p_.size(); ++i) {
    const std::size_t first = model.first_unknown(i);
    const ConstVector dx(unknowns.data() + first);
    system->residual_at(first) = model.mass(i) * (dx - p_[i]) - s * force_[i];
    for (int k = 0; k < 3; ++k) entries.add(1.0);
    if (i >= q_.size()) continue;

    Turning& turn = turnings_[i];
    const ConstVector w(unknowns.data() + first + 3);
    const Vector3d J_w = turn.J0 * (w - turn.a);
    turn.B = mean_rotation(w);
    turn.C = Matrix3d::Identity() - 0.5 * cross_matrix(w);
    system->set_torque(i, torque_[i]);
    system->residual_at(first + 3) = J_w + 0.5 * w.cross(J_w) - turn.C * (turn.b + s * torque_[i]);
    const Matrix3d derivative =
        (turn.J0 + 0.5 * (cross_matrix(w) * turn.J0 - cross_matrix(J_w + turn.b))) *
        system->scale_of(first + 3);
    for (int k = 0; k < 3; ++k)
      for (int m = 0; m < 3; ++m) entries.add(derivative(k, m));
  }
}

// ---- end of a step

void ImplicitMotion::finish(const ImplicitModel& model, const List<double>& unknowns) {
  // Velocity at the end from the change (Δx or w), the change of the previous step, and the
  // velocity at the start.
  const double h = time_.h;
  const auto rate = [&](const Vector3d& change, const Vector3d& before, const Vector3d& velocity) {
    if (time_.is_midpoint()) return Vector3d(2.0 / h * change - velocity);
    return Vector3d((1.5 * change - 0.5 * before) / h);
  };
  for (std::size_t i = 0; i < p_.size(); ++i) {
    const std::size_t first = model.first_unknown(i);
    const ConstVector dx(unknowns.data() + first);
    x_[i] += dx;
    v_[i] = rate(dx, dx_before_[i], v_[i]);
    dx_before_[i] = dx;
    if (i >= q_.size()) continue;
    const ConstVector w(unknowns.data() + first + 3);
    const Vector3d spin = rate(w, w_before_[i], angular_velocity_[i]);
    w_before_[i] = w;
    angular_velocity_[i] = spin + w.cross(mean_rotation(w) * spin);
    const Vector3d half = 0.5 * w;
    const Eigen::Quaterniond turn(1.0, half.x(), half.y(), half.z());
    q_[i] = (turn * q_[i]).normalized();
  }
}

}  // namespace constraint_sim::engine
