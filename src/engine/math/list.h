#pragma once

#include <cassert>
#include <cstddef>
#include <utility>
#include <vector>

namespace constraint_sim::engine {

/// Converts a signed index or count ≥ 0 to the standard library's type.
template <class Integer>
constexpr std::size_t to_index(Integer i) {
  assert(i >= 0);
  return static_cast<std::size_t>(i);
}

/// A std::vector with signed and unsigned indices, since bodies, joints and rows are numbered by
/// int with -1 for "none". Builds with asserts check every index.
template <class T>
class List : public std::vector<T> {
 public:
  using Base = std::vector<T>;
  using Base::Base;
  List() = default;
  explicit List(Base elements) : Base(std::move(elements)) {}

  template <class Integer>
  typename Base::reference operator[](Integer i) {
    const auto place = static_cast<std::size_t>(i);  // a negative index exceeds every size
    assert(place < Base::size());
    return Base::operator[](place);
  }
  template <class Integer>
  typename Base::const_reference operator[](Integer i) const {
    const auto place = static_cast<std::size_t>(i);
    assert(place < Base::size());
    return Base::operator[](place);
  }
};

}  // namespace constraint_sim::engine
