#pragma once

#include <sys/types.h>

#include <cstdio>
#include <memory>
#include <string>

namespace constraint_sim::panel {

/// Records the topics of a simulator into a bag by a process of its own (`simulator_bag`, which
/// runs `rosbag record`). Nothing here waits for the process. It ends, with a whole bag, when the
/// recorder or the process of the recorder does.
class Recorder {
 public:
  ~Recorder();

  /// Begins a bag at `path`; throws std::runtime_error with the reason where that cannot be.
  void start(const std::string& node, const std::string& path);
  /// Asks the process to close the bag.
  void stop();
  bool is_running() const { return process_ > 0; }
  const std::string& path() const { return path_; }

  /// What became of a process that has ended since the last call.
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
      output_;  // without a name; a full pipe would stop the process
};

/// `prefix` with the present local time and .bag after it, as `rosbag record -o` does; absolute.
std::string bag_path(const std::string& prefix);

}  // namespace constraint_sim::panel
