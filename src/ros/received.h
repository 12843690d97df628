#pragma once

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <ros/service_traits.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace constraint_sim {

/// Reads messages from untrusted bytes. roscpp allocates a list by its announced length, up to 2^32
/// elements, before reading elements. Here a list grows with the bytes present, so the size of the
/// message bounds the memory. Throws ros::serialization::StreamOverrunException where bytes are
/// missing.
class BoundedStream : public ros::serialization::Stream {
 public:
  static constexpr ros::serialization::StreamType stream_type =
      ros::serialization::stream_types::Input;

  /// `bytes` may be null where there are none, as of an empty vector: Stream adds to its address.
  BoundedStream(std::uint8_t* bytes, std::uint32_t count)
      : Stream(bytes == nullptr ? &nothing_ : bytes, count) {}

  template <class Value>
  void next(Value& value) {
    ros::serialization::deserialize(*this, value);
  }
  template <class Element, class Allocator>
  void next(std::vector<Element, Allocator>& list) {
    std::uint32_t count = 0;
    next(count);
    list.clear();
    if constexpr (ros::message_traits::IsSimple<Element>::value) {
      const std::size_t bytes = std::size_t{count} * sizeof(Element);
      if (bytes > getLength()) ros::serialization::throwStreamOverrun();
      list.resize(count);
      const std::uint8_t* from = advance(static_cast<std::uint32_t>(bytes));
      if (count > 0) std::memcpy(list.data(), from, bytes);
    } else {
      for (std::uint32_t i = 0; i < count; ++i) {
        list.emplace_back();
        next(list.back());
      }
    }
  }

 private:
  static inline std::uint8_t nothing_ = 0;
};

/// A message or request that roscpp reads by a BoundedStream. It has the message's type for roscpp.
template <class Message>
struct Received {
  Message message;
};

}  // namespace constraint_sim

namespace ros {
namespace message_traits {
template <class Message>
struct DataType<constraint_sim::Received<Message>> : DataType<Message> {
  using DataType<Message>::value;
  static const char* value(const constraint_sim::Received<Message>&) { return value(); }
};
template <class Message>
struct MD5Sum<constraint_sim::Received<Message>> : MD5Sum<Message> {
  using MD5Sum<Message>::value;
  static const char* value(const constraint_sim::Received<Message>&) { return value(); }
};
template <class Message>
struct Definition<constraint_sim::Received<Message>> : Definition<Message> {
  using Definition<Message>::value;
  static const char* value(const constraint_sim::Received<Message>&) { return value(); }
};
}  // namespace message_traits

namespace service_traits {
template <class Message>
struct DataType<constraint_sim::Received<Message>> : DataType<Message> {
  using DataType<Message>::value;
  static const char* value(const constraint_sim::Received<Message>&) { return value(); }
};
template <class Message>
struct MD5Sum<constraint_sim::Received<Message>> : MD5Sum<Message> {
  using MD5Sum<Message>::value;
  static const char* value(const constraint_sim::Received<Message>&) { return value(); }
};
}  // namespace service_traits

namespace serialization {
template <class Message>
struct Serializer<constraint_sim::Received<Message>> {
  template <class Stream>
  static void read(Stream& stream, constraint_sim::Received<Message>& received) {
    constraint_sim::BoundedStream bounded(stream.getData(), stream.getLength());
    bounded.next(received.message);
    stream.advance(stream.getLength() - bounded.getLength());
  }
};
}  // namespace serialization
}  // namespace ros
