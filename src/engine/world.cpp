#include "constraint_sim/engine/world.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint.h"
#include "engine/narrowphase.h"
#include "engine/validate.h"
#include "engine/world_impl.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

namespace {

/// Ends a step within.
struct StepFailed {
  Failure why;
};

void add(const ImpulseReport& impulses, StepReport* report) {
  report->rows += impulses.rows;
  report->contacts = impulses.contacts;
  report->max_penetration = impulses.max_penetration;
  report->iterations += impulses.iterations;
  report->solver_residual = impulses.solver_residual;
  report->driven_work = impulses.driven_work;
  report->correction_work = impulses.correction_work;
  for (std::size_t i = 0; i < kStageCount; ++i) report->stage_times[i] += impulses.stage_times[i];
}

}  // namespace

// a whole physics engine in six steps, as the tutorial has it
const StepReport& World::step() {
  Impl& world = *impl_;
  try {
    world.begin_step();
    world.find_pairs();                                       // 1. broadphase: fast and approximate
    world.find_contacts();                                    // 2. narrowphase: accurate but slow
    if (world.any_corrections) world.take_out_corrections();  // what closed errors a step ago
    world.choose_methods();       //    smooth islands part here from the tutorial:
    world.integrate();            //    all the way in one, to a tolerance; the others go on with
    world.advance_by_impulses();  // 3. to 6. rows, velocities, solve, positions
    world.advance_kinematic_bodies();
    world.finish_step();
  } catch (const StepFailed& failed) {
    world.keep_state_before(failed.why);
  } catch (...) {
    world.abandon_step();
    throw;
  }
  world.measure();
  return world.report;
}

void World::Impl::fail(Failure why) { throw StepFailed{why}; }

// where what the system threw may have left anything half done: as after an edit
void World::Impl::abandon_step() {
  if (is_remembered) go_back();
  forget_contacts();
  topology_edited = true;
  edit_all();
  report = StepReport{};
  report.failed = true;
  report.step = step_count;
  report.time = time();
}

void World::Impl::begin_step() {
  is_remembered = false;
  if (edited)
    recompile();
  else if (any_waking)
    spread_waking();
  remember();
  step_start = time();
  step_end = time_of(step_count + 1);
  report = StepReport{};
  contacts_are_new = false;
  if (!has_next_tick(step_start, options.time_step)) fail(Failure::kNoNextTick);
}

// for a step that fails
void World::Impl::remember() {
  for (const int i : awake_bodies)
    states_before[static_cast<std::size_t>(i)] = states[static_cast<std::size_t>(i)];
  for (const int j : awake_joints)
    joint_states_before[static_cast<std::size_t>(j)] = joint_states[static_cast<std::size_t>(j)];
  for (const int i : awake_islands)
    memory_before[static_cast<std::size_t>(i)] = island_parts[static_cast<std::size_t>(i)];
  is_remembered = true;
  had_corrections = any_corrections;
  if (had_corrections) corrections_before = corrections;
}

void World::Impl::go_back() {
  for (const int i : awake_bodies)
    states[static_cast<std::size_t>(i)] = states_before[static_cast<std::size_t>(i)];
  for (const int j : awake_joints)
    joint_states[static_cast<std::size_t>(j)] = joint_states_before[static_cast<std::size_t>(j)];
  for (const int i : awake_islands)
    static_cast<IslandMemory&>(island_parts[static_cast<std::size_t>(i)]) =
        memory_before[static_cast<std::size_t>(i)];
  if (contacts_are_new) std::swap(touching, touching_before);
  if (had_corrections)
    corrections = corrections_before;
  else if (any_corrections)
    for (Twist& correction : corrections) correction.setZero();
  any_corrections = had_corrections;
}

void World::Impl::find_pairs() {
  if (moving_shapes.empty()) return;
  const StageTimer timer(clock, Stage::kBroadphase, &report.stage_times);
  proxies.clear();
  for (const int body : moving_shapes) proxies.push_back(proxy(body));
  report.candidate_pairs = static_cast<std::uint32_t>(broadphase.find_pairs(proxies).size());
  report.broadphase_tests = broadphase.tests();
  if (broadphase.is_full()) fail(Failure::kTooManyPairs);
}

