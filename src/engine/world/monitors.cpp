#include "engine/world/monitors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/joint.h"
#include "engine/islands/method_choice.h"
#include "engine/islands/motion_bounds.h"
#include "engine/islands/unresolved_bodies.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// A joint is unclosed when its error stays above kFallenShare of an earlier value for the longest
// of kPatience [s], closing_time and kPatienceTicks steps. Baumgarte's factor 0.1 leaves an eighth
// of an error after 20 steps.
constexpr double kPatience = 0.5;
constexpr int kPatienceTicks = 20;
constexpr double kFallenShare = 0.9;
constexpr double kLeastUnclosed = 1e-8;  // [m] joints with less error are not looked at
// Contacts at rest sink in by g h² for each contact of a stack. Overlaps are pushed out within
// kOverlapPatience.
constexpr double kMostSunk = 4.0, kOverlapPatience = 0.1;  // [1], [s]
constexpr int kOverlapTicks = 10;
// Speed of a body at rest, at most, as a multiple of g h: impulses leave speeds of g h in contacts.
// A faster body has moved: errors of its impacts make sticking contacts slip, which is reported as
// creep only beyond kMostSlipShare in place of kMostCreepShare.
constexpr double kMostResting = 4.0;  // [1]
// Slip while a contact sinks in, as a share of the depth that it sinks in by.
constexpr double kMostCrept = 0.0125;
// Reported rise of energy beyond rounding and tolerance, as a share of the largest kinetic energy.
// Smooth methods stay within 1e-9, and no plot shows less than 1e-6.
constexpr double kRise = 1e-6;
// Relative roundings of a step: kRoundingOfBodies for some ten operations on a body,
// kRoundingOfSweeps for sweeps over rows, whose impulses exceed the resulting motion by the ratio
// of masses.
constexpr double kRoundingOfBodies = 16.0 * kEpsilon, kRoundingOfSweeps = 1e-11;

/// Adds a gain to a rise, which never falls below zero: the next rise counts from there.
double gain_of(double before, double gain, double allowed) {
  return std::isfinite(gain) ? std::max(0.0, before + gain - allowed) : before;
}

/// Returns the tangential velocity of A relative to B at the mean of their sticking points, in
/// world [m/s]. Takes the final velocities with the positions at the start, in which a ball rolls
/// without slip, and at the end, since the velocity of a body with unequal moments of inertia turns
/// within the step. Returns the slower of both.
Vector3d slip_of(const TouchingPair& pair, const List<BodyState>& before,
                 const List<BodyState>& after) {
  Vector3d middle = Vector3d::Zero();
  int sticking = 0;
  for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k) {
    if (pair.contact_states[k] != ContactState::kSticking) continue;
    middle += pair.manifold.points[k].position;
    ++sticking;
  }
  middle /= sticking;
  const auto slip = [&](const List<BodyState>& where) -> Vector3d {
    const BodyState &a = after[pair.a], &b = after[pair.b];
    const Vector3d v =
        a.linear_velocity + a.angular_velocity.cross(middle - where[pair.a].position) -
        b.linear_velocity - b.angular_velocity.cross(middle - where[pair.b].position);
    return v - v.dot(pair.manifold.normal) * pair.manifold.normal;
  };
  const Vector3d at_start = slip(before), at_end = slip(after);
  return at_start.squaredNorm() < at_end.squaredNorm() ? at_start : at_end;
}

/// Error above which a joint is reported as unclosed [m]: less where a shape is small.
double unclosed_error(const MonitorInput& in, std::size_t j) {
  const auto [a, b] = in.topology.ends(j);
  const double size =
      std::min(size_of(in.model.bodies[a].shape), size_of(in.model.bodies[b].shape));
  return kUnclosedError * std::min(1.0, size / kSmallShape);
}

