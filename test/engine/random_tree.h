#pragma once

// Random trees of joints of many kinds, with springs, dampers, motors and gears.

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "constraint_sim/engine/snapshot.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "random_joints.h"
#include "support.h"

namespace constraint_sim::engine {

struct RandomTree {
  RandomTree() {
    options.method = Method::kRungeKutta;
    options.tolerance = 1e-12;
    options.time_step = 0.01;
    options.gravity = {0.3, 0.2, -9.81};
  }

  WorldOptions options;
  std::vector<Body> bodies;
  struct Link {
    Joint joint;
    int a, b;  // −1: the world or the moving base
  };
  std::vector<Link> links;
  struct Gear {
    std::size_t first, second;  // links
    double ratio;
  };
  std::vector<Gear> gears;
  bool has_base = false;
  Body base;

  World world() const {
    World made(options);
    BodyId root = kWorldBody;
    if (has_base) root = made.add_body(base);
    std::vector<BodyId> ids;
    for (const Body& body : bodies) ids.push_back(made.add_body(body));
    const auto id = [&](int i) { return i < 0 ? root : ids[static_cast<std::size_t>(i)]; };
    for (Link link : links) {
      link.joint.body_a = id(link.a);
      link.joint.body_b = id(link.b);
      made.add_joint(link.joint);
    }
    for (const Gear& from : gears) {
      Joint gear;
      gear.name = "gear_" + std::to_string(made.joint_ids().size());
      gear.kind = JointKind::kGear;
      gear.coupling = {made.joint_ids()[from.first], made.joint_ids()[from.second], from.ratio, {}};
      made.add_joint(gear);
    }
    return made;
  }
  /// Makes the tree with a spring of no strength. Islands with springs between points are advanced
  /// by their rows.
  World world_by_rows() const {
    World made = world();
    Joint spring;
    spring.name = "spring";
    spring.kind = JointKind::kDistance;
    spring.body_a = made.body_ids().front();
    spring.body_b = made.body_ids().back();
    spring.anchor_b = {0.3, 0.2, 0.1};
    spring.distance.stiffness = 1e-100;
    made.add_joint(spring);
    return made;
  }
};

/// Returns a body whose joint to `parent` is met, as end A or B of the joint.
inline BodyState hung(const Joint& joint, const BodyState& parent, bool is_a, Random* random) {
  if (!is_a) return attached(joint, parent, random);
  BodyState body = random->state();
  body.orientation = Eigen::Quaterniond::Identity();
  body.position.setZero();
  const BodyState other = attached(joint, body, random);
  const Eigen::Quaterniond turn = parent.orientation * other.orientation.conjugate();
  body.orientation = turn;
  body.position = parent.position - turn * other.position;
  return body;
}

/// Random numbers behind the first ones of a sequence.
struct Draws {
  explicit Draws(int left_out) {
    for (int i = 0; i < left_out; ++i) random();
  }
  double share() { return 0.5 * (random() + 1.0); }  ///< in [0, 1]
  std::size_t below(std::size_t n) {
    return std::min(n - 1, static_cast<std::size_t>(share() * static_cast<double>(n)));
  }

