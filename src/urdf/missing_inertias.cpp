#include "urdf/missing_inertias.h"

#include <Eigen/Dense>
#include <cmath>
#include <cstddef>
#include <vector>

#include "engine/math/numbers.h"
#include "urdf/lumps.h"
#include "urdf/parse.h"

namespace constraint_sim {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

bool has_zero_inertia(const urdf::Link& link) {
  if (!link.inertial || !(link.inertial->mass > 0.0)) return false;
  const urdf::Inertial& given = *link.inertial;
  return given.ixx == 0.0 && given.iyy == 0.0 && given.izz == 0.0 && given.ixy == 0.0 &&
         given.ixz == 0.0 && given.iyz == 0.0;
}

/// Returns whether a body has a principal moment of 0, up to rounding.
bool has_no_moment(const Lump& lump) {
  constexpr double kRounding = 1e-12;
  const Vector3d moments =
      Eigen::SelfAdjointEigenSolver<Matrix3d>(lump.inertia(), Eigen::EigenvaluesOnly).eigenvalues();
  const double size = lump.second_moment.cwiseAbs().maxCoeff();
  return moments.minCoeff() <= kRounding * size;
}

/// Returns the first shape of a link in its lump, which are several where it is a mesh of convex
/// parts; none where the link has no shape.
std::vector<const LumpShape*> first_shape_of(const Lump& lump, const std::string& link) {
  std::vector<const LumpShape*> found;
  for (const LumpShape& shape : lump.shapes)
    if (shape.link == link && (found.empty() || found.front()->collision == shape.collision))
      found.push_back(&shape);
  return found;
}

/// Sets the inertia of a shape, whose parts have one density, about the centre of all; `in_lump` is
/// the pose of the link.
void fill_in_by_shape(const std::vector<const LumpShape*>& parts, const Eigen::Isometry3d& in_lump,
                      urdf::Inertial* inertial) {
  const Eigen::Isometry3d frame = in_lump * to_isometry(inertial->origin);
  double volume = 0.0;
  Vector3d moment = Vector3d::Zero();
  for (const LumpShape* part : parts) {
    volume += part->volume;
    moment += part->volume * part->in_lump.translation();
  }
  Matrix3d inertia = Matrix3d::Zero();
  for (const LumpShape* part : parts) {
    const double mass = inertial->mass * part->volume / volume;
    const Matrix3d R = frame.linear().transpose() * part->in_lump.linear();
    const Vector3d off =
        frame.linear().transpose() * (part->in_lump.translation() - moment / volume);
    inertia += R * (mass * engine::unit_inertia(part->shape)).asDiagonal() * R.transpose() +
               mass * point_inertia(off);
  }
  inertial->ixx = inertia(0, 0);
  inertial->iyy = inertia(1, 1);
  inertial->izz = inertia(2, 2);
  inertial->ixy = inertia(0, 1);
  inertial->ixz = inertia(0, 2);
  inertial->iyz = inertia(1, 2);
}

/// Sets the inertia of a sphere with the density of water; returns its radius [m].
double fill_in_by_sphere(urdf::Inertial* inertial) {
  constexpr double kWater = 1000.0;  // kg/m³
  const double radius = std::cbrt(inertial->mass / kWater * 3.0 / (4.0 * engine::kPi));
  inertial->ixx = inertial->iyy = inertial->izz = 0.4 * inertial->mass * radius * radius;
  return radius;
}

}  // namespace

std::vector<std::string> fill_in_inertias(bool is_root_fixed, MeshShapes* meshes,
                                          urdf::ModelInterface* model) {
  std::vector<std::string> sentences;
  const Lumps lumps = lump_links(*model, meshes);
  for (std::size_t i = 0; i < lumps.list.size(); ++i) {
    const Lump& lump = lumps.list[i];
    if ((i == 0 && is_root_fixed) || !(lump.mass > 0.0) || !has_no_moment(lump)) continue;
    for (const std::string& name : lump.links) {
      urdf::Link& link = *model->links_.at(name);
      if (!has_zero_inertia(link)) continue;
      if (const auto shape = first_shape_of(lump, name); !shape.empty()) {
        fill_in_by_shape(shape, lumps.places.at(name).in_lump, &*link.inertial);
        sentences.push_back("link '" + name +
                            "' has a mass and an inertia of 0: it gets that of its shape");
      } else {
        const double radius = fill_in_by_sphere(&*link.inertial);
        sentences.push_back("link '" + name +
                            "' has a mass and an inertia of 0: it gets that of a sphere with the "
                            "density of water, whose radius is " +
                            std::to_string(radius) + " m");
      }
    }
  }
  return sentences;
}

}  // namespace constraint_sim
