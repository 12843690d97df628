// Stiff and extreme cases for the stability grid, two seconds each.

#include <limits>

#include "common.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string power(double value) {
  char text[16];
  std::snprintf(text, sizeof text, "%.0e", value);
  return text;
}

/// The heavy chain of the diagrams. From 1e6 kg on its links are negligible: the load is a pendulum
/// of 11 m, up to the ratio of the masses.
Problem heavy_chain(double load) {
  Problem made = extreme("chain_load_" + power(load), "mass ratio", 11.0);
  PlanarChain chain = chain_of(11, -kPi / 2.0, 0.1);
  chain.masses.back() = load;
  chain.rates.back() = 1.0;
  made.measured = {10};
  made = with_chain(std::move(made), chain,
                    std::min(1.0 / 32.0, 1.5 / std::sqrt(load * kGravity / 0.1)));
  if (load < 1e6) return made;
  made.reference = one_angle(made, -kGravity / 11.0, 0.0, -kPi / 2.0, 1.0 / 11.0, 1.0 / 32.0,
                             [](long double angle, long double rate) {
                               const double c = static_cast<double>(std::cos(angle));
                               const double s = static_cast<double>(std::sin(angle));
                               const double w = static_cast<double>(rate);
                               States states(11);
                               states.back().position = 11.0 * Vector3d(c, 0.0, s);
                               states.back().velocity = 11.0 * w * Vector3d(-s, 0.0, c);
                               return states;
                             });
  made.source = "pendulum of 11 m: links without mass";
  return made;
}

/// Ten links released level, one with another mass.
Problem odd_chain(const std::string& name, std::size_t place, double mass) {
  PlanarChain chain = chain_of(10);
  chain.masses[place] = mass;
  return with_chain(extreme(name, "mass ratio", 10.0), chain, 1.0 / 128.0);
}

Problem long_chain(int links) {
  return with_chain(extreme("long_chain_" + std::to_string(links), "long chain", links),
                    chain_of(links), 1.0 / 32.0);
}

// ---- inertia and spin

Problem spinning(const std::string& name, const std::string& group, const Vector3d& inertia,
                 const Vector3d& spin, double step) {
  Problem made = extreme(name, group);
  made.is_planar = false;
  made.gravity = Vector3d::Zero();
  Body body;
  body.inertia = inertia;
  body.start.angular_velocity = spin;
  made.bodies = {body};
  made.reference = rigid_motion(made, true, Vector3d::Zero(), step);
  made.source = "quaternion and body rates in long double, by extrapolation";
  return made;
}

Problem hung(const std::string& name, const std::string& group, const Vector3d& inertia,
             const Vector3d& spin, double step) {
  Problem made = spinning(name, group, inertia, spin, step);
  made.gravity = {0.0, 0.0, -kGravity};
  made.bodies[0].start.position = {1.0, 0.0, 0.0};
  const Vector3d pivot(-1.0, 0.0, 0.0);
  made.bodies[0].start.velocity = spin.cross(made.bodies[0].start.position);
  made.joints = {ball_joint(kWorld, 0, Vector3d::Zero(), pivot)};
  made.reference = rigid_motion(made, false, pivot, step);
  return made;
}

// ---- redundancy and singular poses

/// A chain with every rod `times` over.
Problem doubled(const std::string& name, int links, int times) {
  Problem made = with_chain(extreme(name, "redundancy", links), chain_of(links), 1.0 / 64.0);
  const std::vector<Joint> once = made.joints;
  for (int i = 1; i < times; ++i) made.joints.insert(made.joints.end(), once.begin(), once.end());
  return made;
}

/// A row of masses on parallel rods joined at the top, starting at an angle of the rods.
Problem parallelogram(const std::string& name, const std::string& group, int rods, double angle,
                      double rate, bool is_braced) {
  Problem made = extreme(name, group, rods - 1.0);
  const auto states = [rods](long double theta, long double omega) {
    States all(static_cast<std::size_t>(rods));
    for (int k = 0; k < rods; ++k) {
      const double c = static_cast<double>(std::cos(theta)),
                   s = static_cast<double>(std::sin(theta));
      const double w = static_cast<double>(omega);
      all[static_cast<std::size_t>(k)].position = {k + c, 0.0, s};
      all[static_cast<std::size_t>(k)].velocity = {-w * s, 0.0, w * c};
    }
    return all;
  };
  for (const State& state : states(static_cast<long double>(angle), static_cast<long double>(rate)))
    made.bodies.push_back(point_mass(state.position, 1.0, state.velocity));
  for (int k = 0; k < rods; ++k) {
    made.joints.push_back(rod(kWorld, k, {static_cast<double>(k), 0.0, 0.0}));
    if (k > 0) made.joints.push_back(rod(k - 1, k));
    if (is_braced && k > 1) made.joints.push_back(rod(k - 2, k));
  }
  made.reference = one_angle(made, -kGravity, 0.0, angle, rate, 1.0 / 64.0, states);
  made.source = "one angle in long double, by extrapolation";
  return made;
}

// ---- stiff springs and motors

