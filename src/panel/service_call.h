#pragma once

#include <ros/serialization.h>
#include <ros/service_traits.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace constraint_sim::panel {

/// Reason why a service call got no response.
class CallError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Cancels waiting calls, from any thread and permanently.
class Cancellation {
 public:
  Cancellation();
  ~Cancellation();
  Cancellation(const Cancellation&) = delete;
  Cancellation& operator=(const Cancellation&) = delete;

  void cancel();
  /// Returns a file descriptor that becomes readable with cancel().
  int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

using Bytes = std::vector<std::uint8_t>;

/// Sends a serialized request to a service and returns the serialized response. Uses its own
/// connection: a call of roscpp cannot be cancelled while the node is silent, which would block
/// closing the panel. `timeout` [s]; 0: none. Throws CallError, also on cancellation.
Bytes exchange(const std::string& service, const std::string& md5, const Bytes& request,
               const Cancellation& cancellation, double timeout);

/// Calls a service with messages.
template <class Service>
typename Service::Response call_service(const std::string& service,
                                        const typename Service::Request& request,
                                        const Cancellation& cancellation, double timeout) {
  namespace serialization = ros::serialization;
  Bytes bytes(serialization::serializationLength(request));
  serialization::OStream out(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  serialization::serialize(out, request);
  bytes = exchange(service, ros::service_traits::md5sum<Service>(), bytes, cancellation, timeout);
  typename Service::Response response;
  try {
    serialization::IStream in(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
    serialization::deserialize(in, response);
  } catch (const ros::serialization::StreamOverrunException&) {
    throw CallError("the answer is cut off");
  }
  return response;
}

}  // namespace constraint_sim::panel
