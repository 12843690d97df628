#include "urdf/sdf.h"

#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "constraint_sim/engine/joint.h"
#include "sim/words.h"
#include "urdf/lumps.h"
#include "urdf/parse.h"
#include "urdf/sdf_constraints.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

const std::string kSdfWorld = "world";

std::string joint_named(const std::string& name) { return "joint '" + shortened(name, 100) + "'"; }

urdf::Pose urdf_pose_of(const Isometry3d& pose) {
  const Vector3d& p = pose.translation();
  const Quaterniond q(pose.linear());
  urdf::Pose converted;
  converted.position = urdf::Vector3(p.x(), p.y(), p.z());
  converted.rotation.setFromQuaternion(q.x(), q.y(), q.z(), q.w());
  return converted;
}

/// Returns a frame with its z axis along `z` and its x axis next to `x`.
Matrix3d frame_of_axes(const Vector3d& z, const Vector3d& x) {
  Matrix3d frame;
  frame.col(2) = z.normalized();
  frame.col(0) = (x - x.dot(frame.col(2)) * frame.col(2)).normalized();
  frame.col(1) = frame.col(2).cross(frame.col(0));
  return frame;
}

class SdfConverter {
 public:
  SdfConverter(const SdfModel& given, const engine::BodyState& pose, bool is_fixed)
      : given_(given),
        is_fixed_(is_fixed),
        at_(Eigen::Translation3d(pose.position) * pose.orientation) {
    result_.model = std::make_shared<urdf::ModelInterface>();
    result_.model->name_ = given.name;
    result_.warnings = given.warnings;
    for (const auto& [link, properties] : given.properties) result_.extra.links[link] = properties;
  }

  SdfRobot convert() {
    for (const SdfLink& link : given_.links) add_link(link);
    attach_static_links();
    for (const SdfJoint& joint : given_.joints) {
      check_ends(joint);
      if (joint.kind == SdfJointKind::kGearbox) continue;
      const bool is_in_tree =
          parents_.count(joint.child) == 0 && !is_behind(joint.parent, joint.child);
      if (is_in_tree) add_to_tree(joint);
      const bool is_of_urdf = joint.kind == SdfJointKind::kFixed ||
                              joint.kind == SdfJointKind::kHinge ||
                              joint.kind == SdfJointKind::kSlider;
      if (!is_in_tree || !is_of_urdf) add_constraint(joint);
    }
    for (const SdfJoint& joint : given_.joints)
      if (joint.kind == SdfJointKind::kGearbox) add_gearbox(joint);
    add_root();
    add_no_contact();
    result_.extra.constraints = constraints_.take();
    std::map<std::string, std::string> tree;
    result_.model->initTree(tree);
    result_.model->initRoot(tree);
    return std::move(result_);
  }

 private:
  // ---- links

  void add_link(const SdfLink& link) {
    const std::string& name = link.link->name;
    if (name == kSdfWorld) refuse("the SDF has a link 'world', which is the world itself");
    check_name("link", name);
    if (!result_.model->links_.emplace(name, link.link).second)
      refuse("the SDF has two links '" + shortened(name, 100) + "'");
    links_.emplace(name, &link);
    poses_.emplace(name, at_ * link.pose);
  }

  static void check_name(const std::string& kind, const std::string& name) {
    const std::string legal = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_./-";
    if (name.empty() || name.find_first_not_of(legal) != std::string::npos)
      refuse(kind + " '" + shortened(name, 100) + "': names have letters, digits, _, ., / and -");
  }

  const Isometry3d& pose_of(const std::string& link) const {
    static const Isometry3d at_origin = Isometry3d::Identity();
    return link == kSdfWorld ? at_origin : poses_.at(link);
  }

  Isometry3d in_link(const std::string& link, const Isometry3d& pose) const {
    return pose_of(link).inverse() * pose;
  }