Problem stiff_spring(double stiffness) {
  Problem made = extreme("spring_" + power(stiffness), "stiff rows");
  const auto states = [=](long double t) {
    const long double g = static_cast<long double>(kGravity),
                      k = static_cast<long double>(stiffness);
    State state;
    state.position.z() = static_cast<double>(-1.0L - g / k * (1.0L - std::cos(std::sqrt(k) * t)));
    state.velocity.z() = static_cast<double>(-g / std::sqrt(k) * std::sin(std::sqrt(k) * t));
    return States{state};
  };
  made.bodies = {point_mass({0.0, 0.0, -1.0})};
  made.joints = {rod(kWorld, 0)};
  made.joints[0].kind = JointKind::kSpring;
  made.joints[0].stiffness = stiffness;
  made.reference = closed_form(made, states);
  made.source = "closed form";
  return made;
}

/// Ten masses on springs, released level.
Problem spring_chain(double stiffness) {
  Problem made = extreme("spring_chain_" + power(stiffness), "stiff rows", 10.0);
  add_chain(chain_of(10), &made);
  for (Joint& joint : made.joints) {
    joint.kind = JointKind::kSpring;
    joint.stiffness = stiffness;
  }
  return made;
}

/// A load on a rope that a motor winds up at 0.1 m/s; with too weak a motor it falls, less the
/// motor's pull.
Problem winch(const std::string& name, double mass, double max_force) {
  Problem made = extreme(name, "motor against load", 5.0);
  made.is_conservative = false;
  const double start = -20.0, weight = mass * kGravity;
  const bool holds = max_force == 0.0 || max_force > weight;
  const double a = holds ? 0.0 : -(weight - max_force) / mass;
  const double rate = -0.1;
  made.bodies = {point_mass({0.0, 0.0, start}, mass, {0.0, 0.0, -rate})};
  made.joints = {rod(kWorld, 0)};
  made.joints[0].rate = rate;
  made.joints[0].max_force = max_force;
  made.has_conflict = !holds;  // the rod does not reach its target length
  made.reference = closed_form(made, [=](long double time) {
    const double t = static_cast<double>(time);
    State state;
    state.position.z() = start - rate * t + 0.5 * a * t * t;
    state.velocity.z() = -rate + a * t;
    return States{state};
  });
  made.source = "closed form";
  return made;
}

// ---- scales: one motion in other units

Problem scaled(const std::string& name, double length, double mass, int links) {
  PlanarChain chain = chain_of(links, 0.3, mass, length);
  Problem made = extreme(name, "scale", length * links);
  made.tick_scale = std::sqrt(length);
  made.duration *= made.tick_scale;
  made.sample *= made.tick_scale;
  const double step = made.tick_scale / 64.0;
  return with_chain(std::move(made), chain, step);
}

Problem slow(Problem made, const std::string& name, double factor) {
  made.name = name;
  made.group = "huge tick";
  made.tick_scale = factor;
  made.duration *= factor;
  made.sample *= factor;
  return made;
}

Problem huge_tick_chain(const std::string& name, int links, double factor) {
  Problem made = slow(extreme(name, "huge tick", links), name, factor);
  return with_chain(std::move(made), chain_of(links, -kPi / 2.0 + 0.3), 1.0 / 64.0);
}

Problem huge_tick_box() {
  Problem made = slow(extreme("", "huge tick"), "huge_tick_box", 10.0);
  made.is_planar = false;
  Body body = box(10.0, {0.1, 0.4, 0.9});
  body.start.angular_velocity = {0.1, 5.0, 0.1};
  made.gravity = Vector3d::Zero();
  made.bodies = {body};
  made.reference = rigid_motion(made, true, Vector3d::Zero(), 1.0 / 64.0);
  made.source = "quaternion and body rates in long double, by extrapolation";
  return made;
}

// ---- contradictory and invalid problems

/// A mass on two rods too short to meet; they pull equally, so the mass should stay in the middle.
Problem conflict(const std::string& name, double missing) {
  Problem made = extreme(name, "conflicting rows");
  made.has_conflict = true;
  made.is_conservative = false;
  made.gravity = Vector3d::Zero();
  made.bodies = {point_mass(Vector3d::Zero())};
  made.joints = {rod(kWorld, 0, {-1.0, 0.0, 0.0}), rod(kWorld, 0, {1.0, 0.0, 0.0})};
  for (Joint& joint : made.joints) joint.length = 1.0 - missing;
  made.reference = closed_form(made, [](long double) { return States(1); });
  made.source = "symmetry";
  return made;
}

/// Two motors that pull against each other.
Problem fighting_motors() {
  Problem made = conflict("motors_fight", 0.0);
  for (Joint& joint : made.joints) {
    joint.length = -1.0;
    joint.rate = -0.1;
  }
  return made;
}

Problem invalid(const std::string& name, double mass, const Vector3d& position, double length) {
  Problem made = extreme(name, "invalid input");
  made.is_invalid = true;
  made.bodies = {point_mass(position, mass)};
  made.joints = {rod(kWorld, 0)};
  made.joints[0].length = length;
  return made;
}

