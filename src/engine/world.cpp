#include "constraint_sim/world.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint.h"
#include "engine/narrowphase.h"
#include "engine/world_impl.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

// a whole physics engine in six steps, as the tutorial has it
const StepReport& World::step() {
  Impl& world = *impl_;
  world.begin_step();
  world.find_pairs();         // 1. broadphase: fast and approximate
  world.find_contacts();      // 2. narrowphase: accurate but slow
  world.choose_methods();     //    smooth islands part here from the tutorial:
  world.integrate();          //    all the way in one, to a tolerance; the others go on with
  world.prepare_rows();       // 3. what joints and contacts ask of the velocities
  world.update_velocities();  // 4. by gravity, and by the impulses of the step before
  world.solve_rows();         // 5. to what the rows allow
  world.update_positions();   // 6. with the final velocities
  world.finish_step();
  return world.report;
}

void World::Impl::begin_step() {
  if (edited) recompile();
  states_before = states;
  joint_states_before = joint_states;
  step_start = time();
  step_end = time_of(step_count + 1);
  report = StepReport{};
}

// what follows from bodies, joints and options: once after an edit
void World::Impl::recompile() {
  edited = false;

  collidable.clear();
  bool any_movable = false;
  for (std::size_t i = 1; i < bodies.size(); ++i) {
    if (bodies[i].no_collision || std::holds_alternative<Point>(bodies[i].shape)) continue;
    collidable.push_back(static_cast<int>(i));
    any_movable = any_movable || is_movable(i);
  }
  if (!any_movable || collidable.size() < 2) collidable.clear();

  kinematic.clear();
  for (std::size_t i = 1; i < bodies.size(); ++i)
    if (bodies[i].type == BodyType::kKinematic) kinematic.push_back(static_cast<int>(i));

  joint_ends.clear();
  unpaired.clear();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const std::size_t a = index(joints[j].body_a);
    const std::size_t b = index(joints[j].body_b);
    joint_ends.emplace_back(a, b);
    if (joint_states[j].broken) joint_states[j].force = joint_states[j].bias = 0.0;
    if (!joints[j].collide_connected && !joint_states[j].broken)
      unpaired.emplace_back(static_cast<int>(std::min(a, b)), static_cast<int>(std::max(a, b)));
  }
  std::sort(unpaired.begin(), unpaired.end());

  for (TouchingPair& pair : touching) {
    pair.a = body_index[pair.id_a.value];
    pair.b = body_index[pair.id_b.value];
  }
  const auto is_gone = [](const TouchingPair& pair) { return pair.a < 0 || pair.b < 0; };
  touching.erase(std::remove_if(touching.begin(), touching.end(), is_gone), touching.end());

  changing_courses.clear();  // until the islands are sorted anew
  span_ends.clear();

  if (topology_edited) make_islands();
  classify_islands();
  is_fresh = true;

  const Energy now = energy();
  largest_kinetic_energy = now.kinetic;
  reference_energy = now.kinetic + now.potential;
}

void World::Impl::find_pairs() {
  if (collidable.empty()) return;
  const StageTimer timer(*this, Stage::kBroadphase);
  proxies.clear();
  for (const int i : collidable) {
    const auto body = static_cast<std::size_t>(i);
    proxies.push_back({bounds(bodies[body].shape, states[body]), i, is_movable(body)});
  }
  report.candidate_pairs = static_cast<std::uint32_t>(broadphase.find_pairs(proxies).size());
  report.broadphase_tests = broadphase.tests();
}

