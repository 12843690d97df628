#pragma once

#include <array>
#include <string>
#include <variant>

#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

/// Names of shapes in scene files, in the order of Shape.
inline constexpr std::array<const char*, std::variant_size_v<Shape>> kShapeNames{
    "point", "sphere", "box", "plane", "cylinder"};
static_assert(kShapeNames.back() != nullptr, "a name for each shape");

/// All names of shapes, with commas between them.
inline std::string names_of_shapes() {
  std::string names;
  for (const char* name : kShapeNames) names += (names.empty() ? "" : ", ") + std::string(name);
  return names;
}

}  // namespace constraint_sim::engine
