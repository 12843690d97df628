#include "engine/dynamics/implicit/custom_force_in_step.h"

#include "engine/constraints/custom_code.h"
#include "engine/dynamics/implicit/form_in_step.h"
#include "engine/math/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;

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

void add_custom_force(const ImplicitLink& link, const LinkInStep& state, const JointInStep& joint,
                      const ImplicitMotion& motion, const List<double>& unknowns,
                      GeneralForces* forces) {
  const ImplicitTime& time = motion.time();
  const bool is_midpoint = time.is_midpoint();
  const double of_step = (is_midpoint ? 1.0 : 1.5) / time.h;
  Ends ends;
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    ends.velocity[e] = state.fixed_velocity[e];
    ends.spin[e] = state.fixed_spin[e];
    if (end.dofs == 0) continue;  // velocity of the anchor, which has no arm here
    const double of_before = is_midpoint ? 0.0 : 0.5 / time.h;
    ends.velocity[e] = of_step * ConstVector(unknowns.data() + end.unknown) -
                       of_before * motion.dx_before(end.point);
    if (end.dofs < 6) continue;
    const ConstVector w(unknowns.data() + end.unknown + 3);
    const Vector3d spin = of_step * w - of_before * motion.w_before(end.point);
    ends.spin[e] = is_midpoint ? spin : Vector3d(spin + w.cross(mean_rotation(w) * spin));
  }
  const double t = time.t + joint.share * time.h;
  const auto wrench_at = [&](const JointVectors& at_end, const Ends& moves) {
    const JointVectors vectors = between(joint.at_start, at_end, joint.share);
    return link.custom->wrench(t, vectors, moves.motion(vectors));
  };
  const Jacobian here = wrench_at(joint.at_end, ends);
  forces->force += here.j3;
  forces->torque[0] += here.j2;
  forces->torque[1] += here.j4;
  const double size = 1.0 + joint.at_end.d.norm();
  for (std::size_t f = 0; f < 2; ++f) {
    for (int i = 0; i < link.ends[f].dofs; ++i) {
      const double step = i < 3 ? kCustomDifference * size : kCustomDifference;
      const auto changed = [&](double by) {
        Ends moves = ends;
        (i < 3 ? moves.velocity[f] : moves.spin[f])[i % 3] += by * of_step;
        return wrench_at(joint.displaced(f, i, by), moves);
      };
      const Jacobian forth = changed(step), back = changed(-step);
      const double factor = 1.0 / (2.0 * step * joint.share);
      forces->slopes[f].add_difference(i, factor, forth, back);
    }
  }
}

}  // namespace constraint_sim::engine
