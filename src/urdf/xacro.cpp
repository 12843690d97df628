#include "urdf/xacro.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "sim/words.h"
#include "urdf/xml_tags.h"

namespace constraint_sim {
namespace {

constexpr int kNone = -1;

bool starts_with(const std::string& text, const std::string& start) {
  return text.compare(0, start.size(), start) == 0;
}

/// Returns the prefix, with its colon, that `xmlns:PREFIX="http://www.ros.org/wiki/xacro"` in a tag
/// gives to elements of xacro.
std::string xacro_prefix(const std::string& tag) {
  const std::string word = "xmlns:", uri = "xacro";
  for (std::size_t at = tag.find(word); at != std::string::npos; at = tag.find(word, at)) {
    at += word.size();
    const std::size_t equals = tag.find('=', at);
    const std::size_t open = tag.find_first_of("\"'", at);
    if (equals == std::string::npos || open == std::string::npos) break;
    const std::size_t close = tag.find(tag[open], open + 1);
    if (close == std::string::npos) break;
    const std::string value = tag.substr(open + 1, close - open - 1);
    if (value.size() >= uri.size() && value.substr(value.size() - uri.size()) == uri)
      return tag.substr(at, equals - at) + ":";
  }
  return "xacro:";
}

bool is_definition(const std::string& name) {
  return name == "macro" || name == "property" || name == "arg";
}

/// Returns whether `$(` at this place begins a substitution of xacro, as in `$(find robot)`.
bool is_argument(const std::string& tag, std::size_t at) {
  constexpr std::array<const char*, 7> kKinds{"find ", "arg ",    "env ", "optenv ",
                                              "eval ", "dirname", "anon "};
  return std::any_of(kKinds.begin(), kKinds.end(), [&](const std::string& kind) {
    return tag.compare(at + 2, kind.size(), kind) == 0;
  });
}

void add_expressions(const std::string& tag, std::size_t line, XacroList* list) {
  for (std::size_t at = tag.find('$'); at != std::string::npos; at = tag.find('$', at + 1)) {
    const bool is_property = tag.compare(at, 2, "${") == 0;
    if (!is_property && !(tag.compare(at, 2, "$(") == 0 && is_argument(tag, at))) continue;
    const std::size_t end = tag.find(is_property ? '}' : ')', at);
    if (end == std::string::npos) return;
    list->add(shortened(tag.substr(at, end + 1 - at)), line);
    at = end;
  }
}

bool is_read(const std::string& name) {
  return name == "link" || name == "joint" || name == "material";
}

}  // namespace

void XacroList::add(const std::string& what, std::size_t line) {
  if (++count_ > kMost) return;
  first_ += (first_.empty() ? "" : ", ") + what + " (line " + std::to_string(line) + ")";
}

std::string XacroList::text() const {
  return count_ <= kMost ? first_ : first_ + " and " + std::to_string(count_ - kMost) + " more";
}

XacroLeft find_xacro(const std::string& text) {
  XacroLeft left;
  std::string prefix = "xacro:";
  int depth = 0, skipped = kNone;  // depth of the element whose content is skipped
  std::size_t line = 1, counted = 0;
  XmlTags tags(text);
  while (tags.next()) {
    if (tags.kind() == XmlTags::Kind::kDeclaration) continue;
    if (tags.kind() == XmlTags::Kind::kEnd) {
      depth = std::max(depth - 1, 0);
      if (depth <= skipped) skipped = kNone;
      continue;
    }
    if (skipped == kNone) {
      const auto begin = static_cast<std::ptrdiff_t>(std::exchange(counted, tags.place()));
      const auto end = static_cast<std::ptrdiff_t>(counted);
      line += static_cast<std::size_t>(std::count(text.begin() + begin, text.begin() + end, '\n'));
      const std::string name = tags.name(), tag = tags.text();
      if (depth == 0) prefix = xacro_prefix(tag);
      const bool is_xacro = starts_with(name, prefix);
      if (is_xacro)
        (is_definition(name.substr(prefix.size())) ? left.definitions : left.content)
            .add("<" + shortened(name) + ">", line);
      const bool is_left_out = is_xacro || (depth == 1 && !is_read(name));
      if (!is_left_out) add_expressions(tag, line, &left.content);
      if (is_left_out && tags.kind() == XmlTags::Kind::kStart) skipped = depth;
    }
    if (tags.kind() == XmlTags::Kind::kStart) ++depth;
  }
  return left;
}

}  // namespace constraint_sim
