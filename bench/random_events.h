#pragma once

// Random event-driven scenes of few bodies, each made from its kind and seed alone, and their
// judge. Arms are chains of 1 to 10 links with stops, friction, springs and weak motors, also to
// positions, and with links whose masses differ by a factor of up to 100. Mechanisms have ropes,
// struts, limits, friction, motors, servos and springs. Touching bodies are spheres and boxes with
// friction and restitution, with joints and laws, some with shape poses; some joints can break.
// Others have screws, gears, racks and pulleys, or joints that are open and motors that move to a
// position. Aligned cubes, hit by a ball, have gaps and margins of zero to rounding. Oracles: only
// motors raise energy; joints, limits and gaps hold to rounding; events are ordered; a copy, a
// snapshot and threads give the same bits; the scene moved, turned and added in another order moves
// alike.

#include <array>
#include <string>
#include <vector>

#include "draw.h"
#include "make_scene.h"
#include "parts.h"

namespace constraint_sim::engine::random_events {

enum class Kind {
  kMechanism,
  kMechanismWithMotors,
  kTouching,
  kTouchingWithLaws,
  kTouchingWithMotors,
  kMechanismWithServos,
  kTouchingWithServos,
  kAligned,
  kTouchingWithPoses,
  kTouchingWithParts,
  kTouchingCoupled,
  kTouchingOpen,
  kArm
};
inline constexpr std::array<const char*, 13> kKindNames{"mechanism",
                                                        "mechanism, motors",
                                                        "touching",
                                                        "touching, laws",
                                                        "touching, motors",
                                                        "mechanism, servos",
                                                        "touching, servos",
                                                        "aligned boxes",
                                                        "touching, poses",
                                                        "touching, parts",
                                                        "touching, coupled",
                                                        "touching, open",
                                                        "arm"};

inline bool has_motors(Kind kind) {
  return kind == Kind::kMechanismWithMotors || kind == Kind::kTouchingWithMotors;
}
inline bool has_servos(Kind kind) {
  return kind == Kind::kMechanismWithServos || kind == Kind::kTouchingWithServos;
}
inline bool touches(Kind kind) {
  return kind >= Kind::kTouching && kind != Kind::kMechanismWithServos && kind != Kind::kArm;
}

struct Scene {
  Kind kind;
  unsigned seed;
  Parts parts;
  WorldOptions options;
  double largest = 0.0;  ///< exchanged energy [J]: weight times one metre
};

// ---- mechanisms

inline CoordinateLaw law_of_mechanism(Draw& draw, bool is_angle, bool with_motors) {
  CoordinateLaw law;
  if (draw.below(2) == 0) {
    law.lower = -(0.2 + draw.share());
    law.upper = 0.2 + draw.share();
    if (draw.below(2) == 0) law.limit_restitution = 0.5 * draw.below(3);
  }
  if (draw.below(3) == 0) law.friction = (is_angle ? 0.5 : 3.0) * draw.share();
  if (draw.below(4) == 0) {
    law.stiffness = 5.0 * draw.share();
    law.damping = draw.share();
  }
  if (!with_motors || draw.below(3) != 0) return law;
  law.motor.emplace();
  law.motor->bias = draw();
  law.motor->max_force = 0.1 + 4.0 * draw.share();
  if (draw.below(2) == 0) {
    law.motor->amplitude = draw.share();
    law.motor->frequency = 2.0 * draw.share();
  }
  return law;
}

/// Returns a joint between an earlier body, or the world, and this one, satisfied in the present
/// pose.
inline Joint joint_of_mechanism(Draw& draw, const std::string& name, const BodyState& a,
                                const BodyState& b, bool with_motors) {
  constexpr JointKind kKinds[] = {
      JointKind::kHinge, JointKind::kSlider,    JointKind::kCylindrical, JointKind::kPlanar,
      JointKind::kBall,  JointKind::kUniversal, JointKind::kFreeDistance};
  Joint joint;
  joint.name = name;
  joint.kind = kKinds[draw.below(7)];
  const Eigen::Vector3d place = b.position + 0.5 * draw.vector();
  joint.anchor_a = a.orientation.conjugate() * (place - a.position);
  joint.anchor_b = b.orientation.conjugate() * (place - b.position);
  joint.frame_a = draw.turn();
  const bool is_length = joint.kind == JointKind::kFreeDistance;
  if (is_length) joint.anchor_b.setZero();
  if (info(joint.kind).has_two_axes)
    joint.axis_b =
        b.orientation.conjugate() * (a.orientation * (joint.frame_a * Eigen::Vector3d::UnitX()));
  for (int i = 0; i < info(joint.kind).coordinates; ++i) {
    CoordinateLaw& law = joint.coordinates[static_cast<std::size_t>(i)];
    law = law_of_mechanism(draw, info(joint.kind).is_angle[i], with_motors);
    if (is_length) law.lower = 0.05 + 0.1 * draw.share();
    if (is_length) law.upper = 3.0 + draw.share();
  }
  return joint;
}

inline Parts mechanism(unsigned seed, bool with_motors) {
  Draw draw(seed);
  Parts parts;
  const int count = 1 + draw.below(4);
  for (int i = 0; i < count; ++i) {
    const Shape shape =
        draw.below(2) == 0
            ? Shape(Sphere{0.2})
            : Shape(Box{0.2 * Eigen::Vector3d::Ones() + 0.5 * draw.vector().cwiseAbs()});
    const double mass = 0.5 + 2.0 * draw.share();
    Body body = make_body("body_" + std::to_string(i), shape, mass, 1.5 * draw.vector());
    body.no_collision = true;
    body.state.orientation = draw.turn();
    body.state.linear_velocity = draw.vector();
    body.state.angular_velocity = draw.vector();
    parts.bodies.push_back(body);
  }
  const auto state_of = [&](int i) {
    return i < 0 ? BodyState{} : parts.bodies[static_cast<std::size_t>(i)].state;
  };
  for (int i = 0; i < count; ++i) {
    int other = draw.below(i + 1) - 1;
    if (draw.below(5) > 0) {
      parts.joints.push_back(joint_of_mechanism(draw, "joint_" + std::to_string(i), state_of(other),
                                                state_of(i), with_motors));
      parts.ends.emplace_back(other, i);
    }
    if (draw.below(2) == 0) continue;
    other = draw.below(i + 1) - 1;
    const double apart = (state_of(other).position - state_of(i).position).norm();
    const bool is_rope = draw.below(3) > 0;
    const double least = is_rope ? 0.0 : 0.01 + 0.2 * draw.share() * apart;
    const Eigen::Vector3d anchor_a = 0.1 * draw.vector(), anchor_b = 0.1 * draw.vector();
    parts.joints.push_back(make_joint("rope_" + std::to_string(i), kWorldBody, anchor_a, kWorldBody,
                                      anchor_b, between(least, apart + 0.5 + draw.share())));
    parts.ends.emplace_back(other, i);
  }
  return parts;
}

// ---- arms

/// Motor that is too weak for many poses: with a constant rate or a sine, or to a position.
inline Motor motor_of_arm(Draw& draw, double weight) {
  Motor motor;
  motor.max_force = 0.5 * weight * std::pow(10.0, 1.5 * draw());
  const int kind = draw.below(4);
  if (kind < 2) motor.bias = draw();
  if (kind == 1) {
    motor.amplitude = draw.share();
    motor.frequency = 3.0 * draw.share();
  }
  if (kind >= 2) motor.position = kind == 2 ? 0.0 : draw();
  return motor;
}

inline Parts arm(unsigned seed) {
  Draw draw(seed);
  Parts parts;
  const int count = 1 + draw.below(10);
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d half = 0.3 * draw.vector();
    const Shape shape = Box{0.1 * Eigen::Vector3d::Ones() + 0.3 * draw.vector().cwiseAbs()};
    Body link = make_body("link_" + std::to_string(i), shape, std::pow(10.0, draw()), place + half);
    link.no_collision = true;
    const double weight = link.mass * kGravity;
    parts.bodies.push_back(link);
    Joint joint;
    joint.name = "joint_" + std::to_string(i);
    joint.kind = draw.below(4) == 0 ? JointKind::kSlider : JointKind::kHinge;
    joint.anchor_a =
        i == 0 ? place : place - parts.bodies[static_cast<std::size_t>(i - 1)].state.position;
    joint.anchor_b = -half;
    joint.frame_a = draw.turn();
    CoordinateLaw& law = joint.coordinates[0];
    if (draw.below(2) == 0) {
      law.lower = -(0.1 + 0.5 * draw.share());
      law.upper = 0.1 + 0.5 * draw.share();
      if (draw.below(2) == 0) law.limit_restitution = draw.share();
    }
    if (draw.below(2) == 0) law.friction = 0.3 * weight * draw.share();
    if (draw.below(4) == 0) {
      law.stiffness = weight * std::pow(10.0, 2.0 * draw.share());
      law.damping = 0.1 * weight * draw.share();
    }
    if (draw.below(2) == 0) law.motor = motor_of_arm(draw, weight);
    parts.joints.push_back(joint);
    parts.ends.emplace_back(i - 1, i);
    place += 2.0 * half;
  }
  return parts;
}

