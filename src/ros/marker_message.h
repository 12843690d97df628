#pragma once

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace constraint_sim {

/// A visualization_msgs/MarkerArray on the wire, made of markers owned elsewhere.
struct MarkerMessage {
  std::vector<const visualization_msgs::Marker*> markers;
};

/// Serializes a Marker, copying whole blocks where memory layout equals wire layout. The serializer
/// of roscpp checks the end of the buffer for each number, which takes longer than making the
/// markers.
class MarkerWriter {
 public:
  static std::uint32_t length(const visualization_msgs::Marker& marker) {
    return kFixedLength +
           static_cast<std::uint32_t>(marker.header.frame_id.size() + marker.ns.size() +
                                      marker.points.size() * sizeof(geometry_msgs::Point) +
                                      marker.colors.size() * sizeof(std_msgs::ColorRGBA) +
                                      marker.text.size() + marker.mesh_resource.size());
  }

  /// `to`: room for the length() of all markers to be written.
  explicit MarkerWriter(std::uint8_t* to) : to_(to) {}

  void write(const visualization_msgs::Marker& marker) {
    put(marker.header.seq);
    put(marker.header.stamp.sec);
    put(marker.header.stamp.nsec);
    put_all(marker.header.frame_id);
    put_all(marker.ns);
    put(marker.id);
    put(marker.type);
    put(marker.action);
    put(marker.pose);
    put(marker.scale);
    put(marker.color);
    put(marker.lifetime.sec);
    put(marker.lifetime.nsec);
    put(marker.frame_locked);
    put_all(marker.points);
    put_all(marker.colors);
    put_all(marker.text);
    put_all(marker.mesh_resource);
    put(marker.mesh_use_embedded_materials);
  }

 private:
  static_assert(sizeof(geometry_msgs::Pose) == 7 * sizeof(double), "without padding");
  static_assert(sizeof(geometry_msgs::Vector3) == 3 * sizeof(double), "without padding");
  static_assert(sizeof(geometry_msgs::Point) == 3 * sizeof(double), "without padding");
  static_assert(sizeof(std_msgs::ColorRGBA) == 4 * sizeof(float), "without padding");
  /// Bytes of all numbers, and of the length prefixes of strings and arrays.
  static constexpr std::uint32_t kFixedLength = 12 + 12 + 80 + 16 + 8 + 2 + 6 * 4;

  template <class T>
  void put(const T& value) {
    std::memcpy(to_, &value, sizeof value);
    to_ += sizeof value;
  }

  template <class Container>
  void put_all(const Container& values) {
    put(static_cast<std::uint32_t>(values.size()));
    if (values.empty()) return;
    const std::size_t bytes = values.size() * sizeof values[0];
    std::memcpy(to_, values.data(), bytes);
    to_ += bytes;
  }

  std::uint8_t* to_;
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
    // the rest of the buffer, sized by serializedLength()
    constraint_sim::MarkerWriter writer(stream.advance(stream.getLength()));
    for (const visualization_msgs::Marker* marker : message.markers) writer.write(*marker);
  }
  static std::uint32_t serializedLength(const constraint_sim::MarkerMessage& message) {
    std::uint32_t length = 4;
    for (const visualization_msgs::Marker* marker : message.markers)
      length += constraint_sim::MarkerWriter::length(*marker);
    return length;
  }
};

}  // namespace serialization
}  // namespace ros
