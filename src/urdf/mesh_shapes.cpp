#include "urdf/mesh_shapes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "engine/math/numbers.h"
#include "sim/words.h"
#include "urdf/convex_parts.h"
#include "urdf/mesh_file.h"
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

/// Returns the point farthest beyond each face of a hull that has one, and how far that is [m],
/// farthest first.
std::vector<std::pair<double, Vector3d>> points_beyond(const engine::ConvexHull& hull,
                                                       const std::vector<Vector3d>& points) {
  std::vector<std::pair<double, Vector3d>> found;
  for (const auto& face : hull.faces()) {
    std::pair<double, Vector3d> farthest{1e-6 * hull.radius(), Vector3d::Zero()};
    const double rounding = farthest.first;
    for (const Vector3d& p : points)
      if (const double d = face.normal.dot(p) - face.offset; d > farthest.first) farthest = {d, p};
    if (farthest.first > rounding) found.push_back(farthest);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  return found;
}

/// Returns some of the points, whose hull is near that of all: first those farthest along
/// directions, then those farthest beyond the faces of the hull.
std::vector<Vector3d> thinned(const std::vector<Vector3d>& points, std::size_t most) {
  std::vector<Vector3d> kept = farthest_points(points, most / 4);
  for (std::size_t before = 0; before < kept.size() && kept.size() < most;) {
    before = kept.size();
    for (const auto& [distance, p] : points_beyond(engine::ConvexHull(kept), points))
      if (kept.size() < most && std::find(kept.begin(), kept.end(), p) == kept.end())
        kept.push_back(p);
  }
  return kept;
}

/// A hull, and how far points reach beyond it.
struct Fitted {
  MeshHull hull;
  double cut;  ///< [m]
};

Fitted hull_of(std::vector<Vector3d> points) {
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
    if (kept.size() > kMostMeshVertices) kept = thinned(kept, kMostMeshVertices);
  }
  const engine::ConvexHull hull(kept);
  MeshHull found;
  found.in_mesh.translation() = hull.centre();
  found.in_mesh.linear() = hull.axes();
  std::vector<Vector3d> centred;
  for (const Vector3d& p : hull.vertices()) centred.push_back(found.in_mesh.inverse() * p);
  found.hull = engine::Hull(centred);
  const auto beyond = points_beyond(hull, points);
  return {std::move(found), beyond.empty() ? 0.0 : beyond.front().first};
}

std::string with_digits(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// Returns hulls of the convex parts; none where the mesh has no such parts.
std::vector<Fitted> parts_of(const TriangleMesh& mesh, std::size_t most) {
  std::vector<Fitted> parts;
  try {
    for (const std::vector<Vector3d>& points : convex_parts(mesh, most))
      parts.push_back(hull_of(points));
  } catch (const std::invalid_argument&) {
    return {};  // a flat part has no hull
  }
  return parts;
}

}  // namespace

MeshShape collision_of(const TriangleMesh& mesh, std::size_t most_parts) {
  // Share of the hull that a mesh may leave empty and still counts as convex.
  constexpr double kHollow = 0.02;
  std::vector<Fitted> fitted;
  fitted.push_back(hull_of(mesh.points));
  const std::optional<double> enclosed = enclosed_volume(mesh);
  const double solid = enclosed ? std::abs(*enclosed) : 0.0;
  const double of_hull = fitted.front().hull.hull.surface->volume();
  const bool is_convex = solid >= (1.0 - kHollow) * of_hull;
  if (!is_convex && most_parts > 1)
    if (std::vector<Fitted> parts = parts_of(mesh, most_parts); parts.size() > 1)
      fitted = std::move(parts);
  MeshShape shape;
  std::size_t vertices = 0;
  double volume = 0.0, cut = 0.0;
  for (Fitted& part : fitted) {
    vertices += part.hull.hull.surface->vertices().size();
    volume += part.hull.hull.surface->volume();
    cut = std::max(cut, part.cut);
    shape.hulls.push_back(std::move(part.hull));
  }
  shape.sentence =
      "collides as " +
      (fitted.size() == 1 ? "its convex hull" : std::to_string(fitted.size()) + " convex parts") +
      " with " + std::to_string(vertices) + " vertices";
  if (cut > 0.0) shape.sentence += with_digits(", %.2g m inside of it", cut);
  if (is_convex) return shape;
  if (solid > 0.0)
    shape.sentence += with_digits(" (%.3g times its volume)", volume / solid);
  else
    shape.sentence += " (its surface is open)";
  if (fitted.size() == 1 && most_parts > 1)
    shape.sentence += divides_meshes() ? "; it was not divided into convex parts"
                                       : "; HACD, which divides meshes, is not in this program";
  return shape;
}

TriangleMesh read_scaled_mesh(const std::string& path, const Vector3d& scale) {
  TriangleMesh mesh = read_mesh(path);
  for (Vector3d& p : mesh.points) p = p.cwiseProduct(scale);
  if (scale.x() * scale.y() * scale.z() < 0.0)
    for (TriangleMesh::Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

const MeshShape& MeshShapes::of(const std::string& link, const urdf::Mesh& mesh) {
  const auto given = most_parts_.find(link);
  const std::size_t most_parts = given == most_parts_.end() ? kMostMeshParts : given->second;
  char key[128];
  std::snprintf(key, sizeof key, " %.17g %.17g %.17g %zu", mesh.scale.x, mesh.scale.y, mesh.scale.z,
                most_parts);
  const auto [found, is_new] = found_.emplace(mesh.filename + key, MeshShape{});
  if (!is_new) return found->second;
  try {
    const std::string path = path_ ? path_(mesh.filename) : path_of_file(mesh.filename);
    if (path.empty()) throw std::invalid_argument("its file is not known");
    found->second = collision_of(read_scaled_mesh(path, to_eigen(mesh.scale)), most_parts);
  } catch (const std::invalid_argument& error) {
    found->second.sentence = std::string("does not collide: ") + error.what();
  }
  found->second.sentence =
      "the mesh '" + shortened(mesh.filename, 200) + "' " + found->second.sentence;
  return found->second;
}

}  // namespace constraint_sim
