#pragma once

#include <cstddef>
#include <string>

namespace constraint_sim {

/// What is left of xacro in a text, as `<xacro:leg> (line 3)`: the first ones, and how many others.
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

/// What xacro would have replaced in a URDF that it has not, or not quite, been run on.
struct XacroLeft {
  XacroList content;      ///< includes, calls of macros, conditions, `${…}` and `$(…)`
  XacroList definitions;  ///< of macros, properties and arguments: nothing is missing for them
};

/// Looks for xacro in all of a text that is read: not in comments, definitions and elements beside
/// links, joints and materials, as `<gazebo>`.
XacroLeft find_xacro(const std::string& text);

}  // namespace constraint_sim
