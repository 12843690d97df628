#include "engine/scene/yaml_element.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"
#include "engine/support/words.h"

namespace constraint_sim::engine {
namespace {

using Kind = YamlNode::Kind;

std::string location(const std::string& source, int line) {
  return source + ":" + std::to_string(line) + ": ";
}

std::string described(const YamlNode& node) {
  switch (node.kind) {
    case Kind::kScalar:
      return in_quotes(node.scalar);
    case Kind::kList:
      return "a list of " + std::to_string(node.children.size());
    case Kind::kMap:
      return "a map";
    case Kind::kNothing:
      break;
  }
  return "nothing";
}

}  // namespace

YamlElement::YamlElement(const std::shared_ptr<const Document>& document, const YamlNode* node,
                         const std::string& path, int line)
    : document_(document), node_(node), path_(path), line_(line) {}

YamlElement YamlElement::parse(const std::string& text, const std::string& source) {
  if (text.size() > kMostSceneBytes)
    throw SceneError(source + ": must be at most " + std::to_string(kMostSceneBytes) +
                     " bytes, got " + std::to_string(text.size()));
  const std::size_t start = text.find_first_not_of(" \t\r\n");
  const bool is_xml = start != std::string::npos && text[start] == '<' &&
                      text.compare(start, 2, "<<") != 0;  // a merge key of YAML
  if (is_xml)
    throw SceneError(source +
                     ": expected YAML, got XML; the node's parameter robot, load_urdf and Python's "
                     "add_urdf load robots from URDFs");
  std::shared_ptr<const Document> document;
  try {
    document = std::make_shared<const Document>(Document{YamlTree(text), source});
  } catch (const YamlError& error) {
    throw SceneError(location(source, error.line) + error.what());
  }
  const YamlNode& root = document->tree.root();
  if (root.kind == Kind::kNothing)
    throw SceneError(location(source, 1) + "expected a scene, got nothing");
  return {document, &root, "", root.line};
}

YamlElement YamlElement::child(const YamlNode* node, const std::string& path,
                               int line_if_empty) const {
  return {document_, node, path, node->kind == Kind::kNothing ? line_if_empty : node->line};
}

void YamlElement::expect_keys(const Words& known) const {
  Words seen;
  expect_map();
  for (std::size_t i = 0; i < node_->children.size(); i += 2) {
    const YamlElement key = child(node_->children[i], path_, line_);
    const std::string word = key.word();
    if (std::find(known.begin(), known.end(), word) == known.end())
      key.fail("unknown key " + in_quotes(word));
    if (std::find(seen.begin(), seen.end(), word) != seen.end())
      key.fail("duplicate key " + in_quotes(word));
    seen.push_back(word);
  }
}

std::optional<YamlElement> YamlElement::find(const std::string& key) const {
  expect_map();
  for (std::size_t i = 0; i < node_->children.size(); i += 2) {
    const YamlNode& found = *node_->children[i];
    if (found.kind != Kind::kScalar || found.scalar != key) continue;
    return child(node_->children[i + 1], path_.empty() ? key : path_ + "." + key, found.line);
  }
  return std::nullopt;
}

YamlElement YamlElement::at(const std::string& key) const {
  const auto value = find(key);
  if (!value) fail("missing key '" + key + "'");
  return *value;
}

YamlElement::Words YamlElement::keys() const {
  Words words;
  expect_map();
  for (std::size_t i = 0; i < node_->children.size(); i += 2)
    words.push_back(child(node_->children[i], path_, line_).word());
  return words;
}

bool YamlElement::is_list() const { return node_->kind == Kind::kList; }

List<YamlElement> YamlElement::items() const {
  if (node_->kind != Kind::kList) fail_expecting("a list");
  List<YamlElement> elements;
  for (const YamlNode* const node : node_->children)
    elements.push_back(child(node, path_ + "[" + std::to_string(elements.size()) + "]", line_));
  return elements;
}

double YamlElement::number() const {
  if (!is_plain()) fail_expecting("a number");
  if (is_one_of(node_->scalar, {".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF", "-.inf", "-.Inf",
                                "-.INF", ".nan", ".NaN", ".NAN"}))
    fail_expecting("a finite number");
  const auto value = number_in<double>(node_->scalar);
  if (!value) fail_expecting("a number");
  return *value;
}

double YamlElement::number_or_infinity() const {
  return is_plain() && node_->scalar == ".inf" ? kInfinity : number();
}

int YamlElement::whole_number() const {
  const auto value = is_plain() ? number_in<int>(node_->scalar) : std::nullopt;
  if (!value) fail_expecting("a whole number");
  return *value;
}

std::uint64_t YamlElement::count() const {
  constexpr std::int64_t kMostExact = std::int64_t{1} << 53;
  const auto value = is_plain() ? number_in<std::int64_t>(node_->scalar) : std::nullopt;
  if (!value || *value < 0 || *value > kMostExact) fail_expecting("a whole number from 0 to 2^53");
  return static_cast<std::uint64_t>(*value);
}

std::uint32_t YamlElement::bits() const {
  constexpr std::int64_t kMostBits = std::numeric_limits<std::uint32_t>::max();
  const auto value = is_plain() ? number_in<std::int64_t>(node_->scalar) : std::nullopt;
  if (!value || *value < 0 || *value > kMostBits)
    fail_expecting("a whole number from 0 to " + std::to_string(kMostBits));
  return static_cast<std::uint32_t>(*value);
}

bool YamlElement::flag() const {
  const auto value = is_plain() ? flag_in(node_->scalar) : std::nullopt;
  if (!value) fail_expecting("true or false");
  return *value;
}

std::string YamlElement::word() const {
  if (node_->kind != Kind::kScalar) fail_expecting("a word");
  return node_->scalar;
}

Eigen::VectorXd YamlElement::numbers(Eigen::Index size) const {
  const std::string expected = "a list of " + std::to_string(size) + " numbers";
  const bool has_size =
      node_->kind == Kind::kList && node_->children.size() == static_cast<std::size_t>(size);
  if (!has_size) fail_expecting(expected);
  const List<YamlElement> elements = items();
  Eigen::VectorXd values(size);
  for (Eigen::Index i = 0; i < size; ++i)
    values[i] = elements[static_cast<std::size_t>(i)].number();
  return values;
}

void YamlElement::fail(const std::string& why) const {
  throw SceneError(location(document_->source, line_) + (path_.empty() ? "" : path_ + ": ") + why);
}

bool YamlElement::is_plain() const { return node_->kind == Kind::kScalar && !node_->is_quoted; }

void YamlElement::expect_map() const {
  if (node_->kind != Kind::kMap) fail_expecting("a map");
}

void YamlElement::fail_expecting(const std::string& kind) const {
  fail("expected " + kind + ", got " + described(*node_));
}

void YamlElement::fail_in_field(const std::string& field_and_why, const std::string& prefix) const {
  const bool has_prefix = field_and_why.compare(0, prefix.size(), prefix) == 0;
  const std::string what = has_prefix ? field_and_why.substr(prefix.size()) : field_and_why;
  const auto value = find(what.substr(0, what.find_first_of(".[:")));
  throw SceneError(location(document_->source, value ? value->line_ : line_) + path_ + "." + what);
}

}  // namespace constraint_sim::engine
