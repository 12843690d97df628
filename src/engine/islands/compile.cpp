#include "engine/islands/compile.h"

#include <algorithm>
#include <utility>

#include "engine/constraints/coupling.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/islands/island_traits.h"
#include "engine/islands/method_choice.h"

namespace constraint_sim::engine {

List<int> open_points_of(const Model& model, const List<JointData>& joint_states,
                         const IslandMembers& members) {
  List<int> open;
  for (const int j : members.joints)
    if (joint_states[j].closing && forms(model.joints[j].kind).form == RowsForm::kPoint)
      open.push_back(j);
  return open;
}

void compile_island(const Model& model, const Topology& topology, const List<int>& open_points,
                    IslandParts* parts, List<IslandMotion>* motions) {
  List<CoupledTerms> couplings;
  for (const int j : parts->members.joints) {
    if (!info(model.joints[j].kind).couples) continue;
    couplings.resize(model.joints.size());
    couplings[j] = model.terms_of(to_index(j));
  }
  List<char> open;
  parts->open_points = open_points;
  for (const int j : open_points) {
    open.resize(model.joints.size());
    open[j] = 1;
  }
  const bool has_events = method_for(parts->nature, model.options) == Method::kEventDriven;
  IslandMotion motion =
      has_events ? IslandMotion(EventDriven(parts->members.joints, model.joints,
                                            topology.joint_ends(), couplings, model.masses, open))
                 : IslandMotion(EquationsOfMotion(parts->members.joints, model.joints,
                                                  topology.joint_ends(), model.masses, couplings,
                                                  {}, open));
  const EquationsOfMotion& equations = motion.equations();
  const List<int>& held = equations.bodies();
  parts->turning_freely.clear();
  for (std::size_t i = equations.rotating(); i < held.size(); ++i)
    if (model.masses[held[i]].can_turn()) parts->turning_freely.push_back(held[i]);
  parts->is_stale = false;
  if (parts->motion >= 0) {
    (*motions)[parts->motion] = std::move(motion);
    return;
  }
  parts->motion = static_cast<int>(motions->size());
  motions->push_back(std::move(motion));
}

namespace {

// Compiles an island unless its equations can take over the laws of the joints.
void compile_where_needed(const Model& model, const State& state, const Topology& topology,
                          IslandParts* parts, List<IslandMotion>* motions) {
  const List<int> open_points = open_points_of(model, state.joint_states, parts->members);
  const bool has_events = method_for(parts->nature, model.options) == Method::kEventDriven;
  const bool is_as_before = parts->motion >= 0 && !parts->is_stale &&
                            open_points == parts->open_points &&
                            has_events == (*motions)[parts->motion].is_event_driven();
  if (is_as_before && (*motions)[parts->motion].follow_laws(model.joints)) return;
  parts->begin_anew();
  compile_island(model, topology, open_points, parts, motions);
}

}  // namespace

void compile_islands(const Model& model, const State& state, const Topology& topology,
                     IslandLists* lists) {
  const FastestSprings fastest(model, state.joint_states, topology.joint_ends());
  for (std::size_t i = 0; i < lists->island_parts.size(); ++i) {
    IslandParts& parts = lists->island_parts[i];
    const MethodReason nature = classify(traits_of(model, parts.members, fastest), model.options);
    const bool has_other_laws = std::exchange(parts.has_other_laws, false);
    if (has_other_laws && !lists->goes_on(i, nature)) parts.begin_anew();
    parts.nature = nature;
    if (uses_impulses(method_for(nature, model.options)))
      parts.is_stale = parts.is_stale || has_other_laws;
    else if (parts.members.joints.empty())
      parts.turning_freely = parts.members.bodies;
    else if (parts.motion < 0 || parts.is_stale || has_other_laws)
      compile_where_needed(model, state, topology, &parts, &lists->motions);
  }
  lists->list_fresh();
}

}  // namespace constraint_sim::engine
