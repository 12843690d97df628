#pragma once

#include <cstddef>
#include <string>
#include <utility>

namespace constraint_sim {

/// Reads the tags of an XML text one by one, without recursion and without a copy of the text.
/// Comments, CDATA and text between tags are skipped, as in TinyXML. Malformed XML ends the reading
/// early, or gives tags that a parser rejects.
class XmlTags {
 public:
  explicit XmlTags(const std::string& text) : text_(text) {}

  /// kDeclaration: begins with `<?`, has no name, and ends here at the first `>`.
  enum class Kind { kStart, kEnd, kEmpty, kDeclaration };
  /// Advances to the next tag; returns false at the end.
  bool next();

  Kind kind() const { return kind_; }
  /// Position of the tag's name in the text.
  std::size_t place() const { return name_start_; }
  /// Text of the tag without its angle brackets.
  std::string text() const { return text_.substr(name_start_, tag_end_ - name_start_); }
  std::string name() const { return text_.substr(name_start_, name_end_ - name_start_); }
  /// Returns the value of an attribute, with entities not decoded; empty where it is missing.
  std::string attribute(const std::string& wanted) const;
  /// Returns the position in the text of the value of an attribute; npos where it is missing.
  std::size_t place_of(const std::string& wanted) const { return find(wanted).first; }

 private:
  bool is_at(std::size_t place, const char* word) const;
  void skip_past(const char* word);
  /// Returns position and length of the value of an attribute; npos and 0 where it is missing.
  std::pair<std::size_t, std::size_t> find(const std::string& wanted) const;

  const std::string& text_;
  std::size_t at_ = 0;
  Kind kind_ = Kind::kStart;
  std::size_t name_start_ = 0, name_end_ = 0, tag_end_ = 0;
};

}  // namespace constraint_sim
