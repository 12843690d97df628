#include "engine/world/robot_members.h"

#include <algorithm>
#include <string>

#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/islands/topology.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

constexpr const char* kField = "body";

std::string described(const Joint& joint) {
  return "constraint " + in_quotes(joint.name) + " (" + name(joint.kind) + ")";
}

/// Whether a joint holds nothing and has no laws. It measures a length, or lets two bodies pass
/// through each other.
bool is_idle(const Joint& joint) {
  const CoordinateLaw& law = joint.coordinates[0];
  return info(joint.kind).is_free_length && !law.motor && !is_one_sided(law) &&
         soft_law(law).is_none();
}

/// Walks along the joints of a robot.
class RobotWalk {
 public:
  RobotWalk(const Model& model, const State& state)
      : model_(model), joints_on_(model.bodies.size()), ends_(model.joints.size()) {
    is_reached_.assign(model.bodies.size(), false);
    const List<bool> is_coupled = find_couplings(state);
    for (std::size_t j = 0; j < model.joints.size(); ++j) {
      const Joint& joint = model.joints[j];
      if (!acts(joint, state.joint_states[j]) || info(joint.kind).couples_joints) continue;
      if (is_idle(joint) && !is_coupled[j]) continue;
      ends_[j] = ends_of(model, joint);
      for (const std::size_t body : {ends_[j].first, ends_[j].second})
        if (model.is_movable(body)) joints_on_[body].push_back(j);
    }
  }

  /// Reaches the trees of bodies, and trees that gears couple with them.
  List<std::size_t> joints_from(const List<std::size_t>& bodies) {
    for (const std::size_t body : bodies)
      if (!is_reached_[body]) reach_tree(body);
    for (bool has_grown = true; has_grown;) {
      has_grown = false;
      for (const std::size_t gear : gears_) has_grown = reach_over(gear) || has_grown;
    }
    if (trees_ > 1 && free_root_ != kNoIndex)
      refuse(kField,
             in_quotes(model_.bodies[free_root_].name) +
                 " is part of a tree that hangs on nothing, beside other trees of the robot");
    std::sort(found_.begin(), found_.end());
    return found_;
  }

 private:
  /// Lists acting gears and pulleys, and returns which joints they couple.
  List<bool> find_couplings(const State& state) {
    List<bool> is_coupled(model_.joints.size(), false);
    for (std::size_t j = 0; j < model_.joints.size(); ++j) {
      if (!info(model_.joints[j].kind).couples_joints ||
          !acts(model_.joints[j], state.joint_states[j]))
        continue;
      gears_.push_back(j);
      for (const CoupledTerm& term : model_.terms_of(j)) is_coupled[term.joint] = true;
    }
    return is_coupled;
  }

  bool has(std::size_t joint) const {
    return std::find(found_.begin(), found_.end(), joint) != found_.end();
  }

  /// Adds a gear that couples a joint of the robot, with the tree of its other joint. Returns false
  /// where nothing is new.
  bool reach_over(std::size_t gear) {
    const CoupledTerms terms = model_.terms_of(gear);
    if (has(gear) || (!has(terms[0].joint) && !has(terms[1].joint))) return false;
    found_.push_back(gear);
    for (const CoupledTerm& term : terms) {
      const auto [a, b] = ends_[term.joint];
      const std::size_t body = model_.is_movable(a) ? a : b;
      if (!is_reached_[body]) reach_tree(body);
    }
    return true;
  }

  /// Finds all bodies and joints of the tree that contains `root`. Rejects loops, and a tree that
  /// hangs on two immovable bodies.
  void reach_tree(std::size_t root) {
    List<std::size_t> queue{root};
    is_reached_[root] = true;
    std::size_t base = kNoIndex;  // joint to the immovable body
    for (std::size_t next = 0; next < queue.size(); ++next) {
      const std::size_t body = queue[next];
      for (const std::size_t j : joints_on_[body]) {
        if (has(j)) continue;
        check_kind(model_.joints[j]);
        found_.push_back(j);
        const auto [a, b] = ends_[j];
        const std::size_t other = a == body ? b : a;
        if (!model_.is_movable(other)) {
          if (base != kNoIndex) refuse_loop(j);
          base = j;
        } else if (is_reached_[other]) {
          refuse_loop(j);
        } else {
          is_reached_[other] = true;
          queue.push_back(other);
        }
      }
    }
    ++trees_;
    if (base == kNoIndex) free_root_ = root;
  }

