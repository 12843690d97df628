#pragma once

#include <ros/datatypes.h>
#include <ros/service_callback_helper.h>

#include <boost/signals2/connection.hpp>
#include <condition_variable>
#include <memory>
#include <mutex>

namespace constraint_sim {

/// Keeps roscpp's poll thread between two rounds of events while a service thread writes a
/// response and closes its connection. Without the pause roscpp 1.15 loses calls: the poll thread
/// may already hold the event that the peer of the closed socket has hung up. A connection that it
/// accepts then may get the number of that socket, and is closed for the old event
/// (PollSet::update, bench/ros/lost_calls.py).
///
/// The poll thread is held in a listener that roscpp calls before each round, where the thread
/// holds no lock that writing or closing needs. All threads.
class PollPause {
 public:
  /// Returns the pause of this process, which ends its listener with the last owner.
  static std::shared_ptr<PollPause> shared();
  ~PollPause();
  PollPause(const PollPause&) = delete;
  PollPause& operator=(const PollPause&) = delete;

  /// Holds the poll thread from hold() to the end of the Answer. Belongs to the thread that makes
  /// the Answer; each callback of a ServiceQueue runs within an Answer.
  class Answer {
   public:
    explicit Answer(PollPause* pause);
    ~Answer();
    Answer(const Answer&) = delete;
    Answer& operator=(const Answer&) = delete;

    /// Waits until the poll thread is held, where an answer of this thread exists and roscpp closes
    /// the connection with this header after the response.
    static void hold(const ros::M_string& connection);

   private:
    PollPause* const pause_;
    bool holds_ = false;
  };

 private:
  PollPause();
  void begin();
  void end();
  void between_rounds();

  std::mutex mutex_;
  std::condition_variable changed_;
  int holders_ = 0;       ///< service threads that write a response
  bool is_held_ = false;  ///< the poll thread waits in between_rounds()
  boost::signals2::connection listener_;
};

/// Calls a service as roscpp does. The poll thread is held from the complete response on, also
/// where reading the request or the call throws, which roscpp answers as well.
template <class Spec>
class PausingCalls : public ros::ServiceCallbackHelperT<Spec> {
 public:
  using ros::ServiceCallbackHelperT<Spec>::ServiceCallbackHelperT;

  bool call(ros::ServiceCallbackHelperCallParams& params) override {
    struct AtEnd {
      const ros::ServiceCallbackHelperCallParams& params;
      ~AtEnd() { PollPause::Answer::hold(*params.connection_header); }
    } const at_end{params};
    return ros::ServiceCallbackHelperT<Spec>::call(params);
  }
};

}  // namespace constraint_sim
