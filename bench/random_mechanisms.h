#pragma once

// Random mechanisms of joints of all kinds, for the judge of random scenes: trees, loops that fit
// the initial pose, planar loops of hinges, duplicated joints, gears, racks, screws and pulleys;
// masses over six decades, 1 m and 1 km from the origin. A mechanism depends on its seed alone,
// with the same numbers everywhere.

#include "scene_judge.h"

namespace constraint_sim::engine::random_scenes {

class MechanismGenerator {
 public:
  explicit MechanismGenerator(std::uint64_t seed) : random_(seed + 1000000) {}

  Scene make() {
    choose();
    if (is_planar_)
      add_planar_loops();
    else
      add_tree();
    if (!is_planar_) add_loops();
    add_again();
    if (!is_planar_) add_couplings();
    set_velocities();
    const std::string origin = std::to_string(static_cast<int>(std::lround(origin_.norm())));
    scene_.kind = std::to_string(scene_.bodies.size()) + " bodies, " +
                  std::to_string(scene_.joints.size()) + " joints" + words_ + ", " + origin +
                  " m off";
    return scene_;
  }

 private:
  static constexpr int kRates[] = {30, 60, 100, 240};

  void choose() {
    Random& r = random_;
    scene_.options.time_step = 1.0 / kRates[r.below(std::size(kRates))];
    if (r.chance(0.2)) scene_.options.gravity.setZero();
    origin_ = (r.chance(0.3) ? 1000.0 : 1.0) * (r.orientation() * Vector3d::UnitX());
    is_planar_ = r.chance(0.3);
    is_free_ = !is_planar_ && r.chance(0.25);
    has_kinematic_ = !is_planar_ && !is_free_ && r.chance(0.2);
    spreads_masses_ = r.chance(0.5);
    words_ += spreads_masses_ ? ", masses over 6 decades" : "";
  }

  Body body() {
    Random& r = random_;
    Body made;
    made.name = "body_" + std::to_string(scene_.bodies.size());
    made.no_collision = true;
    made.mass = spreads_masses_ ? r.decades(1e-3, 1e3) : r.decades(0.3, 3.0);
    made.shape = Box{{r.uniform(0.2, 0.6), r.uniform(0.2, 0.6), r.uniform(0.2, 0.6)}};
    return made;
  }

  const BodyState& state(int i) const {
    static const BodyState world;
    return i < 0 ? world : scene_.bodies[static_cast<std::size_t>(i)].state;
  }
  int bodies() const { return static_cast<int>(scene_.bodies.size()); }

  JointKind any_kind() {
    constexpr auto kKinds = static_cast<std::size_t>(JointKind::kPointOnPlane) + 2;
    const std::size_t kind = random_.below(kKinds);
    return kind + 1 == kKinds ? JointKind::kScrew : static_cast<JointKind>(kind);
  }

  void add(Joint joint, int a, int b) {
    joint.name = std::string(name(joint.kind)) + "_" + std::to_string(scene_.joints.size());
    joint.body_a = BodyId{static_cast<std::uint32_t>(a + 1)};
    joint.body_b = BodyId{static_cast<std::uint32_t>(b + 1)};
    if (!info(joint.kind).has_frames) joint.frame_b.reset();
    scene_.joints.push_back(joint);
  }

  static bool turns_over(JointKind kind) { return info(kind).has_two_axes; }
  // Returns the frame on B relative to A at zero; in universal joints z_B is normal to z_A.
  static Quaterniond home_of(JointKind kind) {
    return turns_over(kind) ? Quaterniond(std::sqrt(0.5), std::sqrt(0.5), 0.0, 0.0)
                            : Quaterniond::Identity();
  }
  bool frees_rotation(JointKind kind) const {
    return kind == JointKind::kDistance || kind == JointKind::kBall ||
           kind == JointKind::kPointOnLine || kind == JointKind::kPointOnPlane;
  }

  /// Places a body at a random position of a joint to its parent, and joins it.
  void hang(int parent, JointKind kind) {
    Random& r = random_;
    Joint joint;
    joint.kind = kind;
    joint.anchor_a = (parent < 0 ? origin_ : Vector3d(Vector3d::Zero())) + r.vector(0.5);
    joint.anchor_b = r.vector(0.5);
    joint.frame_a = r.orientation();
    joint.frame_b = r.orientation();
    const BodyState& a = state(parent);
    const Quaterniond frame_A = a.orientation * joint.frame_a;
    Vector3d off = Vector3d::Zero();
    const double along = r.uniform(-0.5, 0.5);
    if (kind == JointKind::kScrew) joint.pitch = (r.chance(0.5) ? 1.0 : -1.0) * r.decades(0.1, 2.0);
    if (kind == JointKind::kSlider || kind == JointKind::kCylindrical ||
        kind == JointKind::kPointOnLine || kind == JointKind::kScrew)
      off = frame_A * Vector3d(0.0, 0.0, along);
    if (kind == JointKind::kPlanar || kind == JointKind::kPointOnPlane)
      off = frame_A * Vector3d(along, r.uniform(-0.5, 0.5), 0.0);
    if (kind == JointKind::kDistance) {
      off = r.orientation() * Vector3d(r.uniform(0.3, 1.0), 0.0, 0.0);
      joint.distance.length = off.norm();
    }
    Quaterniond frame_B = frame_A;
    if (kind != JointKind::kSlider && kind != JointKind::kWeld)
      frame_B = frame_A * Quaterniond(Eigen::AngleAxisd(r.uniform(-1.0, 1.0), Vector3d::UnitZ()));
    frame_B = frame_B * home_of(kind);
    if (frees_rotation(kind)) frame_B = r.orientation();
    Body made = body();
    made.state.orientation = (frame_B * joint.frame_b->conjugate()).normalized();
    made.state.position =
        a.position + a.orientation * joint.anchor_a + off - made.state.orientation * joint.anchor_b;
    scene_.bodies.push_back(made);
    add(joint, parent, bodies() - 1);
  }