  void check_kind(const Joint& joint) const {
    if (has_length(joint.kind) || info(joint.kind).is_free_length)
      refuse(kField, described(joint) +
                         " acts between two points; the joints of a robot must be kinds with axes "
                         "or ball joints");
    if (info(joint.kind).is_custom)
      refuse(kField, described(joint) +
                         " is a function of another package, which has no place in "
                         "the mass matrix");
  }

  [[noreturn]] void refuse_loop(std::size_t j) const {
    const Joint& joint = model_.joints[j];
    const auto name_of = [&](std::size_t body) { return in_quotes(model_.bodies[body].name); };
    refuse(kField, described(joint) + " closes a loop between " + name_of(ends_[j].first) +
                       " and " + name_of(ends_[j].second) +
                       "; the joints of a robot must form a tree");
  }

  const Model& model_;
  List<List<std::size_t>> joints_on_;  // per movable body: acting joints but couplings
  List<JointEnds> ends_;
  List<std::size_t> gears_;
  List<bool> is_reached_;
  List<std::size_t> found_;
  std::size_t trees_ = 0;
  std::size_t free_root_ = kNoIndex;  // body of a tree that hangs on nothing
};

}  // namespace

List<std::size_t> dynamic_bodies(const Model& model, const std::vector<BodyId>& ids) {
  if (ids.empty()) refuse(kField, "must name a body of the robot, got none");
  List<std::size_t> found;
  for (const BodyId id : ids)
    if (const std::size_t body = model.index(id); model.is_movable(body)) found.push_back(body);
  if (found.empty())
    refuse(kField, "must be a dynamic body of the robot, got " +
                       in_quotes(model.bodies[model.index(ids.front())].name));
  return found;
}

List<std::size_t> joints_of_robot(const Model& model, const State& state,
                                  const List<std::size_t>& bodies) {
  return RobotWalk(model, state).joints_from(bodies);
}

RobotJoints robot_joints(const Model& model, const List<std::size_t>& joints) {
  RobotJoints robot;
  for (const std::size_t j : joints) {
    Joint joint = model.joints[j];
    for (CoordinateLaw& law : joint.coordinates) law.motor.reset();
    robot.joints.push_back(joint);
    robot.ends.push_back(ends_of(model, joint));
    CoupledTerms terms{};
    if (info(joint.kind).couples) terms = model.terms_of(j);
    for (CoupledTerm& term : terms)
      term.joint =
          to_index(std::lower_bound(joints.begin(), joints.end(), term.joint) - joints.begin());
    robot.couplings.push_back(terms);
  }
  return robot;
}

void check_robot(const Model& model, const List<std::size_t>& joints, const RobotTree& robot) {
  if (robot.rotating() < robot.bodies().size()) {
    const int body = robot.bodies()[robot.rotating()];
    refuse(kField, in_quotes(model.bodies[body].name) +
                       " is a point mass, or is held at its centre of mass by ball joints only, so "
                       "that its rotation is not part of the robot");
  }
  if (robot.nodes().empty()) refuse(kField, "the joints of the robot do not form trees");
  for (const TreeNode& node : robot.nodes()) {
    const auto turns = std::count_if(
        node.directions.begin(), node.directions.begin() + static_cast<std::ptrdiff_t>(node.count),
        [](const auto& direction) { return direction.turns; });
    if (node.sense > 0.0 || turns < 3 || node.count == 3) continue;
    const std::size_t j = joints[robot.joints()[node.link]];
    refuse(kField, described(model.joints[j]) +
                       " has its body A farther from the base than body B; exchange both bodies");
  }
  const std::size_t free = robot.tree().motions.size();
  if (free > 0) return;
  const auto has_freedom = std::any_of(robot.nodes().begin(), robot.nodes().end(),
                                       [](const TreeNode& node) { return node.count > 0; });
  refuse(kField,
         has_freedom ? "gears form a loop" : "no joint of the robot leaves a coordinate free");
}

}  // namespace constraint_sim::engine
