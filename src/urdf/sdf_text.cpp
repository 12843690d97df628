#include "urdf/sdf_text.h"

#include <algorithm>
#include <cstddef>

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
  bool has_version = false;
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
      continue;
    }
    if (elements == 0) has_version = !tags.attribute("version").empty();
    if (tags.name() == "include")
      refuse("the SDF has <include> (" + line_of(text, tags.place()) +
             "), which is not read: include the model in the text, as `gz sdf -p FILE` and `ign "
             "sdf -p FILE` print it");
    if (++elements > kMostSdfElements)
      refuse("the SDF has more than " + std::to_string(kMostSdfElements) + " elements");
    if (!tags.attribute("name").empty() && ++named > kMostNamedElements)
      refuse("the SDF has more than " + std::to_string(kMostNamedElements) +
             " elements with names, such as links and joints");
    if (tags.kind() == XmlTags::Kind::kStart && ++depth > kMostSdfDepth)
      refuse("elements are nested more than " + std::to_string(kMostSdfDepth) + " deep");
  }
  if (!has_version) refuse("<sdf> needs the attribute version");
}

}  // namespace constraint_sim
