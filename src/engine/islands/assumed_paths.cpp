#include "engine/islands/assumed_paths.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "constraint_sim/engine/report.h"
#include "engine/islands/contact_groups.h"
#include "engine/islands/contact_reach.h"
#include "engine/islands/continuous_collision.h"
#include "engine/islands/divided_step.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/method_choice.h"
#include "engine/islands/motion_bounds.h"
#include "engine/islands/rollback.h"
#include "engine/islands/step.h"
#include "engine/islands/swept_hits.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kRoomOfPath = 1.25;  // assumed path of a repeat, as a multiple of the path found

bool is_moving_shape(const MovedBodies& in, int body) {
  return std::binary_search(in.moving_shapes.begin(), in.moving_shapes.end(), body);
}

/// State of a body at the start of the step.
const BodyState& start_of(const MovedBodies& in, int body) {
  return (is_moving_shape(in, body) ? in.rollback.states() : in.state.states)[body];
}

Separation separation_at_start(const MovedBodies& in, const Broadphase::Pair& pair) {
  return separation_of(in.step.model, pair, start_of(in, pair.first), start_of(in, pair.second));
}

Separation separation_at_end(const MovedBodies& in, const Broadphase::Pair& pair) {
  return separation_of(in.step.model, in.state, pair);
}

/// Largest distance of the points of a dynamic body from their start within the step [m]. An
/// integrated centre follows a cubic with the positions and velocities of both ends, which is no
/// longer than its control polygon. Bodies that impulses advance move straight.
double path_of(const MovedBodies& in, int body) {
  const Model& model = in.step.model;
  const double h = model.options.time_step;
  const BodyState &from = in.rollback.states()[body], &to = in.state.states[body];
  const Vector3d moved = to.position - from.position;
  double path = moved.norm(), spin = 0.0;
  if (!uses_impulses(in.lists.islands[in.step.topology.island_of(body)].method)) {
    const Vector3d m0 = h * from.linear_velocity, m1 = h * to.linear_velocity;
    path = (m0.norm() + (3.0 * moved - m0 - m1).norm() + m1.norm()) / 3.0;
    spin = std::max(from.angular_velocity.norm(), to.angular_velocity.norm());
  }
  const double radius = swing_radius(model.bodies[body]);
  if (radius == 0.0) return path;
  const double chord = 2.0 * (to.orientation * from.orientation.conjugate()).vec().norm();
  // Rotation moves a centred shape within its bounding sphere, so it comes at most one radius
  // nearer to others. Any other shape may swing by a diameter.
  const double most = is_centred(model.bodies[body]) ? 1.0 : 2.0;
  return path + std::min(std::max(h * spin, chord), most) * radius;
}

/// Path of a body that the stages before the motion assumed [m], without the room of groups.
double assumed_for(const MovedBodies& in, int body) {
  const WorldOptions& options = in.step.model.options;
  const double assumed = max_distance(in.step, in.rollback.states()[body], body, options.time_step);
  return std::max(assumed, kFastShare * in.continuous.thinnest());
}

/// Whether two shapes ended the step on other sides of each other than they began it.
bool has_changed_sides(const MovedBodies& in, const Broadphase::Pair& pair) {
  const Separation start = separation_at_start(in, pair), end = separation_at_end(in, pair);
  return start.normal.dot(end.normal) < 0.0;
}

/// Whether the overlap of a pair in contact by impulses grew within the step by as much as fast
/// bodies move.
bool is_pushed_in(const MovedBodies& in, const Broadphase::Pair& pair) {
  const Separation start = separation_at_start(in, pair), end = separation_at_end(in, pair);
  return end.gap < 0.0 && start.gap - end.gap > kFastShare * thinner_of(in.step.model, pair);
}

/// Whether an event-driven group advanced a pair.
bool is_followed(const ContactGroups& groups, const Broadphase::Pair& pair) {
  return std::any_of(
      groups.groups().begin(), groups.groups().end(), [&](const ContactGroup& group) {
        return !group.has_failed &&
               std::find(group.pairs.begin(), group.pairs.end(), pair) != group.pairs.end();
      });
}

}  // namespace

void AssumedPaths::set_shapes(const Model& model, const Topology& topology,
                              const IslandLists& lists, const List<int>& moving_shapes) {
  has_shapes_ = !moving_shapes.empty();
  on_joints_.clear();
  for (const int body : moving_shapes)
    if (model.is_movable(to_index(body)) &&
        !lists.island_parts[topology.island_of(body)].members.joints.empty())
      on_joints_.push_back(body);
}