  // Fixes the links of a static model to its first link.
  void attach_static_links() {
    std::map<std::size_t, std::string> firsts;
    for (const SdfLink& link : given_.links) {
      if (!link.is_static) continue;
      const std::string& name = link.link->name;
      const auto [first, is_first] = firsts.emplace(link.model, name);
      if (!is_first) attach(name + "/static", first->second, name, urdf::Joint::FIXED);
    }
  }

  // Gives the tree one root: the link without a joint to its parent, or the world.
  void add_root() {
    std::vector<const SdfLink*> roots;
    for (const SdfLink& link : given_.links)
      if (parents_.count(link.link->name) == 0) roots.push_back(&link);
    if (roots.size() == 1 && !has_world_) {
      const Isometry3d& pose = poses_.at(roots[0]->link->name);
      result_.pose.position = pose.translation();
      result_.pose.orientation = Quaterniond(pose.linear()).normalized();
      result_.is_fixed = is_fixed_ || roots[0]->is_static;
      return;
    }
    add_empty_link(kSdfWorld);
    for (const SdfLink* root : roots) {
      const std::string& name = root->link->name;
      if (root->is_static) result_.extra.static_links.insert(name);
      if (is_fixed_ && !root->is_static)
        attach(name + "/static", kSdfWorld, name, urdf::Joint::FIXED);
      else
        attach(name + "/free", kSdfWorld, name, urdf::Joint::FLOATING);
    }
    if (given_.links.back().model == 0) return;
    for (const SdfLink& link : given_.links) result_.extra.models[link.link->name] = link.model;
  }

  void add_empty_link(const std::string& name) {
    const auto link = std::make_shared<urdf::Link>();
    link->name = name;
    if (!result_.model->links_.emplace(name, link).second)
      refuse("the SDF has two links or joints '" + shortened(name, 100) + "'");
  }

  void add_no_contact() {
    constexpr std::size_t kMostListed = 10000;  // more than a robot may have
    std::vector<const SdfLink*> shaped;
    for (const SdfLink& link : given_.links)
      if (!link.is_static && !link.link->collision_array.empty()) shaped.push_back(&link);
    auto& pairs = result_.extra.no_contact;
    for (std::size_t i = 0; i < shaped.size(); ++i)
      for (std::size_t j = i + 1; j < shaped.size() && pairs.size() < kMostListed; ++j)
        if (shaped[i]->model == shaped[j]->model && !shaped[i]->is_self_collide &&
            !shaped[j]->is_self_collide)
          pairs.emplace_back(shaped[i]->link->name, shaped[j]->link->name);
  }

  // ---- joints

  void check_ends(const SdfJoint& joint) const {
    check_name("joint", joint.name);
    for (const std::string& end : {joint.parent, joint.child})
      if ((end != kSdfWorld || &end == &joint.child) && links_.count(end) == 0)
        refuse(joint_named(joint.name) + ": there is no link '" + shortened(end, 100) + "'");
    if (joint.parent == joint.child)
      refuse(joint_named(joint.name) + " joins link '" + joint.child + "' to itself");
  }

  // Returns whether a link is another one, or behind it in the tree.
  bool is_behind(std::string link, const std::string& other) const {
    while (link != other) {
      const auto parent = parents_.find(link);
      if (parent == parents_.end()) return false;
      link = parent->second;
    }
    return true;
  }

  urdf::JointSharedPtr add_urdf_joint(const std::string& name, const std::string& parent,
                                      const std::string& child, const Isometry3d& origin) {
    const auto joint = std::make_shared<urdf::Joint>();
    joint->name = name;
    joint->parent_link_name = parent;
    joint->child_link_name = child;
    joint->parent_to_joint_origin_transform = urdf_pose_of(origin);
    if (!result_.model->joints_.emplace(name, joint).second)
      refuse("the SDF has two joints '" + shortened(name, 100) + "'");
    return joint;
  }

