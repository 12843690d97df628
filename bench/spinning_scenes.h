#pragma once

// Fast rotations on joints, with exact angles or a reference in long double.

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "inertia_of.h"
#include "long_double_reference.h"
#include "make_scene.h"
#include "problems.h"

namespace constraint_sim::engine::spinning {

using Eigen::Vector3d;

/// Mass, place and tick of a scene.
struct Setting {
  Method method = Method::kEnergyMomentum;
  double time_step = 1.0 / 60.0;      ///< [s]
  double speed = 1000.0;              ///< [rad/s]
  double mass = 1.0;                  ///< mass of the fast body [kg]
  Vector3d place = Vector3d::Zero();  ///< [m]
  int stiff_order = 4;
  bool dissipation = false;
  double tolerance = WorldOptions{}.tolerance;  ///< [m/s]
};

/// A body that turns about a fixed axis by a known angle.
struct Turned {
  JointId joint;                           ///< its first coordinate is the angle
  std::function<double(double)> angle_at;  ///< exact angle at a time [rad]
  bool is_at_rest = false;                 ///< whether the body itself does not turn
};

inline World world_of(const Setting& setting) {
  WorldOptions options;
  options.method = setting.method;
  options.time_step = setting.time_step;
  options.stiff_order = setting.stiff_order;
  options.dissipation = setting.dissipation;
  options.tolerance = setting.tolerance;
  options.gravity.setZero();
  return World(options);
}

struct Spinning {
  explicit Spinning(const Setting& setting) : world(world_of(setting)) {}