/// Writes the joints with the largest errors to `worst`. Returns whether the angle error of any
/// joint exceeds kUnclosedAngle.
bool find_worst_joint(const Model& model, const State& state, const List<int>& among,
                      StepReport* worst) {
  bool is_any_askew = false;
  for (const int j : among) {
    is_any_askew |= state.joint_states[j].angle_error > kUnclosedAngle;
    const double error = std::abs(state.joint_states[j].error);
    if (!acts(model.joints[j], state.joint_states[j]) || !is_rigid(model.joints[j])) continue;
    const bool is_closing = state.joint_states[j].closing;
    double& largest = is_closing ? worst->joints.closing_error : worst->joints.max_error;
    std::optional<JointId>& joint = is_closing ? worst->joints.worst_closing : worst->joints.worst;
    if (joint && error <= largest) continue;
    largest = error;
    joint = model.joint_ids[j];
  }
  return is_any_askew;
}

}  // namespace

void Monitors::set_resting(const Model& model, const State& state, const RestingSets& resting,
                           const IslandLists& lists) {
  awake_changed_ = true;
  resting_report_ = StepReport{};
  for (std::size_t i = 0; i < lists.islands.size(); ++i) {
    if (!state.asleep[lists.island_parts[i].members.bodies.front()]) continue;
    ++resting_report_.costs.asleep;
    resting_report_.joints.dependent_rows =
        std::max(resting_report_.joints.dependent_rows, lists.islands[i].dependent_rows);
  }
  for (const TouchingPair& pair : state.resting)
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k)
      resting_report_.contacts.max_penetration =
          std::max(resting_report_.contacts.max_penetration, pair.manifold.points[k].depth);
  find_worst_joint(model, state, resting.joints, &resting_report_);
  resting_energy_ = energy_of(model, state, resting.bodies, resting.joints);
}

void Monitors::measure(const MonitorInput& in, IslandLists* lists, StepReport* report) {
  report->costs.asleep = resting_report_.costs.asleep;
  report->joints.dependent_rows =
      std::max(report->joints.dependent_rows, resting_report_.joints.dependent_rows);
  report->contacts.max_penetration =
      std::max(report->contacts.max_penetration, resting_report_.contacts.max_penetration);
  report->joints.max_error = resting_report_.joints.max_error;
  report->joints.worst = resting_report_.joints.worst;
  report->joints.closing_error = resting_report_.joints.closing_error;
  report->joints.worst_closing = resting_report_.joints.worst_closing;
  const bool is_any_askew = find_worst_joint(in.model, in.state, in.awake.joints, report);
  const Energy now = energy_of(in.model, in.state, in.awake.bodies, in.awake.joints);
  largest_kinetic_energy_ = std::max(largest_kinetic_energy_, now.kinetic);
  report->energy.total = now.kinetic + now.potential + resting_energy_.potential;
  if (largest_kinetic_energy_ > 0.0) {
    constexpr double kLargest = std::numeric_limits<double>::max();
    const double drift = (report->energy.total - reference_energy_) / largest_kinetic_energy_;
    report->energy.drift = std::clamp(drift, -kLargest, kLargest);  // the divisor may be denormal
  }
  if (report->outcome.failed || report->outcome.stopped) return;
  if (is_any_askew ||
      std::max(report->joints.max_error, report->joints.closing_error) > kLeastUnclosed ||
      !open_.empty())
    watch_joints(in, *lists, report);
  if (!in.partition.impulse_joints.empty())
    for (const int i : in.awake.islands) {
      Island& island = lists->islands[i];
      if (!uses_impulses(island.method)) continue;
      island.unresolved_bodies =
          find_spinning(in.model, in.state, in.rollback, lists->island_parts[i].members, nullptr);
      report->unresolved_bodies += island.unresolved_bodies;
    }
  if (!in.state.touching.empty() || !held_.empty()) watch_contacts(in, report);
  watch_energy(in, lists, report);
}

