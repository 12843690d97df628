#include "urdf/lumps.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "sim/words.h"
#include "urdf/parse.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

[[noreturn]] void refuse_link(const std::string& link, const std::string& why) {
  throw std::invalid_argument("urdf: link '" + link + "' " + why);
}

bool has_mass(const urdf::Link& link) { return link.inertial && link.inertial->mass > 0.0; }

void add_inertial(const urdf::Link& link, const Isometry3d& in_lump, Lump* lump) {
  if (!link.inertial) return;
  const urdf::Inertial& inertial = *link.inertial;
  if (!(inertial.mass >= 0.0))
    refuse_link(link.name, "must have a mass >= 0, got " + std::to_string(inertial.mass));
  Matrix3d inertia;
  inertia << inertial.ixx, inertial.ixy, inertial.ixz,  //
      inertial.ixy, inertial.iyy, inertial.iyz,         //
      inertial.ixz, inertial.iyz, inertial.izz;
  const Isometry3d at = in_lump * to_isometry(inertial.origin);
  if (!inertia.allFinite() || !at.matrix().allFinite())
    refuse_link(link.name, "has an inertia that is not finite");
  const Matrix3d R = at.linear();
  lump->mass += inertial.mass;
  lump->first_moment += inertial.mass * at.translation();
  lump->second_moment +=
      R * inertia * R.transpose() + inertial.mass * point_inertia(at.translation());
}

std::optional<engine::Shape> shape_of(const urdf::Geometry& geometry) {
  switch (geometry.type) {
    case urdf::Geometry::SPHERE:
      return engine::Sphere{static_cast<const urdf::Sphere&>(geometry).radius};
    case urdf::Geometry::BOX:
      if (dynamic_cast<const PlaneGeometry*>(&geometry) != nullptr) return engine::Plane{};
      return engine::Box{to_eigen(static_cast<const urdf::Box&>(geometry).dim)};
    case urdf::Geometry::CYLINDER: {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
      if (dynamic_cast<const CapsuleGeometry*>(&geometry) != nullptr)
        return engine::Capsule{cylinder.radius, cylinder.length};
      return engine::Cylinder{cylinder.radius, cylinder.length};
    }
    default:
      return std::nullopt;
  }
}

/// Returns the shapes of the collisions with a supported geometry.
std::vector<LumpShape> shapes_of(const urdf::Link& link, MeshShapes* meshes,
                                 std::vector<std::string>* warnings) {
  std::vector<LumpShape> shapes;
  for (std::size_t i = 0; i < link.collision_array.size(); ++i) {
    const auto& collision = link.collision_array[i];
    const Isometry3d in_link = to_isometry(collision->origin);
    if (collision->geometry->type == urdf::Geometry::MESH) {
      const MeshShape& mesh =
          meshes->of(link.name, static_cast<const urdf::Mesh&>(*collision->geometry));
      warnings->push_back("link '" + link.name + "': " + mesh.sentence);
      for (const MeshHull& hull : mesh.hulls)
        shapes.push_back(
            {hull.hull, in_link * hull.in_mesh, link.name, i, hull.hull.surface->volume()});
      continue;
    }
    const auto shape = shape_of(*collision->geometry);
    if (!shape) continue;
    try {
      engine::validate(*shape);
    } catch (const std::invalid_argument& error) {
      refuse_link(link.name, std::string("has a collision with ") + error.what());
    }
    shapes.push_back({*shape, in_link, link.name, i});
  }
  return shapes;
}

/// Walks the tree of links from the root.
class Walk {
 public:
  Walk(const urdf::ModelInterface& model, MeshShapes* meshes) : meshes_(meshes) {
    begin(*model.getRoot(), nullptr, 0);
  }

  Lumps take() { return std::move(lumps_); }

 private:
  // Begins a new lump with this link, in the group of another lump or of its own.
  void begin(const urdf::Link& link, const urdf::JointConstSharedPtr& joint, std::size_t group) {
    const std::size_t lump = lumps_.list.size();
    lumps_.list.emplace_back();
    const bool is_joint_frame =
        joint && link.name == joint_frame_link(joint->name) && link.child_links.size() == 1;
    lumps_.list[lump].link = is_joint_frame ? link.child_links.front()->name : link.name;
    lumps_.list[lump].joint = joint;
    lumps_.list[lump].group = group;
    add(link, {lump, Isometry3d::Identity()}, shapes_of(link, meshes_, &lumps_.warnings));
  }

  void add(const urdf::Link& link, const LinkPlace& place, const std::vector<LumpShape>& shapes) {
    Lump& lump = lumps_.list[place.lump];
    lump.links.push_back(link.name);
    lumps_.places[link.name] = place;
    add_inertial(link, place.in_lump, &lump);
    for (LumpShape shape : shapes) {
      shape.in_lump = place.in_lump * shape.in_lump;
      if (lump.shape)
        lump.more_shapes.push_back(std::move(shape));
      else
        lump.shape = std::move(shape);
    }
    for (const urdf::JointSharedPtr& joint : link.child_joints) {
      const auto child = std::find_if(
          link.child_links.begin(), link.child_links.end(),
          [&](const auto& candidate) { return candidate->name == joint->child_link_name; });
      follow(**child, joint, place);
    }
  }

  void follow(const urdf::Link& child, const urdf::JointSharedPtr& joint, const LinkPlace& parent) {
    if (joint->type != urdf::Joint::FIXED) return begin(child, joint, lumps_.list.size());
    const bool would_lose_shape =
        lumps_.list[parent.lump].shape && has_mass(child) && !child.collision_array.empty();
    if (would_lose_shape) {
      std::vector<std::string> warnings;  // dropped here; reported when the link is added
      if (!shapes_of(child, meshes_, &warnings).empty())
        return begin(child, joint, lumps_.list[parent.lump].group);
    }
    add(child, {parent.lump, parent.in_lump * to_isometry(joint->parent_to_joint_origin_transform)},
        shapes_of(child, meshes_, &lumps_.warnings));
  }

  MeshShapes* meshes_;
  Lumps lumps_;
};

}  // namespace

Matrix3d point_inertia(const Vector3d& r) {
  return r.squaredNorm() * Matrix3d::Identity() - r * r.transpose();
}

Matrix3d Lump::inertia() const { return second_moment - mass * point_inertia(centre_of_mass()); }

Lumps lump_links(const urdf::ModelInterface& model, MeshShapes* meshes) {
  return Walk(model, meshes).take();
}

void split_shapes(Lumps* lumps) {
  const std::size_t count = lumps->list.size();
  std::map<std::string, std::size_t> left_out;  // numbers of shapes, by link
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<LumpShape> more = std::move(lumps->list[i].more_shapes);
    const std::size_t room = count + kMostParts - lumps->list.size();
    for (; more.size() > room; more.pop_back()) ++left_out[more.back().link];
    const double share = 1.0 / static_cast<double>(more.size() + 1);
    Lump& whole = lumps->list[i];
    whole.mass *= share;
    whole.first_moment *= share;
    whole.second_moment *= share;
    Lump part = whole;
    part.joint.reset();
    part.part_of = i;
    for (std::size_t k = 0; k < more.size(); ++k) {
      part.link = lumps->list[i].link + "/" + std::to_string(k + 2);
      part.shape = std::move(more[k]);
      lumps->list.push_back(part);
    }
  }
  for (const auto& [link, number] : left_out)
    lumps->warnings.push_back("link '" + link + "': " + std::to_string(number) +
                              " of its shapes do not collide: a robot has at most " +
                              std::to_string(kMostParts) + " shapes beyond one for each body");
}

}  // namespace constraint_sim