  void add_tree() {
    Random& r = random_;
    if (has_kinematic_) {
      Body base;
      base.name = "base";
      base.type = BodyType::kKinematic;
      base.no_collision = true;
      base.state.position = origin_;
      base.state.orientation = r.orientation();
      base.state.linear_velocity = r.vector(0.5);
      base.state.angular_velocity = r.vector(0.5);
      scene_.bodies.push_back(base);
      words_ += ", moving base";
    }
    const int ground = has_kinematic_ ? 0 : -1;
    const int first = bodies(), count = r.between(2, 6);
    if (is_free_) {
      Body root = body();
      root.state.position = origin_;
      root.state.orientation = r.orientation();
      scene_.bodies.push_back(root);
    }
    while (bodies() < first + count)
      hang(bodies() == first
               ? ground
               : first + static_cast<int>(r.below(static_cast<std::size_t>(bodies() - first))),
           any_kind());
  }

  /// Joins two bodies in their present pose, about a point near them.
  void join(int a, int b, JointKind kind, const Vector3d& p, const Quaterniond& frame) {
    Joint joint;
    joint.kind = kind;
    const BodyState &of_a = state(a), &of_b = state(b);
    const Vector3d off =
        kind == JointKind::kDistance ? Vector3d(0.4, 0.2, 0.3) : Vector3d(Vector3d::Zero());
    joint.anchor_a = of_a.orientation.conjugate() * (p - of_a.position);
    joint.anchor_b = of_b.orientation.conjugate() * (p + off - of_b.position);
    joint.frame_a = (of_a.orientation.conjugate() * frame).normalized();
    joint.frame_b = (of_b.orientation.conjugate() * frame * home_of(kind)).normalized();
    if (kind == JointKind::kDistance) joint.distance.length = off.norm();
    add(joint, a, b);
  }

  void add_loops() {
    Random& r = random_;
    const int first = has_kinematic_ ? 1 : 0;
    const auto any = [&] {
      return first + static_cast<int>(r.below(static_cast<std::size_t>(bodies() - first)));
    };
    const int count = r.between(0, 2);
    for (int i = 0; i < count; ++i) {
      const int a = any(), b = any();
      if (a == b) continue;
      // kinds with few rows, so that most such loops still move
      static constexpr JointKind kKinds[] = {JointKind::kDistance,     JointKind::kBall,
                                             JointKind::kPointOnPlane, JointKind::kPointOnLine,
                                             JointKind::kUniversal,    JointKind::kPlanar};
      join(a, b, kKinds[r.below(std::size(kKinds))], state(b).position + r.vector(0.4),
           r.orientation());
      words_ += words_.find("loops") == std::string::npos ? ", loops" : "";
    }
  }