// ---- touching bodies

/// Sets anchors and frame of a joint that is satisfied in the present pose.
inline void meet(Draw& draw, const BodyState& a, const BodyState& b, Joint* joint) {
  const Eigen::Vector3d place = b.position + 0.2 * draw.vector();
  joint->anchor_a = a.orientation.conjugate() * (place - a.position);
  joint->anchor_b = b.orientation.conjugate() * (place - b.position);
  joint->frame_a = draw.turn();
}

inline Joint joint_without_laws(Draw& draw, const std::string& name, const BodyState& a,
                                const BodyState& b) {
  constexpr JointKind kKinds[] = {JointKind::kHinge, JointKind::kBall, JointKind::kDistance,
                                  JointKind::kDistance};
  Joint joint;
  joint.name = name;
  joint.kind = kKinds[draw.below(4)];
  meet(draw, a, b, &joint);
  if (joint.kind != JointKind::kDistance) return joint;
  const Eigen::Vector3d anchor_a = 0.1 * draw.vector(), anchor_b = 0.1 * draw.vector();
  return make_joint(name, kWorldBody, anchor_a, kWorldBody,
                    anchor_b);  // length: distance of the anchors
}

inline CoordinateLaw law_of_touching(Draw& draw, bool is_angle, bool with_motors) {
  CoordinateLaw law;
  if (draw.below(2) == 0) {
    law.lower = -(0.1 + 0.5 * draw.share());
    law.upper = 0.1 + 0.5 * draw.share();
    if (draw.below(2) == 0) law.limit_restitution = draw.share();
  }
  if (draw.below(3) == 0) law.friction = (is_angle ? 0.5 : 5.0) * draw.share();
  if (draw.below(4) == 0) {
    law.stiffness = 5.0 * draw.share();
    law.damping = draw.share();
  }
  if (!with_motors || draw.below(2) == 0) return law;
  law.motor.emplace();
  law.motor->bias = draw();
  law.motor->max_force = 0.1 + 4.0 * draw.share();
  return law;
}

