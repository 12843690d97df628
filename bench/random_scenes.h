#pragma once

// Random scenes, run by every method, and a judge that finds errors that were not reported. A scene
// depends on its seed alone, with the same numbers on every machine.

#include <cstdint>
#include <random>

#include "joint_type.h"
#include "long_double_reference.h"

namespace constraint_sim::engine::random_scenes {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using reference::Mechanics;
using reference::Pose;
using reference::Scene;

// ---- random numbers

class Random {
 public:
  explicit Random(std::uint64_t seed) : generator_(seed * 2654435761u + 12345u) {
    generator_.discard(8);
  }
  /// Returns a number in [0, 1).
  double unit() { return static_cast<double>(generator_() >> 11) / 9007199254740992.0; }
  double uniform(double from, double to) { return from + (to - from) * unit(); }
  double decades(double from, double to) {
    return std::pow(10.0, uniform(std::log10(from), std::log10(to)));
  }
  std::size_t below(std::size_t n) {
    return std::min(n - 1, static_cast<std::size_t>(unit() * static_cast<double>(n)));
  }
  int between(int from, int to) {
    return from + static_cast<int>(below(static_cast<std::size_t>(to - from + 1)));
  }
  bool chance(double share) { return unit() < share; }
  Vector3d vector(double size) {
    const double x = uniform(-size, size);
    const double y = uniform(-size, size);
    return {x, y, uniform(-size, size)};
  }
  Quaterniond orientation() {
    Quaterniond q;
    do {
      q.vec() = vector(1.0);
      q.w() = uniform(-1.0, 1.0);
    } while (q.norm() > 1.0 || q.norm() < 0.1);
    return q.normalized();
  }

 private:
  std::mt19937_64 generator_;
};

// ---- scenes

/// Builds one scene. Lengths of joints are those of the initial pose, so any number of joints fits.
class Generator {
 public:
  explicit Generator(std::uint64_t seed) : random_(seed) {}

  Scene make() {
    choose();
    add_bodies();
    add_tree();
    add_loops();
    add_dependent_joints();
    add_limits();
    add_springs();
    add_motor();
    set_velocities();
    reference::Scene scene = scene_;
    scene.kind = kind();
    return scene;
  }

 private:
  static constexpr int kRates[] = {10, 30, 60, 100, 240, 1000};

  void choose() {
    Random& r = random_;
    scene_.options.time_step = 1.0 / kRates[r.below(std::size(kRates))];
    if (r.chance(0.15)) scene_.options.gravity = r.vector(10.0);
    if (r.chance(0.1)) scene_.options.gravity.setZero();
    static constexpr double kOrigins[] = {0.0, 0.0, 10.0, 1000.0};
    origin_ = kOrigins[r.below(4)] * (r.orientation() * Vector3d::UnitX());
    const std::size_t mix = r.below(4);
    share_of_boxes_ = mix == 0 ? 0.0 : (mix == 1 ? 1.0 : 0.5);
    is_net_ = r.chance(0.15);
    spreads_masses_ = r.chance(0.25);
    is_free_ = r.chance(0.2);
    has_kinematic_ = !is_free_ && r.chance(0.15);
  }

  std::string kind() const {
    const std::string origin = std::to_string(static_cast<int>(std::lround(origin_.norm())));
    return std::to_string(scene_.bodies.size()) + " bodies, " +
           std::to_string(scene_.joints.size()) + " joints" + words_ + ", " + origin + " m off" +
           (spreads_masses_ ? ", masses over 6 decades" : "");
  }

  double mass() {
    return spreads_masses_ ? random_.decades(1e-3, 1e3) : random_.decades(0.1, 10.0);
  }

  void add_body(const Vector3d& position) {
    Random& r = random_;
    Body body;
    body.name = "body_" + std::to_string(scene_.bodies.size());
    body.no_collision = true;
    body.mass = mass();
    body.state.position = origin_ + position;
    if (!is_net_ && r.chance(share_of_boxes_)) {
      body.shape = Box{{r.uniform(0.1, 0.8), r.uniform(0.05, 0.4), r.uniform(0.05, 0.4)}};
      body.state.orientation = r.orientation();
      if (r.chance(0.3)) {
        const Vector3d s =
            body.mass * r.vector(0.3).cwiseAbs2() + Vector3d::Constant(1e-3 * body.mass);
        body.inertia = {s.y() + s.z(), s.z() + s.x(), s.x() + s.y()};
      }
    }
    scene_.bodies.push_back(body);
  }

