#include "engine/dynamics/implicit/form_in_step.h"

#include <cmath>

#include "engine/constraints/custom_code.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

void add_slopes(const JointInStep& joint, const RowForm& row, double weight, std::size_t f,
                JacobianSlopes* slopes) {
  JacobianSlopes slope;
  slope.add(row.u, row.v, joint.at_force, joint.slopes[f], f);
  slope.add(row.v, row.u, joint.at_force, joint.slopes[f], f);
  slopes->add(weight, slope);
}

Gradient gradient_of(const JointInStep& joint, const RowForm& row, std::size_t f) {
  const VectorSlopes& slopes = joint.slopes[f];
  return joint.at_end[row.v].transpose() * slopes.of(row.u, f) +
         joint.at_end[row.u].transpose() * slopes.of(row.v, f);
}

}  // namespace

FormInStep::FormInStep(const ScalarForm& form, const JointInStep& joint, double lambda) {
  if (form.is_length)
    set_length(form.product, joint, lambda);
  else if (form.is_angle)
    set_angle(form.angle, joint, lambda);
  else if (form.product.is_custom())
    set_custom(joint, lambda);
  else
    set_product(form.product, joint, lambda);
}

double FormInStep::end_of(const ScalarForm& form, const JointInStep& joint, double start) const {
  return form.is_angle ? start + value : start + value - engine::value(form, joint.at_start);
}

void FormInStep::set_length(const RowForm& square, const JointInStep& joint, double lambda) {
  // Discrete gradient Ḡ = ∇̄(½ d·d)/ℓ̄.
  const double end_length = joint.at_end.d.norm();
  const double length = (1.0 - joint.share) * joint.at_start.d.norm() + joint.share * end_length;
  const Vector3d n =
      end_length > 0.0 ? Vector3d(joint.at_end.d / end_length) : Vector3d(Vector3d::UnitX());
  if (length > 0.0) J = combined(1.0 / length, jacobian(square, joint.at_force), 0.0, {});
  value = end_length;
  for (std::size_t f = 0; f < 2; ++f) {
    if (joint.dofs[f] == 0) continue;
    gradient[f] = n.transpose() * joint.slopes[f].d;
    if (length == 0.0) continue;
    add_slopes(joint, square, 0.5 * lambda / length, f, &slopes[f]);
    slopes[f].add(J, -lambda / length * gradient[f]);
  }
}

void FormInStep::set_product(const RowForm& form, const JointInStep& joint, double lambda) {
  J = jacobian(form, joint.at_force);
  value = engine::value(form, joint.at_end);
  for (std::size_t f = 0; f < 2; ++f) {
    if (joint.dofs[f] == 0) continue;
    add_slopes(joint, form, lambda, f, &slopes[f]);
    gradient[f] = gradient_of(joint, form, f);
  }
}

void FormInStep::set_angle(const AngleForm& form, const JointInStep& joint, double lambda) {
  // Discrete gradient Ḡ = κ (c̄ ∇̄s − s̄ ∇̄c); all factors are taken at the end where forces are.
  const CosineAndSine<double> end = values(form, joint.at_end);
  const CosineAndSine<double> first = joint.share == 0.5 ? values(form, joint.at_start) : end;
  const CosineAndSine<Jacobian> factor = jacobians(form, joint.at_force);
  const AngleStep step(first, end);
  const double c = first.c + joint.share * (end.c - first.c),
               s = first.s + joint.share * (end.s - first.s);
  const Jacobian direction = combined(c, factor.s, -s, factor.c);
  J = combined(step.kappa, direction, 0.0, direction);
  const AngleStep whole(values(form, joint.at_start), end);
  value = whole.change;
  // Derivatives of κ = 1/(c² + s²) where forces are taken at the end.
  const double kappa_c = joint.share == 0.5 ? step.kappa_c : -2.0 * end.c * step.kappa * step.kappa;
  const double kappa_s = joint.share == 0.5 ? step.kappa_s : -2.0 * end.s * step.kappa * step.kappa;
  for (std::size_t f = 0; f < 2; ++f) {
    if (joint.dofs[f] == 0) continue;
    Gradient of_c = Gradient::Zero(), of_s = of_c;
    for (const AngleForm::Term& term : form.c)
      if (term.weight != 0.0) of_c += term.weight * gradient_of(joint, term.form, f);
    for (const AngleForm::Term& term : form.s)
      if (term.weight != 0.0) of_s += term.weight * gradient_of(joint, term.form, f);
    gradient[f] = whole.change_c * of_c + whole.change_s * of_s;
    JacobianSlopes& of_J = slopes[f];
    of_J.add(direction, (lambda / joint.share) * (kappa_c * of_c + kappa_s * of_s));
    for (const AngleForm::Term& term : form.s)
      if (term.weight != 0.0)
        add_slopes(joint, term.form, lambda * step.kappa * c * term.weight, f, &of_J);
    for (const AngleForm::Term& term : form.c)
      if (term.weight != 0.0)
        add_slopes(joint, term.form, -lambda * step.kappa * s * term.weight, f, &of_J);
    of_J.add(factor.s, lambda * step.kappa * of_c);
    of_J.add(factor.c, -lambda * step.kappa * of_s);
  }
}

// J is the discrete gradient where forces are taken at the middle of the step, else the gradient at
// the end. Second derivatives of custom code are unknown; Newton's method uses central differences.
void FormInStep::set_custom(const JointInStep& joint, double lambda) {
  const CustomCode& custom = *joint.at_end.custom;
  const auto J_at = [&](const JointVectors& end) {
    return joint.share == 0.5 ? custom.discrete_gradient(joint.at_start, end)
                              : custom.jacobian(end);
  };
  J = J_at(joint.at_end);
  value = custom.value(joint.at_end);
  const FramePair by_frame = custom.gradient(joint.at_end);
  const double size = 1.0 + joint.at_end.d.norm();
  for (std::size_t f = 0; f < 2; ++f) {
    const VectorSlopes& vectors = joint.slopes[f];
    const Eigen::Matrix3d& of_axes = f == 0 ? by_frame.axes_A : by_frame.axes_B;
    if (joint.dofs[f] == 0) continue;
    gradient[f] = by_frame.d.transpose() * vectors.d;
    for (int k = 0; k < 3; ++k)
      gradient[f] += of_axes.col(k).transpose() * vectors.axes[static_cast<std::size_t>(k)];
    for (int i = 0; lambda != 0.0 && i < joint.dofs[f]; ++i) {
      const double step = i < 3 ? kCustomDifference * size : kCustomDifference;
      const Jacobian forth = J_at(joint.displaced(f, i, step));
      const Jacobian back = J_at(joint.displaced(f, i, -step));
      const double factor = lambda / (2.0 * step * joint.share);
      slopes[f].add_difference(i, factor, forth, back);
    }
  }
}

}  // namespace constraint_sim::engine
