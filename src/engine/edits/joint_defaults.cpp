#include "engine/edits/joint_defaults.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/constraints/coupling.h"
#include "engine/constraints/distance.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/math/elementary.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kCoincident = 1e-9;  // anchors within this share of their coordinates coincide
// Sine of the angle below which axes are parallel: their common normal keeps nine digits or more
// beyond it, and nobody means a right angle within it.
constexpr double kParallelAxes = 1e-6;
// Share of the inverse mass along a coordinate that rounding leaves where the rows of the joint
// hold the coordinate.
constexpr double kHeldByRows = 1e-20;

// Refuses parallel axes that have to become perpendicular, since their direction of rotation would
// be undefined.
void check_apart(const Eigen::Quaterniond& frame_a, const Eigen::Quaterniond& frame_b,
                 const Vector3d& axis_b) {
  const Vector3d z_a = frame_a * Vector3d::UnitZ(), z_b = frame_b * Vector3d::UnitZ();
  if (z_a.cross(z_b).norm() < kParallelAxes)
    refuse("axis_b",
           "must not be along axis_a as the bodies lie, but at a right angle to it, got " +
               shown(axis_b));
}

/// J M⁻¹ Jᵀ of a row between two bodies.
double inverse_effective_mass(const Model& model, const State& state, const Jacobian& J,
                              std::size_t a, std::size_t b) {
  const auto turning = [&](std::size_t i, const Vector3d& j) {
    const Vector3d j_B = state.states[i].orientation.conjugate() * j;
    return j_B.dot(model.masses[i].inverse_inertia.cwiseProduct(j_B));
  };
  return model.masses[a].inverse_mass * J.j1.squaredNorm() + turning(a, J.j2) +
         model.masses[b].inverse_mass * J.j3.squaredNorm() + turning(b, J.j4);
}

/// Inverse effective mass along a coordinate, with the rows of the joint held: g W gᵀ with
/// W = M⁻¹ − M⁻¹Gᵀ(G M⁻¹ Gᵀ)⁻¹G M⁻¹.
double inverse_effective_mass(const Model& model, const State& state, const Joint& joint,
                              int coordinate) {
  const std::size_t a = model.index(joint.body_a), b = model.index(joint.body_b);
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, state.states[a], state.states[b]);
  using Row = Eigen::Matrix<double, 1, 12>;
  const int rows = kind.rows + (info(joint.kind).has_pitch ? 1 : 0);
  Eigen::Matrix<double, Eigen::Dynamic, 12> G(rows + 1, 12);  // G M^(-1/2), and g M^(-1/2)
  for (int k = 0; k <= rows; ++k) {
    const int function = k < rows ? k : kind.rows + coordinate;
    Jacobian J = jacobian(kind.function[static_cast<std::size_t>(function)], vectors);
    if (k == kind.rows && k < rows)
      J = combined(1.0, jacobian(kind.coordinate[0], vectors), -lead(joint),
                   jacobian(kind.coordinate[1], vectors));
    const auto turned = [&](std::size_t i, const Vector3d& j) -> Vector3d {
      return (state.states[i].orientation.conjugate() * j)
          .cwiseProduct(model.masses[i].inverse_inertia.cwiseSqrt());
    };
    Row row;
    row << std::sqrt(model.masses[a].inverse_mass) * J.j1.transpose(), turned(a, J.j2).transpose(),
        std::sqrt(model.masses[b].inverse_mass) * J.j3.transpose(), turned(b, J.j4).transpose();
    G.row(k) = row;
  }
  const Row g = G.row(rows);
  if (rows == 0) return g.squaredNorm();
  LeastNormSolver held;
  Eigen::Map<Eigen::Matrix<double, 12, 12>> columns(held.resize(12));
  columns.setZero();
  columns.leftCols(rows) = G.topRows(rows).transpose();
  held.factor(12.0 * std::numeric_limits<double>::epsilon());
  Row part = g;
  held.solve(part.data());
  Row rest = g;
  for (int k = 0; k < rows; ++k) rest -= part[k] * G.row(k);
  const double left = rest.squaredNorm();
  return left > kHeldByRows * g.squaredNorm() ? left : 0.0;
}

/// Fills in frame B where it is left out, from the present poses of the bodies.
void fill_in_frames(const Model& model, const State& state, Joint* joint) {
  const JointForms& kind = forms(joint->kind);
  if (!kind.has_frames) {
    joint->frame_a.setIdentity();
    joint->frame_b.reset();
    return;
  }
  const BodyState& a = state.states[model.index(joint->body_a)];
  const BodyState& b = state.states[model.index(joint->body_b)];
  make_unit(&joint->frame_a);
  if (!joint->frame_b) {
    joint->frame_b =
        b.orientation.conjugate() * a.orientation * joint->frame_a * home(kind.alignment);
    if (joint->axis_b) {
      const Vector3d& axis = *joint->axis_b;
      const Eigen::Quaterniond along = frame_along(
          joint->frame_b->conjugate() * (axis / math::hypot(axis.x(), axis.y(), axis.z())));
      joint->frame_b = *joint->frame_b * along;
    }
  }
  make_unit(&*joint->frame_b);
  if (joint->axis_b && kind.alignment == Alignment::kPerpendicularZ)
    check_apart(a.orientation * joint->frame_a, b.orientation * *joint->frame_b, *joint->axis_b);
  joint->axis_b.reset();
}

}  // namespace

