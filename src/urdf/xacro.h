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

/// Elements of xacro in a URDF that xacro was not run on, or not completely.
struct XacroLeft {
  XacroList content;      ///< includes, calls of macros, conditions, `${…}` and `$(…)`
  XacroList definitions;  ///< macros, properties and arguments; the URDF is complete without them
};

/// Looks for xacro in all of a text that is read: not in comments, definitions and elements beside
/// links, joints and materials, as `<gazebo>`.
XacroLeft find_xacro(const std::string& text);

}  // namespace constraint_sim
