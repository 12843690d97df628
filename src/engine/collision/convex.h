#pragma once

#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>

#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

template <class Kind>
inline constexpr bool kIsCompound = std::is_same_v<Kind, Compound>;

/// Throws std::logic_error: functions of convex shapes take the parts of a compound one by one.
[[noreturn]] inline void fail_compound() {
  throw std::logic_error("a compound is no convex shape");
}

/// Calls a function object with the alternative of a convex shape.
template <class Visitor>
auto visit_convex(const Visitor& visitor, const Shape& shape) {
  using Result = decltype(visitor(std::declval<const Sphere&>()));
  return std::visit(
      [&](const auto& of_kind) -> Result {
        if constexpr (kIsCompound<std::decay_t<decltype(of_kind)>>)
          fail_compound();
        else
          return visitor(of_kind);
      },
      shape);
}

}  // namespace constraint_sim::engine
