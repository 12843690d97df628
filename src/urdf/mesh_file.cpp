// The only file that includes assimp.

#include "urdf/mesh_file.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <numeric>
#include <stdexcept>
#include <system_error>
#include <utility>

#ifdef CONSTRAINT_SIM_READS_MESHES
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#endif

namespace constraint_sim {

void unite_equal_points(TriangleMesh* mesh) {
  const auto key = [&](std::size_t i) {
    const Eigen::Vector3d& p = mesh->points[i];
    return std::array{p.x(), p.y(), p.z()};
  };
  std::vector<std::size_t> order(mesh->points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  std::vector<Eigen::Vector3d> points;
  std::vector<int> number(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    if (k == 0 || key(order[k]) != key(order[k - 1])) points.push_back(mesh->points[order[k]]);
    number[order[k]] = static_cast<int>(points.size()) - 1;
  }
  mesh->points = std::move(points);
  std::vector<TriangleMesh::Triangle> triangles;
  for (TriangleMesh::Triangle t : mesh->triangles) {
    for (int& corner : t) corner = number[static_cast<std::size_t>(corner)];
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) triangles.push_back(t);
  }
  mesh->triangles = std::move(triangles);
}

#ifdef CONSTRAINT_SIM_READS_MESHES
namespace {

constexpr std::uintmax_t kMostBytes = std::uintmax_t{256} << 20;
constexpr std::size_t kMostVertices = 3000000;

void add_triangles(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent, int depth,
                   TriangleMesh* found) {
  constexpr int kMostDepth = 100;
  if (depth > kMostDepth) throw std::invalid_argument("its nodes are nested too deeply");
  const aiMatrix4x4 in_file = parent * node.mTransformation;
  const bool is_mirrored = in_file.Determinant() < 0.0f;
  for (unsigned i = 0; i < node.mNumMeshes; ++i) {
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[i]];
    const auto first = static_cast<int>(found->points.size());
    if (found->points.size() + mesh.mNumVertices > kMostVertices)
      throw std::invalid_argument("it has more than 3 million vertices");
    for (unsigned k = 0; k < mesh.mNumVertices; ++k) {
      const aiVector3D p = in_file * mesh.mVertices[k];
      found->points.emplace_back(p.x, p.y, p.z);
      if (!found->points.back().allFinite())
        throw std::invalid_argument("a vertex is not a finite number");
    }
    for (unsigned k = 0; k < mesh.mNumFaces; ++k) {
      const aiFace& face = mesh.mFaces[k];
      if (face.mNumIndices != 3) continue;
      TriangleMesh::Triangle t{};
      for (std::size_t c = 0; c < 3; ++c) t[c] = first + static_cast<int>(face.mIndices[c]);
      if (is_mirrored) std::swap(t[1], t[2]);
      found->triangles.push_back(t);
    }
  }
  for (unsigned i = 0; i < node.mNumChildren; ++i)
    add_triangles(scene, *node.mChildren[i], in_file, depth + 1, found);
}

}  // namespace

TriangleMesh read_mesh(const std::string& path) {
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (!error && bytes > kMostBytes)
    throw std::invalid_argument("it has more than 256 MiB, " + std::to_string(bytes) + " bytes");
  Assimp::Importer importer;
  // Robots' frames have z upward whatever the file says, as in rviz.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  // Lines and points of a drawing bound no solid.
  importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE,
                              aiPrimitiveType_LINE | aiPrimitiveType_POINT);
  const aiScene* const scene =
      importer.ReadFile(path, aiProcess_Triangulate | aiProcess_SortByPType);
  if (scene == nullptr || scene->mRootNode == nullptr)
    throw std::invalid_argument("it cannot be read");
  TriangleMesh mesh;
  add_triangles(*scene, *scene->mRootNode, aiMatrix4x4(), 0, &mesh);
  if (mesh.points.empty()) throw std::invalid_argument("it has no triangles");
  unite_equal_points(&mesh);
  return mesh;
}
#else
TriangleMesh read_mesh(const std::string&) {
  throw std::invalid_argument("this program was built without assimp");
}
#endif

}  // namespace constraint_sim
