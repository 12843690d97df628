#include "tree.h"

namespace constraint_sim::report {

using Eigen::Vector3d;

namespace {

const Body& body_of(const Problem& problem, int i) {
  return problem.bodies[static_cast<std::size_t>(i)];
}

bool is_point(const Problem& problem, int i) { return body_of(problem, i).inertia.isZero(0.0); }

/// Returns the link that hangs on this joint; `is_turned`: its child is body A.
Link hang(const Problem& problem, const Joint& joint, bool is_turned) {
  const int parent = is_turned ? joint.b : joint.a;
  const int child = is_turned ? joint.a : joint.b;
  const Vector3d& anchor_parent = is_turned ? joint.anchor_b : joint.anchor_a;
  const Vector3d& anchor_child = is_turned ? joint.anchor_a : joint.anchor_b;
  Link link{child, parent, true, anchor_parent, -anchor_child};
  if (joint.kind == JointKind::kBall) return link;
  if (has_axes(joint.kind)) {
    if (is_turned) throw Unsupported("a joint with axes whose A hangs on B");
    const State& start = body_of(problem, child).start;
    const bool has_one = joint.kind == JointKind::kSlider || joint.kind == JointKind::kHinge;
    if (has_one && parent == kWorld) {
      const Vector3d axis = joint.frame_a * Vector3d::UnitZ();
      link.rate =
          axis.dot(joint.kind == JointKind::kSlider ? start.velocity : start.angular_velocity);
    } else if (!start.velocity.isZero(0.0) || !start.angular_velocity.isZero(0.0)) {
      throw Unsupported("joints with axes whose bodies move at the start");
    }
    link.joint = &joint;
    return link;
  }
  if (!is_point(problem, child)) throw Unsupported("a rod to a body that rotates");
  Vector3d joint_W = anchor_parent;
  if (parent != kWorld) {
    const State& state = body_of(problem, parent).start;
    joint_W = state.position + state.orientation * anchor_parent;
  }
  link.centre = body_of(problem, child).start.position - joint_W;
  const double length = link.centre.norm();
  if (joint.length >= 0.0 && std::abs(joint.length - length) > 1e-9 * length)
    throw Unsupported("a rod of another length than at the start");
  return link;
}

}  // namespace

std::vector<Link> tree_of(const Problem& problem, std::vector<Joint>* loops,
                          bool leaves_out_springs) {
  for (const Joint& joint : problem.joints) {
    const bool has_coordinate = has_axes(joint.kind) || joint.kind == JointKind::kFreeLength;
    if ((joint.kind == JointKind::kSpring && !leaves_out_springs) || joint.break_force != 0.0 ||
        (!has_coordinate && (joint.rate != 0.0 || joint.max_force != 0.0)))
      throw Unsupported("springs, motors of rods and breaking in joint coordinates");
  }
  std::vector<Link> tree;
  std::vector<bool> is_placed(problem.bodies.size(), false), is_used(problem.joints.size(), false);
  for (std::size_t k = 0; k < problem.joints.size(); ++k)  // springs and free lengths hold nothing
    is_used[k] = problem.joints[k].kind == JointKind::kFreeLength ||
                 problem.joints[k].kind == JointKind::kSpring;
  const auto placed = [&](int i) { return i == kWorld || is_placed[static_cast<std::size_t>(i)]; };
  const auto place = [&](const Link& link) {
    tree.push_back(link);
    is_placed[static_cast<std::size_t>(link.body)] = true;
  };
  for (std::size_t i = 0; i < problem.bodies.size(); ++i)
    if (problem.bodies[i].is_static)
      place({static_cast<int>(i), kWorld, false, Vector3d::Zero(), Vector3d::Zero()});
  std::size_t free = 0;
  while (true) {
    bool has_grown = false;
    for (std::size_t k = 0; k < problem.joints.size(); ++k) {
      const Joint& joint = problem.joints[k];
      if (is_used[k] || placed(joint.a) == placed(joint.b)) continue;
      is_used[k] = true;
      place(hang(problem, joint, placed(joint.b)));
      has_grown = true;
    }
    if (has_grown) continue;
    // The remaining bodies start with a free one.
    while (free < is_placed.size() && is_placed[free]) ++free;
    if (free == is_placed.size()) break;
    place({static_cast<int>(free), kWorld, false, Vector3d::Zero(), Vector3d::Zero()});
  }
  for (std::size_t k = 0; k < problem.joints.size(); ++k) {
    if (is_used[k]) continue;
    if (loops == nullptr) throw Unsupported("closed loops in joint coordinates");
    loops->push_back(problem.joints[k]);
  }
  return tree;
}

Vector3d inertia_of(const Problem& problem, const Body& body) {
  if (!body.inertia.isZero(0.0)) return body.inertia;
  return Vector3d::Constant(problem.point_gyration * problem.point_gyration *
                            std::max(body.mass, 1e-3));
}

Vector3d start_spin(const Problem& problem, const Link& link) {
  const Body& body = body_of(problem, link.body);
  if (!is_point(problem, link.body) || !link.is_hung) return body.start.angular_velocity;
  Vector3d joint_velocity = Vector3d::Zero();
  if (link.parent != kWorld) {
    const State& state = body_of(problem, link.parent).start;
    joint_velocity = state.velocity;
    if (!is_point(problem, link.parent))
      joint_velocity += state.angular_velocity.cross(state.orientation * link.anchor);
  }
  const Vector3d relative = body.start.velocity - joint_velocity;
  return link.centre.cross(relative) / link.centre.squaredNorm();
}

}  // namespace constraint_sim::report
