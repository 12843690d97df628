#include "engine/dynamics/implicit/link_in_step.h"

#include <cmath>

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Kind = ImplicitLink::Kind;

}  // namespace

// ---- start of the step

void LinkInStep::place(const ImplicitLink& link, const ImplicitModel& model,
                       const ImplicitMotion& motion, const EquationsOfMotion& equations) {
  custom = link.custom;
  d0 = motion.positions()[link.ends[1].point] - motion.positions()[link.ends[0].point];
  // Inverse of the displacement by 1 N, or of a rod by λ = 1.
  double displacement = 0.0;
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    r0[e].setZero();
    if (end.dofs == 6) {
      const bool is_frame = e == 1 && link.kind == Kind::kGeneral;
      r0[e] = motion.turning(end.point).R0 *
              (is_frame ? equations.inputs().frame_b(link.index).anchor : end.anchor);
      d0 += end.sign * r0[e];
    }
    if (end.dofs > 0) displacement += 1.0 / model.mass(end.point);
    if (end.dofs == 6) displacement += r0[e].squaredNorm() / model.inertia(end.point).mean();
  }
  scale = 1.0 / std::sqrt(displacement);
  // Part of the spring's law at the start; set_spring() adds the rest.
  if (link.kind == Kind::kSpring) target = equations.inputs().length()[link.index].value;
  if (link.kind == Kind::kRod) scale /= d0.norm();
  is_left_out = is_redundant = {};
  if (link.kind != Kind::kGeneral) return;
  place_axes(link, motion, equations, &axes0);
  const JointVectors vectors = start();
  for (int k = 0; k < link.rows; ++k) {
    const double response = model.response(
        link, jacobian(forms(link.joint).function[link.function[to_index(k)]], vectors));
    row_scale[k] = response > 0.0 ? 1.0 / std::sqrt(response) : 1.0;
  }
}

// Axes of both ends, with bodies at the start of the step and fixed points at the current time.
void LinkInStep::place_axes(const ImplicitLink& link, const ImplicitMotion& motion,
                            const EquationsOfMotion& equations,
                            std::array<Matrix3d, 2>* axes) const {
  if (!info(link.joint).has_frames) return;
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    const Matrix3d& frame = e == 0 ? link.frames[0] : equations.inputs().frame_b(link.index).axes;
    (*axes)[e] = frame;
    if (end.dofs == 6) (*axes)[e] = motion.turning(end.point).R0 * frame;
    if (end.dofs == 0) (*axes)[e] = equations.inputs().fixed_axes(end.point) * frame;
  }
}

// ---- targets at the end of the step

void LinkInStep::set_target(const ImplicitLink& link, const ImplicitMotion& motion,
                            const EquationsOfMotion& equations, List<SoftInStep>* softs) {
  if (link.kind == Kind::kGeneral) {
    place_axes(link, motion, equations, &axes1);
    next_axes_B = axes1[1];
    const ImplicitEnd& b = link.ends[1];
    next_r_B = r0[1];
    if (b.dofs == 6)
      next_r_B = motion.turning(b.point).R0 * equations.inputs().frame_b(link.index).anchor;
  }
  if (link.has_custom_force) set_fixed_velocities(link, motion, equations);
  switch (link.kind) {
    case Kind::kBall:
    case Kind::kGeneral:
      offset = equations.inputs().offset(equations, link.index);
      if (link.rows > link.rigid_rows) set_softs(link, motion.time(), equations, softs);
      break;
    case Kind::kRod: {
      const double length = equations.inputs().length()[link.index].value;
      target = 0.5 * length * length;
      break;
    }
    case Kind::kSpring:
      set_spring(link, motion.time(), equations.inputs().length()[link.index]);
      break;
  }
}

