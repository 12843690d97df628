#include "judge.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

constexpr double kAgreed = 1e-6;  // difference of two fine motions that can be a reference [length]

std::size_t index(int i) { return static_cast<std::size_t>(i); }
std::size_t index(Criterion criterion) { return static_cast<std::size_t>(criterion); }

/// Returns the islands of a problem: a number for each body, equal within an island. Static bodies
/// and the world are islands of their own.
std::vector<std::size_t> islands_of(const Problem& problem) {
  std::vector<std::size_t> island(problem.bodies.size());
  std::iota(island.begin(), island.end(), std::size_t{0});
  for (std::size_t round = 0; round < island.size(); ++round)
    for (const Joint& joint : problem.joints) {
      if (joint.a == kWorld || joint.b == kWorld) continue;
      std::size_t& a = island[index(joint.a)];
      std::size_t& b = island[index(joint.b)];
      a = b = std::min(a, b);
    }
  return island;
}

struct Momenta {
  Vector3d linear = Vector3d::Zero();   ///< [kg m/s]
  Vector3d angular = Vector3d::Zero();  ///< about the centre of mass [kg m²/s]
  double linear_scale = 0.0, angular_scale = 0.0;
};

Momenta momenta(const Problem& problem, const States& states) {
  Momenta sum;
  double mass = 0.0;
  Vector3d centre = Vector3d::Zero();
  for (std::size_t i = 0; i < states.size(); ++i) {
    const double m = problem.bodies[i].mass;
    mass += m;
    centre += m * states[i].position;
    sum.linear += m * states[i].velocity;
    sum.linear_scale += m * states[i].velocity.norm();
  }
  centre /= mass;
  const Vector3d drift = sum.linear / mass;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const Body& body = problem.bodies[i];
    const State& state = states[i];
    const Vector3d spin =
        state.orientation *
        body.inertia.cwiseProduct(state.orientation.conjugate() * state.angular_velocity);
    const Vector3d orbit = body.mass * (state.position - centre).cross(state.velocity - drift);
    sum.angular += orbit + spin;
    sum.angular_scale += orbit.norm() + spin.norm();
  }
  return sum;
}

/// Scales and kinds of a problem.
class Scales {
 public:
  Scales(const Problem& problem, const States& start)
      : problem_(problem), start_momenta_(momenta(problem, start)) {
    const auto is_static = [](const Body& body) { return body.is_static; };
    const bool has_ground = std::any_of(problem.bodies.begin(), problem.bodies.end(), is_static);
    is_isolated_ = !has_ground;
    for (const Joint& joint : problem.joints) {
      is_isolated_ = is_isolated_ && joint.a != kWorld && joint.b != kWorld;
      has_laws_ = has_laws_ || joint.has_law();
    }
    for (const Body& body : problem.bodies) {
      if (body.is_static || body.shape == Shape::kPoint) continue;
      has_contacts_ = true;
      const double half = body.shape == Shape::kBox ? 0.5 * body.size.minCoeff() : body.size.x();
      size_ = std::min(size_, half);
    }
    start_energy_ = energy(problem, start);
    energy_ = energy_scale(start, has_ground);
  }

  double size() const { return size_; }
  bool is_isolated() const { return is_isolated_; }
  /// Returns the change of energy that should not be, over its scale.
  double energy_error(const States& states) const {
    const double rise = (energy(problem_, states) - start_energy_) / energy_;
    return has_laws_ || has_contacts_ ? rise : std::abs(rise);
  }
  double momentum_error(const States& states, double time) const {
    const Momenta now = momenta(problem_, states);
    double mass = 0.0;
    for (const Body& body : problem_.bodies) mass += body.mass;
    const Vector3d push = time * mass * problem_.gravity;
    const double linear = (now.linear - start_momenta_.linear - push).norm();
    const double angular = (now.angular - start_momenta_.angular).norm();
    const double linear_scale =
        std::max(start_momenta_.linear_scale + push.norm(), mass * rest_speed());
    const double angular_scale =
        std::max(start_momenta_.angular_scale, mass * problem_.length * rest_speed());
    return std::max(linear / linear_scale, angular / angular_scale);
  }

