// The only file that includes Qhull. The reentrant library is a part of Qhull since 2015.

#include "engine/model/hull_triangles.h"

#include <cstdio>
#include <memory>
#include <string>
#include <utility>

extern "C" {
#include <libqhull_r/libqhull_r.h>
}

#include "constraint_sim/engine/convex_hull.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

/// Returns the coordinates of points that are moved and scaled, since tolerances of Qhull are
/// shares of the greatest coordinate. Throws std::invalid_argument for points that are all equal.
std::vector<coordT> scaled(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d low = points[0], high = points[0];
  for (const Eigen::Vector3d& p : points) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const Eigen::Vector3d middle = 0.5 * low + 0.5 * high;
  const double size = (high - low).maxCoeff();
  if (!(size > 0.0)) refuse("vertices", "all points are equal");
  std::vector<coordT> coordinates;
  coordinates.reserve(3 * points.size());
  for (const Eigen::Vector3d& p : points)
    for (int i = 0; i < 3; ++i) coordinates.push_back((p[i] - middle[i]) / size);
  return coordinates;
}

/// Working memory of Qhull, all of which is freed, also after an error.
struct QhullMemory {
  qhT qh;

  QhullMemory() { qh_zero(&qh, nullptr); }
  ~QhullMemory() {
    qh_freeqhull(&qh, !qh_ALL);
    int blocks = 0, bytes = 0;
    qh_memfreeshort(&qh, &blocks, &bytes);
  }
  QhullMemory(const QhullMemory&) = delete;
  QhullMemory& operator=(const QhullMemory&) = delete;
};

/// A run of Qhull.
class QhullRun {
 public:
  /// Throws std::invalid_argument if the points have no hull.
  QhullRun(const std::vector<Eigen::Vector3d>& points, std::string options)
      : coordinates_(scaled(points)) {
    // Qhull's messages are discarded; its error number says enough.
    const std::unique_ptr<FILE, int (*)(FILE*)> nowhere(std::fopen("/dev/null", "w"), &std::fclose);
    const int error = qh_new_qhull(get(), 3, static_cast<int>(points.size()), coordinates_.data(),
                                   False, options.data(), nowhere.get(), nowhere.get());
    if (error != qh_ERRnone) refuse("vertices", "the points lie in a plane, and have no hull");
  }

  qhT* get() { return &memory_.qh; }

 private:
  std::vector<coordT> coordinates_;  // Qhull reads them until its memory is freed
  QhullMemory memory_;
};

}  // namespace

std::vector<Eigen::Vector3d> hull_vertices(const std::vector<Eigen::Vector3d>& points,
                                           std::size_t most) {
  // Qhull stops at 4 vertices more than the number after TA.
  QhullRun run(points, "qhull Pp TA" + std::to_string(most - 3));
  qhT* const qh = run.get();
  if (static_cast<std::size_t>(qh->num_vertices) > most)
    refuse("vertices", "the hull of the points has more than " + std::to_string(most) +
                           " vertices; at most " + std::to_string(kMostHullVertices) +
                           " are allowed");
  std::vector<bool> is_vertex(points.size(), false);
  vertexT* vertex;
  FORALLvertices is_vertex[static_cast<std::size_t>(qh_pointid(qh, vertex->point))] = true;
  std::vector<Eigen::Vector3d> vertices;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (is_vertex[i]) vertices.push_back(points[i]);
  return vertices;
}

std::vector<std::array<int, 3>> hull_triangles(const std::vector<Eigen::Vector3d>& points) {
  QhullRun run(points, "qhull Qt Pp");
  qhT* const qh = run.get();
  std::vector<std::array<int, 3>> triangles;
  facetT* facet;
  FORALLfacets {
    std::array<int, 3> triangle{};
    std::size_t count = 0;
    vertexT *vertex, **vertexp;
    FOREACHsetelement_(vertexT, facet->vertices, vertex) {
      if (count < 3) triangle[count] = qh_pointid(qh, vertex->point);
      ++count;
    }
    if (count != 3) refuse("vertices", "the points lie too close to a plane, and have no hull");
    // Vertices of a simplicial facet are ordered by their age; Qhull states the orientation.
    if (facet->toporient != qh_ORIENTclock) std::swap(triangle[1], triangle[2]);
    triangles.push_back(triangle);
  }
  return triangles;
}

}  // namespace constraint_sim::engine