  /// Adds four-bars and slider-cranks in one plane, of hinges and sliders: three redundant rows per
  /// loop.
  void add_planar_loops() {
    Random& r = random_;
    const Quaterniond plane = r.orientation();
    const int loops = r.between(1, 2);
    Vector3d left(0.0, 0.0, 0.0);
    int before = -1;
    for (int i = 0; i < loops; ++i) {
      const Vector3d a = left, d = a + Vector3d(r.uniform(1.4, 1.8), r.uniform(-0.2, 0.2), 0.0);
      const Vector3d b = a + Vector3d(r.uniform(0.2, 0.4), r.uniform(0.7, 1.0), 0.0);
      const Vector3d c = d + Vector3d(r.uniform(-0.3, 0.0), r.uniform(0.8, 1.2), 0.0);
      const Vector3d corner[] = {a, b, c, d};
      int bars[3];
      for (int k = 0; k < 3; ++k) {
        if (k == 0 && before >= 0) {  // shares the last bar of the previous loop
          bars[0] = before;
          continue;
        }
        Body bar = body();
        const Vector3d from = corner[k], to = corner[k + 1];
        const double angle = std::atan2(to.y() - from.y(), to.x() - from.x());
        bar.state.position = origin_ + plane * Vector3d(0.5 * (from + to));
        bar.state.orientation =
            plane * Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitZ())) *
            Quaterniond(Eigen::AngleAxisd(r.uniform(-3.0, 3.0), Vector3d::UnitX()));
        bars[k] = bodies();
        scene_.bodies.push_back(bar);
      }
      const auto pin = [&](int of, int on, const Vector3d& p) {
        join(of, on, JointKind::kHinge, origin_ + plane * p, plane);
      };
      if (before < 0) pin(-1, bars[0], a);
      pin(bars[0], bars[1], b);
      pin(bars[1], bars[2], c);
      if (r.chance(0.3)) {  // the last bar slides on a rail along x instead of turning on a hinge
        const Quaterniond rail =
            plane * Quaterniond(Eigen::AngleAxisd(0.5 * 3.14159265358979323846, Vector3d::UnitY()));
        join(-1, bars[2], JointKind::kSlider, origin_ + plane * d, rail);
      } else {
        pin(-1, bars[2], d);
        before = bars[2];
        left = d;
        continue;
      }
      break;
    }
    words_ += ", planar";
  }

  void add_again() {
    Random& r = random_;
    if (!r.chance(0.4)) return;
    Joint again = scene_.joints[r.below(scene_.joints.size())];
    again.name += "_once_more";
    scene_.joints.push_back(again);
    words_ += ", one joint twice";
  }

  void couple(JointKind kind, std::size_t first, std::size_t second) {
    Joint joint;
    joint.kind = kind;
    joint.name = std::string(name(kind)) + "_" + std::to_string(scene_.joints.size());
    joint.coupling.first = JointId{static_cast<std::uint32_t>(first + 1)};
    joint.coupling.second = JointId{static_cast<std::uint32_t>(second + 1)};
    joint.coupling.ratio = (random_.chance(0.5) ? 1.0 : -1.0) * random_.decades(0.3, 3.0);
    scene_.joints.push_back(joint);
  }

  /// Adds a length of one to three metres, from a point of one body or the world to another.
  std::size_t rope(int a, int b) {
    Joint joint;
    joint.kind = JointKind::kFreeDistance;
    joint.anchor_b = random_.vector(0.3);
    const Vector3d end = state(b).position + state(b).orientation * joint.anchor_b;
    const Vector3d off = random_.orientation() * Vector3d(random_.uniform(1.0, 3.0), 0.0, 0.0);
    joint.anchor_a = state(a).orientation.conjugate() * (end + off - state(a).position);
    add(joint, a, b);
    return scene_.joints.size() - 1;
  }

  /// Adds gears between any first coordinates, angles and translations, hence racks too, and
  /// pulleys.
  void add_couplings() {
    Random& r = random_;
    if (!r.chance(0.6)) return;
    std::vector<std::size_t> with_coordinates;
    for (std::size_t j = 0; j < scene_.joints.size(); ++j)
      if (info(scene_.joints[j].kind).coordinates > 0) with_coordinates.push_back(j);
    const int gears = r.between(0, 2);
    const std::size_t n = with_coordinates.size();
    for (int i = 0; i < gears && n > 1; ++i) {
      const std::size_t first = r.below(n), second = (first + 1 + r.below(n - 1)) % n;
      couple(JointKind::kGear, with_coordinates[first], with_coordinates[second]);
    }
    const int ground = is_free_ || has_kinematic_ ? 0 : -1, count = bodies() - (ground + 1);
    if (count > 1 && r.chance(0.4)) {
      const int first = ground + 1 + static_cast<int>(r.below(static_cast<std::size_t>(count)));
      const int second = ground + 1 + static_cast<int>(r.below(static_cast<std::size_t>(count)));
      const std::size_t left = rope(ground, first), right = rope(ground, second);
      couple(JointKind::kPulley, left, right);
    }
    if (info(scene_.joints.back().kind).couples_joints) words_ += ", couplings";
    if (info(scene_.joints.back().kind).couples_joints && r.chance(0.2)) {
      scene_.joints.push_back(scene_.joints.back());
      scene_.joints.back().name += "_once_more";
    }
  }

  // Sets random velocities; the reference projects them onto the joints.
  void set_velocities() {
    const double speed = random_.uniform(0.2, 2.0);
    for (Body& made : scene_.bodies) {
      if (made.type != BodyType::kDynamic) continue;
      made.state.linear_velocity = random_.vector(speed);
      made.state.angular_velocity = random_.vector(speed);
    }
    const Mechanics mechanics(scene_);
    std::vector<Pose> poses = mechanics.start_at(0);
    mechanics.project(0, &poses);
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      if (scene_.bodies[i].type != BodyType::kDynamic) continue;
      scene_.bodies[i].state.linear_velocity = poses[i].v.cast<double>();
      scene_.bodies[i].state.angular_velocity = poses[i].w.cast<double>();
    }
  }

  Random random_;
  Scene scene_;
  std::string words_;
  Vector3d origin_ = Vector3d::Zero();
  bool is_planar_ = false, is_free_ = false, has_kinematic_ = false, spreads_masses_ = false;
};

/// Judges a mechanism, with the strict bound for joints.
inline Verdict judge_mechanism(std::uint64_t seed, const std::string& only = "") {
  return judge_scene(Judge(MechanismGenerator(seed).make(), true), seed, only);
}

}  // namespace constraint_sim::engine::random_scenes
