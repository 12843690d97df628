#include "urdf/sdf_links.h"

#ifdef CONSTRAINT_SIM_READS_SDF

#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <system_error>
#include <utility>

#include "constraint_sim/engine/joint.h"
#include "sim/words.h"
#include "urdf/parse.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

std::string link_named(const std::string& name) { return "link '" + shortened(name, 100) + "'"; }

urdf::Pose to_urdf_pose(const Isometry3d& pose) {
  const Eigen::Quaterniond q(pose.linear());
  urdf::Pose converted;
  converted.position =
      urdf::Vector3(pose.translation().x(), pose.translation().y(), pose.translation().z());
  converted.rotation.setFromQuaternion(q.x(), q.y(), q.z(), q.w());
  return converted;
}

/// Returns the element at the end of a path of child elements; null where there is none.
sdf::ElementPtr element_at(sdf::ElementPtr element, std::initializer_list<const char*> path) {
  for (const char* name : path) {
    if (!element || !element->HasElement(name)) return nullptr;
    element = element->GetElement(name);
  }
  return element;
}

/// Returns the file of `model://NAME/REST`: beside the folder of the SDF, or in it, as where the
/// folder has another name than the model. Empty: there is no such file.
std::string file_of_model_uri(const std::string& uri, const std::string& folder) {
  const std::string rest = uri.substr(std::string("model://").size());
  const std::size_t slash = rest.find('/');
  if (folder.empty() || slash == std::string::npos) return "";
  for (const std::string& path : {folder + "/../" + rest, folder + rest.substr(slash)}) {
    std::error_code error;
    if (std::filesystem::is_regular_file(path, error)) return path;
  }
  return "";
}

/// Reads the geometries of a link.
class SdfShapes {
 public:
  SdfShapes(std::string link, bool is_static, std::string folder, SdfModel* model)
      : link_(std::move(link)), is_static_(is_static), folder_(std::move(folder)), model_(*model) {}

  void add_collision(const sdf::Collision& given, urdf::Link* link) {
    const std::string what = "collision '" + shortened(given.Name()) + "'";
    Isometry3d at = pose_of(given.SemanticPose(), what);
    const sdf::Geometry& geometry = *given.Geom();
    urdf::GeometrySharedPtr shape;
    if (geometry.Type() == sdf::GeometryType::PLANE) {
      if (!is_static_)
        return warn(what + " is a <plane>, which collides only where its model is static");
      at = at * along_normal(*geometry.PlaneShape());
      shape = std::make_shared<PlaneGeometry>();
#if SDF_MAJOR_VERSION >= 11
    } else if (geometry.Type() == sdf::GeometryType::CAPSULE) {
      const auto capsule = std::make_shared<CapsuleGeometry>();
      capsule->radius = geometry.CapsuleShape()->Radius();
      capsule->length = geometry.CapsuleShape()->Length();
      shape = capsule;
#endif
    } else {
      shape = plain_shape(geometry, what);
    }
    if (!shape) return;
    const auto collision = std::make_shared<urdf::Collision>();
    collision->name = given.Name();
    collision->origin = to_urdf_pose(at);
    collision->geometry = shape;
    link->collision_array.push_back(collision);
    add_surface(given.Element(), link->collision_array.size() == 1);
  }

  void add_visual(const sdf::Visual& given, urdf::Link* link) {
    const std::string what = "visual '" + shortened(given.Name()) + "'";
    const Isometry3d at = pose_of(given.SemanticPose(), what);
    const sdf::Geometry& geometry = *given.Geom();
    const urdf::MaterialSharedPtr material = material_of(given);
    const auto show = [&](const urdf::GeometrySharedPtr& shape, const Isometry3d& pose) {
      if (!shape) return;
      const auto visual = std::make_shared<urdf::Visual>();
      visual->name = given.Name();
      visual->origin = to_urdf_pose(pose);
      visual->geometry = shape;
      visual->material = material;
      if (material) visual->material_name = material->name;
      link->visual_array.push_back(visual);
    };
    if (geometry.Type() == sdf::GeometryType::PLANE) {
      constexpr double kThickness = 1e-4;  // [m]
      const sdf::Plane& plane = *geometry.PlaneShape();
      show(box(plane.Size().X(), plane.Size().Y(), kThickness), at * along_normal(plane));
#if SDF_MAJOR_VERSION >= 11
    } else if (geometry.Type() == sdf::GeometryType::CAPSULE) {
      const double radius = geometry.CapsuleShape()->Radius();
      const double length = geometry.CapsuleShape()->Length();
      show(cylinder(radius, length), at);
      for (const double end : {-0.5 * length, 0.5 * length})
        show(sphere(radius), at * Eigen::Translation3d(0.0, 0.0, end));
#endif
    } else {
      show(plain_shape(geometry, what), at);
    }
  }

