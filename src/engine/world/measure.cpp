// What a step tells of itself once it is over: errors of joints, and energy.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "engine/math/list.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

void World::Impl::measure() {
  report.asleep = resting_report.asleep;
  report.dependent_rows = std::max(report.dependent_rows, resting_report.dependent_rows);
  report.max_penetration = std::max(report.max_penetration, resting_report.max_penetration);
  report.max_constraint_error = resting_report.max_constraint_error;
  report.worst_joint = resting_report.worst_joint;
  report.closing_error = resting_report.closing_error;
  report.closing_joint = resting_report.closing_joint;
  const bool is_any_askew = find_worst_joint(sleep.awake().joints, &report);
  const Energy now = energy(sleep.awake().bodies, sleep.awake().joints);
  largest_kinetic_energy = std::max(largest_kinetic_energy, now.kinetic);
  report.energy = now.kinetic + now.potential + resting_energy.potential;
  if (largest_kinetic_energy > 0.0) {
    constexpr double kMost = std::numeric_limits<double>::max();
    const double drift = (report.energy - reference_energy) / largest_kinetic_energy;
    report.energy_drift = std::clamp(drift, -kMost, kMost);  // what moves least may divide by least
  }
  if (report.failed || report.stopped) return;
  if (is_any_askew ||
      std::max(report.max_constraint_error, report.closing_error) > kUnclosedError ||
      !watch.open.empty())
    watch_joints();
  if (!carried.impulse_joints.empty()) watch_spin();
  if (!touching.empty() || !watch.held.empty()) watch_contacts();
  watch_energy();
}

// returns whether one is off by a larger angle than is left unclosed without a word
bool World::Impl::find_worst_joint(const List<int>& among, StepReport* worst) const {
  bool is_any_askew = false;
  for (const int index : among) {
    const auto j = static_cast<std::size_t>(index);
    is_any_askew |= joint_states[j].angle_error > kUnclosedAngle;
    const double error = std::abs(joint_states[j].error);
    if (!acts(joints[j], joint_states[j]) || !is_rigid(joints[j])) continue;
    const bool is_closing = joint_states[j].closing;
    double& largest = is_closing ? worst->closing_error : worst->max_constraint_error;
    std::optional<JointId>& joint = is_closing ? worst->closing_joint : worst->worst_joint;
    if (joint && error <= largest) continue;
    largest = error;
    joint = joint_ids[j];
  }
  return is_any_askew;
}

Energy World::Impl::energy() const {
  List<int> all_bodies(bodies.size());
  List<int> all_joints(joints.size());
  std::iota(all_bodies.begin(), all_bodies.end(), 0);
  std::iota(all_joints.begin(), all_joints.end(), 0);
  return energy(all_bodies, all_joints);
}

Energy World::Impl::energy(const List<int>& of_bodies, const List<int>& of_joints) const {
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

}  // namespace constraint_sim::engine
