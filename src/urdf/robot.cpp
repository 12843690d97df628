#include "urdf/robot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <stdexcept>
#include <utility>

#include "engine/math/dense.h"
#include "engine/model/mass_properties.h"
#include "engine/model/shape_properties.h"
#include "engine/scene/scene_joints.h"
#include "engine/support/shortened.h"
#include "urdf/contact_exceptions.h"
#include "urdf/elements.h"
#include "urdf/extra.h"
#include "urdf/lumps.h"
#include "urdf/massless.h"
#include "urdf/missing_inertias.h"
#include "urdf/positions.h"
#include "urdf/sdf.h"
#include "urdf/sdf_text.h"
#include "urdf/servo_gains.h"
#include "urdf/servo_sag.h"
#include "urdf/urdf_text.h"
#include "urdf/xacro.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using engine::BodyId;
using engine::World;

constexpr double kOpen = 1e-6;  // as for other constraints that are added [m]

std::string in_quotes(const std::string& name) { return "'" + name + "'"; }

Isometry3d to_isometry(const engine::BodyState& state) {
  return Eigen::Translation3d(state.position) * state.orientation;
}

engine::BodyState to_state(const Isometry3d& pose) {
  engine::BodyState state;
  state.position = pose.translation();
  state.orientation = Quaterniond(pose.linear()).normalized();
  return state;
}

// Returns by how much a joint that was just added does not fit [m]; 0 where the function of a
// custom joint fails.
double misfit(const World& world, const std::string& name) {
  const double error = std::abs(world.joint_state(world.find_joint(name)).error);
  return std::isfinite(error) ? error : 0.0;
}

std::string three_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

bool is_diagonal(const Matrix3d& inertia) {
  constexpr double kRounding =
      1e-12;  // relative products of inertia that rotations leave by rounding
  Matrix3d rest = inertia;
  rest.diagonal().setZero();
  return rest.cwiseAbs().maxCoeff() <= kRounding * inertia.diagonal().cwiseAbs().maxCoeff();
}

/// Returns the principal axes, in the order and signs nearest to the given axes.
Matrix3d principal_axes(const Matrix3d& inertia) {
  if (is_diagonal(inertia)) return Matrix3d::Identity();
  const Matrix3d found = engine::math::eigensystem(inertia).vectors;
  std::array<int, 3> order{0, 1, 2}, best = order;
  double most = -1.0;
  do {
    double along = 0.0;
    for (int k = 0; k < 3; ++k) along += std::abs(found(k, order[static_cast<std::size_t>(k)]));
    if (along > most) {
      most = along;
      best = order;
    }
  } while (std::next_permutation(order.begin(), order.end()));
  Matrix3d axes;
  for (int k = 0; k < 3; ++k) {
    axes.col(k) = found.col(best[static_cast<std::size_t>(k)]);
    if (axes(k, k) < 0.0) axes.col(k) = -axes.col(k);
  }
  if (axes.determinant() < 0.0) axes.col(2) = -axes.col(2);
  return axes;
}

engine::JointKind kind_of(const urdf::Joint& joint) {
  switch (joint.type) {
    case urdf::Joint::REVOLUTE:
    case urdf::Joint::CONTINUOUS:
      return engine::JointKind::kHinge;
    case urdf::Joint::PRISMATIC:
      return engine::JointKind::kSlider;
    case urdf::Joint::PLANAR:
      return engine::JointKind::kPlanar;
    case urdf::Joint::FIXED:
      return engine::JointKind::kWeld;
    default:
      refuse("joint " + in_quotes(joint.name) + " has a type that is not known");
  }
}

/// Replaces one moment of 0, up to rounding, by 1e-4 of the largest. Returns whether there was one.
bool fill_in_thin_rod(Vector3d* moments) {
  constexpr double kRounding = 1e-12, kShare = 1e-4;
  const double most = moments->maxCoeff();
  Eigen::Index least = 0;
  const double smallest = moments->minCoeff(&least);
  const double middle = moments->sum() - most - smallest;
  if (std::abs(smallest) > kRounding * most || !(middle > kRounding * most)) return false;
  (*moments)[least] = kShare * most;
  return true;
}

