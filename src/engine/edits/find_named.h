#pragma once

#include <string>
#include <string_view>

#include "engine/model/validate.h"

namespace constraint_sim::engine {

/// Returns the value of `name` in a map; throws std::invalid_argument about `field` without such.
template <class Map>
auto find_named(const Map& map, std::string_view name, const char* field) {
  const auto found = map.find(std::string(name));
  if (found == map.end()) refuse(field, "there is none named " + in_quotes(std::string(name)));
  return found->second;
}

}  // namespace constraint_sim::engine
