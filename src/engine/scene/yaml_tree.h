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
  bool is_quoted = false;  ///< a scalar in quotes is text, whatever it looks like
  int line = 1;            ///< from 1
  std::string scalar;
  /// Elements of a list; of a map keys and values in turn. An alias is the node it stands for.
  List<const YamlNode*> children;
};

/// A text that is not one YAML document within the bounds.
class YamlError : public std::runtime_error {
 public:
  YamlError(int at_line, const std::string& why) : std::runtime_error(why), line(at_line) {}

  int line;  ///< from 1
};

/// One YAML document. Whatever the text, memory and time to read it grow with its length alone.
class YamlTree {
 public:
  static constexpr std::size_t kMostNodes = 750000;  ///< aliases included
  static constexpr std::size_t kMostDepth = 32;      ///< of lists and maps in each other

  /// Throws YamlError.
  explicit YamlTree(const std::string& text);

  const YamlNode& root() const { return *root_; }

 private:
  class Builder;

  std::deque<YamlNode> nodes_;
  const YamlNode* root_ = nullptr;
};

}  // namespace constraint_sim::engine
