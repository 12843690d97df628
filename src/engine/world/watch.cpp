// What a step finds out about itself, after the last stage: errors that nothing closes, and energy
// that rises without a cause.

#include "engine/world/watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/islands/motion_bounds.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

namespace {

constexpr double kPatience = 0.5;     // [s] an error has to fall within, at least
constexpr int kPatienceTicks = 20;    // the same; Baumgarte's 0.1 leaves an eighth after these
constexpr double kFallenShare = 0.9;  // what an error that falls is below then
// Contacts at rest sink in by g h² for each of those that bear each other; overlaps have so long to
// be pushed out.
constexpr double kMostSunk = 4.0, kOverlapPatience = 0.1;  // [1], [s]
constexpr int kOverlapTicks = 10;
// Speed in g h, below which a body rests. Faster bodies slide and roll by what steps leave of their
// impacts, which is no creep up to kMostSlipShare.
constexpr double kMostResting = 4.0;  // [1]
// Slip while a contact sinks in, as a share of the depth that it sinks in by.
constexpr double kMostCrept = 0.0125;
// A rise beyond what rounding and tolerance explain: of the largest kinetic energy. Smooth methods
// keep 1e-9 of it, and no plot shows less.
constexpr double kRise = 1e-6;
constexpr double kFits = 1e-6;  // [m] beyond which an error left by an edit is closed
// Relative roundings of a step: of some ten operations on a body, and of sweeps over rows whose
// impulses exceed the motion they leave by the ratio of masses.
constexpr double kRounding = 16.0 * kEpsilon, kRoundingOfSweeps = 1e-11;

// what there was, plus what came, never below zero, from where the next rise counts
double gain_of(double before, double gain, double allowed) {
  return std::isfinite(gain) ? std::max(0.0, before + gain - allowed) : before;
}

/// How fast A slides on B where they touch, in the middle of their points [m/s].
Vector3d slip_of(const TouchingPair& pair, const BodyState& a, const BodyState& b) {
  Vector3d middle = Vector3d::Zero();
  for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k)
    middle += pair.manifold.points[k].position;
  middle /= pair.manifold.count;
  const Vector3d v = a.linear_velocity + a.angular_velocity.cross(middle - a.position) -
                     b.linear_velocity - b.angular_velocity.cross(middle - b.position);
  return v - v.dot(pair.manifold.normal) * pair.manifold.normal;
}

}  // namespace

// ---- errors that are not closed

// Looks at joints only while one is off by more than kUnclosedError or kUnclosedAngle.
void World::Impl::watch_joints() {
  watch.unclosed.clear();
  std::swap(watch.open, watch.open_before);
  watch.open.clear();
  const double h = options.time_step;
  const double patience = std::max({kPatience, options.closing_time, kPatienceTicks * h});
  double worst = 0.0;
  auto before = watch.open_before.begin();  // both lists are in the order of adding
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const JointState& state = joint_states[j];
    const double error = std::abs(state.error);
    const bool is_off = error > kUnclosedError || state.angle_error > kUnclosedAngle;
    if (!is_off || !acts(joints[j], state) || !is_rigid(joints[j])) continue;
    Watch::Open now{joint_ids[j], error, 0.0, state.closing ? state.closing_since : 0.0};
    while (before != watch.open_before.end() && before->id.value < now.id.value) ++before;
    const bool is_known = before != watch.open_before.end() && before->id == now.id;
    const bool closes_anew = is_known && state.closing && now.closing_since > before->closing_since;
    if (is_known && !closes_anew && error > kFallenShare * before->error) {
      now = *before;
      now.age += h;
    }
    watch.open.push_back(now);
    // that joints cannot be met, or rest as they are, is known before any time has passed
    const MethodReason why = islands[topology.island_of_joint(*this, j)].why;
    const bool stays = why == MethodReason::kInconsistent || why == MethodReason::kAtRest;
    // joints that impulses open beside contacts are reported in the first step already
    const bool is_opened = why == MethodReason::kManyContacts || why == MethodReason::kContact ||
                           why == MethodReason::kContactsGivenUp || why == MethodReason::kOverlap;
    if (now.age < patience && ((!stays && !is_opened) || state.closing)) continue;
    watch.unclosed.push_back(now.id);
    if (error <= worst) continue;
    worst = error;
    report.unclosed_joint = now.id;
  }
  report.unclosed_joints = static_cast<std::uint32_t>(watch.unclosed.size());
}

// ---- contacts that impulses hold, which have no estimate