// Sets target and compliance of a spring from the law of its force σ, where σ > 0 pushes the
// anchors apart. s = ‖d‖ and ℓ, the natural length, are taken at the start (₀), at the end (₁) and
// one step earlier (₋) of a step h; k: stiffness, c: damping.
//   midpoint: σ = −k (½(s₀ + s₁) − ½(ℓ₀ + ℓ₁)) − (c/h)(s₁ − s₀ − (ℓ₁ − ℓ₀))
//   BDF2:     σ = −k (s₁ − ℓ₁) − (c/2h)(3 s₁ − 4 s₀ + s₋) + c ℓ̇₁
// Solved for s₁ the law is s₁ + compliance σ = target. On entry target is ℓ₀, from place().
void LinkInStep::set_spring(const ImplicitLink& link, const ImplicitTime& time,
                            const Prescribed& length) {
  const double k = link.stiffness;
  const double rate = link.damping / time.h;
  const double s0 = d0.norm();
  if (time.is_midpoint()) {
    compliance = 1.0 / (0.5 * k + rate);
    target = length.value - compliance * (0.5 * k - rate) * (s0 - target);
  } else {
    compliance = 1.0 / (k + 1.5 * rate);
    target = compliance *
             (k * length.value + link.damping * length.rate + rate * (2.0 * s0 - 0.5 * before));
  }
  before = s0;
  scale = 1.0 / std::sqrt(1.0 / (scale * scale) + std::abs(compliance) / time.s);
}

// Computes given λ + taken q₁ = target from the laws of soft rows. The coordinate q is taken at the
// start (₀), at the end (₁) and one step earlier (₋) of a step h; K, R, C, F are of SoftLaw, and λ
// is the force along q.
//   midpoint: λ = −K (½(q₀ + q₁) − R) − (C/h)(q₁ − q₀) + F
//   BDF2:     λ = −K (q₁ − R) − (C/2h)(3 q₁ − 4 q₀ + q₋) + F
// Each law is divided by its factor of q₁ plus the inertia of the row over ImplicitTime::s.
void LinkInStep::set_softs(const ImplicitLink& link, const ImplicitTime& time,
                           const EquationsOfMotion& equations, List<SoftInStep>* softs) const {
  const JointVectors vectors = start();
  for (int k = link.rigid_rows; k < link.rows; ++k) {
    const EquationsOfMotion::SoftCoordinate& from = equations.soft_coordinates()[link.soft_of(k)];
    const SoftLaw& law = from.law;
    SoftInStep& soft = (*softs)[link.soft_of(k)];
    const double q_before = soft.start;
    soft.start = soft.end = reading(from.form, value(from.form, vectors), from.zero,
                                    equations.coordinates().soft(link.soft_of(k)));
    const double rate = law.C / time.h;
    double of_q1 = 0.5 * law.K + rate, rest = (rate - 0.5 * law.K) * soft.start;
    if (!time.is_midpoint()) {
      of_q1 = law.K + 1.5 * rate;
      rest = rate * (2.0 * soft.start - 0.5 * q_before);
    }
    const double factor = of_q1 + row_scale[k] * row_scale[k] / time.s;
    soft.given = 1.0 / factor;
    soft.taken = of_q1 / factor;
    soft.target = (law.K * law.R + rest + law.F) / factor;
  }
}

void LinkInStep::set_fixed_velocities(const ImplicitLink& link, const ImplicitMotion& motion,
                                      const EquationsOfMotion& equations) {
  for (std::size_t e = 0; e < 2; ++e) {
    const std::size_t point = link.ends[e].point;
    fixed_velocity[e] = fixed_spin[e] = Vector3d::Zero();
    if (link.ends[e].dofs > 0) continue;
    fixed_velocity[e] = motion.time().is_midpoint()
                            ? Vector3d(motion.shift(point) / motion.time().h)
                            : equations.kinematics().velocity()[point];
    fixed_spin[e] = equations.inputs().fixed_angular_velocity(point);
  }
}

}  // namespace constraint_sim::engine
