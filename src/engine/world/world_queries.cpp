// Queries of a world, which change nothing. Markers and messages ask for each body and joint in
// every round, so these functions are optimized as the stages of a step are.

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>

#include "engine/constraints/custom_code.h"
#include "engine/constraints/distance.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_load.h"
#include "engine/islands/unresolved_bodies.h"
#include "engine/math/list.h"
#include "engine/model/impulse_method.h"
#include "engine/model/validate.h"
#include "engine/world/energy.h"
#include "engine/world/next_islands.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

/// Returns the value of `name` in a map; throws std::invalid_argument about `field` without such.
template <class Map>
auto find_named(const Map& map, std::string_view name, const char* field) {
  const auto found = map.find(std::string(name));
  if (found == map.end()) refuse(field, "there is none named " + in_quotes(std::string(name)));
  return found->second;
}

/// Adds the bodies of an island that joints move faster than the last step resolved. An island that
/// was not compiled since its joints ceased to act has no motion, and no such bodies.
void add_unresolved(const WorldImpl& world, std::size_t i, List<std::size_t>* found) {
  const IslandParts& parts = world.island_parts[i];
  if (uses_impulses(world.islands[i].method))
    find_spinning(world, world, world.rollback, parts.members, found);
  else if (parts.motion >= 0)
    find_unresolved(world, world, world.rollback, parts.members,
                    world.motions[to_index(parts.motion)], found);
}

}  // namespace

// ---- options and time

const WorldOptions& World::options() const { return impl_->options; }
double World::time() const { return impl_->time(); }
std::uint64_t World::step_count() const { return impl_->step_count; }
bool World::is_asked_to_stop() const { return is_set(impl_->stop); }

// ---- bodies and wrenches

const Body& World::body(BodyId id) const { return impl_->bodies[impl_->index(id)]; }
const BodyState& World::state(BodyId id) const { return impl_->states[impl_->index(id)]; }

bool World::has_body(std::string_view name) const {
  return impl_->body_by_name.count(std::string(name)) > 0;
}

BodyId World::find_body(std::string_view name) const {
  return find_named(impl_->body_by_name, name, "body");
}

std::vector<BodyId> World::body_ids() const {
  return {impl_->body_ids.begin() + 1, impl_->body_ids.end()};
}
void World::body_ids(std::vector<BodyId>* ids) const {
  ids->assign(impl_->body_ids.begin() + 1, impl_->body_ids.end());
}

const std::vector<Wrench>& World::wrenches() const { return impl_->wrenches; }

// ---- joints

const Joint& World::joint(JointId id) const { return impl_->joints[impl_->index(id)]; }
const JointState& World::joint_state(JointId id) const { return joint_data(*this, id); }

const JointData& joint_data(const World& world, JointId joint) {
  const WorldImpl& impl = ImplAccess::of(world);
  return impl.joint_states[impl.index(joint)];
}

bool World::has_joint(std::string_view name) const {
  return impl_->joint_by_name.count(std::string(name)) > 0;
}

JointId World::find_joint(std::string_view name) const {
  return find_named(impl_->joint_by_name, name, "constraint");
}

const std::vector<JointId>& World::joint_ids() const { return impl_->joint_ids; }

World::Anchors World::anchors(JointId id) const {
  const Joint& joint = this->joint(id);
  const AnchorPair pair(joint, state(joint.body_a), state(joint.body_b));
  return {pair.p_A, pair.p_A + pair.d};
}