/// Builds a robot in a world of its own.
class Builder {
 public:
  Builder(const urdf::ModelInterface& model, const RobotOptions& options, RobotExtra extra,
          bool is_root_fixed, MeshShapes* meshes)
      : model_(model),
        options_(options),
        extra_(std::move(extra)),
        is_root_fixed_(is_root_fixed),
        lumps_(lump_links(model, meshes)) {
    for (const Lump& lump : lumps_.list)
      for (const LumpShape& shape : lump.shapes) links_with_shapes_.insert(shape.link);
    split_planes(&lumps_);
    for (Lump& lump : lumps_.list) drop_shapes_without_collision(&lump);
    robot_.name = model.getName();
    robot_.warnings = lumps_.warnings;
    positions_ = first_positions(model, extra_.positions, &robot_.warnings);
  }

  BuiltRobot build() {
    place_lumps();
    for (std::size_t i = 0; i < lumps_.list.size(); ++i) add_body(i);
    for (const Lump& lump : lumps_.list) add_joint(lump);
    add_mimics();
    add_extra_constraints();
    add_contact_exceptions();
    list_links();
    return {std::move(robot_), std::move(given_bodies_), std::move(given_joints_), ""};
  }

 private:
  std::string named(const std::string& name) const { return options_.prefix + name; }

  void warn(const std::string& sentence) { robot_.warnings.push_back(sentence); }

  // ---- initial poses

  void place_lumps() {
    const Isometry3d root = to_isometry(options_.pose);
    for (const Lump& lump : lumps_.list) {
      if (lump.plane_of) {
        const Isometry3d whole = lump_poses_[*lump.plane_of];
        lump_poses_.push_back(whole);
        continue;
      }
      if (!lump.joint) {
        lump_poses_.push_back(root);
        continue;
      }
      const LinkPlace& parent = lumps_.places.at(lump.joint->parent_link_name);
      lump_poses_.push_back(
          lump_poses_[parent.lump] * parent.in_lump *
          constraint_sim::to_isometry(lump.joint->parent_to_joint_origin_transform) *
          motion_of(*lump.joint, positions_));
    }
  }

  Isometry3d pose_of_link(const std::string& link) const {
    const LinkPlace& place = lumps_.places.at(link);
    return lump_poses_[place.lump] * place.in_lump;
  }

  // ---- bodies

  bool is_static(std::size_t i) const {
    const std::size_t whole = lumps_.list[i].plane_of.value_or(i);
    return (whole == 0 && is_root_fixed_) || extra_.static_links.count(lumps_.list[whole].link) > 0;
  }

  void add_body(std::size_t i) {
    const Lump& lump = lumps_.list[i];
    engine::Body body;
    body.name = named(lump.link) + "/com";
    Isometry3d in_lump = Isometry3d::Identity();
    if (is_static(i)) {
      body.type = engine::BodyType::kStatic;
      const bool is_plane = !lump.shapes.empty() && engine::is_half_space(lump.shapes[0].shape);
      if (is_plane) in_lump = lump.shapes[0].in_lump;  // a plane has no pose in its body
    } else {
      in_lump = set_mass(lump, &body);
    }
    const std::string of_shape = lump.shapes.empty() ? lump.link : lump.shapes[0].link;
    const LinkProperties properties = properties_of(lump, of_shape);
    body.friction = properties.friction;
    body.restitution = properties.restitution;
    body.no_collision = properties.no_collision;
    set_shape(lump, in_lump, &body);
    body.gravity_compensation = extra_.gravity_compensation;
    body.state = to_state(lump_poses_[i] * in_lump);
    bodies_.push_back(world_.add_body(body));
    given_bodies_.push_back(body);
    in_body_.push_back(in_lump.inverse());
    robot_.bodies.push_back(body.name);
  }

