#pragma once

#include <ros/names.h>

#include <string>

namespace constraint_sim {

/// `kind/name`, with underscores for what names of topics cannot have. Several names may have the
/// same topic, as `wrist-1` and `wrist_1`: whoever makes topics keeps the second one from it.
inline std::string topic_of(const std::string& kind, std::string name) {
  for (char& c : name)
    if (c == '.' || c == '-') c = '_';
  return ros::names::clean(kind + "/" + name);
}

}  // namespace constraint_sim