std::vector<Problem> make() {
  std::vector<Problem> all;
  for (int exponent = 0; exponent <= 9; ++exponent)
    all.push_back(heavy_chain(std::pow(10.0, exponent)));
  for (const double mass : {1e-3, 1e-6, 1e-9})
    all.push_back(odd_chain("light_end_" + power(mass), 9, mass));
  for (const double mass : {1e3, 1e6})
    all.push_back(odd_chain("heavy_middle_" + power(mass), 5, mass));
  for (const int links : {30, 100, 300, 1000}) all.push_back(long_chain(links));

  const std::string inertia = "inertia ratio", spin = "spin";
  for (const double small : {1e-2, 1e-4, 1e-6})
    all.push_back(spinning("inertia_" + power(small), inertia, {small, 0.6, 0.600001},
                           {1.0, 2.0, 3.0}, 1.0 / 64.0));
  for (const double small : {1e-3, 1e-6})
    all.push_back(hung("hung_inertia_" + power(small), inertia, {small, 1.0, 1.0 + small / 2.0},
                       {0.5, 0.5, 1.0}, small < 1e-5 ? 1.0 / 4096.0 : 1.0 / 256.0));
  for (const double rate : {1e2, 1e3, 1e4})
    all.push_back(spinning("spin_" + power(rate), spin, {0.1, 0.2, 0.25},
                           {0.1 * rate, rate, 0.1 * rate}, 0.5 / rate));
  for (const double rate : {1e2, 1e3})
    all.push_back(
        hung("hung_spin_" + power(rate), spin, {0.2, 0.2, 0.3}, {rate, 0.0, 0.0}, 0.5 / rate));

  all.push_back(doubled("pendulum_doubled", 1, 2));
  all.push_back(doubled("double_pendulum_doubled", 2, 2));
  all.push_back(doubled("chain_10_tripled", 10, 3));
  const std::string singular = "singular pose", redundant = "redundancy";
  all.push_back(parallelogram("parallelogram_3", redundant, 3, 1.0, 0.0, false));
  all.push_back(parallelogram("row_braced", redundant, 6, 1.0, 0.0, true));
  all.push_back(parallelogram("flat_start", singular, 2, 0.0, 3.0, false));
  all.push_back(parallelogram("flat_start_10", singular, 11, 0.0, 3.0, false));
  all.push_back(parallelogram("flat_at_rest", singular, 2, 0.0, 0.0, false));
  all.push_back(parallelogram("turning_over", singular, 2, kPi / 2.0, -1.0, false));
  all.push_back(parallelogram("turning_over_10", singular, 11, kPi / 2.0, -1.0, false));
  all.push_back(
      with_chain(extreme("upside_down", singular), chain_of(1, kPi / 2.0 - 1e-3), 1.0 / 64.0));
  all.push_back(with_chain(
      extreme("folded", singular, 2.0),
      [] {
        PlanarChain chain = chain_of(2);
        chain.angles = {0.0, kPi - 1e-3};
        return chain;
      }(),
      1.0 / 256.0));

  for (const double stiffness : {1e2, 1e4, 1e6, 1e9, 1e12}) all.push_back(stiff_spring(stiffness));
  for (const double stiffness : {1e5, 1e8}) all.push_back(spring_chain(stiffness));
  all.push_back(winch("winch_lifts", 1.0, 0.0));
  all.push_back(winch("winch_lifts_1e3", 1e3, 0.0));
  all.push_back(winch("winch_strong_enough", 1.0, 15.0));
  all.push_back(winch("winch_too_weak", 1.0, 5.0));

  for (const double length : {1e-6, 1e-3, 1e3, 1e6}) {
    all.push_back(scaled("length_" + power(length), length, 1.0, 1));
    all.push_back(scaled("length_" + power(length) + "_double", length, 1.0, 2));
  }
  for (const double mass : {1e-6, 1e6}) all.push_back(scaled("mass_" + power(mass), 1.0, mass, 2));

  all.push_back(huge_tick_chain("huge_tick_pendulum", 1, 2.0));
  all.push_back(huge_tick_chain("huge_tick_double_pendulum", 2, 2.0));
  all.push_back(huge_tick_chain("huge_tick_chain_10", 10, 2.0));
  all.push_back(huge_tick_box());

  all.push_back(conflict("rods_too_short", 0.1));
  all.push_back(conflict("rods_far_too_short", 0.5));
  all.push_back(fighting_motors());

  all.push_back(invalid("mass_zero", 0.0, Vector3d::UnitX(), -1.0));
  all.push_back(invalid("mass_negative", -1.0, Vector3d::UnitX(), -1.0));
  all.push_back(invalid("mass_nan", kNaN, Vector3d::UnitX(), -1.0));
  all.push_back(
      invalid("mass_infinite", std::numeric_limits<double>::infinity(), Vector3d::UnitX(), -1.0));
  all.push_back(invalid("position_nan", 1.0, {kNaN, 0.0, 0.0}, 1.0));
  all.push_back(invalid("length_nan", 1.0, Vector3d::UnitX(), kNaN));
  return all;
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
