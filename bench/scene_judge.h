#pragma once

// Runs a scene by each method and finds unreported errors: joints above 1e-6 m, energy, and within
// 1 s the state above 1e-6 m + 100 times the accumulated estimate. Where a disturbance of the start
// grows more than tenfold, ten times that growth replaces 100: diverging motions amplify every
// error, however well it is estimated.

#include <cstdio>
#include <functional>
#include <map>

#include "random_scenes.h"

namespace constraint_sim::engine::random_scenes {

struct Setting {
  const char* name;
  Method method;
  int order;
};
inline constexpr Setting kSettings[] = {
    {"auto", Method::kAuto, 8},
    {"runge_kutta", Method::kRungeKutta, 8},
    {"runge_kutta_5", Method::kRungeKutta, 5},
    {"energy_momentum", Method::kEnergyMomentum, 8},
    {"sequential_impulses", Method::kSequentialImpulses, 8},
};

/// An error, or none where `what` is empty.
struct Finding {
  std::string setting;
  long tick = 0;
  std::string what;    // class: joints, energy, state, finite, report, conflict
  std::string detail;  // figures

  /// Returns whether a wrong result was not reported. A wrong report is a finding, but not silent.
  bool is_silent() const { return !what.empty() && what != "conflict"; }
};

/// Returns whether the last step reports that its result is unreliable. Listed errors alone count
/// for impulses only; `own_error` is the error of joints.
inline bool says_so(const World& world, Method method, double own_error) {
  const StepReport& report = world.report();
  if (report.outcome.failed || report.unresolved_bodies > 0) return true;
  for (const Island& island : world.islands()) {
    if (island.why == MethodReason::kInconsistent || island.why == MethodReason::kRefused)
      return true;
    if (uses_impulses(island.method)) method = island.method;
  }
  return uses_impulses(method) && report.joints.max_error >= 0.999 * own_error - 1e-12;
}

/// Motion by the reference, every tenth of a second, with its own error and the growth of a
/// disturbance of the start.
struct Motion {
  std::vector<std::vector<Pose>> samples;
  std::vector<double> error;        // [m]
  std::vector<double> sensitivity;  // growth of a disturbance [m/m]
};

constexpr double kDuration = 1.0;        // [s]
constexpr double kSampleInterval = 0.1;  // [s]
constexpr long kMostEvaluations = 25000;

inline Motion reference_motion(const Mechanics& mechanics) {
  constexpr double kDisturbance = 1e-8;
  reference::Integrator base(mechanics, 1e-10, kMostEvaluations, 7);
  reference::Integrator fine(mechanics, 1e-12, 2 * kMostEvaluations, 8);
  reference::Integrator disturbed(mechanics, 1e-12, 2 * kMostEvaluations, 8);
  Random random(1);
  for (std::size_t i = 0; i < mechanics.start().size(); ++i) {
    Pose& pose = disturbed.poses()[i];
    if (!mechanics.is_movable(i)) continue;
    pose.x += random.vector(kDisturbance).cast<reference::Real>();
    pose.v += random.vector(kDisturbance).cast<reference::Real>();
    if (mechanics.radius(i) > 0.0) {
      pose.w += random.vector(kDisturbance).cast<reference::Real>();
      Mechanics::turn(random.vector(kDisturbance).cast<reference::Real>(), &pose.q);
    }
  }
  mechanics.project(0, &disturbed.poses());
  Motion motion;
  const auto samples = std::lround(kDuration / kSampleInterval);
  for (long k = 1; k <= samples; ++k) {
    const double t = static_cast<double>(k) * kSampleInterval;
    for (reference::Integrator* integrator : {&base, &fine, &disturbed}) integrator->advance_to(t);
    if (!base.is_valid() || !fine.is_valid() || !disturbed.is_valid()) break;
    const double error = difference(mechanics, base.poses(), fine.poses());
    if (!(error < 1e-7)) break;
    motion.samples.push_back(fine.poses());
    motion.error.push_back(error);
    motion.sensitivity.push_back(difference(mechanics, disturbed.poses(), fine.poses()) /
                                 kDisturbance);
  }
  return motion;
}

class Judge {
 public:
  /// `is_strict`: integrating methods must keep joints to (1e-12 m + 4 eps · coordinate)/√(smallest
  /// kept pivot), where the reference has a motion.
  explicit Judge(Scene scene, bool is_strict = false)
      : mechanics_(std::move(scene)), motion_(reference_motion(mechanics_)) {
    if (is_strict) smallest_pivot_ = smallest_pivot();
    const Scene& made = mechanics_.scene();
    for (const Body& body : made.bodies)
      coordinate_ = std::max(coordinate_, body.state.position.cwiseAbs().maxCoeff());
    for (const Joint& joint : made.joints) {
      has_limits_ = has_limits_ || reference::is_limit(joint);
      is_driven_ = is_driven_ || joint.motor.bias != 0.0 || joint.motor.amplitude != 0.0;
      if (reference::is_spring(joint)) is_damped_ = is_damped_ || joint.distance.damping > 0.0;
    }
    for (const Body& body : made.bodies) {
      if (body.type == BodyType::kKinematic) is_driven_ = true;
      if (std::holds_alternative<Box>(body.shape)) turns_ = true;
    }
    if (!made.wrenches.empty()) is_driven_ = true;
  }