 private:
  /// Speed of a motion through the scene within the run, the scale of scenes at rest [m/s].
  double rest_speed() const { return problem_.length / problem_.duration; }

  /// Kinetic energy and energy of springs at the start, and the work of gravity: on free bodies
  /// over the height of their fall, on others over the lengths by which they hang.
  double energy_scale(const States& start, bool has_ground) const {
    double scale = kinetic_energy(problem_, start);
    Problem weightless = problem_;
    weightless.gravity.setZero();
    scale = std::max(scale, energy(weightless, start));
    const double g = problem_.gravity.norm(), T = problem_.duration;
    const std::vector<std::size_t> island = islands_of(problem_);
    double lowest = 0.0;
    for (std::size_t i = 0; i < start.size(); ++i)
      if (problem_.bodies[i].is_static) lowest = start[i].position.z();
    for (std::size_t i = 0; i < start.size(); ++i) {
      const Body& body = problem_.bodies[i];
      if (body.is_static) continue;
      double reach = start[i].velocity.norm() * T + 0.5 * g * T * T;
      if (has_ground) reach = std::min(reach, start[i].position.z() - lowest + problem_.length);
      reach = std::min(reach, hung_reach(island, island[i], g));
      scale += body.mass * (g * reach + 0.5 * rest_speed() * rest_speed());
    }
    return scale;
  }

  /// Returns how far an island can swing that hangs on the world; infinity where it is free.
  double hung_reach(const std::vector<std::size_t>& island, std::size_t number, double g) const {
    double weight = 0.0, reach = 0.0;
    bool is_hung = false;
    for (std::size_t i = 0; i < island.size(); ++i)
      if (island[i] == number && !problem_.bodies[i].is_static)
        weight += g * problem_.bodies[i].mass;
    for (const Joint& joint : problem_.joints) {
      const int body = joint.b == kWorld ? joint.a : joint.b;
      if (island[index(body)] != number) continue;
      is_hung = is_hung || joint.a == kWorld || joint.b == kWorld;
      reach += 2.0 * problem_.length + (joint.is_rope() ? joint.upper : 0.0);
      if (joint.kind == JointKind::kSpring) reach += 2.0 * weight / joint.stiffness;
    }
    return is_hung ? reach : std::numeric_limits<double>::infinity();
  }

  const Problem& problem_;
  Momenta start_momenta_;
  double start_energy_ = 0.0, energy_ = 0.0;
  double size_ = std::numeric_limits<double>::infinity();  // half of the smallest shape [m]
  bool is_isolated_ = false, has_laws_ = false, has_contacts_ = false;
};

/// Returns the largest excess over limits of hinges [rad] and sliders [length] on the world.
double limit_error(const Problem& problem, const States& states) {
  double largest = 0.0;
  for (const Joint& joint : problem.joints) {
    if (!joint.is_limited() || joint.is_rope() || joint.a != kWorld) continue;
    const State& state = states[index(joint.b)];
    const Eigen::Quaterniond turn = joint.frame_a.conjugate() * state.orientation * joint.frame_b;
    const Vector3d arm = state.position + state.orientation * joint.anchor_b - joint.anchor_a;
    const bool is_hinge = joint.kind == JointKind::kHinge;
    const double angle =
        2.0 * std::atan2(turn.w() < 0.0 ? -turn.z() : turn.z(), std::abs(turn.w()));
    const double q = is_hinge ? angle : (joint.frame_a.conjugate() * arm).z();
    const double excess = std::max({joint.lower - q, q - joint.upper, 0.0});
    largest = std::max(largest, is_hinge ? excess : excess / problem.length);
  }
  return largest;
}

