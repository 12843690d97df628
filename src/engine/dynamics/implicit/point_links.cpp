#include "engine/dynamics/implicit/point_links.h"

#include <array>
#include <cmath>

#include "engine/math/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;

void note_row(const LinkInStep& state, int k, double error, ImplicitSystem* system) {
  if (!state.is_redundant[to_index(k)]) system->note_row(error, !state.is_in(k));
}

/// Motion of a rod, ball joint or spring in the step.
struct PointMotion {
  Vector3d d1;                  ///< d at the end of the step
  std::array<Vector3d, 2> arm;  ///< arms where forces are taken
  /// Derivative of d at the end of the step, without the sign of the body's end.
  std::array<Eigen::Matrix<double, 3, 6>, 2> E;
};

/// Force on B with its derivatives by d and λ; values of the rows with their derivative by d1.
struct PointForce {
  Matrix3d P = Matrix3d::Zero();
  /// Columns per row; one column for rods and springs.
  Matrix3d pull = Matrix3d::Identity(), gradient = pull;
  Vector3d value;
};

PointMotion motion_of(const ImplicitLink& link, const ImplicitMotion& motion,
                      const List<double>& unknowns, LinkInStep* state) {
  PointMotion at;
  const double share = motion.time().share;
  Vector3d change = Vector3d::Zero();  // change of d
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    if (end.dofs == 0) {
      change += end.sign * motion.shift(end.point);
      continue;
    }
    const auto first = to_index(end.unknown);
    change += end.sign * ConstVector(unknowns.data() + first);
    at.E[e].leftCols<3>().setIdentity();
    if (end.dofs < 6) continue;
    const ImplicitMotion::Turning& turn = motion.turning(end.point);
    const Vector3d mean_arm = turn.B * state->r0[e];
    const Vector3d arm_change = ConstVector(unknowns.data() + first + 3).cross(mean_arm);
    change += end.sign * arm_change;
    at.arm[e] = state->r0[e] + share * arm_change;
    at.E[e].rightCols<3>() = -turn.B * cross_matrix(mean_arm);
  }
  at.d1 = state->d0 + change;
  state->d = state->d0 + share * change;
  return at;
}

PointForce force_of(const ImplicitLink& link, const Vector3d& d1, double share,
                    const List<double>& unknowns, LinkInStep* state, ImplicitSystem* system) {
  PointForce at_link;
  auto& [P, pull, gradient, value] = at_link;
  const Vector3d& d = state->d;
  const double compliance = state->compliance;
  const double lambda = unknowns[link.unknown];
  switch (link.kind) {
    case ImplicitLink::Kind::kRod:
      state->force = lambda * d;
      P.diagonal().setConstant(lambda);
      pull.col(0) = d;
      gradient.col(0) = d1;
      value[0] = 0.5 * d1.squaredNorm() - state->target + compliance * lambda;
      note_row(*state, 0, std::abs(value[0]) / std::sqrt(2.0 * state->target), system);
      break;
    case ImplicitLink::Kind::kBall:
      for (int k = 0; k < 3; ++k)
        state->force[k] = state->is_in(k) ? unknowns[link.unknown + k] : 0.0;
      value = d1 - state->offset.head<3>() + compliance * state->force;
      for (int k = 0; k < 3; ++k) note_row(*state, k, std::abs(value[k]), system);
      break;
    case ImplicitLink::Kind::kGeneral:
      break;  // has rows of its own
    case ImplicitLink::Kind::kSpring: {
      const double s1 = d1.norm();
      const double s = (1.0 - share) * state->d0.norm() + share * s1;
      const Vector3d n1 = s1 > 0.0 ? Vector3d(d1 / s1) : Vector3d(Vector3d::UnitX());
      const Vector3d n = s > 0.0 ? Vector3d(d / s) : Vector3d(Vector3d::UnitX());
      state->force = lambda * n;
      if (s > 0.0) P = lambda / s * (Matrix3d::Identity() - n * n1.transpose());
      pull.col(0) = n;
      gradient.col(0) = n1;
      value[0] = compliance * lambda + s1 - state->target;
      break;
    }
  }
  if (link.kind == ImplicitLink::Kind::kRod && !state->is_in(0)) {
    state->force.setZero();
    P.setZero();
  }
  return at_link;
}

// Adds the force to the equations of the bodies. Returns its effect per end, [1; C r ×].
std::array<Eigen::Matrix<double, 6, 3>, 2> add_force(const ImplicitLink& link,
                                                     const ImplicitMotion& motion,
                                                     const PointMotion& at, const Vector3d& force,
                                                     ImplicitSystem* system) {
  const double s = motion.time().s;
  std::array<Eigen::Matrix<double, 6, 3>, 2> H;
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    if (end.dofs == 0) continue;
    H[e].topRows<3>().setIdentity();
    system->residual_at(to_index(end.unknown)) -= s * end.sign * force;
    if (end.dofs < 6) continue;
    H[e].bottomRows<3>() = motion.turning(end.point).C * cross_matrix(at.arm[e]);
    system->residual_at(to_index(end.unknown) + 3) -= s * end.sign * (H[e].bottomRows<3>() * force);
    system->add_torque(end.point, end.sign * at.arm[e].cross(force));
  }
  return H;
}