void World::Impl::find_contacts() {
  std::swap(touching, touching_before);
  touching.clear();
  if (collidable.empty()) return;
  const StageTimer timer(*this, Stage::kNarrowphase);
  auto before = touching_before.begin();  // both lists are sorted, so one pass matches them
  for (const Broadphase::Pair& ends : broadphase.pairs()) {
    if (std::binary_search(unpaired.begin(), unpaired.end(), ends)) continue;
    const auto a = static_cast<std::size_t>(ends.first);
    const auto b = static_cast<std::size_t>(ends.second);
    const Manifold manifold = collide(bodies[a].shape, states[a], bodies[b].shape, states[b]);
    if (manifold.count == 0) continue;

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

void World::Impl::prepare_rows() {
  rows.clear();
  joint_rows.clear();
  contact_rows.clear();
  if (impulse_bodies.empty()) return;
  const StageTimer timer(*this, Stage::kRows);
  const JointStep step = joint_step();
  for (const int index : impulse_joints) {
    const auto j = static_cast<std::size_t>(index);
    joint_rows.push_back(rows.size());
    if (!options.warm_starting) joint_states[j].impulse.setZero();
    std::array<Row, kMaxJointRows> written;
    const int count =
        prepare_joint(joints[j], state_a(j), state_b(j), step, joint_states[j], written.data());
    for (std::size_t k = 0; k < static_cast<std::size_t>(count); ++k) {
      written[k].body_a = static_cast<int>(joint_ends[j].first);
      written[k].body_b = static_cast<int>(joint_ends[j].second);
      rows.push_back(written[k]);
    }
  }
  joint_rows.push_back(rows.size());

  for (const TouchingPair& pair : touching)
    for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k)
      prepare_contact(pair, k);
  report.rows += static_cast<std::uint32_t>(rows.size());
  report.contacts = static_cast<std::uint32_t>(contact_rows.size());
}

void World::Impl::prepare_contact(const TouchingPair& pair, std::size_t point) {
  const auto a = static_cast<std::size_t>(pair.a);
  const auto b = static_cast<std::size_t>(pair.b);
  const ContactSurface surface(bodies[a], bodies[b]);
  const ContactStep step{options.time_step, options.baumgarte, options.gravity.norm()};
  std::array<Row, kMaxContactRows> written;
  const int count =
      write_contact_rows(states[a], states[b], pair.manifold.normal, pair.manifold.points[point],
                         surface, step, pair.impulses[point], written.data());
  contact_rows.push_back(rows.size());
  report.max_penetration = std::max(report.max_penetration, pair.manifold.points[point].depth);
  for (std::size_t k = 0; k < static_cast<std::size_t>(count); ++k) {
    written[k].body_a = pair.a;
    written[k].body_b = pair.b;
    if (k > 0) written[k].normal_row = static_cast<int>(contact_rows.back());
    rows.push_back(written[k]);
  }
}

void World::Impl::update_velocities() {
  if (impulse_bodies.empty()) return;
  const StageTimer timer(*this, Stage::kVelocities);
  if (!wrenches.empty()) apply_wrenches();
  solver.update_velocities(impulse_bodies, states, masses, options.gravity, options.time_step,
                           rows);
}

void World::Impl::apply_wrenches() {
  const double h = options.time_step;
  for (const Wrench& wrench : wrenches) {
    const bool acts_throughout = wrench.start <= step_start && wrench.end >= step_end;
    const double duration =
        acts_throughout ? h : std::min(wrench.end, step_end) - std::max(wrench.start, step_start);
    if (duration <= 0.0) continue;  // not yet
    const std::size_t i = index(wrench.body);
    if (islands[static_cast<std::size_t>(island_of[i])].method != Method::kSequentialImpulses)
      continue;
    BodyState& body = states[i];
    body.linear_velocity += duration * masses[i].inverse_mass * wrench.force;
    body.angular_velocity +=
        apply_inertia(masses[i].inverse_inertia, body.orientation, duration * wrench.torque);
  }
}

void World::Impl::solve_rows() {
  if (rows.empty()) return;
  const StageTimer timer(*this, Stage::kSolve);
  solver.solve(states, rows, options.iterations);
  report.iterations += static_cast<std::uint32_t>(options.iterations);
}

void World::Impl::update_positions() {
  if (impulse_bodies.empty() && kinematic.empty()) return;
  const StageTimer timer(*this, Stage::kPositions);
  SequentialImpulses::update_positions(impulse_bodies, states, masses, options.time_step);
  SequentialImpulses::update_positions(kinematic, states, masses, options.time_step);
}

void World::Impl::finish_step() {
  if (!is_finite()) {
    states = states_before;
    joint_states = joint_states_before;
    for (LinkedMotion& motion : linked) motion.forget();
    for (EnergyMomentum& motion : stiff) motion.forget();
    is_fresh = true;
    touching.clear();
    contacts.clear();
    report.failed = true;
  } else {
    const JointStep step = joint_step();
    read_joints(step);
    read_smooth_joints(step);
    read_contacts();
    ++step_count;
    drop_spent_wrenches();
    is_fresh = false;
  }
  report.step = step_count;
  report.time = report.failed ? step_start : step_end;
  measure();
}

// a sum that a single NaN or infinity spoils
bool World::Impl::is_finite() const {
  Vector3d sum = Vector3d::Zero();
  Eigen::Vector4d turned = Eigen::Vector4d::Zero();
  for (std::size_t i = 1; i < states.size(); ++i) {
    sum += states[i].position + states[i].linear_velocity + states[i].angular_velocity;
    turned += states[i].orientation.coeffs();
  }
  return std::isfinite(sum.sum() + turned.sum());
}

void World::Impl::read_joints(const JointStep& step) {
  for (std::size_t k = 0; k < impulse_joints.size(); ++k) {
    const auto j = static_cast<std::size_t>(impulse_joints[k]);
    const int count = static_cast<int>(joint_rows[k + 1] - joint_rows[k]);
    read_joint(joints[j], state_a(j), state_b(j), step, rows.data() + joint_rows[k], count,
               joint_states[j]);
    note_if_torn(j);
  }
}

void World::Impl::note_if_torn(std::size_t j) {
  if (!joint_states[j].broken) return;
  edited = topology_edited = true;
  ++report.torn_joints;
}

void World::Impl::read_contacts() {
  contacts.clear();
  std::size_t i = 0;
  for (TouchingPair& pair : touching) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k, ++i) {
      const std::size_t first = contact_rows[i];
      const std::size_t end = i + 1 < contact_rows.size() ? contact_rows[i + 1] : rows.size();
      pair.impulses[k].setZero();
      for (std::size_t r = first; r < end; ++r) pair.impulses[k] += rows[r].impulse * rows[r].J.j1;
      const Manifold::Point& point = pair.manifold.points[k];
      contacts.push_back({pair.id_a, pair.id_b, point.position, pair.manifold.normal, point.depth,
                          rows[first].impulse / options.time_step});
    }
  }
}