/// Returns the deepest overlap of balls and boxes [m], which penetration() leaves out.
double overlap_of_boxes(const Problem& problem, const States& states) {
  double deepest = 0.0;
  for (std::size_t i = 0; i < states.size(); ++i)
    for (std::size_t k = 0; k < states.size(); ++k) {
      const Body& box = problem.bodies[i];
      const Body& ball = problem.bodies[k];
      if (box.shape != Shape::kBox || ball.shape != Shape::kSphere) continue;
      const Vector3d centre =
          states[i].orientation.conjugate() * (states[k].position - states[i].position);
      const Vector3d outside = centre.cwiseAbs() - 0.5 * box.size;
      const double depth = -std::min(outside.maxCoeff(), 0.0);
      deepest = std::max(deepest, ball.size.x() - outside.cwiseMax(0.0).norm() + depth);
    }
  return deepest;
}

/// Returns the largest error of a body: its distance from the reference over the larger of the
/// problem's length and the body's path, or the angle [rad] if that is larger.
double reference_error(const Problem& problem, const States& states, const States& exact,
                       const States& start) {
  double largest = 0.0;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const double path = (exact[i].position - start[i].position).norm();
    largest = std::max(
        largest, (states[i].position - exact[i].position).norm() / std::max(problem.length, path));
    if (!problem.bodies[i].inertia.isZero(0.0))
      largest = std::max(largest, angle_between(states[i].orientation, exact[i].orientation));
  }
  return largest;
}

/// Sets whether the engine said that the criterion is off by the amount, or by an amount of this
/// order.
void hear(const Problem& problem, const Scales& scales, const Said& said, Judgement* judgement) {
  constexpr double kOrder = 0.1;  // an estimate within a factor of ten says how wrong it is
  const auto say = [&](const std::string& words) {
    judgement->word = Word::kSaid;
    judgement->said = words;
  };
  char text[64];
  const auto is_of_order = [&](double value, double unit) {
    return value / unit >= kOrder * judgement->amount;
  };
  const auto figure = [&](const char* what, double value, double unit) {
    if (!is_of_order(value, unit)) return;
    std::snprintf(text, sizeof text, "%s %.2g m", what, value);
    say(text);
  };
  if (!said.warning.empty()) return say(said.warning);
  std::snprintf(text, sizeof text, "estimate %.2g m, growth %.2g", said.motion, judgement->growth);
  judgement->said = text;
  if (judgement->worst == Criterion::kJoint) figure("joint error", said.joint, problem.length);
  if (judgement->worst == Criterion::kPenetration)
    figure("penetration", said.penetration, scales.size());
  if (judgement->worst < Criterion::kEnergy) return;
  if (std::isnan(said.motion)) return say("no estimate of the error");
  figure("estimate of the error", said.motion, problem.length);
  if (judgement->word == Word::kSilent &&
      is_of_order(said.motion * judgement->growth, problem.length))
    judgement->word = Word::kGrown;
}

/// Returns how much a disturbance of the start had grown at each sample, at most until then.
std::vector<double> growths(const Problem& problem, const Reference& reference) {
  std::vector<double> growth(reference.exact.size(), 1.0);
  for (std::size_t k = 1; k < growth.size(); ++k) {
    growth[k] = growth[k - 1];
    if (k >= reference.disturbed.size()) continue;
    growth[k] = std::max(growth[k], reference_error(problem, reference.disturbed[k],
                                                    reference.exact[k], reference.exact[0]) /
                                        kDisturbance);
  }
  return growth;
}

}  // namespace

const char* name(Grade grade) {
  constexpr std::array<const char*, 3> kNames{"held", "inaccurate", "blew up"};
  return kNames[static_cast<std::size_t>(grade)];
}

const char* name(Word word) {
  constexpr std::array<const char*, 3> kNames{"silent", "grown", "said"};
  return kNames[static_cast<std::size_t>(word)];
}

const char* name(Criterion criterion) {
  constexpr std::array<const char*, 7> kNames{"not finite", "joint",    "limit",    "penetration",
                                              "energy",     "momentum", "reference"};
  return kNames[index(criterion)];
}