  // Sets mass and inertia; returns the body's frame in the lump: centre of mass and principal axes.
  Isometry3d set_mass(const Lump& lump, engine::Body* body) {
    if (!(lump.mass > 0.0))
      refuse("link " + in_quotes(lump.link) +
             " moves and has no mass: it needs an <inertial> with a mass > 0");
    const Matrix3d inertia = lump.inertia();
    const Matrix3d wanted = axes_of_shape(lump, inertia);
    const Matrix3d axes = wanted * principal_axes(wanted.transpose() * inertia * wanted);
    Vector3d moments = (axes.transpose() * inertia * axes).diagonal();
    if (fill_in_thin_rod(&moments))
      warn("link " + in_quotes(lump.link) +
           " has a principal moment of inertia of 0, as a thin rod: it gets " +
           three_digits(moments.minCoeff()) + " kg m^2");
    if (!(moments.minCoeff() > 0.0))
      refuse("link " + in_quotes(lump.link) +
             " has no inertia, or one that is not positive definite: its principal moments are " +
             std::to_string(moments.x()) + ", " + std::to_string(moments.y()) + ", " +
             std::to_string(moments.z()) + " kg m^2");
    if (moments.sum() < 2.0 * moments.maxCoeff() * (1.0 - 1e-9))
      warn("link " + in_quotes(lump.link) +
           ": no mass has such an inertia: one principal moment is more than the two others");
    body->mass = lump.mass;
    body->inertia = moments;
    Isometry3d in_lump = Isometry3d::Identity();
    in_lump.translation() = lump.centre_of_mass();
    in_lump.linear() = axes;
    return in_lump;
  }

  // Returns the axes of the first shape where they are principal axes, so that the body's axes are
  // aligned with its shape.
  static Matrix3d axes_of_shape(const Lump& lump, const Matrix3d& inertia) {
    if (lump.shapes.empty()) return Matrix3d::Identity();
    const Matrix3d R = lump.shapes[0].in_lump.linear();
    return is_diagonal(R.transpose() * inertia * R) ? R : Matrix3d(Matrix3d::Identity());
  }

  void set_shape(const Lump& lump, const Isometry3d& in_lump, engine::Body* body) const {
    if (lump.shapes.empty()) return;
    if (lump.shapes.size() == 1) {
      constexpr double kRounding = 1e-14;
      body->shape = lump.shapes[0].shape;
      const Isometry3d in_body = in_lump.inverse() * lump.shapes[0].in_lump;
      const bool is_there = in_body.isApprox(Isometry3d::Identity(), kRounding);
      if (!is_there) body->shape_pose = pose_of(in_body);
      return;
    }
    engine::Compound::Parts parts;
    for (const LumpShape& shape : lump.shapes) {
      engine::ShapePart& part = parts.emplace_back();
      part.shape = shape.shape;
      part.pose = pose_of(in_lump.inverse() * shape.in_lump);
      const LinkProperties properties = properties_of(lump, shape.link);
      if (properties.friction != body->friction) part.friction = properties.friction;
      if (properties.restitution != body->restitution) part.restitution = properties.restitution;
    }
    body->shape = engine::Compound(std::move(parts));
  }

  static engine::ShapePose pose_of(const Isometry3d& in_body) {
    return {in_body.translation(), Quaterniond(in_body.linear())};
  }

  // ---- properties of links

  // Returns the properties of a link, else those of links of its body that have no shapes.
  LinkProperties properties_of(const Lump& lump, const std::string& link) const {
    LinkProperties properties;
    for (const std::string& other : lump.links)
      if (links_with_shapes_.count(other) == 0) read_properties(other, &properties);
    read_properties(link, &properties);
    return properties;
  }

  void read_properties(const std::string& link, LinkProperties* properties) const {
    const auto found = extra_.links.find(link);
    if (found != extra_.links.end()) *properties = found->second;
  }

  // Drops the shapes of links that do not collide from a body that has others.
  void drop_shapes_without_collision(Lump* lump) const {
    const auto collides = [&](const LumpShape& shape) {
      return !properties_of(*lump, shape.link).no_collision;
    };
    std::vector<LumpShape>& shapes = lump->shapes;
    if (std::none_of(shapes.begin(), shapes.end(), collides)) return;
    shapes.erase(std::stable_partition(shapes.begin(), shapes.end(), collides), shapes.end());
  }

  // ---- joints

