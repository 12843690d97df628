#pragma once

// Joints of the reference in long double: rows of up to four bodies, with C and γ, free
// coordinates, and errors. They read the public structs alone.

#include <array>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "dense_factors.h"

namespace constraint_sim::engine::reference {

/// Bodies, joints and forces as given to a World, in the order of their ids: body i is BodyId{i +
/// 1}, joint j is JointId{j + 1}, and coupled joints come before their coupling.
struct Scene {
  std::string kind;
  WorldOptions options;
  std::vector<Body> bodies;
  std::vector<Joint> joints;
  std::vector<Wrench> wrenches;  ///< constant from the start
};

inline bool is_spring(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance != nullptr && distance->is_soft();
}

inline bool is_limit(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance != nullptr && distance->is_limited();
}

struct Pose {
  Vector3 x, v, w;
  Quaternion q;
};

template <class Items>
auto& at(Items& items, int i) {
  return items[static_cast<std::size_t>(i)];
}

// ---- rows

/// A row: C, γ = C̈ − J V̇, the target of Ċ, and J by bodies.
struct Row {
  struct Block {
    int body = -1;
    Vector3 v, w;
  };
  std::array<Block, 4> blocks;
  std::size_t count = 0;
  Real C = 0, target = 0, gamma = 0;

  const Block* begin() const { return blocks.data(); }
  const Block* end() const { return blocks.data() + count; }

  /// Adds a block of J; the world, -1, has none.
  void add(int body, const Vector3& v, const Vector3& w) {
    if (body < 0) return;
    for (std::size_t i = 0; i < count; ++i) {
      if (blocks[i].body != body) continue;
      blocks[i].v += v;
      blocks[i].w += w;
      return;
    }
    blocks[count++] = {body, v, w};
  }
  void add(Real factor, const Row& other) {
    for (const Block& block : other) add(block.body, factor * block.v, factor * block.w);
    C += factor * other.C;
    gamma += factor * other.gamma;
  }
  Real times(const std::vector<Pose>& twists) const {
    Real sum = 0;
    for (const Block& block : *this)
      sum += block.v.dot(at(twists, block.body).v) + block.w.dot(at(twists, block.body).w);
    return sum;
  }
};

/// A vector of a joint: fixed in A (0) or B (1), the separation d (2), or constant (3); with its
/// rate, and its second derivative without accelerations.
struct Vector {
  Vector3 value, rate, gamma;
  int fixed_in;
};

/// A joint in the present poses: anchors, frames, and d from anchor A to anchor B.
struct Placed {
  int a, b;  // -1: the world
  Vector3 r_A, r_B;
  Quaternion frame_A, frame_B;
  Vector d;

  /// Positions of poses are relative to `origin`.
  Placed(const Joint& joint, const std::vector<Pose>& poses, const Vector3& origin)
      : a(static_cast<int>(joint.body_a.value) - 1),
        b(static_cast<int>(joint.body_b.value) - 1),
        r_A(joint.anchor_a.cast<Real>()),
        r_B(joint.anchor_b.cast<Real>()),
        frame_A(joint.frame_a.cast<Real>().normalized()),
        frame_B(joint.frame_b.value_or(Eigen::Quaterniond::Identity()).cast<Real>().normalized()) {
    const Vector3 zero(0, 0, 0);
    d = {zero, zero, zero, 2};
    put(a, -1, poses, origin, &r_A, &frame_A);
    put(b, 1, poses, origin, &r_B, &frame_B);
    d.value += r_B - r_A;
    w_A = a >= 0 ? at(poses, a).w : zero;
    w_B = b >= 0 ? at(poses, b).w : zero;
  }

  Vector on_a(int k) const { return axis(frame_A, k, a, w_A, 0); }
  Vector on_b(int k) const { return axis(frame_B, k, b, w_B, 1); }
  static Vector on_world(int k) {
    return {Vector3::Unit(k), Vector3(0, 0, 0), Vector3(0, 0, 0), 3};
  }

  /// Returns the row of n·ḋ.
  Row along(const Vector3& n) const {
    Row row;
    row.add(a, -n, -r_A.cross(n));
    row.add(b, n, r_B.cross(n));
    return row;
  }

