// The only file that includes HACD.

#include "urdf/convex_parts.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#ifdef CONSTRAINT_SIM_DIVIDES_MESHES
#include <hacdHACD.h>
#endif

namespace constraint_sim {

using Eigen::Vector3d;

std::optional<double> enclosed_volume(const TriangleMesh& mesh) {
  std::vector<std::pair<int, int>> edges, opposite;
  double six_volumes = 0.0;
  if (mesh.triangles.empty()) return std::nullopt;
  const Vector3d origin = mesh.points.front();
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      edges.emplace_back(t[k], t[(k + 1) % 3]);
      opposite.emplace_back(t[(k + 1) % 3], t[k]);
    }
    const auto corner = [&](std::size_t k) {
      return Vector3d(mesh.points[static_cast<std::size_t>(t[k])] - origin);
    };
    six_volumes += corner(0).dot(corner(1).cross(corner(2)));
  }
  std::sort(edges.begin(), edges.end());
  std::sort(opposite.begin(), opposite.end());
  const bool is_closed =
      edges == opposite && std::adjacent_find(edges.begin(), edges.end()) == edges.end();
  if (!is_closed) return std::nullopt;
  return six_volumes / 6.0;
}

#ifdef CONSTRAINT_SIM_DIVIDES_MESHES
namespace {

// Triangles that HACD gets at most: its time grows with their square.
constexpr std::size_t kMostTriangles = 500;
// Cells along the diagonal of the first grid and of the last, and the most in the next over those
// before.
constexpr double kCells = 40.0, kLeastCells = 5.0, kCoarser = 0.8;
// HACD scales meshes to a diagonal of 2000. Depth of hollows that hulls may fill, at first, and
// over the one before where there are too many parts.
constexpr double kDiagonal = 2000.0, kFilled = 0.02 * kDiagonal, kMoreFilled = 2.0;

/// A mesh whose points are united in cells of a grid.
struct Gridded {
  TriangleMesh mesh;         ///< a point for each cell, at the mean of its points
  std::vector<int> cell_of;  ///< cell of each original point
};

double diagonal(const std::vector<Vector3d>& points) {
  Vector3d low = points.front(), high = points.front();
  for (const Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return (high - low).norm();
}

Gridded gridded(const TriangleMesh& mesh, double edge) {
  Gridded result;
  std::map<std::array<double, 3>, int> cells;
  std::vector<int> counts;
  for (const Vector3d& p : mesh.points) {
    const Vector3d at = (p - mesh.points.front()) / edge;
    const std::array key{std::floor(at.x()), std::floor(at.y()), std::floor(at.z())};
    const auto [cell, is_new] = cells.emplace(key, static_cast<int>(cells.size()));
    if (is_new) {
      result.mesh.points.push_back(Vector3d::Zero());
      counts.push_back(0);
    }
    result.mesh.points[static_cast<std::size_t>(cell->second)] += p;
    ++counts[static_cast<std::size_t>(cell->second)];
    result.cell_of.push_back(cell->second);
  }
  for (std::size_t i = 0; i < counts.size(); ++i) result.mesh.points[i] /= counts[i];
  std::set<TriangleMesh::Triangle> known;  // from the least corner on
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    TriangleMesh::Triangle united{};
    for (std::size_t k = 0; k < 3; ++k) united[k] = result.cell_of[static_cast<std::size_t>(t[k])];
    if (united[0] == united[1] || united[1] == united[2] || united[2] == united[0]) continue;
    std::rotate(united.begin(), std::min_element(united.begin(), united.end()), united.end());
    if (known.insert(united).second) result.mesh.triangles.push_back(united);
  }
  return result;
}

/// Whether HACD divides a mesh in bounded time: it looks at all pairs of triangles with a common
/// edge, which are three for two triangles of a surface, and at the points of all pairs of pieces.
bool is_divisible(const TriangleMesh& mesh) {
  constexpr std::size_t kMostPieces = 32;
  if (mesh.triangles.size() > kMostTriangles) return false;
  std::map<std::pair<int, int>, std::size_t> triangles_of;
  std::vector<int> piece(mesh.points.size());
  std::iota(piece.begin(), piece.end(), 0);
  const auto piece_of = [&](int point) {
    while (piece[static_cast<std::size_t>(point)] != point)
      point = piece[static_cast<std::size_t>(point)];
    return point;
  };
  std::size_t pairs = 0;
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax(t[k], t[(k + 1) % 3]);
      pairs += triangles_of[{low, high}]++;
      piece[static_cast<std::size_t>(piece_of(low))] = piece_of(high);
    }
  std::set<int> pieces;
  for (const TriangleMesh::Triangle& t : mesh.triangles) pieces.insert(piece_of(t[0]));
  return !pieces.empty() && pairs <= 2 * mesh.triangles.size() && pieces.size() <= kMostPieces;
}

