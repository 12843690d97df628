#pragma once

#include <ros/names.h>

#include <string>

namespace constraint_sim {

/// Returns `kind/name`, with underscores for characters not allowed in topic names. Several names
/// may give one topic, as `wrist-1` and `wrist_1`; the caller has to reject the second.
inline std::string topic_of(const std::string& kind, std::string name) {
  for (char& c : name)
    if (c == '.' || c == '-') c = '_';
  return ros::names::clean(kind + "/" + name);
}

}  // namespace constraint_sim