  /// Returns the row of u·v = 0.
  Row product(const Vector& u, const Vector& v) const {
    Row row;
    row.C = u.value.dot(v.value);
    row.gamma = u.gamma.dot(v.value) + 2 * u.rate.dot(v.rate) + u.value.dot(v.gamma);
    for (const auto& [moving, other] : {std::pair(&u, &v), std::pair(&v, &u)}) {
      const Vector3& n = other->value;
      const Vector3 turning = moving->value.cross(n);
      if (moving->fixed_in == 0) row.add(a, Vector3(0, 0, 0), turning);
      if (moving->fixed_in == 1) row.add(b, Vector3(0, 0, 0), turning);
      if (moving->fixed_in == 2) row.add(1, along(n));
    }
    return row;
  }

  Vector3 w_A, w_B;

 private:
  void put(int body, Real sign, const std::vector<Pose>& poses, const Vector3& origin, Vector3* r,
           Quaternion* frame) {
    if (body < 0) {
      *r -= origin;
      return;
    }
    const Pose& pose = at(poses, body);
    *r = pose.q * *r;
    *frame = pose.q * *frame;
    d.value += sign * pose.x;
    d.rate += sign * (pose.v + pose.w.cross(*r));
    d.gamma += sign * pose.w.cross(pose.w.cross(*r));
  }
  static Vector axis(const Quaternion& frame, int k, int body, const Vector3& w, int fixed_in) {
    const Vector3 u = frame * Vector3(Vector3::Unit(k));
    if (body < 0) return {u, Vector3(0, 0, 0), Vector3(0, 0, 0), 3};
    return {u, w.cross(u), w.cross(w.cross(u)), fixed_in};
  }
};

/// Adds rows of every kind except kDistance, which depends on its length, and couplings.
inline void add_rows(JointKind kind, const Placed& p, std::vector<Row>* rows) {
  const auto add = [&](const Vector& u, const Vector& v) { rows->push_back(p.product(u, v)); };
  const auto add_point = [&] {
    for (int k = 0; k < 3; ++k) add(Placed::on_world(k), p.d);
  };
  const auto add_parallel = [&] {  // z_B along z_A
    add(p.on_a(0), p.on_b(2));
    add(p.on_a(1), p.on_b(2));
  };
  const auto add_line = [&] {
    add(p.on_a(0), p.d);
    add(p.on_a(1), p.d);
  };
  switch (kind) {
    case JointKind::kDistance:
    case JointKind::kFreeDistance:
    case JointKind::kGear:
    case JointKind::kPulley:
    case JointKind::kCustom:
    case JointKind::kCustomForce:
      break;
    case JointKind::kBall:
      return add_point();
    case JointKind::kHinge:
      add_point();
      return add_parallel();
    case JointKind::kUniversal:
      add_point();
      return add(p.on_a(2), p.on_b(2));
    case JointKind::kWeld:
      add_point();
      add_parallel();
      return add(p.on_a(1), p.on_b(0));
    case JointKind::kSlider:
      add_line();
      add_parallel();
      return add(p.on_a(1), p.on_b(0));
    case JointKind::kCylindrical:
    case JointKind::kScrew:
      add_line();
      return add_parallel();
    case JointKind::kPlanar:
      add(p.on_a(2), p.d);
      return add_parallel();
    case JointKind::kPointOnLine:
      return add_line();
    case JointKind::kPointOnPlane:
      return add(p.on_a(2), p.d);
    case JointKind::kParallel:
      return add_parallel();
  }
}

// ---- coordinates

/// Returns q as C, angles in [−π, π], with its gradient and γ. `which`: 0, or 1 for the angle of a
/// screw. An angle is the twist about z_A, whose rate is z_A·(ω_B − ω_A) where the joint is
/// satisfied, in universal joints too; that rate is used elsewhere as well.
inline Row coordinate(JointKind kind, const Placed& p, int which) {
  switch (kind) {
    case JointKind::kFreeDistance: {
      const Real length = p.d.value.norm();
      const Vector3 n = p.d.value / length;
      Row row = p.along(n);
      const Real rate = n.dot(p.d.rate);
      row.C = length;
      row.gamma = (p.d.rate.squaredNorm() - rate * rate) / length + n.dot(p.d.gamma);
      return row;
    }
    case JointKind::kPlanar:
    case JointKind::kPointOnPlane:
      return p.product(p.on_a(0), p.d);
    case JointKind::kHinge:
    case JointKind::kParallel:
    case JointKind::kUniversal:
    case JointKind::kScrew:
      if (kind == JointKind::kScrew && which == 0) break;
      {
        const Vector3 z = p.on_a(2).value;
        const auto on_a = [&](int i, int k) { return p.on_a(i).value.dot(p.on_b(k).value); };
        Row row;
        row.add(p.a, Vector3(0, 0, 0), -z);
        row.add(p.b, Vector3(0, 0, 0), z);
        row.C = kind == JointKind::kUniversal
                    ? std::atan2(on_a(1, 2), on_a(0, 2))
                    : std::atan2(on_a(1, 0) - on_a(0, 1), on_a(0, 0) + on_a(1, 1));
        row.gamma = p.w_A.cross(z).dot(p.w_B);
        return row;
      }
    default:
      break;
  }
  return p.product(p.on_a(2), p.d);  // translation along z_A
}

inline bool is_angle(const Joint& joint, int which) {
  return joint.kind == JointKind::kHinge || joint.kind == JointKind::kParallel ||
         joint.kind == JointKind::kUniversal || (joint.kind == JointKind::kScrew && which == 1);
}

/// A term of Σ ratio q of a coupling; `joint` is an index.
struct Term {
  std::size_t joint;
  int which;
  Real ratio;
};
inline std::array<Term, 2> terms_of(const std::vector<Joint>& joints, std::size_t j) {
  const Joint& joint = joints[j];
  const Real turn = 2 * std::acos(Real{-1});
  if (joint.kind == JointKind::kScrew)
    return {{{j, 0, 1}, {j, 1, -static_cast<Real>(joint.pitch) / turn}}};
  return {{{joint.coupling.first.value - 1, 0, 1},
           {joint.coupling.second.value - 1, 0, static_cast<Real>(joint.coupling.ratio)}}};
}

// ---- errors

/// Returns the larger of the joint's distance error and angle error times radius of gyration, for
/// every kind except kDistance, without couplings.
inline Real error_of(JointKind kind, const Placed& p, Real radius) {
  const Vector3 z_A = p.on_a(2).value, z_B = p.on_b(2).value;
  const Real along = z_A.dot(p.d.value);
  const Real aside = (p.d.value - along * z_A).norm();
  Real gap = p.d.value.norm(), angle = 0;
  const auto between = [&] { return std::atan2(z_A.cross(z_B).norm(), z_A.dot(z_B)); };
  switch (kind) {
    case JointKind::kDistance:
    case JointKind::kBall:
      break;
    case JointKind::kFreeDistance:
    case JointKind::kGear:
    case JointKind::kPulley:
    case JointKind::kCustom:
    case JointKind::kCustomForce:
      return 0;
    case JointKind::kHinge:
      angle = between();
      break;
    case JointKind::kUniversal:
      angle = std::abs(std::atan2(z_A.dot(z_B), z_A.cross(z_B).norm()));
      break;
    case JointKind::kSlider:
      gap = aside;
      [[fallthrough]];
    case JointKind::kWeld: {
      const Quaternion q = p.frame_A.conjugate() * p.frame_B;
      angle = 2 * std::atan2(q.vec().norm(), std::abs(q.w()));
      break;
    }
    case JointKind::kCylindrical:
    case JointKind::kScrew:
      gap = aside;
      angle = between();
      break;
    case JointKind::kPlanar:
      gap = std::abs(along);
      angle = between();
      break;
    case JointKind::kPointOnLine:
      gap = aside;
      break;
    case JointKind::kPointOnPlane:
      gap = std::abs(along);
      break;
    case JointKind::kParallel:
      gap = 0;
      angle = between();
      break;
  }
  return std::max(gap, radius * angle);
}

}  // namespace constraint_sim::engine::reference