  bool has_motion() const { return !motion_.samples.empty(); }
  const Scene& scene() const { return mechanics_.scene(); }

  /// Returns the first error of a method.
  Finding judge(const Setting& setting) const {
    Scene scene = mechanics_.scene();
    scene.options.method = setting.method;
    scene.options.order = setting.order;
    World world = make_world(scene);
    return follow(setting, &world, nullptr);
  }

  /// Returns the first error of a world that should move like the scene.
  Finding judge(const Setting& setting, World* world) const {
    return follow(setting, world, nullptr);
  }

  /// Compares the motion by `auto` of variants: scenes that differ in description only.
  std::vector<Finding> compare_variants(std::uint64_t seed) const {
    std::vector<Finding> findings;
    if (!has_motion()) return findings;
    Random random(seed + 77);
    const Quaterniond turned = random.orientation();
    const Vector3d moved = random.vector(10.0);
    const auto add = [&](const char* name, const Scene& variant, const Quaterniond& q,
                         const Vector3d& x) {
      World world = make_world(variant);
      const auto back = [&](std::vector<Pose> poses) {
        for (Pose& pose : poses) {
          const auto inverse = q.conjugate().cast<reference::Real>();
          pose.x = inverse * (pose.x - x.cast<reference::Real>());
          pose.v = inverse * pose.v;
          pose.w = inverse * pose.w;
          pose.q = inverse * pose.q;
        }
        return poses;
      };
      Finding finding = follow({name, Method::kAuto, 8}, &world, back);
      if (!finding.what.empty()) findings.push_back(finding);
    };
    const Quaterniond none = Quaterniond::Identity();
    add("auto, moved", transformed(none, moved), none, moved);
    add("auto, turned", transformed(turned, Vector3d::Zero()), turned, Vector3d::Zero());
    add("auto, reordered", reordered(&random), none, Vector3d::Zero());
    add("auto, A and B exchanged", exchanged(), none, Vector3d::Zero());
    add("auto, all joints twice", doubled(), none, Vector3d::Zero());
    for (const double factor : {0.03, 30.0}) {
      World world = make_world(scaled(factor));
      const auto back = [&](std::vector<Pose> poses) {
        for (Pose& pose : poses) {
          pose.x /= static_cast<reference::Real>(factor);
          pose.v /= static_cast<reference::Real>(factor);
        }
        return poses;
      };
      Finding finding = follow({factor < 1.0 ? "auto, small" : "auto, large", Method::kAuto, 8},
                               &world, back, factor);
      if (!finding.what.empty()) findings.push_back(finding);
    }
    return findings;
  }

 private:
  using Back = std::function<std::vector<Pose>(std::vector<Pose>)>;

