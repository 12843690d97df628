#pragma once

// References of mechanisms with gears, racks, screws and pulleys: bodies, joints, couplings of
// their coordinates, and final poses.

#include "mechanisms.h"

namespace constraint_sim::engine::mechanisms {

enum class CoordinateOf { kAngle, kTranslation, kLength };

/// A condition Σ ratio · coordinate = its initial value, over coordinates of the mechanism's
/// joints.
struct Coupling {
  struct Term {
    std::size_t joint = 0;  ///< index into Mechanism::joints
    CoordinateOf of = CoordinateOf::kAngle;
    double ratio = 1.0;
  };
  std::vector<Term> terms;
};

struct CoupledMechanism {
  Mechanism mechanism;
  std::vector<Coupling> couplings;
};

/// Carrier, planet and sun in a fixed ring; sun, planet and ring have 12, 24 and 60 teeth. Released
/// with the carrier level, gravity swings the carrier about y. The coordinate is the carrier's
/// angle.
inline CoupledMechanism planetary_gear(int steps = 384) {
  const double sun_teeth = 12.0, planet_teeth = 24.0, ring_teeth = 60.0, arm = 0.36;
  CoupledMechanism made;
  Mechanism& mechanism = made.mechanism;
  mechanism.name = "planetary gear";
  mechanism.duration = 3.0;
  mechanism.bodies = {bar("carrier", 0.5, {0.4, 0.02, 0.1}), bar("planet", 1.0, {0.24, 0.05, 0.24}),
                      bar("sun", 0.7, {0.12, 0.05, 0.12})};
  const auto poses = [=](const Jet& theta) {
    // Angles are relative to the carrier, to which the ring turns by −θ.
    const Jet planet = Jet(static_cast<Real>(ring_teeth / planet_teeth)) * -theta;
    const Jet sun = Jet(static_cast<Real>(-planet_teeth / sun_teeth)) * planet;
    const Angle carrier = minimal::angle(theta);
    const Jet length = static_cast<Real>(arm), half = length * Jet(0.5L);
    return Poses{
        minimal::planar(half * carrier.c, half * carrier.s, carrier),
        minimal::planar(length * carrier.c, length * carrier.s, minimal::angle(theta + planet)),
        minimal::planar(0, 0, minimal::angle(theta + sun))};
  };
  place(&mechanism, poses, 0.0, 0.0);
  mechanism.joints = {hinge(kGround, 0, Vector3d::Zero()), hinge(0, 1, {arm, 0.0, 0.0}),
                      hinge(0, 2, Vector3d::Zero())};
  made.couplings = {
      {{{2, CoordinateOf::kAngle, 1.0}, {1, CoordinateOf::kAngle, planet_teeth / sun_teeth}}},
      {{{1, CoordinateOf::kAngle, 1.0}, {0, CoordinateOf::kAngle, ring_teeth / planet_teeth}}}};
  finish(&mechanism, steps);
  mechanism.steps = common_steps();
  mechanism.expected_errors = {8.0e-10, 4.2e-12, 1.6e-14, 1.6e-14};
  return made;
}

/// Two masses swinging on a rope over two pulleys at (∓1, 0, 0), with ℓ₁ + ratio ℓ₂ constant. The
/// coordinates are ℓ₁ and both angles from the vertical.
inline CoupledMechanism swinging_atwood(double ratio, int steps = 128) {
  const double m1 = 1.0, m2 = 1.5, length2 = 1.2;
  CoupledMechanism made;
  Mechanism& mechanism = made.mechanism;
  mechanism.name = "swinging Atwood, " + std::to_string(static_cast<int>(ratio)) + ":1";
  mechanism.duration = 1.0;
  const Real first = 0.6L, second = -0.3L;
  for (const auto& [name, mass] : {std::pair{"left", m1}, std::pair{"right", m2}}) {
    Body body;
    body.name = name;
    body.mass = mass;
    body.no_collision = true;
    mechanism.bodies.push_back(body);
  }
  const Real rho = static_cast<Real>(ratio), l2 = static_cast<Real>(length2);
  const Real rope = 1 + rho * l2, g = static_cast<Real>(problems::kGravity);
  const Real M1 = static_cast<Real>(m1), M2 = static_cast<Real>(m2);
  const auto poses = [=](Real r, Real theta, Real psi) {
    const Real s = (rope - r) / rho;
    return Poses{minimal::planar(-1 + r * std::sin(theta), -r * std::cos(theta), {}),
                 minimal::planar(1 + s * std::sin(psi), -s * std::cos(psi), {})};
  };
  const Poses start = poses(1, first, second);
  for (std::size_t i = 0; i < 2; ++i)
    mechanism.bodies[i].state.position = minimal::position(start[i]);
  made.couplings = {{{{0, CoordinateOf::kLength, 1.0}, {1, CoordinateOf::kLength, ratio}}}};
  const auto rate = [=](const Reals& y) {
    const Real r = y[0], s = (rope - r) / rho, dr = y[3], ds = -dr / rho;
    const Real pull = M1 * (r * y[4] * y[4] + g * std::cos(y[1])) -
                      M2 * (s * y[5] * y[5] + g * std::cos(y[2])) / rho;
    return Reals{dr,
                 y[4],
                 y[5],
                 pull / (M1 + M2 / (rho * rho)),
                 -(2 * dr * y[4] + g * std::sin(y[1])) / r,
                 -(2 * ds * y[5] + g * std::sin(y[2])) / s};
  };
  const Reals y = minimal::integrate(rate, {1, first, second, 0, 0, 0}, 1, steps);
  mechanism.end = poses(y[0], y[1], y[2]);
  mechanism.steps = common_steps();
  mechanism.expected_errors = {9.4e-12, 4.6e-14, 4.6e-14, 4.6e-14};
  return made;
}

/// A nut on an upright screw of 50 mm pitch: its height is a parabola.
inline CoupledMechanism falling_nut() {
  const double pitch = 0.05;
  CoupledMechanism made;
  Mechanism& mechanism = made.mechanism;
  mechanism.name = "falling nut on a screw";
  mechanism.duration = 1.0;
  mechanism.bodies = {bar("nut", 1.0, {0.1, 0.12, 0.08})};
  mechanism.joints = {
      {JointKind::kCylindrical, kGround, 0, Vector3d::Zero(), Vector3d::UnitZ(), std::nullopt}};
  const Real turn = 2 * minimal::kPi / static_cast<Real>(pitch);  // [rad/m]
  made.couplings = {{{{0, CoordinateOf::kTranslation, 1.0},
                      {0, CoordinateOf::kAngle, static_cast<double>(-1 / turn)}}}};
  place(
      &mechanism,
      [=](const Jet& z) {
        Pose pose;
        pose.x[2] = z;
        pose.R = minimal::rotation(Vector3d::UnitZ(), minimal::angle(Jet(turn) * z));
        return Poses{pose};
      },
      0.0, 0.0);
  const Real inertia = minimal::mass_of(mechanism.bodies[0]).inertia[2];
  const Real acceleration = static_cast<Real>(-problems::kGravity) / (1 + inertia * turn * turn);
  mechanism.end = minimal::at(*mechanism.reference, acceleration / 2);
  mechanism.steps = common_steps();
  mechanism.expected_errors = {2.5e-10, 1.0e-12, 9e-15, 9e-15};
  return made;
}

/// A falling rack on an upright slider turns a pinion of 0.1 m radius: its height is a parabola.
inline CoupledMechanism falling_rack() {
  const double radius = 0.1;
  CoupledMechanism made;
  Mechanism& mechanism = made.mechanism;
  mechanism.name = "falling rack and pinion";
  mechanism.duration = 1.0;
  mechanism.bodies = {bar("rack", 1.0, {0.05, 0.05, 0.6}), bar("pinion", 2.0, {0.2, 0.04, 0.2})};
  const Vector3d centre(radius, 0.0, 0.0);
  mechanism.joints = {
      {JointKind::kHinge, kGround, 1, centre, Vector3d::UnitY(), std::nullopt},
      {JointKind::kSlider, kGround, 0, Vector3d::Zero(), Vector3d::UnitZ(), std::nullopt}};
  made.couplings = {
      {{{0, CoordinateOf::kAngle, 1.0}, {1, CoordinateOf::kTranslation, -1.0 / radius}}}};
  place(
      &mechanism,
      [=](const Jet& z) {
        Poses poses(2);
        poses[0].x[2] = z;
        poses[1].x[0] = static_cast<Real>(radius);
        // The rack is on the side of −x, where the pinion's rim rises with the angle about y.
        poses[1].R = minimal::rotation(Vector3d::UnitY(),
                                       minimal::angle(z / Jet(static_cast<Real>(radius))));
        return poses;
      },
      0.0, 0.0);
  const Real r = static_cast<Real>(radius);
  const Real inertia = minimal::mass_of(mechanism.bodies[1]).inertia[1];
  const Real acceleration = static_cast<Real>(-problems::kGravity) / (1 + inertia / (r * r));
  mechanism.end = minimal::at(*mechanism.reference, acceleration / 2);
  mechanism.steps = common_steps();
  mechanism.expected_errors = {8.6e-10, 8.6e-10, 1e-14, 1e-14};
  return made;
}

/// Returns the mechanism with its couplings as joints: gears by number, a screw for a joint that
/// couples its own coordinates, a pulley for lengths, with fixed ends at (∓1, 0, 0).
inline Mechanism with_couplings(const CoupledMechanism& made) {
  Mechanism mechanism = made.mechanism;
  const std::vector<JointAt> joints = mechanism.joints;
  const bool is_screw = made.couplings[0].terms[0].joint == made.couplings[0].terms[1].joint &&
                        made.couplings[0].terms[0].of != CoordinateOf::kLength;
  if (is_screw) mechanism.joints.clear();
  mechanism.add_forces = [made, joints, is_screw](World* world) {
    std::size_t number = 0;
    for (const Coupling& coupling : made.couplings) {
      Joint joint;
      joint.name = "coupling" + std::to_string(number++);
      const auto& [first, second] = std::tie(coupling.terms[0], coupling.terms[1]);
      if (is_screw) {
        joint.kind = JointKind::kScrew;
        joint.body_b = world->body_ids().front();
        joint.frame_a = frame_along(joints[0].axis);
        joint.anchor_a = joints[0].point;
        joint.anchor_b = joints[0].point - world->state(joint.body_b).position;
        joint.pitch = -2.0 * static_cast<double>(minimal::kPi) * second.ratio;
      } else if (first.of == CoordinateOf::kLength) {
        joint.kind = JointKind::kPulley;
        for (std::size_t i = 0; i < 2; ++i) {
          Joint rope;
          rope.name = "rope" + std::to_string(i);
          rope.kind = JointKind::kFreeDistance;
          rope.anchor_a = {i == 0 ? -1.0 : 1.0, 0.0, 0.0};
          rope.body_b = world->body_ids()[i];
          (i == 0 ? joint.coupling.first : joint.coupling.second) = world->add_joint(rope);
        }
      } else {
        joint.kind = JointKind::kGear;
        joint.coupling.first = world->joint_ids()[first.joint];
        joint.coupling.second = world->joint_ids()[second.joint];
      }
      joint.coupling.ratio = second.ratio / first.ratio;
      world->add_joint(joint);
    }
  };
  return mechanism;
}

}  // namespace constraint_sim::engine::mechanisms
