#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/math/list.h"
#include "engine/scene/yaml_tree.h"

namespace constraint_sim::engine {

/// One value of a YAML document that knows where it stands: its path of keys and its line. Every
/// function throws SceneError("SOURCE:LINE: PATH: what is wrong, with the value") when the value is
/// not what is asked for.
class YamlElement {
 public:
  using Words = std::vector<std::string>;

  /// The single document in `text`; `source` names it in errors.
  static YamlElement parse(const std::string& text, const std::string& source);

  /// Requires a map with none but these keys, each at most once.
  void expect_keys(const Words& known) const;
  /// The value of a key of this map, if the key is there.
  std::optional<YamlElement> find(const std::string& key) const;
  /// The value of a key that must be there.
  YamlElement at(const std::string& key) const;
  /// The keys of this map, in their order.
  Words keys() const;
  bool is_list() const;
  /// The elements of this list.
  List<YamlElement> items() const;

  double number() const;              ///< finite
  double number_or_infinity() const;  ///< `.inf` as well
  int whole_number() const;
  std::uint64_t count() const;  ///< whole, from 0 to 2^53
  bool flag() const;
  std::string word() const;
  /// Exactly `size` finite numbers.
  Eigen::VectorXd numbers(Eigen::Index size) const;

  // The value of a key of this map into `target`, which stays as it is when the key is not there.
  void read(const std::string& key, double* target) const;
  void read(const std::string& key, int* target) const;
  void read(const std::string& key, bool* target) const;
  void read(const std::string& key, Eigen::Vector3d* target) const;

  /// Throws the SceneError that says what is wrong with this value.
  [[noreturn]] void fail(const std::string& why) const;

  /// Does `action`; its std::invalid_argument("FIELD: why") becomes a SceneError about that field
  /// of this map. `prefix` is what FIELD has before the key.
  template <class Action>
  auto attempt(Action action, const std::string& prefix = "") const {
    try {
      return action();
    } catch (const std::invalid_argument& error) {
      fail_in_field(error.what(), prefix);
    }
  }

 private:
  /// What all elements of a text share.
  struct Document {
    YamlTree tree;
    std::string source;
  };

  YamlElement(const std::shared_ptr<const Document>& document, const YamlNode* node,
              const std::string& path, int line);

  YamlElement child(const YamlNode* node, const std::string& path, int line_if_empty) const;
  /// Whether this is a scalar without quotes that the functions for numbers and flags may read.
  bool is_plain() const;
  /// Throws unless this is a map.
  void expect_map() const;
  [[noreturn]] void fail_expecting(const std::string& kind) const;
  [[noreturn]] void fail_in_field(const std::string& field_and_why,
                                  const std::string& prefix) const;

  std::shared_ptr<const Document> document_;
  const YamlNode* node_;
  std::string path_;  ///< as in "bodies[2].mass"; empty for the document
  int line_;          ///< from 1
};

}  // namespace constraint_sim::engine
