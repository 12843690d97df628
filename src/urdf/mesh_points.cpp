// The only file that includes assimp.

#include "urdf/mesh_points.h"

#include <stdexcept>

#ifdef CONSTRAINT_SIM_READS_MESHES
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#endif

namespace constraint_sim {

#ifdef CONSTRAINT_SIM_READS_MESHES
namespace {

constexpr std::size_t kMostVertices = 3000000;

void add_points(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent, int depth,
                std::vector<Eigen::Vector3d>* points) {
  constexpr int kMostDepth = 100;
  if (depth > kMostDepth) throw std::invalid_argument("its nodes are nested too deeply");
  const aiMatrix4x4 in_file = parent * node.mTransformation;
  for (unsigned i = 0; i < node.mNumMeshes; ++i) {
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[i]];
    if (points->size() + mesh.mNumVertices > kMostVertices)
      throw std::invalid_argument("it has more than 3 million vertices");
    for (unsigned k = 0; k < mesh.mNumVertices; ++k) {
      const aiVector3D p = in_file * mesh.mVertices[k];
      points->emplace_back(p.x, p.y, p.z);
      if (!points->back().allFinite())
        throw std::invalid_argument("a vertex is not a finite number");
    }
  }
  for (unsigned i = 0; i < node.mNumChildren; ++i)
    add_points(scene, *node.mChildren[i], in_file, depth + 1, points);
}

}  // namespace

bool reads_meshes() { return true; }

std::vector<Eigen::Vector3d> read_mesh_points(const std::string& path) {
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
  std::vector<Eigen::Vector3d> points;
  add_points(*scene, *scene->mRootNode, aiMatrix4x4(), 0, &points);
  if (points.empty()) throw std::invalid_argument("it has no triangles");
  return points;
}
#else
bool reads_meshes() { return false; }

std::vector<Eigen::Vector3d> read_mesh_points(const std::string&) {
  throw std::invalid_argument("this program was built without assimp");
}
#endif

}  // namespace constraint_sim