void Monitors::begin(const Model& model, const State& state, const Topology& topology,
                     IslandLists* lists) {
  const Energy now = energy_of(model, state);
  largest_kinetic_energy_ = now.kinetic;
  reference_energy_ = now.kinetic + now.potential;
  steps_ = 0;
  impulse_work_ = gain_ = energy_rise_ = 0.0;
  has_wrench_ended_ = awake_changed_ = false;
  has_moved_.assign(model.bodies.size(), 0);
  for (std::size_t i = 0; i < lists->islands.size(); ++i) {
    IslandParts& parts = lists->island_parts[i];
    parts.energy = WatchedEnergy{};
    parts.energy.was_by_impulses = uses_impulses(method_for(parts.nature, model.options));
    parts.energy.was_driven = is_driven(model, state, topology, parts.members, i);
    parts.has_limited_spring = false;
    for (const int index : parts.members.joints) {
      const Joint& joint = model.joints[index];
      if (is_rigid(joint))  // a rigid joint closes its error from the first step on
        parts.energy.was_driven |= std::abs(state.joint_states[index].error) > kClosedError;
      else
        parts.has_limited_spring |= joint.motor.max_force > 0.0;
    }
    compare_island(model, state, lists->islands[i], nullptr, &parts);
  }
}

// Adds up the work of a valid step: a step that failed or was stopped has moved nothing.
void Monitors::watch_energy(const MonitorInput& in, IslandLists* lists, StepReport* report) {
  if (!in.partition.impulse_bodies.empty())
    impulse_work_ += report->energy.correction_work + report->energy.driven_work;
  if (!in.partition.integrated.empty()) {
    double corrections = 0.0, drives = 0.0;  // work on integrated islands [J]
    const bool has_groups = !in.groups.is_empty();
    for (const int i : in.partition.integrated) {
      IslandParts& parts = lists->island_parts[i];
      const double driven = has_groups ? in.groups.driven_work_of(to_index(i)) : 0.0;
      corrections += parts.correction_work;
      drives += driven;
      parts.energy.corrections += parts.correction_work + driven;
    }
    report->energy.correction_work += corrections;
    report->energy.driven_work += drives;
  }
  if (++steps_ >= kWindow) compare_energies(in, lists);
  if (energy_rise_ == 0.0) return;
  report->energy.rise = energy_rise_;
  report->energy.rise_body = energy_rise_body_;
}

// Returns the gain of energy of an island since the last comparison [J], and begins the next
// comparison. `allowed`: gain by rounding, and by errors of position and velocity within the
// tolerance of the method [J]; null: not needed.
double Monitors::compare_island(const Model& model, const State& state, const Island& island,
                                double* allowed, IslandParts* parts) const {
  const Energy now = energy_of(model, state, parts->members.bodies, parts->members.joints);
  WatchedEnergy& watched = parts->energy;
  watched.most_kinetic = std::max(watched.most_kinetic, now.kinetic);
  const double gain = now.kinetic + now.potential - watched.before - watched.corrections;
  watched.before = now.kinetic + now.potential;
  watched.corrections = 0.0;
  if (allowed == nullptr) return gain;

  double mass = 0.0, moment = 0.0;  // Σ m |x|
  for (const int body : parts->members.bodies) {
    const double m = 1.0 / model.masses[body].inverse_mass;
    mass += m;
    moment += m * state.states[body].position.lpNorm<1>();
  }
  const double g = model.options.gravity.norm(), h = model.options.time_step;
  const double size = now.kinetic + std::abs(now.potential);
  if (uses_impulses(island.method)) {
    *allowed = steps_ * kRoundingOfSweeps * (size + g * moment);
    return gain;
  }
  const double rate = std::max(1u, island.substeps) / h;
  const double speed = std::sqrt(2.0 * now.kinetic / mass) + model.options.tolerance;
  const double off = mass * model.options.tolerance * h + kRoundingOfBodies * moment;
  *allowed = steps_ * (off * (g + speed * rate) + kRoundingOfBodies * size);
  return gain;
}

