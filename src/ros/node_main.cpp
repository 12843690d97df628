#include <ros/ros.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <future>
#include <iostream>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "ros/simulator_node.h"
#include "sim/errors.h"
#include "sim/words.h"

namespace {

using constraint_sim::ParameterError;
using constraint_sim::shortened;
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

  /// Returns when one has come, or the master has shut the node down; whether one has come.
  bool wait() {
    for (;;) {
      if (asked_.wait_for(std::chrono::milliseconds(20)) == std::future_status::ready) return true;
      if (!ros::ok()) return false;
    }
  }

 private:
  std::promise<void> asking_;
  std::future<void> asked_;
};

constexpr int kBadCommandLine = 2;

/// What the command line says, by ROS's syntax NAME:=VALUE.
struct CommandLine {
  std::set<std::string> parameters;  ///< private ones that it sets, _NAME:=VALUE
  bool is_from_roslaunch = false;
  bool asks_for_help = false;
  std::string mistake;  ///< what is wrong with it; empty: nothing
};

CommandLine read_command_line(int argc, char** argv) {
  CommandLine line;
  const std::vector<std::string> known = constraint_sim::parameter_names();
  std::string unscored;  // a parameter without its underscore
  std::string why;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t end = word.find(":=");
    const std::string name = word.substr(0, end);
    if (word == "--help" || word == "-h")
      line.asks_for_help = true;
    else if (end == std::string::npos || end == 0)
      line.mistake = "'" + shortened(word) + "' is not of the form _PARAMETER:=VALUE";
    else if (name == "__log")
      line.is_from_roslaunch = true;
    else if (name[0] == '_' && name.size() > 1 && name[1] != '_') {
      // roscpp throws at a bad name, and leaves on the parameter server what it has set until then
      const std::string parameter = name.substr(1);
      if (parameter[0] == '/' || !ros::names::validate(parameter, why))
        line.mistake = "no parameter can have the name '" + shortened(parameter) + "'";
      line.parameters.insert(parameter);
    } else if (std::find(known.begin(), known.end(), name) != known.end())
      unscored = name;
  }
  // roslaunch hands a <remap> of a group to each node in it
  if (!line.is_from_roslaunch && !unscored.empty() && line.mistake.empty())
    line.mistake = "'" + unscored + ":=' remaps a topic; the parameter is _" + unscored + ":=VALUE";
  return line;
}

void print_help() {
  std::cout
      << "usage: rosrun constraint_sim constraint_sim_node [_PARAMETER:=VALUE ...]\n"
         "Simulates constrained rigid bodies; services and topics are in docs/ros.md. Needs a "
         "running roscore.\n"
         "Parameters, whose meanings and defaults are in config/parameters.yaml:\n ";
  for (const std::string& name : constraint_sim::parameter_names()) std::cout << " " << name;
  std::cout << std::endl;
}

// rosconsole may be set to say nothing, and a node that does not start must say why
void explain(const std::string& why) {
  std::cerr << ros::this_node::getName() << ": " << why << std::endl;
}

/// The parameters that the command line has put on the parameter server. They are of this run.
class GivenParameters {
 public:
  explicit GivenParameters(const std::set<std::string>& names) {
    for (const std::string& name : names) handle_.getParam(name, values_[name]);
  }

  /// Notes their values again: the node writes back a number where an integer was given.
  void remember() {
    for (auto& [name, value] : values_) handle_.getParam(name, value);
  }

  /// Takes them off the parameter server, once, except where somebody else has set another value.
  void forget() {
    for (const auto& [name, value] : std::exchange(values_, {})) {
      XmlRpc::XmlRpcValue now;
      if (handle_.getParam(name, now) && now == value) handle_.deleteParam(name);
    }
  }

 private:
  ros::NodeHandle handle_{"~"};  // keeps roscpp running until the parameters are forgotten
  std::map<std::string, XmlRpc::XmlRpcValue> values_;
};

/// Runs the node; returns its exit status, and false in `is_replaced` unless the master has shut it
/// down for another node of its name.
int run(const CommandLine& line, EndSignals* signals, GivenParameters* given, bool* is_replaced) {
  try {
    const SimulatorNode node(ros::NodeHandle(), ros::NodeHandle("~"));
    given->remember();
    const std::string others = parameters_not_given(node.parameters(), line.parameters);
    if (!line.is_from_roslaunch && !others.empty())
      ROS_WARN(
          "not of this command line, but of an earlier run or of rosparam: %s; `rosparam "
          "delete %s` forgets them",
          others.c_str(), ros::this_node::getName().c_str());
    *is_replaced = !signals->wait();
    if (!*is_replaced) given->forget();  // before the node ends, which may take all its time
    return 0;
  } catch (const ParameterError& error) {
    explain(error.what());
    const ros::NodeHandle handle("~");
    if (line.parameters.count(error.name()) == 0 && handle.hasParam(error.name()))
      explain("it is not of this command line but on the parameter server; `rosparam delete " +
              handle.resolveName(error.name()) + "` forgets it");
  } catch (...) {
    explain(constraint_sim::message_of_exception());
  }
  return kBadCommandLine;
}

}  // namespace

int main(int argc, char** argv) {
  const CommandLine line = read_command_line(argc, argv);
  if (line.asks_for_help) {
    print_help();
    return 0;
  }
  if (!line.mistake.empty()) {
    std::cerr << "constraint_sim_node: " << line.mistake << "; --help lists the parameters"
              << std::endl;
    return kBadCommandLine;
  }
  EndSignals& signals = *new EndSignals;  // its thread may outlive main
  try {
    ros::init(argc, argv, "constraint_sim", ros::init_options::NoSigintHandler);
  } catch (const ros::Exception& error) {  // of a name that no node can have
    std::cerr << "constraint_sim_node: " << error.what() << std::endl;
    return kBadCommandLine;
  }
  GivenParameters given(line.parameters);
  bool is_replaced = false;
  const int status = run(line, &signals, &given, &is_replaced);
  if (!is_replaced) given.forget();  // a later node of the same name has its own
  return status;
}