  void add_bodies() {
    Random& r = random_;
    if (is_net_) {
      columns_ = r.between(2, 5);
      const int rows = r.between(2, 5);
      for (int i = 0; i < rows; ++i)
        for (int k = 0; k < columns_; ++k) add_body(Vector3d(i, k, 0.0) + r.vector(0.2));
      return;
    }
    const int count = r.between(1, 9);
    const bool is_chain = r.chance(0.4);
    Vector3d p = Vector3d::Zero();
    for (int i = 0; i < count; ++i) {
      p = is_chain ? Vector3d(p + Vector3d(r.uniform(0.4, 1.0), 0.0, 0.0) + r.vector(0.4))
                   : r.vector(1.0 + 0.1 * count);
      add_body(p);
    }
    if (has_kinematic_) {
      Body body;
      body.name = "anchor";
      body.type = BodyType::kKinematic;
      body.state.position = origin_ + r.vector(1.0);
      body.state.linear_velocity = r.vector(0.5);
      body.state.angular_velocity = r.vector(1.0);
      anchor_ = static_cast<int>(scene_.bodies.size());
      scene_.bodies.push_back(body);
    }
  }

  std::size_t movable() const { return scene_.bodies.size() - (anchor_ >= 0 ? 1 : 0); }
  bool turns(int i) const {
    return i < 0 || i == anchor_ || std::holds_alternative<Box>(at(i).shape);
  }
  const Body& at(int i) const { return scene_.bodies[static_cast<std::size_t>(i)]; }

  // Transforms a point from the world's to a body's frame; -1 is the world.
  Vector3d in_body(int i, const Vector3d& p) const {
    if (i < 0) return p;
    return at(i).state.orientation.conjugate() * (p - at(i).state.position);
  }
  Vector3d place(int i, const Vector3d& anchor) const {
    return i < 0 ? anchor : Vector3d(at(i).state.position + at(i).state.orientation * anchor);
  }
  Vector3d point_on(int i) {
    if (i < 0) return origin_ + random_.vector(1.5);
    if (i == anchor_) return place(i, random_.vector(0.5));
    const auto* box = std::get_if<Box>(&at(i).shape);
    if (box == nullptr) return at(i).state.position;
    return place(i, (0.5 * box->size).cwiseProduct(random_.vector(1.0)));
  }

  Joint& add_joint(int a, const Vector3d& p, int b, const Vector3d& q, const JointType& type) {
    Joint joint;
    joint.name = "joint_" + std::to_string(scene_.joints.size());
    joint.body_a = BodyId{static_cast<std::uint32_t>(a + 1)};
    joint.body_b = BodyId{static_cast<std::uint32_t>(b + 1)};
    joint.anchor_a = turns(a) ? in_body(a, p) : Vector3d::Zero();
    joint.anchor_b = turns(b) ? in_body(b, q) : Vector3d::Zero();
    type.write(&joint);
    if (auto* distance = if_distance(joint))
      if (!distance->length && !distance->is_limited())
        distance->length = (place(b, joint.anchor_b) - place(a, joint.anchor_a)).norm();
    scene_.joints.push_back(joint);
    if (random_.chance(0.5)) {
      std::swap(scene_.joints.back().body_a, scene_.joints.back().body_b);
      std::swap(scene_.joints.back().anchor_a, scene_.joints.back().anchor_b);
    }
    return scene_.joints.back();
  }

  void add_rod(int a, int b) {
    const Vector3d p = point_on(a), q = point_on(b);
    if ((p - q).norm() > 0.1) add_joint(a, p, b, q, DistanceJoint{});
  }