  // Runs a world. `size`: scale of the world relative to the scene.
  Finding follow(const Setting& setting, World* world, const Back& back, double size = 1.0) const {
    const Scene& scene = mechanics_.scene();
    const double h = scene.options.time_step;
    const auto ticks = std::lround(kDuration / h);
    const auto ticks_a_sample = std::lround(kSampleInterval / h);
    Progress so_far;
    so_far.readings = mechanics_.start_readings();
    so_far.poses = mechanics_.start();
    const auto start = mechanics_.energy(mechanics_.start());
    so_far.start = start.kinetic + start.potential;
    Finding finding{setting.name, 0, "", ""};
    for (long tick = 1; tick <= ticks; ++tick) {
      world->step();
      std::vector<Pose> poses = poses_of(*world, scene);
      if (back) poses = back(std::move(poses));
      for (Pose& pose : poses) pose.x -= mechanics_.origin();
      finding.tick = tick;
      const reference::Readings before = so_far.readings;
      so_far.readings =
          mechanics_.read_on(so_far.poses, poses, static_cast<reference::Real>(h), before);
      so_far.knows_turns =
          mechanics_.choose_turns(poses, before, &so_far.readings) && so_far.knows_turns;
      so_far.poses = poses;
      if (is_off(setting, *world, poses, h * static_cast<double>(tick), size, &so_far, &finding))
        break;
      if (so_far.has_said || uses_impulses(setting.method) || so_far.uses_impulses ||
          tick % ticks_a_sample != 0)
        continue;
      const auto k = static_cast<std::size_t>(tick / ticks_a_sample - 1);
      if (is_elsewhere(k, poses, so_far, &finding)) break;
    }
    return finding;
  }

  struct Progress {
    double start = 0.0, before = 0.0;  // energy [J]
    double scale = 0.0;                // scale of energies [J]
    double estimate = 0.0;             // accumulated estimate [m]
    double corrected = 0.0;            // corrections by impulses [m]
    double error = 0.0;                // error of joints in the previous tick [m]
    reference::Readings readings;      // coupled coordinates
    bool knows_turns = true;           // whole turns of coupled coordinates are known
    std::vector<Pose> poses;
    bool has_said = false;
    bool uses_impulses = false;
  };

  bool is_off(const Setting& setting, const World& world, const std::vector<Pose>& poses, double t,
              double size, Progress* so_far, Finding* finding) const {
    const auto found = [&](const char* what, const std::string& detail) {
      finding->what = what;
      finding->detail = detail;
      return true;
    };
    const StepReport& report = world.report();
    for (const Pose& pose : poses)
      if (!pose.x.allFinite() || !pose.q.coeffs().allFinite() || !pose.v.allFinite())
        return found("finite", "a state is not finite");
    if (t <= kSampleInterval * static_cast<double>(motion_.samples.size()) + 1e-9 && !has_limits_)
      for (const Island& island : world.islands())
        if (island.why == MethodReason::kInconsistent)
          return found("conflict", "joints that the reference meets are taken for contradictory");
    const auto [error, joint] = mechanics_.worst_joint(poses, t, so_far->readings);
    so_far->has_said = so_far->has_said || says_so(world, setting.method, size * error);
    if (!std::isnan(report.local_error)) so_far->estimate += report.local_error / size;
    for (const Island& island : world.islands())
      so_far->uses_impulses = so_far->uses_impulses || uses_impulses(island.method);
    if (error > joints_allowed(*so_far, t) / std::min(size, 1.0) && !so_far->has_said)
      return found("joints", mechanics_.scene().joints[joint].name + figure(" is off by", error));
    if (std::abs(report.joints.max_error / size - error) >
            (1e-6 + 4.0 * 2.3e-16 * coordinate_) / std::min(size, 1.0) + 1e-3 * error &&
        !report.outcome.failed && so_far->knows_turns)
      return found("report", figure("max_constraint_error", report.joints.max_error) +
                                 figure(" while joints are off by", error));
    return has_wrong_energy(poses, error, so_far, finding);
  }