void World::Impl::watch_contacts() {
  std::swap(watch.held, watch.held_before);
  watch.held.clear();
  const double h = options.time_step;
  const double sunk = kMostSunk * h * h * options.gravity.norm();
  const double resting = kMostResting * h * options.gravity.norm();
  const double patience = std::max(kOverlapPatience, kOverlapTicks * h);
  watch.has_moved.resize(bodies.size(), 0);
  auto before = watch.held_before.begin();  // both lists are in the order of places
  for (const TouchingPair& pair : touching) {
    for (const int body : {pair.a, pair.b}) {
      if (watch.has_moved[body] != 0) continue;
      const double thick = thickness(bodies[body].shape);
      const double radius = std::isfinite(thick) ? 0.5 * thick : 0.0;
      for (const List<BodyState>* all : {&rollback.states(), &std::as_const(states)})
        if ((*all)[body].linear_velocity.norm() > resting ||
            radius * (*all)[body].angular_velocity.norm() > resting)
          watch.has_moved[body] = 1;
    }
    const int island = std::max(topology.island_of(pair.a), topology.island_of(pair.b));
    if (pair.manifold.count == 0 || island < 0 || groups.contains(to_index(island))) continue;
    double deepest = 0.0;
    bool sticks = false;
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      deepest = std::max(deepest, pair.manifold.points[k].depth);
      sticks = sticks || pair.contact_states[k] == ContactState::kSticking;
    }
    if (deepest <= sunk && !sticks) continue;
    Watch::HeldPair now{pair.id_a, pair.id_b};
    const BodyId movable = is_movable(pair.a) ? pair.id_a : pair.id_b;
    const auto is_before = [&](const Watch::HeldPair& l) {
      return body_index[l.a.value] >= 0 && body_index[l.b.value] >= 0 &&
             std::pair(body_index[l.a.value], body_index[l.b.value]) < pair.ends();
    };
    while (
        before != watch.held_before.end() && !(before->a == now.a && before->b == now.b) &&
        (is_before(*before) || body_index[before->a.value] < 0 || body_index[before->b.value] < 0))
      ++before;
    const bool is_known =
        before != watch.held_before.end() && before->a == now.a && before->b == now.b;
    const double thinner =
        std::min(thickness(bodies[pair.a].shape), thickness(bodies[pair.b].shape));
    if (deepest > std::max(sunk, kMostOverlapShare * thinner)) {
      now.overlapping = h + (is_known ? before->overlapping : 0.0);
      if (now.overlapping >= patience && deepest > report.overlap) {
        report.overlap = deepest;
        report.overlap_body = movable;
      }
    }
    if (sticks) {
      if (is_known) now.slid = before->slid;
      now.slid += h * slip_of(pair, states[pair.a], states[pair.b]);
      const double slid = now.slid.norm();
      const bool has_moved = watch.has_moved[pair.a] != 0 || watch.has_moved[pair.b] != 0;
      const double most =
          std::max(thinner * (has_moved ? kMostSlipShare : kMostCreepShare), kMostCrept * sunk);
      if (slid > most && slid > report.creep) {
        report.creep = slid;
        report.creep_body = movable;
      }
    }
    watch.held.push_back(now);
  }
}

// ---- bodies that turn too fast for impulses

void World::Impl::watch_spin() {
  for (const int index : sleep.awake().islands) {
    Island& island = islands[index];
    if (island.method != Method::kSequentialImpulses) continue;
    island.unresolved_bodies = find_spinning(to_index(index), nullptr);
    report.unresolved_bodies += island.unresolved_bodies;
  }
}

// on joints, which a step takes along a line: by more than EnergyMomentum::kResolved in a step
std::uint32_t World::Impl::find_spinning(std::size_t i, List<std::size_t>* bodies) const {
  if (island_parts[i].members.joints.empty()) return 0;
  const double most = EnergyMomentum::kResolved / options.time_step;
  std::uint32_t count = 0;
  for (const int body : island_parts[i].members.bodies) {
    const double w = std::max(states[body].angular_velocity.squaredNorm(),
                              rollback.states()[body].angular_velocity.squaredNorm());
    if (!masses[body].can_turn() || w <= most * most) continue;
    ++count;
    if (bodies != nullptr) bodies->push_back(to_index(body));
  }
  return count;
}

// ---- energy

void World::Impl::begin_watch() {
  watch.steps = 0;
  watch.booked = watch.gain = watch.energy_rise = 0.0;
  watch.any_wrench_ended = watch.awake_changed = false;
  watch.has_moved.assign(bodies.size(), 0);
  for (std::size_t i = 0; i < islands.size(); ++i) {
    IslandParts& parts = island_parts[i];
    parts.energy = WatchedEnergy{};
    parts.energy.was_by_impulses = method_for(parts.nature, options) == Method::kSequentialImpulses;
    parts.energy.was_driven = is_driven(*this, *this, topology, island_parts[i].members, i);
    parts.has_limited_spring = false;
    for (const int index : parts.members.joints) {
      const Joint& joint = joints[index];
      if (is_rigid(joint))  // what does not fit is closed from the first step on
        parts.energy.was_driven |= std::abs(joint_states[index].error) > kFits;
      else
        parts.has_limited_spring |= joint.motor.max_force > 0.0;
    }
    look_at_island(i, nullptr);
  }
}