/// Returns a joint with one-sided elements: a rope, or laws of coordinates.
inline Joint joint_with_laws(Draw& draw, const std::string& name, const BodyState& a,
                             const BodyState& b, bool with_motors) {
  constexpr JointKind kKinds[] = {JointKind::kHinge, JointKind::kSlider, JointKind::kCylindrical,
                                  JointKind::kFreeDistance};
  const double apart = (a.position - b.position).norm();
  if (draw.below(3) == 0) {
    const Eigen::Vector3d anchor_a = 0.05 * draw.vector(), anchor_b = 0.05 * draw.vector();
    const double least = draw.below(2) == 0 ? 0.0 : 0.05 * apart;
    return make_joint(name, kWorldBody, anchor_a, kWorldBody, anchor_b,
                      between(least, apart + 0.1 + 0.3 * draw.share()));
  }
  Joint joint;
  joint.name = name;
  joint.kind = kKinds[draw.below(4)];
  meet(draw, a, b, &joint);
  if (joint.kind == JointKind::kFreeDistance) {
    joint.anchor_a = 0.05 * draw.vector();
    joint.anchor_b = 0.05 * draw.vector();
    joint.frame_a = Eigen::Quaterniond::Identity();
  }
  for (int i = 0; i < info(joint.kind).coordinates; ++i) {
    CoordinateLaw& law = joint.coordinates[static_cast<std::size_t>(i)];
    law = law_of_touching(draw, info(joint.kind).is_angle[i], with_motors);
    if (joint.kind != JointKind::kFreeDistance || !law.is_limited()) continue;
    law.lower = 0.3 * apart;
    law.upper = apart + 0.2 + 0.3 * draw.share();
  }
  return joint;
}

inline Body touching_body(Draw& draw, int i) {
  const bool is_box = draw.below(2) == 0;
  const Shape shape =
      is_box ? Shape(Box{0.2 * Eigen::Vector3d::Ones() + 0.3 * draw.vector().cwiseAbs()})
             : Shape(Sphere{0.1 + 0.15 * draw.share()});
  const double mass = std::pow(10.0, 3.0 * draw()), y = 0.2 * draw();
  Body body = make_body("body_" + std::to_string(i), shape, mass,
                        Eigen::Vector3d(0.9 * i, y, 0.7 + 0.3 * draw()));
  body.state.orientation = draw.turn();
  body.state.linear_velocity = draw.vector();
  body.state.angular_velocity = 3.0 * draw.vector();
  return body;
}

