#pragma once

// Scenes with dependent, contradictory or badly scaled joints. Each builder says which properties
// must hold. Lengths are in metres, masses in kg; the caller sets methods and ticks.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "engine/math/numbers.h"
#include "joint_type.h"
#include "problems.h"
#include "rotation_between.h"

namespace constraint_sim::engine::redundant {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// ---- parts

inline Body body_at(const std::string& name, const Vector3d& size, double mass,
                    const Vector3d& position,
                    const Quaterniond& orientation = Quaterniond::Identity()) {
  Body body;
  body.name = name;
  body.shape = Box{size};
  body.mass = mass;
  body.no_collision = true;
  body.state.position = position;
  body.state.orientation = orientation;
  return body;
}

/// Transforms a point from the world's to a body's frame.
inline Vector3d in_body(const World& world, BodyId id, const Vector3d& p_W) {
  if (id == kWorldBody) return p_W;
  const BodyState& state = world.state(id);
  return state.orientation.conjugate() * (p_W - state.position);
}

/// Joins two bodies between two points in world coordinates.
inline JointId join(World* world, BodyId a, const Vector3d& p_W, BodyId b, const Vector3d& q_W,
                    const JointType& type = DistanceJoint{}) {
  Joint joint;
  joint.name = "joint_" + std::to_string(world->joint_ids().size());
  joint.body_a = a;
  joint.anchor_a = in_body(*world, a, p_W);
  joint.body_b = b;
  joint.anchor_b = in_body(*world, b, q_W);
  type.write(&joint);
  return world->add_joint(joint);
}

inline JointId join_ball(World* world, BodyId a, BodyId b, const Vector3d& p_W) {
  return join(world, a, p_W, b, p_W, JointKind::kBall);
}

/// Adds a hinge about `axis`, made of two ball joints 2 × `half` apart.
inline void join_hinge(World* world, BodyId a, BodyId b, const Vector3d& p_W, const Vector3d& axis,
                       double half = 0.1) {
  join_ball(world, a, b, p_W - half * axis);
  join_ball(world, a, b, p_W + half * axis);
}

/// Adds a rod between two centres of mass.
inline void join_centres(World* world, BodyId a, BodyId b) {
  join(world, a, world->state(a).position, b, world->state(b).position);
}

inline DistanceJoint spring(double stiffness) {
  DistanceJoint joint;
  joint.stiffness = stiffness;
  return joint;
}

inline void set_twist(World* world, BodyId id, const Vector3d& v, const Vector3d& w) {
  BodyState state = world->state(id);
  state.linear_velocity = v;
  state.angular_velocity = w;
  world->set_state(id, state);
}

/// Makes a body rotate about a point in world coordinates.
inline void spin_about(World* world, BodyId id, const Vector3d& p_W, const Vector3d& w) {
  set_twist(world, id, w.cross(world->state(id).position - p_W), w);
}

/// Adds point masses on rods, downwards from `top`, the last with `end_mass`.
inline BodyId hang_chain(World* world, BodyId from, const Vector3d& top, int links, double length,
                         double mass, double end_mass) {
  Vector3d last = top;
  for (int i = 1; i <= links; ++i) {
    const Vector3d p = top - Vector3d(0.0, 0.0, i * length);
    const BodyId id =
        problems::add_mass(world, "link_" + std::to_string(i), p, i == links ? end_mass : mass);
    join(world, from, last, id, p);
    from = id;
    last = p;
  }
  return from;
}

// ---- permanently dependent rows

/// A rigid dome in free flight: an apex and 6 rings of 11 points, joined along rings and meridians,
/// with both diagonals in each panel and 16 chords in the lowest ring. 63 of 258 rods are
/// redundant. Energy is kept to rounding.
inline World dome(const Vector3d& origin = Vector3d::Zero()) {
  constexpr int kRings = 6, kSides = 11;
  const Vector3d w(0.7, 1.1, 0.4), v(3.0, 1.0, 5.0);
  World world;
  std::vector<BodyId> ids;
  const auto add = [&](const Vector3d& p) {
    ids.push_back(problems::add_mass(&world, "p_" + std::to_string(ids.size()), origin + p));
    set_twist(&world, ids.back(), v + w.cross(p), Vector3d::Zero());
  };
  add({0.0, 0.0, 5.0});
  for (int i = 1; i <= kRings; ++i) {
    const double polar = 0.24 * i;
    for (int k = 0; k < kSides; ++k) {
      const double angle = 2.0 * kPi * (k + 0.5 * i) / kSides;
      add(5.0 * Vector3d(std::sin(polar) * std::cos(angle), std::sin(polar) * std::sin(angle),
                         std::cos(polar)));
    }
  }
  const auto at = [&](int i, int k) {
    return ids[static_cast<std::size_t>(1 + (i - 1) * kSides + k % kSides)];
  };
  for (int k = 0; k < kSides; ++k) join_centres(&world, ids[0], at(1, k));
  for (int i = 1; i <= kRings; ++i) {
    for (int k = 0; k < kSides; ++k) {
      join_centres(&world, at(i, k), at(i, k + 1));
      if (i == kRings) continue;
      for (const int turn : {0, 1, kSides - 1}) join_centres(&world, at(i, k), at(i + 1, k + turn));
    }
  }
  for (int k = 0; k < kSides; ++k) join_centres(&world, at(kRings, k), at(kRings, k + 2));
  for (int k = 0; k < 5; ++k) join_centres(&world, at(kRings, k), at(kRings, k + 3));
  return world;
}

/// A link of a closed chain of hinges, by Denavit and Hartenberg: joint angle about the previous
/// axis, its rate, link length, and twist of the next axis about the link.
struct Link {
  double angle, rate, length, twist;
};

/// A closed chain of hinges, each of two ball joints. Its last link is the world; the chain starts
/// from the origin.
inline World hinged_loop(const std::vector<Link>& links, const Vector3d& gravity,
                         const Vector3d& origin = Vector3d::Zero()) {
  WorldOptions options;
  options.gravity = gravity;
  World world(options);
  Matrix3d R = Matrix3d::Identity();
  Vector3d x = origin, v = Vector3d::Zero(), w = Vector3d::Zero();
  BodyId last = kWorldBody;
  for (std::size_t i = 0; i < links.size(); ++i) {
    const Link& link = links[i];
    const Vector3d axis = R.col(2);
    w += link.rate * axis;
    R *= Eigen::AngleAxisd(link.angle, Vector3d::UnitZ()).toRotationMatrix();
    const Vector3d along = link.length * R.col(0);
    BodyId id = kWorldBody;
    if (i + 1 < links.size()) {
      Body bar = body_at("bar_" + std::to_string(i), {link.length, 0.05, 0.05}, 1.0,
                         x + 0.5 * along, Quaterniond(R).normalized());
      bar.state.linear_velocity = v + w.cross(0.5 * along);
      bar.state.angular_velocity = w;
      id = world.add_body(bar);
    }
    join_hinge(&world, last, id, x, axis);
    last = id;
    x += along;
    v += w.cross(along);
    R *= Eigen::AngleAxisd(link.twist, Vector3d::UnitX()).toRotationMatrix();
  }
  return world;
}

/// Bricard's linkage: six unit links along the edges of a cube, each hinge normal to both links. 36
/// rows hold 30 degrees of freedom, and one remains. Joints and energy are kept to rounding.
inline World bricard(const Vector3d& origin = Vector3d::Zero()) {
  std::vector<Link> links;
  for (int i = 0; i < 6; ++i) {
    const double sign = i % 2 == 0 ? 1.0 : -1.0;
    links.push_back({0.5 * kPi, sign, 1.0, sign * 0.5 * kPi});
  }
  return hinged_loop(links, {0.0, -9.81, 0.0}, origin);
}

/// Bennett's linkage: opposite links are equal, length / sin(twist) is equal for all. 24 rows hold
/// 18 degrees of freedom, and one remains. The dependence holds for these dimensions only.
inline World bennett(const Vector3d& origin = Vector3d::Zero()) {
  const double a = 1.0, alpha = 0.6, beta = 1.1;
  const double b = a * std::sin(beta) / std::sin(alpha);
  const double first = 1.2, rate = 1.5;
  const double ratio = std::sin(0.5 * (beta + alpha)) / std::sin(0.5 * (beta - alpha));
  const double second = 2.0 * std::atan(ratio / std::tan(0.5 * first));
  const double second_rate = -rate * std::sin(second) / std::sin(first);
  return hinged_loop({{first, rate, a, alpha},
                      {second, second_rate, b, beta},
                      {-first, -rate, a, alpha},
                      {-second, -second_rate, b, beta}},
                     {0.0, 0.0, -9.81}, origin);
}

/// A door of 1 × 0.05 × 2 m and 10 kg on two ball joints, turning at 1 rad/s.
inline World door(const Vector3d& origin = Vector3d::Zero()) {
  World world;
  const BodyId id =
      world.add_body(body_at("door", {1.0, 0.05, 2.0}, 10.0, origin + Vector3d(0.5, 0.0, 0.0)));
  join_hinge(&world, kWorldBody, id, origin, Vector3d::UnitZ(), 0.9);
  spin_about(&world, id, origin, Vector3d::UnitZ());
  return world;
}

/// The door with a knob of 0.05 kg on a spring of 1e6 N/m, which makes the scene stiff.
inline World door_with_knob() {
  World world = door();
  const BodyId id = world.find_body("door");
  const Vector3d p(0.95, 0.025, 0.0), q(0.95, 0.125, 0.0);
  const BodyId knob = problems::add_mass(&world, "knob", q, 0.05);
  set_twist(&world, knob, Vector3d::UnitZ().cross(q), Vector3d::Zero());
  join(&world, id, p, knob, q, spring(1e6));
  return world;
}

/// A boom on a hinge of two ball joints and a stay, with a load of 1e4 kg on light links, which
/// make the scene stiff.
inline World crane_boom() {
  World world;
  const BodyId boom = world.add_body(body_at("boom", {4.0, 0.2, 0.2}, 50.0, {2.0, 0.0, 0.0}));
  join_hinge(&world, kWorldBody, boom, Vector3d::Zero(), Vector3d::UnitY(), 0.3);
  join(&world, kWorldBody, {0.0, 0.0, 3.0}, boom, {4.0, 0.0, 0.0});
  const BodyId load = hang_chain(&world, boom, {4.0, 0.0, 0.0}, 4, 0.5, 0.02, 1e4);
  set_twist(&world, load, {1.0, 0.5, 0.0}, Vector3d::Zero());
  return world;
}

/// A light ring on a ball joint, with a redundant rod from there across the ring, and a load of 1e5
/// kg on a rod below.
inline World hook_stiff() {
  World world;
  const BodyId ring = world.add_body(body_at("ring", {0.2, 0.2, 0.05}, 0.5, {0.0, 0.0, -0.1}));
  join_ball(&world, kWorldBody, ring, Vector3d::Zero());
  join(&world, kWorldBody, Vector3d::Zero(), ring, {0.1, 0.05, -0.15});
  const BodyId load = problems::add_mass(&world, "load", {0.0, 0.0, -1.2}, 1e5);
  join(&world, ring, {0.0, 0.0, -0.2}, load, {0.0, 0.0, -1.2});
  set_twist(&world, load, {3.0, 1.0, 0.0}, Vector3d::Zero());
  return world;
}

/// A box and a mass, joined in a point of the box by a ball joint, and by a redundant rod from a
/// corner. Both tumble in free space. As the rod turns it replaces each row of the ball joint in
/// turn.
inline World ball_and_dependent_rod(const Vector3d& origin = Vector3d::Zero()) {
  WorldOptions options;
  options.gravity.setZero();
  World world(options);
  const Quaterniond q = Quaterniond(0.9, 0.1, -0.3, 0.2).normalized();
  const BodyId box = world.add_body(body_at("box", {0.6, 0.4, 0.2}, 1.0, origin, q));
  const Vector3d arm = q * Vector3d(0.5, 0.0, 0.0), corner = q * Vector3d(-0.3, -0.2, -0.1);
  const BodyId mass = problems::add_mass(&world, "mass", origin + arm);
  join_ball(&world, box, mass, origin + arm);
  join(&world, box, origin + corner, mass, origin + arm);
  const Vector3d v(0.6, 0.7, 0.4), w(1.0, 2.0, 3.0);
  set_twist(&world, box, v, w);
  set_twist(&world, mass, v + w.cross(arm), Vector3d::Zero());
  return world;
}

/// Nine planks between two fixed edges, each hinged by two ball joints, sagging in an arc with 28°
/// at its ends; a ball of 5 kg falls on the middle.
inline World bridge_two_balls() {
  World world;
  const double length = 0.4;
  Vector3d x = Vector3d::Zero();
  BodyId last = kWorldBody;
  const auto pair = [&](BodyId id) {
    for (const double y : {-0.5, 0.5}) join_ball(&world, last, id, x + Vector3d(0.0, y, 0.0));
  };
  for (int i = 0; i < 9; ++i) {
    const double pitch = (4 - i) * 7.0 * kPi / 180.0;
    const Quaterniond q(Eigen::AngleAxisd(pitch, Vector3d::UnitY()));
    const Vector3d along = q * Vector3d(length, 0.0, 0.0);
    Body plank =
        body_at("plank_" + std::to_string(i), {length, 1.0, 0.06}, 1.0, x + 0.5 * along, q);
    plank.no_collision = false;
    const BodyId id = world.add_body(plank);
    pair(id);
    last = id;
    x += along;
  }
  pair(kWorldBody);
  Body ball;
  ball.name = "ball";
  ball.shape = Sphere{0.2};
  ball.mass = 5.0;
  ball.state.position = {0.5 * x.x(), 0.0, 1.0};
  world.add_body(ball);
  return world;
}

// ---- momentary singular poses, and loops without dependent rows

/// IFToMM's A02: N windows of bars of 1 kg on ball joints, upright, with tops moving at 1 m/s. All
/// bars are in line twice a turn. Energy is kept.
inline World n_four_bar(int windows) {
  World world;
  const auto add_bar = [&](const std::string& name, const Vector3d& from, const Vector3d& to,
                           const Vector3d& v, const Vector3d& w) {
    const Quaterniond q = rotation_between(Vector3d::UnitX(), to - from);
    Body bar = body_at(name, {1.0, 0.1, 0.1}, 1.0, 0.5 * (from + to), q);
    bar.inertia = Vector3d::Constant(1.0 / 12.0);
    bar.state.linear_velocity = v;
    bar.state.angular_velocity = w;
    return world.add_body(bar);
  };
  BodyId last = kWorldBody;
  for (int k = 0; k <= windows; ++k) {
    const Vector3d foot(k, 0.0, 0.0), top(k, 0.0, 1.0), before(k - 1.0, 0.0, 1.0);
    const BodyId bar =
        add_bar("upright_" + std::to_string(k), foot, top, {0.5, 0.0, 0.0}, Vector3d::UnitY());
    join_ball(&world, kWorldBody, bar, foot);
    if (k > 0) {
      const BodyId across =
          add_bar("across_" + std::to_string(k), before, top, Vector3d::UnitX(), Vector3d::Zero());
      join_ball(&world, last, across, before);
      join_ball(&world, across, bar, top);
    }
    last = bar;
  }
  return world;
}

/// Peaucellier's linkage of seven rods. Its last point runs along a line; at both ends of the line
/// all rods but one are in line. It starts at rest, 1 m above the middle.
inline World peaucellier() {
  World world;
  const Vector3d O = Vector3d::Zero(), Q(0.75, 0.0, 0.0), C(2.0, 0.0, 1.0);
  const Vector3d P = 3.0 / C.squaredNorm() * C;  // inversion: OP · OC = 2² − 1²
  const Vector3d middle = 0.5 * (P + C);
  const Vector3d across =
      std::sqrt(1.0 - 0.25 * (C - P).squaredNorm()) * Vector3d(-C.z(), 0.0, C.x()).normalized();
  const BodyId b = problems::add_mass(&world, "b", middle + across);
  const BodyId d = problems::add_mass(&world, "d", middle - across);
  const BodyId p = problems::add_mass(&world, "p", P);
  const BodyId c = problems::add_mass(&world, "c", C);
  join(&world, kWorldBody, O, b, middle + across);
  join(&world, kWorldBody, O, d, middle - across);
  join(&world, kWorldBody, Q, p, P);
  for (const auto& [from, to] :
       {std::pair(p, b), std::pair(p, d), std::pair(c, b), std::pair(c, d)})
    join_centres(&world, from, to);
  return world;
}

/// A four-bar of point masses that starts flat, at rest or moving up, bent by a spring from above.
inline World flat_four_bar_with_spring(double speed = 0.0) {
  World world;
  const BodyId a = problems::add_mass(&world, "a", {1.0, 0.0, 0.0});
  const BodyId b = problems::add_mass(&world, "b", {2.0, 0.0, 0.0});
  for (const BodyId id : {a, b}) set_twist(&world, id, {0.0, 0.0, speed}, Vector3d::Zero());
  join(&world, kWorldBody, Vector3d::Zero(), a, {1.0, 0.0, 0.0});
  join_centres(&world, a, b);
  join(&world, kWorldBody, {1.0, 0.0, 0.0}, b, {2.0, 0.0, 0.0});
  DistanceJoint above = spring(100.0);
  above.length = 1.0;
  join(&world, kWorldBody, {1.0, 0.0, 2.0}, a, {1.0, 0.0, 0.0}, above);
  return world;
}

/// The flat four-bar without spring and gravity. It passes its flat pose slowly while a motor
/// changes the length of a rod by some nanometres, which that pose does not allow.
inline World flat_four_bar_with_motor() {
  World world = flat_four_bar_with_spring(1e-4);
  world.remove_joint(world.joint_ids().back());
  WorldOptions options = world.options();
  options.gravity.setZero();
  world.set_options(options);
  Motor motor;
  motor.amplitude = 1e-7;
  motor.frequency = 1.0;
  world.set_motor(world.joint_ids().front(), motor);
  return world;
}

/// The four-bar with a spring, of slender bars on ball joints, at rest.
inline World flat_bars_with_spring() {
  World world;
  const auto add_bar = [&](const std::string& name, double from) {
    Body bar = body_at(name, {1.0, 0.05, 0.05}, 1.0, {from + 0.5, 0.0, 0.0});
    bar.inertia = {1.0 / 1200.0, 1.0 / 12.0, 1.0 / 12.0};
    return world.add_body(bar);
  };
  const BodyId first = add_bar("first", 0.0), across = add_bar("across", 1.0);
  const BodyId last = add_bar("last", 1.0);
  join_ball(&world, kWorldBody, first, Vector3d::Zero());
  join_ball(&world, first, across, {1.0, 0.0, 0.0});
  join_ball(&world, across, last, {2.0, 0.0, 0.0});
  join_ball(&world, kWorldBody, last, {1.0, 0.0, 0.0});
  DistanceJoint above = spring(100.0);
  above.length = 1.0;
  join(&world, kWorldBody, {1.0, 0.0, 2.0}, first, {1.0, 0.0, 0.0}, above);
  return world;
}

/// A window of four rods with a spring across it.
inline World window_with_spring(double stiffness) {
  World world = problems::four_bar(1);
  const BodyId top = world.find_body("top_1");
  join(&world, kWorldBody, Vector3d::Zero(), top, world.state(top).position, spring(stiffness));
  return world;
}

/// A cable of 1 kg masses held at both ends, sagging by half its length.
inline World cable_held_at_both_ends(int masses) {
  World world;
  BodyId last = kWorldBody;
  Vector3d before = Vector3d::Zero();
  const auto at = [&](int i) {  // chords of an arc of 120°
    const double angle = kPi / 3.0 * (2.0 * i / (masses + 1.0) - 1.0);
    return Vector3d(10.0 * (std::sin(angle) + std::sin(kPi / 3.0)), 0.0,
                    10.0 * (std::cos(kPi / 3.0) - std::cos(angle)));
  };
  for (int i = 1; i <= masses; ++i) {
    const BodyId id = problems::add_mass(&world, "mass_" + std::to_string(i), at(i));
    join(&world, last, before, id, at(i));
    last = id;
    before = at(i);
  }
  join(&world, last, before, kWorldBody, at(masses + 1));
  set_twist(&world, world.find_body("mass_" + std::to_string((masses + 1) / 2)), {0.0, 2.0, 0.0},
            Vector3d::Zero());
  return world;
}

/// 200 links of 10 g and 0.1 m, hanging at rest; the middle one moves across at 10 m/s.
inline World cable_struck() {
  World world;
  hang_chain(&world, kWorldBody, Vector3d::Zero(), 200, 0.1, 0.01, 0.01);
  set_twist(&world, world.find_body("link_100"), {10.0, 0.0, 0.0}, Vector3d::Zero());
  return world;
}

/// A net of 39 × 39 masses and 2966 rods.
inline World net_2966() { return problems::net(39, 0.1); }

// ---- contradictory joints: reported, and without a gain of energy

/// A mass of 2 kg on five rods whose lengths contradict each other.
inline World tetra() {
  World world;
  const Vector3d start(0.1, 0.1, 0.1);
  const BodyId id = problems::add_mass(&world, "mass", start, 2.0);
  const std::vector<std::pair<Vector3d, double>> rods = {{{1.0, 1.0, 1.0}, 1.0},
                                                         {{1.0, -1.0, -1.0}, 1.5},
                                                         {{-1.0, 1.0, -1.0}, 2.0},
                                                         {{-1.0, -1.0, 1.0}, 2.5},
                                                         {{0.0, 0.0, 2.0}, 1.0}};
  for (const auto& [p, length] : rods) {
    DistanceJoint rod;
    rod.length = length;
    join(&world, kWorldBody, p, id, start, rod);
  }
  return world;
}

/// Five masses tumbling in free space, a rod for each pair, and one rod 20 % too long.
inline World k5_too_long() {
  WorldOptions options;
  options.gravity.setZero();
  World world(options);
  const std::vector<Vector3d> points = {
      {1.0, 1.0, 1.0}, {1.0, -1.0, -1.0}, {-1.0, 1.0, -1.0}, {-1.0, -1.0, 1.0}, {0.0, 0.0, 0.1}};
  std::vector<BodyId> ids;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double mass = i < 4 ? 1.0 + 0.3 * static_cast<double>(i) : 2.0;
    ids.push_back(problems::add_mass(&world, "p_" + std::to_string(i), points[i], mass));
    set_twist(&world, ids[i], Vector3d(0.7, 1.1, 0.4).cross(points[i]) + Vector3d(0.3, 0.0, 2.0),
              Vector3d::Zero());
    for (std::size_t k = 0; k < i; ++k) {
      DistanceJoint rod;
      rod.length = (i == 4 && k == 0 ? 1.2 : 1.0) * (points[i] - points[k]).norm();
      join(&world, ids[k], points[k], ids[i], points[i], rod);
    }
  }
  return world;
}

