#pragma once

#include <array>
#include <cstdint>

#include "constraint_sim/engine/world.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Which method advances which islands in a step. Awake islands alone, by index.
struct MethodPartition {
  std::array<std::uint32_t, kMethodCount> islands{};  ///< how many islands each method advances
  List<int> integrated;      ///< islands that other methods than impulses advance
  List<int> impulse_bodies;  ///< dynamic bodies of all other islands
  List<int> impulse_joints;  ///< acting joints of all other islands
  List<int> ended;           ///< islands whose step events began and impulses end
};

}  // namespace constraint_sim::engine
