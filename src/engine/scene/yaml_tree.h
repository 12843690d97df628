#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <stdexcept>
#include <string>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// A value of a YAML document.
struct YamlNode {
  enum class Kind { kNothing, kScalar, kList, kMap };

  Kind kind = Kind::kNothing;
  bool is_quoted = false;  ///< a quoted scalar is text, even if it looks like a number
  int line = 1;            ///< line, from 1
  std::string scalar;
  /// Elements of a list, or keys and values of a map in turn. An alias is the node of its anchor.
  List<const YamlNode*> children;
};

/// Error of a text that is not a single YAML document within the limits.
class YamlError : public std::runtime_error {
 public:
  YamlError(int at_line, const std::string& why) : std::runtime_error(why), line(at_line) {}

  int line;  ///< line, from 1
};

/// A YAML document. Memory and time to read it are bounded by the length of the text.
class YamlTree {
 public:
  static constexpr std::size_t kMostNodes = 750000;  ///< most nodes, aliases included
  static constexpr std::size_t kMostDepth = 32;      ///< most nesting of lists and maps

  /// Parses the text. Throws YamlError.
  explicit YamlTree(const std::string& text);

  const YamlNode& root() const { return *root_; }

 private:
  class Builder;

  std::deque<YamlNode> nodes_;
  const YamlNode* root_ = nullptr;
};

}  // namespace constraint_sim::engine
