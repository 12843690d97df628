#pragma once

// Random mechanisms with loops: random trees with joints that close loops, and planar mechanisms of
// hinges, whose loops have redundant rows.

#include <string>

#include "random_tree.h"

namespace constraint_sim::engine {

/// Adds a joint of the kind between two bodies of a tree, met at their poses; body −1 is the world.
inline void close_loop(JointKind kind, int a, int b, Random* random, RandomTree* tree) {
  const auto state_of = [&](int body) {
    return body < 0 ? tree->base.state : tree->bodies[to_index(body)].state;
  };
  const BodyState &on_a = state_of(a), &on_b = state_of(b);
  Joint joint;
  joint.kind = kind;
  joint.name = "closing_" + std::to_string(tree->links.size());
  joint.anchor_a = 0.3 * random->vector();
  joint.frame_a = random->orientation();
  const Eigen::Vector3d there = on_a.position + on_a.orientation * joint.anchor_a;
  joint.anchor_b = on_b.orientation.conjugate() * (there - on_b.position);
  if (kind == JointKind::kDistance) {
    joint.anchor_b += random->vector();
    joint.frame_a.setIdentity();
  } else if (info(kind).has_frames) {
    joint.frame_b = on_b.orientation.conjugate() * on_a.orientation * joint.frame_a *
                    home(forms(kind).alignment);
  } else {
    joint.frame_a.setIdentity();
  }
  tree->links.push_back({joint, a, b});
}

/// Number of free directions of a joint.
inline int freedom(JointKind kind) { return 6 - forms(kind).rows; }

/// A random tree with as many closing joints as leave it at least one free direction, without
/// motors. Gears may hold further ones.
inline RandomTree random_loops(int seed) {
  constexpr std::array kClosing{JointKind::kBall,      JointKind::kPointOnLine,
                                JointKind::kDistance,  JointKind::kPointOnPlane,
                                JointKind::kUniversal, JointKind::kCylindrical};
  RandomTree tree = random_tree(seed);
  Draws draws(100 * seed + 31);
  for (RandomTree::Link& link : tree.links)
    for (CoordinateLaw& law : link.joint.coordinates) law.motor.reset();
  const bool is_free = tree.links.size() < tree.bodies.size();
  int left = is_free ? 6 : 0;
  for (const RandomTree::Link& link : tree.links) left += freedom(link.joint.kind);
  left -= static_cast<int>(tree.gears.size()) + 1;
  for (std::size_t i = 0; i < 4; ++i) {
    const JointKind kind = kClosing[draws.below(kClosing.size())];
    const int a = static_cast<int>(draws.below(tree.bodies.size() + 1)) - 1;
    const int b = static_cast<int>(draws.below(tree.bodies.size()));
    if (a == b || (is_free && a < 0) || forms(kind).rows > left) continue;
    left -= forms(kind).rows;
    close_loop(kind, a, b, &draws.random, &tree);
  }
  return tree;
}

/// Bars on hinges with parallel axes in a random direction, on the world, with closing hinges and
/// springs.
inline RandomTree random_planar_loops(int seed, double far = 0.0) {
  Draws draws(100 * seed + 57);
  Random& random = draws.random;
  RandomTree tree;
  const Eigen::Vector3d origin = far * Eigen::Vector3d(0.6, -0.64, 0.48);
  const Eigen::Quaterniond plane = random.orientation();  // turns z into the axes
  const std::size_t count = 3 + draws.below(4);
  const auto hinge = [&](int a, int b, const Eigen::Vector3d& at) {
    const auto state_of = [&](int body) {
      return body < 0 ? tree.base.state : tree.bodies[to_index(body)].state;
    };
    Joint joint;
    joint.kind = JointKind::kHinge;
    joint.name = "hinge_" + std::to_string(tree.links.size());
    joint.anchor_a = state_of(a).orientation.conjugate() * (at - state_of(a).position);
    joint.anchor_b = state_of(b).orientation.conjugate() * (at - state_of(b).position);
    joint.frame_a = state_of(a).orientation.conjugate() * plane;
    joint.frame_b = state_of(b).orientation.conjugate() * plane;
    if (draws.share() < 0.3) joint.coordinates[0].stiffness = 5.0 * draws.share();
    if (draws.share() < 0.3) joint.coordinates[0].damping = draws.share();
    tree.links.push_back({joint, a, b});
  };
  const auto in_plane = [&] {
    return Eigen::Vector3d(origin + plane * Eigen::Vector3d(random(), random(), 0.1 * random()));
  };
  for (std::size_t i = 0; i < count; ++i) {
    Body body = make_body("body_" + std::to_string(i), Box{{0.5, 0.3, 0.2}},
                          std::pow(10.0, random()), in_plane());
    body.no_collision = true;
    body.state.orientation = random.orientation();
    tree.bodies.push_back(body);
    const int parent = i == 0 ? -1 : static_cast<int>(draws.below(i));
    hinge(parent, static_cast<int>(i), in_plane());
  }
  const auto parent_of = [&](int body) { return tree.links[to_index(body)].a; };
  const auto is_before = [&](int a, int b) {  // whether a is on the way from b to the world
    while (b > a) b = parent_of(b);
    return a == b;
  };
  const auto hinges_between = [&](int a, int b) {
    int hinges = 0;
    for (; !is_before(b, a); b = parent_of(b)) ++hinges;
    for (; a != b; a = parent_of(a)) ++hinges;
    return hinges;
  };
  std::size_t left = count - 1;  // two of the free directions go with each loop of three and more
  for (int i = 0; i < 8 && left >= 2; ++i) {
    const int a = static_cast<int>(draws.below(count + 1)) - 1,
              b = static_cast<int>(draws.below(count));
    if (hinges_between(a, b) < 3) continue;
    hinge(a, b, in_plane());
    left -= 2;
  }
  return tree;
}

}  // namespace constraint_sim::engine