  bool has_wrong_energy(const std::vector<Pose>& poses, double error, Progress* so_far,
                        Finding* finding) const {
    const auto energy = mechanics_.energy(poses);
    const double now = energy.kinetic + energy.potential;
    so_far->scale = std::max({so_far->scale, energy.kinetic, std::abs(energy.potential),
                              std::abs(so_far->start), weight()});
    so_far->corrected += std::max(error, so_far->error);
    so_far->error = error;
    if (is_driven_ || so_far->has_said) return false;
    const double rise = now - so_far->start;
    // a rope that becomes taut is an inelastic impact
    const bool loses = is_damped_ || has_limits_ || so_far->uses_impulses || is_thrown();
    const double off = loses ? rise : std::abs(rise);
    // The last term is the energy of 1e-6 m/s, for scenes at rest.
    double allowed =
        1e-6 * so_far->scale + 100.0 * so_far->estimate * so_far->scale + 0.5e-12 * mass();
    // Baumgarte's corrections may lift bodies; with rotations the method is of first order.
    if (so_far->uses_impulses) allowed += weight() * so_far->corrected;
    if (so_far->uses_impulses && turns_) allowed += 1e-3 * so_far->scale;
    if (!(off > allowed)) return false;
    finding->what = rise > 0.0 ? "energy rises" : "energy falls";
    finding->detail = figure("by", rise) + " J" + figure(" of", so_far->scale) + " J";
    return true;
  }

  bool is_elsewhere(std::size_t k, const std::vector<Pose>& poses, const Progress& so_far,
                    Finding* finding) const {
    if (k >= motion_.samples.size() || has_limits_) return false;
    const double off = difference(mechanics_, poses, motion_.samples[k]);
    const double grows = motion_.sensitivity[k];
    const double rounding = 1e-14 + 4.0 * 2.3e-16 * coordinate_;
    const double allowed = 1e-6 + std::max(100.0, 10.0 * grows) * so_far.estimate +
                           10.0 * motion_.error[k] + 100.0 * grows * rounding;
    if (!(off > allowed)) return false;
    finding->what = "state";
    finding->detail = figure("off by", off) + " m" + figure(", estimate", so_far.estimate) +
                      figure(" m, sensitivity", grows);
    return true;
  }

  static std::string figure(const char* what, double value) {
    char text[96];
    std::snprintf(text, sizeof text, "%s %.3g", what, value);
    return text;
  }

  bool is_thrown() const { return mechanics_.scene().kind.find("thrown") != std::string::npos; }
  double joints_allowed(const Progress& so_far, double t) const {
    const double end = kSampleInterval * static_cast<double>(motion_.samples.size()) + 1e-9;
    if (!smallest_pivot_ || so_far.uses_impulses || t > end)
      return 1e-6 + 4.0 * 2.3e-16 * coordinate_;
    return (1e-12 + 4.0 * 2.3e-16 * coordinate_) / std::sqrt(*smallest_pivot_);
  }
  // Returns the smallest pivot along the motion of the reference.
  double smallest_pivot() const {
    double least = mechanics_.smallest_pivot(mechanics_.start(), 0);
    for (std::size_t k = 0; k < motion_.samples.size(); ++k)
      least = std::min(
          least, mechanics_.smallest_pivot(motion_.samples[k],
                                           static_cast<reference::Real>(k + 1) *
                                               static_cast<reference::Real>(kSampleInterval)));
    return least;
  }
  double mass() const {
    double sum = 0.0;
    for (const auto& body : mechanics_.scene().bodies) sum += static_cast<double>(body.mass);
    return sum;
  }

  double weight() const {
    double mass = 0.0;
    for (const Body& body : mechanics_.scene().bodies) mass += body.mass;
    return mass * mechanics_.scene().options.gravity.norm();
  }

  // ---- variants: scenes that differ in description only

