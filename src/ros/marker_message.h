#pragma once

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdint>
#include <vector>

namespace constraint_sim {

/// A visualization_msgs/MarkerArray of markers that somebody else owns: on the wire the same.
struct MarkerMessage {
  std::vector<const visualization_msgs::Marker*> markers;
};

}  // namespace constraint_sim

namespace ros {
namespace message_traits {

template <>
struct MD5Sum<constraint_sim::MarkerMessage> : MD5Sum<visualization_msgs::MarkerArray> {
  static const char* value(const constraint_sim::MarkerMessage&) {
    return MD5Sum<visualization_msgs::MarkerArray>::value();
  }
  using MD5Sum<visualization_msgs::MarkerArray>::value;
};
template <>
struct DataType<constraint_sim::MarkerMessage> : DataType<visualization_msgs::MarkerArray> {
  static const char* value(const constraint_sim::MarkerMessage&) {
    return DataType<visualization_msgs::MarkerArray>::value();
  }
  using DataType<visualization_msgs::MarkerArray>::value;
};
template <>
struct Definition<constraint_sim::MarkerMessage> : Definition<visualization_msgs::MarkerArray> {
  static const char* value(const constraint_sim::MarkerMessage&) {
    return Definition<visualization_msgs::MarkerArray>::value();
  }
  using Definition<visualization_msgs::MarkerArray>::value;
};

}  // namespace message_traits

namespace serialization {

template <>
struct Serializer<constraint_sim::MarkerMessage> {
  template <typename Stream>
  static void write(Stream& stream, const constraint_sim::MarkerMessage& message) {
    stream.next(static_cast<std::uint32_t>(message.markers.size()));
    for (const visualization_msgs::Marker* marker : message.markers) stream.next(*marker);
  }
  static std::uint32_t serializedLength(const constraint_sim::MarkerMessage& message) {
    std::uint32_t length = 4;
    for (const visualization_msgs::Marker* marker : message.markers)
      length += serializationLength(*marker);
    return length;
  }
};

}  // namespace serialization
}  // namespace ros
