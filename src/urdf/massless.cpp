#include "urdf/massless.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "sim/words.h"
#include "urdf/lumps.h"
#include "urdf/parse.h"
#include "urdf/positions.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Column = Eigen::Matrix<double, 6, 1>;

constexpr std::size_t kNoLump = std::numeric_limits<std::size_t>::max();
constexpr std::size_t kLongestList = 1000;  // length of a list of names [characters]

std::string quoted_name(const std::string& name) { return "'" + name + "'"; }

std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

[[noreturn]] void refuse_massless(const std::string& link) {
  refuse("link " + quoted_name(link) +
         " moves and has no mass: it needs an <inertial> with a mass > 0");
}

void append(const std::string& item, std::string* list) {
  *list += (list->empty() ? "" : ", ") + item;
}

/// Returns the smallest principal moment about the centre of mass, or about the origin of a link
/// without mass [kg m²].
double least_moment(const Lump& lump) {
  const Matrix3d inertia = lump.mass > 0.0 ? lump.inertia() : lump.second_moment;
  return Eigen::SelfAdjointEigenSolver<Matrix3d>(inertia, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .minCoeff();
}

/// Returns the links and joints that constraints of the extra YAML name.
std::set<std::string> names_in(const std::vector<engine::YamlElement>& constraints) {
  std::set<std::string> names;
  for (const engine::YamlElement& item : constraints) {
    for (const char* key : {"body_a", "body_b"})
      if (const auto body = item.find(key)) names.insert(body->word());
    if (const auto joints = item.find("joints"))
      for (const engine::YamlElement& joint : joints->items()) names.insert(joint.word());
  }
  return names;
}

/// Bodies of a robot as a tree of movable joints.
class MassTree {
 public:
  MassTree(const urdf::ModelInterface& model, const RobotExtra& extra, bool is_fixed,
           MeshShapes* meshes)
      : lumps_(lump_links(model, meshes)),
        is_fixed_(is_fixed),
        static_links_(extra.static_links),
        children_(size()),
        kept_(size(), 0) {
    const std::set<std::string> named = names_in(extra.constraints);
    for (std::size_t i = 0; i < size(); ++i) {
      const Lump& lump = lumps_.list[i];
      const bool is_named =
          std::any_of(lump.links.begin(), lump.links.end(),
                      [&](const std::string& link) { return named.count(link) > 0; }) ||
          (lump.joint && named.count(lump.joint->name) > 0);
      named_.push_back(is_named ? 1 : 0);
      has_mass_.push_back(lump.mass > 0.0 || least_moment(lump) > 0.0 ? 1 : 0);
      parents_.push_back(lump.joint ? lumps_.places.at(lump.joint->parent_link_name).lump
                                    : kNoLump);
      if (i > 0) children_[parents_[i]].push_back(i);
    }
    for (std::size_t i = size(); i-- > 0;) {
      if (has_mass_[i] != 0 || named_[i] != 0 || is_static(i)) kept_[i] = 1;
      if (kept_[i] != 0 && i > 0) kept_[parents_[i]] = 1;
    }
  }

  std::size_t size() const { return lumps_.list.size(); }
  const Lump& lump(std::size_t i) const { return lumps_.list[i]; }
  std::size_t parent(std::size_t i) const { return parents_[i]; }
  const std::vector<std::size_t>& children(std::size_t i) const { return children_[i]; }
  const Isometry3d& place(const std::string& link) const { return lumps_.places.at(link).in_lump; }

  bool is_static(std::size_t i) const {
    return (i == 0 && is_fixed_) || static_links_.count(lump(i).link) > 0;
  }
  bool is_named(std::size_t i) const { return named_[i] != 0; }
  /// Returns whether the body, or one behind it, has a mass or ends a constraint.
  bool is_kept(std::size_t i) const { return kept_[i] != 0; }
  bool has_mass(std::size_t i) const { return has_mass_[i] != 0; }
  bool needs_mass(std::size_t i) const { return !is_static(i) && !(lump(i).mass > 0.0); }
  bool is_free(std::size_t i) const {
    return !lump(i).joint || lump(i).joint->type == urdf::Joint::FLOATING;
  }

  /// Returns the children with masses behind them, on joints that are not floating.
  std::vector<std::size_t> joined_children(std::size_t i) const {
    std::vector<std::size_t> joined;
    for (const std::size_t child : children_[i])
      if (is_kept(child) && !is_free(child)) joined.push_back(child);
    return joined;
  }

 private:
  Lumps lumps_;
  bool is_fixed_;
  std::set<std::string> static_links_;
  std::vector<std::vector<std::size_t>> children_;
  std::vector<char> kept_, named_, has_mass_;
  std::vector<std::size_t> parents_;
};

/// Finds the joints that move no mass, and makes them fixed.
class MasslessJoints {
 public:
  MasslessJoints(bool is_fixed, urdf::ModelInterface* model, RobotExtra* extra, MeshShapes* meshes)
      : tree_(*model, *extra, is_fixed, meshes), model_(*model), extra_(*extra) {}

  MasslessLinks fix() {
    check_any_mass();
    for (std::size_t i = 0; i < tree_.size(); ++i) {
      if (i > 0 && !tree_.is_kept(i)) found_.insert(tree_.lump(i).joint->name);
      if (tree_.is_kept(i) && tree_.is_free(i) && !tree_.is_static(i)) unite_root(i);
    }
    if (found_.empty()) return std::move(result_);
    std::vector<std::string> told_later;
    const auto positions = first_positions(model_, extra_.positions, &told_later);
    add_followers();
    std::string list;
    for (const std::string& name : found_) fix(name, positions, &list);
    result_.warnings.push_back(
        "joints that move no mass are fixed, since these links have no <inertial>: " +
        shortened(list, kLongestList));
    return std::move(result_);
  }

 private:
  void check_any_mass() const {
    if (tree_.is_static(0) || tree_.is_kept(0)) return;
    refuse("link " + quoted_name(tree_.lump(0).link) +
           " moves and has no mass, and neither has any other link: one of them needs an "
           "<inertial> with a mass > 0");
  }

  // Unites a massless root that has one joint with the link behind the joint: their rotation
  // against each other moves no mass.
  void unite_root(std::size_t root) {
    for (std::size_t i = root; !tree_.has_mass(i) && !tree_.is_named(i);) {
      const std::vector<std::size_t> joined = tree_.joined_children(i);
      if (joined.empty() && root == 0) {
        result_.is_root_fixed = true;
        result_.warnings.push_back("link " + quoted_name(tree_.lump(0).link) +
                                   " has no mass and only floating joints: it does not move");
      }
      if (joined.size() != 1) return;
      i = joined.front();
      found_.insert(tree_.lump(i).joint->name);
    }
  }

  // Adds the joints that mimic a fixed joint.
  void add_followers() {
    for (bool is_new = true; is_new;) {
      is_new = false;
      for (const auto& [name, joint] : model_.joints_)
        if (joint->mimic && has_position(*joint) && found_.count(joint->mimic->joint_name) > 0)
          is_new = found_.insert(name).second || is_new;
    }
  }

  void fix(const std::string& name, const std::map<std::string, double>& positions,
           std::string* list) {
    urdf::Joint& joint = *model_.joints_.at(name);
    append(quoted_name(name), list);
    if (has_position(joint)) {
      const double q = positions.at(name);
      if (q != 0.0) {
        *list += " at " + short_number(q);
        move_origin(motion_of(joint, positions), &joint);
      }
      result_.fixed_joints[name] = q;
    }
    *list += " (link " + quoted_name(joint.child_link_name) + ")";
    joint.type = urdf::Joint::FIXED;
    joint.mimic.reset();
    extra_.positions.erase(name);
    if (extra_.motors.erase(name) > 0)
      result_.warnings.push_back("joint " + quoted_name(name) +
                                 " is fixed, since it moves no mass; its motor is left out");
  }

  static void move_origin(const Isometry3d& motion, urdf::Joint* joint) {
    urdf::Pose& origin = joint->parent_to_joint_origin_transform;
    const Isometry3d moved = to_isometry(origin) * motion;
    const Eigen::Quaterniond q(moved.linear());
    origin.position =
        urdf::Vector3(moved.translation().x(), moved.translation().y(), moved.translation().z());
    origin.rotation.setFromQuaternion(q.x(), q.y(), q.z(), q.w());
  }

  MassTree tree_;
  urdf::ModelInterface& model_;
  RobotExtra& extra_;
  std::set<std::string> found_;
  MasslessLinks result_;
};

/// Gives masses to the massless links between joints.
class SubstituteMasses {
 public:
  SubstituteMasses(bool is_fixed, urdf::ModelInterface* model, const RobotExtra& extra,
                   MeshShapes* meshes, std::vector<std::string>* warnings)
      : tree_(*model, extra, is_fixed, meshes),
        model_(*model),
        extra_(extra),
        warnings_(*warnings) {}

  void add() {
    std::string list;
    std::vector<char> is_checked(tree_.size(), 0);
    // children first, since a parent takes the mass of the lightest body behind it
    std::vector<Reference> lightest(tree_.size());
    Reference of_all;
    for (std::size_t i = tree_.size(); i-- > 0;) {
      const double moment = least_moment(tree_.lump(i));
      if (!tree_.is_static(i) && tree_.lump(i).mass == 0.0 && moment > 0.0)
        lightest[i] = {moment / (kRotorRadius * kRotorRadius), moment};
      else if (tree_.lump(i).mass > 0.0)
        lightest[i] = {tree_.lump(i).mass, moment};
      else if (tree_.needs_mass(i))
        for (const std::size_t child : tree_.children(i)) lightest[i].take(lightest[child]);
      of_all.take(lightest[i]);
    }
    for (std::size_t i = 0; i < tree_.size(); ++i) {
      if (!tree_.needs_mass(i)) continue;
      if (is_checked[i] == 0) check(i, &is_checked);
      const bool has_masses_behind = lightest[i].mass > 0.0;
      append(give_mass(tree_.lump(i).link, has_masses_behind ? lightest[i] : of_all), &list);
    }
    if (!list.empty())
      warnings_.push_back(
          "links between joints have no mass, and get " + short_number(kMasslessShare) +
          " of the mass of the lightest link behind them: " + shortened(list, kLongestList));
  }

 private:
  /// Mass and smallest principal moment of a body.
  struct Reference {
    double mass = 0.0, moment = 0.0;

    void take(const Reference& other) {
      if (!(other.mass > 0.0) || (mass > 0.0 && other.mass >= mass)) return;
      *this = other;
    }
  };

  std::string give_mass(const std::string& name, const Reference& reference) {
    if (!(reference.mass > 0.0)) refuse_massless(name);
    urdf::Link& link = *model_.links_.at(name);
    const double mass = kMasslessShare * reference.mass;
    const double moment = kMasslessShare * reference.moment;
    if (!link.inertial) link.inertial = std::make_shared<urdf::Inertial>();
    urdf::Inertial& inertial = *link.inertial;
    inertial.mass = mass;
    inertial.ixx += moment;
    inertial.iyy += moment;
    inertial.izz += moment;
    return quoted_name(name) + " " + short_number(mass) + " kg";
  }

  // ---- whether the joints of massless links move masses

  /// Joints on the way to a body: unknown, and twist of the body at its unit rate.
  using Path = std::vector<std::pair<std::size_t, Column>>;

  /// Joint rates of neighbouring massless links, and the bodies behind, that they must move.
  struct Unknowns {
    std::vector<std::string> names;            ///< joint of each unknown
    std::map<std::string, std::size_t> first;  ///< unknown of each joint
    std::vector<Path> twists;                  ///< path to each body with a mass or an inertia
    bool is_held = false;                      ///< constraints of the YAML hold a massless link
  };

  /// Returns the twists, about the origin of the world, of the motions of a joint.
  static std::vector<Column> motions(const urdf::Joint& joint, const Isometry3d& at) {
    const Vector3d z = at.linear() * (along_axis(joint) * Vector3d::UnitZ());
    const auto turn = [&](const Vector3d& axis) {
      return (Column() << at.translation().cross(axis), axis).finished();
    };
    const auto move = [](const Vector3d& axis) {
      return (Column() << axis, Vector3d::Zero()).finished();
    };
    switch (joint.type) {
      case urdf::Joint::REVOLUTE:
      case urdf::Joint::CONTINUOUS:
        return {turn(z)};
      case urdf::Joint::PRISMATIC:
        return {move(z)};
      case urdf::Joint::PLANAR: {
        const Vector3d x = z.unitOrthogonal();
        return {move(x), move(z.cross(x)), turn(z)};
      }
      default:
        return {};
    }
  }

  /// Returns the rotation alone: a link without mass may have an inertia.
  static Path rotation_of(Path path) {
    for (auto& entry : path) entry.second.head<3>().setZero();
    return path;
  }

  static void add_unknowns(const std::string& joint, const std::vector<Column>& columns, Path* path,
                           Unknowns* unknowns) {
    unknowns->first.emplace(joint, unknowns->names.size());
    for (const Column& column : columns) {
      path->emplace_back(unknowns->names.size(), column);
      unknowns->names.push_back(joint);
    }
  }

  // Walks from a massless body to those behind it, until bodies with masses.
  void walk(std::size_t i, const Isometry3d& pose, const Path& path, Unknowns* unknowns,
            std::vector<char>* is_checked) const {
    (*is_checked)[i] = 1;
    unknowns->is_held = unknowns->is_held || tree_.is_named(i);
    if (tree_.has_mass(i)) unknowns->twists.push_back(rotation_of(path));
    for (const std::size_t child : tree_.children(i)) {
      if (tree_.is_free(child)) continue;
      if (unknowns->names.size() > kMostUnknowns) {
        if (tree_.needs_mass(child)) walk(child, pose, path, unknowns, is_checked);
        continue;
      }
      const urdf::Joint& joint = *tree_.lump(child).joint;
      const Isometry3d at = pose * tree_.place(joint.parent_link_name) *
                            to_isometry(joint.parent_to_joint_origin_transform);
      Path longer = path;
      add_unknowns(joint.name, motions(joint, at), &longer, unknowns);
      if (tree_.needs_mass(child))
        walk(child, at * motion_of(joint, positions()), longer, unknowns, is_checked);
      else
        unknowns->twists.push_back(longer);
    }
  }

  // Rejects massless links that can move although all masses rest.
  void check(std::size_t top, std::vector<char>* is_checked) {
    Unknowns unknowns;
    Path path;
    const urdf::JointConstSharedPtr& joint = tree_.lump(top).joint;
    if (tree_.is_free(top)) {
      std::vector<Column> all;
      for (int k = 0; k < 6; ++k) all.push_back(Column::Unit(k));
      add_unknowns("", all, &path, &unknowns);
    } else {
      const Isometry3d at = motion_of(*joint, positions()).inverse();
      add_unknowns(joint->name, motions(*joint, at), &path, &unknowns);
    }
    walk(top, Isometry3d::Identity(), path, &unknowns, is_checked);
    if (unknowns.is_held || unknowns.names.size() > kMostUnknowns) return;
    const std::optional<std::string> idle = idle_joints(unknowns);
    if (!idle) return;
    if (idle->empty()) refuse_massless(tree_.lump(top).link);
    refuse("link " + quoted_name(tree_.lump(top).link) + " has no mass, and joints " + *idle +
           " can turn or move without moving a mass, as where their axes coincide: give the link "
           "an <inertial> with a mass > 0, or make one of the joints fixed");
  }

  // Returns the names of joints that can move while all masses rest. Empty names: the link moves
  // without joints.
  std::optional<std::string> idle_joints(const Unknowns& unknowns) const {
    const auto count = static_cast<Eigen::Index>(unknowns.names.size());
    std::vector<Eigen::RowVectorXd> rows;
    for (const Path& twist : unknowns.twists) {
      Eigen::MatrixXd row = Eigen::MatrixXd::Zero(6, count);
      for (const auto& [unknown, column] : twist)
        row.col(static_cast<Eigen::Index>(unknown)) = column;
      for (int k = 0; k < 6; ++k) rows.emplace_back(row.row(k));
    }
    for (const auto& [name, unknown] : unknowns.first) {
      const auto found = model_.joints_.find(name);
      if (found == model_.joints_.end() || !found->second->mimic) continue;
      Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(count);
      row[static_cast<Eigen::Index>(unknown)] = 1.0;
      const auto leader = unknowns.first.find(found->second->mimic->joint_name);
      if (leader != unknowns.first.end())
        row[static_cast<Eigen::Index>(leader->second)] -= found->second->mimic->multiplier;
      rows.push_back(row);
    }
    Eigen::MatrixXd A =
        Eigen::MatrixXd::Zero(std::max(count, static_cast<Eigen::Index>(rows.size())), count);
    for (std::size_t i = 0; i < rows.size(); ++i) A.row(static_cast<Eigen::Index>(i)) = rows[i];
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(A, Eigen::ComputeThinV);
    if (svd.singularValues()[count - 1] > kIdle * svd.singularValues()[0]) return std::nullopt;
    const Eigen::VectorXd idle = svd.matrixV().col(count - 1);
    std::string names, last;
    for (Eigen::Index i = 0; i < count; ++i) {
      const std::string& name = unknowns.names[static_cast<std::size_t>(i)];
      if (name.empty() || name == last || std::abs(idle[i]) < kShare) continue;
      append(quoted_name(name), &names);
      last = name;
    }
    return names;
  }

  const std::map<std::string, double>& positions() const {
    if (positions_.empty()) {
      std::vector<std::string> told_elsewhere;
      positions_ = first_positions(model_, extra_.positions, &told_elsewhere);
    }
    return positions_;
  }

  // Radius of gyration of a link with an inertia alone [m].
  static constexpr double kRotorRadius = 0.1;
  // More neighbouring massless joints are not checked: the time grows with the cube.
  static constexpr std::size_t kMostUnknowns = 60;
  // Smallest singular value, relative to the largest, of joints that move a mass. URDFs have axes
  // to six digits.
  static constexpr double kIdle = 1e-5;
  // Share of the idle motion from which a joint is named.
  static constexpr double kShare = 1e-3;

  MassTree tree_;
  urdf::ModelInterface& model_;
  const RobotExtra& extra_;
  std::vector<std::string>& warnings_;
  mutable std::map<std::string, double> positions_;
};

}  // namespace

MasslessLinks treat_massless_links(bool is_fixed, urdf::ModelInterface* model, MeshShapes* meshes,
                                   RobotExtra* extra) {
  MasslessLinks result = MasslessJoints(is_fixed, model, extra, meshes).fix();
  SubstituteMasses(is_fixed || result.is_root_fixed, model, *extra, meshes, &result.warnings).add();
  return result;
}

}  // namespace constraint_sim
