#include <ros/ros.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <future>
#include <iostream>
#include <map>
#include <optional>
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

// Time within which the node ends in any case: reading a scene cannot be interrupted.
constexpr auto kMostToEnd = std::chrono::milliseconds(850);

/// Catches SIGINT and SIGTERM from construction on. The handler of roscpp would close services
/// before pending calls are answered.
class EndSignals {
 public:
  EndSignals() : asked_(asking_.get_future()) {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);  // inherited by all later threads
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

  /// Waits for a signal, or until the master shuts the node down; returns whether a signal arrived.
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

/// Command line in the syntax of ROS, NAME:=VALUE.
struct CommandLine {
  std::set<std::string> parameters;  ///< private parameters that are set, as _NAME:=VALUE
  bool is_from_roslaunch = false;
  bool asks_for_help = false;
  std::string mistake;  ///< description of the error; empty: none
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
      // roscpp throws at a bad name, and leaves the parameters that it has set before on the
      // server.
      const std::string parameter = name.substr(1);
      if (parameter[0] == '/' || !ros::names::validate(parameter, why))
        line.mistake = "no parameter can have the name '" + shortened(parameter) + "'";
      line.parameters.insert(parameter);
    } else if (std::find(known.begin(), known.end(), name) != known.end())
      unscored = name;
  }
  // roslaunch passes a <remap> of a group to each node in the group
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

// Prints an error even where rosconsole is silenced: a node that does not start must say why.
void explain(const std::string& why) {
  std::cerr << ros::this_node::getName() << ": " << why << std::endl;
}

/// Returns the value of a number, integer or not.
std::optional<double> number_of(XmlRpc::XmlRpcValue value) {
  if (value.getType() == XmlRpc::XmlRpcValue::TypeInt) return static_cast<int>(value);
  if (value.getType() == XmlRpc::XmlRpcValue::TypeDouble) return static_cast<double>(value);
  return std::nullopt;
}

/// Returns whether both are the same value of a parameter: the node writes some numbers that are
/// given as integers back as floating-point numbers.
bool are_same_value(const XmlRpc::XmlRpcValue& a, const XmlRpc::XmlRpcValue& b) {
  const std::optional<double> x = number_of(a), y = number_of(b);
  return x && y ? *x == *y : a == b;
}

/// Parameters that the command line put on the parameter server. They are valid for this run only.
class GivenParameters {
 public:
  explicit GivenParameters(const std::set<std::string>& names) {
    for (const std::string& name : names) handle_.getParam(name, values_[name]);
  }

  /// Deletes the parameters, once, except those that were set to another value since.
  void forget() {
    for (const auto& [name, value] : std::exchange(values_, {})) {
      XmlRpc::XmlRpcValue now;
      if (handle_.getParam(name, now) && are_same_value(now, value)) handle_.deleteParam(name);
    }
  }

 private:
  ros::NodeHandle handle_{"~"};  // keeps roscpp running until the parameters are deleted
  std::map<std::string, XmlRpc::XmlRpcValue> values_;
};

/// Runs the node; returns its exit status. `is_replaced` becomes true where the master shut the
/// node down for another node of its name.
int run(const CommandLine& line, EndSignals* signals, GivenParameters* given, bool* is_replaced) {
  try {
    const SimulatorNode node(ros::NodeHandle(), ros::NodeHandle("~"));
    const std::string others = parameters_not_given(node.parameters(), line.parameters);
    if (!line.is_from_roslaunch && !others.empty())
      ROS_WARN(
          "not of this command line, but of an earlier run or of rosparam: %s; `rosparam "
          "delete %s` forgets them",
          others.c_str(), ros::this_node::getName().c_str());
    *is_replaced = !signals->wait();
    if (!*is_replaced) given->forget();  // first, since the node may need all of its time to end
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
  EndSignals& signals = *new EndSignals;  // never destroyed: its thread may outlive main
  try {
    ros::init(argc, argv, "constraint_sim", ros::init_options::NoSigintHandler);
  } catch (const ros::Exception& error) {  // the name cannot be that of a node
    std::cerr << "constraint_sim_node: " << error.what() << std::endl;
    return kBadCommandLine;
  }
  GivenParameters given(line.parameters);
  bool is_replaced = false;
  const int status = run(line, &signals, &given, &is_replaced);
  if (!is_replaced) given.forget();  // a node that replaced this one has its own parameters
  return status;
}