void World::Impl::watch_energy() {
  if (!carried.impulse_bodies.empty()) watch.booked += report.correction_work + report.driven_work;
  if (!carried.smooth.empty()) {
    report.correction_work += watch.integrated_corrections;
    report.driven_work += integrated_drives;
  }
  if (++watch.steps >= Watch::kWindow) look_at_energy();
  if (watch.energy_rise == 0.0) return;
  report.energy_rise = watch.energy_rise;
  report.energy_rise_body = watch.energy_rise_body;
}

// Of an island, since it was last looked at [J]. `allowed`: what rounding explains of it, and where
// a method has a tolerance the positions and velocities that it allows to be off.
double World::Impl::look_at_island(std::size_t i, double* allowed) {
  const IslandParts& parts = island_parts[i];
  const Energy now = energy(parts.members.bodies, parts.members.joints);
  WatchedEnergy& watched = island_parts[i].energy;
  watched.most_kinetic = std::max(watched.most_kinetic, now.kinetic);
  const double gain = now.kinetic + now.potential - watched.before - watched.corrections;
  watched.before = now.kinetic + now.potential;
  watched.corrections = 0.0;
  if (allowed == nullptr) return gain;

  double mass = 0.0, moment = 0.0;  // Σ m |x|
  for (const int body : parts.members.bodies) {
    const double m = 1.0 / masses[body].inverse_mass;
    mass += m;
    moment += m * states[body].position.lpNorm<1>();
  }
  const double g = options.gravity.norm(), h = options.time_step;
  const double size = now.kinetic + std::abs(now.potential);
  if (islands[i].method == Method::kSequentialImpulses) {
    *allowed = watch.steps * kRoundingOfSweeps * (size + g * moment);
    return gain;
  }
  const double rate = std::max(1u, islands[i].substeps) / h;
  const double speed = std::sqrt(2.0 * now.kinetic / mass) + options.tolerance;
  const double off = mass * options.tolerance * h + kRounding * moment;
  *allowed = watch.steps * (off * (g + speed * rate) + kRounding * size);
  return gain;
}

// Smooth islands one by one; those that impulses advance exchange energy where they touch, and what
// is done from outside is known of all of them together.
void World::Impl::look_at_energy() {
  double gain = -watch.booked, most_kinetic = 0.0;
  double allowed = watch.steps * kRoundingOfSweeps * std::abs(watch.booked);
  bool is_known = true;  // what is done from outside, on those that impulses advance
  const IslandParts* most = nullptr;
  watch.energy_rise = 0.0;
  for (std::size_t i = 0; i < islands.size(); ++i) {
    if (!watch.awake_changed && asleep[island_parts[i].members.bodies.front()]) continue;
    WatchedEnergy& watched = island_parts[i].energy;
    double allowed_here = 0.0;
    const double gain_here = look_at_island(i, &allowed_here);
    const bool was_driven = watched.was_driven || watch.any_wrench_ended;
    const bool was_by_impulses = watched.was_by_impulses;
    watched.was_driven = is_driven(*this, *this, topology, island_parts[i].members, i);
    watched.was_by_impulses = islands[i].method == Method::kSequentialImpulses;
    const bool any_driven = was_driven || watched.was_driven;
    const bool has_changed = watched.has_changed;
    watched.has_changed = false;
    if (!was_by_impulses && !watched.was_by_impulses && !has_changed) {
      if (any_driven) continue;
      watched.gain = gain_of(watched.gain, gain_here, allowed_here);
      tell_of_gain(island_parts[i], watched.gain, kRise * watched.most_kinetic + allowed_here);
      continue;
    }
    // the work of drives on what was integrated for a while is not known
    is_known = is_known && !island_parts[i].has_limited_spring &&
               !(any_driven && (has_changed || !was_by_impulses));
    gain += gain_here;
    allowed += allowed_here;
    most_kinetic += watched.most_kinetic;
    watched.gain = watched.was_by_impulses ? watched.gain + gain_here : 0.0;
    if (most == nullptr || watched.gain > most->energy.gain) most = &island_parts[i];
  }
  if (is_known && most != nullptr) {
    watch.gain = gain_of(watch.gain, gain, allowed);
    tell_of_gain(*most, watch.gain, kRise * most_kinetic + allowed);
  }
  watch.steps = 0;
  watch.booked = 0.0;
  watch.any_wrench_ended = watch.awake_changed = false;
}

void World::Impl::tell_of_gain(const IslandParts& parts, double gain, double allowed) {
  if (gain <= allowed || gain <= watch.energy_rise) return;
  watch.energy_rise = gain;
  watch.energy_rise_body = body_ids[parts.members.bodies.front()];
}

}  // namespace constraint_sim::engine
