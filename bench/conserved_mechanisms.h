#pragma once

// Conservation by energy_momentum of pairs of bodies in free space, pairs that hang on the world,
// and loops.

#include <vector>

#include "mechanisms.h"

namespace constraint_sim::engine::mechanisms {

/// A scene, and the length of its run.
struct Conserved {
  Mechanism mechanism;
  double tick = 0.02;  ///< [s]
  int steps = 10000;
  double tolerance = 0.0;  ///< 0: one substep a tick
  bool is_free = true;     ///< without joints to the world, so momenta are conserved too
};

struct Kept {
  double energy = 0.0;            ///< largest change over the largest kinetic energy
  double momentum = 0.0;          ///< largest change over its size
  double angular_momentum = 0.0;  ///< largest change over its size, about the origin
  double joints = 0.0;            ///< largest error [m]
  double size = 0.0;              ///< largest coordinate [m]
  double iterations = 0.0;        ///< Newton iterations per solved system
  std::uint32_t halvings = 0;
  std::uint32_t changes = 0;  ///< changes of method, as reported
  bool has_failed = false;
};

struct Momenta {
  double kinetic_energy = 0.0;
  Vector3d momentum = Vector3d::Zero(), angular_momentum = Vector3d::Zero();
};

inline Momenta momenta_of(const World& world) {
  Momenta sum;
  for (const BodyId id : world.body_ids()) {
    const Body& body = world.body(id);
    const BodyState& state = world.state(id);
    const Vector3d inertia = minimal::mass_of(body).inertia.cast<double>();
    const Vector3d w = state.orientation.conjugate() * state.angular_velocity;
    const Vector3d spin = state.orientation * inertia.cwiseProduct(w);
    sum.kinetic_energy +=
        0.5 * (body.mass * state.linear_velocity.squaredNorm() + spin.dot(state.angular_velocity));
    sum.momentum += body.mass * state.linear_velocity;
    sum.angular_momentum += body.mass * state.position.cross(state.linear_velocity) + spin;
  }
  return sum;
}

/// Runs by the midpoint rule, one system a step.
inline Kept run(const Conserved& scene) {
  WorldOptions options;
  options.method = Method::kEnergyMomentum;
  options.stiff_order = 2;
  options.time_step = scene.tick;
  options.tolerance = scene.tolerance;
  World world = scene.mechanism.world(options);
  Kept kept;
  world.step();  // the first step removes velocities that the joints forbid
  const double energy = world.energy();
  const Momenta start = momenta_of(world);
  double kinetic = start.kinetic_energy, energy_change = 0.0, iterations = 0.0, systems = 0.0;
  for (int i = 0; i < scene.steps; ++i) {
    const StepReport& report = world.step();
    const Momenta now = momenta_of(world);
    kept.has_failed = kept.has_failed || report.outcome.failed;
    kept.changes += report.costs.method_changes;
    kept.joints = std::max(kept.joints, report.joints.max_error);
    kept.halvings += report.costs.rejected;
    iterations += report.costs.iterations;
    systems += report.costs.substeps + report.costs.rejected;
    kinetic = std::max(kinetic, now.kinetic_energy);
    energy_change = std::max(energy_change, std::abs(world.energy() - energy));
    kept.momentum = std::max(kept.momentum, (now.momentum - start.momentum).norm());
    kept.angular_momentum =
        std::max(kept.angular_momentum, (now.angular_momentum - start.angular_momentum).norm());
    for (const BodyId id : world.body_ids())
      kept.size = std::max(kept.size, world.state(id).position.cwiseAbs().maxCoeff());
  }
  kept.energy = energy_change / kinetic;
  kept.momentum /= start.momentum.norm();
  kept.angular_momentum /= start.angular_momentum.norm();
  kept.iterations = iterations / systems;
  return kept;
}

/// Two tumbling boxes connected by one joint.
inline Conserved pair_of(JointKind kind, double mass_ratio = 2.0) {
  Conserved scene;
  Mechanism& made = scene.mechanism;
  made.name = name(kind);
  made.gravity.setZero();
  Body a = bar("a", 1.0, {0.2, 0.4, 0.6}), b = bar("b", mass_ratio, {0.5, 0.3, 0.2});
  a.state.linear_velocity = {0.3, -0.2, 0.1};
  a.state.angular_velocity = {1.0, 2.0, 3.0};
  b.state.position = {0.35, 0.5, 0.4};
  b.state.angular_velocity = {-1.0, 0.5, 2.0};
  made.bodies = {a, b};
  const Vector3d axis(1.0, 1.0, 0.3);
  JointAt joint{kind, 0, 1, {0.1, 0.2, 0.3}, axis, std::nullopt};
  if (info(kind).has_two_axes) joint.second_axis = axis.cross(Vector3d::UnitX());
  made.joints = {joint};
  return scene;
}

/// The pair of boxes under gravity, with the light box on a ball joint to the world.
inline Conserved hanging_pair(JointKind kind, double mass_ratio) {
  Conserved scene = pair_of(kind, mass_ratio);
  scene.mechanism.name += mass_ratio > 100.0 ? ", heavy load" : ", on the world";
  scene.mechanism.gravity = {0.0, 0.0, -problems::kGravity};
  scene.mechanism.joints.push_back(
      {JointKind::kBall, kGround, 0, {-0.1, -0.2, -0.3}, Vector3d::UnitZ(), std::nullopt});
  scene.tick = 0.01;
  scene.steps = 2000;
  scene.is_free = false;
  // Near its gimbal lock the light box turns at up to 1e4 rad/s; steps have to be shorter there, or
  // substeps have to pass it.
  if (kind == JointKind::kUniversal && mass_ratio > 100.0) scene.tolerance = 1e-8;
  return scene;
}

/// A mechanism on the world, run for 2000 steps of 5 ms.
inline Conserved loop(const Mechanism& mechanism) { return {mechanism, 0.005, 2000, 0.0, false}; }

/// Two wheels on a free carrier, one on a skew axis, geared so that both turn many times.
inline Conserved free_gears(double mass_ratio) {
  Conserved scene = pair_of(JointKind::kHinge, mass_ratio);
  Mechanism& made = scene.mechanism;
  made.name = mass_ratio > 100.0 ? "gears, heavy load" : "gears on a free carrier";
  Body c = bar("c", 0.7, {0.3, 0.2, 0.3});
  c.state.position = {-0.4, 0.3, 0.2};
  c.state.angular_velocity = {0.5, -2.0, 1.0};
  made.bodies.push_back(c);
  made.joints.push_back(
      {JointKind::kHinge, 0, 2, {-0.3, 0.2, 0.1}, {0.2, 1.0, -0.4}, std::nullopt});
  made.add_forces = [](World* world) {
    Joint gear;
    gear.name = "gear";
    gear.kind = JointKind::kGear;
    gear.coupling.first = world->joint_ids()[0];
    gear.coupling.second = world->joint_ids()[1];
    gear.coupling.ratio = std::sqrt(2.0);
    world->add_joint(gear);
  };
  if (mass_ratio > 100.0) scene.steps = 2000;
  return scene;
}

inline Conserved free_screw() {
  Conserved scene = pair_of(JointKind::kCylindrical);
  Mechanism& made = scene.mechanism;
  made.name = "screw";
  const JointAt along = made.joints[0];
  made.joints.clear();
  made.add_forces = [along](World* world) {
    Joint screw;
    screw.name = "screw";
    screw.kind = JointKind::kScrew;
    screw.body_a = world->body_ids()[0];
    screw.body_b = world->body_ids()[1];
    screw.anchor_a = along.point - world->state(screw.body_a).position;
    screw.anchor_b = along.point - world->state(screw.body_b).position;
    screw.frame_a = frame_along(along.axis);
    screw.pitch = 0.4;
    world->add_joint(screw);
  };
  return scene;
}

/// Two boxes on a rope over two corners of a third box.
inline Conserved free_pulley() {
  Conserved scene = free_gears(2.0);
  Mechanism& made = scene.mechanism;
  made.name = "pulley";
  made.joints.clear();
  made.add_forces = [](World* world) {
    Joint pulley;
    pulley.name = "pulley";
    pulley.kind = JointKind::kPulley;
    for (std::size_t i = 0; i < 2; ++i) {
      Joint rope;
      rope.name = "rope" + std::to_string(i);
      rope.kind = JointKind::kFreeDistance;
      rope.body_a = world->body_ids()[0];
      rope.anchor_a = {i == 0 ? 0.1 : -0.1, 0.2, 0.3};
      rope.body_b = world->body_ids()[i + 1];
      rope.anchor_b = {0.1, -0.1, 0.05};
      (i == 0 ? pulley.coupling.first : pulley.coupling.second) = world->add_joint(rope);
    }
    pulley.coupling.ratio = 1.7;
    world->add_joint(pulley);
  };
  return scene;
}

inline std::vector<Conserved> conserved() {
  std::vector<Conserved> all;
  for (const JointKind kind :
       {JointKind::kBall, JointKind::kHinge, JointKind::kUniversal, JointKind::kWeld,
        JointKind::kSlider, JointKind::kCylindrical, JointKind::kPlanar, JointKind::kPointOnLine,
        JointKind::kPointOnPlane, JointKind::kParallel})
    all.push_back(pair_of(kind));
  for (const double ratio : {2.0, 1e6}) all.push_back(free_gears(ratio));
  all.push_back(free_screw());
  all.push_back(free_pulley());
  for (const JointKind kind : {JointKind::kHinge, JointKind::kSlider, JointKind::kUniversal})
    for (const double ratio : {2.0, 1e6}) all.push_back(hanging_pair(kind, ratio));
  for (const Mechanism& mechanism : {slider_crank(), four_bar(), universal_shaft(), bricard()})
    all.push_back(loop(mechanism));
  return all;
}

}  // namespace constraint_sim::engine::mechanisms