  void add_joint(const Lump& lump) {
    if (!lump.joint || lump.joint->type == urdf::Joint::FLOATING) return;
    const urdf::Joint& given = *lump.joint;
    const LinkPlace& parent = lumps_.places.at(given.parent_link_name);
    const LinkPlace& child = lumps_.places.at(given.child_link_name);
    const Quaterniond axis = along_axis(given);
    const Isometry3d a = in_body_[parent.lump] * parent.in_lump *
                         constraint_sim::to_isometry(given.parent_to_joint_origin_transform);
    const Isometry3d& b = in_body_[child.lump];
    engine::Joint joint;
    joint.name = named(given.name);
    joint.kind = kind_of(given);
    joint.body_a = bodies_[parent.lump];
    joint.body_b = bodies_[child.lump];
    joint.anchor_a = a.translation();
    joint.anchor_b = b.translation();
    joint.frame_a = Quaterniond(a.linear()) * axis;
    joint.frame_b = Quaterniond(b.linear()) * axis;
    if (has_position(given)) joint.coordinates[0] = law_of(given);
    if (joint.coordinates[0].motor)
      set_servo_gains(inertia_behind(lumps_, given_bodies_, child.lump, axis_of(joint)),
                      &*joint.coordinates[0].motor);
    add(joint);
  }

  // Returns the axis of a hinge or slider in the world.
  JointAxis axis_of(const engine::Joint& joint) const {
    const engine::BodyState& child = world_.state(joint.body_b);
    JointAxis axis;
    axis.point = child.position + child.orientation * joint.anchor_b;
    axis.direction = child.orientation * (*joint.frame_b * Vector3d::UnitZ());
    axis.is_slider = joint.kind == engine::JointKind::kSlider;
    return axis;
  }

  engine::CoordinateLaw law_of(const urdf::Joint& given) {
    engine::CoordinateLaw law;
    constexpr double kWithinATurn = 3.0;
    const double q = positions_.at(given.name);
    if (given.type != urdf::Joint::PRISMATIC && std::abs(q) > kWithinATurn) law.position = q;
    if (given.limits) {
      if (given.type != urdf::Joint::CONTINUOUS) {
        law.lower = given.limits->lower;
        law.upper = given.limits->upper;
      }
      robot_.bounds[named(given.name)] = {given.limits->effort, given.limits->velocity};
    }
    if (given.dynamics) {
      law.damping = given.dynamics->damping;
      law.friction = given.dynamics->friction;
    }
    if (const auto spring = extra_.springs.find(given.name); spring != extra_.springs.end()) {
      law.stiffness = spring->second.stiffness;
      law.rest = spring->second.rest;
    }
    const auto motor = extra_.motors.find(given.name);
    if (motor == extra_.motors.end()) {
      if (extra_.hold && !given.mimic && given.limits && given.limits->effort > 0.0) {
        law.motor.emplace();
        law.motor->position = q;
        law.motor->max_force = given.limits->effort;
      }
      return law;
    }
    law.motor = engine::read_coordinate_motor(motor->second);
    if (given.limits && !motor->second.find("max_force"))
      law.motor->max_force = given.limits->effort;
    return law;
  }

  engine::JointId add(const engine::Joint& joint) {
    const engine::JointId id = world_.add_joint(joint);
    robot_.constraints.push_back(joint.name);
    given_joints_.push_back(joint);
    return id;
  }

  void add_mimics() {
    for (const auto& [name, given] : model_.joints_) {
      if (!given->mimic || !has_position(*given)) continue;
      if (given->mimic->multiplier == 0.0)
        refuse("joint " + in_quotes(name) + " mimics by a multiplier of 0; make it a fixed joint");
      engine::Joint gear;
      gear.name = named(name) + "/mimic";
      gear.kind = engine::JointKind::kGear;
      gear.coupling.first = world_.find_joint(named(name));
      gear.coupling.second = world_.find_joint(named(leader_of(model_, *given).name));
      gear.coupling.ratio = -given->mimic->multiplier;
      gear.coupling.value = given->mimic->offset;
      add(gear);
    }
  }

  // ---- constraints of the extra YAML

  // Returns a scene whose bodies are the links, to read the constraints as in a scene.
  World scene_of_links() const {
    World scene;
    for (const auto& [link, place] : lumps_.places) {
      if (link == "world") continue;  // is the world
      engine::Body body;
      body.name = link;
      body.shape = engine::Sphere{1.0};
      body.mass = 1.0;
      body.state = to_state(pose_of_link(link));
      scene.add_body(body);
    }
    for (const auto& [name, given] : model_.joints_) {
      if (!has_position(*given)) continue;
      engine::Joint joint = world_.joint(world_.find_joint(named(name)));
      const auto in_scene = [&](const std::string& link) {
        return link == "world" ? engine::kWorldBody : scene.find_body(link);
      };
      joint.name = name;
      joint.body_a = in_scene(given->parent_link_name);
      joint.body_b = in_scene(given->child_link_name);
      scene.add_joint(joint);
    }
    return scene;
  }