void clear_unused(Joint* joint) {
  if (!has_length(joint->kind)) joint->distance = DistanceJoint{};
  if (!info(joint->kind).has_pitch) joint->pitch = 0.0;
  if (!info(joint->kind).is_custom) joint->custom = CustomElement{};
  if (info(joint->kind).couples_joints) return;
  const std::optional<double> value = joint->coupling.value;
  joint->coupling = Coupling{};
  if (info(joint->kind).has_pitch) joint->coupling.value = value;
}

void fill_in(const Model& model, const State& state, Joint* joint) {
  clear_unused(joint);
  auto* distance = if_distance(*joint);
  if (distance == nullptr) {
    fill_in_frames(model, state, joint);
    set_zeros(model, state, joint);
    fill_in_laws(model, state, joint);
    return;
  }
  joint->frame_a.setIdentity();
  joint->frame_b.reset();
  const std::size_t a = model.index(joint->body_a);
  const std::size_t b = model.index(joint->body_b);
  const AnchorPair anchors(*joint, state.states[a], state.states[b]);

  if (!is_between_limits(*distance) && !distance->length) {
    const double size = std::max({anchors.p_A.norm(), anchors.r_A.norm(), anchors.r_B.norm()});
    const double present = anchors.d.norm();
    distance->length = present <= kCoincident * size ? 0.0 : present;
  }
  if (distance->length == 0.0 && !distance->is_soft()) {
    joint->kind = kKindOfLengthZero;
    joint->distance = DistanceJoint{};
  } else if (distance->frequency > 0.0) {
    const Jacobian J = anchors.along(direction(anchors));
    const double constraint_mass = inverse_effective_mass(model, state, J, a, b);
    const double omega = 2.0 * kPi * distance->frequency;
    distance->stiffness = omega * omega / constraint_mass;
    distance->damping = 2.0 * distance->damping_ratio * omega / constraint_mass;
    distance->frequency = distance->damping_ratio = 0.0;
  }
  validate(*joint);  // a ball joint has no motor, and constants may be too large
}

void set_zeros(const Model& model, const State& state, Joint* joint) {
  const JointForms& kind = forms(joint->kind);
  const std::size_t a = model.index(joint->body_a), b = model.index(joint->body_b);
  const double radius =
      std::max(model.masses[a].radius_of_gyration(), model.masses[b].radius_of_gyration());
  const JointVectors vectors(*joint, state.states[a], state.states[b],
                             frame_where_met(*joint, state.states[a], state.states[b], radius));
  for (std::size_t i = 0; i < static_cast<std::size_t>(kind.coordinates); ++i) {
    CoordinateLaw& law = joint->coordinates[i];
    if (law.position) law.zero = *law.position - value(kind.coordinate[i], vectors);
    law.position.reset();
  }
}

void fill_in_laws(const Model& model, const State& state, Joint* joint) {
  bool is_changed = false;
  for (int i = 0; i < info(joint->kind).coordinates; ++i) {
    CoordinateLaw& law = joint->coordinates[static_cast<std::size_t>(i)];
    const bool is_servo = law.motor && law.motor->servo_frequency > 0.0;
    if (law.frequency == 0.0 && !is_servo) continue;
    is_changed = true;
    const double inverse_mass = inverse_effective_mass(model, state, *joint, i);
    if (!(inverse_mass > 0.0))
      refuse(law.frequency > 0.0 ? "frequency" : "servo_frequency",
             "nothing can move along this coordinate of " + in_quotes(joint->name));
    const auto set = [&](double frequency, double ratio, double* stiffness, double* damping) {
      const double omega = 2.0 * kPi * frequency;
      *stiffness = omega * omega / inverse_mass;
      *damping = 2.0 * ratio * omega / inverse_mass;
    };
    if (is_servo) {
      Motor& motor = *law.motor;
      set(motor.servo_frequency, motor.servo_damping_ratio, &motor.servo_stiffness,
          &motor.servo_damping);
      motor.servo_frequency = 0.0;
      motor.servo_damping_ratio = 1.0;
    }
    if (law.frequency == 0.0) continue;
    set(law.frequency, law.damping_ratio, &law.stiffness, &law.damping);
    law.frequency = law.damping_ratio = 0.0;
  }
  if (is_changed) validate(*joint);  // constants may be too large
}

}  // namespace constraint_sim::engine
