#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/math/list.h"
#include "engine/scene/yaml_tree.h"

namespace constraint_sim::engine {

/// A value of a YAML document with its path of keys and its line. Every function throws
/// SceneError("SOURCE:LINE: PATH: what is wrong, with the value") for a value of another type or
/// range.
class YamlElement {
 public:
  using Words = std::vector<std::string>;

  /// Parses the single document in `text`; `source` names it in errors.
  static YamlElement parse(const std::string& text, const std::string& source);

  /// Requires a map with none but these keys, each at most once.
  void expect_keys(const Words& known) const;
  /// Returns the value of a key of this map, if the key exists.
  std::optional<YamlElement> find(const std::string& key) const;
  /// Returns the value of a key, which must exist.
  YamlElement at(const std::string& key) const;
  /// Returns the keys of this map, in their order.
  Words keys() const;
  bool is_list() const;
  /// Returns the elements of this list.
  List<YamlElement> items() const;

  double number() const;              ///< a finite number
  double number_or_infinity() const;  ///< a finite number or `.inf`
  int whole_number() const;
  std::uint64_t count() const;  ///< a whole number from 0 to 2^53
  std::uint32_t bits() const;   ///< a whole number below 2^32
  bool flag() const;
  std::string word() const;
  /// Returns exactly `size` finite numbers.
  Eigen::VectorXd numbers(Eigen::Index size) const;

  // Read this value; quaternions are x, y, z, w.
  void read(double* target) const { *target = number(); }
  void read(std::optional<double>* target) const { *target = number(); }
  void read(int* target) const { *target = whole_number(); }
  void read(std::uint32_t* target) const { *target = bits(); }
  void read(bool* target) const { *target = flag(); }
  void read(Eigen::Vector3d* target) const { *target = numbers(3); }
  void read(Eigen::Quaterniond* target) const { target->coeffs() = Eigen::Vector4d(numbers(4)); }
  /// Reads the value of a key of this map into `target`, which stays unchanged without the key.
  template <class Value>
  void read(const std::string& key, Value* target) const {
    if (const auto value = find(key)) value->read(target);
  }

  /// Throws a SceneError about this value.
  [[noreturn]] void fail(const std::string& why) const;

  /// Calls `action` and converts its std::invalid_argument("FIELD: why") to a SceneError about that
  /// field of this map. `prefix` is the part of FIELD before the key.
  template <class Action>
  auto attempt(Action action, const std::string& prefix = "") const {
    try {
      return action();
    } catch (const std::invalid_argument& error) {
      fail_in_field(error.what(), prefix);
    }
  }

 private:
  /// Document shared by all elements of a text.
  struct Document {
    YamlTree tree;
    std::string source;
  };

  YamlElement(const std::shared_ptr<const Document>& document, const YamlNode* node,
              const std::string& path, int line);

  YamlElement child(const YamlNode* node, const std::string& path, int line_if_empty) const;
  /// Whether this is a scalar without quotes, which may be a number or a flag.
  bool is_plain() const;
  /// Throws SceneError unless this is a map.
  void expect_map() const;
  [[noreturn]] void fail_expecting(const std::string& kind) const;
  [[noreturn]] void fail_in_field(const std::string& field_and_why,
                                  const std::string& prefix) const;

  std::shared_ptr<const Document> document_;
  const YamlNode* node_;
  std::string path_;  ///< path such as "bodies[2].mass"; empty for the document
  int line_;          ///< line, from 1
};

}  // namespace constraint_sim::engine
