#include "engine/scene/yaml_tree.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <sstream>
#include <unordered_map>

#include "engine/math/list.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {

namespace {

/// Stands for a colon directly before `]` while yaml-cpp reads a text. YAML allows no such byte.
constexpr char kColon = '\x1f';

/// The text as yaml-cpp gets it. In a list in brackets, the scanner of yaml-cpp 0.6 makes empty
/// scalars without end out of a colon that stands directly before `]` or at the end of the text;
/// neither memory nor time is bounded there, since no event reaches the builder.
std::string scannable(std::string text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    // UTF-16 and UTF-32, which yaml-cpp reads as well, would hide a colon.
    if (text[i] == '\0' || text[i] == kColon) {
      const auto lines =
          std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(i), '\n');
      throw YamlError(static_cast<int>(lines) + 1, "not valid YAML: a control character in UTF-8");
    }
    if (text[i] == ']' && i > 0 && text[i - 1] == ':') text[i - 1] = kColon;
  }
  if (!text.empty() && text.back() == ':') text += '\n';
  return text;
}

}  // namespace

/// Builds the tree from the events of the parser, and stops the parser at the first limit.
class YamlTree::Builder : public YAML::EventHandler {
 public:
  explicit Builder(YamlTree* tree) : tree_(*tree) {}

  // The parser of yaml-cpp 0.7 finds an endless series of documents in some texts.
  void OnDocumentStart(const YAML::Mark& mark) override {
    if (++documents_ > 1) fail(mark, "expected one YAML document, got a second");
  }
  void OnDocumentEnd() override {}

  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { add(mark, anchor); }

  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto found = anchors_.find(anchor);
    if (found == anchors_.end()) fail(mark, "an alias without its anchor");
    const bool is_open = std::find(open_.begin(), open_.end(), found->second) != open_.end();
    if (is_open) fail(mark, "an alias within its own anchor");
    if (++aliases_ + tree_.nodes_.size() > kMostNodes) fail_at_most_nodes(mark);
    attach(found->second);
  }

  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string& value) override {
    YamlNode* const node = add(mark, anchor);
    node->scalar = value;
    node->is_quoted = tag == "!";
    const bool is_before_bracket = !value.empty() && value.back() == kColon;
    if (is_before_bracket && !node->is_quoted) fail(mark, "expected a space between ':' and ']'");
    for (std::size_t i = 0; i + 1 < value.size(); ++i)
      if (value[i] == kColon && value[i + 1] == ']') node->scalar[i] = ':';
    node->kind = YamlNode::Kind::kScalar;
  }

  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(mark, anchor, YamlNode::Kind::kList);
  }
  void OnSequenceEnd() override { open_.pop_back(); }

  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(mark, anchor, YamlNode::Kind::kMap);
  }
  void OnMapEnd() override { open_.pop_back(); }

 private:
  [[noreturn]] static void fail(const YAML::Mark& mark, const std::string& why) {
    throw YamlError(mark.line + 1, why);
  }
  [[noreturn]] static void fail_at_most_nodes(const YAML::Mark& mark) {
    fail(mark, "more than " + std::to_string(kMostNodes) + " values");
  }

  YamlNode* add(const YAML::Mark& mark, YAML::anchor_t anchor) {
    if (tree_.nodes_.size() + aliases_ >= kMostNodes) fail_at_most_nodes(mark);
    YamlNode* const node = &tree_.nodes_.emplace_back();
    node->line = mark.line + 1;
    if (anchor != 0) anchors_[anchor] = node;
    attach(node);
    return node;
  }

  void attach(const YamlNode* node) {
    if (open_.empty())
      tree_.root_ = node;
    else
      open_.back()->children.push_back(node);
  }

  void open(const YAML::Mark& mark, YAML::anchor_t anchor, YamlNode::Kind kind) {
    if (open_.size() >= kMostDepth)
      fail(mark, "lists and maps more than " + std::to_string(kMostDepth) + " deep");
    YamlNode* const node = add(mark, anchor);
    node->kind = kind;
    open_.push_back(node);
  }

  YamlTree& tree_;
  List<YamlNode*> open_;  // open lists and maps, from the root to the parser's position
  std::unordered_map<YAML::anchor_t, YamlNode*> anchors_;
  std::size_t aliases_ = 0;
  int documents_ = 0;
};

YamlTree::YamlTree(const std::string& text) {
  try {
    std::istringstream stream(scannable(text));
    YAML::Parser parser(stream);
    Builder builder(this);
    while (parser.HandleNextDocument(builder)) {
    }
  } catch (const YAML::Exception& error) {
    throw YamlError(std::max(0, error.mark.line) + 1, "not valid YAML: " + excerpt(error.msg));
  }
  if (root_ == nullptr) root_ = &nodes_.emplace_back();
}

}  // namespace constraint_sim::engine
