// Contact and impact: SimBenchmark's scenes, and closed forms.

#include "common.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

Body block(double mass, const Vector3d& size, const Vector3d& position, double friction) {
  Body body = box(mass, size);
  body.shape = Shape::kBox;
  body.start.position = position;
  body.friction = friction;
  return body;
}

/// A problem with contacts, dissipative and with a closed form.
Problem contact(const std::string& name, double duration, double length) {
  Problem made = problem(name, "contact", duration, length);
  made.is_planar = false;
  made.is_conservative = false;
  made.source = "closed form";
  return made;
}

/// A box on the ground, pulled by 150 N, with 25 balls on top that roll as it slides below them.
Problem rolling() {
  Problem made = contact("rolling", 4.0, 10.0);
  // a pair has the geometric mean: 0.4 below the box and 0.8 above it
  made.bodies = {plane(0.2, 0.0), block(10.0, {20.0, 20.0, 1.0}, {0.0, 0.0, 0.5}, 0.8)};
  const Vector3d direction = Vector3d(0.5, 0.866, 0.0).normalized();
  made.bodies[1].force = 150.0 * direction;
  for (int i = 0; i < 25; ++i)
    made.bodies.push_back(
        ball(1.0, 0.5, {2.0 * (i % 5) - 4.0, 2.0 * std::floor(i / 5.0) - 4.0, 1.5}, 0.8));
  const double below = 0.4 * 35.0 * kGravity;
  const double above = (150.0 - below) / 10.0 / (3.5 + 2.5);
  const double a_box = (150.0 - below - 25.0 * above) / 10.0;
  States start;
  for (const Body& body : made.bodies) start.push_back(body.start);
  made.reference = closed_form(made, [=](long double time) {
    const double t = static_cast<double>(time);
    States states = start;
    for (std::size_t i = 1; i < states.size(); ++i) {
      const double a = i == 1 ? a_box : above;
      states[i].position += 0.5 * a * t * t * direction;
      states[i].velocity = a * t * direction;
      if (i == 1) continue;
      // the box drives the lowest point: α = −(5/2) (a/r) z × direction
      const Vector3d axis = -Vector3d::UnitZ().cross(direction);
      states[i].angular_velocity = 2.5 * a / 0.5 * t * axis;
      states[i].orientation = Eigen::AngleAxisd(0.5 * 2.5 * a / 0.5 * t * t, axis);
    }
    return states;
  });
  return made;
}

/// Balls of radius R that fall from 5 m and bounce for ever.
Problem bouncing() {
  Problem made = contact("bouncing", 20.0, 5.0);
  made.is_conservative = true;
  made.bodies = {plane(0.0, 1.0)};
  for (int i = 0; i < 49; ++i)
    made.bodies.push_back(ball(10.0, 0.1, {1.0 * (i % 7), std::floor(i / 7.0), 5.0}, 0.0, 1.0));
  States start;
  for (const Body& body : made.bodies) start.push_back(body.start);
  made.reference = closed_form(made, [=](long double t) {
    const long double g = static_cast<long double>(kGravity), fall = std::sqrt(2.0L * 4.9L / g);
    const long double phase = std::remainder(t, 2.0L * fall);  // time from the highest point
    States states = start;
    for (std::size_t i = 1; i < states.size(); ++i) {
      states[i].position.z() = static_cast<double>(5.0L - g * phase * phase / 2.0L);
      states[i].velocity.z() = static_cast<double>(-g * phase);
    }
    return states;
  });
  return made;
}

/// Six layers of six by six balls, slightly out of line, fall into a heap.
Problem heap(const std::string& name, double restitution) {
  Problem made = contact(name, 2.0, 6.0);
  made.is_conservative = restitution == 1.0;
  made.bodies = {plane(0.0, restitution)};
  for (int i = 0; i < 216; ++i) {
    const double x = i % 6, y = std::floor(i / 6.0) - 6.0 * std::floor(i / 36.0);
    const double z = std::floor(i / 36.0);
    made.bodies.push_back(
        ball(1.0, 0.4, {x + 0.05 * std::sin(1.0 + 7.0 * i), y + 0.05 * std::cos(3.0 * i), 1.0 + z},
             0.0, restitution));
  }
  made.source.clear();
  return made;
}

/// A block on a slope of 30°, written as tilted gravity. It stays, or slides with g (sin − μ cos).
Problem incline(const std::string& name, double friction) {
  Problem made = contact(name, 2.0, 1.0);
  const double slope = kPi / 6.0;
  made.gravity = kGravity * Vector3d(std::sin(slope), 0.0, -std::cos(slope));
  made.bodies = {plane(friction, 0.0), block(1.0, {1.0, 1.0, 0.5}, {0.0, 0.0, 0.25}, friction)};
  const double a = std::max(0.0, kGravity * (std::sin(slope) - friction * std::cos(slope)));
  made.reference = closed_form(made, [=](long double t) {
    States states(2);
    states[1].position = {0.5 * a * static_cast<double>(t * t), 0.0, 0.25};
    states[1].velocity = {a * static_cast<double>(t), 0.0, 0.0};
    return states;
  });
  return made;
}

