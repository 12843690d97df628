#include "urdf/lumps.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "engine/model/shape_properties.h"
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

/// Returns the shape of a geometry; none for meshes, which become hulls.
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
    case urdf::Geometry::MESH:
      break;
  }
  return std::nullopt;
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
    begin(*model.getRoot(), nullptr);
  }

  Lumps take() { return std::move(lumps_); }

 private:
  // Begins a new lump with this link.
  void begin(const urdf::Link& link, const urdf::JointConstSharedPtr& joint) {
    const std::size_t lump = lumps_.list.size();
    lumps_.list.emplace_back();
    const bool is_joint_frame =
        joint && link.name == joint_frame_link(joint->name) && link.child_links.size() == 1;
    lumps_.list[lump].link = is_joint_frame ? link.child_links.front()->name : link.name;
    lumps_.list[lump].joint = joint;
    add(link, {lump, Isometry3d::Identity()});
  }

  void add(const urdf::Link& link, const LinkPlace& place) {
    Lump& lump = lumps_.list[place.lump];
    lump.links.push_back(link.name);
    lumps_.places[link.name] = place;
    add_inertial(link, place.in_lump, &lump);
    for (LumpShape& shape : shapes_of(link, meshes_, &lumps_.warnings)) {
      shape.in_lump = place.in_lump * shape.in_lump;
      lump.shapes.push_back(std::move(shape));
    }
    if (lump.shapes.size() > engine::kMostParts)
      refuse_link(link.name, "has a body with more than " + std::to_string(engine::kMostParts) +
                                 " collision shapes");
    for (const urdf::JointSharedPtr& joint : link.child_joints) {
      const auto child = std::find_if(
          link.child_links.begin(), link.child_links.end(),
          [&](const auto& candidate) { return candidate->name == joint->child_link_name; });
      follow(**child, joint, place);
    }
  }

  void follow(const urdf::Link& child, const urdf::JointSharedPtr& joint, const LinkPlace& parent) {
    if (joint->type != urdf::Joint::FIXED) return begin(child, joint);
    add(child,
        {parent.lump, parent.in_lump * to_isometry(joint->parent_to_joint_origin_transform)});
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

void split_planes(Lumps* lumps) {
  const std::size_t count = lumps->list.size();
  for (std::size_t i = 0; i < count; ++i) {
    const auto is_plane = [](const LumpShape& shape) { return engine::is_half_space(shape.shape); };
    std::vector<LumpShape> shapes = std::move(lumps->list[i].shapes);
    const auto first_plane = std::stable_partition(
        shapes.begin(), shapes.end(), [&](const auto& shape) { return !is_plane(shape); });
    std::vector<LumpShape> planes(std::make_move_iterator(first_plane),
                                  std::make_move_iterator(shapes.end()));
    shapes.erase(first_plane, shapes.end());
    std::size_t number = 1;
    for (LumpShape& plane : planes) {
      if (shapes.empty()) {
        shapes.push_back(std::move(plane));
        continue;
      }
      Lump part = lumps->list[i];
      part.joint.reset();
      part.plane_of = i;
      part.link += "/" + std::to_string(++number);
      part.shapes = {std::move(plane)};
      lumps->list.push_back(std::move(part));
    }
    lumps->list[i].shapes = std::move(shapes);
  }
}

}  // namespace constraint_sim