inline Scene touching(unsigned seed, Kind kind) {
  Draw draw(seed);
  Scene scene{kind, seed, {}, options(std::pow(10.0, -1.0 - 2.0 * draw.share()))};
  scene.options.method = seed % 2 == 0 ? Method::kEventDriven : Method::kAuto;
  const double friction = draw.below(3) == 0 ? 0.0 : 1.2 * draw.share();
  const double restitution = draw.below(2) == 0 ? 0.0 : draw.share();
  Parts& parts = scene.parts;
  parts.bodies.push_back(make_floor(0.0, draw.below(2) == 0 ? 0.0 : 0.4 * draw()));
  const int count = 1 + draw.below(3);
  for (int i = 0; i < count; ++i) parts.bodies.push_back(touching_body(draw, i));
  for (Body& body : parts.bodies) {
    body.friction = friction;
    body.restitution = restitution;
  }
  for (int i = 1; i <= count; ++i) {
    if (kind != Kind::kTouchingCoupled && draw.below(2) == 0) continue;
    const int other = draw.below(2) == 0 ? -1 : draw.below(i);
    const int a = other == 0 ? -1 : other;
    const BodyState state_a = a < 0 ? BodyState{} : parts.bodies[static_cast<std::size_t>(a)].state;
    const BodyState& state_b = parts.bodies[static_cast<std::size_t>(i)].state;
    const std::string name = "joint_" + std::to_string(i);
    parts.joints.push_back(kind == Kind::kTouching
                               ? joint_without_laws(draw, name, state_a, state_b)
                               : joint_with_laws(draw, name, state_a, state_b, has_motors(kind)));
    parts.ends.emplace_back(a, i);
  }
  return scene;
}

/// Makes some joints break at random multiples of the total weight, and of its moment at half a
/// metre.
inline void let_joints_break(Scene* scene) {
  Draw draw(scene->seed + 1000003);  // separate generator, so that other draws stay the same
  for (Joint& joint : scene->parts.joints) {
    if (draw.below(3) > 0) continue;
    const double bears = scene->largest * std::pow(10.0, draw());
    joint.break_force = bears;
    const bool has_torque = joint.kind != JointKind::kDistance &&
                            joint.kind != JointKind::kFreeDistance &&
                            !info(joint.kind).couples_joints;
    if (has_torque && draw.below(2) == 0) joint.break_torque = 0.5 * bears;
  }
}

/// Adds springs, servos and position-controlled motors, all with a force limit. Targets are the
/// initial positions, so that nothing has to be closed.
inline void add_servos(unsigned seed, Parts* parts) {
  Draw draw(seed + 1000033);
  for (Joint& joint : parts->joints) {
    if (joint.kind == JointKind::kDistance && draw.below(3) == 0) {
      joint.distance = {};
      joint.distance.stiffness = std::pow(10.0, 3.0 * draw.share());
      joint.distance.damping = draw.below(2) == 0 ? 0.0 : draw.share();
      joint.motor.max_force = 0.1 + 20.0 * draw.share();
    }
    for (int i = 0; i < info(joint.kind).coordinates; ++i) {
      CoordinateLaw& law = joint.coordinates[static_cast<std::size_t>(i)];
      if (draw.below(3) == 0) continue;
      law.motor.emplace();
      law.motor->max_force = 0.1 + 4.0 * draw.share();
      law.motor->position = 0.0;
      if (draw.below(2) == 0 && !info(joint.kind).is_free_length) continue;
      law.motor->position = draw();
      law.motor->servo_stiffness = std::pow(10.0, 3.0 * draw.share());
      law.motor->servo_damping = draw.below(2) == 0 ? 0.0 : draw.share();
    }
  }
}

