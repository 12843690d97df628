#include "urdf/xml_tags.h"

#include <algorithm>
#include <cctype>
#include <cstring>

namespace constraint_sim {
namespace {

bool is_xml_space(char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; }

bool starts_xml_name(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte >= 127 || std::isalpha(byte) != 0 || c == '_';
}

bool ends_xml_name(char c) { return is_xml_space(c) || std::strchr("/>=\"'", c) != nullptr; }

}  // namespace

bool XmlTags::is_at(std::size_t place, const char* word) const {
  return text_.compare(place, std::strlen(word), word) == 0;
}

void XmlTags::skip_past(const char* word) {
  const std::size_t found = text_.find(word, at_);
  at_ = found == std::string::npos ? text_.size() : found + std::strlen(word);
}

bool XmlTags::next() {
  for (;;) {
    at_ = text_.find('<', at_);
    if (at_ == std::string::npos || at_ + 1 >= text_.size()) break;
    if (is_at(at_, "<!--")) {
      at_ += 4;
      skip_past("-->");
    } else if (is_at(at_, "<![CDATA[")) {
      skip_past("]]>");
    } else if (text_[at_ + 1] == '/' || starts_xml_name(text_[at_ + 1])) {
      const bool is_end = text_[at_ + 1] == '/';
      name_start_ = at_ + (is_end ? 2 : 1);
      name_end_ = name_start_;
      while (name_end_ < text_.size() && !ends_xml_name(text_[name_end_])) ++name_end_;
      tag_end_ = name_end_;
      while (tag_end_ < text_.size() && text_[tag_end_] != '>') {
        const char c = text_[tag_end_];
        if (c == '"' || c == '\'') tag_end_ = std::min(text_.find(c, tag_end_ + 1), text_.size());
        if (tag_end_ < text_.size()) ++tag_end_;
      }
      if (tag_end_ >= text_.size()) break;
      at_ = tag_end_ + 1;
      kind_ = is_end ? Kind::kEnd : text_[tag_end_ - 1] == '/' ? Kind::kEmpty : Kind::kStart;
      return true;
    } else {
      const bool is_declaration = text_[at_ + 1] == '?';
      skip_past(">");
      if (!is_declaration) continue;
      kind_ = Kind::kDeclaration;
      name_start_ = name_end_ = tag_end_ = at_;
      return true;
    }
  }
  at_ = text_.size();
  return false;
}

std::string XmlTags::attribute(const std::string& wanted) const {
  const auto [place, length] = find(wanted);
  return place == std::string::npos ? "" : text_.substr(place, length);
}

std::pair<std::size_t, std::size_t> XmlTags::find(const std::string& wanted) const {
  constexpr std::pair<std::size_t, std::size_t> kMissing{std::string::npos, 0};
  const auto skip_spaces = [this](std::size_t at) {
    while (at < tag_end_ && is_xml_space(text_[at])) ++at;
    return at;
  };
  for (std::size_t at = skip_spaces(name_end_); at < tag_end_; at = skip_spaces(at)) {
    const std::size_t start = at;
    while (at < tag_end_ && !ends_xml_name(text_[at])) ++at;
    const std::string name = text_.substr(start, at - start);
    at = skip_spaces(at);
    if (at >= tag_end_ || text_[at] != '=') return kMissing;
    at = skip_spaces(at + 1);
    const bool is_quoted = at < tag_end_ && (text_[at] == '"' || text_[at] == '\'');
    std::size_t end = at;
    if (is_quoted)
      end = std::min(text_.find(text_[at], at + 1), tag_end_);
    else
      while (end < tag_end_ && !is_xml_space(text_[end])) ++end;
    const std::size_t first = is_quoted ? at + 1 : at;
    if (name == wanted) return {first, end - first};
    at = end + (is_quoted ? 1 : 0);
  }
  return kMissing;
}

}  // namespace constraint_sim
