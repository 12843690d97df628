#include "urdf/elements.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "sim/words.h"
#include "urdf/parse.h"
#include "urdf/xml_tags.h"

namespace constraint_sim {
namespace {

/// Elements that the conversion reads, by the path of their parent. The contents of other parents
/// are all read.
struct ReadElements {
  const char* parent;
  const char* children;  ///< with a blank before and after each name
};

constexpr std::array<ReadElements, 6> kRead{{
    {"robot", " link joint material "},
    {"robot/link", " inertial visual collision "},
    {"robot/joint", " origin parent child axis limit dynamics mimic "},
    {"robot/link/inertial", " origin mass inertia "},
    {"robot/link/visual", " origin geometry material "},
    {"robot/link/collision", " origin geometry "},
}};

/// Elements of SDF, by the name of their parent. Those that only viewers use count as read.
constexpr std::array<ReadElements, 18> kReadOfSdf{{
    {"sdf", " world model "},
    {"world", " model "},
    {"model", " static pose link joint frame model self_collide allow_auto_disable enable_wind "},
    {"link", " pose inertial visual collision gravity self_collide kinematic enable_wind "},
    {"inertial", " pose mass inertia "},
    {"joint",
     " parent child pose axis axis2 thread_pitch screw_thread_pitch gearbox_ratio "
     "gearbox_reference_body "},
    {"axis", " xyz dynamics limit use_parent_model_frame "},
    {"axis2", " xyz dynamics limit use_parent_model_frame "},
    {"dynamics", " damping friction spring_reference spring_stiffness "},
    {"limit", " lower upper effort velocity "},
    {"visual", " pose geometry material transparency cast_shadows laser_retro visibility_flags "},
    {"material", " ambient diffuse specular emissive "},
    {"mesh", " uri scale "},
    {"collision", " pose geometry surface laser_retro max_contacts "},
    {"surface", " friction bounce "},
    {"friction", " ode bullet "},
    {"ode", " mu mu2 "},
    {"bounce", " restitution_coefficient threshold "},
}};

template <std::size_t size>
bool is_element_in(const std::array<ReadElements, size>& table, const std::string& parent,
                   const std::string& name) {
  const auto found = std::find_if(table.begin(), table.end(),
                                  [&](const ReadElements& read) { return parent == read.parent; });
  return found == table.end() ||
         std::string(found->children).find(" " + name + " ") != std::string::npos;
}

/// Kinds of elements with the number of each and the line of the first.
class ElementCounts {
 public:
  void add(const std::string& what, std::size_t line) {
    const auto found = std::find_if(kinds_.begin(), kinds_.end(),
                                    [&](const Entry& entry) { return entry.what == what; });
    if (found != kinds_.end())
      ++found->count;
    else if (kinds_.size() < kMost)
      kinds_.push_back({what, 1, line});
    else
      ++others_;
  }

  std::string text() const {
    std::string text;
    for (const Entry& entry : kinds_) {
      const std::string line = "line " + std::to_string(entry.line);
      const std::string count = std::to_string(entry.count);
      text += (text.empty() ? "" : ", ") + entry.what + " (" +
              (entry.count == 1 ? line : count + ", first in " + line) + ")";
    }
    return others_ == 0 ? text : text + " and " + std::to_string(others_) + " more";
  }

 private:
  struct Entry {
    std::string what;
    std::size_t count, line;
  };
  static constexpr std::size_t kMost = 10;

  std::vector<Entry> kinds_;
  std::size_t others_ = 0;
};

std::string parent_path(const std::vector<std::string>& open) {
  std::string path;
  for (const std::string& name : open) path += (path.empty() ? "" : "/") + name;
  return path;
}

/// `open`: the elements around the element, from the root.
bool is_element_read(const std::vector<std::string>& open, const std::string& name) {
  if (open.front() == "sdf") return is_element_in(kReadOfSdf, open.back(), name);
  return is_element_in(kRead, parent_path(open), name);
}

}  // namespace

void check_root_element(const std::string& urdf) {
  XmlTags tags(urdf);
  while (tags.next() && tags.kind() == XmlTags::Kind::kDeclaration) {
  }
  const std::string root = tags.place() < urdf.size() ? tags.name() : "";
  const std::string expected = "a URDF is XML and begins with <robot>, an SDF with <sdf>";
  if (root.empty()) refuse("the text has no element of XML; " + expected);
  const std::string begins = "the text begins with <" + shortened(root) + ">";
  if (root == "gazebo" || root == "world" || root == "model")
    refuse(begins + ", which is SDF without its first element <sdf>; " + expected);
  if (root == "mujoco" || root == "mujocoinclude")
    refuse(begins + ", which is MJCF of MuJoCo, and MJCF is not read; " + expected);
}

std::string unread_elements(const std::string& urdf) {
  ElementCounts counts;
  std::vector<std::string> open;  // elements around the tag, from the root
  std::size_t unread_depth = 0;   // depth of the element whose contents are skipped; 0: none
  std::size_t line = 1, counted = 0;
  XmlTags tags(urdf);
  while (tags.next()) {
    if (tags.kind() == XmlTags::Kind::kDeclaration) continue;
    if (tags.kind() == XmlTags::Kind::kEnd) {
      if (!open.empty()) open.pop_back();
      if (open.size() <= unread_depth) unread_depth = 0;
      continue;
    }
    const std::string name = tags.name();
    if (unread_depth == 0 && !open.empty() && !is_element_read(open, name)) {
      const auto begin = static_cast<std::ptrdiff_t>(std::exchange(counted, tags.place()));
      const auto end = static_cast<std::ptrdiff_t>(counted);
      line += static_cast<std::size_t>(std::count(urdf.begin() + begin, urdf.begin() + end, '\n'));
      const bool is_in_robot = open.size() == 1;
      const bool is_xacro = name.find(':') != std::string::npos && name.compare(0, 5, "xacro") == 0;
      if (!is_xacro)
        counts.add("<" + shortened(name) + ">" + (is_in_robot ? "" : " in <" + open.back() + ">"),
                   line);
      if (tags.kind() == XmlTags::Kind::kStart) unread_depth = open.size();
    }
    if (tags.kind() == XmlTags::Kind::kStart) open.push_back(name);
  }
  return counts.text();
}

}  // namespace constraint_sim
