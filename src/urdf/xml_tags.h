#pragma once

#include <cstddef>
#include <string>

namespace constraint_sim {

/// Reads the tags of an XML text one after the other, without recursion and without a copy of the
/// text. Comments, CDATA and text between tags are left out, as TinyXML does it. A text that is no
/// XML ends the reading early, or gives tags that a parser rejects.
class XmlTags {
 public:
  explicit XmlTags(const std::string& text) : text_(text) {}

  /// kDeclaration: begins with `<?`, and ends here at the first `>`; has no name.
  enum class Kind { kStart, kEnd, kEmpty, kDeclaration };
  /// Goes to the next tag; false where there is none.
  bool next();

  Kind kind() const { return kind_; }
  /// Where the name of this tag begins in the text.
  std::size_t place() const { return name_start_; }
  /// This tag without its angle brackets.
  std::string text() const { return text_.substr(name_start_, tag_end_ - name_start_); }
  std::string name() const { return text_.substr(name_start_, name_end_ - name_start_); }
  /// The value of an attribute of this tag, entities as they are written; empty where it has none.
  std::string attribute(const std::string& wanted) const;

 private:
  bool is_at(std::size_t place, const char* word) const;
  void skip_past(const char* word);

  const std::string& text_;
  std::size_t at_ = 0;
  Kind kind_ = Kind::kStart;
  std::size_t name_start_ = 0, name_end_ = 0, tag_end_ = 0;
};

}  // namespace constraint_sim
