#include <ros/ros.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <future>
#include <iostream>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>

#include "ros/simulator_node.h"

namespace {

using constraint_sim::ParameterError;
using constraint_sim::SimulatorNode;

// [s] within which the node ends, whatever it does: reading a scene cannot be hurried
constexpr auto kMostToEnd = std::chrono::milliseconds(850);

/// SIGINT and SIGTERM, from construction on. roscpp's own handler would close the services before
/// those who wait are answered.
class EndSignals {
 public:
  EndSignals() : asked_(asking_.get_future()) {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);  // for all threads that will be
    std::thread([this, signals] {
      int signal = 0;
      sigwait(&signals, &signal);
      asking_.set_value();
      std::this_thread::sleep_for(kMostToEnd);
      _exit(128 + signal);
    }).detach();
  }
  EndSignals(const EndSignals&) = delete;
  EndSignals& operator=(const EndSignals&) = delete;

  /// Returns when one has come, or the master has shut the node down.
  void wait() {
    while (ros::ok() && asked_.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready)
      ;
  }

 private:
  std::promise<void> asking_;
  std::future<void> asked_;
};

/// Names of the private parameters in a command line.
std::set<std::string> parameters_in(int argc, char** argv) {
  std::set<std::string> names;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t end = word.find(":=");
    if (end != std::string::npos && end > 1 && word[0] == '_' && word[1] != '_')
      names.insert(word.substr(1, end - 1));
  }
  return names;
}

bool is_from_roslaunch(int argc, char** argv) {
  for (int i = 1; i < argc; ++i)
    if (std::string(argv[i]).compare(0, 7, "__log:=") == 0) return true;
  return false;
}

// what stays on the parameter server would refuse the next start as well
void forget_or_explain(const ParameterError& error, const std::set<std::string>& given) {
  const ros::NodeHandle handle("~");
  const std::string full = handle.resolveName(error.name());
  if (given.count(error.name()) > 0)
    handle.deleteParam(error.name());
  else if (handle.hasParam(error.name()))
    std::cerr << ros::this_node::getName() << ": it is not of this command line but on the "
              << "parameter server; `rosparam delete " << full << "` forgets it" << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  const std::set<std::string> given = parameters_in(argc, argv);
  const bool is_launched = is_from_roslaunch(argc, argv);
  EndSignals& signals = *new EndSignals;  // its thread may outlive main
  ros::init(argc, argv, "constraint_sim", ros::init_options::NoSigintHandler);
  try {
    const SimulatorNode node(ros::NodeHandle(), ros::NodeHandle("~"));
    const std::string others = parameters_not_given(node.parameters(), given);
    if (!is_launched && !others.empty())
      ROS_WARN(
          "not of this command line, but of an earlier run or of rosparam: %s; `rosparam "
          "delete %s` forgets them",
          others.c_str(), ros::this_node::getName().c_str());
    signals.wait();
  } catch (const ParameterError& error) {
    // rosconsole may be set to say nothing, and a node that does not start must say why
    std::cerr << ros::this_node::getName() << ": " << error.what() << std::endl;
    forget_or_explain(error, given);
    return 2;
  }
}