  Scene transformed(const Quaterniond& q, const Vector3d& x) const {
    Scene scene = mechanics_.scene();
    scene.options.gravity = q * scene.options.gravity;
    for (Body& body : scene.bodies) {
      BodyState& state = body.state;
      state.position = q * state.position + x;
      state.orientation = (q * state.orientation).normalized();
      state.linear_velocity = q * state.linear_velocity;
      state.angular_velocity = q * state.angular_velocity;
    }
    for (Joint& joint : scene.joints) {
      if (joint.body_a == kWorldBody) joint.anchor_a = q * joint.anchor_a + x;
      if (joint.body_b == kWorldBody) joint.anchor_b = q * joint.anchor_b + x;
      if (joint.body_a == kWorldBody) joint.frame_a = q * joint.frame_a;
      if (joint.body_b == kWorldBody && joint.frame_b) joint.frame_b = q * *joint.frame_b;
    }
    return scene;
  }

  Scene reordered(Random* random) const {
    Scene scene = mechanics_.scene();
    const auto shuffle = [&](auto* items) {
      for (std::size_t i = items->size(); i-- > 1;)
        std::swap((*items)[i], (*items)[random->below(i + 1)]);
    };
    std::vector<std::size_t> order(scene.bodies.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    shuffle(&order);
    const std::vector<Body> bodies = scene.bodies;
    std::vector<BodyId> id(order.size() + 1, kWorldBody);
    for (std::size_t i = 0; i < order.size(); ++i) {
      scene.bodies[i] = bodies[order[i]];
      id[order[i] + 1] = BodyId{static_cast<std::uint32_t>(i + 1)};
    }
    for (Joint& joint : scene.joints) {
      joint.body_a = id[joint.body_a.value];
      joint.body_b = id[joint.body_b.value];
    }
    shuffle(&scene.joints);
    // couplings must follow the joints that they couple
    std::stable_partition(scene.joints.begin(), scene.joints.end(),
                          [](const Joint& joint) { return !info(joint.kind).couples_joints; });
    for (Joint& joint : scene.joints)
      for (JointId* coupled : coupled_by(&joint))
        *coupled = id_of(mechanics_.scene().joints[coupled->value - 1].name, scene);
    return scene;
  }

  // Exchanges bodies A and B of joints, and first and second joint of couplings.
  Scene exchanged() const {
    Scene scene = mechanics_.scene();
    // Exchanging bodies reverses the sign of the first coordinate, or selects another coordinate.
    std::vector<double> sign(scene.joints.size(), 1.0);
    std::vector<bool> stays(scene.joints.size(), false);
    for (Joint& joint : scene.joints)
      for (const JointId* coupled : coupled_by(&joint)) {
        const JointKind kind = scene.joints[coupled->value - 1].kind;
        stays[coupled->value - 1] = kind == JointKind::kUniversal || kind == JointKind::kPlanar;
      }
    for (std::size_t j = 0; j < scene.joints.size(); ++j) {
      Joint& joint = scene.joints[j];
      const bool is_of_a =
          joint.kind == JointKind::kPointOnLine ||  // the line, or the plane, belongs to A
          joint.kind == JointKind::kPointOnPlane;
      if (is_of_a || stays[j]) continue;
      if (joint.kind != JointKind::kFreeDistance) sign[j] = -1.0;
      std::swap(joint.body_a, joint.body_b);
      std::swap(joint.anchor_a, joint.anchor_b);
      if (joint.frame_b) std::swap(joint.frame_a, *joint.frame_b);
      if (!info(joint.kind).couples_joints) continue;
      Coupling& coupling = joint.coupling;
      coupling.ratio *= sign[coupling.first.value - 1] * sign[coupling.second.value - 1];
      coupling.ratio = 1.0 / coupling.ratio;
      std::swap(coupling.first, coupling.second);
    }
    return scene;
  }

  // Returns the joints that a gear or pulley couples.
  static std::vector<JointId*> coupled_by(Joint* joint) {
    if (!info(joint->kind).couples_joints) return {};
    return {&joint->coupling.first, &joint->coupling.second};
  }
  static JointId id_of(const std::string& name, const Scene& scene) {
    std::uint32_t number = 1;
    for (const Joint& joint : scene.joints) {
      if (joint.name == name) break;
      ++number;
    }
    return JointId{number};
  }
  static bool is_length(const Scene& scene, JointId joint) {
    return !info(scene.joints[joint.value - 1].kind).is_angle[0];
  }

  // Scales all lengths, with gravity, inertia and the tolerance.
  Scene scaled(double factor) const {
    Scene scene = mechanics_.scene();
    scene.options.gravity *= factor;
    scene.options.tolerance *= factor;
    for (Body& body : scene.bodies) {
      body.state.position *= factor;
      body.state.linear_velocity *= factor;
      body.inertia *= factor * factor;
      if (auto* box = std::get_if<Box>(&body.shape)) box->size *= factor;
    }
    for (Joint& joint : scene.joints) {
      joint.anchor_a *= factor;
      joint.anchor_b *= factor;
      if (joint.distance.length) joint.distance.length = factor * *joint.distance.length;
      joint.distance.min_length *= factor;
      joint.distance.max_length *= factor;
      joint.motor.bias *= factor;
      joint.motor.amplitude *= factor;
      joint.pitch *= factor;
      if (!info(joint.kind).couples_joints) continue;
      if (is_length(scene, joint.coupling.first)) joint.coupling.ratio *= factor;
      if (is_length(scene, joint.coupling.second)) joint.coupling.ratio /= factor;
    }
    return scene;
  }

  // Duplicates joints, except springs and limits, which would add up.
  Scene doubled() const {
    Scene scene = mechanics_.scene();
    for (const Joint& joint : mechanics_.scene().joints) {
      if (reference::is_spring(joint) || reference::is_limit(joint)) continue;
      scene.joints.push_back(joint);
      scene.joints.back().name += "_again";
      for (JointId* coupled : coupled_by(&scene.joints.back()))
        *coupled = id_of(mechanics_.scene().joints[coupled->value - 1].name + "_again", scene);
    }
    return scene;
  }

  Mechanics mechanics_;
  Motion motion_;
  double coordinate_ = 0.0;
  std::optional<double> smallest_pivot_;
  bool has_limits_ = false, is_driven_ = false, is_damped_ = false, turns_ = false;
};

/// Findings on the scene of a seed, and whether the reference could follow its motion.
struct Verdict {
  std::uint64_t seed = 0;
  std::string kind;
  double rate = 0.0;
  bool has_motion = false;
  std::vector<Finding> findings;
};

/// Judges a scene. `only`: name of a setting; empty: all settings and the variants.
inline Verdict judge_scene(const Judge& judge, std::uint64_t seed, const std::string& only) {
  Verdict verdict{
      seed, judge.scene().kind, 1.0 / judge.scene().options.time_step, judge.has_motion(), {}};
  for (const Setting& setting : kSettings) {
    if (!only.empty() && only != setting.name) continue;
    Finding finding = judge.judge(setting);
    if (!finding.what.empty()) verdict.findings.push_back(std::move(finding));
  }
  if (only.empty() || only == "variants")
    for (Finding& finding : judge.compare_variants(seed))
      verdict.findings.push_back(std::move(finding));
  return verdict;
}

inline Verdict judge_seed(std::uint64_t seed, const std::string& only = "") {
  return judge_scene(Judge(Generator(seed).make()), seed, only);
}

/// Returns one line, from which the scene can be reproduced.
inline std::string line_of(const Verdict& verdict, const Finding& finding) {
  char text[512];
  std::snprintf(text, sizeof text, "--only %-5llu %-24s 1/%-4.0f s tick %-4ld %-12s %s | %s",
                static_cast<unsigned long long>(verdict.seed), finding.setting.c_str(),
                verdict.rate, finding.tick, finding.what.c_str(), finding.detail.c_str(),
                verdict.kind.c_str());
  return text;
}

}  // namespace constraint_sim::engine::random_scenes