  // Adds the joint of a body to its parent in the tree.
  void add_link(int a, int b) {
    Random& r = random_;
    if (!turns(a) && !turns(b)) return add_rod(a, b);
    if (!turns(b) ||
        !turns(a)) {  // a point mass is held at its centre: by a ball joint there, or by a rod
      const int point = turns(b) ? a : b, other = turns(b) ? b : a;
      if (other < 0 || r.chance(0.7)) return add_rod(a, b);
      add_joint(other, at(point).state.position, point, at(point).state.position, JointKind::kBall);
      return;
    }
    const double kind = r.unit();
    if (kind < 0.25) return add_rod(a, b);
    const Vector3d p = r.chance(0.5) ? point_on(b) : Vector3d(0.5 * (point_on(a) + point_on(b)));
    add_joint(a, p, b, p, JointKind::kBall);
    if (kind < 0.6) return;
    const Vector3d q = p + r.vector(0.4);  // a hinge; one of its six rows is redundant
    add_joint(a, q, b, q, JointKind::kBall);
    words_ += words_.find("hinge") == std::string::npos ? ", hinges" : "";
    if (kind > 0.9) {  // locked by a third point off the axis
      const Vector3d s = p + r.vector(0.4);
      add_joint(a, s, b, s, JointKind::kBall);
    }
  }

  void add_tree() {
    Random& r = random_;
    const int ground = anchor_;  // -1: the world
    if (is_net_) {
      const int n = static_cast<int>(movable());
      for (int i = 0; i < n; ++i) {
        if (i % columns_ != 0) add_rod(i - 1, i);
        if (i >= columns_) add_rod(i - columns_, i);
        if (i % columns_ != 0 && i >= columns_ && r.chance(0.15)) add_rod(i - columns_ - 1, i);
      }
      if (!is_free_) {
        add_rod(ground, 0);
        add_rod(ground, columns_ - 1);
      }
      words_ += ", net";
      return;
    }
    for (int i = 0; i < static_cast<int>(movable()); ++i) {
      if (i == 0) {
        if (!is_free_) add_link(ground, 0);
      } else {
        add_link(r.chance(0.6) ? i - 1 : static_cast<int>(r.below(static_cast<std::size_t>(i))), i);
      }
    }
  }

  void add_loops() {
    Random& r = random_;
    if (is_net_ || r.chance(0.4) || movable() < 2) return;
    const int count = r.between(1, static_cast<int>(movable()) + (r.chance(0.3) ? 10 : 0));
    for (int i = 0; i < count; ++i) {
      const int a = is_free_ ? static_cast<int>(r.below(movable()))
                             : r.between(-1, static_cast<int>(movable()) - 1);
      const int b = static_cast<int>(r.below(movable()));
      if (a != b) add_rod(a < 0 ? anchor_ : a, b);
    }
    words_ += ", loops";
  }

  void add_dependent_joints() {
    Random& r = random_;
    if (r.chance(0.5) || scene_.joints.empty()) return;
    const int count = r.between(1, 4);
    for (int i = 0; i < count; ++i) {
      const Joint of = scene_.joints[r.below(scene_.joints.size())];
      const int a = static_cast<int>(of.body_a.value) - 1,
                b = static_cast<int>(of.body_b.value) - 1;
      const Vector3d p = place(a, of.anchor_a), q = place(b, of.anchor_b);
      if (r.chance(0.4) || of.kind != JointKind::kBall) {
        add_joint(a, p, b, q, JointType(of));  // a duplicate
        continue;
      }
      // A rod from the common point, on one body, to another point of the other body.
      const bool is_on_a = turns(a) && (!turns(b) || r.chance(0.5));
      const Vector3d from = p + r.vector(1.0);
      if (is_on_a)
        add_joint(a, from, b, q, DistanceJoint{});
      else
        add_joint(a, p, b, from, DistanceJoint{});
    }
    words_ += ", dependent";
  }

  void add_limits() {
    Random& r = random_;
    if (!r.chance(0.12)) return;
    const int b = static_cast<int>(r.below(movable()));
    const Vector3d p = point_on(anchor_), q = point_on(b);
    const double d = (p - q).norm();
    if (d < 0.1) return;
    DistanceJoint limited;
    const bool is_strut = r.chance(0.4);
    if (is_strut)
      limited.min_length = d * r.uniform(0.7, 1.0);
    else
      limited.max_length = d * r.uniform(1.0, 1.3);
    add_joint(anchor_, p, b, q, limited);
    words_ += is_strut ? ", strut" : ", rope";
  }