// Compares integrated islands one by one, and all islands that impulses advance as one sum: these
// islands exchange energy in contacts, and only the sum of the work on them is known.
void Monitors::compare_energies(const MonitorInput& in, IslandLists* lists) {
  const Model& model = in.model;
  const State& state = in.state;
  double gain = -impulse_work_, most_kinetic = 0.0;
  double allowed = steps_ * kRoundingOfSweeps * std::abs(impulse_work_);
  bool is_known = true;  // whether the work on islands that impulses advance is known
  const IslandParts* most = nullptr;
  energy_rise_ = 0.0;
  for (std::size_t i = 0; i < lists->islands.size(); ++i) {
    IslandParts& parts = lists->island_parts[i];
    if (!awake_changed_ && state.asleep[parts.members.bodies.front()]) continue;
    WatchedEnergy& watched = parts.energy;
    double allowed_here = 0.0;
    const double gain_here = compare_island(model, state, lists->islands[i], &allowed_here, &parts);
    const bool was_driven = watched.was_driven || has_wrench_ended_;
    const bool was_by_impulses = watched.was_by_impulses;
    watched.was_driven = is_driven(model, state, in.topology, parts.members, i);
    watched.was_by_impulses = uses_impulses(lists->islands[i].method);
    const bool any_driven = was_driven || watched.was_driven;
    const bool has_changed = std::exchange(watched.has_changed, false);
    if (!was_by_impulses && !watched.was_by_impulses && !has_changed) {
      if (any_driven) continue;
      watched.gain = gain_of(watched.gain, gain_here, allowed_here);
      note_rise(model, parts, watched.gain, kRise * watched.most_kinetic + allowed_here);
      continue;
    }
    // The work of drives on islands that were integrated in a part of the window is unknown.
    is_known =
        is_known && !parts.has_limited_spring && !(any_driven && (has_changed || !was_by_impulses));
    gain += gain_here;
    allowed += allowed_here;
    most_kinetic += watched.most_kinetic;
    watched.gain = watched.was_by_impulses ? watched.gain + gain_here : 0.0;
    if (most == nullptr || watched.gain > most->energy.gain) most = &parts;
  }
  if (is_known && most != nullptr) {
    gain_ = gain_of(gain_, gain, allowed);
    note_rise(model, *most, gain_, kRise * most_kinetic + allowed);
  }
  steps_ = 0;
  impulse_work_ = 0.0;
  has_wrench_ended_ = awake_changed_ = false;
}

void Monitors::note_rise(const Model& model, const IslandParts& parts, double gain,
                         double allowed) {
  if (gain <= allowed || gain <= energy_rise_) return;
  energy_rise_ = gain;
  energy_rise_body_ = model.body_ids[parts.members.bodies.front()];
}

// Lists the joints whose errors nothing closes. Called only while the error of a joint exceeds
// kLeastUnclosed or kUnclosedAngle.
void Monitors::watch_joints(const MonitorInput& in, const IslandLists& lists, StepReport* report) {
  const Model& model = in.model;
  const State& state = in.state;
  unclosed_.clear();
  std::swap(open_, open_before_);
  open_.clear();
  const double h = model.options.time_step;
  const double patience = std::max({kPatience, model.options.closing_time, kPatienceTicks * h});
  double worst = 0.0;
  auto before = open_before_.begin();  // both lists are in the order of adding
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    const JointData& joint_state = state.joint_states[j];
    const double error = std::abs(joint_state.error);
    const bool is_off = error > unclosed_error(in, j) || joint_state.angle_error > kUnclosedAngle;
    if (!is_off || !acts(model.joints[j], joint_state) || !is_rigid(model.joints[j])) continue;
    UnclosedJoint now{model.joint_ids[j], error, 0.0, 0.0};
    if (joint_state.closing)
      visit_starts(joint_state.to_close,
                   [&](double since) { now.closing_since = std::max(now.closing_since, since); });
    while (before != open_before_.end() && before->id.value < now.id.value) ++before;
    const bool is_known = before != open_before_.end() && before->id == now.id;
    if (is_known && error > kFallenShare * before->error &&
        !(joint_state.closing && now.closing_since > before->closing_since)) {
      now = *before;
      now.age += h;
    }
    open_.push_back(now);
    // Errors of joints in inconsistent or sleeping islands stay: listed at once, unless closing.
    const MethodReason why = lists.islands[in.topology.island_of_joint(model, j)].why;
    const bool stays = why == MethodReason::kInconsistent || why == MethodReason::kAtRest;
    // Joints that impulses open, beside contacts or after a failed integration: listed at once.
    const bool is_opened = why == MethodReason::kManyContacts || why == MethodReason::kContact ||
                           why == MethodReason::kContactsGivenUp || why == MethodReason::kOverlap ||
                           why == MethodReason::kRefused;
    if (now.age < patience && ((!stays && !is_opened) || joint_state.closing)) continue;
    unclosed_.push_back(now.id);
    if (error > worst) report->joints.worst_unclosed = now.id;
    worst = std::max(worst, error);
  }
  report->joints.unclosed = static_cast<std::uint32_t>(unclosed_.size());
}

