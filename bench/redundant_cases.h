#pragma once

// Cases of redundancy, singular poses and mass ratios: scenes, settings, and figures of a
// prototype. Tests allow ten times these figures; constraint_sim_redundancy_table prints them
// beside the engine's.

#include <functional>

#include "inertia_of.h"
#include "redundant_scenes.h"

namespace constraint_sim::engine::redundant {

// ---- figures

inline Vector3d anchor_in_world(const World& world, BodyId id, const Vector3d& anchor) {
  if (id == kWorldBody) return anchor;
  return world.state(id).position + world.state(id).orientation * anchor;
}

/// Returns the largest error of a joint without limits and springs [m]; motors are not counted.
inline double largest_joint_error(const World& world) {
  double largest = 0.0;
  for (const JointId id : world.joint_ids()) {
    const Joint& joint = world.joint(id);
    const auto* distance = if_distance(joint);
    if (distance != nullptr && (distance->is_soft() || distance->is_limited())) continue;
    const double length = distance != nullptr ? *distance->length : 0.0;
    const Vector3d d = anchor_in_world(world, joint.body_b, joint.anchor_b) -
                       anchor_in_world(world, joint.body_a, joint.anchor_a);
    largest = std::max(largest, std::abs(d.norm() - length));
  }
  return largest;
}

inline double largest_coordinate(const World& world) {
  double largest = 0.0;
  for (const BodyId id : world.body_ids())
    largest = std::max(largest, world.state(id).position.cwiseAbs().maxCoeff());
  return largest;
}

inline double kinetic_energy(const World& world) {
  double sum = 0.0;
  for (const BodyId id : world.body_ids()) {
    const Body& body = world.body(id);
    const BodyState& state = world.state(id);
    const Vector3d w_B = state.orientation.conjugate() * state.angular_velocity;
    sum += 0.5 * body.mass * state.linear_velocity.squaredNorm() +
           0.5 * inertia_of(body).dot(w_B.cwiseAbs2());
  }
  return sum;
}

/// Returns the sum of |potential energy| of all bodies [J].
inline double size_of_potential_energy(const World& world) {
  double sum = 0.0;
  for (const BodyId id : world.body_ids())
    sum += world.body(id).mass * std::abs(world.options().gravity.dot(world.state(id).position));
  return sum;
}

inline bool has_conflict(const World& world) {
  for (const Island& island : world.islands())
    if (island.why == MethodReason::kInconsistent || island.why == MethodReason::kRefused)
      return true;
  return false;
}

struct Figures {
  double joints = 0.0;        // largest error [m]
  double energy = 0.0;        // largest |E − E0| [J]
  double rise = 0.0;          // largest E − E0 [J]
  double peak_kinetic = 0.0;  // [J]
  double scale = 0.0;         // sum of |energy| terms [J]
  double round_off = 0.0;     // rounding of joints [m]
  double lost = 0.0;          // sum of StepReport::Energy::projected [J]
  std::uint32_t changes = 0;  // changes of method
  bool has_failed = false;    // a step failed, or an island was taken for contradictory
};

/// Runs a world. Ends early, with the figures so far, once joints or energy exceed their bounds.
inline Figures measure(World world, double duration, double joints_allowed, double energy_allowed) {
  Figures figures;
  const double start = world.energy();
  const auto ticks = std::lround(duration / world.options().time_step);
  for (long i = 0; i < ticks; ++i) {
    const StepReport& report = world.step();
    figures.lost += report.energy.projected;
    figures.has_failed = figures.has_failed || report.outcome.failed || has_conflict(world);
    figures.changes += report.costs.method_changes;
    const double kinetic = kinetic_energy(world);
    const double energy = world.energy();
    figures.joints = std::max(figures.joints, largest_joint_error(world));
    figures.energy = std::max(figures.energy, std::abs(energy - start));
    figures.rise = std::max(figures.rise, energy - start);
    figures.peak_kinetic = std::max(figures.peak_kinetic, kinetic);
    figures.scale =
        std::max(figures.scale, kinetic + size_of_potential_energy(world) + std::abs(start));
    figures.round_off =
        std::max(figures.round_off, 1e-12 + 4.0 * 2.22e-16 * largest_coordinate(world));
    if (report.outcome.failed || figures.joints > std::max(joints_allowed, figures.round_off) ||
        figures.energy > std::max(energy_allowed, 1e-12 * figures.scale))
      break;
  }
  return figures;
}

inline World with(World world, Method method, double rate, double tolerance = 1e-8) {
  WorldOptions options = world.options();
  options.method = method;
  options.time_step = 1.0 / rate;
  options.tolerance = tolerance;
  world.set_options(options);
  return world;
}

// ---- cases

struct Case {
  std::string name;
  std::function<World()> make;
  Method method;
  double rate;      // [1/s]
  double duration;  // [s]
  double joints;    // figure of the prototype [m]
  double energy;    // figure of the prototype [J]
  double tolerance = 1e-8;
  bool keeps_method = false;  // the figure was measured without a change of method

