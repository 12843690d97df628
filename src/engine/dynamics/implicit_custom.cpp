// Custom constraints and forces in ImplicitStep. Their second derivatives are unknown; Newton's
// method uses central differences.

#include "engine/constraints/custom.h"
#include "engine/dynamics/implicit_step.h"
#include "engine/math/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;

constexpr double kDifference = 1e-6;  // [rad], and as a share of the length of d plus 1 m

/// Velocities of both ends of a joint.
struct Ends {
  std::array<Vector3d, 2> velocity{Vector3d::Zero(), Vector3d::Zero()}, spin = velocity;

  JointMotion motion(const JointVectors& v) const {
    BodyState a, b;
    a.linear_velocity = velocity[0];
    a.angular_velocity = spin[0];
    b.linear_velocity = velocity[1];
    b.angular_velocity = spin[1];
    return {v, a, b};
  }
};

}  // namespace

// Evaluates a custom row as evaluate_form() does. J is the discrete gradient where forces are taken
// at the middle of the step, else the gradient at the end.
void ImplicitStep::evaluate_custom_row(const Link& link, const JointVectors& start,
                                       const GeneralMotion& motion, double lambda,
                                       FormInStep* there) const {
  const auto J_at = [&](const JointVectors& end) {
    return share_ == 0.5 ? link.custom->discrete_gradient(start, end) : link.custom->jacobian(end);
  };
  there->J = J_at(motion.at_end);
  there->value = link.custom->value(motion.at_end);
  const FramePair gradient = link.custom->gradient(motion.at_end);
  const double size = 1.0 + motion.at_end.d.norm();
  for (std::size_t f = 0; f < 2; ++f) {
    const VectorSlopes& slopes = motion.slopes[f];
    const Eigen::Matrix3d& of_axes = f == 0 ? gradient.axes_A : gradient.axes_B;
    if (link.ends[f].dofs == 0) continue;
    there->gradient[f] = gradient.d.transpose() * slopes.d;
    for (int k = 0; k < 3; ++k)
      there->gradient[f] += of_axes.col(k).transpose() * slopes.axes[static_cast<std::size_t>(k)];
    for (int i = 0; lambda != 0.0 && i < link.ends[f].dofs; ++i) {
      const double step = i < 3 ? kDifference * size : kDifference;
      const Jacobian forth = J_at(displaced(motion, f, i, step));
      const Jacobian back = J_at(displaced(motion, f, i, -step));
      const double factor = lambda / (2.0 * step * share_);
      there->slopes[f].force.col(i) = factor * (forth.j3 - back.j3);
      there->slopes[f].torque_A.col(i) = factor * (forth.j2 - back.j2);
      there->slopes[f].torque_B.col(i) = factor * (forth.j4 - back.j4);
    }
  }
}

// Vectors at the end of the step after a change of component i of the displacement of end f.
JointVectors ImplicitStep::displaced(const GeneralMotion& motion, std::size_t f, int i,
                                     double step) {
  JointVectors vectors = motion.at_end;
  const VectorSlopes& slopes = motion.slopes[f];
  vectors.d += step * slopes.d.col(i);
  (f == 0 ? vectors.r_A : vectors.r_B) += step * slopes.arm.col(i);
  for (int k = 0; k < 3; ++k)
    (f == 0 ? vectors.axes_A : vectors.axes_B).col(k) +=
        step * slopes.axes[static_cast<std::size_t>(k)].col(i);
  return vectors;
}

void ImplicitStep::ask_custom_force(const Link& link, const EquationsOfMotion& equations,
                                    Shape* shape) const {
  for (std::size_t e = 0; e < 2; ++e) {
    const std::size_t point = link.ends[e].point;
    shape->fixed_velocity[e] = shape->fixed_spin[e] = Vector3d::Zero();
    if (link.ends[e].dofs > 0) continue;
    shape->fixed_velocity[e] = rule_ == ImplicitRule::kMidpoint
                                   ? Vector3d(shift_[point] / h_)
                                   : equations.kinematics().velocity()[point];
    shape->fixed_spin[e] = equations.inputs().fixed_angular_velocity(point);
  }
}

// Adds a custom force, with rates where forces are taken: Δx/h (midpoint) or (3 Δx − Δx₋)/2h
// (BDF2).
void ImplicitStep::add_custom_force(const Link& link, const Shape& shape,
                                    const GeneralMotion& motion, const JointVectors& start,
                                    const Unknowns& unknowns, GeneralForces* forces) const {
  const bool is_midpoint = rule_ == ImplicitRule::kMidpoint;
  const double of_step = (is_midpoint ? 1.0 : 1.5) / h_;
  Ends ends;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    ends.velocity[e] = shape.fixed_velocity[e];
    ends.spin[e] = shape.fixed_spin[e];
    if (end.dofs == 0) continue;  // velocity of the anchor, which has no arm here
    const double of_before = is_midpoint ? 0.0 : 0.5 / h_;
    ends.velocity[e] =
        of_step * ConstVector(unknowns.data() + end.unknown) - of_before * dx_before_[end.point];
    if (end.dofs < 6) continue;
    const ConstVector w(unknowns.data() + end.unknown + 3);
    const Vector3d spin = of_step * w - of_before * w_before_[end.point];
    ends.spin[e] = is_midpoint ? spin : Vector3d(spin + w.cross(mean_rotation(w) * spin));
  }
  const double t = t_ + share_ * h_;
  const auto wrench_at = [&](const JointVectors& at_end, const Ends& moves) {
    const JointVectors vectors = between(start, at_end, share_);
    return link.custom->wrench(t, vectors, moves.motion(vectors));
  };
  const Jacobian here = wrench_at(motion.at_end, ends);
  forces->force += here.j3;
  forces->torque[0] += here.j2;
  forces->torque[1] += here.j4;
  const double size = 1.0 + motion.at_end.d.norm();
  for (std::size_t f = 0; f < 2; ++f) {
    for (int i = 0; i < link.ends[f].dofs; ++i) {
      const double step = i < 3 ? kDifference * size : kDifference;
      const auto changed = [&](double by) {
        Ends moves = ends;
        (i < 3 ? moves.velocity[f] : moves.spin[f])[i % 3] += by * of_step;
        return wrench_at(displaced(motion, f, i, by), moves);
      };
      const Jacobian forth = changed(step), back = changed(-step);
      const double factor = 1.0 / (2.0 * step * share_);
      forces->slopes[f].force.col(i) += factor * (forth.j3 - back.j3);
      forces->slopes[f].torque_A.col(i) += factor * (forth.j2 - back.j2);
      forces->slopes[f].torque_B.col(i) += factor * (forth.j4 - back.j4);
    }
  }
}

}  // namespace constraint_sim::engine