 private:
  void warn(const std::string& sentence) {
    model_.warnings.push_back(link_named(link_) + ": " + sentence);
  }

  Isometry3d pose_of(const sdf::SemanticPose& pose, const std::string& what) const {
    return resolved_pose(pose, link_named(link_) + ": " + what);
  }

  static urdf::GeometrySharedPtr box(double x, double y, double z) {
    const auto shape = std::make_shared<urdf::Box>();
    shape->dim = urdf::Vector3(x, y, z);
    return shape;
  }
  static urdf::GeometrySharedPtr sphere(double radius) {
    const auto shape = std::make_shared<urdf::Sphere>();
    shape->radius = radius;
    return shape;
  }
  static urdf::GeometrySharedPtr cylinder(double radius, double length) {
    const auto shape = std::make_shared<urdf::Cylinder>();
    shape->radius = radius;
    shape->length = length;
    return shape;
  }

  Isometry3d along_normal(const sdf::Plane& plane) const {
    const Vector3d normal(plane.Normal().X(), plane.Normal().Y(), plane.Normal().Z());
    if (!normal.allFinite() || !(normal.norm() > 0.0))
      refuse(link_named(link_) + " has a <plane> whose normal has no direction");
    return Isometry3d(engine::frame_along(normal));
  }

  /// Returns a box, sphere, cylinder or mesh; null for others, which are named.
  urdf::GeometrySharedPtr plain_shape(const sdf::Geometry& geometry, const std::string& what) {
    switch (geometry.Type()) {
      case sdf::GeometryType::BOX: {
        const auto size = geometry.BoxShape()->Size();
        return box(size.X(), size.Y(), size.Z());
      }
      case sdf::GeometryType::SPHERE:
        return sphere(geometry.SphereShape()->Radius());
      case sdf::GeometryType::CYLINDER:
        return cylinder(geometry.CylinderShape()->Radius(), geometry.CylinderShape()->Length());
      case sdf::GeometryType::MESH:
        return mesh_of(*geometry.MeshShape(), what);
      default: {
        const sdf::ElementPtr shape =
            geometry.Element() ? geometry.Element()->GetFirstElement() : nullptr;
        warn(what + " is left out: its geometry is " +
             (shape ? "<" + shortened(shape->GetName()) + ">" : std::string("empty")));
        return nullptr;
      }
    }
  }

  urdf::GeometrySharedPtr mesh_of(const sdf::Mesh& given, const std::string& what) {
    const auto mesh = std::make_shared<urdf::Mesh>();
    mesh->filename = given.Uri();
    mesh->scale = urdf::Vector3(given.Scale().X(), given.Scale().Y(), given.Scale().Z());
    const std::size_t end = given.Uri().find("://");
    const std::string scheme = end == std::string::npos ? "" : given.Uri().substr(0, end);
    if (scheme == "model") mesh->filename = file_of_model_uri(given.Uri(), folder_);
    const bool is_known =
        scheme.empty() || scheme == "model" || scheme == "package" || scheme == "file";
    if (is_known && !mesh->filename.empty()) return mesh;
    warn(what + " is left out: the mesh '" + shortened(given.Uri(), 200) + "' is not available" +
         (scheme != "model" ? ""
          : folder_.empty() ? ", since a text has no folder to search"
                            : " beside the folder of the SDF or in it"));
    return nullptr;
  }

  urdf::MaterialSharedPtr material_of(const sdf::Visual& visual) const {
    const sdf::ElementPtr element = element_at(visual.Element(), {"material"});
    if (!visual.Material() || !element) return nullptr;
    const bool has_diffuse = element->HasElement("diffuse");
    if (!has_diffuse && !element->HasElement("ambient")) return nullptr;
    const auto colour = has_diffuse ? visual.Material()->Diffuse() : visual.Material()->Ambient();
    const auto material = std::make_shared<urdf::Material>();
    material->name = link_ + "/" + visual.Name();
    material->color.r = colour.R();
    material->color.g = colour.G();
    material->color.b = colour.B();
    material->color.a = colour.A() * (1.0F - visual.Transparency());
    return material;
  }

