#include "urdf/prefixed.h"

#include <algorithm>
#include <cstddef>

#include "urdf/meshes.h"
#include "urdf/xml_tags.h"

namespace constraint_sim {
namespace {

/// Kind of name that an attribute of an element holds.
enum class NameKind { kNone, kLink, kJoint, kMesh };

struct NamedAttribute {
  const char* attribute;
  NameKind kind;
};

/// Returns the attribute of a tag that names a link, a joint or a mesh. `parent` is the element at
/// depth 1 around it.
NamedAttribute named_attribute(const std::string& parent, const std::string& name, int depth) {
  if (depth == 4 && parent == "link" && name == "mesh") return {"filename", NameKind::kMesh};
  if (depth == 1 && name == "link") return {"name", NameKind::kLink};
  if (depth == 1 && name == "joint") return {"name", NameKind::kJoint};
  if (depth != 2 || parent != "joint") return {"", NameKind::kNone};
  if (name == "parent" || name == "child") return {"link", NameKind::kLink};
  if (name == "mimic") return {"joint", NameKind::kJoint};
  return {"", NameKind::kNone};
}

}  // namespace

PrefixedUrdf prefixed_urdf(const std::string& urdf, const std::string& link_prefix,
                           const std::string& joint_prefix, const std::string& folder) {
  PrefixedUrdf prefixed;
  std::size_t copied = 0;
  int depth = 0;
  std::string parent;  // name of the element at depth 1
  XmlTags tags(urdf);
  while (tags.next()) {
    if (tags.kind() == XmlTags::Kind::kDeclaration) continue;
    if (tags.kind() == XmlTags::Kind::kEnd) {
      depth = std::max(depth - 1, 0);
      continue;
    }
    const std::string name = tags.name();
    if (depth == 1) parent = name;
    const auto [attribute, kind] = named_attribute(parent, name, depth);
    const std::size_t place =
        kind == NameKind::kNone ? std::string::npos : tags.place_of(attribute);
    if (place != std::string::npos && kind == NameKind::kMesh) {
      const std::string file = tags.attribute(attribute);
      const bool has_entities = file.find('&') != std::string::npos;  // not decoded here
      const std::string uri = has_entities ? "" : mesh_uri(file, folder);
      if (!uri.empty()) {
        prefixed.text += urdf.substr(copied, place - copied) + uri;
        copied = place + file.size();
      }
    } else if (place != std::string::npos) {
      const std::string& prefix = kind == NameKind::kLink ? link_prefix : joint_prefix;
      prefixed.text += urdf.substr(copied, place - copied) + prefix;
      copied = place;
      if (depth == 1 && kind == NameKind::kJoint)
        prefixed.joints.push_back(prefix + tags.attribute(attribute));
    }
    if (tags.kind() == XmlTags::Kind::kStart) ++depth;
  }
  prefixed.text += urdf.substr(copied);
  return prefixed;
}

}  // namespace constraint_sim