  void add_extra_constraints() {
    if (extra_.constraints.empty()) return;
    World scene = scene_of_links();
    for (const engine::YamlElement& item : extra_.constraints) {
      for (const char* key : {"state", "broken"})
        if (const auto saved = item.find(key)) saved->fail("belongs to saved scenes");
      engine::Joint joint = engine::read_joint(item, scene);
      item.attempt([&] { scene.add_joint(joint); });  // later constraints may couple it
      if (is_within_a_body(item, scene, joint)) continue;
      if (engine::info(joint.kind).couples_joints) {
        for (engine::JointId* id : {&joint.coupling.first, &joint.coupling.second})
          *id = in_world(item, scene.joint(*id).name);
      } else {
        move_end(scene, &joint.body_a, &joint.anchor_a, &joint.frame_a);
        Quaterniond none = Quaterniond::Identity();
        const Quaterniond in_body = turn_to_body(scene, joint.body_b);
        if (joint.axis_b) joint.axis_b = in_body * *joint.axis_b;
        move_end(scene, &joint.body_b, &joint.anchor_b, joint.frame_b ? &*joint.frame_b : &none);
      }
      joint.name = named(joint.name);
      item.attempt([&] { add(joint); });
    }
  }

  // Whether both ends of a joint are links of one body: it is left out where it fits, with a
  // warning, and rejected where it does not.
  bool is_within_a_body(const engine::YamlElement& item, const World& scene,
                        const engine::Joint& joint) {
    if (engine::info(joint.kind).couples_joints || joint.body_a == engine::kWorldBody ||
        joint.body_b == engine::kWorldBody)
      return false;
    const std::string &a = scene.body(joint.body_a).name, &b = scene.body(joint.body_b).name;
    if (lumps_.places.at(a).lump != lumps_.places.at(b).lump) return false;
    const std::string links = "links " + in_quotes(a) + " and " + in_quotes(b) + " are one body";
    const double error = misfit(scene, joint.name);
    if (error > kOpen)
      item.fail(links + ", which the constraint does not fit by " + three_digits(error));
    warn("constraint " + in_quotes(joint.name) + " is left out: " + links);
    return true;
  }

  // Returns the joint of the robot that has the given name in the scene of links.
  engine::JointId in_world(const engine::YamlElement& item, const std::string& name) const {
    if (!world_.has_joint(named(name)))
      item.fail("couples constraint " + in_quotes(name) + ", which is left out");
    return world_.find_joint(named(name));
  }

  Quaterniond turn_to_body(const World& scene, BodyId id) const {
    if (id == engine::kWorldBody) return Quaterniond::Identity();
    return Quaterniond(link_in_body(scene.body(id).name).linear());
  }

  // Converts an end of a joint from the link's frame to that of its body.
  void move_end(const World& scene, BodyId* id, Vector3d* anchor, Quaterniond* frame) const {
    if (*id == engine::kWorldBody) return;
    const std::string& link = scene.body(*id).name;
    const Isometry3d in_body = link_in_body(link);
    *anchor = in_body * *anchor;
    *frame = Quaterniond(in_body.linear()) * *frame;
    *id = bodies_[lumps_.places.at(link).lump];
  }

  // ---- reported data

  Isometry3d link_in_body(const std::string& link) const {
    const LinkPlace& place = lumps_.places.at(link);
    return in_body_[place.lump] * place.in_lump;
  }

  static bool is_unknown_mesh(const urdf::Geometry& geometry) {
    return geometry.type == urdf::Geometry::MESH &&
           static_cast<const urdf::Mesh&>(geometry).filename.empty();
  }