Proxy World::Impl::proxy(int body) const {
  const auto i = static_cast<std::size_t>(body);
  return {bounds(bodies[i].shape, states[i]), body, is_movable(i)};
}

void World::Impl::find_contacts() {
  collide_pairs();
  while (wake_touched()) {
    std::swap(touching, touching_before);  // back to the contacts of the step before
    contacts_are_new = false;
    spread_waking();
    remember();
    find_pairs();
    collide_pairs();
  }
}

void World::Impl::collide_pairs() {
  std::swap(touching, touching_before);
  contacts_are_new = true;
  touching.clear();
  if (moving_shapes.empty()) return;
  const StageTimer timer(clock, Stage::kNarrowphase, &report.stage_times);
  std::size_t points = 0;
  auto before = touching_before.begin();  // both lists are sorted, so one pass matches them
  for (const Broadphase::Pair& ends : broadphase.pairs()) {
    if (std::binary_search(unpaired.begin(), unpaired.end(), ends)) continue;
    if (is_set(stop)) return;
    const auto a = static_cast<std::size_t>(ends.first);
    const auto b = static_cast<std::size_t>(ends.second);
    const Manifold manifold = collide(bodies[a].shape, states[a], bodies[b].shape, states[b]);
    if (manifold.count == 0) continue;
    points += static_cast<std::size_t>(manifold.count);
    if (points > kMostContacts) fail(Failure::kTooManyContacts);

    TouchingPair& pair = touching.emplace_back();
    pair.a = ends.first;
    pair.b = ends.second;
    pair.id_a = body_ids[a];
    pair.id_b = body_ids[b];
    pair.manifold = manifold;
    while (before != touching_before.end() && before->ends() < ends) ++before;
    const bool known =
        options.warm_starting && before != touching_before.end() && before->ends() == ends;
    for (std::size_t k = 0; k < static_cast<std::size_t>(manifold.count); ++k)
      pair.impulses[k] =
          known ? before->impulse_of(manifold.points[k].feature) : Vector3d(Vector3d::Zero());
  }
}

Vector3d TouchingPair::impulse_of(std::uint32_t feature) const {
  for (std::size_t k = 0; k < static_cast<std::size_t>(manifold.count); ++k)
    if (manifold.points[k].feature == feature) return impulses[k];
  return Vector3d::Zero();
}

void World::Impl::take_out_corrections() {
  for (const int index : awake_bodies) {
    const auto i = static_cast<std::size_t>(index);
    states[i].linear_velocity -= corrections[i].head<3>();
    states[i].angular_velocity -= corrections[i].tail<3>();
    corrections[i].setZero();
  }
  any_corrections = false;
}

// those that act in this step on bodies that impulses carry: how long
void World::Impl::find_acting_wrenches() {
  for (const Wrench& wrench : wrenches) {
    const bool acts_throughout = wrench.start <= step_start && wrench.end >= step_end;
    const double duration =
        acts_throughout ? options.time_step
                        : std::min(wrench.end, step_end) - std::max(wrench.start, step_start);
    if (duration <= 0.0) continue;  // not yet
    const std::size_t i = index(wrench.body);
    if (islands[static_cast<std::size_t>(island_of[i])].method == Method::kSequentialImpulses)
      acting_wrenches.push_back({i, duration, wrench.force, wrench.torque});
  }
}

void World::Impl::advance_by_impulses() {
  if (impulse_bodies.empty()) return;
  acting_wrenches.clear();
  if (!wrenches.empty()) find_acting_wrenches();
  add(sequential_impulses.advance(*this, impulse_step(), this), &report);
}

void World::Impl::finish_impulses() {
  if (impulse_bodies.empty()) return;
  report.correction_work += sequential_impulses.finish(*this, impulse_step(), this);
  for (const int j : impulse_joints) note_if_torn(static_cast<std::size_t>(j));
}

ImpulseStep World::Impl::impulse_step() const {
  return {joint_step(), impulse_bodies,  impulse_joints, joint_ends,
          is_in_loop,   acting_wrenches, stop,           clock};
}

void World::Impl::advance_kinematic_bodies() {
  if (kinematic.empty()) return;
  const StageTimer timer(clock, Stage::kPositions, &report.stage_times);
  advance_kinematic(kinematic, options.time_step, states);
}

