#pragma once

#include <cstddef>
#include <string>

namespace constraint_sim {

/// Left-over elements of xacro, as `<xacro:leg> (line 3)`: the first five, and how many more.
class XacroList {
 public:
  void add(const std::string& what, std::size_t line);
  bool empty() const { return count_ == 0; }
  std::string text() const;

 private:
  static constexpr std::size_t kMost = 5;

  std::string first_;
  std::size_t count_ = 0;
};

/// Elements of xacro in a URDF that xacro was not run on, or only partly.
struct XacroLeft {
  XacroList content;      ///< includes, calls of macros, conditions, `${…}` and `$(…)`
  XacroList definitions;  ///< macros, properties and arguments; the URDF is complete without them
};

/// Finds xacro in the text of a URDF. Skips comments, the content of definitions, and top-level
/// elements other than links, joints and materials, such as `<gazebo>`.
XacroLeft find_xacro(const std::string& text);

}  // namespace constraint_sim
