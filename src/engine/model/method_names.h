#pragma once

#include <string>

#include "constraint_sim/engine/report.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {

/// Returns the method with this name(). Throws std::invalid_argument for a name that does not
/// exist.
inline Method method_named(const std::string& text) {
  std::string existing;
  for (std::size_t i = 0; i < kMethodCount; ++i) {
    const auto method = static_cast<Method>(i);
    if (text == name(method)) return method;
    existing += (existing.empty() ? "" : ", ") + std::string(name(method));
  }
  refuse("method", "there is no " + in_quotes(text) + "; there are " + existing);
}

}  // namespace constraint_sim::engine