  void list_links() {
    for (const Lump& lump : lumps_.list) {
      if (lump.plane_of) continue;
      for (const std::string& link : lump.links) {
        const BodyId body = bodies_[lumps_.places.at(link).lump];
        const Isometry3d in_body = link_in_body(link);
        robot_.links.push_back({named(link), body, in_body});
        for (const auto& visual : model_.getLink(link)->visual_array) {
          if (is_unknown_mesh(*visual->geometry)) continue;
          RobotVisual& shown = robot_.visuals.emplace_back();
          shown.body = body;
          shown.in_body = in_body * constraint_sim::to_isometry(visual->origin);
          shown.geometry = visual->geometry;
          if (!visual->material) continue;
          const urdf::Color& colour = visual->material->color;
          shown.colour = {colour.r, colour.g, colour.b, colour.a};
        }
      }
    }
  }

  // Adds a joint for each pair of bodies that do not collide.
  void add_contact_exceptions() {
    const ContactExceptions exceptions =
        contact_exceptions(lumps_, given_bodies_, given_joints_, listed_pairs(), extra_.models);
    for (const auto& [i, j] : exceptions.pairs)
      add(no_contact_joint(options_.prefix, {lumps_.list[i].link, lumps_.list[j].link}, bodies_[i],
                           bodies_[j]));
    for (const std::string& sentence : exceptions.warnings) warn(sentence);
  }

  // Returns the pairs of links in the extra YAML and in the SRDF.
  std::vector<LinkPair> listed_pairs() {
    std::vector<LinkPair> pairs = extra_.no_contact;
    std::string unknown;
    for (const LinkPair& pair : disabled_collisions(options_.srdf)) {
      for (const std::string& link : {pair.first, pair.second})
        if (!model_.getLink(link) && unknown.find(in_quotes(link)) == std::string::npos)
          unknown += (unknown.empty() ? "" : ", ") + in_quotes(link);
      pairs.push_back(pair);
    }
    if (!unknown.empty())
      warn("the SRDF has links that the URDF does not have: " + engine::shortened(unknown, 200));
    return pairs;
  }

  const urdf::ModelInterface& model_;
  const RobotOptions& options_;
  RobotExtra extra_;
  bool is_root_fixed_;
  Lumps lumps_;
  std::set<std::string> links_with_shapes_;
  World world_;
  Robot robot_;
  std::vector<engine::Body> given_bodies_;
  std::vector<engine::Joint> given_joints_;
  std::map<std::string, double> positions_;  // initial positions of joints
  std::vector<Isometry3d> lump_poses_;       // poses in the world's frame
  std::vector<BodyId> bodies_;               // ids of lumps
  std::vector<Isometry3d> in_body_;          // poses of lumps in their bodies
};

}  // namespace

namespace {

/// Rejects a link named 'world' unless it is the world itself.
void check_world_link(const urdf::ModelInterface& model, const RobotOptions& options) {
  const bool is_at_origin = to_isometry(options.pose).isApprox(Isometry3d::Identity());
  for (const auto& entry : model.links_)
    if (options.prefix + entry.first == "world" &&
        (entry.first != model.getRoot()->name || !is_at_origin))
      refuse(
          "link 'world' is the world itself only as the root of a robot that is added without a "
          "pose; else give the robot a prefix");
}

/// Rejects names that the world has already. Links count too: their frames are published beside
/// those of bodies.
void check_names(const BuiltRobot& built, const World& world) {
  for (const RobotLink& link : built.robot.links)
    if (link.name != "world" && world.has_body(link.name))
      refuse("there is already a body named " + in_quotes(link.name));
  for (const std::string& name : built.robot.bodies)
    if (world.has_body(name)) refuse("there is already a body named " + in_quotes(name));
  for (const std::string& name : built.robot.constraints)
    if (world.has_joint(name)) refuse("there is already a constraint named " + in_quotes(name));
}

/// Parses a URDF that xacro has been run on.
urdf::ModelInterfaceSharedPtr parse_expanded_urdf(const std::string& text,
                                                  const RobotOptions& options,
                                                  std::vector<std::string>* deviations) {
  const XacroLeft xacro = find_xacro(text);
  if (!xacro.content.empty())
    refuse("xacro has not been run on this text, which has " + xacro.content.text() +
           (options.how_to_expand.empty() ? "" : ": " + options.how_to_expand));
  if (!xacro.definitions.empty())
    deviations->push_back("definitions of xacro are left in the URDF and are not read: " +
                          xacro.definitions.text());
  return parse_urdf(text);
}

/// Parses an SDF, and sets the pose of the root link.
urdf::ModelInterfaceSharedPtr parse_sdf(const std::string& text, RobotOptions* options,
                                        RobotExtra* extra, std::vector<std::string>* deviations) {
  if (reads_sdf()) check_sdf_text(text);
  SdfRobot robot =
      robot_of_sdf(read_sdf_model(text, options->folder), options->pose, options->fixed);
  options->pose = robot.pose;
  options->fixed = robot.is_fixed;
  *extra = std::move(robot.extra);
  *deviations = std::move(robot.warnings);
  return robot.model;
}

/// Returns a sentence for each constraint that does not fit the links where they lie.
std::vector<std::string> open_constraints(const Robot& robot, const World& world) {
  std::vector<std::string> sentences;
  for (const std::string& name : robot.constraints) {
    const double error = misfit(world, name);
    if (!(error > kOpen)) continue;
    sentences.push_back("constraint " + in_quotes(name) + " does not fit the links by " +
                        three_digits(error) + "; it closes within closing_time");
  }
  return sentences;
}

}  // namespace

