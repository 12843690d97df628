#pragma once

#include <sys/types.h>

#include <cstdio>
#include <memory>
#include <string>

namespace constraint_sim::panel {

/// Records the topics of a simulator into a bag by a separate process (`simulator_bag`, which runs
/// `rosbag record`). Functions do not wait for the process. The process ends, with a complete bag,
/// together with the recorder or its process.
class Recorder {
 public:
  ~Recorder();

  /// Begins a bag at `path`; throws std::runtime_error with the reason of a failure.
  void start(const std::string& node, const std::string& path);
  /// Asks the process to close the bag.
  void stop();
  bool is_running() const { return process_ > 0; }
  const std::string& path() const { return path_; }

  /// Result of a process that has ended since the last call.
  struct Ending {
    bool success;
    std::string message;
  };
  std::unique_ptr<Ending> take_ending();

 private:
  struct CloseFile {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string last_words() const;

  pid_t process_ = 0;
  bool was_stopped_ = false;
  std::string path_;
  std::unique_ptr<std::FILE, CloseFile>
      output_;  // unnamed file; a full pipe would block the process
};

/// Returns `prefix` with the present local time and .bag appended, as in `rosbag record -o`;
/// absolute.
std::string bag_path(const std::string& prefix);

}  // namespace constraint_sim::panel