Judgement judge(const Problem& problem, const Motion& motion, bool is_finite, const Said& said,
                const Reference& reference) {
  const States& start = motion.states.front();
  const Scales scales(problem, start);
  const std::vector<double> growth = growths(problem, reference);
  Judgement made;
  const auto raise = [&](Criterion criterion, double amount, double time) {
    Grade grade = Grade::kHeld;
    if (!(amount <= kHeldShare)) grade = Grade::kInaccurate;
    if (!(amount <= 1.0) && criterion != Criterion::kReference) grade = Grade::kBlewUp;
    const bool is_worse = grade > made.grade || (grade == made.grade && !(amount <= made.amount));
    if (!is_worse) return;
    if (grade > made.grade || grade != Grade::kBlewUp) made.time = time;
    made.grade = grade;
    made.worst = criterion;
    made.amount = amount;
  };
  for (std::size_t k = 1; k < motion.states.size(); ++k) {
    const States& states = motion.states[k];
    const double time = motion.sample[k] * problem.sample;
    raise(Criterion::kJoint, constraint_error(problem, states, time) / problem.length, time);
    raise(Criterion::kLimit, limit_error(problem, states), time);
    if (problem.has_shapes()) {
      const double depth =
          std::max(penetration(problem, states), overlap_of_boxes(problem, states));
      raise(Criterion::kPenetration, depth / scales.size(), time);
    }
    raise(Criterion::kEnergy, scales.energy_error(states), time);
    if (scales.is_isolated())
      raise(Criterion::kMomentum, scales.momentum_error(states, time), time);
    const std::size_t sample = index(motion.sample[k]);
    if (sample >= reference.exact.size()) continue;
    const double error = reference_error(problem, states, reference.exact[sample], start);
    if (error > made.amount) made.growth = growth[sample];
    raise(Criterion::kReference, error, time);
  }
  if (!is_finite) {
    made.grade = Grade::kBlewUp;
    made.worst = Criterion::kFinite;
    made.amount = std::numeric_limits<double>::infinity();
    made.time = (motion.sample.back() + 1) * problem.sample;
  }
  if (made.grade != Grade::kHeld) hear(problem, scales, said, &made);
  return made;
}

Problem disturbed(const Problem& problem) {
  Problem made = problem;
  const double speed = kDisturbance * speed_of(problem);
  for (Body& body : made.bodies) {
    if (body.is_static) continue;
    body.start.velocity += speed * Vector3d(1.0, -0.6, 0.8);
    if (!body.inertia.isZero(0.0))
      body.start.angular_velocity += speed / problem.length * Vector3d(-0.8, 1.0, 0.6);
  }
  return made;
}

std::size_t agreement(const Problem& problem, const Trajectory& a, const Trajectory& b) {
  std::size_t count = 0;
  while (count < std::min(a.size(), b.size()) &&
         reference_error(problem, a[count], b[count], b.front()) <= kAgreed)
    ++count;
  return count;
}

double speed_of(const Problem& problem) {
  double speed = std::max(problem.length, std::sqrt(problem.gravity.norm() * problem.length));
  for (const Body& body : problem.bodies)
    speed = std::max(
        {speed, body.start.velocity.norm(), problem.length * body.start.angular_velocity.norm()});
  return speed;
}

std::string description(const Problem& problem) {
  double least = std::numeric_limits<double>::infinity(), most = 0.0, spin = 0.0, stiffness = 0.0;
  for (const Body& body : problem.bodies) {
    if (body.is_static) continue;
    least = std::min(least, body.mass);
    most = std::max(most, body.mass);
    spin = std::max(
        {spin, body.start.angular_velocity.norm(), body.start.velocity.norm() / problem.length});
  }
  for (const Joint& joint : problem.joints) stiffness = std::max(stiffness, joint.stiffness);
  char text[160];
  std::snprintf(
      text, sizeof text,
      "%zu bodies, %zu joints, length %.1g m, masses 1:%.1g, stiffness %.1g N/m, step %.1g s, "
      "spin %.1g rad/s",
      problem.bodies.size(), problem.joints.size(), problem.length, most / least, stiffness,
      problem.sample, spin);
  return text;
}

}  // namespace constraint_sim::report
