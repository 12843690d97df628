#include "urdf/sdf_text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <sstream>

#include "sim/words.h"
#include "urdf/parse.h"
#include "urdf/xml_tags.h"

namespace constraint_sim {
namespace {

// libsdformat parses nested elements recursively. It copies the description of each element, which
// takes milliseconds for elements with names, such as links and joints.
constexpr int kMostSdfDepth = 64;
constexpr std::size_t kMostSdfElements = 20000, kMostNamedElements = 2000;

/// Rejects markup that XmlTags skips and TinyXML reads, or the other way round.
void check_markup(const std::string& text) {
  for (std::size_t at = text.find("<!"); at != std::string::npos; at = text.find("<!", at + 2))
    if (text.compare(at, 4, "<!--") != 0 && text.compare(at, 9, "<![CDATA[") != 0)
      refuse("the SDF has a declaration '" + shortened(text.substr(at, 40), 20) + "'");
  if (text.find("<:") != std::string::npos)
    refuse("the SDF has an element whose name begins with a colon");
  if (text.find('\0') != std::string::npos) refuse("the SDF has a character of value 0");
}

std::string line_of(const std::string& text, std::size_t place) {
  const auto end = text.begin() + static_cast<std::ptrdiff_t>(place);
  return "line " + std::to_string(1 + std::count(text.begin(), end, '\n'));
}

void check_version(const std::string& version) {
  const bool is_number =
      version.find_first_not_of("0123456789.") == std::string::npos && version.size() < 10;
  if (version.empty() || !is_number || version.front() == '.' || version.back() == '.')
    refuse("<sdf> needs the attribute version, such as '1.7', got '" + shortened(version) + "'");
}

/// Elements that hold vectors, and the numbers of components that they may have. libsdformat 9
/// leaves components that do not parse without a value.
struct VectorElement {
  const char* name;
  std::size_t least, most;
};
constexpr std::array<VectorElement, 5> kVectorElements{
    {{"pose", 6, 7}, {"xyz", 3, 3}, {"normal", 3, 3}, {"scale", 3, 3}, {"size", 2, 3}}};

/// Throws where the tag opens an element of a vector that is not empty, and its content has another
/// number of components or one that is not a finite number.
void check_vector(const std::string& text, const XmlTags& tag) {
  const std::string name = tag.name();
  const auto element =
      std::find_if(kVectorElements.begin(), kVectorElements.end(),
                   [&](const VectorElement& candidate) { return name == candidate.name; });
  if (element == kVectorElements.end()) return;
  const std::size_t begin = tag.place() + tag.text().size() + 1;
  const std::string content = text.substr(begin, text.find('<', begin) - begin);
  std::istringstream words(content);
  std::size_t count = 0;
  bool are_numbers = true;
  for (std::string word; words >> word; ++count) {
    char* end = nullptr;
    const double number = std::strtod(word.c_str(), &end);
    are_numbers = are_numbers && *end == '\0' && std::isfinite(number);
  }
  if (are_numbers && (count == 0 || (count >= element->least && count <= element->most))) return;
  refuse("<" + name + "> (" + line_of(text, tag.place()) + ") must have " +
         std::to_string(element->least) + " finite numbers, got '" + shortened(content) + "'");
}

}  // namespace

bool is_sdf(const std::string& text) {
  XmlTags tags(text);
  while (tags.next())
    if (tags.kind() != XmlTags::Kind::kDeclaration) return tags.name() == "sdf";
  return false;
}

void check_sdf_text(const std::string& text) {
  check_markup(text);
  int depth = 0;
  int plugin_depth = 0;  // depth of the plugin around the element; 0: none
  std::size_t elements = 0, named = 0;
  XmlTags tags(text);
  while (tags.next()) {
    if (tags.kind() == XmlTags::Kind::kDeclaration) {
      // TinyXML ends a declaration at `?>`, and XmlTags at the first `>`.
      if (depth > 0 || text.compare(tags.place() - 2, 2, "?>") != 0)
        refuse("the SDF has a declaration `<?` within an element, or with a `>` in it");
      continue;
    }
    if (tags.kind() == XmlTags::Kind::kEnd) {
      depth = std::max(depth - 1, 0);
      if (depth < plugin_depth) plugin_depth = 0;
      continue;
    }
    if (elements == 0) check_version(tags.attribute("version"));
    if (tags.name() == "include")
      refuse("the SDF has <include> (" + line_of(text, tags.place()) +
             "), which is not read: include the model in the text, as `gz sdf -p FILE` and `ign "
             "sdf -p FILE` print it");
    if (++elements > kMostSdfElements)
      refuse("the SDF has more than " + std::to_string(kMostSdfElements) + " elements");
    if (!tags.attribute("name").empty() && ++named > kMostNamedElements)
      refuse("the SDF has more than " + std::to_string(kMostNamedElements) +
             " elements with names, such as links and joints");
    if (tags.kind() != XmlTags::Kind::kStart) continue;
    if (++depth > kMostSdfDepth)
      refuse("elements are nested more than " + std::to_string(kMostSdfDepth) + " deep");
    if (plugin_depth == 0 && tags.name() == "plugin") plugin_depth = depth;
    if (plugin_depth == 0) check_vector(text, tags);
  }
}

}  // namespace constraint_sim