std::optional<int> AssumedPaths::find_missed(const MovedBodies& in, Broadphase* broadphase) {
  list_outrun(in);
  if (outrun_.empty() || !are_in_range(in.state, in.moving_shapes)) return std::nullopt;
  for (const Broadphase::Pair& pair : find_near(in, broadphase)) {
    if (!is_missed(in, pair)) continue;
    const auto has_outrun = [&](const Outrun& outrun) { return outrun.body == pair.first; };
    return std::any_of(outrun_.begin(), outrun_.end(), has_outrun) ? pair.first : pair.second;
  }
  return std::nullopt;
}

void AssumedPaths::list_outrun(const MovedBodies& in) {
  outrun_.clear();
  const auto look_at = [&](int body) {
    const double path = path_of(in, body);
    if (path > assumed_for(in, body)) outrun_.push_back({body, path});
  };
  for (const int body : on_joints_) look_at(body);
  for (const Wrench& wrench : in.state.wrenches) {
    const int body = static_cast<int>(in.step.model.index(wrench.body));
    if (is_moving_shape(in, body) && in.step.model.is_movable(to_index(body)) &&
        !std::binary_search(on_joints_.begin(), on_joints_.end(), body))
      look_at(body);
  }
}

// Pairs whose paths come near each other, where one of both bodies has outrun its assumed path.
const List<Broadphase::Pair>& AssumedPaths::find_near(const MovedBodies& in,
                                                      Broadphase* broadphase) {
  const Model& model = in.step.model;
  found_.assign(model.bodies.size(), 0.0);
  proxies_.clear();
  for (const int body : in.moving_shapes) {
    const bool is_movable = model.is_movable(to_index(body));
    found_[body] =
        is_movable ? path_of(in, body)
                   : max_distance(in.step, in.state.states[body], body, model.options.time_step);
    add_proxies(model, in.rollback.states()[body], body, found_[body], &proxies_);
  }
  const List<Broadphase::Pair>& near = broadphase->find_pairs(proxies_);
  if (broadphase->is_full()) throw StepFailed{Failure::kTooManyPairs};
  return near;
}

// Whether a pair may have met without being looked at.
bool AssumedPaths::is_missed(const MovedBodies& in, const Broadphase::Pair& pair) const {
  const auto is_of_pair = [&](const Outrun& outrun) {
    return outrun.body == pair.first || outrun.body == pair.second;
  };
  if (std::none_of(outrun_.begin(), outrun_.end(), is_of_pair)) return false;
  const int a = pair.first, b = pair.second;
  const Model& model = in.step.model;
  const Topology& topology = in.step.topology;
  if (topology.is_unpaired(pair.bodies())) return false;
  if (find_contact(in.state.touching, pair) != nullptr || in.continuous.has_met(pair))
    return is_pushed_in(in, pair) || has_changed_sides(in, pair);
  const double most = found_[a] + found_[b];
  const bool is_fast_pair = most > kFastShare * thinner_of(model, pair);
  const List<Broadphase::Pair>& on_joints = in.continuous.jointed_pairs();
  const bool is_left = in.continuous.first_body_with_missed_hits() &&
                       (in.continuous.divides(a) || in.continuous.divides(b));
  if (is_left && std::binary_search(on_joints.begin(), on_joints.end(), pair)) return true;
  const bool follows = follows_contacts(model.options);
  // a body that is slow comes to lie within a shape, and impulses push it out again
  if (!is_fast_pair && !follows) return false;
  const double gap = separation_at_start(in, pair).gap;
  if (gap > most) return false;
  if (follows && gap > in.reach.travel_bound(a) + in.reach.travel_bound(b)) return true;
  if (!is_fast_pair) return false;
  return is_followed(in.groups, pair) ? has_changed_sides(in, pair)
                                      : passes(in.step, in.state, in.rollback, pair);
}

bool AssumedPaths::lengthen(std::size_t bodies) {
  if (repeats_ == kMostRepeats) return false;
  ++repeats_;
  paths_.resize(bodies, 0.0);
  for (const auto& [body, path] : outrun_)
    paths_[body] = std::max(paths_[body], kRoomOfPath * path);
  return true;
}

}  // namespace constraint_sim::engine