void World::Impl::finish_step() {
  if (is_set(stop)) {
    keep_state_before(Failure::kNone);
    report.failed = false;
    report.stopped = true;
    return;
  }
  const Failure failure = failure_of_motion();
  if (failure != Failure::kNone) fail(failure);
  finish_impulses();
  if (!motions.empty()) read_smooth_joints(joint_step());
  tell_contacts();
  if (!tells_finite_numbers()) fail(Failure::kNotFinite);
  ++step_count;
  drop_spent_wrenches();
  fall_asleep();
  for (const int i : fresh_islands) island_parts[static_cast<std::size_t>(i)].is_fresh = false;
  fresh_islands.clear();
  if (!impulse_bodies.empty()) sequential_impulses.keep_self_stress(&self_stress);
  report.step = step_count;
  report.time = step_end;
}

void World::Impl::keep_state_before(Failure why) {
  go_back();
  for (IslandMotion& motion : motions) motion.forget();
  begin_all_anew();
  contacts.resize(resting_contacts);
  report.failed = true;
  report.failure = why;
  report.step = step_count;
  report.time = step_start;
}

// One sum tells that all is well, two numbers at a time; only where it does not are bodies looked
// at one by one.
Failure World::Impl::failure_of_motion() {
  Eigen::Array2d squares(0.0, 0.0);
  double others = 0.0;
  for (const int i : awake_bodies) {
    const BodyState& state = states[static_cast<std::size_t>(i)];
    const Eigen::Vector3d& x = state.position;
    const Eigen::Vector3d& v = state.linear_velocity;
    const Eigen::Vector3d& w = state.angular_velocity;
    const Eigen::Vector4d& q = state.orientation.coeffs();
    squares += x.head<2>().array().square() + v.head<2>().array().square() +
               w.head<2>().array().square() + q.head<2>().array().square() +
               q.tail<2>().array().square();
    others += x[2] * x[2] + v[2] * v[2] + w[2] * w[2];
  }
  if (squares.sum() + others <= kMostMagnitude * kMostMagnitude) return Failure::kNone;
  for (const int i : awake_bodies) {
    const BodyState& state = states[static_cast<std::size_t>(i)];
    Eigen::Matrix<double, 13, 1> numbers;
    numbers << state.position, state.linear_velocity, state.angular_velocity,
        state.orientation.coeffs();
    const bool is_finite = numbers.allFinite();
    if (is_finite && numbers.lpNorm<Eigen::Infinity>() <= kMostMagnitude) continue;
    report.failed_body = body_ids[static_cast<std::size_t>(i)];
    return is_finite ? Failure::kOutOfRange : Failure::kNotFinite;
  }
  return Failure::kNone;
}

// sums that a single NaN or infinity spoils
bool World::Impl::tells_finite_numbers() const {
  double sum = 0.0;
  for (const int j : awake_joints) {
    const JointState& state = joint_states[static_cast<std::size_t>(j)];
    sum += state.error + state.error_rate + state.force + state.bias + state.reached_rate +
           state.travel;
  }
  for (std::size_t i = resting_contacts; i < contacts.size(); ++i)
    sum += contacts[i].normal_force + contacts[i].depth;
  return std::isfinite(sum);
}

void World::Impl::note_if_torn(std::size_t j) {
  if (!joint_states[j].broken) return;
  topology_edited = true;
  edit_island_of(joints[j].body_a);
  edit_island_of(joints[j].body_b);
  ++report.torn_joints;
}

void World::Impl::tell_contacts() {
  contacts.resize(resting_contacts);
  for (const TouchingPair& pair : touching) add_contacts(pair);
}

void World::Impl::add_contacts(const TouchingPair& pair) {
  for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k) {
    const Manifold::Point& point = pair.manifold.points[k];
    const double force = pair.impulses[k].dot(pair.manifold.normal) / options.time_step;
    contacts.push_back(
        {pair.id_a, pair.id_b, point.position, pair.manifold.normal, point.depth, force});
  }
}

void World::Impl::drop_spent_wrenches() {
  if (wrenches.empty()) return;
  const auto is_spent = [this](const Wrench& wrench) {
    return wrench.end <= std::max(step_end, wrench.start);
  };
  const auto spent = std::remove_if(wrenches.begin(), wrenches.end(), is_spent);
  if (spent == wrenches.end()) return;
  wrenches.erase(spent, wrenches.end());
  watch.any_wrench_ended = true;
}

