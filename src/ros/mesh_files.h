#pragma once

#include <map>
#include <string>

namespace constraint_sim {

/// Finds meshes as rviz does. Folders are cached: looking up a package takes milliseconds.
class MeshFiles {
 public:
  /// Returns the path of the regular file of a URI, `package://` or `file://`; empty where there is
  /// none.
  std::string path(const std::string& uri);

 private:
  std::string named(const std::string& uri);

  std::map<std::string, std::string> folders_;  // by package
};

}  // namespace constraint_sim
