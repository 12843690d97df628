// Joints of EventDriven that bear too little.

#include "engine/constraints/joint_load.h"
#include "engine/methods/event_driven/joints/event_driven.h"

namespace constraint_sim::engine {

void EventDriven::break_joint(Run* run, std::size_t joint) {
  collect(*run->states, run->motion);
  const EventJoints& joints = motions_.joints();
  const auto break_one = [&](std::size_t l) {
    if (!motions_.is_broken(l)) reported_.push_back({EventKind::kBroken, run->t(), l, -1, 0.0});
    motions_.break_joint(l);
  };
  break_one(joint);
  for (std::size_t l = 0; l < joints.size(); ++l)  // couplings of the joint
    if (info(joints[l].kind).couples_joints)
      for (const CoupledTerm& term : joints.terms(l))
        if (term.joint == joint) break_one(l);
  variants_.compile_bare(joints, motions_.broken(), run->around.masses);
}

// Joints whose impulses since `before` are more than they bear.
List<std::size_t> EventDriven::broken_by_impacts(const Run& run,
                                                 const EventImpulses::Sums& before) const {
  const EventJoints& joints = motions_.joints();
  List<std::size_t> broken;
  for (const EventJoints::Breaking& breaking : joints.breaking()) {
    const std::size_t l = breaking.joint;
    if (motions_.is_broken(l)) continue;
    const auto [a, b] = joints.ends(l);
    const JointLoad load =
        load_of(joints[l], run.bodies().at(a, run.t()), run.bodies().at(b, run.t()),
                impulses_.sums().joint[l] - before.joint[l],
                impulses_.sums().coupled[l] - before.coupled[l]);
    if (load.breaks(joints[l], 1.0 / kImpactDuration)) broken.push_back(l);
  }
  return broken;
}

// Adds the joint that is farthest beyond its load, as after another joint let go.
void EventDriven::add_overloaded(List<std::size_t>* broken) const {
  const WatchedByJoints* worst = nullptr;
  const auto excess = [](const WatchedByJoints& of) { return -of.value / of.tolerance; };
  for (const WatchedByJoints& watched : stepper_.before())
    if (watched.breaks >= 0 && excess(watched) > (worst != nullptr ? excess(*worst) : 1.0))
      worst = &watched;
  if (worst != nullptr) broken->push_back(static_cast<std::size_t>(worst->breaks));
}

}  // namespace constraint_sim::engine
