#include "ros/mesh_files.h"

#include <ros/package.h>
#include <sys/stat.h>

#include "urdf/meshes.h"

namespace constraint_sim {

std::string MeshFiles::path(const std::string& uri) {
  const std::string found = named(uri);
  struct stat status {};
  return ::stat(found.c_str(), &status) == 0 && S_ISREG(status.st_mode) ? found : "";
}

std::string MeshFiles::named(const std::string& uri) {
  const std::string package = "package://";
  if (uri.compare(0, package.size(), package) != 0) return path_of_file(uri);
  const std::string rest = uri.substr(package.size());
  const std::size_t slash = rest.find('/');
  if (slash == std::string::npos) return "";
  const auto [found, is_new] = folders_.emplace(rest.substr(0, slash), "");
  if (is_new) found->second = ros::package::getPath(found->first);
  return found->second.empty() ? "" : found->second + rest.substr(slash);
}

}  // namespace constraint_sim