/// A ball launched with v₀ slides until it rolls at 5 v₀ / 7.
Problem sliding_ball() {
  Problem made = contact("sliding_ball", 2.0, 5.0);
  constexpr double kSpeed = 3.0, kFriction = 0.2, kRadius = 0.5;
  made.bodies = {plane(kFriction, 0.0), ball(1.0, kRadius, {0.0, 0.0, kRadius}, kFriction)};
  made.bodies[1].start.velocity.x() = kSpeed;
  made.reference = closed_form(made, [=](long double time) {
    const double a = kFriction * kGravity, rolls_at = 2.0 * kSpeed / (7.0 * a);
    const double t = static_cast<double>(time), slides = std::min(t, rolls_at);
    const double rolls = t - slides, speed = kSpeed - a * slides, spin = 2.5 * a / kRadius;
    States states(2);
    states[1].position = {kSpeed * slides - 0.5 * a * slides * slides + speed * rolls, 0.0,
                          kRadius};
    states[1].velocity = {speed, 0.0, 0.0};
    states[1].angular_velocity = {0.0, spin * slides, 0.0};
    states[1].orientation =
        Eigen::AngleAxisd(0.5 * spin * slides * slides + spin * slides * rolls, Vector3d::UnitY());
    return states;
  });
  return made;
}

/// Newton's cradle without strings: the impulse passes from ball to ball, and the last ball leaves.
Problem cradle() {
  constexpr int kCount = 5;
  constexpr double kRadius = 0.1, kGap = 0.05, kRun = 0.3;
  Problem made = contact("cradle", 2.0, 2.0);
  made.gravity = Vector3d::Zero();
  made.is_conservative = true;
  for (int i = 0; i < kCount; ++i) {
    const double x = i == 0 ? 0.0 : 2.0 * kRadius + kRun + (i - 1) * (2.0 * kRadius + kGap);
    made.bodies.push_back(ball(1.0, kRadius, {x, 0.0, 0.0}, 0.0, 1.0));
  }
  made.bodies[0].start.velocity.x() = 1.0;
  States start;
  for (const Body& body : made.bodies) start.push_back(body.start);
  made.reference = closed_form(made, [=](long double time) {
    States states = start;
    double left = static_cast<double>(time);
    for (int i = 0; i < kCount; ++i) {
      const double run = i == 0 ? kRun : kGap;
      const bool stays = left > run && i + 1 < kCount;
      State& state = states[static_cast<std::size_t>(i)];
      state.position.x() += stays ? run : std::max(0.0, left);
      state.velocity.x() = !stays && (left > 0.0 || i == 0) ? 1.0 : 0.0;
      left -= run;
    }
    return states;
  });
  return made;
}

Problem fast_impact(const std::string& name, double speed, bool is_thin_wall) {
  Problem made = contact(name, 2.0, 1.0);
  made.is_graded = false;
  made.group = "fast impact";
  made.is_conservative = true;
  made.gravity = Vector3d::Zero();
  constexpr double kRadius = 0.05;
  const double face = is_thin_wall ? 0.0005 : 0.0;
  Body wall = plane(0.0, 1.0);
  wall.start.orientation = Eigen::AngleAxisd(-kPi / 2.0, Vector3d::UnitY());  // normal −x
  if (is_thin_wall) {
    wall.shape = Shape::kBox;
    wall.size = {0.001, 2.0, 2.0};
    wall.start.orientation = Eigen::Quaterniond::Identity();
  }
  // distance from the wall is no whole number of ticks
  const double x = -speed * 0.987;
  made.bodies = {wall, ball(1.0, kRadius, {x, 0.0, 0.0}, 0.0, 1.0)};
  made.bodies[1].start.velocity.x() = speed;
  made.length = speed;
  const State fixed = wall.start;
  made.reference = closed_form(made, [=](long double t) {
    States states{fixed, State{}};
    const double end = -face - kRadius, at = x + speed * static_cast<double>(t);
    states[1].position.x() = at < end ? at : 2.0 * end - at;
    states[1].velocity.x() = at < end ? speed : -speed;
    return states;
  });
  return made;
}

Problem stack(const std::string& name, int count, double top_mass) {
  Problem made = contact(name, 2.0, 0.5 * count);
  made.is_graded = false;
  made.group = "heavy stack";
  made.bodies = {plane(0.5, 0.0)};
  for (int i = 0; i < count; ++i)
    made.bodies.push_back(
        block(i + 1 == count ? top_mass : 1.0, {0.5, 0.5, 0.5}, {0.0, 0.0, 0.25 + 0.5 * i}, 0.5));
  States start;
  for (const Body& body : made.bodies) start.push_back(body.start);
  made.reference = closed_form(made, [start](long double) { return start; });
  return made;
}

std::vector<Problem> make() {
  return {rolling(),
          bouncing(),
          heap("balls_666", 0.0),
          heap("balls_666_elastic", 1.0),
          incline("block_sticks", 0.7),
          incline("block_slides", 0.3),
          sliding_ball(),
          cradle(),
          fast_impact("impact_50", 50.0, false),
          fast_impact("impact_500", 500.0, false),
          fast_impact("impact_50_thin_wall", 50.0, true),
          fast_impact("impact_500_thin_wall", 500.0, true),
          stack("stack_3", 3, 1.0),
          stack("stack_10", 10, 1.0),
          stack("stack_3_top_1e3", 3, 1e3),
          stack("stack_10_top_1e2", 10, 1e2)};
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