World::JointWrench World::joint_wrench(JointId id) const {
  const Joint& joint = this->joint(id);
  if (info(joint.kind).couples_joints)
    refuse("constraint", in_quotes(joint.name) + " is a " + engine::name(joint.kind) +
                             ", which couples others and has no wrench of its own");
  const JointData& state = joint_data(*this, id);
  const BodyState &a = this->state(joint.body_a), &b = this->state(joint.body_b);
  if (has_length(joint.kind))
    return {b.orientation.conjugate() * (state.force * direction(AnchorPair(joint, a, b))),
            Eigen::Vector3d::Zero()};
  if (is_custom_force(joint.kind)) {
    if (!acts(joint, state)) return {};
    const Jacobian wrench = custom_wrench(joint, a, b, time());
    const Eigen::Vector3d arm = b.orientation * joint.anchor_b;
    const Eigen::Quaterniond to_joint = (b.orientation * *joint.frame_b).conjugate();
    return {to_joint * wrench.j3, to_joint * (wrench.j4 - arm.cross(wrench.j3))};
  }
  const double h = options().time_step;
  RowVector impulse = state.impulse;
  const JointForms& kind = forms(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i)
    impulse[kind.rows + i] = h * state.coordinates[static_cast<std::size_t>(i)].effort;
  return wrench_of(joint, a, b, impulse, h);
}

// ---- the last step

const StepReport& World::report() const { return impl_->report; }
std::optional<JointId> World::failed_joint() const {
  if (impl_->report.outcome.failure != Failure::kCustom) return std::nullopt;
  return impl_->failed_joint;
}
std::string World::failed_why() const {
  return impl_->report.outcome.failure == Failure::kCustom ? impl_->failed_why : "";
}
const std::vector<Contact>& World::contacts() const { return impl_->contacts; }
const std::vector<Event>& World::events() const { return impl_->events; }
double World::energy() const {
  const Energy now = energy_of(*impl_, *impl_);
  return now.kinetic + now.potential;
}

std::vector<Island> World::islands() const {
  if (impl_->edits.answers()) return impl_->edits.answers()->islands;
  if (!impl_->edits.any()) return impl_->islands;
  std::vector<Island> islands;
  for (const NextIsland& next : next_islands(*impl_)) islands.push_back(next.island);
  return islands;
}

std::vector<BodyId> World::unresolved_bodies() const {
  if (impl_->edits.answers()) return impl_->edits.answers()->unresolved_bodies;
  if (impl_->edits.any()) return {};  // indices of islands and bodies may be stale
  List<std::size_t> indices;
  for (std::size_t i = 0; i < impl_->islands.size(); ++i)
    if (impl_->islands[i].unresolved_bodies > 0) add_unresolved(*impl_, i, &indices);
  std::sort(indices.begin(), indices.end());
  std::vector<BodyId> ids;
  ids.reserve(indices.size());
  for (const std::size_t index : indices) ids.push_back(impl_->body_ids[index]);
  return ids;
}

std::vector<JointId> World::unclosed_joints() const {
  if (impl_->edits.is_edited() || impl_->report.joints.unclosed == 0) return {};
  return impl_->monitors.unclosed();
}

std::vector<StepWarning> World::warnings() const {
  using Kind = StepWarning::Kind;
  std::vector<StepWarning> list;
  if (impl_->edits.is_edited()) return list;
  const StepReport& report = impl_->report;
  const StepReport::Contacts& contacts = report.contacts;
  const auto add = [&](Kind kind, BodyId id, double value) {
    list.push_back({kind, body(id).name, value});
  };
  for (const JointId id : unclosed_joints())
    list.push_back({Kind::kUnclosed, joint(id).name, std::abs(joint_state(id).error)});
  if (report.energy.rise_body) add(Kind::kEnergyRise, *report.energy.rise_body, report.energy.rise);
  if (contacts.hits_left_body) add(Kind::kHitsLeft, *contacts.hits_left_body, contacts.hits);
  if (contacts.overlap_body) add(Kind::kOverlap, *contacts.overlap_body, contacts.overlap);
  if (contacts.creep_body) add(Kind::kCreep, *contacts.creep_body, contacts.creep);
  if (contacts.unsolved_body)
    add(Kind::kUnsolved, *contacts.unsolved_body, contacts.solver_residual);
  if (report.unresolved_bodies > 0) {
    const std::vector<BodyId> unresolved = unresolved_bodies();
    if (!unresolved.empty())
      add(Kind::kUnresolved, unresolved.front(), static_cast<double>(unresolved.size()));
  }
  if (contacts.handed_over_body)
    add(Kind::kHandedOver, *contacts.handed_over_body, contacts.handed_over);
  return list;
}

}  // namespace constraint_sim::engine