  /// Bounds: ten times the figure where that is above rounding; rounding is always allowed.
  double joints_allowed() const { return joints > 1e-12 ? 10.0 * joints : 0.0; }
  double energy_allowed() const { return energy > 1e-12 ? 10.0 * energy : 0.0; }
};

inline constexpr Method kAuto = Method::kAuto, kRk = Method::kRungeKutta,
                        kEm = Method::kEnergyMomentum;
inline const Vector3d kFar(1000.0, 0.0, 0.0), kTen(10.0, 0.0, 0.0), kFarUp(600.0, 0.0, 800.0);

inline Figures measure(const Case& c) {
  return measure(with(c.make(), c.method, c.rate, c.tolerance), c.duration, c.joints_allowed(),
                 c.energy_allowed());
}

inline bool is_met(const Case& c, const Figures& figures) {
  return !figures.has_failed && figures.joints <= std::max(c.joints_allowed(), figures.round_off) &&
         figures.energy <= std::max(c.energy_allowed(), 1e-12 * figures.scale) &&
         (!c.keeps_method || figures.changes == 0);
}

// Cases with permanently dependent rows. At short ticks durations are below the prototype's 3 to 5
// s, to keep the tests quick.
inline std::vector<Case> permanent_cases() {
  return {
      Case{"dome_auto", [] { return dome(); }, kAuto, 30, 3, 9e-16, 7e-13},
      Case{"dome_auto", [] { return dome(); }, kAuto, 60, 3, 9e-16, 7e-13},
      Case{"dome_auto", [] { return dome(); }, kAuto, 100, 3, 9e-16, 7e-13},
      Case{"dome_far", [] { return dome(kFarUp); }, kAuto, 60, 3, 2e-13, 1e-10},
      Case{"bricard_rk_1e12", [] { return bricard(); }, kRk, 10, 3, 2e-15, 5e-12, 1e-12},
      Case{"bricard_rk_1e12", [] { return bricard(); }, kRk, 30, 3, 2e-15, 6e-12, 1e-12},
      Case{"bricard_rk_1e12", [] { return bricard(); }, kRk, 100, 3, 2e-15, 2e-12, 1e-12},
      Case{"bricard_rk_1e12", [] { return bricard(); }, kRk, 1000, 1, 2e-15, 3e-13, 1e-12},
      Case{"bricard_rk_1e8", [] { return bricard(); }, kRk, 10, 3, 2e-15, 1e-7},
      Case{"bricard_rk_1e8", [] { return bricard(); }, kRk, 30, 3, 2e-15, 1e-7},
      Case{"bricard_rk_1e8", [] { return bricard(); }, kRk, 100, 3, 2e-15, 1e-8},
      Case{"bricard_rk_1e8", [] { return bricard(); }, kRk, 1000, 1, 2e-15, 3e-13},
      Case{"bricard_far", [] { return bricard(kFar); }, kRk, 100, 3, 2e-12, 1e-8},
      Case{"bricard_em", [] { return bricard(); }, kEm, 10, 3, 2e-15, 2e-12, 1e-8, true},
      Case{"bricard_em", [] { return bricard(); }, kEm, 30, 3, 2e-15, 1e-11, 1e-8, true},
      Case{"bricard_em", [] { return bricard(); }, kEm, 100, 3, 2e-15, 2e-10, 1e-8, true},
      Case{"bricard_em", [] { return bricard(); }, kEm, 1000, 0.5, 2e-15, 7e-11, 1e-8, true},
      Case{"bennett_em", [] { return bennett(); }, kEm, 10, 3, 4e-16, 5e-15, 1e-8, true},
      Case{"bennett_em", [] { return bennett(); }, kEm, 30, 3, 4e-16, 3e-14, 1e-8, true},
      Case{"bennett_em", [] { return bennett(); }, kEm, 100, 3, 4e-16, 1e-14, 1e-8, true},
      Case{"bennett_rk_1e12", [] { return bennett(); }, kRk, 100, 3, 9e-16, 7e-14, 1e-12},
      Case{"ball_and_rod", [] { return ball_and_dependent_rod(); }, kAuto, 30, 3, 3e-13, 6e-11},
      Case{"ball_and_rod", [] { return ball_and_dependent_rod(); }, kAuto, 100, 3, 3e-13, 8e-12},
      Case{"ball_and_rod_10_m", [] { return ball_and_dependent_rod(kTen); }, kAuto, 100, 3, 3e-13,
           8e-12},
      Case{"ball_and_rod_1_km", [] { return ball_and_dependent_rod(kFar); }, kAuto, 100, 3, 9e-11,
           2e-10},
      Case{"door_em", [] { return door(); }, kEm, 100, 3, 5e-16, 0.0},
      Case{"door_with_knob", door_with_knob, kAuto, 100, 3, 5e-16, 0.0},
      Case{"door_with_knob_em", door_with_knob, kEm, 100, 3, 5e-16, 0.0},
      Case{"crane_boom", crane_boom, kAuto, 100, 3, 4e-16, 7e-12},
      Case{"hook_stiff", hook_stiff, kAuto, 100, 3, 2e-16, 7e-10}};
}

// Cases given with few digits: joints start off by up to 1e-6 m, and no motion removes that. Joints
// are held to the given digits (1e-7 m), and energy to rounding.
inline std::vector<Case> few_digits_cases() {
  return {Case{"door_7", [] { return rounded(door(), 7); }, kAuto, 100, 3, 1e-7, 1e-12},
          Case{"door_7_em", [] { return rounded(door(), 7); }, kEm, 100, 3, 1e-7, 1e-12},
          Case{"dome_7", [] { return rounded(dome(), 7); }, kAuto, 100, 1, 1e-7, 1e-12},
          Case{"bennett_10", [] { return rounded(bennett(), 10); }, kRk, 100, 3, 1e-9, 5e-8},
          Case{"bricard_10", [] { return rounded(bricard(), 10); }, kRk, 100, 3, 1e-10, 1e-8},
          Case{"bennett_7", [] { return rounded(bennett(), 7); }, kRk, 100, 3, 1e-6, 8e-5},
          Case{"bricard_7", [] { return rounded(bricard(), 7); }, kRk, 100, 3, 1e-7, 8e-5}};
}

inline World flat_at_rest() { return flat_four_bar_with_spring(); }
inline World flat_and_moving() { return flat_four_bar_with_spring(0.5); }

// Cases without permanently dependent rows: singular poses twice a turn, and loops through the
// world.
inline std::vector<Case> momentary_cases() {
  return {
      Case{"n_four_bar_40_em", [] { return n_four_bar(40); }, kEm, 10, 3, 1e-15, 6e-10, 1e-8, true},
      Case{"n_four_bar_40_em", [] { return n_four_bar(40); }, kEm, 100, 1, 1e-15, 1e-9, 1e-8, true},
      Case{"n_four_bar_2_em", [] { return n_four_bar(2); }, kEm, 1000, 3, 1e-15, 5e-10, 1e-8, true},
      Case{"n_four_bar_40_rk", [] { return n_four_bar(40); }, kRk, 1000, 1, 1e-15, 1.5e-7},
      Case{"n_four_bar_2_rk", [] { return n_four_bar(2); }, kRk, 1000, 3, 1e-15, 1.5e-7},
      Case{"bar_window_em", [] { return n_four_bar(1); }, kEm, 10, 3, 1e-15, 2e-12, 1e-8, true},
      Case{"bar_window_em", [] { return n_four_bar(1); }, kEm, 30, 3, 1e-15, 7e-12, 1e-8, true},
      Case{"windows_40_rk", [] { return problems::four_bar(40); }, kRk, 1000, 2, 1e-15, 2e-9},
      Case{"four_bar_1_em", [] { return problems::four_bar(1); }, kEm, 100, 3, 1e-15, 1e-9},
      Case{"four_bar_10_em", [] { return problems::four_bar(10); }, kEm, 100, 3, 1e-15, 1e-9},
      Case{"peaucellier_rk", peaucellier, kRk, 100, 4, 1e-15, 7e-6},
      Case{"peaucellier_em", peaucellier, kEm, 10, 4, 1e-15, 7e-12},
      Case{"peaucellier_em", peaucellier, kEm, 30, 4, 1e-15, 2e-11},
      Case{"peaucellier_em", peaucellier, kEm, 100, 4, 1e-15, 7e-10},
      Case{"peaucellier_em", peaucellier, kEm, 1000, 4, 1e-15, 2e-6},
      // starts at a bifurcation
      Case{"flat_with_spring_rk", flat_at_rest, kRk, 30, 3, 1e-15, 7e-9},
      Case{"flat_with_spring_rk", flat_at_rest, kRk, 100, 3, 1e-15, 7e-9},
      Case{"flat_with_spring_rk", flat_at_rest, kRk, 1000, 1, 1e-15, 7e-9},
      Case{"flat_with_spring_em", flat_at_rest, kEm, 10, 3, 1e-15, 7e-9},
      Case{"flat_with_spring_em", flat_at_rest, kEm, 30, 3, 1e-15, 7e-9},
      Case{"flat_with_spring_em", flat_at_rest, kEm, 100, 3, 1e-15, 7e-9},
      Case{"flat_with_spring_em", flat_at_rest, kEm, 1000, 1, 1e-15, 7e-9},
      Case{"flat_and_moving_rk", flat_and_moving, kRk, 100, 3, 1e-15, 7e-9},
      Case{"flat_and_moving_em", flat_and_moving, kEm, 100, 3, 1e-15, 7e-9},
      // A tick ends within 5e-6 m of the flat pose, where dropped rows are off by 3e-11 m.
      Case{"flat_bars_with_spring_rk", flat_bars_with_spring, kRk, 100, 3, 3e-12, 7e-9},
      Case{"flat_bars_with_spring_em", flat_bars_with_spring, kEm, 100, 3, 1e-15, 7e-9},
      Case{"window_with_spring_em", [] { return window_with_spring(1e3); }, kEm, 100, 3, 1e-15,
           1e-9, 1e-8, true},
      Case{"window_with_stiff_spring_em", [] { return window_with_spring(1e6); }, kEm, 100, 3,
           1e-15, 1e-9, 1e-8, true},
      Case{"cable_at_both_ends_em", [] { return cable_held_at_both_ends(50); }, kEm, 100, 1, 1e-15,
           1e-9, 1e-8, true},
      Case{"cable_at_both_ends_rk", [] { return cable_held_at_both_ends(50); }, kRk, 100, 1, 1e-15,
           1e-7}};
}

// A large net by energy_momentum: joints and energy hold in every tick.
// constraint_sim_redundancy_table prints run times.
inline std::vector<Case> large_cases() {
  return {Case{"net_2966_em", net_2966, kEm, 100, 0.02, 1e-15, 1e-9}};
}

// Large mass ratios, consistent joints: many substeps resolve the motion of the links. 4e-12 of the
// energy [J] is the prototype's figure.
inline std::vector<Case> ratio_cases() {
  return {Case{"tripod_1e8_rk", [] { return tripod(1e8); }, kRk, 100, 0.2, 2e-16,
               4e-12 * 1e8 * problems::kGravity},
          Case{"tripod_1e10_auto", [] { return tripod(1e10); }, kAuto, 100, 0.05, 2e-16,
               4e-12 * 1e10 * problems::kGravity}};
}

// Long runs for drift of redundant rows, which no projection corrects: 1e5 steps of 1/100 s, for
// the dome 6000 of 1/60 s. They take minutes; constraint_sim_redundancy_table runs them with
// --long.
inline std::vector<Case> long_cases() {
  return {Case{"bricard_stays", [] { return bricard(); }, kRk, 100, 1000, 5e-15, 4e-8},
          Case{"bricard_far_stays", [] { return bricard(kFar); }, kRk, 100, 1000, 2e-12, 4e-8},
          Case{"bennett_stays", [] { return bennett(); }, kRk, 100, 1000, 9e-16, 7e-14, 1e-12},
          Case{"door_stays", [] { return door(); }, kRk, 100, 1000, 6e-16, 0.0},
          Case{"ball_and_rod_stays", [] { return ball_and_dependent_rod(); }, kRk, 100, 1000, 3e-12,
               3e-12},
          Case{"dome_stays", [] { return dome(); }, kRk, 60, 100, 1e-11, 7e-13},
          Case{"n_four_bar_40_em", [] { return n_four_bar(40); }, kEm, 1000, 1, 1e-15, 5e-10, 1e-8,
               true}};
}

inline std::vector<Case> all_cases() {
  std::vector<Case> all;
  for (const auto& cases :
       {permanent_cases(), few_digits_cases(), momentary_cases(), large_cases(), ratio_cases()})
    all.insert(all.end(), cases.begin(), cases.end());
  return all;
}

}  // namespace constraint_sim::engine::redundant
