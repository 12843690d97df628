#include "urdf/meshes.h"

#include <array>
#include <cctype>
#include <cstdio>
#include <cstdlib>

#include "sim/words.h"
#include "urdf/parse.h"

namespace constraint_sim {
namespace {

const std::string kFile = "file://";

bool begins_with(const std::string& text, const std::string& begin) {
  return text.compare(0, begin.size(), begin) == 0;
}

bool is_hex(char c) { return std::isxdigit(static_cast<unsigned char>(c)) != 0; }

bool is_escape(const std::string& text, std::size_t at) {
  return text[at] == '%' && at + 2 < text.size() && is_hex(text[at + 1]) && is_hex(text[at + 2]);
}

/// Escapes the characters of a path that a URI, or an attribute of XML, cannot have.
/// `keeps_escapes`: escapes in the path stay.
std::string escaped(const std::string& path, bool keeps_escapes) {
  std::string uri;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const auto c = static_cast<unsigned char>(path[i]);
    const bool is_plain =
        std::isalnum(c) != 0 || std::string("/-_.~!()*,:@+=$;").find(path[i]) != std::string::npos;
    if (is_plain || (keeps_escapes && is_escape(path, i))) {
      uri += path[i];
      continue;
    }
    std::array<char, 4> code{};
    std::snprintf(code.data(), code.size(), "%%%02X", static_cast<unsigned>(c));
    uri += code.data();
  }
  return uri;
}

}  // namespace

std::string mesh_uri(const std::string& name, const std::string& folder) {
  const bool is_file = begins_with(name, kFile);
  if (!is_file && name.find("://") != std::string::npos) return name;
  std::string path = is_file ? name.substr(kFile.size()) : name;
  if (is_file && begins_with(path, "localhost/")) path.erase(0, path.find('/'));
  if (path.empty()) return name;
  if (path[0] == '/') return kFile + escaped(path, is_file);
  if (folder.empty()) return "";
  while (begins_with(path, "./")) path.erase(0, 2);
  return kFile + escaped(folder + "/", false) + escaped(path, is_file);
}

std::string path_of_file_uri(const std::string& uri) {
  std::string path;
  for (std::size_t i = kFile.size(); i < uri.size(); ++i) {
    if (!is_escape(uri, i)) {
      path += uri[i];
      continue;
    }
    path += static_cast<char>(std::strtol(uri.substr(i + 1, 2).c_str(), nullptr, 16));
    i += 2;
  }
  return path;
}

std::string path_of_file(const std::string& uri) {
  return begins_with(uri, kFile) ? path_of_file_uri(uri) : "";
}

std::vector<std::string> name_meshes(const std::string& folder, const MeshExists& exists,
                                     urdf::ModelInterface* model) {
  std::vector<std::string> sentences;
  const auto rename = [&](const std::string& link, urdf::Geometry* geometry, bool is_visual) {
    if (geometry->type != urdf::Geometry::MESH) return;
    std::string& file = static_cast<urdf::Mesh*>(geometry)->filename;
    const std::string uri = mesh_uri(file, folder);
    if (!uri.empty() && exists && !exists(uri))
      refuse("link '" + link + "': there is no mesh '" + shortened(uri, 200) + "'");
    if (uri.empty() && is_visual)
      sentences.push_back("link '" + link + "': the mesh '" + shortened(file, 200) +
                          "' is not shown: its name is relative to the folder of the URDF, and a "
                          "text has no folder: load the URDF by its path, or use package://");
    if (!uri.empty() || is_visual) file = uri;
  };
  for (const auto& [name, link] : model->links_) {
    for (const auto& visual : link->visual_array) rename(name, visual->geometry.get(), true);
    for (const auto& collision : link->collision_array)
      rename(name, collision->geometry.get(), false);
  }
  return sentences;
}

}  // namespace constraint_sim