  template <class Type>
  void attach(const std::string& name, const std::string& parent, const std::string& child,
              Type type) {
    add_urdf_joint(name, parent, child, in_link(parent, poses_.at(child)))->type = type;
    parents_[child] = parent;
  }

  void add_to_tree(const SdfJoint& given) {
    has_world_ = has_world_ || given.parent == kSdfWorld;
    if (given.kind == SdfJointKind::kFixed)
      return attach(given.name, given.parent, given.child, urdf::Joint::FIXED);
    if (given.kind != SdfJointKind::kHinge && given.kind != SdfJointKind::kSlider)
      return attach(given.name + "/free", given.parent, given.child, urdf::Joint::FLOATING);
    parents_[given.child] = given.parent;
    constexpr double kRounding = 1e-12;  // rounding of equal poses
    const Isometry3d frame = at_ * given.frame;
    const bool is_at_child =
        in_link(given.child, frame).isApprox(Isometry3d::Identity(), kRounding);
    const std::string child = is_at_child ? given.child : joint_frame_link(given.name);
    const urdf::JointSharedPtr joint =
        add_urdf_joint(given.name, given.parent, child,
                       in_link(given.parent, is_at_child ? poses_.at(given.child) : frame));
    if (!is_at_child) {
      add_empty_link(child);
      add_urdf_joint(child + "/link", child, given.child, frame.inverse() * poses_.at(given.child))
          ->type = urdf::Joint::FIXED;
    }
    set_laws(given.axes.at(0), given.kind == SdfJointKind::kSlider, joint.get());
  }

  void set_laws(const SdfAxis& axis, bool is_slider, urdf::Joint* joint) {
    const bool is_limited = std::isfinite(axis.lower) || std::isfinite(axis.upper);
    joint->type = is_slider    ? urdf::Joint::PRISMATIC
                  : is_limited ? urdf::Joint::REVOLUTE
                               : urdf::Joint::CONTINUOUS;
    joint->axis = urdf::Vector3(axis.direction.x(), axis.direction.y(), axis.direction.z());
    if (is_limited || axis.effort > 0.0 || axis.velocity > 0.0) {
      joint->limits = std::make_shared<urdf::JointLimits>();
      joint->limits->lower = axis.lower;
      joint->limits->upper = axis.upper;
      joint->limits->effort = axis.effort;
      joint->limits->velocity = axis.velocity;
    }
    if (axis.damping != 0.0 || axis.friction != 0.0) {
      joint->dynamics = std::make_shared<urdf::JointDynamics>();
      joint->dynamics->damping = axis.damping;
      joint->dynamics->friction = axis.friction;
    }
    if (axis.spring.stiffness != 0.0) result_.extra.springs[joint->name] = axis.spring;
  }

  // Writes a joint that closes a loop, or of a kind that URDF lacks.
  void add_constraint(const SdfJoint& given) {
    const auto write = [&](const char* type, const Matrix3d& on_a, const Matrix3d& on_b) {
      constraints_.begin(given.name, type);
      const bool has_frame = given.kind != SdfJointKind::kBall;
      constraints_.add_end(
          "a", {given.parent, in_link(given.parent, at_ * given.frame * Isometry3d(on_a))},
          has_frame);
      constraints_.add_end(
          "b", {given.child, in_link(given.child, at_ * given.frame * Isometry3d(on_b))},
          has_frame);
    };
    const auto along = [&] {
      return engine::frame_along(given.axes.at(0).direction).toRotationMatrix();
    };
    switch (given.kind) {
      case SdfJointKind::kFixed:
        return write("weld", Matrix3d::Identity(), Matrix3d::Identity());
      case SdfJointKind::kBall:
        return write("ball", Matrix3d::Identity(), Matrix3d::Identity());
      case SdfJointKind::kHinge:
      case SdfJointKind::kSlider:
        write(given.kind == SdfJointKind::kHinge ? "hinge" : "slider", along(), along());
        return constraints_.add_coordinates({given.axes[0]});
      case SdfJointKind::kUniversal: {
        const Vector3d first = given.axes.at(0).direction.normalized();
        const Vector3d second = given.axes.at(1).direction.normalized();
        constexpr double kRightAngle = 1e-6;  // axes have six digits
        if (!(std::abs(first.dot(second)) < kRightAngle))
          refuse(joint_named(given.name) +
                 ": axis2: must be at a right angle to axis, got a cosine of " +
                 std::to_string(first.dot(second)));
        write("universal", frame_of_axes(first, second), frame_of_axes(second, first));
        return constraints_.add_coordinates({given.axes[0], given.axes[1]});
      }
      case SdfJointKind::kScrew:
        write("screw", along(), along());
        constraints_.add("pitch", given.ratio);
        return constraints_.add_coordinates({SdfAxis{}, given.axes[0]});
      default:
        return;
    }
  }