void World::Impl::drop_spent_wrenches() {
  if (wrenches.empty()) return;
  const auto is_spent = [this](const Wrench& wrench) {
    return wrench.end <= std::max(step_end, wrench.start);
  };
  wrenches.erase(std::remove_if(wrenches.begin(), wrenches.end(), is_spent), wrenches.end());
}

void World::Impl::measure() {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double error = std::abs(joint_states[j].error);
    if (joint_states[j].broken || !is_rigid(joints[j])) continue;
    if (report.worst_joint && error <= report.max_constraint_error) continue;
    report.max_constraint_error = error;
    report.worst_joint = joint_ids[j];
  }
  const Energy now = energy();
  largest_kinetic_energy = std::max(largest_kinetic_energy, now.kinetic);
  report.energy = now.kinetic + now.potential;
  if (largest_kinetic_energy > 0.0)
    report.energy_drift = (report.energy - reference_energy) / largest_kinetic_energy;
}

Energy World::Impl::energy() const {
  Energy energy;
  for (std::size_t i = 1; i < states.size(); ++i) {
    if (!is_movable(i)) continue;
    const double mass = 1.0 / masses[i].inverse_mass;
    energy.kinetic += 0.5 * mass * states[i].linear_velocity.squaredNorm();
    energy.potential -= mass * options.gravity.dot(states[i].position);
    if (!masses[i].can_turn()) continue;
    const Vector3d w = states[i].orientation.conjugate() * states[i].angular_velocity;
    energy.kinetic += 0.5 * w.dot(masses[i].inertia.cwiseProduct(w));
  }
  for (std::size_t j = 0; j < joints.size(); ++j)
    energy.potential += elastic_energy(joints[j], joint_states[j]);
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