// Finds contacts by impulses that overlap or creep, which error estimates of steps do not name.
void Monitors::watch_contacts(const MonitorInput& in, StepReport* report) {
  const Model& model = in.model;
  const State& state = in.state;
  std::swap(held_, held_before_);
  held_.clear();
  const double h = model.options.time_step;
  const double sunk = kMostSunk * h * h * model.options.gravity.norm();
  const double slow = kMostResting * h * model.options.gravity.norm();
  const double patience = std::max(kOverlapPatience, kOverlapTicks * h);
  has_moved_.resize(model.bodies.size(), 0);
  auto before = held_before_.begin();  // both lists are in the order of ids and parts
  for (const TouchingPair& pair : state.touching) {
    for (const int body : {pair.a, pair.b}) {
      if (has_moved_[body] != 0) continue;
      const double thick = thickness(model.bodies[body].shape);
      const double radius = std::isfinite(thick) ? 0.5 * thick : 0.0;
      for (const List<BodyState>* all : {&in.rollback.states(), &state.states})
        if ((*all)[body].linear_velocity.norm() > slow ||
            radius * (*all)[body].angular_velocity.norm() > slow)
          has_moved_[body] = 1;
    }
    const int island = std::max(in.topology.island_of(pair.a), in.topology.island_of(pair.b));
    if (pair.manifold.count == 0 || island < 0 || in.groups.contains(to_index(island))) continue;
    double deepest = 0.0;
    bool sticks = false;
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      deepest = std::max(deepest, pair.manifold.points[k].depth);
      sticks = sticks || pair.contact_states[k] == ContactState::kSticking;
    }
    if (deepest <= sunk && !sticks) continue;
    HeldPair now{pair.id_a, pair.id_b, pair.part_a, pair.part_b};
    const auto place_of = [](const HeldPair& held) {
      return std::tuple(held.a, held.b, held.part_a, held.part_b);
    };
    const BodyId movable = model.is_movable(pair.a) ? pair.id_a : pair.id_b;
    while (before != held_before_.end() && place_of(*before) < place_of(now)) ++before;
    const bool is_known = before != held_before_.end() && place_of(*before) == place_of(now);
    const double thinner = thinner_of(model, pair.shapes());
    if (deepest > std::max(sunk, kMostOverlapShare * thinner)) {
      now.overlapping = h + (is_known ? before->overlapping : 0.0);
      const bool is_reported =
          now.overlapping >= patience || deepest > std::max(sunk, kDeepOverlapShare * thinner);
      if (is_reported && deepest > report->contacts.overlap) {
        report->contacts.overlap = deepest;
        report->contacts.overlap_body = movable;
      }
    }
    if (sticks) {
      if (is_known) now.slid = before->slid;
      now.slid += h * slip_of(pair, in.rollback.states(), state.states);
      const double slid = now.slid.norm();
      const bool has_moved = has_moved_[pair.a] != 0 || has_moved_[pair.b] != 0;
      const double most =
          std::max(thinner * (has_moved ? kMostSlipShare : kMostCreepShare), kMostCrept * sunk);
      if (slid > most && slid > report->contacts.creep) {
        report->contacts.creep = slid;
        report->contacts.creep_body = movable;
      }
    }
    held_.push_back(now);
  }
}

}  // namespace constraint_sim::engine