/// Describes a third of the bodies in another frame, and gives the others random shape poses.
inline void add_poses(unsigned seed, Parts* parts) {
  Draw draw(seed + 1000037);
  for (std::size_t i = 0; i < parts->bodies.size(); ++i) {
    Body& body = parts->bodies[i];
    if (body.type != BodyType::kDynamic) continue;
    if (draw.below(3) > 0) {
      body.inertia = body.mass * unit_inertia(body.shape);
      body.shape_pose = ShapePose{0.1 * draw.vector(), draw.turn()};
      continue;
    }
    // The body moves as without a pose.
    const ShapePose frame = other_frame(body);
    body = in_frame(body, frame);
    for (std::size_t j = 0; j < parts->joints.size(); ++j) {
      const auto [a, b] = parts->ends[j];
      if (a == static_cast<int>(i)) put_in_frame(frame, true, &parts->joints[j]);
      if (b == static_cast<int>(i)) put_in_frame(frame, false, &parts->joints[j]);
    }
  }
}

/// Describes a third of the dynamic bodies as in_parts(), and gives the others another ball or box
/// beside their shape.
inline void add_further_parts(unsigned seed, Parts* parts) {
  add_poses(seed, parts);
  Draw draw(seed + 2000003);
  for (Body& body : parts->bodies) {
    if (!body.shape_pose || std::holds_alternative<Plane>(body.shape)) continue;
    if (draw.below(3) == 0) {
      body = in_parts(body);
      continue;
    }
    const double size = 0.05 + 0.1 * draw.share();
    const Shape beside = draw.below(2) == 0 ? Shape(Sphere{size}) : Shape(Box{{size, size, size}});
    ShapePart part{beside, {0.2 * draw.vector(), draw.turn()}};
    if (draw.below(2) == 0) part.friction = draw.share();
    if (draw.below(2) == 0) part.restitution = draw.share();
    body.shape = Compound({{body.shape, *body.shape_pose}, part});
    body.shape_pose.reset();
  }
}

/// Makes screws of some joints, and couples the coordinates of others.
inline void couple(unsigned seed, Parts* parts) {
  Draw draw(seed + 3000017);
  std::vector<std::size_t> coordinates_at, lengths_at;
  for (std::size_t j = 0; j < parts->joints.size(); ++j) {
    Joint& joint = parts->joints[j];
    if (joint.kind == JointKind::kCylindrical) {
      joint.kind = JointKind::kScrew;
      joint.pitch = 0.1 + draw.share();
    }
    if (info(joint.kind).coordinates > 0)
      (info(joint.kind).is_free_length ? lengths_at : coordinates_at).push_back(j);
  }
  const auto add = [&](JointKind kind, const std::vector<std::size_t>& at) {
    for (std::size_t k = 0; k + 1 < at.size(); ++k) {
      Joint coupling;
      coupling.name = std::string(name(kind)) + "_" + std::to_string(at[k]);
      coupling.kind = kind;
      coupling.coupling.first = JointId{static_cast<std::uint32_t>(at[k])};
      coupling.coupling.second = JointId{static_cast<std::uint32_t>(at[k + 1])};
      coupling.coupling.ratio = 0.3 + draw.share();
      coupling.coupling.one_sided = kind == JointKind::kPulley && draw.below(2) == 0;
      if (kind == JointKind::kGear && draw.below(2) == 0) coupling.coupling.ratio *= -1.0;
      parts->joints.push_back(coupling);
      parts->ends.emplace_back(-1, 1);
    }
  };
  add(JointKind::kGear, coordinates_at);
  add(JointKind::kPulley, lengths_at);
}

/// Shifts and turns joints by up to 1 cm and 0.05 rad, and sends motors to other positions.
inline void open_joints(unsigned seed, Parts* parts) {
  Draw draw(seed + 3000029);
  for (std::size_t j = 0; j < parts->joints.size(); ++j) {
    Joint& joint = parts->joints[j];
    const bool has_frames = info(joint.kind).coordinates > 0 && !info(joint.kind).is_free_length;
    if (!has_frames) continue;
    const auto [a, b] = parts->ends[j];
    const auto turn_of = [&](int body) {
      return body < 0 ? Eigen::Quaterniond::Identity()
                      : parts->bodies[static_cast<std::size_t>(body)].state.orientation;
    };
    if (draw.below(2) == 0) {
      const Eigen::Quaterniond off(
          Eigen::AngleAxisd(0.05 * draw.share(), draw.vector().normalized()));
      joint.anchor_a += 0.005 * draw.vector();
      joint.frame_b = turn_of(b).conjugate() * (turn_of(a) * joint.frame_a) * off;
    }
    for (int i = 0; i < info(joint.kind).coordinates; ++i) {
      if (draw.below(2) == 0) continue;
      CoordinateLaw& law = joint.coordinates[static_cast<std::size_t>(i)];
      law.motor.emplace();
      law.motor->position = 0.1 * draw();
      law.motor->max_force = draw.below(3) == 0 ? 0.0 : std::pow(10.0, 4.0 * draw.share());
    }
  }
}

