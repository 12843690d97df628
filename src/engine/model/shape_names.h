#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <variant>

#include "constraint_sim/engine/body.h"

namespace constraint_sim::engine {

/// Names of types of bodies in scene files, in the order of BodyType.
inline constexpr std::array kBodyTypeNames{"dynamic", "static", "kinematic"};

/// Names of shapes in scene files, in the order of Shape.
inline constexpr std::array<const char*, std::variant_size_v<Shape>> kShapeNames{
    "point", "sphere", "box", "plane", "cylinder", "hull", "capsule", "compound"};
static_assert(kShapeNames.back() != nullptr, "a name for each shape");

/// Returns the shape with an index in the variant Shape, with dimensions 0.
template <std::size_t kIndex = 0>
Shape shape_of_kind(std::size_t index) {
  if constexpr (kIndex + 1 < std::variant_size_v<Shape>)
    if (index != kIndex) return shape_of_kind<kIndex + 1>(index);
  return Shape(std::in_place_index<kIndex>);
}

/// All names of convex shapes, with commas between them.
inline std::string names_of_shapes() {
  std::string names;
  for (std::size_t i = 0; i < kShapeNames.size(); ++i)
    if (!std::holds_alternative<Compound>(shape_of_kind(i)))
      names += (names.empty() ? "" : ", ") + std::string(kShapeNames[i]);
  return names;
}

}  // namespace constraint_sim::engine
