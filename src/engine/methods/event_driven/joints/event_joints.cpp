#include "engine/methods/event_driven/joints/event_joints.h"

#include <algorithm>

#include "engine/constraints/joint_kinds.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

EventJoints::EventJoints(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
                         const List<CoupledTerms>& couplings, const List<char>& open)
    : members_(members) {
  for (const int j : members_) {
    const Joint& joint = all_joints[j];
    ends_.push_back(ends[j]);
    if (!open.empty()) open_.push_back(open[j]);
    add_laws(joint);
    if (info(joint.kind).couples) add_coupling(couplings[j], joints_.size() - 1);
  }
  first_law_.push_back(laws_.size());
}

void EventJoints::add_laws(const Joint& joint) {
  const std::size_t l = joints_.size();
  joints_.push_back(joint);
  joints_.back().name.clear();  // copies then allocate nothing
  first_law_.push_back(laws_.size());
  add_one_sided_laws(joint, l, &laws_);
  if (joint.break_force == 0.0 && joint.break_torque == 0.0) return;
  const auto most = [](double force) { return force > 0.0 ? force : kInfinity; };
  breaking_.push_back({l, most(joint.break_force), most(joint.break_torque)});
}

bool EventJoints::follow_laws(const List<Joint>& all_joints) {
  const List<OneSidedLaw> before = std::move(laws_);
  joints_.clear();
  laws_.clear();
  first_law_.clear();
  breaking_.clear();
  for (const int j : members_) add_laws(all_joints[j]);
  first_law_.push_back(laws_.size());
  return std::equal(laws_.begin(), laws_.end(), before.begin(), before.end(),
                    [](const OneSidedLaw& a, const OneSidedLaw& b) {
                      return a.joint == b.joint && a.function == b.function &&
                             a.is_distance == b.is_distance && a.is_coupling == b.is_coupling;
                    });
}

void EventJoints::add_coupling(const CoupledTerms& terms, std::size_t joint) {
  couplings_.resize(members_.size());
  couplings_[joint] = terms;
  for (CoupledTerm& term : couplings_[joint]) {
    const auto found = std::find(members_.begin(), members_.end(), static_cast<int>(term.joint));
    term.joint = to_index(found - members_.begin());
  }
}

bool EventJoints::with_rows(std::size_t joint, const List<OneSidedState>& states,
                            Joint* result) const {
  *result = joints_[joint];
  const auto [first, end] = laws_of(joint);
  return with_rows_switched(laws_.data() + first, states.data() + first, end - first, result);
}

// Returns the joints with rows as the states say, and lists which of them act.
List<Joint> EventJoints::switched(const List<OneSidedState>& states, const List<char>& is_broken,
                                  List<int>* acting, List<int>* idle) const {
  List<Joint> joints = joints_;
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    const bool acts = !is_broken[l] && with_rows(l, states, &joints[l]);
    (acts ? acting : idle)->push_back(static_cast<int>(l));
  }
  return joints;
}

EquationsOfMotion EventJoints::compile(const List<OneSidedState>& states,
                                       const List<char>& is_broken,
                                       const List<MassProperties>& masses) const {
  List<int> acting, idle;
  const List<Joint> joints = switched(states, is_broken, &acting, &idle);
  return {acting, joints, ends_, masses, couplings_, idle, open_};
}

}  // namespace constraint_sim::engine