  Random random;
};

inline RandomTree random_tree(int seed, double far = 0.0) {
  constexpr std::array kKinds{
      JointKind::kHinge,     JointKind::kSlider,      JointKind::kCylindrical,
      JointKind::kUniversal, JointKind::kPlanar,      JointKind::kWeld,
      JointKind::kParallel,  JointKind::kPointOnLine, JointKind::kPointOnPlane,
      JointKind::kBall,      JointKind::kScrew};
  Draws draws(100 * seed + 7);
  Random& random = draws.random;
  RandomTree tree;
  const std::size_t count = 2 + draws.below(4), root = draws.below(4);
  const Eigen::Vector3d origin = far * Eigen::Vector3d(0.6, -0.64, 0.48);
  BodyState base;
  tree.has_base = root == 3;
  if (tree.has_base) {
    tree.base = make_body("base", Box{{0.5, 0.3, 0.2}}, 1.0, Eigen::Vector3d::Zero());
    tree.base.type = BodyType::kKinematic;
    tree.base.no_collision = true;
    tree.base.state = random.state();
    tree.base.state.position += origin;
    base = tree.base.state;
  }
  for (std::size_t i = 0; i < count; ++i) {
    Body body = make_body("body_" + std::to_string(i), Box{{0.5, 0.3, 0.2}},
                          std::pow(10.0, 3.0 * random()), Eigen::Vector3d::Zero());
    body.no_collision = true;
    body.state = random.state();
    body.state.position += origin;
    const bool is_free = i == 0 && root == 2;
    if (!is_free) {
      const int parent = i == 0 ? -1 : static_cast<int>(draws.below(i));
      const JointKind kind = kKinds[draws.below(kKinds.size())];
      Joint joint = random_joint(kind, &random);
      joint.name = "joint_" + std::to_string(i);
      if (!info(kind).has_frames)
        joint.frame_a = joint.frame_b.emplace(Eigen::Quaterniond::Identity());
      const bool is_a = draws.share() < 0.4;
      if (parent < 0 && !tree.has_base) (is_a ? joint.anchor_b : joint.anchor_a) += origin;
      body.state =
          hung(joint, parent < 0 ? base : tree.bodies[to_index(parent)].state, is_a, &random);
      if (!info(kind).has_frames) joint.frame_b.reset();
      for (std::size_t c = 0; c < to_index(info(kind).coordinates); ++c) {
        CoordinateLaw& law = joint.coordinates[c];
        const double which = draws.share();
        if (which < 0.3) {
          law.stiffness = 5.0 * draws.share();
          law.damping = draws.share();
          law.rest = random();
        } else if (which < 0.45 && kind != JointKind::kScrew) {  // motors of both would contradict
          Motor motor;
          if (which < 0.4) {  // else it holds the coordinate
            motor.bias = random();
            motor.amplitude = random();
            motor.frequency = 1.0;
          }
          law.motor = motor;
        }
      }
      const int own = static_cast<int>(i);
      tree.links.push_back({joint, is_a ? own : parent, is_a ? parent : own});
    }
    tree.bodies.push_back(body);
  }
  // A train of gears between first coordinates of joints without motors.
  std::vector<std::size_t> free_ones;
  for (std::size_t l = 0; l < tree.links.size(); ++l) {
    const Joint& joint = tree.links[l].joint;
    if (info(joint.kind).coordinates > 0 && !joint.coordinates[0].motor) free_ones.push_back(l);
  }
  for (std::size_t i = 0; i + 1 < free_ones.size() && draws.share() < 0.5; ++i)
    tree.gears.push_back({free_ones[i], free_ones[i + 1], 2.0 * draws.share() - 2.5});
  return tree;
}

/// Whether the tree is integrated in joint coordinates: at most half of the bodies turn by three
/// angles.
inline bool has_coordinates(const RandomTree& tree) {
  std::size_t turning = tree.links.size() < tree.bodies.size() ? 1 : 0;
  for (const RandomTree::Link& link : tree.links)
    turning += forms(link.joint.kind).alignment == Alignment::kFree ? 1 : 0;
  return 2 * turning <= tree.bodies.size();
}

/// Largest difference of positions, and of orientations at 1 m.
inline double difference(const World& a, const World& b) {
  double largest = 0.0;
  for (const BodyId id : a.body_ids()) {
    largest = std::max(largest, (a.state(id).position - b.state(id).position).norm());
    largest = std::max(largest, a.state(id).orientation.angularDistance(b.state(id).orientation));
  }
  return largest;
}

/// Takes 0.2 s in ticks of 1/100 s or shorter ones.
inline World after_steps(World world, int divisor = 1) {
  WorldOptions options = world.options();
  options.time_step /= divisor;
  world.set_options(options);
  for (int i = 0; i < 20 * divisor; ++i) EXPECT_FALSE(world.step().outcome.failed);
  return world;
}

/// Largest distance of the ends of a joint from what its rows allow, by the published poses [m].
inline double opening(const World& world, JointId id) {
  const Joint& joint = world.joint(id);
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, world.state(joint.body_a), world.state(joint.body_b));
  double largest = 0.0;
  for (int k = 0; k < kind.rows; ++k)
    largest = std::max(largest, std::abs(value(kind.row[to_index(k)], vectors)));
  return largest;
}

/// Expects that a copy and a snapshot of the moving mechanism go on with its bits.
inline void expect_goes_on(RandomTree tree) {
  tree.options.tolerance = 1e-8;
  World world = tree.world();
  for (int i = 0; i < 7; ++i) world.step();
  World copy = world, read = read_snapshot(write_snapshot(world));
  EXPECT_EQ(read.state_hash(), world.state_hash());
  for (int i = 0; i < 7; ++i)
    for (World* each : {&world, &copy, &read}) ASSERT_FALSE(each->step().outcome.failed);
  EXPECT_EQ(copy.state_hash(), world.state_hash());
  EXPECT_EQ(read.state_hash(), world.state_hash());
}

inline constexpr double kRowsAgree = 2e-8;  // [m], [rad]

inline void expect_same_forces(const World& one, const World& other, std::size_t joints,
                               double share = 1e-6) {
  for (std::size_t j = 0; j < joints; ++j) {
    const JointId id = one.joint_ids()[j];
    const World::JointWrench a = one.joint_wrench(id), b = other.joint_wrench(id);
    const double size = 1.0 + b.force.norm() + b.torque.norm();
    EXPECT_LE((a.force - b.force).norm(), share * size) << j;
    EXPECT_LE((a.torque - b.torque).norm(), share * size) << j;
    for (std::size_t c = 0; c < kMaxCoordinates; ++c)
      EXPECT_NEAR(one.joint_state(id).coordinates[c].position,
                  other.joint_state(id).coordinates[c].position, kRowsAgree)
          << j;
  }
}

}  // namespace constraint_sim::engine