/// Equal cubes that stand on each other, or are dropped, and a ball that hits them.
inline Scene aligned(unsigned seed) {
  Draw draw(seed);
  Scene scene{Kind::kAligned, seed, {}, options(seed % 4 < 2 ? 1.0 / 30 : 0.01)};
  scene.options.method = seed % 2 == 0 ? Method::kEventDriven : Method::kAuto;
  scene.options.tolerance = WorldOptions{}.tolerance;
  Parts& parts = scene.parts;
  parts.bodies.push_back(make_floor(0.0, 0.0));
  const int count = draw.below(4) == 0 ? 3 : 2;
  const double apart = draw.below(4) == 0 ? 0.1 * draw.share() : 0.0;
  for (int i = 0; i < count; ++i)
    parts.bodies.push_back(make_body("box_" + std::to_string(i), Box{0.4 * Eigen::Vector3d::Ones()},
                                     1.0,
                                     Eigen::Vector3d(0.0, 0.0, 0.2 + 0.4 * i + apart * (i + 1))));
  Body ball = make_body("ball", Sphere{0.05}, 0.1 + 0.4 * draw.share(), Eigen::Vector3d::Zero());
  ball.state.position = {-1.0, 0.0, 0.1 + 0.7 * draw.share()};
  ball.state.linear_velocity = {5.0 + 25.0 * draw.share(), 0.0, 1.0};
  parts.bodies.push_back(ball);
  for (Body& body : parts.bodies) body.friction = 0.5;
  return scene;
}

inline Scene scene_of(Kind kind, unsigned seed) {
  Scene scene{kind, seed, {}, options(1.0 / 60)};
  if (has_servos(kind)) {
    scene = scene_of(touches(kind) ? Kind::kTouchingWithLaws : Kind::kMechanism, seed);
    scene.kind = kind;
    add_servos(seed, &scene.parts);
    return scene;
  }
  if (kind == Kind::kAligned) {
    scene = aligned(seed);
  } else if (kind == Kind::kArm) {
    scene.parts = arm(seed);
    scene.options.time_step = std::pow(10.0, -1.0 - 2.0 * Draw(seed + 1).share());
    scene.options.method = Method::kAuto;
  } else if (kind == Kind::kTouchingWithPoses) {
    scene = touching(seed, Kind::kTouchingWithLaws);
    scene.kind = kind;
    add_poses(seed, &scene.parts);
  } else if (kind == Kind::kTouchingWithParts) {
    scene = touching(seed, Kind::kTouchingWithLaws);
    scene.kind = kind;
    add_further_parts(seed, &scene.parts);
  } else if (kind == Kind::kTouchingCoupled || kind == Kind::kTouchingOpen) {
    scene = touching(seed, kind);
    if (kind == Kind::kTouchingCoupled)
      couple(seed, &scene.parts);
    else
      open_joints(seed, &scene.parts);
  } else if (touches(kind)) {
    scene = touching(seed, kind);
  } else {
    scene.parts = mechanism(seed, has_motors(kind));
    scene.options.method = Method::kAuto;
  }
  for (const Body& body : scene.parts.bodies)
    if (body.type == BodyType::kDynamic) scene.largest += body.mass * kGravity;
  let_joints_break(&scene);
  return scene;
}

/// Multiplies all masses, forces and stiffnesses, which leaves the motion as it is.
inline Scene with_masses(Scene scene, double factor) {
  for (Body& body : scene.parts.bodies) {
    body.mass *= factor;
    body.inertia *= factor;
  }
  for (Joint& joint : scene.parts.joints) {
    for (double* value : {&joint.break_force, &joint.break_torque, &joint.distance.stiffness,
                          &joint.distance.damping, &joint.motor.max_force})
      *value *= factor;
    for (CoordinateLaw& law : joint.coordinates) {
      for (double* value : {&law.friction, &law.damping, &law.stiffness}) *value *= factor;
      if (!law.motor) continue;
      for (double* value :
           {&law.motor->max_force, &law.motor->servo_stiffness, &law.motor->servo_damping})
        *value *= factor;
    }
  }
  return scene;
}

inline World world_of(const Scene& scene, const Placing& placing = {}) {
  return assemble(scene.parts, scene.options, placing);
}

}  // namespace constraint_sim::engine::random_events