  void add_springs() {
    Random& r = random_;
    if (!r.chance(0.3)) return;
    const int count = r.between(1, 3);
    for (int i = 0; i < count; ++i) {
      const int a = is_free_ ? static_cast<int>(r.below(movable())) : anchor_;
      const int b = static_cast<int>(r.below(movable()));
      const Vector3d p = point_on(a), q = point_on(b);
      const double d = (p - q).norm();
      if (a == b || d < 0.2) continue;
      DistanceJoint spring;
      spring.length = d * r.uniform(0.9, 1.1);
      spring.stiffness = r.decades(1.0, 1e6);
      if (r.chance(0.3)) spring.damping = r.decades(0.01, 10.0);
      add_joint(a, p, b, q, spring);
    }
    words_ += ", springs";
  }

  // Adds a motor to a rod without which, by the reference, the other bodies can move.
  void add_motor() {
    Random& r = random_;
    if (!r.chance(0.15)) return;
    Joint& joint = scene_.joints[r.below(scene_.joints.size())];
    const auto* distance = if_distance(joint);
    if (distance == nullptr || distance->is_soft() || distance->is_limited()) return;
    joint.motor.amplitude = r.uniform(0.02, 0.2);
    joint.motor.frequency = r.uniform(0.3, 2.0);
    joint.motor.phase = r.uniform(0.0, 6.0);
    if (r.chance(0.5)) joint.motor.bias = r.uniform(-0.05, 0.05);
    const Mechanics mechanics(scene_);
    std::vector<Pose> poses = mechanics.start_at(0);
    if (mechanics.project(0, &poses) > 1e-9L)
      joint.motor = Motor{};  // other joints hold the length
    else
      words_ += ", motor";
  }

  // Sets random velocities, which the reference projects; one scene in ten is left for the engine
  // to project.
  void set_velocities() {
    Random& r = random_;
    const double speed = r.chance(0.2) ? 0.0 : r.uniform(0.1, 3.0);
    for (Body& body : scene_.bodies) {
      if (body.type != BodyType::kDynamic) continue;
      body.state.linear_velocity = r.vector(speed);
      if (std::holds_alternative<Box>(body.shape)) body.state.angular_velocity = r.vector(speed);
    }
    if (r.chance(0.1)) {
      words_ += ", thrown";
      return;
    }
    const Mechanics mechanics(scene_);
    std::vector<Pose> poses = mechanics.start_at(0);
    mechanics.project(0, &poses);
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      BodyState& state = scene_.bodies[i].state;
      if (scene_.bodies[i].type != BodyType::kDynamic) continue;
      state.linear_velocity = poses[i].v.cast<double>();
      state.angular_velocity = poses[i].w.cast<double>();
    }
  }

  Random random_;
  Scene scene_;
  std::string words_;
  Vector3d origin_ = Vector3d::Zero();
  double share_of_boxes_ = 0.0;
  bool is_net_ = false, spreads_masses_ = false, is_free_ = false, has_kinematic_ = false;
  int columns_ = 1, anchor_ = -1;
};

inline World make_world(const Scene& scene) {
  World world(scene.options);
  for (const Body& body : scene.bodies) world.add_body(body);
  std::vector<JointId> ids;
  for (Joint joint : scene.joints) {
    if (info(joint.kind).couples_joints)
      for (JointId* coupled : {&joint.coupling.first, &joint.coupling.second})
        *coupled = ids[coupled->value - 1];
    ids.push_back(world.add_joint(joint));
  }
  for (const Wrench& wrench : scene.wrenches) world.add_wrench(wrench);
  return world;
}

/// Returns poses in world coordinates.
inline std::vector<Pose> poses_of(const World& world, const Scene& scene) {
  const reference::Vector3 origin(0, 0, 0);
  std::vector<Pose> poses;
  for (const Body& body : scene.bodies)
    poses.push_back(reference::pose_of(world.state(world.find_body(body.name)), origin));
  return poses;
}

}  // namespace constraint_sim::engine::random_scenes