BuiltRobot build_robot(const std::string& text, const RobotOptions& given) {
  engine::validate(given.pose);
  if (!text.empty()) check_root_element(text);
  RobotOptions options = given;
  RobotExtra sdf_extra;
  std::vector<std::string> deviations;
  const bool from_sdf = is_sdf(text);
  const urdf::ModelInterfaceSharedPtr model =
      from_sdf ? parse_sdf(text, &options, &sdf_extra, &deviations)
               : parse_expanded_urdf(text, options, &deviations);
  check_world_link(*model, options);
  const std::vector<std::string> unknown_meshes =
      name_meshes(options.folder, options.mesh_exists, model.get());
  RobotExtra extra = read_extra(options.extra);
  check_extra(extra, *model);
  add_sdf_extra(sdf_extra, &extra);
  const std::string description = from_sdf ? urdf_text(*model) : "";
  const bool is_fixed = options.fixed || model->getRoot()->name == "world";
  MeshShapes meshes(options.mesh_path, most_parts(extra));
  const std::vector<std::string> inertias = fill_in_inertias(is_fixed, &meshes, model.get());
  const MasslessLinks massless = treat_massless_links(is_fixed, model.get(), &meshes, &extra);
  BuiltRobot built =
      Builder(*model, options, std::move(extra), is_fixed || massless.is_root_fixed, &meshes)
          .build();
  built.urdf = description;
  built.robot.fixed_joints = massless.fixed_joints;
  const std::vector<std::string>* const all_sentences[] = {&inertias, &massless.warnings,
                                                           &unknown_meshes, &deviations};
  for (const auto* sentences : all_sentences)
    built.robot.warnings.insert(built.robot.warnings.end(), sentences->begin(), sentences->end());
  if (const std::string unread = unread_elements(text); !unread.empty())
    built.robot.warnings.push_back("elements that are not read: " + unread);
  return built;
}

Robot add_robot(const BuiltRobot& built, World* world) {
  check_names(built, *world);  // other errors were found when the robot was built
  std::vector<BodyId> bodies{engine::kWorldBody};
  for (const engine::Body& body : built.bodies) bodies.push_back(world->add_body(body));
  std::vector<engine::JointId> joints;
  for (engine::Joint joint : built.joints) {
    joint.body_a = bodies[joint.body_a.value];
    joint.body_b = bodies[joint.body_b.value];
    if (engine::info(joint.kind).couples_joints)
      for (engine::JointId* id : {&joint.coupling.first, &joint.coupling.second})
        *id = joints[id->value];
    joints.push_back(world->add_joint(joint));
  }
  Robot robot = built.robot;
  for (RobotLink& link : robot.links) link.body = bodies[link.body.value];
  for (RobotVisual& visual : robot.visuals) visual.body = bodies[visual.body.value];
  for (std::string& sentence : open_constraints(robot, *world))
    robot.warnings.push_back(std::move(sentence));
  for (std::string& sentence : sagging_servos(robot, *world))
    robot.warnings.push_back(std::move(sentence));
  return robot;
}

Robot add_robot(const std::string& text, const RobotOptions& options, World* world) {
  return add_robot(build_robot(text, options), world);
}

}  // namespace constraint_sim