  World world;
  std::vector<Turned> turned;
  /// Where there is no closed form.
  std::shared_ptr<const reference::Mechanics> mechanics;
  std::optional<reference::Integrator> reference;
};

/// Adds a body on a hinge about z of `base`, at `place` with anchor `from_axis` on the body.
inline JointId add_wheel(World* world, const std::string& name, const Setting& setting,
                         const Vector3d& place, double speed, const CoordinateLaw& law = {},
                         double from_axis = 0.0, BodyId base = kWorldBody) {
  Body wheel = make_body(name, Cylinder{0.1, 0.05}, setting.mass,
                         setting.place + place + Vector3d(from_axis, 0.0, 0.0));
  wheel.no_collision = true;
  wheel.state.angular_velocity.z() = speed;
  wheel.state.linear_velocity.y() = speed * from_axis;
  Joint hinge;
  hinge.name = name + "_hinge";
  hinge.kind = JointKind::kHinge;
  hinge.body_a = base;
  hinge.anchor_a = base == kWorldBody
                       ? Vector3d(setting.place + place)
                       : Vector3d(setting.place + place - world->state(base).position);
  hinge.body_b = world->add_body(wheel);
  hinge.anchor_b.x() = -from_axis;
  hinge.coordinates[0] = law;
  return world->add_joint(hinge);
}

/// Moment of inertia about the hinge of add_wheel() [kg m²].
inline double inertia_of_wheel(const Setting& setting, double from_axis = 0.0) {
  return setting.mass * (0.5 * 0.1 * 0.1 + from_axis * from_axis);
}

inline Spinning wheel(const Setting& setting) {
  Spinning scene(setting);
  const double speed = setting.speed;
  const JointId id = add_wheel(&scene.world, "wheel", setting, Vector3d::Zero(), speed);
  scene.turned = {{id, [=](double t) { return speed * t; }}};
  return scene;
}

/// A wheel whose centre is `kOffCentre` beside its axis.
inline constexpr double kOffCentre = 0.03;
inline Spinning off_centre(const Setting& setting) {
  Spinning scene(setting);
  const double speed = setting.speed;
  const JointId id =
      add_wheel(&scene.world, "wheel", setting, Vector3d::Zero(), speed, {}, kOffCentre);
  scene.turned = {{id, [=](double t) { return speed * t; }}};
  return scene;
}

/// A flywheel on a frame that a stiff spring holds at rest: the island is stiff.
inline Spinning beside_a_stiff_spring(const Setting& setting) {
  Spinning scene(setting);
  const double speed = setting.speed, h = setting.time_step;
  CoordinateLaw spring;
  spring.stiffness = 2.0 * inertia_of_wheel(setting) * std::pow(200.0 / h, 2.0);
  const JointId held = add_wheel(&scene.world, "frame", setting, Vector3d::Zero(), 0.0, spring);
  const JointId id = add_wheel(&scene.world, "flywheel", setting, Vector3d::Zero(), speed, {}, 0.0,
                               scene.world.joint(held).body_b);
  scene.turned = {{id, [=](double t) { return speed * t; }}, {held, [](double) { return 0.0; }}};
  return scene;
}

inline constexpr double kTeeth = 10.0;
inline Spinning geared(const Setting& setting) {
  Spinning scene(setting);
  const double fast = setting.speed, slow = -setting.speed / kTeeth;
  Joint gear;
  gear.name = "gear";
  gear.kind = JointKind::kGear;
  gear.coupling.first = add_wheel(&scene.world, "fast", setting, Vector3d::Zero(), fast);
  gear.coupling.second = add_wheel(&scene.world, "slow", setting, {1.0, 0.0, 0.0}, slow);
  gear.coupling.ratio = kTeeth;
  scene.world.add_joint(gear);
  scene.turned = {{gear.coupling.first, [=](double t) { return fast * t; }},
                  {gear.coupling.second, [=](double t) { return slow * t; }}};
  return scene;
}

/// A wheel whose damper slows it down by e in 0.05 s.
inline Spinning damped(const Setting& setting) {
  Spinning scene(setting);
  const double speed = setting.speed, duration = 0.05;
  CoordinateLaw law;
  law.damping = inertia_of_wheel(setting) / duration;
  const JointId id = add_wheel(&scene.world, "wheel", setting, Vector3d::Zero(), speed, law);
  scene.turned = {
      {id, [=](double t) { return speed * duration * (1.0 - std::exp(-t / duration)); }}};
  return scene;
}

/// A wheel on a spring that it winds up by many turns.
inline Spinning wound_up(const Setting& setting) {
  Spinning scene(setting);
  const double speed = setting.speed, frequency = 10.0;  // [rad/s]
  CoordinateLaw law;
  law.stiffness = inertia_of_wheel(setting) * frequency * frequency;
  const JointId id = add_wheel(&scene.world, "wheel", setting, Vector3d::Zero(), speed, law);
  scene.turned = {{id, [=](double t) { return speed / frequency * std::sin(frequency * t); }}};
  return scene;
}

/// A wheel that a motor turns, and a wheel on it that turns back: it stays as it is.
inline Spinning driven(const Setting& setting) {
  Spinning scene(setting);
  const double speed = setting.speed;
  CoordinateLaw law;
  law.motor.emplace().bias = speed;
  const JointId id = add_wheel(&scene.world, "wheel", setting, Vector3d::Zero(), speed, law);
  const JointId back = add_wheel(&scene.world, "rider", setting, Vector3d::Zero(), 0.0, {}, 0.0,
                                 scene.world.joint(id).body_b);
  scene.turned = {{id, [=](double t) { return speed * t; }},
                  {back, [=](double t) { return -speed * t; }, true}};
  return scene;
}

/// Takes the bodies and joints of the world, as they were added, for the reference.
inline void add_reference(Spinning* scene) {
  reference::Scene same;
  same.options = scene->world.options();
  for (const BodyId id : scene->world.body_ids()) same.bodies.push_back(scene->world.body(id));
  for (const JointId id : scene->world.joint_ids()) same.joints.push_back(scene->world.joint(id));
  scene->mechanics = std::make_shared<const reference::Mechanics>(same);
  scene->reference.emplace(*scene->mechanics, 1e-13, 4000000);
}

/// Two boxes connected at their surfaces by a joint of a kind. Both turn as one rigid body.
inline Spinning boxes(const Setting& setting, JointKind kind, double mass_ratio) {
  Spinning scene(setting);
  const Vector3d spin = setting.speed * Vector3d(0.3, 0.8, 0.2), arm(0.05, 0.1, 0.15);
  const auto box = [&](const std::string& box_name, double mass, const Vector3d& at) {
    Body body = make_body(box_name, Box{{0.1, 0.2, 0.3}}, mass, setting.place + at);
    body.no_collision = true;
    body.state.angular_velocity = spin;
    body.state.linear_velocity = spin.cross(at);
    return scene.world.add_body(body);
  };
  Joint joint;
  joint.name = "joint";
  joint.kind = kind;
  joint.body_a = box("first", setting.mass, -arm / (1.0 + 1.0 / mass_ratio));
  joint.body_b = box("second", mass_ratio * setting.mass, arm / (1.0 + mass_ratio));
  joint.anchor_a =
      scene.world.state(joint.body_b).position - scene.world.state(joint.body_a).position;
  scene.world.add_joint(joint);
  add_reference(&scene);
  return scene;
}
inline Spinning top(const Setting& setting) { return boxes(setting, JointKind::kWeld, 1.0); }
inline Spinning heavy_top(const Setting& setting) { return boxes(setting, JointKind::kWeld, 1e3); }
inline Spinning on_hinge(const Setting& setting) { return boxes(setting, JointKind::kHinge, 10.0); }

struct Named {
  const char* name;
  Spinning (*make)(const Setting&);
};
inline constexpr Named kSpinning[] = {{"wheel", wheel},
                                      {"off centre", off_centre},
                                      {"beside a spring", beside_a_stiff_spring},
                                      {"gears", geared},
                                      {"damped", damped},
                                      {"wound up", wound_up},
                                      {"driven", driven},
                                      {"top", top},
                                      {"top, heavy load", heavy_top},
                                      {"hinged boxes", on_hinge}};

/// Result of some steps.
struct Seen {
  double error = 0.0;          ///< largest error of angles and poses, as distances [m]
  double angle = 0.0;          ///< largest error of an angle with whole turns [rad]
  double speed = 0.0;          ///< largest error of the speed of an angle, over the speed [1]
  double estimate = 0.0;       ///< sum of the error estimates [m]
  bool is_named = false;       ///< whether a step named bodies that it does not resolve
  bool is_by_midpoint = true;  ///< whether energy_momentum took all steps
  std::uint32_t changes = 0;
};

/// Adds the errors of the present state.
inline void add_errors(Spinning& scene, double speed, Seen* seen) {
  const World& world = scene.world;
  for (const Turned& turned : scene.turned) {
    const Joint& joint = world.joint(turned.joint);
    const Body& body = world.body(joint.body_b);
    const double radius =
        std::hypot(std::sqrt(inertia_of(body).maxCoeff() / body.mass), joint.anchor_b.norm());
    const double exact = turned.angle_at(world.time());
    const double angle = world.joint_state(turned.joint).coordinates[0].position - exact;
    const Eigen::Quaterniond q(
        Eigen::AngleAxisd(turned.is_at_rest ? 0.0 : exact, Vector3d::UnitZ()));
    const double before = 1e-6 * world.options().time_step;
    const double rate =
        (turned.angle_at(world.time() + before) - turned.angle_at(world.time() - before)) /
        (2.0 * before);
    const double pose = problems::angle_between(q, world.state(joint.body_b).orientation);
    seen->angle = std::max(seen->angle, std::abs(angle));
    seen->speed =
        std::max(seen->speed,
                 std::abs(world.joint_state(turned.joint).coordinates[0].velocity - rate) / speed);
    seen->error = std::max(seen->error, radius * std::max(std::abs(angle), pose));
  }
  if (!scene.reference) return;
  scene.reference->advance_to(world.time());
  const std::vector<BodyId> ids = world.body_ids();
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const Body& body = world.body(ids[i]);
    const BodyState& state = world.state(ids[i]);
    const reference::Pose& exact = scene.reference->poses()[i];
    const Vector3d spin = exact.w.cast<double>();
    const Vector3d place = (exact.x + scene.mechanics->origin()).cast<double>();
    const double radius = std::sqrt(inertia_of(body).maxCoeff() / body.mass);
    const double pose = problems::angle_between(exact.q.cast<double>(), state.orientation);
    seen->error = std::max({seen->error, radius * pose, (state.position - place).norm()});
    seen->angle = std::max(seen->angle, pose);
    seen->speed = std::max(seen->speed, (state.angular_velocity - spin).norm() / speed);
  }
  if (!scene.reference->is_valid()) seen->error = std::nan("");
}

inline Seen run(Spinning& scene, double duration, double speed) {
  Seen seen;
  const long ticks = std::lround(duration / scene.world.options().time_step);
  for (long i = 0; i < ticks; ++i) {
    const StepReport& report = scene.world.step();
    seen.estimate += report.local_error;
    seen.is_named = seen.is_named || report.unresolved_bodies > 0;
    seen.changes += report.costs.method_changes;
    for (const Island& island : scene.world.islands())
      seen.is_by_midpoint = seen.is_by_midpoint && island.method == Method::kEnergyMomentum;
    add_errors(scene, speed, &seen);
  }
  return seen;
}

}  // namespace constraint_sim::engine::spinning