void World::Impl::measure() {
  report.asleep = resting_report.asleep;
  report.dependent_rows = std::max(report.dependent_rows, resting_report.dependent_rows);
  report.max_penetration = std::max(report.max_penetration, resting_report.max_penetration);
  report.max_constraint_error = resting_report.max_constraint_error;
  report.worst_joint = resting_report.worst_joint;
  find_worst_joint(awake_joints, &report);
  const Energy now = energy(awake_bodies, awake_joints);
  largest_kinetic_energy = std::max(largest_kinetic_energy, now.kinetic);
  report.energy = now.kinetic + now.potential + resting_energy.potential;
  if (largest_kinetic_energy > 0.0) {
    constexpr double kMost = std::numeric_limits<double>::max();
    const double drift = (report.energy - reference_energy) / largest_kinetic_energy;
    report.energy_drift = std::clamp(drift, -kMost, kMost);  // what moves least may divide by least
  }
  if (report.failed || report.stopped) return;
  bool any_askew = false;
  for (const int j : awake_joints)
    any_askew |= joint_states[static_cast<std::size_t>(j)].angle_error > kUnclosedAngle;
  if (any_askew || report.max_constraint_error > kUnclosedError || !watch.open.empty())
    watch_joints();
  if (!impulse_joints.empty()) watch_spin();
  watch_energy();
}

void World::Impl::find_worst_joint(const std::vector<int>& among, StepReport* worst) const {
  for (const int index : among) {
    const auto j = static_cast<std::size_t>(index);
    const double error = std::abs(joint_states[j].error);
    if (joint_states[j].broken || !is_rigid(joints[j])) continue;
    if (worst->worst_joint && error <= worst->max_constraint_error) continue;
    worst->max_constraint_error = error;
    worst->worst_joint = joint_ids[j];
  }
}

Energy World::Impl::energy() const {
  std::vector<int> all_bodies(bodies.size());
  std::vector<int> all_joints(joints.size());
  std::iota(all_bodies.begin(), all_bodies.end(), 0);
  std::iota(all_joints.begin(), all_joints.end(), 0);
  return energy(all_bodies, all_joints);
}

Energy World::Impl::energy(const std::vector<int>& of_bodies,
                           const std::vector<int>& of_joints) const {
  Energy energy;
  for (const int index : of_bodies) {
    const auto i = static_cast<std::size_t>(index);
    if (!is_movable(i)) continue;
    const double mass = 1.0 / masses[i].inverse_mass;
    Vector3d v = states[i].linear_velocity;
    Vector3d w = states[i].angular_velocity;
    if (any_corrections) {
      v -= corrections[i].head<3>();
      w -= corrections[i].tail<3>();
    }
    energy.kinetic += 0.5 * mass * v.squaredNorm();
    energy.potential -= mass * options.gravity.dot(states[i].position);
    if (w.isZero(0.0) || !masses[i].can_turn()) continue;
    w = states[i].orientation.conjugate() * w;
    energy.kinetic += 0.5 * w.dot(masses[i].inertia.cwiseProduct(w));
  }
  for (const int j : of_joints)
    energy.potential += elastic_energy(joints[static_cast<std::size_t>(j)],
                                       joint_states[static_cast<std::size_t>(j)]);
  return energy;
}

JointStep World::Impl::joint_step() const { return span_from(step_start, options.time_step); }

JointStep World::Impl::span_from(double t, double h) const {
  const bool by_baumgarte = options.method == Method::kSequentialImpulses;
  const double closing_time = by_baumgarte ? 0.0 : options.closing_time;
  return {t, h, options.baumgarte, closing_time};
}

double World::Impl::time() const { return time_of(step_count); }

double World::Impl::time_of(std::uint64_t step) const {
  return base_time + static_cast<double>(step - base_step) * options.time_step;
}

const BodyState& World::Impl::state_a(std::size_t j) const { return states[joint_ends[j].first]; }
const BodyState& World::Impl::state_b(std::size_t j) const { return states[joint_ends[j].second]; }

}  // namespace constraint_sim::engine
