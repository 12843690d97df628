#include "engine/snapshot/snapshot_checks.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "constraint_sim/engine/snapshot.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

void check(bool is_right, const char* what) {
  if (!is_right) fail_damaged(what);
}

// Checks that ids ascend, and that the next id is larger.
template <class Id>
void check_order(const std::vector<Id>& ids, Id next, const char* what) {
  for (std::size_t i = 0; i < ids.size(); ++i)
    check(ids[i] < (i + 1 < ids.size() ? ids[i + 1] : next), what);
}

bool is_finite(const MassProperties& mass) {
  return std::isfinite(mass.inverse_mass) && mass.inverse_mass >= 0.0 && mass.inertia.allFinite() &&
         (mass.inertia.array() >= 0.0).all() && mass.inverse_inertia.allFinite() &&
         (mass.inverse_inertia.array() >= 0.0).all() && mass.weight_share >= 0.0 &&
         mass.weight_share <= 1.0;
}

void check_bodies(const Model& model) {
  const std::size_t n = model.bodies.size();
  check(n > 0 && model.masses.size() == n && model.body_ids.size() == n, "its bodies");
  check(model.body_ids[0] == kWorldBody && model.bodies[0].name == "world" && !model.is_movable(0),
        "its world");
  check_order(model.body_ids, model.next_body_id, "its bodies");
  std::set<std::string> names{"world"};
  for (std::size_t i = 1; i < n; ++i) {
    const Body& body = model.bodies[i];
    validate(body);
    check(names.insert(body.name).second, "its names");
    check(is_finite(model.masses[i]), "its masses");
    check(model.is_movable(i) == (body.type == BodyType::kDynamic), "its masses");
  }
}

void check_joint(const Model& model, std::size_t j) {
  const Joint& joint = model.joints[j];
  validate(joint);
  check(model.is_known(joint.body_a) && model.is_known(joint.body_b),
        "the bodies of its constraints");
  const bool is_pair =
      joint.body_a != joint.body_b &&
      (model.is_movable(model.index(joint.body_a)) || model.is_movable(model.index(joint.body_b)));
  check(is_pair || info(joint.kind).couples_joints, "the bodies of its constraints");
  check(info(joint.kind).has_frames == joint.frame_b.has_value(), "its frames");
  if (const DistanceJoint* distance = if_distance(joint))
    check(distance->length || distance->is_limited(), "its lengths");
  if (!info(joint.kind).couples_joints) return;
  const auto end_of = [&](JointId id) {
    const Joint& of = model.joints[model.index(id)];
    return model.is_movable(model.index(of.body_b)) ? of.body_b : of.body_a;
  };
  for (const JointId id : {joint.coupling.first, joint.coupling.second}) {
    const int of = model.find(id);
    check(of >= 0 && to_index(of) < j &&
              (info(joint.kind).couples_lengths ? info(model.joints[of].kind).is_free_length
                                                : info(model.joints[of].kind).coordinates > 0),
          "its couplings");
  }
  check(joint.coupling.first != joint.coupling.second &&
            joint.body_a == end_of(joint.coupling.first) &&
            joint.body_b == end_of(joint.coupling.second),
        "its couplings");
}

// Checks that each acting coupling couples acting joints.
void check_acting(const Model& model, const State& state) {
  const auto acts = [&](std::size_t j) {
    return model.joints[j].enabled && !state.joint_states[j].broken;
  };
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    if (!info(model.joints[j].kind).couples_joints || !acts(j)) continue;
    const Coupling& coupling = model.joints[j].coupling;
    check(acts(model.index(coupling.first)) && acts(model.index(coupling.second)), "its couplings");
  }
}

void check_joints(const Model& model) {
  const std::size_t m = model.joints.size();
  check(model.joint_starts.size() == m && model.joint_ids.size() == m, "its constraints");
  check_order(model.joint_ids, model.next_joint_id, "its constraints");
  std::set<std::string> names;
  for (std::size_t j = 0; j < m; ++j) {
    check_joint(model, j);
    check(names.insert(model.joints[j].name).second, "its names");
    Joint start = model.joints[j];  // the joint after a reset(), which has to be valid
    start.motor = model.joint_starts[j].motor;
    start.coordinates = model.joint_starts[j].coordinates;
    validate(start);
  }
}

}  // namespace

void fail_damaged(const char* what) {
  throw SnapshotError(std::string("snapshot: is damaged: ") + what + " cannot be");
}

void check_pairs(const Model& model, const List<TouchingPair>& pairs) {
  const auto n = static_cast<int>(model.bodies.size());
  for (const TouchingPair& pair : pairs) {
    check(pair.a >= 0 && pair.a < n && pair.b >= 0 && pair.b < n, "its contacts");
    const auto has_part = [&](int body, int part) {
      return part >= 0 && to_index(part) < part_count(model.bodies[body].shape);
    };
    check(has_part(pair.a, pair.part_a) && has_part(pair.b, pair.part_b), "its contacts");
  }
}

void check_model(const Model& model, const State& state) {
  check_bodies(model);
  check_joints(model);
  const std::size_t n = model.bodies.size(), m = model.joints.size();
  check(state.states.size() == n && state.corrections.size() == n && state.asleep.size() == n,
        "the states of its bodies");
  check(state.joint_states.size() == m && state.self_stress.size() == m,
        "the states of its constraints");
  check_acting(model, state);
  for (const BodyState& body : state.states) validate(body);
  for (const Wrench& wrench : state.wrenches) check(model.is_known(wrench.body), "its wrenches");
  check_pairs(model, state.touching);
  check_pairs(model, state.resting);
  check(state.base_step <= state.step_count &&
            std::abs(state.time(model.options.time_step)) <= kMostMagnitude,
        "its time");
}

void check_ids(const Model& model, const MostIds& most) {
  check(most.body <= model.next_body_id.value && most.joint <= model.next_joint_id.value,
        "its ids");
}

void check_indices(const List<int>& indices, std::size_t size) {
  for (const int index : indices)
    check(index >= 0 && static_cast<std::size_t>(index) < size, "its lists");
}

}  // namespace constraint_sim::engine
