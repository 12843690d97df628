#include "urdf/mesh_hulls.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "engine/math/numbers.h"
#include "sim/words.h"
#include "urdf/mesh_points.h"
#include "urdf/parse.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;

/// Returns the points farthest along directions that are spread evenly by the golden angle.
std::vector<Vector3d> farthest_points(const std::vector<Vector3d>& points, std::size_t directions) {
  std::vector<bool> is_kept(points.size(), false);
  const double turn = engine::kPi * (3.0 - std::sqrt(5.0));
  for (std::size_t k = 0; k < directions; ++k) {
    const double z = 1.0 - (2.0 * static_cast<double>(k) + 1.0) / static_cast<double>(directions);
    const double across = std::sqrt(1.0 - z * z), angle = turn * static_cast<double>(k);
    const Vector3d n(across * std::cos(angle), across * std::sin(angle), z);
    std::size_t best = 0;
    for (std::size_t i = 1; i < points.size(); ++i)
      if (n.dot(points[i]) > n.dot(points[best])) best = i;
    is_kept[best] = true;
  }
  std::vector<Vector3d> kept;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (is_kept[i]) kept.push_back(points[i]);
  return kept;
}

/// Returns how far the points reach beyond a hull [m].
double beyond(const engine::ConvexHull& hull, const std::vector<Vector3d>& points) {
  double most = 0.0;
  for (const Vector3d& p : points)
    for (const auto& face : hull.faces()) most = std::max(most, face.normal.dot(p) - face.offset);
  return most;
}

std::vector<Vector3d> without_duplicates(std::vector<Vector3d> points) {
  const auto key = [](const Vector3d& p) { return std::array{p.x(), p.y(), p.z()}; };
  std::sort(points.begin(), points.end(),
            [&](const Vector3d& l, const Vector3d& r) { return key(l) < key(r); });
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

MeshHull hull_of(const std::vector<Vector3d>& all) {
  std::vector<Vector3d> points = without_duplicates(all);
  // Many points are first thinned out, to bound the time of Qhull.
  constexpr std::size_t kThinned = 2000;
  if (points.size() > engine::kMostHullPoints) points = farthest_points(points, kThinned);
  std::vector<Vector3d> kept = points;
  if (kept.size() > kMostMeshVertices) {
    try {
      const engine::ConvexHull whole(points);
      kept = whole.vertices();
    } catch (const std::invalid_argument&) {
      // More vertices than a hull may have, or points in a plane, which the second attempt rejects.
    }
    if (kept.size() > kMostMeshVertices) kept = farthest_points(kept, kMostMeshVertices);
  }
  const engine::ConvexHull hull(kept);
  MeshHull found;
  found.in_mesh.translation() = hull.centre();
  found.in_mesh.linear() = hull.axes();
  std::vector<Vector3d> centred;
  for (const Vector3d& p : hull.vertices()) centred.push_back(found.in_mesh.inverse() * p);
  found.hull = engine::Hull(centred);
  const double cut = beyond(hull, points);
  found.sentence =
      "collides as its convex hull with " + std::to_string(centred.size()) + " vertices";
  char text[48];
  std::snprintf(text, sizeof text, ", %.2g m inside of it", cut);
  if (cut > 1e-6 * hull.radius()) found.sentence += text;
  return found;
}

}  // namespace

const MeshHull& MeshHulls::of(const urdf::Mesh& mesh) {
  char scale[96];
  std::snprintf(scale, sizeof scale, " %.17g %.17g %.17g", mesh.scale.x, mesh.scale.y,
                mesh.scale.z);
  const auto [found, is_new] = found_.emplace(mesh.filename + scale, MeshHull{});
  if (!is_new) return found->second;
  try {
    const std::string path = path_ ? path_(mesh.filename) : path_of_file(mesh.filename);
    if (path.empty()) throw std::invalid_argument("its file is not known");
    std::vector<Vector3d> points = read_mesh_points(path);
    for (Vector3d& p : points) p = p.cwiseProduct(to_eigen(mesh.scale));
    found->second = hull_of(points);
  } catch (const std::invalid_argument& error) {
    found->second.sentence = std::string("does not collide: ") + error.what();
  }
  found->second.sentence =
      "the mesh '" + shortened(mesh.filename, 200) + "' " + found->second.sentence;
  return found->second;
}

}  // namespace constraint_sim
