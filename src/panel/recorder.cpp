#include "panel/recorder.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <vector>

#include "panel/programs.h"

namespace constraint_sim::panel {
namespace {

// Returns the highest file descriptor to close in the child, which must not keep rviz's connections
// open: nodes would go on sending to them.
int highest_descriptor() {
  int highest = 255;
  if (DIR* const folder = ::opendir("/proc/self/fd")) {
    while (const dirent* entry = ::readdir(folder))
      highest = std::max(highest, std::atoi(entry->d_name));
    ::closedir(folder);
  }
  return highest + 64;  // margin for descriptors that other threads open meanwhile
}

// Runs between fork and exec, so only with calls that are safe after a fork of a process with
// threads.
[[noreturn]] void run_child(char* const* command, int output, int highest, pid_t parent) {
  ::setpgid(0, 0);  // ctrl-C in the terminal of rviz must not reach the child
  ::prctl(PR_SET_PDEATHSIG, SIGINT);
  if (::getppid() != parent) ::_exit(1);
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  ::signal(SIGINT, SIG_DFL);
  ::close(STDIN_FILENO);
  ::open("/dev/null", O_RDONLY);
  ::dup2(output, STDOUT_FILENO);
  ::dup2(output, STDERR_FILENO);
  for (int i = STDERR_FILENO + 1; i <= highest; ++i) ::close(i);
  ::execv(command[0], command);
  ::_exit(127);
}

}  // namespace

Recorder::~Recorder() { stop(); }

void Recorder::start(const std::string& node, const std::string& path) {
  if (is_running()) throw std::runtime_error("the bag " + path_ + " is still being written");
  if (::access(path.c_str(), F_OK) == 0) throw std::runtime_error(path + " exists already");
  const std::size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  if (::access(folder.c_str(), W_OK) != 0)
    throw std::runtime_error("folder " + folder + ": " + std::strerror(errno));
  output_.reset(std::tmpfile());
  if (!output_) throw std::runtime_error(std::string("no temporary file: ") + std::strerror(errno));
  std::vector<std::string> words = {program("simulator_bag"), "record", node, "-O", path,
                                    node + "/edit_log"};
  if (::access(words[0].c_str(), X_OK) != 0)
    throw std::runtime_error(words[0] + ": " + std::strerror(errno));
  std::vector<char*> command;
  for (std::string& word : words) command.push_back(&word[0]);
  command.push_back(nullptr);
  const int highest = highest_descriptor(), output = ::fileno(output_.get());
  const pid_t parent = ::getpid(), child = ::fork();
  if (child == 0) run_child(command.data(), output, highest, parent);
  if (child < 0) throw std::runtime_error(std::string("fork: ") + std::strerror(errno));
  process_ = child;
  path_ = path;
  was_stopped_ = false;
}

void Recorder::stop() {
  if (!is_running()) return;
  was_stopped_ = true;
  ::kill(-process_, SIGINT);  // the process group, with further processes
  ::kill(process_, SIGINT);   // effective before the group exists
}

std::unique_ptr<Recorder::Ending> Recorder::take_ending() {
  int status = 0;
  if (!is_running() || ::waitpid(process_, &status, WNOHANG) == 0) return nullptr;
  process_ = 0;
  if (was_stopped_ && ::access(path_.c_str(), F_OK) == 0)
    return std::make_unique<Ending>(Ending{true, "recorded " + path_});
  return std::make_unique<Ending>(Ending{false, "no bag " + path_ + ": " + last_words()});
}

std::string Recorder::last_words() const {
  std::array<char, 300> text{};
  const off_t size = ::lseek(::fileno(output_.get()), 0, SEEK_END);
  const off_t from = std::max<off_t>(0, size - static_cast<off_t>(text.size()));
  const ssize_t count = ::pread(::fileno(output_.get()), text.data(), text.size(), from);
  if (count <= 0) return "the recorder ended without a word";
  return std::string(text.data(), static_cast<std::size_t>(count));
}

std::string bag_path(const std::string& prefix) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  ::localtime_r(&now, &local);
  std::array<char, 32> time{};
  std::strftime(time.data(), time.size(), "_%Y-%m-%d-%H-%M-%S", &local);
  const std::string path = prefix + time.data() + ".bag";
  std::array<char, 4096> folder{};
  if (path[0] == '/' || ::getcwd(folder.data(), folder.size()) == nullptr) return path;
  return std::string(folder.data()) + "/" + path;
}

}  // namespace constraint_sim::panel