// ---- mass ratios

/// A load on a light chain from a tripod of four rods, one of which is redundant.
inline World tripod(double load) {
  World world;
  const Vector3d top(0.0, 0.0, 3.0);
  const BodyId apex = problems::add_mass(&world, "apex", top);
  const std::vector<Vector3d> feet = {
      {2.0, 0.3, 0.0}, {-1.5, 1.4, 0.0}, {-0.5, -1.8, 0.0}, {1.0, 1.2, 0.0}};
  for (const Vector3d& foot : feet) join(&world, kWorldBody, foot, apex, top);
  const BodyId end = hang_chain(&world, apex, top, 2, 1.0, 1.0, load);
  set_twist(&world, end, {1.0, 0.0, 0.0}, Vector3d::Zero());
  return world;
}

/// A box that turns at 1e6 rad/s on a ball joint at its corner, faster than the tick resolves,
/// which is reported.
inline World fast_box(const Vector3d& w) {
  World world;
  const BodyId id = world.add_body(body_at("box", {0.3, 0.2, 0.1}, 1.0, {0.15, 0.1, 0.05}));
  join_ball(&world, kWorldBody, id, Vector3d::Zero());
  spin_about(&world, id, Vector3d::Zero(), w);
  return world;
}

/// Two masses `first` and `second` on rods of 1 m below the origin, moving across at 1 m/s.
inline World mass_ratio(double first, double second) {
  World world;
  const BodyId a = problems::add_mass(&world, "first", {0.0, 0.0, -1.0}, first);
  const BodyId b = problems::add_mass(&world, "second", {0.0, 0.0, -2.0}, second);
  join(&world, kWorldBody, Vector3d::Zero(), a, {0.0, 0.0, -1.0});
  join_centres(&world, a, b);
  set_twist(&world, b, {1.0, 0.0, 0.0}, Vector3d::Zero());
  return world;
}

