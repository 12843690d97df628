// Removal of bodies and joints. All lists are compacted once per request, so the cost is linear in
// the sizes of the world and of the request.

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

/// Pairs (coupled joint, coupling) by index, sorted.
using CouplingsOfJoints = List<std::pair<std::size_t, std::size_t>>;

CouplingsOfJoints couplings_by_joint(const Model& model) {
  CouplingsOfJoints found;
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    if (!info(model.joints[j].kind).couples_joints) continue;
    const Coupling& coupling = model.joints[j].coupling;
    for (const JointId id : {coupling.first, coupling.second})
      found.emplace_back(model.index(id), j);
  }
  std::sort(found.begin(), found.end());
  return found;
}

/// Keeps the entries of a list that are not removed, in their order.
template <class Container>
void compact_list(const List<bool>& is_removed, Container* list) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < list->size(); ++i) {
    if (is_removed[i]) continue;
    if (kept != i) (*list)[kept] = std::move((*list)[i]);
    ++kept;
  }
  list->erase(list->begin() + static_cast<std::ptrdiff_t>(kept), list->end());
}

/// Marks the joints to remove. Refuses a coupled joint whose couplings are not before it in `ids`.
void mark_removed(const Model& model, const std::vector<JointId>& ids, List<bool>* is_removed) {
  const CouplingsOfJoints couplings = couplings_by_joint(model);
  for (const JointId id : ids) {
    const std::size_t j = model.index(id);
    if ((*is_removed)[j]) refuse("name", in_quotes(model.joints[j].name) + " is there twice");
    for (auto coupling =
             std::lower_bound(couplings.begin(), couplings.end(), std::pair(j, std::size_t{0}));
         coupling != couplings.end() && coupling->first == j; ++coupling)
      if (!(*is_removed)[coupling->second])
        refuse("name", in_quotes(model.joints[j].name) + " is coupled by " +
                           in_quotes(model.joints[coupling->second].name) + ", remove that first");
    (*is_removed)[j] = true;
  }
}

/// Marks the bodies to remove and all joints on them. Returns the names of these joints, in the
/// order of the bodies.
std::vector<std::string> mark_removed(const Model& model, const std::vector<BodyId>& ids,
                                      List<bool>* is_body_removed, List<bool>* is_joint_removed) {
  constexpr std::size_t kStays = std::numeric_limits<std::size_t>::max();
  List<std::size_t> order(model.bodies.size(), kStays);  // place in the request
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const std::size_t i = model.index(ids[k]);
    if (ids[k] == kWorldBody) refuse("name", "'world' cannot be removed");
    if (order[i] != kStays) refuse("name", in_quotes(model.bodies[i].name) + " is there twice");
    order[i] = k;
    (*is_body_removed)[i] = true;
  }
  // Pairs (place of the first removed body in the request, joint).
  List<std::pair<std::size_t, std::size_t>> held;
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    if ((*is_joint_removed)[j]) continue;
    std::size_t first = kStays;
    for (const BodyId id : model.holders(j)) first = std::min(first, order[model.index(id)]);
    if (first != kStays) held.emplace_back(first, j);
  }
  std::sort(held.begin(), held.end());
  std::vector<std::string> names;
  for (const auto& [body, j] : held) {
    (*is_joint_removed)[j] = true;
    names.push_back(model.joints[j].name);
  }
  return names;
}

void erase_joints(const List<bool>& is_removed, WorldImpl* world) {
  for (std::size_t j = 0; j < world->joints.size(); ++j) {
    if (!is_removed[j]) continue;
    world->wake_ends(world->joints[j]);
    world->joint_by_name.erase(world->joints[j].name);
  }
  compact_list(is_removed, &world->joints);
  compact_list(is_removed, &world->joint_starts);
  compact_list(is_removed, &world->joint_states);
  compact_list(is_removed, &world->self_stress);
  compact_list(is_removed, &world->joint_ids);
  world->joints_of_bodies = {};
  world->events.clear();
  world->edits.note_topology();
  world->edits.note_all();  // indices are others now
}

void erase_bodies(const List<bool>& is_removed, WorldImpl* world) {
  const auto goes = [&](BodyId id) { return is_removed[world->index(id)]; };
  for (const TouchingPair& pair : world->resting) {
    if (!world->is_known(pair)) continue;
    if (goes(pair.id_a)) world->sleep.wake(world->index(pair.id_b), world);
    if (goes(pair.id_b)) world->sleep.wake(world->index(pair.id_a), world);
  }
  const auto is_on_one = [&](const Wrench& wrench) { return goes(wrench.body); };
  world->wrenches.erase(std::remove_if(world->wrenches.begin(), world->wrenches.end(), is_on_one),
                        world->wrenches.end());
  world->monitors.note_wrench_ended();
  for (std::size_t i = 0; i < world->bodies.size(); ++i)
    if (is_removed[i]) world->body_by_name.erase(world->bodies[i].name);
  compact_list(is_removed, &world->bodies);
  compact_list(is_removed, &world->states);
  compact_list(is_removed, &world->masses);
  compact_list(is_removed, &world->corrections);
  compact_list(is_removed, &world->asleep);
  compact_list(is_removed, &world->body_ids);
  world->joints_of_bodies = {};
  world->integration
      .forget_loads();  // loads of the last step have indices of bodies, which have changed
  world->contacts.clear();
  world->events.clear();
  world->edits.note_topology();
  world->edits.note_all();  // indices are others now
}

void erase(const List<bool>& is_joint_removed, const List<bool>& is_body_removed,
           WorldImpl* world) {
  const auto any = [](const List<bool>& list) {
    return std::find(list.begin(), list.end(), true) != list.end();
  };
  if (any(is_joint_removed)) erase_joints(is_joint_removed, world);
  if (any(is_body_removed)) erase_bodies(is_body_removed, world);
  world->forget_unknown_ids();
}

}  // namespace

std::vector<std::string> World::remove(const std::vector<JointId>& joints,
                                       const std::vector<BodyId>& bodies) {
  List<bool> is_joint_removed(impl_->joints.size()), is_body_removed(impl_->bodies.size());
  mark_removed(*impl_, joints, &is_joint_removed);
  std::vector<std::string> names =
      mark_removed(*impl_, bodies, &is_body_removed, &is_joint_removed);
  erase(is_joint_removed, is_body_removed, impl_.get());
  return names;
}

void World::remove_joint(JointId id) { remove({id}, {}); }

std::vector<std::string> World::remove_body(BodyId id) { return remove({}, {id}); }

}  // namespace constraint_sim::engine
