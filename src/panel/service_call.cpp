// Service calls by TCPROS: connect, header, header, request, response
// (http://wiki.ros.org/ROS/TCPROS, "Service calls").
#include "panel/service_call.h"

#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>

namespace constraint_sim::panel {
namespace {

using Clock = std::chrono::steady_clock;

// Largest accepted response [bytes]; no service of this package sends more.
constexpr std::uint32_t kMostBytes = std::uint32_t{1} << 30;

void append(const std::string& field, Bytes* header) {
  std::array<std::uint8_t, 4> length;
  const auto size = static_cast<std::uint32_t>(field.size());
  for (std::size_t i = 0; i < 4; ++i) length[i] = static_cast<std::uint8_t>(size >> (8 * i));
  header->insert(header->end(), length.begin(), length.end());
  header->insert(header->end(), field.begin(), field.end());
}

Bytes with_length(const Bytes& content) {
  Bytes bytes;
  append(std::string(content.begin(), content.end()), &bytes);
  return bytes;
}

/// A connection whose reads and writes end on cancellation and at the deadline.
class Connection {
 public:
  Connection(const Cancellation& cancellation, double timeout)
      : cancellation_(cancellation),
        has_deadline_(timeout > 0.0),
        timeout_(timeout),
        deadline_(Clock::now() + std::chrono::milliseconds(std::lround(1e3 * timeout))) {}
  ~Connection() {
    if (socket_ >= 0) ::close(socket_);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void open(const std::string& host, std::uint32_t port);
  void write(const Bytes& bytes);
  Bytes read(std::size_t size);
  std::uint32_t read_length();

 private:
  bool connect(const addrinfo& address);
  void wait_for(short events);

  const Cancellation& cancellation_;
  bool has_deadline_;
  double timeout_;
  Clock::time_point deadline_;
  int socket_ = -1;
};

void Connection::wait_for(short events) {
  std::array<pollfd, 2> waiting = {{{socket_, events, 0}, {cancellation_.descriptor(), POLLIN, 0}}};
  int milliseconds = -1;
  if (has_deadline_) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline_ - Clock::now());
    milliseconds = static_cast<int>(std::max<std::int64_t>(0, left.count()));
  }
  const int count = ::poll(waiting.data(), waiting.size(), milliseconds);
  if (count < 0 && errno == EINTR) return wait_for(events);
  if (count < 0) throw CallError(std::string("poll: ") + std::strerror(errno));
  if (count > 0 && waiting[1].revents != 0) throw CallError("given up");
  if (count == 0)
    throw CallError("no answer within " + std::to_string(std::lround(timeout_)) + " s");
}

bool Connection::connect(const addrinfo& address) {
  socket_ = ::socket(address.ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (socket_ < 0) return false;
  if (::connect(socket_, address.ai_addr, address.ai_addrlen) != 0 && errno == EINPROGRESS)
    wait_for(POLLOUT);
  int error = 0;
  socklen_t size = sizeof error;
  ::getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &size);
  pollfd connected = {socket_, POLLOUT, 0};
  if (error == 0 && ::poll(&connected, 1, 0) == 1 && (connected.revents & POLLHUP) == 0)
    return true;
  ::close(socket_);
  socket_ = -1;
  return false;
}

void Connection::open(const std::string& host, std::uint32_t port) {
  addrinfo hints = {};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found) != 0)
    throw CallError("the host '" + host + "' of the node is unknown");
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> addresses(found, &::freeaddrinfo);
  for (const addrinfo* address = found; address != nullptr; address = address->ai_next)
    if (connect(*address)) return;
  throw CallError("the node is gone: nobody answers at " + host + ":" + std::to_string(port));
}

void Connection::write(const Bytes& bytes) {
  for (std::size_t sent = 0; sent < bytes.size();) {
    wait_for(POLLOUT);
    const ssize_t count = ::send(socket_, &bytes[sent], bytes.size() - sent, MSG_NOSIGNAL);
    if (count < 0 && errno != EAGAIN && errno != EINTR)
      throw CallError("the node went away during the call");
    if (count > 0) sent += static_cast<std::size_t>(count);
  }
}

Bytes Connection::read(std::size_t size) {
  Bytes bytes(size);
  for (std::size_t received = 0; received < size;) {
    wait_for(POLLIN);
    const ssize_t count = ::recv(socket_, &bytes[received], size - received, 0);
    if (count == 0 || (count < 0 && errno != EAGAIN && errno != EINTR))
      throw CallError("the node went away during the call");
    if (count > 0) received += static_cast<std::size_t>(count);
  }
  return bytes;
}

std::uint32_t Connection::read_length() {
  std::uint32_t length = 0;
  const Bytes bytes = read(4);
  for (std::size_t i = 0; i < 4; ++i) length |= static_cast<std::uint32_t>(bytes[i]) << (8 * i);
  if (length > kMostBytes) throw CallError("the answer is no answer of a service");
  return length;
}

// Connects to the service. Blocks only while the master does, as all of rviz would.
void connect_to(const std::string& service, Connection* connection) {
  XmlRpc::XmlRpcValue arguments, result, payload;
  arguments[0] = ros::this_node::getName();
  arguments[1] = service;
  if (!ros::master::execute("lookupService", arguments, result, payload, false))
    throw CallError("there is no service " + service);
  std::string host;
  std::uint32_t port = 0;
  if (!ros::network::splitURI(static_cast<std::string>(payload), host, port))
    throw CallError("the master has no address of " + service);
  connection->open(host, port);
}

void shake_hands(const std::string& service, const std::string& md5, Connection* connection) {
  Bytes header;
  append("callerid=" + ros::this_node::getName(), &header);
  append("md5sum=" + md5, &header);
  append("service=" + service, &header);
  connection->write(with_length(header));
  const Bytes answer = connection->read(connection->read_length());
  const std::string text(answer.begin(), answer.end());
  const std::size_t error = text.find("error=");
  if (error != std::string::npos)
    throw CallError("the node has another version of " + service + ": " + text.substr(error + 6));
}

}  // namespace

Cancellation::Cancellation() : descriptor_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (descriptor_ < 0) throw std::runtime_error(std::string("eventfd: ") + std::strerror(errno));
}

Cancellation::~Cancellation() { ::close(descriptor_); }

void Cancellation::cancel() { ::eventfd_write(descriptor_, 1); }

Bytes exchange(const std::string& service, const std::string& md5, const Bytes& request,
               const Cancellation& cancellation, double timeout) {
  Connection connection(cancellation, timeout);
  connect_to(service, &connection);
  shake_hands(service, md5, &connection);
  connection.write(with_length(request));
  const bool success = connection.read(1)[0] != 0;
  Bytes answer = connection.read(connection.read_length());
  if (success) return answer;
  throw CallError(answer.empty() ? "refused; the log of the node tells why"
                                 : std::string(answer.begin(), answer.end()));
}

}  // namespace constraint_sim::panel