/// Eleven links of 0.1 kg and a load, straight and at rest, with a slack rope beside the chain so
/// that impulses advance the island. It starts consistent and at rest, and stays so.
inline World chain_with_slack_rope(double load) {
  World world;
  const BodyId end = hang_chain(&world, kWorldBody, Vector3d::Zero(), 12, 1.0, 0.1, load);
  DistanceJoint rope;
  rope.max_length = 15.0;
  join(&world, kWorldBody, {1.0, 0.0, 0.0}, end, world.state(end).position, rope);
  return world;
}

// ---- variants

/// Returns a copy with positions, anchors, lengths and quaternions rounded to `digits` decimals, as
/// in a file written by hand.
inline World rounded(const World& original, int digits) {
  const double scale = std::pow(10.0, digits);
  const auto round = [&](double x) { return std::round(scale * x) / scale; };
  const auto round_all = [&](const auto& x) { return x.unaryExpr(round).eval(); };
  World world(original.options());
  for (const BodyId id : original.body_ids()) {
    Body body = original.body(id);
    body.state = original.state(id);
    body.state.position = round_all(body.state.position);
    body.state.orientation.coeffs() = round_all(body.state.orientation.coeffs());
    world.add_body(body);
  }
  for (const JointId id : original.joint_ids()) {
    Joint joint = original.joint(id);
    joint.anchor_a = round_all(joint.anchor_a);
    joint.anchor_b = round_all(joint.anchor_b);
    if (auto* distance = if_distance(joint))
      if (distance->length) distance->length = round(*distance->length);
    world.add_joint(joint);
  }
  return world;
}

}  // namespace constraint_sim::engine::redundant