  /// Reads friction and restitution; those of the first collision hold for the link.
  void add_surface(const sdf::ElementPtr& collision, bool is_first) {
    constexpr double kFriction = 1.0;  // default of SDF
    LinkProperties surface;
    surface.friction = kFriction;
    const sdf::ElementPtr friction = element_at(collision, {"surface", "friction"});
    if (const sdf::ElementPtr ode = element_at(friction, {"ode"}))
      surface.friction = ode->Get<double>("mu", kFriction).first;
    else if (const sdf::ElementPtr bullet = element_at(friction, {"bullet"}))
      surface.friction = bullet->Get<double>("friction", kFriction).first;
    if (const sdf::ElementPtr bounce = element_at(collision, {"surface", "bounce"}))
      surface.restitution = bounce->Get<double>("restitution_coefficient", 0.0).first;
    const bool is_valid = surface.friction >= 0.0 && std::isfinite(surface.friction) &&
                          surface.restitution >= 0.0 && surface.restitution <= 1.0;
    if (!is_valid)
      refuse(link_named(link_) +
             " must have a friction >= 0 and a restitution_coefficient from 0 "
             "to 1, got " +
             std::to_string(surface.friction) + " and " + std::to_string(surface.restitution));
    LinkProperties& kept = model_.properties[link_];
    if (is_first) {
      kept = surface;
    } else if (kept.friction != surface.friction || kept.restitution != surface.restitution) {
      if (!std::exchange(has_warned_, true))
        warn("its collisions differ in friction or restitution; those of the first are used");
    }
  }

  std::string link_;
  bool is_static_;
  std::string folder_;
  SdfModel& model_;
  bool has_warned_ = false;
};

urdf::InertialSharedPtr inertial_of(const sdf::Link& link, const std::string& name) {
  const auto inertial = std::make_shared<urdf::Inertial>();
  const auto given = link.Inertial();
  const auto matrix = given.MassMatrix();
  inertial->origin = to_urdf_pose(sdf_pose(given.Pose(), link_named(name)));
  inertial->mass = matrix.Mass();
  inertial->ixx = matrix.Ixx();
  inertial->ixy = matrix.Ixy();
  inertial->ixz = matrix.Ixz();
  inertial->iyy = matrix.Iyy();
  inertial->iyz = matrix.Iyz();
  inertial->izz = matrix.Izz();
  return inertial;
}

}  // namespace

void check_sdf_errors(const sdf::Errors& errors) {
  if (errors.empty()) return;
  std::string text;
  for (const sdf::Error& error : errors) text += (text.empty() ? "" : "; ") + error.Message();
  refuse("libsdformat rejects the SDF: " + shortened(text, 400));
}

Isometry3d resolved_pose(const sdf::SemanticPose& pose, const std::string& owner,
                         const std::string& resolve_to) {
  auto resolved = pose.RawPose();
  const sdf::Errors errors = pose.Resolve(resolved, resolve_to);
  if (!errors.empty())
    refuse(owner + " has a pose that does not resolve: " + shortened(errors[0].Message(), 300));
  return sdf_pose(resolved, owner);
}

bool sdf_flag(const sdf::ElementPtr& element, const std::string& child, bool otherwise) {
  if (!element || !element->HasElement(child)) return otherwise;
  return element->Get<bool>(child, otherwise).first;
}

urdf::LinkSharedPtr read_sdf_link(const sdf::Link& given, const std::string& name, bool is_static,
                                  const std::string& folder, SdfModel* model) {
  const auto link = std::make_shared<urdf::Link>();
  link->name = name;
  if (!is_static) link->inertial = inertial_of(given, name);
  const auto warn = [&](const std::string& why) {
    if (!is_static) model->warnings.push_back(link_named(name) + " " + why);
  };
  if (!given.Element()->HasElement("inertial"))
    warn("has no <inertial>: SDF gives it a mass of 1 kg and moments of 1 kg m^2");
  if (!sdf_flag(given.Element(), "gravity", true)) warn("has gravity all the same");
  if (sdf_flag(given.Element(), "kinematic", false)) warn("is kinematic in the SDF, and moves");
  SdfShapes shapes(name, is_static, folder, model);
  for (std::size_t i = 0; i < given.CollisionCount(); ++i)
    shapes.add_collision(*given.CollisionByIndex(i), link.get());
  for (std::size_t i = 0; i < given.VisualCount(); ++i)
    shapes.add_visual(*given.VisualByIndex(i), link.get());
  if (!link->collision_array.empty()) link->collision = link->collision_array.front();
  if (!link->visual_array.empty()) link->visual = link->visual_array.front();
  return link;
}

}  // namespace constraint_sim

#endif