  // A gearbox couples the two hinges between its reference body and its links:
  // θ₂ + ratio θ₁ = constant.
  void add_gearbox(const SdfJoint& given) {
    const std::optional<Shaft> first = shaft(given, given.parent, given.axes.at(0));
    const std::optional<Shaft> second = shaft(given, given.child, given.axes.at(1));
    if (!first || !second) {
      result_.warnings.push_back(joint_named(given.name) +
                                 " is left out: a gearbox needs a revolute joint along its axis "
                                 "between gearbox_reference_body '" +
                                 shortened(given.reference_body) + "' and each of its links");
      return;
    }
    constraints_.begin(given.name, "gear");
    constraints_.add_joints(second->joint, first->joint);
    constraints_.add("ratio", given.ratio * first->sign * second->sign);
  }

  /// Hinge between the reference body of a gearbox and a link.
  struct Shaft {
    std::string joint;
    double sign;  ///< sign of the hinge's angle in the angle of the gearbox
  };

  std::optional<Shaft> shaft(const SdfJoint& gearbox, const std::string& link,
                             const SdfAxis& axis) const {
    constexpr double kParallel = 1e-6;
    const Vector3d wanted = gearbox.frame.linear() * axis.direction.normalized();
    for (const SdfJoint& joint : given_.joints) {
      if (joint.kind != SdfJointKind::kHinge) continue;
      const bool is_forward = joint.parent == gearbox.reference_body && joint.child == link;
      const bool is_reverse = joint.child == gearbox.reference_body && joint.parent == link;
      if (!is_forward && !is_reverse) continue;
      const double along =
          wanted.dot(joint.frame.linear() * joint.axes.at(0).direction.normalized());
      if (std::abs(std::abs(along) - 1.0) > kParallel) continue;
      return Shaft{joint.name, (along > 0.0) == is_forward ? 1.0 : -1.0};
    }
    return std::nullopt;
  }

  const SdfModel& given_;
  bool is_fixed_;
  Isometry3d at_;  // pose of the frame of the SDF
  SdfRobot result_;
  SdfConstraints constraints_;
  std::map<std::string, const SdfLink*> links_;
  std::map<std::string, Isometry3d> poses_;     // poses of links
  std::map<std::string, std::string> parents_;  // parents in the tree, by link
  bool has_world_ = false;                      // whether a joint of the tree begins at the world
};

}  // namespace

SdfRobot robot_of_sdf(const SdfModel& given, const engine::BodyState& pose, bool is_fixed) {
  return SdfConverter(given, pose, is_fixed).convert();
}

void add_sdf_extra(const RobotExtra& sdf, RobotExtra* extra) {
  extra->springs = sdf.springs;
  extra->static_links = sdf.static_links;
  extra->models = sdf.models;
  extra->links.insert(sdf.links.begin(), sdf.links.end());
  extra->no_contact.insert(extra->no_contact.end(), sdf.no_contact.begin(), sdf.no_contact.end());
  extra->constraints.insert(extra->constraints.begin(), sdf.constraints.begin(),
                            sdf.constraints.end());
}

}  // namespace constraint_sim