// Adds the derivatives of the force on end e by the displacements of both ends.
void write_block(const ImplicitLink& link, std::size_t e, const ImplicitMotion& motion,
                 const PointMotion& at, const Matrix3d& P, const Eigen::Matrix<double, 6, 3>& H,
                 const Vector3d& force, const ImplicitSystem& system,
                 ImplicitSystem::Entries* entries) {
  const double s = motion.time().s, share = motion.time().share;
  const ImplicitEnd& row = link.ends[e];
  const double* const left = system.left(row.unknown);
  for (std::size_t f = 0; f < 2; ++f) {
    const ImplicitEnd& column = link.ends[f];
    if (column.dofs == 0) continue;
    Eigen::Matrix<double, 6, 6> K = Eigen::Matrix<double, 6, 6>::Zero();
    // The force of a ball joint does not depend on the positions of its ends.
    if (link.kind != ImplicitLink::Kind::kBall) {
      Eigen::Matrix<double, 3, 6> PE = Eigen::Matrix<double, 3, 6>::Zero();
      PE.leftCols<3>() = P;
      if (column.dofs == 6) PE.rightCols<3>() = P * at.E[f].rightCols<3>();
      const double weight = -s * share * row.sign * column.sign;
      K.topRows<3>() = weight * PE;
      if (row.dofs == 6) K.bottomRows<3>().noalias() = weight * H.bottomRows<3>() * PE;
    }
    if (e == f && row.dofs == 6)
      K.bottomRightCorner<3, 3>() += (s * share * row.sign) * motion.turning(row.point).C *
                                     cross_matrix(force) * at.E[e].rightCols<3>();
    const double* const right = system.right(column.unknown);
    for (int i = 0; i < row.dofs; ++i)
      for (int j = 0; j < column.dofs; ++j) entries->add(left[i] * K(i, j) * right[j]);
  }
}

// Evaluates a rod whose ends do not rotate; a fast path of evaluate_point_link().
void evaluate_rod(const ImplicitLink& link, const ImplicitMotion& motion,
                  const List<double>& unknowns, LinkInStep* state, ImplicitSystem* system) {
  const double s = motion.time().s, share = motion.time().share;
  Vector3d change = Vector3d::Zero();
  for (const ImplicitEnd& end : link.ends)
    change += end.sign * (end.dofs > 0 ? Vector3d(ConstVector(unknowns.data() + end.unknown))
                                       : motion.shift(end.point));
  const Vector3d d1 = state->d0 + change;
  state->d = state->d0 + share * change;
  const bool is_in = state->is_in(0);
  const double lambda = is_in ? unknowns[link.unknown] : 0.0;
  state->force = lambda * state->d;
  const double value = 0.5 * d1.squaredNorm() - state->target + state->compliance * lambda;
  note_row(*state, 0, std::abs(value) / std::sqrt(2.0 * state->target), system);

  const double scale = is_in ? state->scale : 0.0;
  ImplicitSystem::Entries entries = system->entries_of_link(link.index);
  for (const ImplicitEnd& row : link.ends) {
    if (row.dofs == 0) continue;
    const double left = *system->left(row.unknown);
    for (const ImplicitEnd& column : link.ends) {
      if (column.dofs == 0) continue;
      const double K =
          -share * s * row.sign * column.sign * lambda * left * *system->right(column.unknown);
      for (int k = 0; k < 3; ++k) entries.add(K);
    }
    const double weight = row.sign * left * scale;
    for (int k = 0; k < 3; ++k) {
      entries.add(-weight * state->d[k]);
      entries.add(weight * d1[k]);
    }
    system->residual_at(to_index(row.unknown)) -= (s * row.sign) * state->force;
  }
  entries.add(is_in ? scale * state->compliance * *system->right(link.unknown) : 1.0);
  system->set_residual(link.unknown, is_in ? value : 0.0);
}

}  // namespace

void evaluate_point_link(const ImplicitLink& link, const ImplicitMotion& motion,
                         const List<double>& unknowns, LinkInStep* state, ImplicitSystem* system) {
  if (link.is_between_points) return evaluate_rod(link, motion, unknowns, state, system);
  const PointMotion at = motion_of(link, motion, unknowns, state);
  const auto& [P, pull, gradient, value] =
      force_of(link, at.d1, motion.time().share, unknowns, state, system);
  const auto H = add_force(link, motion, at, state->force, system);
  ImplicitSystem::Entries entries = system->entries_of_link(link.index);
  const double scale = state->scale;
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& row = link.ends[e];
    if (row.dofs == 0) continue;
    write_block(link, e, motion, at, P, H[e], state->force, *system, &entries);
    const double* const left = system->left(row.unknown);
    const double* const right = system->right(row.unknown);
    for (int i = 0; i < row.dofs; ++i) {
      for (int k = 0; k < link.rows; ++k) {
        // s of the column cancels 1/s of its scale.
        const double column = -row.sign * H[e].row(i).dot(pull.col(k));
        const double entry = row.sign * gradient.col(k).dot(at.E[e].col(i));
        entries.add(state->is_in(k) ? left[i] * column * scale : 0.0);
        entries.add(state->is_in(k) ? scale * entry * right[i] : 0.0);
      }
    }
  }
  for (int k = 0; k < link.rows; ++k) {
    const double diagonal = scale * state->compliance * *system->right(link.unknown);
    entries.add(state->is_in(k) ? diagonal : 1.0);
    system->set_residual(link.unknown + k, state->is_in(k) ? value[k] : 0.0);
  }
}

}  // namespace constraint_sim::engine