/// Returns the mesh itself, or the finest tried grid of it that HACD divides in bounded time;
/// without triangles where there is none.
Gridded divisible(const TriangleMesh& mesh) {
  Gridded result{mesh, {}};
  for (std::size_t i = 0; i < mesh.points.size(); ++i)
    result.cell_of.push_back(static_cast<int>(i));
  const double size = diagonal(mesh.points);
  double cells = kCells;
  while (!is_divisible(result.mesh)) {
    if (cells < kLeastCells) return {};
    result = gridded(mesh, size / cells);
    // a surface has triangles as the square of the number of cells along it
    const double share =
        static_cast<double>(kMostTriangles) /
        static_cast<double>(std::max<std::size_t>(result.mesh.triangles.size(), 1));
    cells *= std::min(kCoarser, std::sqrt(share));
  }
  return result;
}

/// Returns the part of each triangle.
std::vector<int> parts_of_triangles(const TriangleMesh& mesh, std::size_t most) {
  std::vector<HACD::Vec3<HACD::Real>> points;
  std::vector<HACD::Vec3<long>> triangles;
  for (const Vector3d& p : mesh.points) points.emplace_back(p.x(), p.y(), p.z());
  for (const TriangleMesh::Triangle& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
  for (double filled = kFilled; filled <= kDiagonal; filled *= kMoreFilled) {
    std::vector<HACD::Vec3<HACD::Real>> scaled = points;  // HACD changes them
    HACD::HACD hacd;
    hacd.SetPoints(scaled.data());
    hacd.SetNPoints(scaled.size());
    hacd.SetTriangles(triangles.data());
    hacd.SetNTriangles(triangles.size());
    hacd.SetNClusters(1);
    hacd.SetConcavity(filled);
    hacd.SetConnectDist(kFilled);  // may unite pieces that nearly touch
    hacd.SetVolumeWeight(0.0);
    hacd.SetAddExtraDistPoints(true);
    hacd.SetAddNeighboursDistPoints(true);
    hacd.SetAddFacesPoints(true);
    if (!hacd.Compute()) return {};
    if (hacd.GetNClusters() > most) continue;
    std::vector<int> parts;
    for (std::size_t t = 0; t < triangles.size(); ++t)
      parts.push_back(static_cast<int>(hacd.GetPartition()[t]));
    return parts;
  }
  return {};
}

/// Gives cells without triangles the part of a cell that an original triangle connects them with.
void fill_in_parts(const TriangleMesh& mesh, const std::vector<int>& cell_of,
                   std::vector<std::set<int>>* parts_of_cell) {
  for (bool changes = true; changes;) {
    changes = false;
    for (const TriangleMesh::Triangle& t : mesh.triangles)
      for (const int from : t)
        for (const int to : t) {
          const auto& known =
              (*parts_of_cell)[static_cast<std::size_t>(cell_of[static_cast<std::size_t>(from)])];
          auto& other =
              (*parts_of_cell)[static_cast<std::size_t>(cell_of[static_cast<std::size_t>(to)])];
          if (known.empty() || !other.empty()) continue;
          other.insert(*known.begin());
          changes = true;
        }
  }
}

}  // namespace

bool divides_meshes() { return true; }

std::vector<std::vector<Vector3d>> convex_parts(const TriangleMesh& mesh, std::size_t most) {
  if (mesh.triangles.empty()) return {};
  if (const double size = diagonal(mesh.points); !(size > 0.0) || !std::isfinite(size)) return {};
  const Gridded divided = divisible(mesh);
  if (divided.mesh.triangles.empty()) return {};
  const std::vector<int> part_of = parts_of_triangles(divided.mesh, most);
  if (part_of.empty()) return {};
  std::vector<std::set<int>> parts_of_cell(divided.mesh.points.size());
  for (std::size_t t = 0; t < part_of.size(); ++t)
    for (const int corner : divided.mesh.triangles[t])
      parts_of_cell[static_cast<std::size_t>(corner)].insert(part_of[t]);
  fill_in_parts(mesh, divided.cell_of, &parts_of_cell);
  std::map<int, std::vector<Vector3d>> points_of;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const std::set<int>& parts = parts_of_cell[static_cast<std::size_t>(divided.cell_of[i])];
    if (parts.empty()) return {};
    for (const int part : parts) points_of[part].push_back(mesh.points[i]);
  }
  std::vector<std::vector<Vector3d>> result;
  for (auto& [part, points] : points_of) result.push_back(std::move(points));
  return result;
}
#else
bool divides_meshes() { return false; }

std::vector<std::vector<Vector3d>> convex_parts(const TriangleMesh&, std::size_t) { return {}; }
#endif

}  // namespace constraint_sim
