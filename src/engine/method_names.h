#pragma once

#include <string>

#include "constraint_sim/report.h"
#include "engine/validate.h"

namespace constraint_sim::engine {

/// The method with this name(). Throws std::invalid_argument for one that does not exist (yet).
inline Method method_named(const std::string& text) {
  for (const Method method : {Method::kAuto, Method::kSequentialImpulses}) {
    if (text == name(method)) return method;
  }
  refuse("method", "there is no '" + text + "' (yet); there are " + name(Method::kAuto) + ", " +
                       name(Method::kSequentialImpulses));
}

}  // namespace constraint_sim::engine
