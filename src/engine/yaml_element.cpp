#include "engine/yaml_element.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "constraint_sim/scene.h"

namespace constraint_sim::engine {
namespace {

int line_of(const YAML::Mark& mark) { return mark.line + 1; }

std::string location(const std::string& source, int line) {
  return source + ":" + std::to_string(line) + ": ";
}

std::string described(const YAML::Node& node) {
  if (node.IsScalar()) return "'" + node.Scalar() + "'";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  if (node.IsMap()) return "a map";
  return "nothing";
}

/// In quotes a number or flag is text.
bool is_quoted(const YAML::Node& node) { return node.Tag() == "!"; }

}  // namespace

YamlElement::YamlElement(const YAML::Node& node, const std::string& source, const std::string& path,
                         int line)
    : node_(node), source_(source), path_(path), line_(line) {}

YamlElement YamlElement::parse(const std::string& text, const std::string& source) {
  std::vector<YAML::Node> documents;
  try {
    documents = YAML::LoadAll(text);
  } catch (const YAML::Exception& error) {
    throw SceneError(location(source, line_of(error.mark)) + "not valid YAML: " + error.msg);
  }
  if (documents.empty() || documents.front().IsNull())
    throw SceneError(location(source, 1) + "expected a scene, got nothing");
  if (documents.size() > 1)
    throw SceneError(location(source, line_of(documents[1].Mark())) +
                     "expected one YAML document, got " + std::to_string(documents.size()));
  const YAML::Node& root = documents.front();
  return {root, source, "", line_of(root.Mark())};
}

YamlElement YamlElement::child(const YAML::Node& node, const std::string& path,
                               int line_if_empty) const {
  return {node, source_, path, node.IsNull() ? line_if_empty : line_of(node.Mark())};
}

void YamlElement::expect_keys(const Words& known) const {
  Words seen;
  expect_map();
  for (const auto& entry : node_) {
    const YamlElement key = child(entry.first, path_, line_);
    const std::string word = key.word();
    if (std::find(known.begin(), known.end(), word) == known.end())
      key.fail("unknown key '" + word + "'");
    if (std::find(seen.begin(), seen.end(), word) != seen.end())
      key.fail("duplicate key '" + word + "'");
    seen.push_back(word);
  }
}

std::optional<YamlElement> YamlElement::find(const std::string& key) const {
  expect_map();
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar() || entry.first.Scalar() != key) continue;
    return child(entry.second, path_.empty() ? key : path_ + "." + key,
                 line_of(entry.first.Mark()));
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
  for (const auto& entry : node_) words.push_back(child(entry.first, path_, line_).word());
  return words;
}

std::vector<YamlElement> YamlElement::items() const {
  if (!node_.IsSequence()) fail_expecting("a list");
  std::vector<YamlElement> elements;
  for (const auto& node : node_)
    elements.push_back(child(node, path_ + "[" + std::to_string(elements.size()) + "]", line_));
  return elements;
}

double YamlElement::number() const {
  double value = 0.0;
  if (!node_.IsScalar() || is_quoted(node_) || !YAML::convert<double>::decode(node_, value))
    fail_expecting("a number");
  if (!std::isfinite(value)) fail_expecting("a finite number");
  return value;
}

double YamlElement::number_or_infinity() const {
  return node_.IsScalar() && !is_quoted(node_) && node_.Scalar() == ".inf"
             ? std::numeric_limits<double>::infinity()
             : number();
}

int YamlElement::whole_number() const {
  int value = 0;
  if (!node_.IsScalar() || is_quoted(node_) || !YAML::convert<int>::decode(node_, value))
    fail_expecting("a whole number");
  return value;
}

bool YamlElement::flag() const {
  bool value = false;
  if (!node_.IsScalar() || is_quoted(node_) || !YAML::convert<bool>::decode(node_, value))
    fail_expecting("true or false");
  return value;
}

std::string YamlElement::word() const {
  if (!node_.IsScalar()) fail_expecting("a word");
  return node_.Scalar();
}

Eigen::VectorXd YamlElement::numbers(Eigen::Index size) const {
  const std::string expected = "a list of " + std::to_string(size) + " numbers";
  if (!node_.IsSequence()) fail_expecting(expected);
  const std::vector<YamlElement> elements = items();
  if (static_cast<Eigen::Index>(elements.size()) != size) fail_expecting(expected);
  Eigen::VectorXd values(size);
  for (Eigen::Index i = 0; i < size; ++i)
    values[i] = elements[static_cast<std::size_t>(i)].number();
  return values;
}

void YamlElement::read(const std::string& key, double* target) const {
  if (const auto value = find(key)) *target = value->number();
}

void YamlElement::read(const std::string& key, int* target) const {
  if (const auto value = find(key)) *target = value->whole_number();
}

void YamlElement::read(const std::string& key, bool* target) const {
  if (const auto value = find(key)) *target = value->flag();
}

void YamlElement::read(const std::string& key, Eigen::Vector3d* target) const {
  if (const auto value = find(key)) *target = value->numbers(3);
}

void YamlElement::fail(const std::string& why) const {
  throw SceneError(location(source_, line_) + (path_.empty() ? "" : path_ + ": ") + why);
}

void YamlElement::expect_map() const {
  if (!node_.IsMap()) fail_expecting("a map");
}

void YamlElement::fail_expecting(const std::string& kind) const {
  fail("expected " + kind + ", got " + described(node_));
}

void YamlElement::fail_in_field(const std::string& field_and_why, const std::string& prefix) const {
  const bool has_prefix = field_and_why.compare(0, prefix.size(), prefix) == 0;
  const std::string what = has_prefix ? field_and_why.substr(prefix.size()) : field_and_why;
  const auto value = find(what.substr(0, what.find_first_of(".[:")));
  throw SceneError(location(source_, value ? value->line_ : line_) + path_ + "." + what);
}

}  // namespace constraint_sim::engine
