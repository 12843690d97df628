#pragma once

#include <urdf_model/model.h>

#include <functional>
#include <string>
#include <vector>

namespace constraint_sim {

/// Returns the URI of a mesh as other programs read it. A path, also one after `file://`, becomes
/// `file://` with an absolute path; a relative one starts at `folder`, the absolute path of the
/// folder of the URDF. Other names, such as `package://`, stay. Empty: the path is relative and
/// there is no folder.
std::string mesh_uri(const std::string& name, const std::string& folder);

/// Returns the path of a `file://` URI, with its escapes decoded.
std::string path_of_file_uri(const std::string& uri);

/// Returns the path of a `file://` URI, and nothing for other names.
std::string path_of_file(const std::string& uri);

/// Returns the file path of a URI, empty where there is none. An empty std::function stands for
/// path_of_file().
using MeshPath = std::function<std::string(const std::string& uri)>;

/// Returns whether the file of a URI exists. With an empty std::function files are not checked.
using MeshExists = std::function<bool(const std::string& uri)>;

/// Replaces the names of meshes by their URIs. A visual without one gets an empty name and is not
/// shown: a returned sentence names it. Throws std::invalid_argument for a missing file.
std::vector<std::string> name_meshes(const std::string& folder, const MeshExists& exists,
                                     urdf::ModelInterface* model);

}  // namespace constraint_sim
